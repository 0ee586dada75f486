"""Tracks against truth: errors near and far from crossings; held, swapped or lost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class BearingErrors:
    """Mean-square errors, rad^2, over all targets and samples, and split at the beam width; counts beside."""

    mse: float
    mse_near: float
    mse_far: float
    n: int
    n_near: int
    n_far: int


def bearing_errors(bearing_rad: Array, truth_rad: Array, near_rad: float) -> BearingErrors:
    """Of (T, N) or (R, T, N) tracks; near: another true target is closer than `near_rad` then."""
    raise NotImplementedError


def outcome(bearing_rad: Array, truth_rad: Array, *, limit_rad: float = np.deg2rad(2.0), tail: float = 0.05) -> str:
    """ "held", "swapped" or "lost" of one (T, N) track set: within the limit of its own truth over the last
    `tail` of the samples; after relabelling; neither.
    """
    raise NotImplementedError
