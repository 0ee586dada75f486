"""Where the target was and when: from a truth, plots or residual log, in that order of trust."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rangeeval.model import Log, Problem, Trial
from rangeeval.model.paths import positions
from rangeeval.physics.frames import beam_to_cartesian, face_matrix, turn_back
from rangeeval.physics.pointing import azimuth_elevation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Path:
    """Directions of the target (rad, from the site) with times and ranges, and the kind of log they come from."""

    time_s: Array
    range_m: Array
    azimuth: Array
    elevation: Array
    kind: str
    source: str
    problems: tuple[Problem, ...] = ()


def target_path(trial: Trial) -> Path | None:
    """The target's path from the best log that gives one; None when the trial holds none."""
    for kind, read in (("truth", _truth), ("plots", _plots), ("residuals", _residuals)):
        for log in trial.of_kind(kind)[:1]:
            path = read(trial, log)
            if path is not None and np.isfinite(path.elevation).any():
                return path
    return None


def _made(position: Array, time: Array, kind: str, log: Log, problems: tuple[Problem, ...]) -> Path:
    az, el = azimuth_elevation(position)
    return Path(time, np.linalg.norm(position, axis=-1), np.mod(az, 2 * np.pi), el, kind, log.source, problems)


def _truth(trial: Trial, log: Log) -> Path | None:
    table = log.read()
    position = positions(log, table, trial.settings.site)
    if position is None:
        return None
    return _made(position, table.floats("time_s"), "truth", log, table.problems)


def _plots(trial: Trial, log: Log) -> Path | None:
    if "elevation_rad" not in log:
        return None
    table = log.read(["time_s", "range_m", "azimuth_rad", "elevation_rad"])
    return Path(
        table.floats("time_s"), table.floats("range_m"), np.mod(table.floats("azimuth_rad"), 2 * np.pi),
        table.floats("elevation_rad"), "plots", log.source, table.problems,
    )  # fmt: skip


def _residuals(trial: Trial, log: Log) -> Path | None:
    if not ("y_predicted_m" in log and "z_predicted_m" in log):
        return None
    table = log.read(["time_s", "range_predicted_m", "y_predicted_m", "z_predicted_m"])
    site = trial.settings.site
    face = beam_to_cartesian(*(table.floats(f"{n}_predicted_m") for n in ("range", "y", "z")))
    position = turn_back(face_matrix(math.radians(site.heading_deg), math.radians(site.tilt_deg)), face)
    return _made(position, table.floats("time_s"), "residuals", log, table.problems)
