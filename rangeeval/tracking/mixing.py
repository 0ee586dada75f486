"""Mixing of the models' densities in an IMM filter whose models have unequal states, as compiled kernels.

References
----------
Blom and Bar-Shalom (1988). Unequal states: Granstrom, Willett and Bar-Shalom (2015), Systematic approach to IMM mixing
for unequal dimension states (`unbiased`, `unbiased-cross`); `reset` draws the third block from its prior.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rangeeval.compiled import compiled_ieee, compiled_inside
from rangeeval.tracking.motion import CA, CV

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

RESET, ZERO, UNBIASED, UNBIASED_CROSS = 0, 1, 2, 3
PADDINGS = {"reset": RESET, "zero": ZERO, "unbiased": UNBIASED, "unbiased-cross": UNBIASED_CROSS}


@compiled_ieee
def third_block(motion: int) -> int:
    """What the third block of a model's state is: 0 nothing, 1 acceleration, 2 turn rate."""
    return 0 if motion == CV else (1 if motion == CA else 2)


@compiled_inside
def pad(padding: int, prior: float, x: FloatArray, p: FloatArray, row: int, own: int, f: FloatArray) -> None:
    """Complete position and velocity in `row` of `x` (n, 9), `p` (n, 81) by a third block that its model does not have.

    Row `own` is the density of the model that it is mixed into; `prior` the sigma of the third block where it is drawn
    anew; `f` (162) is scratch.
    """
    for k in range(54, 81):
        p[row, k] = 0.0
    for a in range(6):
        for b in range(6, 9):
            p[row, 9 * a + b] = 0.0
    for a in range(6, 9):
        x[row, a] = 0.0
    if padding == RESET:
        for a in range(6, 9):
            p[row, 10 * a] = prior * prior
    elif padding == UNBIASED:
        for a in range(6, 9):
            x[row, a] = x[own, a]
            for b in range(6, 9):
                p[row, 9 * a + b] = p[own, 9 * a + b]
    elif padding == UNBIASED_CROSS:
        _regress(x, p, row, own, f)


@compiled_inside
def _regress(x: FloatArray, p: FloatArray, row: int, own: int, f: FloatArray) -> None:
    # regression B of the third block on position and velocity in `own`: B P66 = Pu6, by Cholesky of P66
    for a in range(9):
        for b in range(min(a + 1, 6)):
            total = p[own, 9 * a + b]
            for m in range(b):
                total -= f[9 * a + m] * f[9 * b + m]
            if a == b:
                f[10 * a] = math.sqrt(total) if total > 0.0 else math.inf
            else:
                f[9 * a + b] = total / f[10 * b]
    for u in range(6, 9):
        for k in range(6):
            a = 5 - k
            total = f[9 * u + a]
            for m in range(a + 1, 6):
                total -= f[9 * m + a] * f[9 * u + m]
            f[9 * u + a] = total / f[10 * a]
    for u in range(6, 9):
        x[row, u] = x[own, u]
        for a in range(6):
            x[row, u] += f[9 * u + a] * (x[row, a] - x[own, a])
            total = 0.0
            for m in range(6):
                total += f[9 * u + m] * p[row, 9 * m + a]
            p[row, 9 * u + a] = total
            p[row, 9 * a + u] = total
    for u in range(6, 9):
        for t in range(6, 9):
            total = p[own, 9 * u + t]
            for a in range(6):
                total += f[9 * u + a] * (p[row, 9 * a + t] - p[own, 9 * a + t])
            p[row, 9 * u + t] = total


@compiled_inside
def add_outer(p: FloatArray, row: int, weight: float, f: FloatArray) -> None:
    """Add weight d d' to `row` of `p` (n, 81), d being the first nine of `f`."""
    d0, d1, d2, d3, d4, d5, d6, d7, d8 = f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7], f[8]
    for a in range(9):
        e = weight * f[a]
        p[row, 9 * a] += e * d0
        p[row, 9 * a + 1] += e * d1
        p[row, 9 * a + 2] += e * d2
        p[row, 9 * a + 3] += e * d3
        p[row, 9 * a + 4] += e * d4
        p[row, 9 * a + 5] += e * d5
        p[row, 9 * a + 6] += e * d6
        p[row, 9 * a + 7] += e * d7
        p[row, 9 * a + 8] += e * d8


@compiled_inside
def mix(
    j: int,
    motions: IntArray,
    padding: int,
    prior: float,
    weight: FloatArray,
    x: FloatArray,
    p: FloatArray,
    f: FloatArray,
) -> None:
    """Mixed density of model `j`: the filtered densities of all models in its states, weighted and merged.

    Rows of `x` (4 models, 9) and `p` (4 models, 81): filtered, mixed, predicted densities of the models in turn, and
    scratch. Row 2 of `weight` holds the weights. The spread of the means is a sum over pairs of models:
    sum w_i d_i d_i' = sum over i < k of w_i w_k (x_i - x_k)(x_i - x_k)'.
    """
    models = motions.size
    third = third_block(motions[j])
    if third > 0:
        for i in range(models):
            other = third_block(motions[i])
            if other == third:
                continue
            row = i
            if other != 0:  # its third block is something else: work on a copy
                row = 3 * models + i
                for a in range(9):
                    x[row, a] = x[i, a]
                for k in range(81):
                    p[row, k] = p[i, k]
            pad(padding, prior, x, p, row, j, f)
    to = models + j
    for a in range(9):
        x[to, a] = 0.0
    for k in range(81):
        p[to, k] = 0.0
    for i in range(models):
        row = i if third == 0 or third_block(motions[i]) == 0 or third_block(motions[i]) == third else 3 * models + i
        w = weight[2, i]
        for a in range(9):
            x[to, a] += w * x[row, a]
        for k in range(81):
            p[to, k] += w * p[row, k]
        for m in range(i):
            other = (
                m if third == 0 or third_block(motions[m]) == 0 or third_block(motions[m]) == third else 3 * models + m
            )
            for a in range(9):
                f[a] = x[row, a] - x[other, a]
            add_outer(p, to, w * weight[2, m], f)
