"""Small tables for the figures: tracks, waterfall, spectra, guard and number of sources."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.bearing.blocks import Counts, Spectrum, Waterfall
from rangeeval.analyses.bearing.frame import Frame
from rangeeval.analyses.bearing.recording import Recording
from rangeeval.analyses.bearing.tracking import Tracked
from rangeeval.analyses.bearing.truth import Judged
from rangeeval.angles import wrapped
from rangeeval.arrays import options as arrays
from rangeeval.model.result import Series

Floats = NDArray[np.float64]

MOST = 2000  # rows of a series


def track_series(
    recording: Recording, tracked: Tracked, names: Sequence[str], frame: Frame, z: float, judged: Judged | None
) -> dict[str, Series]:
    """Each target's bearing with its interval (and the truth), as shown."""
    kept = _kept(len(tracked.sample))
    time = times(recording, tracked)[kept]
    found: dict[str, Series] = {}
    for n, name in enumerate(names):
        bearing = frame.shown(tracked.bearing_rad[kept, n])
        half = z * tracked.sigma_rad[kept, n]
        series: dict[str, Sequence[float]] = {
            "time_s": time.tolist(),
            "bearing_rad": bearing.tolist(),
            "low_rad": (bearing - half).tolist(),
            "high_rad": (bearing + half).tolist(),
            "heard": (1.0 * ((tracked.bits[kept, n] & (arrays.MISSING | arrays.FADED)) == 0)).tolist(),
        }
        if judged is not None:
            series["truth_rad"] = frame.shown(_between(judged.truth_rad[:, n], tracked.sample[kept])).tolist()
        found[f"bearing/{name}"] = series
    if np.isfinite(tracked.guard).any():
        found["guard"] = {"time_s": time.tolist(), "eigenvalue": tracked.guard[kept].tolist()}
    if np.isfinite(tracked.coherence).any():
        found["coherence"] = {"time_s": time.tolist(), "share": tracked.coherence[kept].tolist()}
    return found


def block_series(water: Waterfall, some: Sequence[Spectrum], counted: Counts, frame: Frame) -> dict[str, Series]:
    """The waterfall (edges, and levels a bearing after the other), spectra and counts, as shown."""
    edges, level = _turned(water.bearing_edges_rad, water.level_db, frame)
    found: dict[str, Series] = {
        "waterfall": {
            "time_edge_s": water.time_edges_s.tolist(),
            "bearing_edge_rad": edges.tolist(),
            "level_db": np.round(level.T, 1).reshape(-1).tolist(),
        },
    }
    for number, one in enumerate(some):
        bearing = frame.shown(one.bearing_rad)
        order = np.argsort(bearing, kind="stable")
        found[f"spectrum/{number}"] = {
            "time_s": [one.time_s],
            "bearing_rad": bearing[order].tolist(),
            "beamformer_db": np.round(one.beamformer_db[order], 2).tolist(),
            "capon_db": np.round(one.capon_db[order], 2).tolist(),
            "music_db": np.round(one.music_db[order], 2).tolist(),
        }
    if len(counted.time_s):
        found["sources"] = {
            "time_s": counted.time_s.tolist(),
            "mdl": counted.mdl.astype(float).tolist(),
            "aic": counted.aic.astype(float).tolist(),
        }
    return found


def times(recording: Recording, tracked: Tracked) -> Floats:
    """Of each update of the tracks."""
    return np.asarray(np.interp(tracked.sample, np.arange(len(recording.time_s)), recording.time_s))


def _turned(edges: Floats, level: Floats, frame: Frame) -> tuple[Floats, Floats]:
    """Rows of even bearings (columns, rows) as shown: by the compass the circle begins elsewhere, and may run back."""
    if not frame.compass:
        return edges, level
    middles = frame.shown(0.5 * (edges[1:] + edges[:-1]))
    step = float(edges[1] - edges[0])
    order = np.argsort(middles)
    if abs(step * len(middles) - 2 * np.pi) < 1e-6:
        first = middles[order[0]] - step / 2
        return first + step * np.arange(len(edges)), level[:, order]
    # A sector that does not wrap stays in its place; one that does is shown past north.
    start = middles[0] if frame.sense > 0 else middles[-1]
    return start - step / 2 + step * np.arange(len(edges)), level if frame.sense > 0 else level[:, ::-1]


def _between(angle: Floats, place: Floats) -> Floats:
    """Angles at fractional places, on the shorter way between neighbours."""
    before = np.clip(np.floor(place).astype(np.intp), 0, len(angle) - 1)
    after = np.minimum(before + 1, len(angle) - 1)
    return np.asarray(angle[before] + (place - before) * wrapped(angle[after] - angle[before]))


def _kept(count: int) -> NDArray[np.intp]:
    if count <= MOST:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, MOST).astype(np.intp))


__all__ = ["block_series", "times", "track_series"]
