"""Intervals of a sigma and what they say about a requirement.

All rest on nu s^2 / sigma^2 being chi-square with `nu` degrees of freedom; `nu` is the effective number of
samples (less one when the mean was removed) and need not be whole. Scalars or arrays that broadcast; NaN
where nu is not above zero. Sigma of an estimate is a fixed factor times sigma of the residuals, so its
interval is these ends times that factor.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

FloatArray = NDArray[np.float64]
Verdict = Literal["pass", "fail", "inconclusive"]


def degrees_of_freedom(n_eff: ArrayLike, *, mean_removed: bool = True, kurtosis: ArrayLike = 3.0) -> FloatArray:
    """Degrees of freedom of a variance estimate, less one for a removed mean, fewer for heavy tails.

    Heavy tails scatter s^2 more: its variance grows by (kurtosis - 1)/2, so nu becomes 2 nu / (kurtosis - 1).
    NaN where nothing is left.
    """
    nu = _float(n_eff) - (1.0 if mean_removed else 0.0)
    tails = _float(kurtosis) - 1
    with np.errstate(divide="ignore", invalid="ignore"):
        adjusted: FloatArray = np.where((nu > 0) & (tails > 0), 2 * nu / tails, np.nan)[()]
    return adjusted


def sigma_interval(s: ArrayLike, nu: ArrayLike, confidence: float = 0.95) -> tuple[FloatArray, FloatArray]:
    """Two-sided interval (low, high) that holds the true sigma with the given confidence."""
    tail = (1 - _checked(confidence)) / 2
    sigma = _float(s)
    return sigma / _chi_over_nu(nu, 1 - tail), sigma / _chi_over_nu(nu, tail)


def sigma_upper_bound(s: ArrayLike, nu: ArrayLike, confidence: float = 0.95) -> FloatArray:
    """One-sided bound that the true sigma stays below, with the given confidence."""
    bound: FloatArray = _float(s) / _chi_over_nu(nu, 1 - _checked(confidence))
    return bound


def sigma_lower_bound(s: ArrayLike, nu: ArrayLike, confidence: float = 0.95) -> FloatArray:
    """One-sided bound that the true sigma stays above, with the given confidence."""
    bound: FloatArray = _float(s) / _chi_over_nu(nu, _checked(confidence))
    return bound


def mean_interval(
    mean: ArrayLike,
    s: ArrayLike,
    n: ArrayLike,
    vif: ArrayLike = 1.0,
    confidence: float = 0.95,
    dof: ArrayLike | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Two-sided interval (low, high) of a mean of correlated samples; `vif` inflates the variance of the
    mean.

    References
    ----------
    Student's t with min(n, n / vif) - 1 degrees of freedom, unless `dof` says how well `vif` is known.
    """
    count, inflation = _float(n), _float(vif)
    freedom = np.minimum(count, count / inflation) - 1 if dof is None else np.where(count > 1, _float(dof), np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        quantile = special.stdtrit(np.where(freedom > 0, freedom, np.nan), (1 + _checked(confidence)) / 2)
        half = quantile * _float(s) * np.sqrt(inflation / count)
    centre = _float(mean)
    return centre - half, centre + half


def max_passing_ratio(nu: ArrayLike, confidence: float = 0.95) -> FloatArray:
    """Largest sigma estimate over limit that still demonstrates the limit: 0.78 at nu 29, 0.95 at nu 499."""
    return _chi_over_nu(nu, 1 - _checked(confidence))


def family_wise_confidence(confidence: float, judged: int) -> float:
    """Confidence each of `judged` bins needs, so that all verdicts hold together (Bonferroni).

    Raises
    ------
    ValueError : fewer than one bin, or a confidence outside (0, 1).
    """
    if judged < 1:
        raise ValueError(f"{judged} bins are judged together; give at least 1")
    return 1 - (1 - _checked(confidence)) / judged


@dataclass(frozen=True)
class Compliance:
    """A verdict on one sigma and the bounds behind it."""

    verdict: Verdict
    lower: float
    upper: float
    max_passing_ratio: float


def judge(s: float, nu: float, limit: float, confidence: float = 0.95) -> Compliance:
    """Judge a sigma against its limit: `pass` if the upper bound is within it, `fail` if the lower bound is
    beyond.

    Anything else, and anything without an estimate, is `inconclusive`: the data do not decide.
    """
    lower = float(sigma_lower_bound(s, nu, confidence))
    upper = float(sigma_upper_bound(s, nu, confidence))
    verdict: Verdict = "pass" if upper <= limit else "fail" if lower > limit else "inconclusive"
    return Compliance(verdict, lower, upper, float(max_passing_ratio(nu, confidence)))


def further_samples(s: float, nu: float, n: float, limit: float, confidence: float = 0.95) -> float:
    """Number of samples still needed until the verdict is decided, if sigma and the correlation stay as they
    are.

    0 when it is decided already; infinite when the estimate equals the limit; NaN without an estimate. `nu`
    is taken to grow in proportion to the number of samples `n`.
    """
    if not (nu > 0 and n > 0 and limit > 0 and np.isfinite(s)):
        return float("nan")
    if judge(s, nu, limit, confidence).verdict != "inconclusive":
        return 0.0
    if s == limit:
        return float("inf")

    def decided(m: float) -> bool:
        return judge(s, nu * (n + m) / n, limit, confidence).verdict != "inconclusive"

    high = 1.0
    while not decided(high):
        high *= 2
        if high > 1e15:
            return float("inf")
    low = high / 2 if high > 1 else 0.0
    while high - low > 1:
        middle = float(np.floor((low + high) / 2))
        low, high = (low, middle) if decided(middle) else (middle, high)
    return high


def variance_ratio_interval(
    s: ArrayLike, nu: ArrayLike, predicted: ArrayLike, confidence: float = 0.95
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Assessed over predicted variance with its interval (ratio, low, high): an interval without 1 is a
    disagreement.

    Above 1: clutter, multipath, manoeuvre or a waveform's effect; below 1: a pessimistic noise model.
    """
    low, high = sigma_interval(s, nu, confidence)
    reference = _float(predicted)
    with np.errstate(divide="ignore", invalid="ignore"):
        return (_float(s) / reference) ** 2, (low / reference) ** 2, (high / reference) ** 2


def _chi_over_nu(nu: ArrayLike, probability: float) -> FloatArray:
    """Give sqrt(chi-square quantile / nu) at a cumulative probability, NaN where nu is not above zero."""
    dof = _float(nu)
    half = np.where(dof > 0, dof, np.nan) / 2
    # The upper tail has its own inverse: 1 - p would lose the digits of a small p.
    quantile = (
        special.gammaincinv(half, probability) if probability < 0.5 else special.gammainccinv(half, 1 - probability)
    )
    root: FloatArray = np.sqrt(quantile / half)
    return root[()]


def _checked(confidence: float) -> float:
    if not 0 < confidence < 1:
        raise ValueError(f"confidence is {confidence!r}; give a fraction between 0 and 1, such as 0.95")
    return confidence


def _float(value: ArrayLike) -> FloatArray:
    return np.asarray(value, dtype=np.float64)
