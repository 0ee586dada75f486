"""A plots log with the attitude taken out of azimuth and elevation."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.attitude.gathering import gather_tilt
from rangeeval.analyses.attitude.motion import Motion, motion_of
from rangeeval.analyses.attitude.pointing import attitudes_at
from rangeeval.analyses.attitude.setup import set_up
from rangeeval.angles import wrapped
from rangeeval.errors import InputError
from rangeeval.model import Problem, Trial, as_trial, gather
from rangeeval.physics.pointing import corrected

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CorrectedPlots:
    """The plots' columns, corrected (missing where no attitude is had), in their order; `flags` says why."""

    columns: dict[str, list[float] | list[str]]
    corrected: int
    flagged: int
    problems: tuple[Problem, ...]

    def to_csv(self) -> str:
        """As text that reads back as a plots log; missing values are empty, numbers keep full precision."""
        rows = zip(*self.columns.values(), strict=True)
        lines = [",".join(self.columns), *(",".join(_text(v) for v in row) for row in rows)]
        return "\n".join(lines) + "\n"


def _text(value: float | str) -> str:
    if isinstance(value, str):
        quoted = any(c in value for c in ',"\n\r')
        return '"' + value.replace('"', '""') + '"' if quoted else value
    return "" if value != value else repr(value)


def correct_plots(trial: Trial | Any, *, progress: Callable[[int], None] | None = None) -> CorrectedPlots:
    """Azimuth and elevation of the trial's plots as they are with the attitude at each detection.

    The plots are taken to hold earth-fixed angles made with the attitude the radar assumed (`attitude.assumed_*_deg`,
    level by default). Where the attitude is not known (a gap, outside the tilt log), or an elevation is missing, the
    corrected angles are missing and the row is flagged; the measured angles stay beside them.

    Raises
    ------
    InputError : no plots log, no tilt log, or not one attitude at any plot.
    """
    trial = as_trial(trial)
    log = trial.log("plots")
    table = log.read()
    setup = set_up(trial)
    time = table.floats("time_s")
    gathered = gather_tilt(setup, np.where(np.isfinite(time), time, -np.inf), progress)
    motions: dict[str, Motion] = {}
    for axis in ("z", "x"):
        motion = motion_of(axis, setup, gathered, motions["z"].alpha if "z" in motions and axis == "x" else None)
        if motion is not None:
            motions[axis] = motion
    found = attitudes_at(setup, gathered, motions)
    method = "pair" if all(m.heights is not None for m in motions.values()) else "single"
    attitude, assumed = found.of[method], found.of["none"]
    if not np.isfinite(attitude[0] + attitude[1]).any():
        first, last = gathered.span_s
        raise InputError(
            f"no plot of {log.source} ({np.nanmin(time):.6g} to {np.nanmax(time):.6g} s) falls on an attitude of "
            f"{setup.source} ({first:.6g} to {last:.6g} s); are both on one clock?"
        )
    heading = math.radians(trial.settings.site.heading_deg)
    az, el = table.floats("azimuth_rad"), table.floats("elevation_rad")
    new_az, new_el = corrected(az, el, heading, assumed, attitude)
    known, whole = np.isfinite(attitude[0] + attitude[1]), np.isfinite(el) & np.isfinite(az)
    good = known & whole
    extra = [f for f in ("one-sensor", "no-radii", "one-axis", "calibrated", "saturated") if f in found.flags]
    words = [
        " ".join(
            [*(["no-attitude"] if not k else []), *(["no-elevation"] if not w else []), *(extra if k and w else [])]
        )
        for k, w in zip(known.tolist(), whole.tolist(), strict=True)
    ]
    columns: dict[str, list[float] | list[str]] = {}
    for name in log.columns:
        columns[name] = table.texts(name) if log.definition.column(name).text else table.floats(name).tolist()
    columns["azimuth_rad"] = np.where(good, new_az, np.nan).tolist()
    columns["elevation_rad"] = np.where(good, new_el, np.nan).tolist()
    columns |= {
        "measured_azimuth_rad": az.tolist(),
        "measured_elevation_rad": el.tolist(),
        "azimuth_correction_rad": np.where(good, wrapped(new_az - az), np.nan).tolist(),
        "elevation_correction_rad": np.where(good, new_el - el, np.nan).tolist(),
        "alpha_x_rad": attitude[0].tolist(),
        "alpha_z_rad": attitude[1].tolist(),
        "flags": words,
    }
    problems = [*table.problems, *gathered.problems]
    if lost := int(np.count_nonzero(~known)):
        problems.append(Problem(log.source, "no attitude at the time of the plot: not corrected, flagged", lost))
    if lost := int(np.count_nonzero(known & ~whole)):
        problems.append(Problem(log.source, "no azimuth or elevation: not corrected, flagged", lost))
    return CorrectedPlots(columns, int(good.sum()), int((~good).sum()), gather(problems))
