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

from rangeeval.compiled import compiled
from rangeeval.tracking.motion import CA, CV

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

RESET, ZERO, UNBIASED, UNBIASED_CROSS = 0, 1, 2, 3
PADDINGS = {"reset": RESET, "zero": ZERO, "unbiased": UNBIASED, "unbiased-cross": UNBIASED_CROSS}


@compiled
def third_block(motion: int) -> int:
    """What the third block of a model's state is: 0 nothing, 1 acceleration, 2 turn rate."""
    return 0 if motion == CV else (1 if motion == CA else 2)


@compiled
def pad(
    i: int,
    j: int,
    padding: int,
    prior: float,
    x: FloatArray,
    p: FloatArray,
    y: FloatArray,
    s: FloatArray,
    work: FloatArray,
) -> None:
    """Density of model `i` in the nine states of model `j`, into `y` (9), `s` (9, 9).

    `prior` is the sigma of the third block where it is drawn anew; `work` is scratch (9, 9).
    """
    for a in range(6):
        y[a] = x[i, a]
        for b in range(6):
            s[a, b] = p[i, a, b]
    for a in range(6, 9):
        y[a] = 0.0
        for b in range(9):
            s[a, b] = 0.0
            s[b, a] = 0.0
    if padding == RESET:
        for a in range(6, 9):
            s[a, a] = prior * prior
    elif padding == UNBIASED:
        for a in range(6, 9):
            y[a] = x[j, a]
            for b in range(6, 9):
                s[a, b] = p[j, a, b]
    elif padding == UNBIASED_CROSS:
        _regress(i, j, x, p, y, s, work)


@compiled
def _regress(i: int, j: int, x: FloatArray, p: FloatArray, y: FloatArray, s: FloatArray, work: FloatArray) -> None:
    # regression B of the third block on position and velocity in model j: B P66 = Pu6, by Cholesky of P66
    for a in range(6):
        for b in range(a + 1):
            total = p[j, a, b]
            for m in range(b):
                total -= work[a, m] * work[b, m]
            if a == b:
                work[a, a] = math.sqrt(total) if total > 0.0 else 0.0
            else:
                work[a, b] = total / work[b, b] if work[b, b] > 0.0 else 0.0
    for u in range(6, 9):
        for a in range(6):
            total = p[j, u, a]
            for m in range(a):
                total -= work[a, m] * work[u, m]
            work[u, a] = total / work[a, a] if work[a, a] > 0.0 else 0.0
        for k in range(6):
            a = 5 - k
            total = work[u, a]
            for m in range(a + 1, 6):
                total -= work[m, a] * work[u, m]
            work[u, a] = total / work[a, a] if work[a, a] > 0.0 else 0.0
    for u in range(6, 9):
        y[u] = x[j, u]
        for a in range(6):
            y[u] += work[u, a] * (x[i, a] - x[j, a])
            total = 0.0
            for m in range(6):
                total += work[u, m] * p[i, m, a]
            s[u, a] = total
            s[a, u] = total
    for u in range(6, 9):
        for t in range(6, 9):
            total = p[j, u, t]
            for a in range(6):
                total += work[u, a] * (s[a, t] - p[j, a, t])
            s[u, t] = total


@compiled
def mix(
    j: int,
    motions: IntArray,
    padding: int,
    prior: float,
    weights: FloatArray,
    x: FloatArray,
    p: FloatArray,
    scratch: FloatArray,
) -> None:
    """Mixed density of model `j`: the filtered densities of all models in its states, weighted and merged.

    `x` (4, models, 9) and `p` (4, models, 9, 9): row 0 is read, row 1 written, row 3 scratch; `weights` (models).
    """
    models = motions.size
    third = third_block(motions[j])
    n = 6 if third == 0 else 9
    y, s = x[1, j], p[1, j]
    for a in range(n):
        y[a] = 0.0
        for b in range(n):
            s[a, b] = 0.0
    for i in range(models):
        same = third == 0 or third_block(motions[i]) == third
        if not same:
            pad(i, j, padding, prior, x[0], p[0], x[3, i], p[3, i], scratch)
        for a in range(n):
            y[a] += weights[i] * (x[0, i, a] if same else x[3, i, a])
    for i in range(models):
        row = 0 if third == 0 or third_block(motions[i]) == third else 3
        weight = weights[i]
        xi, pi = x[row, i], p[row, i]
        for a in range(n):
            d = xi[a] - y[a]
            for b in range(n):
                s[a, b] += weight * (pi[a, b] + d * (xi[b] - y[b]))
