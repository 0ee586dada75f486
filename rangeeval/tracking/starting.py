"""Starting a track from its first one, two or three plots, as compiled kernels.

References
----------
Divided differences of converted measurements: Jung (1999), eq 17 (position, velocity, acceleration), with the covariance
that follows from the same weights.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.compiled import compiled
from rangeeval.tracking.polar import conventional_covariance, convert

FloatArray = NDArray[np.float64]


@compiled
def difference_weights(count: int, times: FloatArray, quadratic: bool, weights: FloatArray) -> None:
    """Weights (3, 3) of position, velocity, acceleration (rows) on the newest `count` plots, oldest first (columns)."""
    for i in range(3):
        for k in range(3):
            weights[i, k] = 0.0
    weights[0, count - 1] = 1.0
    if count == 1:
        return
    h = times[count - 1] - times[count - 2]
    weights[1, count - 1] = 1.0 / h
    weights[1, count - 2] = -1.0 / h
    if count == 2:
        return
    g = times[1] - times[0]
    weights[2, 2] = 2.0 / (h * (h + g))
    weights[2, 1] = -2.0 / (h * g)
    weights[2, 0] = 2.0 / (g * (h + g))
    if quadratic:
        for k in range(3):
            weights[1, k] += 0.5 * h * weights[2, k]


@compiled
def start(
    count: int,
    times: FloatArray,
    positions: FloatArray,
    covariances: FloatArray,
    quadratic: bool,
    speed: float,
    acceleration: float,
    x: FloatArray,
    p: FloatArray,
) -> None:
    """Position, velocity, acceleration (9) and their covariance (9, 9) from `count` plots, into `x` and `p`.

    `times` (3), `positions` (3, 3), `covariances` (3, 3, 3), oldest first. What the plots do not show is zero with the
    prior sigmas `speed` and `acceleration`.
    """
    weights = np.empty((3, 3))
    difference_weights(count, times, quadratic, weights)
    for i in range(3):
        for a in range(3):
            total = 0.0
            for n in range(count):
                total += weights[i, n] * positions[n, a]
            x[3 * i + a] = total
    for i in range(3):
        for k in range(3):
            for a in range(3):
                for b in range(3):
                    total = 0.0
                    for n in range(count):
                        total += weights[i, n] * weights[k, n] * covariances[n, a, b]
                    p[3 * i + a, 3 * k + b] = total
    for a in range(3):
        if count < 2:
            p[3 + a, 3 + a] = speed * speed
        if count < 3:
            p[6 + a, 6 + a] = acceleration * acceleration


@compiled
def turn_from_acceleration(x: FloatArray, p: FloatArray, y: FloatArray, s: FloatArray) -> None:
    """Turn rate v x a / |v|^2 in place of the acceleration: (x, p) of p, v, a into (y, s) of p, v, w.

    With no speed the turn rate is zero.
    """
    square = x[3] * x[3] + x[4] * x[4] + x[5] * x[5]
    work = np.zeros((18, 9))
    for i in range(6):
        y[i] = x[i]
        work[i, i] = 1.0
    v = (x[3], x[4], x[5])
    a = (x[6], x[7], x[8])
    n = (v[1] * a[2] - v[2] * a[1], v[2] * a[0] - v[0] * a[2], v[0] * a[1] - v[1] * a[0])
    cross_v = (0.0, -v[2], v[1], v[2], 0.0, -v[0], -v[1], v[0], 0.0)
    cross_a = (0.0, -a[2], a[1], a[2], 0.0, -a[0], -a[1], a[0], 0.0)
    for i in range(3):
        y[6 + i] = n[i] / square if square > 0.0 else 0.0
        for k in range(3):
            if square > 0.0:
                work[6 + i, 3 + k] = -cross_a[3 * i + k] / square - 2.0 * n[i] * v[k] / (square * square)
                work[6 + i, 6 + k] = cross_v[3 * i + k] / square
    for i in range(9):
        for k in range(9):
            total = 0.0
            for m in range(9):
                total += work[i, m] * p[m, k]
            work[9 + i, k] = total
    for i in range(9):
        for k in range(9):
            total = 0.0
            for m in range(9):
                total += work[9 + i, m] * work[k, m]
            s[i, k] = total


def three_point(
    time_s: ArrayLike, polar: ArrayLike, sigma: ArrayLike, *, quadratic: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Position, velocity, acceleration (9,) and covariance (9, 9) at the newest of three plots.

    `time_s` (3,), increasing; `polar` (3, 3) range, azimuth, elevation; `sigma` (3,) or (3, 3).
    """
    z = np.asarray(polar, dtype=np.float64)
    s = np.broadcast_to(np.asarray(sigma, dtype=np.float64), z.shape)
    positions, covariances = np.empty((3, 3)), np.empty((3, 3, 3))
    for n in range(3):
        convert(*z[n], positions[n])
        conventional_covariance(*z[n], *(s[n] ** 2), covariances[n])
    x, p = np.empty(9), np.empty((9, 9))
    times = np.asarray(time_s, dtype=np.float64)
    start(3, times, positions, covariances, quadratic, math.nan, math.nan, x, p)
    return x, p
