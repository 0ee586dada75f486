"""Starting a track from its first one, two or three plots, as compiled kernels.

References
----------
Divided differences of converted measurements: Jung (1999), eq 17 (position, velocity, acceleration), with the
covariance that follows from the same weights.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.compiled import compiled_ieee, compiled_inside
from rangeeval.tracking.polar import conventional_covariance, convert

FloatArray = NDArray[np.float64]


@compiled_inside
def difference_weights(count: int, plots: FloatArray, quadratic: bool, f: FloatArray) -> None:
    """Weights of position, velocity, acceleration (rows) on the `count` plots, oldest first, into nine of `f`.

    The first column of `plots` is time.
    """
    for i in range(3):
        for k in range(3):
            f[3 * i + k] = 0.0
    f[count - 1] = 1.0
    if count == 1:
        return
    h = plots[count - 1, 0] - plots[count - 2, 0]
    f[3 + count - 1] = 1.0 / h
    f[3 + count - 2] = -1.0 / h
    if count == 2:
        return
    g = plots[1, 0] - plots[0, 0]
    f[8] = 2.0 / (h * (h + g))
    f[7] = -2.0 / (h * g)
    f[6] = 2.0 / (g * (h + g))
    if quadratic:
        for k in range(3):
            f[3 + k] += 0.5 * h * f[6 + k]


@compiled_ieee
def start(
    count: int,
    plots: FloatArray,
    height_sigma: float,
    quadratic: bool,
    speed: float,
    acceleration: float,
    x: FloatArray,
    p: FloatArray,
    row: int,
    v: FloatArray,
    position: int,
    m: FloatArray,
    covariance: int,
    f: FloatArray,
) -> None:
    """Position, velocity, acceleration and their covariance from `count` plots, into `row` of `x` (n, 9) and `p` (n,
    81).

    `plots` (3, 7), oldest first: time, range, azimuth, elevation and their variances. What they do not show is zero
    with the prior sigmas `speed` and `acceleration`. `height_sigma` above 0: elevation is not known, the height has
    this sigma. Three rows of `v` and of `m` from the given ones on, and `f`, are scratch.
    """
    difference_weights(count, plots, quadratic, f)
    for n in range(count):
        r, az, el, vr, va, ve = plots[n, 1], plots[n, 2], plots[n, 3], plots[n, 4], plots[n, 5], plots[n, 6]
        convert(r, az, el, v, position + n)
        conventional_covariance(r, az, el, vr, va, ve, m, covariance + n)
        if height_sigma > 0.0:
            m[covariance + n, 8] = height_sigma * height_sigma
    for i in range(3):
        for a in range(3):
            total = 0.0
            for n in range(count):
                total += f[3 * i + n] * v[position + n, a]
            x[row, 3 * i + a] = total
    for i in range(3):
        for k in range(3):
            for a in range(3):
                for b in range(3):
                    total = 0.0
                    for n in range(count):
                        total += f[3 * i + n] * f[3 * k + n] * m[covariance + n, 3 * a + b]
                    p[row, 27 * i + 9 * a + 3 * k + b] = total
    for a in range(3):
        if count < 2:
            p[row, 30 + 10 * a] = speed * speed
        if count < 3:
            p[row, 60 + 10 * a] = acceleration * acceleration


@compiled_inside
def turn_from_acceleration(x: FloatArray, p: FloatArray, row: int, prior: float, g: FloatArray) -> None:
    """Replace the acceleration in `row` by the turn rate v x a / |v|^2, in place.

    The part of the turn rate along the velocity, which no motion shows, gets its `prior` sigma. With no speed the turn
    rate is zero with that prior. `g` (45) is scratch.
    """
    v0, v1, v2, a0, a1, a2 = x[row, 3], x[row, 4], x[row, 5], x[row, 6], x[row, 7], x[row, 8]
    square = v0 * v0 + v1 * v1 + v2 * v2
    one = 1.0 / square if square > 0.0 else 0.0
    n = (one * (v1 * a2 - v2 * a1), one * (v2 * a0 - v0 * a2), one * (v0 * a1 - v1 * a0))
    v = (v0, v1, v2)
    cross_v = (0.0, -v2, v1, v2, 0.0, -v0, -v1, v0, 0.0)
    cross_a = (0.0, -a2, a1, a2, 0.0, -a0, -a1, a0, 0.0)
    # into g: the derivative of the turn rate by velocity and acceleration (3 x 6), and that times P (3 x 9)
    for i in range(3):
        for k in range(3):
            g[6 * i + k] = -cross_a[3 * i + k] * one - 2.0 * n[i] * v[k] * one
            g[6 * i + 3 + k] = cross_v[3 * i + k] * one
    for i in range(3):
        for c in range(9):
            g[18 + 9 * i + c] = 0.0
            for m in range(6):
                g[18 + 9 * i + c] += g[6 * i + m] * p[row, 27 + 9 * m + c]
    for i in range(3):
        x[row, 6 + i] = n[i]
        for k in range(6):
            p[row, 54 + 9 * i + k] = g[18 + 9 * i + k]
            p[row, 9 * k + 6 + i] = g[18 + 9 * i + k]
        for k in range(3):
            total = prior * prior * (v[i] * v[k] * one if square > 0.0 else (1.0 if i == k else 0.0))
            for m in range(6):
                total += g[18 + 9 * i + 3 + m] * g[6 * k + m]
            p[row, 54 + 9 * i + 6 + k] = total


def three_point(
    time_s: ArrayLike, polar: ArrayLike, sigma: ArrayLike, *, quadratic: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Position, velocity, acceleration (9,) and covariance (9, 9) at the newest of three plots.

    `time_s` (3,), increasing; `polar` (3, 3) range, azimuth, elevation; `sigma` (3,) or (3, 3).
    """
    plots = np.empty((3, 7))
    plots[:, 0], plots[:, 1:4], plots[:, 4:] = time_s, polar, np.asarray(sigma, dtype=np.float64) ** 2
    x, p = np.empty((1, 9)), np.empty((1, 81))
    start(3, plots, 0.0, quadratic, math.nan, math.nan, x, p, 0, np.empty((3, 3)), 0, np.empty((3, 9)), 0, np.empty(9))
    return x[0], p.reshape(9, 9)
