"""The alpha-beta filter while its gains change: start-up, gain switching, irregular update intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.compiled import compiled

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class VaryingVariances:
    """Variances at every update: of the residual, of the filtered position, and the second over the first
    (`q`).
    """

    residual: FloatArray
    filtered: FloatArray
    q: FloatArray


def varying_gain_variances(
    alpha: ArrayLike,
    beta: ArrayLike,
    *,
    interval_s: ArrayLike = 1.0,
    sigma_v: ArrayLike = 1.0,
    initial_covariance: ArrayLike | None = None,
) -> VaryingVariances:
    """Follow the variances of one track update by update, for a target at constant velocity.

    `alpha`, `beta`: the gains of the updates after the start (n); `interval_s` the time since the update
    before, `sigma_v` the measurement sigma (n, or one number for all). Only the shape of `sigma_v` matters
    for `q`. A coasted update has alpha = beta = 0 (or NaN gains). `initial_covariance` (2 x 2) is that of the
    estimate before the first of these updates; by default a two-point start made with the first interval and
    sigma.

    Raises
    ------
    ValueError : the arrays are not one-dimensional or differ in length.

    References
    ----------
    P' = A P A^T + K K^T sigma_v^2 with A = (I - K H) Phi; two-point start: Bar-Shalom, Li and Kirubarajan
    (2001).
    """
    a = np.nan_to_num(np.atleast_1d(np.asarray(alpha, dtype=np.float64)))
    b = np.nan_to_num(np.atleast_1d(np.asarray(beta, dtype=np.float64)))
    if a.ndim != 1 or a.shape != b.shape:
        raise ValueError(f"alpha has shape {a.shape} and beta {b.shape}; give two lists of the same length")
    interval = np.ascontiguousarray(np.broadcast_to(np.asarray(interval_s, dtype=np.float64), a.shape))
    sigma = np.ascontiguousarray(np.broadcast_to(np.asarray(sigma_v, dtype=np.float64), a.shape))
    if initial_covariance is not None:
        start = np.array(initial_covariance, dtype=np.float64)
    elif a.size:
        start = two_point_covariance(float(sigma[0]), float(interval[0]))
    else:
        start = np.zeros((2, 2))
    residual, filtered = _recursion(a, b, interval, sigma, start)
    return VaryingVariances(residual=residual, filtered=filtered, q=filtered / residual)


def two_point_covariance(sigma_v: float, interval_s: float) -> FloatArray:
    """Give the covariance (2 x 2) of a state made from two measurements `interval_s` apart."""
    t = interval_s
    return np.array([[1.0, 1.0 / t], [1.0 / t, 2.0 / t**2]]) * sigma_v**2


@compiled
def _recursion(
    alpha: FloatArray, beta: FloatArray, interval: FloatArray, sigma: FloatArray, start: FloatArray
) -> tuple[FloatArray, FloatArray]:
    n = alpha.size
    residual = np.empty(n)
    filtered = np.empty(n)
    p11, p12, p22 = start[0, 0], start[0, 1], start[1, 1]
    for k in range(n):
        t = interval[k]
        b11 = p11 + 2.0 * t * p12 + t * t * p22
        b12 = p12 + t * p22
        b22 = p22
        noise = sigma[k] * sigma[k]
        keep = 1.0 - alpha[k]
        rate = beta[k] / t
        p11 = keep * keep * b11 + alpha[k] * alpha[k] * noise
        p12 = keep * (b12 - rate * b11) + alpha[k] * rate * noise
        p22 = b22 - 2.0 * rate * b12 + rate * rate * (b11 + noise)
        residual[k] = b11 + noise
        filtered[k] = p11
    return residual, filtered
