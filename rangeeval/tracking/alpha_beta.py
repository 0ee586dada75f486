"""The alpha-beta tracking filter in steady state: what its gains say about the accuracy of its estimates.

Notation: predict `xbar = xhat + T vhat`; residual `e = z - xbar`; update `xhat = xbar + alpha e`, `vhat =
vbar + (beta/T) e`. Every variance is for white measurement noise of sigma `sigma_v`. Outside the stability
triangle no steady state exists and the variances are NaN.

The formulas are those of Shin and Kim (2015), "A Study for Assessment of Track Accuracy of Phased Array Radar
Associated with alpha-beta Filter", with the two velocity covariances (its A10, A11) corrected by the missing
1/T and 2/T^2. Functions take scalars or arrays that broadcast, unless they say otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


def is_stable(alpha: ArrayLike, beta: ArrayLike) -> BoolArray:
    """Tell whether a filter with these gains forgets its past: alpha > 0, beta > 0 and 2 alpha + beta < 4.

    NaN gains are not stable, and neither are the zero gains that trackers log while coasting.

    References
    ----------
    Jury's criterion on z^2 - (2 - alpha - beta) z + (1 - alpha).
    """
    a, b = _pair(alpha, beta)
    stable: BoolArray = (a > 0) & (b > 0) & (2 * a + b < 4)
    return stable


def usable(residual: ArrayLike, alpha: ArrayLike, beta: ArrayLike) -> BoolArray:
    """Tell which updates can enter an assessment: a finite residual made with stable gains."""
    used: BoolArray = np.isfinite(np.asarray(residual, dtype=np.float64)) & is_stable(alpha, beta)
    return used


def gains_from_tracking_index(index: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Give the optimal gains (alpha, beta) for a tracking index sigma_a T^2 / sigma_v.

    `sigma_a` is the sigma of a white, piecewise constant acceleration. The form used keeps all digits when
    the index is small (1 - s is computed without subtracting nearly equal numbers).

    References
    ----------
    Kalata (1984), The tracking index: a generalized parameter for alpha-beta and alpha-beta-gamma target
    trackers.
    """
    lam = np.asarray(index, dtype=np.float64)
    with np.errstate(invalid="ignore"):
        root = np.sqrt(lam * (8 + lam))
        # (root - lam)/4, written as a quotient so that a large index loses no digits either
        r = np.where(lam > 0, 2 * lam / (root + lam + (lam == 0)), np.where(lam == 0, 0.0, np.nan))
    return (r * (2 - r))[()], (2 * r**2)[()]


def beta_from_alpha(alpha: ArrayLike) -> FloatArray:
    """Give the beta that goes with alpha in the optimal design: 2 (2 - alpha) - 4 sqrt(1 - alpha).

    References
    ----------
    Kalata (1984). Other rules: Benedict and Bordner (1962) alpha^2/(2 - alpha), fading memory (1 -
    sqrt(1-alpha))^2.
    """
    a = np.asarray(alpha, dtype=np.float64)
    with np.errstate(invalid="ignore"):
        beta: FloatArray = 2 * (a / (1 + np.sqrt(1 - a))) ** 2  # 1 - s = alpha/(1 + s), s = sqrt(1 - alpha)
    return beta


def tracking_index(alpha: ArrayLike, beta: ArrayLike) -> FloatArray:
    """Give the tracking index beta / sqrt(1 - alpha) of optimal gains; NaN when alpha is 1 or more."""
    a, b = _pair(alpha, beta)
    with np.errstate(invalid="ignore", divide="ignore"):
        index: FloatArray = np.where(a < 1, b / np.sqrt(1 - a), np.nan)[()]
    return index


def residual_variance(alpha: ArrayLike, beta: ArrayLike, sigma_v: ArrayLike = 1.0) -> FloatArray:
    """Variance of the residual while the target flies at constant velocity.

    References
    ----------
    Shin and Kim (2015), eq 7.
    """
    a, b = _gains(alpha, beta)
    return _times_square((4 * a + 2 * b) / _denominator(a, b), sigma_v)


def predicted_variance(alpha: ArrayLike, beta: ArrayLike, sigma_v: ArrayLike = 1.0) -> FloatArray:
    """Variance of the predicted position at constant velocity: the residual's less the measurement's."""
    a, b = _gains(alpha, beta)
    return _times_square((2 * a**2 + a * b + 2 * b) / _denominator(a, b), sigma_v)


def filtered_variance(alpha: ArrayLike, beta: ArrayLike, sigma_v: ArrayLike = 1.0) -> FloatArray:
    """Variance of the filtered position at constant velocity.

    References
    ----------
    Shin and Kim (2015), eq 8 (A9).
    """
    a, b = _gains(alpha, beta)
    return _times_square((2 * a**2 - 3 * a * b + 2 * b) / _denominator(a, b), sigma_v)


def position_velocity_covariance(
    alpha: ArrayLike, beta: ArrayLike, interval_s: ArrayLike, sigma_v: ArrayLike = 1.0
) -> FloatArray:
    """Covariance of the filtered position and velocity at constant velocity, in (unit of sigma_v)^2 / s.

    References
    ----------
    Shin and Kim (2015), eq A10, with the factor 1/T that its print lacks.
    """
    a, b = _gains(alpha, beta)
    return _times_square(b * (2 * a - b) / (np.asarray(interval_s) * _denominator(a, b)), sigma_v)


def velocity_variance(alpha: ArrayLike, beta: ArrayLike, interval_s: ArrayLike, sigma_v: ArrayLike = 1.0) -> FloatArray:
    """Variance of the filtered velocity at constant velocity, in (unit of sigma_v / s)^2.

    References
    ----------
    Shin and Kim (2015), eq A11, with the factor 2/T^2 that its print lacks.
    """
    a, b = _gains(alpha, beta)
    return _times_square(2 * b**2 / (np.asarray(interval_s) ** 2 * _denominator(a, b)), sigma_v)


def q_cv(alpha: ArrayLike, beta: ArrayLike) -> FloatArray:
    """Filtered over residual variance when the target flies at constant velocity.

    True only if the target does not manoeuvre over the filter's memory; with gains that are optimal for a
    real manoeuvre `q_white` is right, and sigma from this ratio is 0.87 to 1.63 of the truth.

    References
    ----------
    Shin and Kim (2015), eq 9.
    """
    a, b = _gains(alpha, beta)
    q: FloatArray = (2 * a**2 - 3 * a * b + 2 * b) / (2 * (2 * a + b))
    return q


def q_white(alpha: ArrayLike, beta: ArrayLike | None = None) -> FloatArray:
    """Filtered over residual variance when the gains are optimal, so that the residual is white: alpha (1 -
    alpha).

    `beta` is taken only so that both ratios can be called alike; it has no influence. NaN unless 0 < alpha <=
    1.
    """
    del beta
    a = np.asarray(alpha, dtype=np.float64)
    q: FloatArray = np.where((a > 0) & (a <= 1), a * (1 - a), np.nan)[()]
    return q


def q_cautious(alpha: ArrayLike, beta: ArrayLike) -> FloatArray:
    """Give the larger of the two ratios: for judging a requirement when the manoeuvre is not known."""
    q: FloatArray = np.fmax(q_cv(alpha, beta), q_white(alpha))
    return q


def q_from_phi(alpha: ArrayLike, phi: ArrayLike) -> FloatArray:
    """Filtered over residual variance, given that a share `phi` of the residual variance is the prediction's.

    Holds for any motion of the target and any prediction; asks only for white measurement noise:
    var xhat = (1-alpha)^2 (var e - sigma_v^2) + alpha^2 sigma_v^2, that is q = alpha^2 + (1 - 2 alpha) phi.
    With a known sigma_v, phi = 1 - sigma_v^2 / var e.
    """
    a, p = _pair(alpha, phi)
    q: FloatArray = a**2 + (1 - 2 * a) * p
    return q


def phi_cv(alpha: ArrayLike, beta: ArrayLike) -> FloatArray:
    """Share of the residual variance that is the prediction's, at constant velocity."""
    a, b = _gains(alpha, beta)
    phi: FloatArray = (2 * a**2 + a * b + 2 * b) / (4 * a + 2 * b)
    return phi


def bracket_factors(alpha: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Give the factors between which sigma of the estimate over sigma of the residual must lie, whatever the
    motion.

    They are the ends of `q_from_phi` at phi 0 and 1: the smaller and the larger of alpha and |1 - alpha|.
    """
    a = np.asarray(alpha, dtype=np.float64)
    rest = np.abs(1 - a)
    return np.minimum(a, rest), np.maximum(a, rest)


def lag_one_correlation_cv(alpha: ArrayLike, beta: ArrayLike) -> FloatArray:
    """Correlation of consecutive residuals at constant velocity: beta/(2 alpha + beta) - (alpha + beta)/2.

    It is negative with optimal gains (-0.19 at alpha 0.5); zero means gains that fit the manoeuvre, above
    zero a lag.
    """
    a, b = _gains(alpha, beta)
    rho: FloatArray = b / (2 * a + b) - (a + b) / 2
    return rho


def samples_to_tell_regimes(alpha: ArrayLike, beta: ArrayLike) -> FloatArray:
    """Give the number of residuals needed to tell a constant-velocity target from one the gains fit: (2.8 /
    rho_1)^2.

    2.8 sigma separates the two lag-one correlations at 5 % significance with 80 % power. Rounded up; infinite
    when rho_1 is zero.
    """
    rho = lag_one_correlation_cv(alpha, beta)
    with np.errstate(divide="ignore"):
        count: FloatArray = np.ceil((2.8 / rho) ** 2)
    return count


def residual_mean_under_acceleration(acceleration: ArrayLike, beta: ArrayLike, interval_s: ArrayLike) -> FloatArray:
    """Mean residual while the target accelerates steadily: a T^2 / beta."""
    lag: FloatArray = _float(acceleration) * _float(interval_s) ** 2 / _float(beta)
    return lag


def filtered_bias_under_acceleration(
    acceleration: ArrayLike, alpha: ArrayLike, beta: ArrayLike, interval_s: ArrayLike
) -> FloatArray:
    """Error (estimate less truth) of the filtered position while the target accelerates: -(1 - alpha) a T^2 /
    beta.
    """
    bias: FloatArray = -(1 - _float(alpha)) * residual_mean_under_acceleration(acceleration, beta, interval_s)
    return bias


def velocity_bias_under_acceleration(
    acceleration: ArrayLike, alpha: ArrayLike, beta: ArrayLike, interval_s: ArrayLike
) -> FloatArray:
    """Error (estimate less truth) of the filtered velocity: -a T (2 alpha - beta) / (2 beta)."""
    a, b = _pair(alpha, beta)
    bias: FloatArray = -_float(acceleration) * _float(interval_s) * (2 * a - b) / (2 * b)
    return bias


def rms_with_lag(sigma: ArrayLike, residual_mean: ArrayLike, alpha: ArrayLike) -> FloatArray:
    """Root mean square error of the estimate: its random part and the lag (1 - alpha) b that a mean residual
    b shows.
    """
    rms: FloatArray = np.hypot(_float(sigma), (1 - _float(alpha)) * _float(residual_mean))
    return rms


def startup_length(alpha: ArrayLike) -> NDArray[np.int64]:
    """Give the number of updates to leave out after a track starts, starts anew or changes its gains: ceil(11
    / alpha).

    After that many, sigma is within 1 % of its steady value for alpha from 0.1 to 0.7 after a two-point start
    (the usual ln 0.01 / ln(1 - alpha) is about half as long). Where alpha is not above zero, 0.
    """
    a = np.asarray(alpha, dtype=np.float64)
    safe = np.where(a > 0, a, np.inf)
    # the tiny amount keeps 11/0.1 at 110 although 0.1 has no exact binary form
    return np.asarray(np.ceil(11 / safe - 1e-9), dtype=np.int64)[()]


def steady_state_covariance(
    alpha: float, beta: float, *, interval_s: float = 1.0, sigma_v: float = 1.0, sigma_a: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Give the covariance (2 x 2, position and velocity) of the estimate and of the prediction, for a
    manoeuvring target.

    `sigma_a` (m/s^2) is a white acceleration, constant over each interval; it need not be what the gains were
    made for. All NaN for unstable gains.

    References
    ----------
    Lyapunov equation of the fixed-gain filter; Bar-Shalom, Li and Kirubarajan (2001), section 6.5.
    """
    if not is_stable(alpha, beta):
        return np.full((2, 2), np.nan), np.full((2, 2), np.nan)
    # Solved with velocity in position per interval, so that a small T does not spoil the condition.
    phi = np.array([[1.0, 1.0], [0.0, 1.0]])
    gain = np.array([[alpha], [beta]])
    keep = np.eye(2) - gain @ np.array([[1.0, 0.0]])
    process = (sigma_a * interval_s**2) ** 2 * np.array([[0.25, 0.5], [0.5, 1.0]])
    step = keep @ phi
    forcing = gain @ gain.T * sigma_v**2 + keep @ process @ keep.T
    filtered = np.linalg.solve(np.eye(4) - np.kron(step, step), forcing.ravel()).reshape(2, 2)
    predicted = phi @ filtered @ phi.T + process
    unit = np.outer([1.0, 1 / interval_s], [1.0, 1 / interval_s])
    return filtered * unit, predicted * unit


def residual_autocovariance(
    alpha: float,
    beta: float,
    lags: int,
    *,
    interval_s: float = 1.0,
    sigma_v: float = 1.0,
    sigma_a: float = 0.0,
) -> FloatArray:
    """Give the theoretical autocovariance of the residuals at lags 0 to `lags` of a filter with fixed gains.

    Zero beyond lag 0 if and only if the gains are the Kalman gains for this `sigma_a` and `sigma_v`.

    References
    ----------
    Mehra (1970), On the identification of variances and adaptive Kalman filtering.
    """
    predicted = steady_state_covariance(alpha, beta, interval_s=interval_s, sigma_v=sigma_v, sigma_a=sigma_a)[1]
    predicted = predicted * np.outer([1.0, interval_s], [1.0, interval_s])
    phi = np.array([[1.0, 1.0], [0.0, 1.0]])
    gain = np.array([alpha, beta])
    step = phi @ (np.eye(2) - np.outer(gain, [1.0, 0.0]))
    covariance = np.empty(lags + 1)
    covariance[0] = predicted[0, 0] + sigma_v**2
    state = phi @ (predicted[:, 0] - gain * covariance[0])
    for lag in range(1, lags + 1):
        covariance[lag] = state[0]
        state = step @ state
    return covariance


@dataclass(frozen=True)
class OwnVariances:
    """Variances that the residuals' own autocovariance implies, in the residuals' unit squared."""

    predicted: FloatArray
    measurement: FloatArray
    filtered: FloatArray


def variances_from_autocovariance(
    c0: ArrayLike, c1: ArrayLike, c2: ArrayLike, alpha: ArrayLike, beta: ArrayLike
) -> OwnVariances:
    """Estimate all variances from the residuals' autocovariance at lags 0, 1, 2, with no assumption on the
    manoeuvre.

    Scatters widely (relative standard deviation of the filtered variance 25-30 % at alpha 0.2 from 1000
    residuals): a cross-check, not the headline. An estimate may come out negative; it is returned so, since
    cutting it at zero would bias it.

    References
    ----------
    Mehra (1970).
    """
    a, b = _pair(alpha, beta)
    zero, one, two = _float(c0), _float(c1), _float(c2)
    memory = (2 - a - b) * one - two
    predicted = a * zero + memory
    return OwnVariances(
        predicted=predicted,
        measurement=zero - predicted,
        filtered=a * (1 - a) * zero + (1 - 2 * a) * memory,
    )


def _float(value: ArrayLike) -> FloatArray:
    return np.asarray(value, dtype=np.float64)


def _pair(first: ArrayLike, second: ArrayLike) -> tuple[FloatArray, FloatArray]:
    return _float(first), _float(second)


def _gains(alpha: ArrayLike, beta: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Both gains as floats, alpha NaN wherever the filter is not stable."""
    a, b = _pair(alpha, beta)
    stable = is_stable(a, b)
    if np.all(stable):
        return a, b
    return np.where(stable, a, np.nan), b


def _denominator(a: FloatArray, b: FloatArray) -> FloatArray:
    d: FloatArray = a * (4 - 2 * a - b)
    return d


def _times_square(ratio: FloatArray, sigma: ArrayLike) -> FloatArray:
    variance: FloatArray = ratio * _float(sigma) ** 2
    return variance
