"""Sigma of a track's estimates from residuals: three ways to take sigma, mean gains or gains of each sample.

The ratio q of filtered to residual variance belongs to the filter and comes in as a function of the gains or
as a number per sample, so these formulas serve any filter that has one.

None of the sigmas is corrected for the small bias of a square root (`c4`): the interval carries it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from rangeeval.stats.moments import WeightedMoments, moments, weighted_moments

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

#: `paper`: no mean removed, divisor N - 1 (as printed); `zero_mean`: divisor N; `mean_removed`: usual.
Mode = Literal["paper", "zero_mean", "mean_removed"]
Ratio = Callable[[FloatArray, FloatArray], FloatArray]

#: Below this cosine of the off-boresight angle the small-angle conversion is unreliable.
GRAZING_COSINE = 0.1


def residual_sigma(n: ArrayLike, mean: ArrayLike, m2: ArrayLike, mode: Mode = "mean_removed") -> FloatArray:
    """Sigma of residuals from their count, mean and sum of squared deviations; NaN for fewer than two.

    References
    ----------
    Shin and Kim (2015), eq 11 (mode `paper`); its divisor N - 1 without removing the mean is not unbiased.
    """
    count, centre, squares = _float(n), _float(mean), _float(m2)
    total = squares if mode == "mean_removed" else squares + count * centre**2
    return _root(total, count, mode)


def weighted_sigma(n: ArrayLike, mean: ArrayLike, weighted: WeightedMoments, mode: Mode = "mean_removed") -> FloatArray:
    """Sigma of estimates from residuals that each carry their own ratio as weight; NaN for fewer than two.

    `n`, `mean`: count and unweighted mean of the same residuals, per group. With weights q the result is
    sigma of the filtered position; with q / (R^2 - y^2) it is sigma of the angle. Unlike the form with mean
    gains it stays right when the gains switch inside a bin (where that one is up to 26 % high).
    """
    centre = _float(mean) if mode == "mean_removed" else 0.0
    return _root(weighted.sum_of_squares_about(centre), _float(n), mode)


def expected_variance_ratio(n: ArrayLike, mode: Mode = "mean_removed", vif: ArrayLike = 1.0) -> FloatArray:
    """Expected value of the variance estimate over the true residual variance, for zero-mean residuals.

    `vif` is the variance inflation of the mean (1 for white residuals, near 0 at constant velocity).
    """
    count, inflation = _float(n), _float(vif)
    with np.errstate(divide="ignore", invalid="ignore"):
        if mode == "paper":
            ratio: FloatArray = count / (count - 1)
        elif mode == "zero_mean":
            ratio = np.ones_like(count)
        else:
            ratio = (count - inflation) / (count - 1)
    return ratio


def c4(nu: ArrayLike) -> FloatArray:
    """Expected sigma estimate over the true one at `nu` degrees of freedom: 0.80 at 1, 0.99 at 29."""
    half = _float(nu) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.exp(special.gammaln(half + 0.5) - special.gammaln(half))
        ratio: FloatArray = np.where(half > 0, root / np.sqrt(half), np.nan)[()]
    return ratio


@dataclass(frozen=True)
class TrackSigma:
    """Sigma of one axis of a track over one set of samples, and what it was made of. NaN: cannot be had."""

    n: int
    n_dropped: int
    mean: float
    sigma_residual: float
    alpha_mean: float
    beta_mean: float
    q: float
    sigma: float
    sigma_per_sample: float


def track_sigma(
    residual: ArrayLike,
    alpha: ArrayLike,
    beta: ArrayLike,
    ratio: Ratio,
    *,
    used: ArrayLike | None = None,
    mode: Mode = "mean_removed",
) -> TrackSigma:
    """Sigma of the filtered position on one axis, from the residuals and gains of one bin.

    `residual` (n), `alpha`, `beta` (n, or one number); `ratio(alpha, beta)` gives the filtered over the
    residual variance; `used` (n, boolean) says which samples count (finite residuals by default). With fewer
    than two used samples every sigma is NaN.

    References
    ----------
    Shin and Kim (2015), eqs 10-13, and the same with the ratio of each sample.
    """
    e, a, b, kept = _screened(residual, alpha, beta, used)
    m = moments(e[kept])
    w = weighted_moments(e[kept], _ratio_of_samples(ratio, a[kept], b[kept]))
    alpha_mean, beta_mean = _mean(a[kept]), _mean(b[kept])
    enough = m.n[0] >= 2
    q = float(ratio(np.asarray(alpha_mean), np.asarray(beta_mean))) if enough else np.nan
    sigma_residual = float(residual_sigma(m.n, m.mean, m.m2, mode)[0])
    return TrackSigma(
        n=int(m.n[0]),
        n_dropped=int(e.size - m.n[0]),
        mean=float(m.mean[0]),
        sigma_residual=sigma_residual,
        alpha_mean=alpha_mean,
        beta_mean=beta_mean,
        q=q,
        sigma=sigma_residual * float(np.sqrt(q)),
        sigma_per_sample=float(weighted_sigma(m.n, m.mean, w, mode)[0]),
    )


AngleFlag = Literal["ok", "grazing", "invalid", "too_few"]


@dataclass(frozen=True)
class AngleSigma:
    """Sigma (rad) of one array angle, the cross-range sigma (m) behind it, and whether the geometry allows
    it.
    """

    cross_range: TrackSigma
    range_mean_m: float
    cross_range_mean_m: float
    sigma_rad: float
    sigma_per_sample_rad: float
    flag: AngleFlag


def angle_sigma(
    residual_m: ArrayLike,
    alpha: ArrayLike,
    beta: ArrayLike,
    range_predicted_m: ArrayLike,
    cross_range_predicted_m: ArrayLike,
    ratio: Ratio,
    *,
    used: ArrayLike | None = None,
    mode: Mode = "mean_removed",
) -> AngleSigma:
    """Sigma of an array angle (theta_e from y, theta_a from z) from cross-range residuals and gains of one
    bin.

    All arrays (n); metres in, radians out. Samples without a finite prediction are left out. The flag is
    `too_few` below two samples, `invalid` when the mean cross-range reaches the mean range (no result),
    `grazing` when the cosine is below 0.1 (usually a wrong frame or unit in the log).

    References
    ----------
    Shin and Kim (2015), eqs 22-32.
    """
    r, c = _float(range_predicted_m), _float(cross_range_predicted_m)
    e, a, b, kept = _screened(residual_m, alpha, beta, used)
    kept = kept & np.isfinite(r) & np.isfinite(c)
    cross = track_sigma(e, a, b, ratio, used=kept, mode=mode)
    range_mean, cross_mean = _mean(r[kept]), _mean(c[kept])
    sigma, cosine = sigma_to_angle(cross.sigma, range_mean, cross_mean)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (r - np.abs(c)) * (r + np.abs(c))
        weights = np.where(depth > 0, _ratio_of_samples(ratio, a, b) / depth, np.nan)
    w = weighted_moments(e[kept], weights[kept])
    per_sample = float(weighted_sigma(float(cross.n), cross.mean, w, mode)[0])
    if not np.all(depth[kept] > 0):
        per_sample = np.nan
    return AngleSigma(cross, range_mean, cross_mean, float(sigma), per_sample, angle_flag(cross.n, float(cosine)))


def sigma_to_angle(
    sigma_m: ArrayLike, range_mean_m: ArrayLike, cross_range_mean_m: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Turn a cross-range sigma (m) into an angle sigma (rad); also give the cosine of the angle off
    boresight.

    NaN where the mean cross-range reaches the mean range.

    References
    ----------
    Shin and Kim (2015), eq 29: E[R]^2 - E[y]^2 is squares of means, here (ER - Ey)(ER + Ey).
    """
    r, c = _float(range_mean_m), _float(cross_range_mean_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(r > np.abs(c), np.sqrt((r - c) * (r + c)), np.nan)
        return (_float(sigma_m) / depth)[()], (depth / r)[()]


def angle_flag(n: int, cosine: float) -> AngleFlag:
    """Say whether an angle sigma can be trusted, from the number of samples and the cosine off boresight."""
    if n < 2:
        return "too_few"
    if not cosine > 0:
        return "invalid"
    return "grazing" if cosine < GRAZING_COSINE else "ok"


def range_leak(
    sigma_range_m: ArrayLike, sigma_angle_rad: ArrayLike, range_m: ArrayLike, cross_range_m: ArrayLike
) -> FloatArray:
    """Range noise that enters the angle, over the angle sigma: tan(theta) sigma_R / (R sigma_theta). Warn
    above 0.3.

    A tracker that updates range and cross-range independently turns range errors into angle errors, and the
    residuals do not show it (down to 0.6 of the true sigma at 45 degrees off boresight).
    """
    r, c = _float(range_m), _float(cross_range_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        tangent = np.abs(c) / np.where(r > np.abs(c), np.sqrt((r - c) * (r + c)), np.nan)
        leak: FloatArray = (tangent * _float(sigma_range_m) / (r * _float(sigma_angle_rad)))[()]
    return leak


def angle_sigma_with_range_noise(
    sigma_cross_m: ArrayLike, sigma_range_m: ArrayLike, range_mean_m: ArrayLike, cross_range_mean_m: ArrayLike
) -> FloatArray:
    """Upper bound (rad) of the angle sigma when range noise leaks into it, for uncorrelated errors."""
    r, c = _float(range_mean_m), _float(cross_range_mean_m)
    total = np.hypot(_float(sigma_cross_m), c / r * _float(sigma_range_m))
    return sigma_to_angle(total, r, c)[0]


def relative_difference(first: ArrayLike, second: ArrayLike) -> FloatArray:
    """Give |first / second - 1|: 0.02 between mean-gain and per-sample sigma is where gains vary too much in
    a bin.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        difference: FloatArray = np.abs(_float(first) / _float(second) - 1)
    return difference


def _screened(
    residual: ArrayLike, alpha: ArrayLike, beta: ArrayLike, used: ArrayLike | None
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
    e = np.atleast_1d(_float(residual))
    a, b = np.broadcast_to(_float(alpha), e.shape), np.broadcast_to(_float(beta), e.shape)
    kept = np.isfinite(e) & np.isfinite(a) & np.isfinite(b)
    if used is not None:
        kept = kept & np.asarray(used, dtype=bool)
    return e, a, b, kept


def _ratio_of_samples(ratio: Ratio, alpha: FloatArray, beta: FloatArray) -> FloatArray:
    return np.asarray(ratio(alpha, beta), dtype=np.float64)


def _root(total: FloatArray, n: FloatArray, mode: Mode) -> FloatArray:
    if mode not in ("paper", "zero_mean", "mean_removed"):
        raise ValueError(f"mode is {mode!r}; it can be 'paper', 'zero_mean' or 'mean_removed'")
    divisor = n if mode == "zero_mean" else n - 1
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma: FloatArray = np.sqrt(np.where(n >= 2, total / divisor, np.nan))
    return sigma


def _mean(x: FloatArray) -> float:
    return float(x.mean()) if x.size else float("nan")


def _float(value: ArrayLike) -> FloatArray:
    return np.asarray(value, dtype=np.float64)
