"""Sums that add up: moments of residuals per group, gathered chunk by chunk and merged in any order.

Every field is an array with one entry per group (a bin, a leg, a waveform). The moments are central, so a
large mean costs no digits, and merging two sets gives what one pass over all samples would have given (to
rounding).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Moments:
    """Count, mean and the sums of the 2nd, 3rd and 4th powers of deviations from the mean, per group."""

    n: FloatArray
    mean: FloatArray
    m2: FloatArray
    m3: FloatArray
    m4: FloatArray

    def merge(self, other: Moments) -> Moments:
        """Give the moments of both sets of samples together.

        References
        ----------
        Pébay (2008), Formulas for robust, one-pass parallel computation of covariances and higher moments.
        """
        na, nb = self.n, other.n
        n = na + nb
        some = np.where(n > 0, n, 1.0)
        # A group that one side has never seen has mean NaN there; it must not spoil the other side.
        mean_a = np.where(na > 0, self.mean, 0.0)
        mean_b = np.where(nb > 0, other.mean, 0.0)
        d = np.where((na > 0) & (nb > 0), mean_b - mean_a, 0.0)
        mean = np.where(na > 0, mean_a + d * nb / some, mean_b)
        cross = d**2 * na * nb / some
        m2 = self.m2 + other.m2 + cross
        m3 = self.m3 + other.m3 + cross * d * (na - nb) / some + 3 * d * (na * other.m2 - nb * self.m2) / some
        m4 = (
            self.m4
            + other.m4
            + cross * d**2 * (na**2 - na * nb + nb**2) / some**2
            + 6 * d**2 * (na**2 * other.m2 + nb**2 * self.m2) / some**2
            + 4 * d * (na * other.m3 - nb * self.m3) / some
        )
        return Moments(n, np.where(n > 0, mean, np.nan), m2, m3, m4)

    @property
    def skewness(self) -> FloatArray:
        """Third standardised moment (0 for a symmetric distribution); NaN where all samples are equal."""
        with np.errstate(divide="ignore", invalid="ignore"):
            skew: FloatArray = np.where(self.m2 > 0, np.sqrt(self.n) * self.m3 / self.m2**1.5, np.nan)
        return skew

    @property
    def kurtosis(self) -> FloatArray:
        """Fourth standardised moment (3 for a normal distribution); NaN where all samples are equal."""
        with np.errstate(divide="ignore", invalid="ignore"):
            kurt: FloatArray = np.where(self.m2 > 0, self.n * self.m4 / self.m2**2, np.nan)
        return kurt


@dataclass(frozen=True)
class WeightedMoments:
    """Sum of weights, weighted mean and weighted sum of squared deviations from that mean, per group."""

    weight: FloatArray
    mean: FloatArray
    m2: FloatArray

    def merge(self, other: WeightedMoments) -> WeightedMoments:
        """Give the weighted moments of both sets of samples together."""
        wa, wb = self.weight, other.weight
        w = wa + wb
        some = np.where(w > 0, w, 1.0)
        mean_a = np.where(wa > 0, self.mean, 0.0)
        mean_b = np.where(wb > 0, other.mean, 0.0)
        d = np.where((wa > 0) & (wb > 0), mean_b - mean_a, 0.0)
        mean = np.where(wa > 0, mean_a + d * wb / some, mean_b)
        return WeightedMoments(w, np.where(w > 0, mean, np.nan), self.m2 + other.m2 + d**2 * wa * wb / some)

    def sum_of_squares_about(self, centre: ArrayLike) -> FloatArray:
        """Give the weighted sum of squared deviations from any other centre, per group."""
        away = np.where(self.weight > 0, self.mean - np.asarray(centre, dtype=np.float64), 0.0)
        total: FloatArray = self.m2 + self.weight * away**2
        return total


def moments(values: ArrayLike, group: ArrayLike | None = None, groups: int = 1) -> Moments:
    """Gather the moments of `values` (n) per `group` (n whole numbers from 0; negative: left out).

    Values that are not finite are left out.
    """
    x, g, _ = _grouped(values, group)
    n = _sum(g, groups)
    mean = _mean(_sum(g, groups, x), n)
    d = x - mean[g]
    d2 = d * d
    return Moments(n, mean, _sum(g, groups, d2), _sum(g, groups, d2 * d), _sum(g, groups, d2 * d2))


def weighted_moments(
    values: ArrayLike, weights: ArrayLike, group: ArrayLike | None = None, groups: int = 1
) -> WeightedMoments:
    """Gather the weighted moments of `values` (n) with `weights` (n, not negative) per `group`, as in
    `moments`.

    Where a value or a weight is not finite the sample is left out.
    """
    raw = np.asarray(weights, dtype=np.float64).ravel()
    x, g, keep = _grouped(values, group, np.isfinite(raw))
    w = raw[keep]
    weight = _sum(g, groups, w)
    mean = _mean(_sum(g, groups, w * x), weight)
    d = np.where(w > 0, x - mean[g], 0.0)
    return WeightedMoments(weight, mean, _sum(g, groups, w * d * d))


def _grouped(
    values: ArrayLike, group: ArrayLike | None, also: NDArray[np.bool_] | None = None
) -> tuple[FloatArray, NDArray[np.intp], NDArray[np.bool_]]:
    """Values and group numbers of the samples that count, and which those are."""
    x = np.asarray(values, dtype=np.float64).ravel()
    g = np.zeros(x.size, dtype=np.intp) if group is None else np.asarray(group, dtype=np.intp).ravel()
    for name, size in (("group numbers", g.size), ("weights", x.size if also is None else also.size)):
        if size != x.size:
            raise ValueError(f"{x.size} values but {size} {name}; give one a value")
    keep = np.isfinite(x) & (g >= 0)
    if also is not None:
        keep &= also
    return x[keep], g[keep], keep


def _sum(group: NDArray[np.intp], groups: int, weights: FloatArray | None = None) -> FloatArray:
    return np.bincount(group, weights=weights, minlength=groups).astype(np.float64)


def _mean(total: FloatArray, n: FloatArray) -> FloatArray:
    mean: FloatArray = np.where(n > 0, total / np.where(n > 0, n, 1.0), np.nan)
    return mean
