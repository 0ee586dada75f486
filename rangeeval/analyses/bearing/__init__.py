"""Bearing: several targets tracked from the snapshots of an array, with an honest error and what spoils it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rangeeval.analyses.bearing.blocks import counts, spectra, waterfall
from rangeeval.analyses.bearing.frame import Frame
from rangeeval.analyses.bearing.numbers import Writer, array_rows
from rangeeval.analyses.bearing.recording import Recording, gather_recording
from rangeeval.analyses.bearing.series import block_series, times, track_series
from rangeeval.analyses.bearing.tracking import COASTING, METHODS, PER_BLOCK, How, Tracked, follow
from rangeeval.analyses.bearing.truth import Judged, gather_truth, judge
from rangeeval.arrays.health import Ambiguity, check_geometry, mirrored
from rangeeval.arrays.options import flag_words
from rangeeval.errors import SettingsError, did_you_mean
from rangeeval.model import Bins, Estimate, Problem, Result, SensorArray, Trial, as_trial

ALL = (-math.inf, math.inf)
_LOOKED_AT = 2000  # snapshots in which a mirrored recording is looked for


def bearing(
    trial: Trial | Any,
    bins: Bins | None = None,
    *,
    confidence: float = 0.95,
    method: str = "joint-ml",
    targets: int | str | None = None,
    block: int | None = None,
    acceleration_rad_s2: float | None = None,
    lag_compensation: bool = False,
    coasting: str = "none",
    span_s: tuple[float, float] = ALL,
    array: SensorArray | None = None,
    progress: Callable[[int], None] | None = None,
) -> Result:
    """Bearings of several targets over time, with their errors, from the snapshots of one array.

    Whether targets that cross keep their names is never certain: where truth is there, it says held, swapped or lost;
    where it is not, the times at which targets could not be resolved are flagged.

    Parameters
    ----------
    trial : holds a `snapshots` log (CONTRACT section 3) and perhaps `truth` with bearings, or plain tables of them.
    bins : of time; with them there is a row `bearing` for each target in each bin.
    confidence : of the intervals.
    method : `joint-ml` maximum likelihood of all bearings at once; `ryu` (a line) and `modified` (any array) the source
        papers' subspace trackers; `music`, `root-music`, `esprit` blocks by themselves.
    targets : how many; `auto`: what MDL finds in the first blocks; None: the trial's own number, else as `auto`.
    block : snapshots a step (`joint-ml`), or a block.
    acceleration_rad_s2 : sigma of the acceleration of a bearing that the filter is to expect.
    lag_compensation, coasting : of `ryu` and `modified`; coasting `none`, `hard` or `soft`.
    span_s : first and last time that is used.
    array : what is known of the array, over what the log and the trial's settings say of it.
    progress : called with the number of snapshots read.

    Raises
    ------
    InputError : no snapshots log, nothing known of its array, or too few sensors for the targets.
    SettingsError : an impossible argument.

    References
    ----------
    Ryu et al. (2002) and its extension to cylindrical arrays, as corrected in docs/explanation/bearing.md.
    """
    how = _checked(method, targets, block, acceleration_rad_s2, lag_compensation, coasting, confidence)
    found = _look(_with(as_trial(trial), array), how, span_s, confidence, progress)
    rows: list[Estimate] = []
    water, counted = waterfall(found.recording), counts(found.recording)
    series: dict[str, Any] = {}
    if found.tracked is not None:
        writer = found.writer
        if found.judged is not None:
            rows += writer.judged(found.judged)
        rows += writer.whole(counted, found.ambiguity)
        rows += writer.tracks()
        bins = bins or Bins.of(found.trial.settings.bins)
        if bins.variable == "time":
            rows += writer.over_time(bins)
        series |= track_series(found.recording, found.tracked, found.names, found.frame, writer.z, found.judged)
    else:
        rows += array_rows(found.recording, counted, found.ambiguity, (*found.flags, "none-found"))
    known = found.tracked.targets if found.tracked else 0
    series |= block_series(water, spectra(found.recording, known), counted, found.frame)
    return Result(
        "bearing", tuple(rows), settings=_settings(found, how, confidence), problems=found.problems, series=series
    )


def bearing_tracks(
    trial: Trial | Any,
    *,
    confidence: float = 0.95,
    span_s: tuple[float, float] = ALL,
    array: SensorArray | None = None,
    progress: Callable[[int], None] | None = None,
    **how: Any,
) -> tuple[Any, tuple[Problem, ...]]:
    """Every update of every target as a DataFrame, with the problems met; arguments as those of `bearing`.

    Columns: `time_s`, `target_id`, `bearing_deg` and `sigma_deg`, `rate_deg_s`, `power_db` over the noise of a sensor,
    `flags`; `compass_deg` too where bearings are shown by the compass.
    """
    import pandas as pd

    options = {
        "method": "joint-ml", "targets": None, "block": None, "acceleration_rad_s2": None,
        "lag_compensation": False, "coasting": "none",
    }  # fmt: skip
    found = _look(
        _with(as_trial(trial), array), _checked(**(options | how), confidence=confidence), span_s, confidence, progress
    )
    tracked, frame = found.tracked, found.frame
    columns: dict[str, list[Any]] = {}
    if tracked is not None:
        count = len(tracked.sample)
        with np.errstate(divide="ignore", invalid="ignore"):
            power = 10 * np.log10(tracked.power / tracked.noise[:, None])
        flat = {
            "time_s": np.repeat(times(found.recording, tracked), tracked.targets),
            "target_id": np.array(found.names * count),
            "bearing_deg": np.rad2deg(tracked.bearing_rad).reshape(-1),
            "sigma_deg": np.rad2deg(tracked.sigma_rad).reshape(-1),
            "rate_deg_s": np.rad2deg(tracked.rate_rad / found.recording.interval_s).reshape(-1),
            "power_db": power.reshape(-1),
        }
        if frame.compass:
            flat["compass_deg"] = np.rad2deg(frame.shown(tracked.bearing_rad)).reshape(-1)
        columns = {name: values.tolist() for name, values in flat.items()}
        columns["flags"] = [flag_words(int(bits)) for bits in tracked.bits.reshape(-1)]
    return pd.DataFrame(columns), found.problems


def _checked(
    method: str, targets: int | str | None, block: int | None, acceleration_rad_s2: float | None,
    lag_compensation: bool, coasting: str, confidence: float,
) -> How:  # fmt: skip
    for value, known, word in ((method, METHODS, "method"), (coasting, COASTING, "coasting")):
        if value not in known:
            raise SettingsError(f"{word} '{value}' is not known; {did_you_mean(value, known)}")
    if not 0.0 < confidence < 1.0:
        raise SettingsError(f"confidence is {confidence:g}, expected more than 0 and less than 1")
    counted = targets == "auto"
    wanted = None if counted else targets
    for name, number in (("targets", wanted), ("block", block)):
        if isinstance(number, str) or (number is not None and number < 1):
            raise SettingsError(f"{name} is {number}, expected 1 or more")
    assert not isinstance(wanted, str)
    if acceleration_rad_s2 is not None and not acceleration_rad_s2 >= 0:
        raise SettingsError(f"acceleration_rad_s2 is {acceleration_rad_s2:g}, expected 0 or more")
    if method not in ("ryu", "modified") and (lag_compensation or coasting != "none"):
        raise SettingsError(f"lag_compensation and coasting belong to the methods ryu and modified, not to {method}")
    return How(method, wanted, counted, block, acceleration_rad_s2, lag_compensation, coasting)


def _with(trial: Trial, array: SensorArray | None) -> Trial:
    if array is None:
        return trial
    return replace(trial, settings=replace(trial.settings, array=array.over(trial.settings.array)))


@dataclass(frozen=True)
class _Found:
    """All that was read and tracked, before it is put into rows."""

    trial: Trial
    recording: Recording
    tracked: Tracked | None
    judged: Judged | None
    names: tuple[str, ...]
    frame: Frame
    ambiguity: Ambiguity
    flags: tuple[str, ...]
    problems: tuple[Problem, ...]
    confidence: float

    @property
    def writer(self) -> Writer:
        """What makes rows of it."""
        assert self.tracked is not None
        return Writer(self.recording, self.tracked, self.names, self.frame, self.confidence, self.flags)


def _look(
    trial: Trial, how: How, span: tuple[float, float], confidence: float, progress: Callable[[int], None] | None
) -> _Found:
    recording = gather_recording(trial, span, progress)
    ambiguity = check_geometry(recording.geometry)
    tracked = follow(recording, how)
    truth = gather_truth(trial, recording)
    judged = judge(recording, tracked, truth) if tracked is not None and truth is not None else None
    problems = [*recording.problems, *(truth.problems if truth else ())]
    flags = recording.flags
    if ambiguity.aliased:
        flags += ("aliased",)
        problems.append(Problem(
            recording.where,
            f"sensors stand up to {ambiguity.half_wavelengths:.2g} half wavelengths apart: two bearings look the same "
            f"({ambiguity.level_db:.1f} dB); sector_deg in [array] says where sources can be",
        ))  # fmt: skip
    known = tracked.targets if tracked is not None else 1
    some = recording.snapshots[recording.usable][:_LOOKED_AT]
    if ambiguity.tells_mirror and len(some) > recording.geometry.sensors and mirrored(recording.geometry, some, known):
        flags += ("mirrored",)
        problems.append(Problem(
            recording.where,
            "the samples fit the array better with the other sign of phase, so these bearings are mirrored; "
            "conjugate in [array] of trial.toml is the other way round",
        ))  # fmt: skip
    if tracked is not None and not math.isnan(tracked.guard_threshold):
        alarms = int(np.count_nonzero(tracked.guard > tracked.guard_threshold))
        if alarms:
            problems.append(Problem(
                recording.where,
                f"a source that is not modelled: {alarms} of {len(tracked.guard)} updates alarm; more targets?",
            ))  # fmt: skip
            flags += ("unmodelled-source",)
    if tracked is None:
        problems.append(Problem(recording.where, "no source stands out of the noise; --targets gives their number"))
    names = judged.names if judged else tuple(str(n + 1) for n in range(tracked.targets if tracked else 0))
    return _Found(
        trial,
        recording,
        tracked,
        judged,
        names,
        Frame.of(recording.array),
        ambiguity,
        flags,
        tuple(problems),
        confidence,
    )


def _settings(found: _Found, how: How, confidence: float) -> dict[str, Any]:
    recording, tracked = found.recording, found.tracked
    array = recording.array
    used = tracked.how if tracked else replace(how, targets=0)
    return {
        "method": how.method,
        "targets": used.targets,
        "targets_given": not how.counted and bool(how.targets or array.targets or array.start_bearing_deg),
        "block": used.block,
        "lag_compensation": how.lag_compensation,
        "coasting": how.coasting,
        "process_variance": tracked.process_variance if tracked else math.nan,
        "confidence": confidence,
        "bearings": array.bearings,
        "sensors": len(recording.sensors),
        "linear": recording.geometry.linear,
        "frequency_hz": recording.geometry.frequency_hz.tolist(),
        "propagation_speed_m_s": recording.geometry.propagation_speed_m_s,
        "snapshots": len(recording.snapshots),
        "interval_s": recording.interval_s,
        "bins": recording.bins,
        "time_zero": array.time_zero,
        "first_time_s": float(recording.time_s[0]),
        "last_time_s": float(recording.time_s[-1]),
        "ambiguity_db": found.ambiguity.level_db,
        "tells_mirror": found.ambiguity.tells_mirror,
        "guard_threshold": tracked.guard_threshold if tracked else math.nan,
        "outcome": found.judged.outcome if found.judged else None,
        "flags": list(found.flags),
    }


__all__ = ["COASTING", "METHODS", "PER_BLOCK", "bearing", "bearing_tracks"]
