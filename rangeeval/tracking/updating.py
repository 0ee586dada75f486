"""The measurement update of one model, as compiled kernels: EKF in polar coordinates or converted to Cartesian.

A component that was not measured has a zero row in H, no innovation and unit noise: it then changes neither state nor
likelihood, and every mix of components takes the same path.

References
----------
Joseph form: Bucy and Joseph (1968); Bar-Shalom, Li and Kirubarajan (2001), 5.2.3.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rangeeval.compiled import compiled
from rangeeval.tracking.polar import (
    CONVERTED,
    DECORRELATED,
    conventional_covariance,
    convert,
    unbiased_covariance,
    wrap,
)

FloatArray = NDArray[np.float64]


@compiled
def cholesky_inverse(s: FloatArray, inverse: FloatArray) -> float:
    """Inverse of the lower Cholesky factor of `s` (3, 3) into `inverse`; returns log det s, NaN if s is not positive."""
    if not s[0, 0] > 0.0:
        return math.nan
    l00 = math.sqrt(s[0, 0])
    l10 = s[1, 0] / l00
    l20 = s[2, 0] / l00
    d1 = s[1, 1] - l10 * l10
    if not d1 > 0.0:
        return math.nan
    l11 = math.sqrt(d1)
    l21 = (s[2, 1] - l20 * l10) / l11
    d2 = s[2, 2] - l20 * l20 - l21 * l21
    if not d2 > 0.0:
        return math.nan
    l22 = math.sqrt(d2)
    inverse[0, 0] = 1.0 / l00
    inverse[1, 1] = 1.0 / l11
    inverse[2, 2] = 1.0 / l22
    inverse[1, 0] = -l10 * inverse[0, 0] * inverse[1, 1]
    inverse[2, 1] = -l21 * inverse[1, 1] * inverse[2, 2]
    inverse[2, 0] = -(l20 * inverse[0, 0] + l21 * inverse[1, 0]) * inverse[2, 2]
    return 2.0 * math.log(l00 * l11 * l22)


@compiled
def quadratic(inverse: FloatArray, nu: FloatArray) -> float:
    """nu' s^-1 nu (3) with the inverse Cholesky factor of s."""
    e0 = inverse[0, 0] * nu[0]
    e1 = inverse[1, 0] * nu[0] + inverse[1, 1] * nu[1]
    e2 = inverse[2, 0] * nu[0] + inverse[2, 1] * nu[1] + inverse[2, 2] * nu[2]
    return e0 * e0 + e1 * e1 + e2 * e2


@compiled
def cartesian_innovation(
    kind: int, z: FloatArray, variance: FloatArray, at: FloatArray, position: FloatArray, nu: FloatArray, r: FloatArray
) -> None:
    """Innovation (3) and noise covariance (3, 3) of a converted measurement; `at` is the predicted polar position."""
    convert(z[0], z[1], z[2], nu)
    if kind == CONVERTED:
        conventional_covariance(z[0], z[1], z[2], variance[0], variance[1], variance[2], r)
    else:
        la, le = math.exp(-0.5 * variance[1]), math.exp(-0.5 * variance[2])
        nu[0] /= la * le
        nu[1] /= la * le
        nu[2] /= le
        if kind == DECORRELATED:
            unbiased_covariance(at[0], at[1], at[2], variance[0], variance[1], variance[2], r)
        else:
            unbiased_covariance(z[0], z[1], z[2], variance[0], variance[1], variance[2], r)
    for i in range(3):
        nu[i] -= position[i]


@compiled
def polar_innovation(
    z: FloatArray, plot: FloatArray, at: FloatArray, h: FloatArray, nu: FloatArray, r: FloatArray
) -> None:
    """Innovation (3) and noise covariance (3, 3) of range, azimuth, elevation; rows of `h` not measured become zero.

    `plot` (2, 3): variances, and 1 where measured.
    """
    for i in range(3):
        for k in range(3):
            r[i, k] = 0.0
        if plot[1, i] > 0.0:
            nu[i] = z[i] - at[i]
            r[i, i] = plot[0, i]
        else:
            nu[i] = 0.0
            r[i, i] = 1.0
            for k in range(3):
                h[i, k] = 0.0
    nu[1] = wrap(nu[1])


@compiled
def innovation_covariance(p: FloatArray, h: FloatArray, r: FloatArray, s: FloatArray) -> None:
    """H P H' + R (3, 3) into `s`, H acting on position."""
    for i in range(3):
        for k in range(3):
            total = r[i, k]
            for a in range(3):
                total += h[i, a] * (p[a, 0] * h[k, 0] + p[a, 1] * h[k, 1] + p[a, 2] * h[k, 2])
            s[i, k] = total


@compiled
def joseph(
    n: int, h: FloatArray, r: FloatArray, inverse: FloatArray, nu: FloatArray,
    y: FloatArray, s: FloatArray, x: FloatArray, p: FloatArray, shrink: FloatArray, scratch: FloatArray,
) -> None:  # fmt: skip
    """Joseph update of the first `n` states: prediction (y, s) into (x, p).

    `inverse` is the inverse Cholesky factor of the innovation covariance; `shrink` (9, 3) = K H is written for the caller,
    `scratch` (24, 9) is free.
    """
    gain, left = scratch[:9], scratch[9:18]
    for a in range(n):
        c0 = s[a, 0] * h[0, 0] + s[a, 1] * h[0, 1] + s[a, 2] * h[0, 2]
        c1 = s[a, 0] * h[1, 0] + s[a, 1] * h[1, 1] + s[a, 2] * h[1, 2]
        c2 = s[a, 0] * h[2, 0] + s[a, 1] * h[2, 1] + s[a, 2] * h[2, 2]
        e0 = c0 * inverse[0, 0]
        e1 = c0 * inverse[1, 0] + c1 * inverse[1, 1]
        e2 = c0 * inverse[2, 0] + c1 * inverse[2, 1] + c2 * inverse[2, 2]
        g0 = e0 * inverse[0, 0] + e1 * inverse[1, 0] + e2 * inverse[2, 0]
        g1 = e1 * inverse[1, 1] + e2 * inverse[2, 1]
        g2 = e2 * inverse[2, 2]
        gain[a, 0], gain[a, 1], gain[a, 2] = g0, g1, g2
        x[a] = y[a] + g0 * nu[0] + g1 * nu[1] + g2 * nu[2]
        k0 = g0 * h[0, 0] + g1 * h[1, 0] + g2 * h[2, 0]
        k1 = g0 * h[0, 1] + g1 * h[1, 1] + g2 * h[2, 1]
        k2 = g0 * h[0, 2] + g1 * h[1, 2] + g2 * h[2, 2]
        shrink[a, 0], shrink[a, 1], shrink[a, 2] = k0, k1, k2
        for b in range(n):
            left[a, b] = s[a, b] - k0 * s[0, b] - k1 * s[1, b] - k2 * s[2, b]
    for a in range(n):
        r0 = gain[a, 0] * r[0, 0] + gain[a, 1] * r[1, 0] + gain[a, 2] * r[2, 0]
        r1 = gain[a, 0] * r[0, 1] + gain[a, 1] * r[1, 1] + gain[a, 2] * r[2, 1]
        r2 = gain[a, 0] * r[0, 2] + gain[a, 1] * r[1, 2] + gain[a, 2] * r[2, 2]
        l0, l1, l2 = left[a, 0], left[a, 1], left[a, 2]
        for b in range(a, n):
            total = left[a, b] - l0 * shrink[b, 0] - l1 * shrink[b, 1] - l2 * shrink[b, 2]
            total += r0 * gain[b, 0] + r1 * gain[b, 1] + r2 * gain[b, 2]
            p[a, b] = total
            p[b, a] = total


@compiled
def forbid_parallel_turn(sigma: float, x: FloatArray, p: FloatArray, scratch: FloatArray) -> None:
    """Pseudo-measurement w.v/|v| = 0 of position, velocity, turn rate, in place; `scratch` (24, 9)."""
    v2 = x[3] ** 2 + x[4] ** 2 + x[5] ** 2
    if v2 <= 0.0:
        return
    v = math.sqrt(v2)
    dot = (x[3] * x[6] + x[4] * x[7] + x[5] * x[8]) / v
    h, ph, k = scratch[0], scratch[1], scratch[2]
    for a in range(3):
        h[a] = 0.0
        h[3 + a] = (x[6 + a] - dot * x[3 + a] / v) / v
        h[6 + a] = x[3 + a] / v
    total = sigma * sigma
    for a in range(9):
        ph[a] = 0.0
        for b in range(9):
            ph[a] += p[a, b] * h[b]
        total += h[a] * ph[a]
    for a in range(9):
        k[a] = ph[a] / total
        x[a] -= k[a] * dot
    # Joseph form for one row: P - k (Ph)' - (Ph) k' + k s k'
    for a in range(9):
        for b in range(9):
            p[a, b] += k[a] * k[b] * total - k[a] * ph[b] - ph[a] * k[b]
