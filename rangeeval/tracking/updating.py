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

from rangeeval.compiled import compiled_inside
from rangeeval.tracking.polar import (
    CONVERTED,
    DECORRELATED,
    conventional_covariance,
    convert,
    unbiased_covariance,
    wrap,
)

FloatArray = NDArray[np.float64]

JOSEPH_BEYOND = 1e6  # then rounding is 1e-10 of the smallest variance


@compiled_inside
def cholesky_inverse(m: FloatArray, s: int, to: int) -> float:
    """Inverse of the lower Cholesky factor of row `s` of `m` (n, 9) into row `to`; gives log det, NaN if not
    positive.
    """
    if not m[s, 0] > 0.0:
        return math.nan
    l00 = math.sqrt(m[s, 0])
    l10 = m[s, 3] / l00
    l20 = m[s, 6] / l00
    d1 = m[s, 4] - l10 * l10
    if not d1 > 0.0:
        return math.nan
    l11 = math.sqrt(d1)
    l21 = (m[s, 7] - l20 * l10) / l11
    d2 = m[s, 8] - l20 * l20 - l21 * l21
    if not d2 > 0.0:
        return math.nan
    l22 = math.sqrt(d2)
    i00, i11, i22 = 1.0 / l00, 1.0 / l11, 1.0 / l22
    i10 = -l10 * i00 * i11
    m[to, 0], m[to, 4], m[to, 8] = i00, i11, i22
    m[to, 3] = i10
    m[to, 7] = -l21 * i11 * i22
    m[to, 6] = -(l20 * i00 + l21 * i10) * i22
    return 2.0 * math.log(l00 * l11 * l22)


@compiled_inside
def quadratic(m: FloatArray, inverse: int, v: FloatArray, nu: int) -> float:
    """nu' S^-1 nu, with the inverse Cholesky factor of S in a row of `m` and nu in one of `v`."""
    n0, n1, n2 = v[nu, 0], v[nu, 1], v[nu, 2]
    e0 = m[inverse, 0] * n0
    e1 = m[inverse, 3] * n0 + m[inverse, 4] * n1
    e2 = m[inverse, 6] * n0 + m[inverse, 7] * n1 + m[inverse, 8] * n2
    total: float = e0 * e0 + e1 * e1 + e2 * e2
    return total


@compiled_inside
def cartesian_innovation(
    kind: int, v: FloatArray, z: int, variance: int, at: int, nu: int, x: FloatArray, row: int, m: FloatArray, r: int
) -> None:
    """Innovation (row `nu` of `v`) and noise covariance (row `r` of `m`) of a plot converted to Cartesian."""
    z0, z1, z2, vr, va, ve = v[z, 0], v[z, 1], v[z, 2], v[variance, 0], v[variance, 1], v[variance, 2]
    convert(z0, z1, z2, v, nu)
    if kind == CONVERTED:
        conventional_covariance(z0, z1, z2, vr, va, ve, m, r)
    else:
        la, le = math.exp(-0.5 * va), math.exp(-0.5 * ve)
        v[nu, 0] /= la * le
        v[nu, 1] /= la * le
        v[nu, 2] /= le
        predicted = kind == DECORRELATED
        unbiased_covariance(
            v[at, 0] if predicted else z0, v[at, 1] if predicted else z1, v[at, 2] if predicted else z2,
            vr, va, ve, m, r,
        )  # fmt: skip
    for i in range(3):
        v[nu, i] -= x[row, i]


@compiled_inside
def polar_innovation(
    v: FloatArray, z: int, variance: int, known: int, at: int, nu: int, m: FloatArray, h: int, r: int
) -> None:
    """Innovation and noise covariance of range, azimuth, elevation; rows of H not measured become zero.

    Rows of `v` (n, 3): plot, variance, 1 where measured, predicted; of `m` (n, 9): H, R.
    """
    for k in range(9):
        m[r, k] = 0.0
    for i in range(3):
        if v[known, i] > 0.0:
            v[nu, i] = v[z, i] - v[at, i]
            m[r, 4 * i] = v[variance, i]
        else:
            v[nu, i] = 0.0
            m[r, 4 * i] = 1.0
            for k in range(3):
                m[h, 3 * i + k] = 0.0
    v[nu, 1] = wrap(v[nu, 1])


@compiled_inside
def innovation_covariance(p: FloatArray, row: int, m: FloatArray, h: int, r: int, to: int) -> None:
    """H P H' + R into row `to` of `m` (n, 9), H acting on position."""
    for i in range(3):
        h0, h1, h2 = m[h, 3 * i], m[h, 3 * i + 1], m[h, 3 * i + 2]
        c0 = h0 * p[row, 0] + h1 * p[row, 9] + h2 * p[row, 18]
        c1 = h0 * p[row, 1] + h1 * p[row, 10] + h2 * p[row, 19]
        c2 = h0 * p[row, 2] + h1 * p[row, 11] + h2 * p[row, 20]
        for k in range(3):
            m[to, 3 * i + k] = c0 * m[h, 3 * k] + c1 * m[h, 3 * k + 1] + c2 * m[h, 3 * k + 2] + m[r, 3 * i + k]


@compiled_inside
def correct(
    n: int, m: FloatArray, h: int, r: int, inverse: int, v: FloatArray, nu: int,
    x: FloatArray, p: FloatArray, row: int, to: int, shrink: FloatArray, j: int, f: FloatArray,
) -> None:  # fmt: skip
    """Update of the first `n` states: prediction in `row` of `x` (9) and `p` (81), result into row `to`.

    P - W W' with W = P H' L^-T (L the Cholesky factor of the innovation covariance) costs a third of Joseph's form and
    is as good while no variance shrinks by more than `JOSEPH_BEYOND`; beyond it Joseph's form is taken. Row `inverse`
    of `m` is L^-1; row `j` of `shrink` (27) becomes K H; `f` (162) is scratch.
    """
    h00, h01, h02, h10, h11, h12 = m[h, 0], m[h, 1], m[h, 2], m[h, 3], m[h, 4], m[h, 5]
    h20, h21, h22, i00, i10, i11 = m[h, 6], m[h, 7], m[h, 8], m[inverse, 0], m[inverse, 3], m[inverse, 4]
    i20, i21, i22, nu0, nu1, nu2 = m[inverse, 6], m[inverse, 7], m[inverse, 8], v[nu, 0], v[nu, 1], v[nu, 2]
    for a in range(9):
        p0, p1, p2 = p[row, 9 * a], p[row, 9 * a + 1], p[row, 9 * a + 2]
        c0 = p0 * h00 + p1 * h01 + p2 * h02
        c1 = p0 * h10 + p1 * h11 + p2 * h12
        c2 = p0 * h20 + p1 * h21 + p2 * h22
        e0 = c0 * i00
        e1 = c0 * i10 + c1 * i11
        e2 = c0 * i20 + c1 * i21 + c2 * i22
        g0 = e0 * i00 + e1 * i10 + e2 * i20
        g1 = e1 * i11 + e2 * i21
        g2 = e2 * i22
        f[a], f[9 + a], f[18 + a] = e0, e1, e2
        f[27 + a], f[36 + a], f[45 + a] = g0, g1, g2
        x[to, a] = x[row, a] + g0 * nu0 + g1 * nu1 + g2 * nu2
        shrink[j, 3 * a] = g0 * h00 + g1 * h10 + g2 * h20
        shrink[j, 3 * a + 1] = g0 * h01 + g1 * h11 + g2 * h21
        shrink[j, 3 * a + 2] = g0 * h02 + g1 * h12 + g2 * h22
    for k in range(81):
        p[to, k] = p[row, k]
    for b in range(3):
        _subtract_outer(p, to, f, 9 * b)
    for a in range(n):
        if not p[to, 10 * a] * JOSEPH_BEYOND > p[row, 10 * a]:
            _joseph(n, m, r, p, row, to, shrink, j, f)
            return


@compiled_inside
def _subtract_outer(p: FloatArray, row: int, f: FloatArray, at: int) -> None:
    """Subtract d d' from `row` of `p` (n, 81), d being nine of `f` from `at` on."""
    d0, d1, d2, d3, d4 = f[at], f[at + 1], f[at + 2], f[at + 3], f[at + 4]
    d5, d6, d7, d8 = f[at + 5], f[at + 6], f[at + 7], f[at + 8]
    for a in range(9):
        e = f[at + a]
        p[row, 9 * a] -= e * d0
        p[row, 9 * a + 1] -= e * d1
        p[row, 9 * a + 2] -= e * d2
        p[row, 9 * a + 3] -= e * d3
        p[row, 9 * a + 4] -= e * d4
        p[row, 9 * a + 5] -= e * d5
        p[row, 9 * a + 6] -= e * d6
        p[row, 9 * a + 7] -= e * d7
        p[row, 9 * a + 8] -= e * d8


@compiled_inside
def _joseph(
    n: int, m: FloatArray, r: int, p: FloatArray, row: int, to: int, shrink: FloatArray, j: int, f: FloatArray
) -> None:
    """(I - K H) P (I - K H)' + K R K' of `row` of `p` into row `to`; the columns of K are at 27, 36, 45 of `f`."""
    for a in range(n):
        for b in range(n):
            left = p[row, 9 * a + b]
            for c in range(3):
                left -= shrink[j, 3 * a + c] * p[row, 9 * c + b]
            f[81 + 9 * a + b] = left
    for a in range(n):
        for b in range(a, n):
            total = f[81 + 9 * a + b]
            for c in range(3):
                total -= f[81 + 9 * a + c] * shrink[j, 3 * b + c]
                for k in range(3):
                    total += f[27 + 9 * c + a] * m[r, 3 * c + k] * f[27 + 9 * k + b]
            p[to, 9 * a + b] = total
            p[to, 9 * b + a] = total


@compiled_inside
def forbid_parallel_turn(sigma: float, x: FloatArray, p: FloatArray, row: int, f: FloatArray) -> None:
    """Pseudo-measurement w.v/|v| = 0 of position, velocity, turn rate in `row`, in place; `f` (162) is scratch."""
    v2 = x[row, 3] ** 2 + x[row, 4] ** 2 + x[row, 5] ** 2
    if v2 <= 0.0:
        return
    v = math.sqrt(v2)
    dot = (x[row, 3] * x[row, 6] + x[row, 4] * x[row, 7] + x[row, 5] * x[row, 8]) / v
    for a in range(3):
        f[a] = (x[row, 6 + a] - dot * x[row, 3 + a] / v) / v
        f[3 + a] = x[row, 3 + a] / v
    total = sigma * sigma
    for a in range(9):
        f[9 + a] = 0.0
        for b in range(6):
            f[9 + a] += p[row, 9 * a + 3 + b] * f[b]
    for b in range(6):
        total += f[b] * f[12 + b]
    for a in range(9):
        gain = f[9 + a] / total
        x[row, a] -= gain * dot
        for b in range(9):
            p[row, 9 * a + b] -= gain * f[9 + b]
