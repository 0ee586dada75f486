"""What blocks of snapshots show without tracking: the beamformer over time, spectra, the number of sources."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.bearing.recording import Recording
from rangeeval.arrays.bounds import beam_width
from rangeeval.arrays.counting import count_sources
from rangeeval.arrays.spectra import beamformer, capon, covariance, music_spectrum

Floats = NDArray[np.float64]

MOST_COLUMNS, MOST_ROWS = 240, 181  # of the waterfall: what a page shows
SPECTRA = 4
FLOOR_DB = -15.0
_COUNTED = 20  # snapshots of a block whose sources are counted


@dataclass(frozen=True)
class Waterfall:
    """Beamformer power (columns, rows), dB below the strongest of its column; edges in the array's frame."""

    time_edges_s: Floats
    bearing_edges_rad: Floats
    level_db: Floats


@dataclass(frozen=True)
class Spectrum:
    """Of one block at its middle: dB below the highest, over bearings of the array's frame."""

    time_s: float
    bearing_rad: Floats
    beamformer_db: Floats
    capon_db: Floats
    music_db: Floats


@dataclass(frozen=True)
class Counts:
    """The number of sources of each block (at its middle) by each criterion."""

    time_s: Floats
    mdl: NDArray[np.int64]
    aic: NDArray[np.int64]


def waterfall(recording: Recording) -> Waterfall:
    """The beamformer over the whole record, in as many blocks and bearings as a page shows."""
    total = len(recording.snapshots)
    least = max(1, recording.geometry.sensors // recording.bins)  # fewer snapshots show mostly their own noise
    columns = max(1, min(MOST_COLUMNS, total // least))
    low, high = recording.geometry.sector
    rows = int(min(MOST_ROWS, max(31, 8 * (high - low) / beam_width(recording.geometry))))
    edges = np.linspace(low, high, rows + 1)
    middles = 0.5 * (edges[1:] + edges[:-1])
    starts = np.linspace(0, total, columns + 1).astype(int)
    level = np.full((columns, rows), np.nan)
    for i, (a, b) in enumerate(pairwise(starts.tolist())):
        if recording.usable[a:b].any():
            level[i] = _decibels(beamformer(recording.geometry, covariance(recording.snapshots[a:b]), middles))
    step = recording.interval_s
    when = np.interp(starts - 0.5, np.arange(total), recording.time_s)
    when[0], when[-1] = recording.time_s[0] - step / 2, recording.time_s[-1] + step / 2
    return Waterfall(np.linspace(when[0], when[-1], columns + 1), edges, np.maximum(level, FLOOR_DB))


def spectra(recording: Recording, sources: int) -> list[Spectrum]:
    """Spectra of a few blocks spread over the record."""
    total = len(recording.snapshots)
    sensors = recording.geometry.sensors
    block = min(total, max(5 * sensors // recording.bins, 2 * _COUNTED // recording.bins, 2))
    low, high = recording.geometry.sector
    grid = np.linspace(low, high, 361)
    found = []
    for middle in np.linspace(0, total - block, SPECTRA).astype(int):
        part = slice(int(middle), int(middle) + block)
        if np.count_nonzero(recording.usable[part]) * recording.bins < sensors:
            continue
        cov = covariance(recording.snapshots[part])
        if _silent(cov):
            continue
        known = min(max(sources, 1), sensors - 1)
        found.append(
            Spectrum(
                float(recording.time_s[part].mean()), grid,
                *(_decibels(np.asarray(s)) for s in (
                    beamformer(recording.geometry, cov, grid), capon(recording.geometry, cov, grid),
                    music_spectrum(recording.geometry, cov, known, grid),
                )),
            )
        )  # fmt: skip
    return found


def counts(recording: Recording, blocks: int = MOST_COLUMNS) -> Counts:
    """AIC and MDL of short blocks over the record; moving sources are over-counted in long ones."""
    total = len(recording.snapshots)
    block = min(total, max(_COUNTED, recording.geometry.sensors + 1))
    times, mdl, aic = [], [], []
    for start in np.unique(np.linspace(0, total - block, min(blocks, max(1, total // block))).astype(int)).tolist():
        part = slice(start, start + block)
        usable = int(np.count_nonzero(recording.usable[part]))
        if usable < block // 2:
            continue
        cov = covariance(recording.snapshots[part])
        if _silent(cov):
            continue
        found = count_sources(cov, usable)
        times.append(float(recording.time_s[part].mean()))
        mdl.append(found.mdl)
        aic.append(found.aic)
    return Counts(np.array(times), np.array(mdl, np.int64), np.array(aic, np.int64))


def _silent(cov: NDArray[Any]) -> bool:
    """Whether a frequency bin holds nothing: a recorder that dropped out."""
    return not np.real(np.trace(cov, axis1=-2, axis2=-1)).min() > 0


def _decibels(power: Floats) -> Floats:
    highest = float(np.max(power, initial=0.0))
    if not highest > 0 or not math.isfinite(highest):
        return np.full(len(power), np.nan)
    return np.asarray(10 * np.log10(np.maximum(power / highest, 1e-12)))


__all__ = ["Counts", "Spectrum", "Waterfall", "counts", "spectra", "waterfall"]
