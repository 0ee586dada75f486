"""Small tables for the figures: trajectories, innovations with their bounds, probabilities of the modes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.replay.gathering import COORDINATES, Gathered
from rangeeval.model.result import Series
from rangeeval.stats.reduce import thin
from rangeeval.tracking.filters import AlphaBeta
from rangeeval.tracking.runs import Flag, Run

Floats = NDArray[np.float64]

SHOWN_TRACKS = 6  # with the most plots; more lines than that nobody can tell apart
POINTS = 250
BOUND = 2.0  # sigmas
LONG_GAP, SHORT_GAP_S = 10.0, 20.0  # usual intervals, or seconds if more, over which no line is drawn


def series_of(gathered: Gathered, runs: Sequence[Run], truths: Sequence[Floats] | None) -> dict[str, Series]:
    """The series of the longest tracks, in the order of their names."""
    longest = sorted(range(len(runs)), key=lambda i: -len(gathered.tracks[i].plots))[:SHOWN_TRACKS]
    found: dict[str, Series] = {}
    for i in sorted(longest):
        name, run = gathered.tracks[i].name or "T001", runs[i]
        if not np.isfinite(run.state[:, 0]).any():
            continue
        time = run.measurements.time_s
        found[f"trajectory/{name}"] = _path(time, run.state, run.planar)
        if truths is not None and np.isfinite(truths[i][:, 0]).any():
            found[f"truth/{name}"] = _path(time, truths[i], run.planar)
        found |= _innovations(name, run)
        if not isinstance(run.filter, AlphaBeta) and run.mode_probability.shape[1] > 1:
            found[f"modes/{name}"] = _modes(run)
    return found


def _rows(time: Floats, good: NDArray[np.bool_], count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """About `count` of the good rows at most, and where a line through them has to break: at long gaps."""
    rows = np.flatnonzero(good)
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), count)).astype(int))] if len(rows) else rows
    whole = np.flatnonzero(good)
    step = np.diff(time[whole])
    usual = float(np.median(step)) if step.size else 0.0
    ends = whole[1:][step > max(LONG_GAP * usual, SHORT_GAP_S)]
    return rows, np.searchsorted(rows, ends)


def _line(values: Floats, rows: NDArray[np.intp], breaks: NDArray[np.intp]) -> list[float]:
    return np.insert(values[rows], breaks, np.nan).tolist()


def _path(time: Floats, state: Floats, planar: bool) -> Series:
    rows, breaks = _rows(time, np.isfinite(state[:, 0]), 2 * POINTS)
    names = ("east_m", "north_m") if planar else ("east_m", "north_m", "up_m")
    return {name: _line(state[:, k], rows, breaks) for k, name in enumerate(names)}


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
        rows, breaks = _rows(time, np.isfinite(bound), 4 * POINTS)
        found[f"innovation/{coordinate}/{name}"] = {"time_s": x.tolist(), "value": y.tolist()}
        found[f"bound/{coordinate}/{name}"] = {
            "time_s": np.insert(time[rows], breaks, time[rows[breaks]]).tolist(), "value": _line(bound, rows, breaks),
        }  # fmt: skip
    return found


def _modes(run: Run) -> Series:
    time = run.measurements.time_s
    p = run.mode_probability
    rows, breaks = _rows(time, np.isfinite(p.sum(axis=1)), 4 * POINTS)
    columns = {f"mode_{m + 1}": _line(p[:, m], rows, breaks) for m in range(p.shape[1])}
    return {"time_s": np.insert(time[rows], breaks, time[rows[breaks]]).tolist(), **columns}
