"""Which updates of a track can be assessed: those whose filter has forgotten how it started."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

BoolArray = NDArray[np.bool_]

#: Sum of alpha after which sigma is within 1 % of its steady value (see `alpha_beta.startup_length`).
MEMORY = 11.0


def restarts(alpha: ArrayLike, track: ArrayLike, *, jump: float = 0.2, longest_coast: int = 3) -> BoolArray:
    """Tell at which updates a filter starts anew: a new track, a jump of alpha, or the end of a long coast.

    `alpha` (n) in time order within each track, zero or NaN while coasting; `track` (n) changes where a track
    begins (give a re-initiated track, or one whose log has a gap, a new number). `jump` is the relative
    change of alpha from the update before that counts as one; `longest_coast` the number of missed updates in
    a row that does not.
    """
    a = np.nan_to_num(np.asarray(alpha, dtype=np.float64))
    mark = np.asarray(track)
    if a.shape != mark.shape or a.ndim != 1:
        raise ValueError(
            f"alpha has shape {a.shape} and track {mark.shape}; give two lists of the same length"
        )
    if a.size == 0:
        return np.zeros(0, dtype=bool)
    index = np.arange(a.size)
    begins = np.concatenate(([True], mark[1:] != mark[:-1]))
    updated = a > 0
    latest = np.maximum.accumulate(np.where(updated, index, -1))
    before = np.concatenate(([-1], latest[:-1]))  # the last real update before this row
    same = updated & (before >= np.maximum.accumulate(np.where(begins, index, 0)))
    reference = np.where(same, a[before], 1.0)
    jumped = same & (np.abs(a / reference - 1) > jump)
    coasted = same & (index - before - 1 > longest_coast)
    restarted: BoolArray = begins | jumped | coasted
    return restarted


def settled(alpha: ArrayLike, restart: ArrayLike, memory: float = MEMORY) -> BoolArray:
    """Tell which updates come long enough after the last restart: the alphas since then add up to 11 or more.

    With fixed gains that leaves out ceil(11 / alpha) updates. `alpha` and `restart` (n each) as in
    `restarts`; the first row counts as a restart. Coasted rows add nothing to the memory.
    """
    a = np.clip(np.nan_to_num(np.asarray(alpha, dtype=np.float64)), 0.0, None)
    if a.size == 0:
        return np.zeros(0, dtype=bool)
    since = np.cumsum(a) - a
    again = np.asarray(restart, dtype=bool).copy()
    again[0] = True
    start = np.maximum.accumulate(np.where(again, np.arange(a.size), 0))
    # The tiny amount forgives the rounding of the sum: 110 times 0.1 is enough.
    long_enough: BoolArray = since - since[start] >= memory - 1e-6
    return long_enough
