"""Targets found in the first snapshots, without being told how many or where."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from rangeeval.arrays.assessment import bearing_difference
from rangeeval.arrays.bounds import beam_width
from rangeeval.arrays.counting import count_sources
from rangeeval.arrays.geometry import ArrayGeometry
from rangeeval.arrays.options import StartUncertainty
from rangeeval.arrays.spectra import covariance, music, root_music

Array = NDArray[np.float64]

_STILL = 0.2  # of a beam width: more motion in a block and the count cannot be trusted
_AGREE = 0.5  # of a beam width: a bearing found again in the next block


@dataclass(frozen=True, eq=False)
class Start:
    """Targets found in the first snapshots: bearings and rates (N,) at snapshot 0, ascending.

    uncertainty : standard deviations to start a tracker with. flags : "moving" when a target moves so far in a block
    that the count cannot be trusted; "fewer-found" when the spectrum showed fewer than were counted or asked for;
    "none-found".
    """

    bearing_rad: Array
    rate_rad: Array
    uncertainty: StartUncertainty
    flags: tuple[str, ...]


def start(geometry: ArrayGeometry, snapshots: ArrayLike, *, targets: int | None = None, block: int = 20) -> Start:
    """Count the targets by MDL on short blocks, find them by root-MUSIC or MUSIC, and their rates from two blocks.

    snapshots : (K, M) or (K, bins, M), K at least two blocks; those with a NaN are left out.
    targets : how many, when it is known.

    The count is the middle one of the blocks among the first four, since one block in twenty counts wrong. ValueError
    for too few snapshots, or more targets than sensors less one.
    """
    x = np.asarray(snapshots, dtype=np.complex128)
    whole = np.flatnonzero(np.isfinite(x).all(axis=tuple(range(1, x.ndim))))
    if whole.size < 2 * block:
        raise ValueError(f"{whole.size} complete snapshots; the automatic start needs 2 blocks of {block}")
    parts = [whole[i * block : (i + 1) * block] for i in range(min(4, whole.size // block))]
    covariances = [covariance(x[part]) for part in parts]
    if targets is None:
        counts = sorted(count_sources(cov, block).mdl for cov in covariances)
        targets = min(counts[len(counts) // 2], geometry.sensors - 1)
    elif targets > geometry.sensors - 1:
        raise ValueError(f"{targets} targets on {geometry.sensors} sensors; {targets + 1} sensors or more are needed")
    beam = beam_width(geometry, 0.5 * sum(geometry.sector))
    if not targets:
        return Start(np.empty(0), np.empty(0), StartUncertainty(), ("none-found",))
    times = [float(part.mean()) for part in parts]
    first, second = (_found(geometry, cov, targets) for cov in covariances[:2])
    rate = _rates(first, second, times[1] - times[0], _AGREE * beam)
    flags = []
    if first.size < targets:
        flags.append("fewer-found")
    if first.size and np.abs(rate).max() * block > _STILL * beam:
        flags.append("moving")
    if not first.size:
        flags.append("none-found")
    # One block places a target to a tenth of a beam or so; its rate has twice that over the time between blocks.
    sigma = 0.1 * beam
    return Start(
        first - rate * times[0],
        rate,
        StartUncertainty(sigma, math.sqrt(2.0) * sigma / (times[1] - times[0])),
        tuple(flags),
    )


def _found(geometry: ArrayGeometry, cov: NDArray[np.complex128], targets: int) -> Array:
    """Bearings of one block."""
    spacing = geometry.spacing_m
    if geometry.bins == 1 and spacing is not None and 2 * abs(spacing) <= geometry.wavelength_m[0] * (1 + 1e-9):
        return root_music(geometry, cov, targets)
    return music(geometry, cov, targets)


def _rates(first: Array, second: Array, apart: float, reach: float) -> Array:
    """Rate of each target of the first block by the nearest of the second; 0 where none is within reach."""
    rate = np.zeros(first.size)
    off = bearing_difference(second[None, :], first[:, None])
    rows, columns = linear_sum_assignment(np.minimum(np.abs(off), reach))
    for i, k in zip(rows, columns, strict=True):
        if abs(off[i, k]) < reach:
            rate[i] = off[i, k] / apart
    return rate
