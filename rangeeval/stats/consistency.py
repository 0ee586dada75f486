"""Does a filter know how good it is? Normalised errors with their chi-square bounds, and whiteness of innovations.

References
----------
Bar-Shalom, Li and Kirubarajan (2001), Estimation with Applications to Tracking and Navigation, 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

FloatArray = NDArray[np.float64]


def normalised_squares(error: ArrayLike, covariance: ArrayLike) -> FloatArray:
    """e' P^-1 e (...) of errors (..., n) with covariances (..., n, n): NEES of errors, NIS of innovations.

    Components that are missing (NaN) are left out with their rows and columns; NaN where none is left or the covariance
    of those left is not positive definite. Angles must be wrapped.
    """
    e = np.asarray(error, dtype=np.float64)
    p = np.array(np.broadcast_to(np.asarray(covariance, dtype=np.float64), (*e.shape, e.shape[-1])))
    missing = ~np.isfinite(e)
    clean = np.where(missing, 0.0, e)
    p[missing] = 0.0
    np.swapaxes(p, -1, -2)[missing] = 0.0
    diagonal = np.arange(e.shape[-1])
    p[..., diagonal, diagonal] = np.where(missing, 1.0, p[..., diagonal, diagonal])
    bad = ~np.all(np.isfinite(p), axis=(-2, -1)) | np.all(missing, axis=-1)
    p[bad] = np.eye(e.shape[-1])
    bad |= np.linalg.eigvalsh(p)[..., 0] <= 0
    p[bad] = np.eye(e.shape[-1])
    squares = np.einsum("...i,...i->...", clean, np.linalg.solve(p, clean[..., None])[..., 0])
    found: FloatArray = np.where(bad, np.nan, squares)
    return found


def average_bounds(dof: ArrayLike, count: ArrayLike, confidence: float = 0.95) -> tuple[FloatArray, FloatArray]:
    """Bounds (low, high) of the average of `count` independent normalised squares, each divided by its `dof`.

    A consistent filter stays inside with the given confidence: 100 runs of 6 degrees of freedom [0.890, 1.116].
    """
    tail = (1 - _checked(confidence)) / 2
    total = np.asarray(dof, dtype=np.float64) * np.asarray(count, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        low: FloatArray = np.where(total > 0, 2 * special.gammaincinv(total / 2, tail) / total, np.nan)[()]
        high: FloatArray = np.where(total > 0, 2 * special.gammainccinv(total / 2, tail) / total, np.nan)[()]
    return low, high


@dataclass(frozen=True)
class Consistency:
    """The average of normalised squares per degree of freedom, and the bounds it should lie in.

    `verdict`: `consistent`, `optimistic` (errors larger than the filter believes), `pessimistic`, or `unknown` without
    data.
    """

    average: float
    low: float
    high: float
    count: int

    @property
    def verdict(self) -> str:
        """What the average says."""
        if self.count == 0:
            return "unknown"
        if self.average > self.high:
            return "optimistic"
        return "pessimistic" if self.average < self.low else "consistent"


def consistency(squares: ArrayLike, dof: ArrayLike, confidence: float = 0.95) -> Consistency:
    """Judge normalised squares (n) of `dof` degrees of freedom each (n, or one for all), which must be independent.

    Missing squares, and those without degrees of freedom, are left out.
    """
    s, d = np.broadcast_arrays(np.asarray(squares, dtype=np.float64), np.asarray(dof, dtype=np.float64))
    used = np.isfinite(s) & (d > 0)
    total = float(d[used].sum())
    if total == 0:
        return Consistency(float("nan"), float("nan"), float("nan"), 0)
    low, high = average_bounds(total, 1, confidence)
    return Consistency(float(s[used].sum()) / total, float(low), float(high), int(used.sum()))


@dataclass(frozen=True)
class Whiteness:
    """Lag-one autocorrelation of innovations, and the bound that white ones keep: +- `bound`."""

    correlation: float
    bound: float
    count: int

    @property
    def white(self) -> bool:
        """Whether the correlation is inside its bound."""
        return abs(self.correlation) <= self.bound


def whiteness(innovation: ArrayLike, sigma: ArrayLike = 1.0, confidence: float = 0.95) -> Whiteness:
    """Lag-one autocorrelation of innovations (n), each divided by its `sigma`, without removing a mean.

    Innovations of a matched filter have zero mean and no correlation. Pairs with a missing member are left out; `count`
    is the number of pairs.
    """
    u = np.asarray(innovation, dtype=np.float64) / np.asarray(sigma, dtype=np.float64)
    both = np.isfinite(u[1:]) & np.isfinite(u[:-1])
    pairs = int(both.sum())
    known = u[np.isfinite(u)]
    power = float(np.mean(known**2)) if known.size else float("nan")
    if pairs == 0 or not power > 0:
        return Whiteness(float("nan"), float("nan"), pairs)
    correlation = float(np.mean(u[1:][both] * u[:-1][both])) / power
    bound = float(special.ndtri(0.5 + _checked(confidence) / 2)) / np.sqrt(pairs)
    return Whiteness(correlation, float(bound), pairs)


def _checked(confidence: float) -> float:
    if not 0 < confidence < 1:
        raise ValueError(f"confidence is {confidence}; give a number between 0 and 1, such as 0.95")
    return confidence
