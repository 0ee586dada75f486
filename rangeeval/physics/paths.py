"""A surveyed path between its points: position and velocity at any time that lies in no gap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

MAX_SPEED_M_S = 2000.0  # faster is an error of the record, not a target
STALE_S = 20.0  # a position may be repeated so long while the target moves, before it counts as standing still


@dataclass(frozen=True)
class Cleaned:
    """Points of a path in order of time, each time once, and how many were left out and why."""

    time_s: Floats
    position_m: Floats
    missing: int
    repeated: int
    stale: int
    jumps: int


def clean(
    time_s: ArrayLike,
    position_m: ArrayLike,
    max_speed_m_s: float = MAX_SPEED_M_S,
    *,
    reported: ArrayLike | None = None,
) -> Cleaned:
    """Points (n), (n, d) that can be interpolated: finite, in order, no time twice, no stale position, no jump.

    Stale: a position repeated to the last digit by a receiver that had no new one, while the target moves. A jump: a
    point that cannot be reached from either neighbour below `max_speed_m_s`. `reported` (n, k): what a receiver repeats
    when it has nothing new, where that is not the position itself (latitude and longitude; height comes apart).
    """
    time, position = np.asarray(time_s, dtype=np.float64), np.asarray(position_m, dtype=np.float64)
    key = position if reported is None else np.asarray(reported, dtype=np.float64)
    good = np.isfinite(time) & np.isfinite(position).all(axis=-1)
    missing = int(np.count_nonzero(~good))
    time, first = np.unique(time[good], return_index=True)
    position, key = position[good], key[good]
    repeated = len(position) - len(time)
    position, key = position[first], key[first]
    fresh = ~_stale(time, key)
    stale = int(np.count_nonzero(~fresh))
    time, position = time[fresh], position[fresh]
    near = ~_jumps(time, position, max_speed_m_s)
    return Cleaned(time[near], position[near], missing, repeated, stale, int(np.count_nonzero(~near)))


def _stale(time: Floats, position: Floats) -> NDArray[np.bool_]:
    """Later points of a run of equal positions, where the runs are short and the path moves in between."""
    stale = np.zeros(len(time), bool)
    if len(time) < 3:
        return stale
    same = (np.diff(position, axis=0) == 0).all(axis=1)
    if same.all() or not same.any():
        return stale
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
    for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        after = min(b + 1, len(time) - 1)
        if time[b] - time[a] <= STALE_S and not (position[after] == position[b]).all():
            stale[a + 1 : b + 1] = True
    return stale


def _jumps(time: Floats, position: Floats, limit: float) -> NDArray[np.bool_]:
    far = np.zeros(len(time), bool)
    if len(time) > 2:
        fast = np.linalg.norm(np.diff(position, axis=0), axis=1) > limit * np.diff(time)
        far[1:-1] = fast[:-1] & fast[1:]
        # At an end one neighbour has to do: it is the end that jumped when the next step is sound.
        far[0] = fast[0] and not fast[1]
        far[-1] = fast[-1] and not fast[-2]
    return far


def interpolate(time_s: ArrayLike, position_m: ArrayLike, at_s: ArrayLike, max_gap_s: float) -> tuple[Floats, Floats]:
    """Position and velocity (m, d) of a path of points (n), (n, d) at times (m); NaN in a gap and outside the path.

    Cubic between neighbours, with the velocity at each point from the parabola through it and its neighbours, within a
    stretch that has no gap longer than `max_gap_s`: exact for constant acceleration. Times increase.
    """
    time, position = np.asarray(time_s, dtype=np.float64), np.asarray(position_m, dtype=np.float64)
    at = np.asarray(at_s, dtype=np.float64)
    missing = np.full((len(at), position.shape[-1]), np.nan)
    if len(time) < 2:
        return missing, missing.copy()
    velocity = _velocity(time, position, max_gap_s)
    k = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    step = np.diff(time)[k]
    on_a_point = (at == time[k]) | (at == time[k + 1])
    known = (at >= time[0]) & (at <= time[-1]) & ((step <= max_gap_s) | on_a_point)
    h = step[:, None]
    u = ((at - time[k]) / step)[:, None]
    a, b, va, vb = position[k], position[k + 1], velocity[k] * h, velocity[k + 1] * h
    # Hermite: c0 + c1 u + c2 u^2 + c3 u^3 with c0 = a, c1 = va.
    c2, c3 = 3 * (b - a) - 2 * va - vb, 2 * (a - b) + va + vb
    place = a + u * (va + u * (c2 + u * c3))
    speed = (va + u * (2 * c2 + 3 * u * c3)) / h
    return np.where(known[:, None], place, np.nan), np.where(known[:, None], speed, np.nan)


def _velocity(time: Floats, position: Floats, max_gap_s: float) -> Floats:
    """Velocity at each point of a path, from points of its own stretch only."""
    velocity = np.zeros_like(position)
    edges = np.flatnonzero(np.diff(time) > max_gap_s) + 1
    for rows in np.split(np.arange(len(time)), edges):
        if len(rows) > 1:
            order: Literal[1, 2] = 2 if len(rows) > 2 else 1
            velocity[rows] = np.gradient(position[rows], time[rows], axis=0, edge_order=order)
    return velocity
