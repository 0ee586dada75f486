"""Small tables for the figures: trajectories, innovations with their bounds, probabilities of the modes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.replay.gathering import COORDINATES, Gathered
from rangeeval.model.result import Series
from rangeeval.stats.reduce import decimate, thin
from rangeeval.tracking.filters import AlphaBeta
from rangeeval.tracking.runs import Flag, Run

Floats = NDArray[np.float64]

SHOWN_TRACKS = 6  # with the most plots; more lines than that nobody can tell apart
POINTS = 250
BOUND = 2.0  # sigmas


def series_of(gathered: Gathered, runs: Sequence[Run], truths: Sequence[Floats] | None) -> dict[str, Series]:
    """The series of the longest tracks, in the order of their names."""
    longest = sorted(range(len(runs)), key=lambda i: -len(gathered.tracks[i].plots))[:SHOWN_TRACKS]
    found: dict[str, Series] = {}
    for i in sorted(longest):
        name, run = gathered.tracks[i].name or "T001", runs[i]
        if not np.isfinite(run.state[:, 0]).any():
            continue
        found[f"trajectory/{name}"] = _path(run.state)
        if truths is not None and np.isfinite(truths[i][:, 0]).any():
            found[f"truth/{name}"] = _path(truths[i])
        found |= _innovations(name, run)
        if not isinstance(run.filter, AlphaBeta) and run.mode_probability.shape[1] > 1:
            found[f"modes/{name}"] = _modes(run)
    return found


def _path(state: Floats) -> Series:
    rows = np.unique(np.linspace(0, len(state) - 1, min(len(state), 2 * POINTS)).astype(int))
    rows = rows[np.isfinite(state[rows, 0])]
    return {name: state[rows, k].tolist() for k, name in enumerate(("east_m", "north_m", "up_m"))}


def _innovations(name: str, run: Run) -> dict[str, Series]:
    found: dict[str, Series] = {}
    time = run.measurements.time_s
    gated = (run.flags & int(Flag.GATED)) != 0
    for k, coordinate in enumerate(COORDINATES):
        e = np.where(gated, np.nan, run.innovation[:, k])
        if not np.isfinite(e).any():
            continue
        x, y = thin(time, e, columns=2 * POINTS)
        with np.errstate(invalid="ignore"):
            bound = BOUND * np.sqrt(run.innovation_covariance[:, k, k])
        at, line = decimate(time[np.isfinite(bound)], bound[np.isfinite(bound)], POINTS)
        found[f"innovation/{coordinate}/{name}"] = {"time_s": x.tolist(), "value": y.tolist()}
        found[f"bound/{coordinate}/{name}"] = {"time_s": at.tolist(), "value": line.tolist()}
    return found


def _modes(run: Run) -> Series:
    time = run.measurements.time_s
    rows = np.unique(np.linspace(0, len(time) - 1, min(len(time), 4 * POINTS)).astype(int))
    rows = rows[np.isfinite(run.mode_probability[rows]).all(axis=1)]
    columns = {f"mode_{m + 1}": run.mode_probability[rows, m].tolist() for m in range(run.mode_probability.shape[1])}
    return {"time_s": time[rows].tolist(), **columns}
