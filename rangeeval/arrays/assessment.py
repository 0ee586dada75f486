"""Bearing tracks against truth: errors near and far from crossings; held, swapped or lost."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from rangeeval.angles import wrapped

Array = NDArray[np.float64]
Outcome = Literal["held", "swapped", "lost"]


@dataclass(frozen=True)
class BearingErrors:
    """Mean-square errors, rad^2, over all targets and samples, near and far from other targets; counts beside."""

    mse: float
    mse_near: float
    mse_far: float
    n: int
    n_near: int
    n_far: int


def bearing_difference(bearing_rad: ArrayLike, truth_rad: ArrayLike) -> Array:
    """First minus second, wrapped to -pi .. pi."""
    return wrapped(np.asarray(bearing_rad, dtype=np.float64) - np.asarray(truth_rad, dtype=np.float64))


def bearing_errors(bearing_rad: ArrayLike, truth_rad: ArrayLike, near_rad: float) -> BearingErrors:
    """Errors of tracks (T, N) or (runs, T, N) against truth (T, N); a NaN in either leaves that sample out.

    Near: another true target is then closer than `near_rad`, a beam width. NaN where there is no sample.
    """
    truth = np.asarray(truth_rad, dtype=np.float64)
    square = bearing_difference(bearing_rad, truth) ** 2
    apart = np.abs(bearing_difference(truth[:, :, None], truth[:, None, :]))
    apart[:, np.arange(truth.shape[1]), np.arange(truth.shape[1])] = np.inf
    near = np.broadcast_to(np.nanmin(apart, axis=2) < near_rad, square.shape)
    parts = []
    for chosen in (np.ones(square.shape, bool), near, ~near):
        values = square[chosen & np.isfinite(square)]
        parts.append((float(values.mean()) if values.size else math.nan, values.size))
    (mse, n), (mse_near, n_near), (mse_far, n_far) = parts
    return BearingErrors(mse, mse_near, mse_far, n, n_near, n_far)


def outcome(
    bearing_rad: ArrayLike, truth_rad: ArrayLike, *, limit_rad: float = math.radians(2.0), tail: float = 0.05
) -> Outcome:
    """What became of the tracks (T, N) of one run, by the last `tail` of its samples.

    held: every track within the limit of its own truth there; swapped: so after exchanging tracks; lost: neither.
    """
    truth = np.asarray(truth_rad, dtype=np.float64)
    last = max(1, round(tail * len(truth)))
    ends = np.asarray(bearing_rad, dtype=np.float64)[-last:]
    off = np.abs(bearing_difference(ends[:, :, None], truth[-last:, None, :])).max(axis=0)
    within = off < limit_rad
    if np.diag(within).all():
        return "held"
    rows, columns = linear_sum_assignment(~within)
    return "swapped" if within[rows, columns].all() else "lost"


def outcomes(bearing_rad: ArrayLike, truth_rad: ArrayLike, *, limit_rad: float = math.radians(2.0)) -> dict[str, float]:
    """Share of the runs (runs, T, N) that were held, swapped and lost."""
    found = [outcome(one, truth_rad, limit_rad=limit_rad) for one in np.asarray(bearing_rad, dtype=np.float64)]
    return {word: found.count(word) / len(found) for word in ("held", "swapped", "lost")}
