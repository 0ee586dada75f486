"""Mixing of the models' densities in an IMM filter whose models have unequal states, as compiled kernels.

References
----------
Blom and Bar-Shalom (1988). Unequal states: Granstrom, Willett and Bar-Shalom (2015), Systematic approach to IMM mixing
for unequal dimension states (`unbiased`, `unbiased-cross`); `reset` draws the third block from its prior.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rangeeval.compiled import compiled_inside
from rangeeval.tracking.layout import (
    AWAY,
    DENSITY,
    FILTERED,
    FILTERED_P,
    MIX,
    PADDED,
    PADDED_P,
    PREDICTED,
    PREDICTED_P,
    PRODUCT,
    SEEN,
)
from rangeeval.tracking.motion import CT, CV

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

RESET, ZERO, UNBIASED, UNBIASED_CROSS = 0, 1, 2, 3
PADDINGS = {"reset": RESET, "zero": ZERO, "unbiased": UNBIASED, "unbiased-cross": UNBIASED_CROSS}


@compiled_inside
def mix(s: FloatArray, j: int, motions: IntArray, padding: int, prior: float) -> None:
    """Mixed density of model `j` into its PREDICTED: the filtered ones of all models in its states, weighted by MIX.

    The spread of the means is a sum over pairs of models: sum w_i d_i d_i' = sum over i < k of
    w_i w_k (x_i - x_k)(x_i - x_k)'.
    """
    own = s[j]
    for c in range(PREDICTED, PREDICTED + DENSITY):
        own[c] = 0.0
    for i in range(motions.size):
        one = s[i]
        at = FILTERED
        if motions[j] != CV and (motions[i] == CV or (motions[i] >= CT) != (motions[j] >= CT)):
            at = PADDED
            _pad(one, own, padding, prior)
        w = one[MIX]
        for a in range(9):
            one[SEEN + a] = one[at + a]
        for c in range(DENSITY):
            own[PREDICTED + c] += w * one[at + c]
        for m in range(i):
            other = s[m]
            for a in range(9):
                own[AWAY + a] = one[SEEN + a] - other[SEEN + a]
            both = w * other[MIX]
            for a in range(9):
                e = both * own[AWAY + a]
                for b in range(9):
                    own[PREDICTED_P + 9 * a + b] += e * own[AWAY + b]


@compiled_inside
def _pad(one: FloatArray, own: FloatArray, padding: int, prior: float) -> None:
    """The filtered density of model `one` into its PADDED, with a third block for the model `own`.

    `prior` is the sigma of the third block where it is drawn anew.
    """
    for c in range(DENSITY):
        one[PADDED + c] = one[FILTERED + c]
    for u in range(6, 9):
        for a in range(9):
            one[PADDED_P + 9 * u + a] = 0.0
            one[PADDED_P + 9 * a + u] = 0.0
        one[PADDED + u] = 0.0
    for u in range(6, 9):
        if padding == RESET:
            one[PADDED_P + 10 * u] = prior * prior
        elif padding >= UNBIASED:
            one[PADDED + u] = own[FILTERED + u]
            for b in range(6, 9):
                one[PADDED_P + 9 * u + b] = own[FILTERED_P + 9 * u + b]
    if padding == UNBIASED_CROSS:
        _regress(one, own)


@compiled_inside
def _regress(one: FloatArray, own: FloatArray) -> None:
    """Give the third block in PADDED the regression on position and velocity that it has in model `own`.

    Sweeping position and velocity out of the covariance of `own` leaves the regression B in the rows of the third
    block, and in its own block what is left of its covariance.
    """
    for c in range(81):
        own[PRODUCT + c] = own[FILTERED_P + c]
    for k in range(6):
        row = PRODUCT + 9 * k
        pivot = own[row + k]
        for u in range(PRODUCT, PRODUCT + 81, 9):
            share = own[u + k] / pivot if u != row and pivot > 0.0 else 0.0
            for c in range(9):
                own[u + c] -= share * own[row + c]
            own[u + k] = share if u != row else 1.0
        for c in range(9):
            own[row + c] = own[row + c] / pivot if pivot > 0.0 and c != k else 0.0
    for u in range(6, 9):
        b = PRODUCT + 9 * u
        for a in range(6):
            one[PADDED + u] += own[b + a] * (one[PADDED + a] - own[FILTERED + a])
            total = 0.0
            for m in range(6):
                total += own[b + m] * one[PADDED_P + 9 * m + a]
            one[PADDED_P + 9 * u + a] = total
            one[PADDED_P + 9 * a + u] = total
    for u in range(6, 9):
        for t in range(6, 9):
            total = own[PRODUCT + 9 * u + t]
            for a in range(6):
                total += one[PADDED_P + 9 * u + a] * own[PRODUCT + 9 * t + a]
            one[PADDED_P + 9 * u + t] = total
