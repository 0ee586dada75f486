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
from rangeeval.tracking.layout import (
    AT,
    AWAY,
    CROSS,
    FILTERED,
    FILTERED_P,
    GAIN,
    JACOBIAN,
    KNOWN,
    LOWER,
    NU,
    PIVOT,
    PLOT,
    PREDICTED,
    PREDICTED_P,
    PRODUCT,
    SQUARE,
    VARIANCE,
    WHITE,
    H,
    R,
    S,
)
from rangeeval.tracking.polar import CONVERTED, DECORRELATED, convert, unbiased_covariance, wrap

FloatArray = NDArray[np.float64]

JOSEPH_BEYOND = 1e6  # then rounding is 1e-10 of the smallest variance


@compiled_inside
def polar_innovation(own: FloatArray, both: FloatArray) -> None:
    """Innovation of the plot in `both` into NU and its noise into R; rows of H not measured become zero."""
    for k in range(9):
        own[R + k] = 0.0
    for i in range(3):
        if both[KNOWN + i] > 0.0:
            off = both[PLOT + i] - own[AT + i]
            own[NU + i] = wrap(off) if i == 1 else off
            own[R + 4 * i] = both[VARIANCE + i]
        else:
            own[NU + i] = 0.0
            own[R + 4 * i] = 1.0
            for k in range(3):
                own[H + 3 * i + k] = 0.0


@compiled_inside
def cartesian_innovation(own: FloatArray, both: FloatArray, kind: int) -> None:
    """Innovation of the plot converted to Cartesian into NU, its covariance into R; H becomes the unit matrix."""
    z0, z1, z2 = both[PLOT], both[PLOT + 1], both[PLOT + 2]
    vr, va, ve = both[VARIANCE], both[VARIANCE + 1], both[VARIANCE + 2]
    convert(own, z0, z1, z2, vr, va, ve)
    if kind != CONVERTED:
        one_a, one_e = math.exp(0.5 * va), math.exp(0.5 * ve)
        own[NU] *= one_a * one_e
        own[NU + 1] *= one_a * one_e
        own[NU + 2] *= one_e
        if kind == DECORRELATED:
            z0, z1, z2 = own[AT], own[AT + 1], own[AT + 2]
        unbiased_covariance(own, z0, z1, z2, vr, va, ve)
    for i in range(3):
        own[NU + i] -= own[PREDICTED + i]
        for k in range(3):
            own[H + 3 * i + k] = 1.0 if i == k else 0.0


@compiled_inside
def project(own: FloatArray) -> None:
    """H P into CROSS, the innovation covariance H P H' + R into S."""
    for i in range(3):
        h0, h1, h2, to = own[H + 3 * i], own[H + 3 * i + 1], own[H + 3 * i + 2], CROSS + 9 * i
        for a in range(9):
            p = PREDICTED_P + a
            own[to + a] = h0 * own[p] + h1 * own[p + 9] + h2 * own[p + 18]
        for k in range(3):
            h = H + 3 * k
            own[S + 3 * i + k] = (
                own[to] * own[h] + own[to + 1] * own[h + 1] + own[to + 2] * own[h + 2] + own[R + 3 * i + k]
            )


@compiled_inside
def whiten(own: FloatArray) -> float:
    """Factors of S = L D L' as LOWER and PIVOT, nu' S^-1 nu into SQUARE; gives log det S, NaN if S is not positive."""
    d0 = own[S]
    r0 = 1.0 / d0
    l10, l20 = own[S + 3] * r0, own[S + 6] * r0
    d1 = own[S + 4] - l10 * own[S + 3]
    r1 = 1.0 / d1
    l21 = (own[S + 7] - l20 * own[S + 3]) * r1
    d2 = own[S + 8] - l20 * own[S + 6] - l21 * l21 * d1
    if not (d0 > 0.0 and d1 > 0.0 and d2 > 0.0):
        return math.nan
    own[PIVOT], own[PIVOT + 1], own[PIVOT + 2] = r0, r1, 1.0 / d2
    own[LOWER], own[LOWER + 1], own[LOWER + 2] = -l10, l10 * l21 - l20, -l21
    e0 = own[NU]
    e1 = own[NU + 1] - l10 * e0
    e2 = own[NU + 2] - l20 * e0 - l21 * e1
    own[SQUARE] = e0 * e0 * r0 + e1 * e1 * r1 + e2 * e2 * own[PIVOT + 2]
    return math.log(d0 * d1 * d2)


@compiled_inside
def correct(own: FloatArray, n: int) -> None:
    """Update of PREDICTED, of whose states `n` count, into FILTERED.

    P - W D^-1 W' with W = P H' L^-T (S = L D L' the innovation covariance) costs a third of Joseph's form and is as
    good while no variance shrinks by more than `JOSEPH_BEYOND`; beyond it Joseph's form is taken.
    """
    m10, m20, m21, r0, r1, r2 = own[LOWER], own[LOWER + 1], own[LOWER + 2], own[PIVOT], own[PIVOT + 1], own[PIVOT + 2]
    nu0, nu1, nu2 = own[NU], own[NU + 1], own[NU + 2]
    for a in range(9):
        w0 = own[CROSS + a]
        w1 = m10 * w0 + own[CROSS + 9 + a]
        w2 = m20 * w0 + m21 * own[CROSS + 9 + a] + own[CROSS + 18 + a]
        g2 = w2 * r2
        g1 = w1 * r1 + m21 * g2
        g0 = w0 * r0 + m10 * w1 * r1 + m20 * g2
        own[WHITE + a], own[WHITE + 9 + a], own[WHITE + 18 + a] = w0, w1, w2
        own[GAIN + a], own[GAIN + 9 + a], own[GAIN + 18 + a] = g0, g1, g2
        own[FILTERED + a] = own[PREDICTED + a] + g0 * nu0 + g1 * nu1 + g2 * nu2
    for a in range(9):
        w0, w1, w2 = own[WHITE + a] * r0, own[WHITE + 9 + a] * r1, own[WHITE + 18 + a] * r2
        for b in range(9):
            less = w0 * own[WHITE + b] + w1 * own[WHITE + 9 + b] + w2 * own[WHITE + 18 + b]
            own[FILTERED_P + 9 * a + b] = own[PREDICTED_P + 9 * a + b] - less
    for a in range(n):
        if not own[FILTERED_P + 10 * a] * JOSEPH_BEYOND > own[PREDICTED_P + 10 * a]:
            _joseph(own)
            return


@compiled_inside
def _joseph(own: FloatArray) -> None:
    """(I - K H) P (I - K H)' + K R K' = L - (L H' - K R) K' with L = P - K H P, from PREDICTED into FILTERED."""
    for a in range(9):
        for b in range(9):
            left = own[PREDICTED_P + 9 * a + b]
            for i in range(3):
                left -= own[GAIN + 9 * i + a] * own[CROSS + 9 * i + b]
            own[PRODUCT + 9 * a + b] = left
    for a in range(9):
        for b in range(a, 9):
            total = own[PRODUCT + 9 * a + b]
            for i in range(3):
                for k in range(3):
                    part = own[PRODUCT + 9 * a + k] * own[H + 3 * i + k] - own[GAIN + 9 * k + a] * own[R + 3 * k + i]
                    total -= part * own[GAIN + 9 * i + b]
            own[FILTERED_P + 9 * a + b] = total
            own[FILTERED_P + 9 * b + a] = total


@compiled_inside
def forbid_parallel_turn(own: FloatArray, sigma: float) -> None:
    """Pseudo-measurement w.v/|v| = 0 of position, velocity, turn rate in FILTERED, in place."""
    derivative, crossed, p = JACOBIAN, AWAY, FILTERED_P  # (6) by velocity and turn rate; (9) P times that
    square, dot = 0.0, 0.0
    for a in range(FILTERED + 3, FILTERED + 6):
        square += own[a] * own[a]
        dot += own[a] * own[a + 3]
    if square <= 0.0:
        return
    one = 1.0 / math.sqrt(square)
    dot *= one
    for a in range(3):
        own[derivative + a] = (own[FILTERED + 6 + a] - dot * own[FILTERED + 3 + a] * one) * one
        own[derivative + 3 + a] = own[FILTERED + 3 + a] * one
    total = sigma * sigma
    for a in range(9):
        own[crossed + a] = 0.0
        for b in range(6):
            own[crossed + a] += own[p + 9 * a + 3 + b] * own[derivative + b]
    for b in range(6):
        total += own[derivative + b] * own[crossed + 3 + b]
    for a in range(9):
        gain = own[crossed + a] / total
        own[FILTERED + a] -= gain * dot
        for b in range(9):
            own[p + 9 * a + b] -= gain * own[crossed + b]
