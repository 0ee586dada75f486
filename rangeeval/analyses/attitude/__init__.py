"""Attitude: how the radar rocked, how well each method knows it, and what that does to azimuth and elevation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from rangeeval.analyses.attitude.correction import CorrectedPlots, correct_plots
from rangeeval.analyses.attitude.gathering import gather_tilt
from rangeeval.analyses.attitude.motion import Motion, motion_of
from rangeeval.analyses.attitude.numbers import motion_estimates
from rangeeval.analyses.attitude.pointing import pointing_estimates, pointing_of
from rangeeval.analyses.attitude.series import motion_series, pointing_series
from rangeeval.analyses.attitude.setup import AXES, set_up
from rangeeval.analyses.attitude.targets import target_path
from rangeeval.errors import SettingsError
from rangeeval.model import Bins, Estimate, Problem, Result, Trial, as_trial, gather
from rangeeval.model.result import Series

__all__ = ["CorrectedPlots", "attitude", "correct_plots"]


def attitude(
    trial: Trial | Any,
    bins: Bins | None = None,
    *,
    confidence: float = 0.95,
    progress: Callable[[int], None] | None = None,
) -> Result:
    """Tilt, oscillation and attitude error by three methods, and the pointing error they cause per bin.

    The methods: `none` (the radar takes its assumed attitude for true), `single` (one accelerometer, which takes its
    own acceleration for tilt), `pair` (accelerometers at two or more radii taken to the rotation centre). The pair's
    attitude stands for the truth; what it cannot see (sway of the centre, bias, wrong radii) is in the budget.

    Parameters
    ----------
    trial : holds one or more `tilt` logs; for errors per bin also a truth, plots or residual log. Plain tables do.
    bins : of the target's path; by default those of the trial's settings.
    confidence : of the two-sided intervals.
    progress : called with the number of rows read since the last call.

    Raises
    ------
    InputError : no tilt log, nothing usable in it, equal radii, clocks without a common time, a wrong unit.

    References
    ----------
    Kim (2011), eqs 1-20, as corrected in docs/explanation/attitude.md.
    """
    trial = as_trial(trial)
    bins = bins or Bins.of(trial.settings.bins)
    if not 0.0 < confidence < 1.0:
        raise SettingsError(f"confidence is {confidence:g}, expected more than 0 and less than 1")
    setup = set_up(trial)
    path = target_path(trial)
    times = path.time_s if path is not None else np.empty(0)
    gathered = gather_tilt(setup, np.where(np.isfinite(times), times, -np.inf), progress)
    motions: dict[str, Motion] = {}
    for axis in ("z", "x"):
        motion = motion_of(axis, setup, gathered, motions["z"].alpha if "z" in motions and axis == "x" else None)
        if motion is not None:
            motions[axis] = motion
    rows: list[Estimate] = []
    series: dict[str, Series] = {}
    for axis in AXES:
        if axis in motions:
            rows += motion_estimates(motions[axis], setup, gathered.usable[setup.of_axis(axis)[0]], confidence)
            series |= motion_series(motions[axis], setup, gathered)
    problems = list(gathered.problems)
    for axis, motion in motions.items():
        if "clocks-differ" in motion.flags:
            problems.append(Problem(
                setup.source,
                f"{motion.sensors[-1]} is {motion.skew.value * 1e3:.3g} ms late against {motion.sensors[0]} "
                f"({axis} rotation): "
                f"their clocks differ, or the body bends",
            ))  # fmt: skip
    if path is not None:
        found = pointing_of(trial, setup, gathered, motions, path, bins)
        rows += pointing_estimates(found, bins, confidence)
        series |= pointing_series(found)
        problems += path.problems
        without = int(np.count_nonzero(~np.isfinite(found.attitudes.of["single"][0] + found.attitudes.of["single"][1])))
        if without:
            text = "no attitude at these times (gap, or outside the tilt log): left out of the bins"
            if without == path.time_s.size:
                first, last = gathered.span_s
                text = f"none of its times falls on an attitude ({first:.6g} to {last:.6g} s): are both on one clock?"
            problems.append(Problem(path.source, text, without))
    return Result(
        "attitude",
        tuple(rows),
        settings={
            "confidence": confidence,
            "gravity": setup.gravity,
            "gravity_from": setup.gravity_from,
            "single_sensor": setup.single,
            "radii": {
                f"{m.sensors[i]}_{a}": r for a, m in motions.items() if m.radii for i, r in enumerate(m.radii.values)
            },
            "assumed_x_deg": setup.settings.assumed_x_deg,
            "assumed_z_deg": setup.settings.assumed_z_deg,
            "radius_sigma_m": setup.settings.radius_sigma_m,
            "bias_sigma_m_s2": setup.settings.bias_sigma_m_s2,
            "time_skew_s": setup.settings.time_skew_s,
            "sway_m": setup.settings.sway_m,
            "gravity_sigma_m_s2": setup.settings.gravity_sigma_m_s2,
            "path": path.kind if path else None,
            "path_source": path.source if path else None,
            "variable": bins.variable,
            "bin_width": bins.width,
            "bin_start": bins.start,
            "bin_ratio": bins.ratio,
            "min_samples": bins.min_samples,
            "sampling_interval": gathered.interval_s,
            "block": gathered.block,
            "counts": dict(gathered.counts),
        },
        problems=gather(problems),
        series=series,
    )
