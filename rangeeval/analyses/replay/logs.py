"""What replay writes: a residual log with gains that `accuracy` reads, and the smoothed reference trajectory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.replay.gathering import Track
from rangeeval.physics.frames import face_matrix, turn
from rangeeval.physics.polar import cartesian
from rangeeval.tracking.filters import AlphaBeta
from rangeeval.tracking.measurements import azimuth_to_log
from rangeeval.tracking.runs import Flag, Run, Smoothed

Floats = NDArray[np.float64]
Columns = Mapping[str, Floats | list[str]]

_AXES = ("range", "y", "z")


def residual_log(tracks: Sequence[Track], runs: Sequence[Run], face: tuple[float, float] | None) -> Columns:
    """The columns of a residual log with gains: one row an update, tracks one after the other.

    Axes are those of the array face: y up along it, z to the right. `face`: its heading and tilt (rad); missing, the
    antenna turns to each predicted direction. A plot outside the gate is a row without residuals and with zero gains.
    The modes' probabilities after the update and the NIS stand in further columns.
    """
    parts = [_of_track(t, r, face) for t, r in zip(tracks, runs, strict=True)]
    names = list(dict.fromkeys(n for p in parts for n in p))
    columns: dict[str, Floats | list[str]] = {}
    for name in names:
        pieces = [p[name] if name in p else np.full(len(p["time_s"]), np.nan) for p in parts]
        if name == "track_id":
            columns[name] = [text for piece in pieces for text in piece]
        else:
            columns[name] = np.concatenate(pieces) if pieces else np.empty(0)
    planar = "y_residual_m" in columns and not np.isfinite(np.asarray(columns["y_residual_m"], float)).any()
    dropped = {n for n in columns if planar and n in {"y_residual_m", "y_predicted_m", "alpha_y", "beta_y"}}
    empty = {n for n in columns if n == "snr_db" and not np.isfinite(np.asarray(columns[n], float)).any()}
    return {n: c for n, c in columns.items() if n not in dropped | empty}


def _of_track(track: Track, run: Run, face: tuple[float, float] | None) -> dict[str, Floats | list[str]]:
    rows = np.isfinite(run.predicted[:, 0]) & ((run.flags & int(Flag.MISSED | Flag.DISORDERED)) == 0)
    predicted = run.predicted[rows]
    distance, azimuth = predicted[:, 0], azimuth_to_log(predicted[:, 1])
    elevation = np.zeros(len(distance)) if run.planar else predicted[:, 2]
    innovation = run.innovation[rows]
    seen_up = np.isfinite(innovation[:, 2]) & (not run.planar)
    measured_up = np.where(seen_up, elevation + np.nan_to_num(innovation[:, 2]), elevation)
    # The filters' azimuth runs the other way round.
    measured = cartesian(1.0, azimuth - innovation[:, 1], measured_up)
    expected = cartesian(1.0, azimuth, elevation)
    heading, tilt = (azimuth, 0.0) if face is None else face
    matrix = face_matrix(heading, tilt)
    to, at = turn(matrix, measured), turn(matrix, expected)
    gated = (run.flags[rows] & int(Flag.GATED)) != 0
    columns: dict[str, Floats | list[str]] = {
        "time_s": run.measurements.time_s[rows],
        "track_id": [track.name or "T001"] * int(np.count_nonzero(rows)),
        "range_residual_m": np.where(gated, np.nan, innovation[:, 0]),
        "y_residual_m": np.where(gated | ~seen_up, np.nan, distance * (to[:, 1] - at[:, 1])),
        "z_residual_m": np.where(gated, np.nan, distance * (to[:, 2] - at[:, 2])),
        "range_predicted_m": distance,
        "y_predicted_m": distance * at[:, 1],
        "z_predicted_m": distance * at[:, 2],
        "snr_db": track.plots.snr_db[rows],
    }
    for k, axis in enumerate(_AXES):
        columns[f"alpha_{axis}"] = run.gains[rows, k, 0]
        columns[f"beta_{axis}"] = run.gains[rows, k, 1]
    columns["nis"] = np.where(gated, np.nan, run.nis[rows])
    if not isinstance(run.filter, AlphaBeta):
        for m in range(run.mode_probability.shape[1]):
            columns[f"mode_{m + 1}_probability"] = run.mode_probability[rows, m]
    return columns


def reference_log(tracks: Sequence[Track], smoothed: Sequence[Smoothed], planar: Sequence[bool]) -> Columns:
    """The smoothed trajectory as a truth log: position, velocity and the covariance of the position, in m.

    Planar tracks have no height: their `north_m`, `east_m` lie in the slant plane and `up_m` is 0.
    """
    names = ("north", "up", "east")
    at = (1, 2, 0)  # of the filters' east, north, up
    parts: dict[str, list[Floats]] = {}
    labels: list[str] = []
    for track, s, flat in zip(tracks, smoothed, planar, strict=True):
        rows = np.isfinite(s.state).all(axis=1)
        labels += [track.name or "T001"] * int(np.count_nonzero(rows))
        state, cov = s.state[rows], s.covariance[rows]
        own = {"time_s": track.measurements.time_s[rows]}
        for name, k in zip(names, at, strict=True):
            own[f"{name}_m"] = state[:, k] * (0.0 if flat and name == "up" else 1.0)
        for name, k in zip(names, at, strict=True):
            own[f"{name}_velocity_m_s"] = state[:, 3 + k] * (0.0 if flat and name == "up" else 1.0)
        for i in range(3):
            for j in range(i, 3):
                value = cov[:, at[i], at[j]]
                flat_part = flat and "up" in (names[i], names[j])
                own[f"covariance_{names[i]}_{names[j]}_m2"] = np.full(len(value), np.nan) if flat_part else value
        for name, column in own.items():
            parts.setdefault(name, []).append(column)
    columns: dict[str, Floats | list[str]] = {"time_s": np.concatenate(parts.pop("time_s")) if parts else np.empty(0)}
    columns["target_id"] = labels
    return columns | {n: np.concatenate(c) for n, c in parts.items()}


def as_csv(columns: Columns) -> str:
    """The columns as CSV text: full precision, missing values empty."""
    import pandas as pd

    return str(pd.DataFrame(dict(columns)).to_csv(index=False, lineterminator="\n"))
