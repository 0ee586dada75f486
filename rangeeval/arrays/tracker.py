"""Bearings of several targets over time from the snapshots of one array: one call for every method."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.arrays.geometry import ArrayGeometry
from rangeeval.arrays.options import JointOptions, PastOptions, Track

Array = NDArray[np.float64]
Snapshots = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Start:
    """Targets found in the first snapshots: bearings and rates (N,), at snapshot 0; `sigma` what to start with."""

    bearing_rad: Array
    rate_rad: Array
    flags: tuple[str, ...]  # "moving" (count uncertain), "few-sensors", "none-found"


def track(
    method: str,
    geometry: ArrayGeometry,
    snapshots: Snapshots,
    start_bearing_rad: ArrayLike,
    start_rate_rad: ArrayLike | None = None,
    options: PastOptions | JointOptions | None = None,
) -> Track:
    """Track N targets from where they start. Method one of METHODS.

    snapshots : (K, M), (K, bins, M), or with a leading axis of runs for Monte Carlo; a snapshot that holds a NaN is
        a missing one.
    start_bearing_rad, start_rate_rad : (N,) or (runs, N) at the snapshot before the first; rates 0 by default.
    ValueError: unknown method, shapes that do not fit, fewer sensors than targets plus one, `ryu` off a line.
    """
    raise NotImplementedError


def start(geometry: ArrayGeometry, snapshots: Snapshots, *, targets: int | None = None, block: int = 20) -> Start:
    """Find the targets by MDL on short blocks and (root-)MUSIC, their rates from two blocks."""
    raise NotImplementedError
