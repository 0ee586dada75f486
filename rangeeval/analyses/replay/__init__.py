"""Replay: recorded plots through a tracking filter, judged by its innovations, and by truth where there is any."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.replay.against_truth import Compared, compare, error_rows, scene, set_rows
from rangeeval.analyses.replay.comparing import MAIN, paired_rows
from rangeeval.analyses.replay.gathering import COORDINATES, Gathered, gather_tracks
from rangeeval.analyses.replay.logs import Columns, as_csv, reference_log, residual_log
from rangeeval.analyses.replay.numbers import (
    Place,
    common_flags,
    innovation_rows,
    noise_rows,
    places,
)
from rangeeval.analyses.replay.pooled import Updates, pooled
from rangeeval.analyses.replay.series import series_of
from rangeeval.analyses.replay.setup import DEFAULT, described, filter_of, modes
from rangeeval.analyses.replay.tuning import Tuned, tuned_rows
from rangeeval.analyses.replay.tuning import tune as tune_filter
from rangeeval.errors import InputError, SettingsError
from rangeeval.model import Bins, Estimate, Problem, Result, Trial, as_trial, gather
from rangeeval.model.paths import TruePath, true_paths
from rangeeval.tracking.filters import AlphaBeta, AnyFilter
from rangeeval.tracking.runs import Flag, Run, run_many, smooth

Floats = NDArray[np.float64]

__all__ = ["Replayed", "replay", "replay_for_report", "run_replay"]

MOST_PLOTS = 2_000_000  # a kilobyte each while the filter's covariances are kept
COMPARED = 10_000  # plots up to which a report compares filters unasked: a second or so


@dataclass(frozen=True)
class Replayed:
    """A trial's plots run through one filter: the runs of all tracks, and what they can be written as."""

    trial: Trial
    name: str
    spec: AnyFilter
    gathered: Gathered
    runs: tuple[Run, ...]
    tuned: Tuned | None = None

    def residuals(self) -> Columns:
        """The residual log with gains, as columns; `rangeeval accuracy` reads it."""
        site, fixed = self.trial.settings.site, self.trial.settings.replay.face == "site"
        face = (math.radians(site.heading_deg), math.radians(site.tilt_deg)) if fixed else None
        return residual_log(self.gathered.tracks, self.runs, face)

    def residuals_csv(self) -> str:
        """The residual log as CSV text."""
        return as_csv(self.residuals())

    def reference(self) -> Columns:
        """The smoothed trajectory as a truth log, as columns. Raises SettingsError for alpha-beta: no covariances."""
        if isinstance(self.spec, AlphaBeta):
            raise SettingsError("an alpha-beta filter has no covariances to smooth with; use --filter kalman or imm")
        smoothed = [
            smooth(run) for run in run_many(self.spec, [t.measurements for t in self.gathered.tracks], detail=True)
        ]
        return reference_log(self.gathered.tracks, smoothed, [r.planar for r in self.runs])

    def reference_csv(self) -> str:
        """The smoothed trajectory as CSV text."""
        return as_csv(self.reference())


def run_replay(
    trial: Trial | Any,
    filter: str | None = None,
    *,
    association: str | None = None,
    tune: bool = False,
    confidence: float = 0.95,
    progress: Callable[[int], None] | None = None,
) -> Replayed:
    """Run the plots of a trial through a filter; see `replay` for the arguments."""
    trial = as_trial(trial)
    name = filter or trial.settings.replay.filter or DEFAULT
    gathered = gather_tracks(trial, association, progress)
    spec = filter_of(name, trial, gathered.interval_s)
    if gathered.counts["used"] > MOST_PLOTS:
        raise InputError(
            f"{gathered.log.source}: {gathered.counts['used']:,} plots are more than a replay holds in memory "
            f"({MOST_PLOTS:,}); give it the log in parts"
        )
    if not gathered.tracks:
        raise InputError(
            f"{gathered.log.source}: no track can be formed from {gathered.counts['used']} plots by "
            f"association ({gathered.method}); give target_id, or [replay] max_speed_m_s and update_interval_s"
        )
    tuned = None
    if tune:
        tuned = tune_filter(spec, gathered.tracks, gathered.noise.sigma, confidence)
        spec, gathered = tuned.spec, replace(gathered, noise=tuned.noise(gathered.noise))
    runs = run_many(spec, [t.measurements for t in gathered.tracks])
    return Replayed(trial, name, spec, gathered, tuple(runs), tuned)


def replay(
    trial: Trial | Any,
    bins: Bins | None = None,
    *,
    filter: str | None = None,
    compare: bool | Sequence[str] = False,
    association: str | None = None,
    tune: bool = False,
    confidence: float = 0.95,
    per_track: bool = False,
    progress: Callable[[int], None] | None = None,
    replayed: Replayed | None = None,
) -> Result:
    """How a tracking filter does on recorded plots: NIS, likelihood, whiteness of innovations; with truth, errors.

    Innovations judge the filter's assumptions, not its accuracy: a constant bias of the radar leaves no trace.

    Parameters
    ----------
    trial : holds a `plots` log, perhaps a `truth` log (CONTRACT section 3), or plain tables of them.
    bins : of range, azimuth, elevation, time or SNR; by default those of the trial's settings.
    filter : `alpha-beta`, `kalman`, `imm`, or another of `rangeeval.tracking.filters.FILTERS`; by default that of the
        trial's settings, else `imm`.
    compare : also run the other two (or those named), with paired differences.
    association : `id`, `nearest`, `global` or `pda`; by default by target_id where the log has it, else global.
    tune : first find the noise and manoeuvre parameters that make the plots likeliest (Kalman and IMM filters).
    confidence : of the two-sided intervals, and of the acceptance regions of NIS and NEES.
    per_track : also rows for each track in each bin.
    progress : called with the number of rows read.
    replayed : runs already made by `run_replay`.

    Raises
    ------
    InputError : no usable plots, or no track in them. SettingsError : an impossible argument.

    References
    ----------
    docs/explanation/imm.md.
    """
    trial = as_trial(trial)
    bins = bins or Bins.of(trial.settings.bins)
    if not 0.0 < confidence < 1.0:
        raise SettingsError(f"confidence is {confidence:g}, expected more than 0 and less than 1")
    done = replayed or run_replay(
        trial, filter, association=association, tune=tune, confidence=confidence, progress=progress
    )
    gathered, runs = done.gathered, done.runs
    u = pooled(gathered.tracks, runs)
    names = [t.name for t in gathered.tracks]
    rows = noise_rows(gathered) + (tuned_rows(done.tuned) if done.tuned else [])
    problems = [*gathered.problems, *_told(u, gathered)]
    paths, said = _paths(trial)
    problems += said
    against = compare_with(gathered, runs, paths, trial) if paths else None
    for place in places(u, bins, names, per_track=per_track):
        rows += _place_rows(u, place, bins, confidence, gathered, against)
    if against is not None and paths:
        rows += set_rows(scene(gathered, runs, paths), list(paths), bins, trial.settings.replay, confidence)
    if compare:
        chosen = [n for n in (MAIN if compare is True else compare) if n != done.name]
        rows += _compared(done, chosen, u, bins, confidence, paths, against)
    return Result(
        "replay",
        tuple(_ordered(rows)),
        settings={
            "confidence": confidence,
            "filter": done.name,
            **described(done.spec),
            "gate_probability": done.spec.gate_probability,
            "restart_after": done.spec.restart_after,
            "restart_gap_s": done.spec.restart_gap_s,
            "measurement_noise": dict(
                zip(("range_m", "azimuth_rad", "elevation_rad"), gathered.noise.sigma, strict=True)
            ),
            "measurement_noise_from": {c: gathered.noise.origin[k] for k, c in enumerate(_measured(gathered))},
            "tuned": done.tuned.as_settings() if done.tuned else None,
            "association": gathered.method,
            "usual_interval_s": gathered.interval_s,
            "axes": "x east, y north, z up",
            "modes": list(modes(done.spec)),
            "truth": bool(paths),
            "variable": bins.variable,
            "bin_width": bins.width,
            "bin_start": bins.start,
            "bin_ratio": bins.ratio,
            "min_samples": bins.min_samples,
            "counts": dict(gathered.counts),
        },
        problems=gather(problems),
        series=series_of(gathered, runs, _split(against.true, runs) if against is not None else None),
    )


def replay_for_report(
    trial: Trial,
    bins: Bins | None = None,
    *,
    confidence: float = 0.95,
    per_track: bool = False,
    progress: Callable[[int], None] | None = None,
) -> Result:
    """What a report shows of replay: the trial's filter, and for all but long logs the others beside it."""
    done = run_replay(trial, confidence=confidence, progress=progress)
    short = done.gathered.counts["used"] <= COMPARED
    return replay(trial, bins, compare=short, confidence=confidence, per_track=per_track, replayed=done)


def compare_with(
    gathered: Gathered, runs: Sequence[Run], paths: Mapping[str, TruePath], trial: Trial
) -> Compared | None:
    """Errors against the truth; None when no row has any."""
    found = compare(gathered, runs, paths, trial.settings.replay)
    return found if np.isfinite(found.error[:, 0]).any() else None


def _place_rows(
    u: Updates, place: Place, bins: Bins, confidence: float, gathered: Gathered, against: Compared | None
) -> list[Estimate]:
    rows = innovation_rows(u, place, bins, confidence, gathered.noise)
    if against is not None:
        n = int(np.count_nonzero(place.rows & u.used & np.isfinite(against.error[:, 0])))
        rows += error_rows(u, against, place, confidence, common_flags(u, place, bins, n, gathered.noise))
    return rows


def _paths(trial: Trial) -> tuple[dict[str, TruePath], tuple[Problem, ...]]:
    """The true paths, if any; a truth that cannot be used is a problem, not a failure of the replay."""
    if not trial.of_kind("truth"):
        return {}, ()
    try:
        return true_paths(trial, trial.settings.truth.max_gap_s)
    except InputError as error:
        return {}, (Problem(trial.of_kind("truth")[0].source, f"not used: {error}"),)


def _compared(
    done: Replayed, chosen: Sequence[str], u: Updates, bins: Bins, confidence: float, paths: Mapping[str, TruePath],
    against: Compared | None,
) -> list[Estimate]:  # fmt: skip
    """Every other filter's rows as a group of its name, and its paired differences to the chosen one."""
    gathered = done.gathered
    names = [t.name for t in gathered.tracks]
    rows: list[Estimate] = []
    others: dict[str, Updates] = {}
    errors = {done.name: against.error[:, :3]} if against is not None else {}
    for place in places(u, bins, names, per_track=False, group=done.name):
        rows += _place_rows(u, place, bins, confidence, gathered, against)
    for name in chosen:
        spec = filter_of(name, done.trial, gathered.interval_s)
        if done.tuned and not isinstance(spec, AlphaBeta):
            spec = tune_filter(spec, gathered.tracks, done.tuned.given, confidence).spec
        runs = run_many(spec, [t.measurements for t in gathered.tracks])
        other = others[name] = pooled(gathered.tracks, runs)
        found = compare_with(gathered, runs, paths, done.trial) if paths else None
        if found is not None:
            errors[name] = found.error[:, :3]
        for place in places(other, bins, names, per_track=False, group=name):
            rows += _place_rows(other, place, bins, confidence, gathered, found)
    return rows + paired_rows(done.name, others, u, errors, confidence)


def _told(u: Updates, gathered: Gathered) -> list[Problem]:
    """What happened to plots on the way through the filter."""
    said = []
    for flag, text in (
        (Flag.GATED, "plots outside the gate: not used, as if missed"),
        (Flag.RESTARTED, "restarts of a track, after a long gap or too many plots outside the gate in a row"),
        (Flag.DISORDERED, "plots earlier than the one before: not used"),
        (Flag.REPEATED, "plots with the time of the one before"),
        (Flag.OVERHEAD, "plots near the zenith: their azimuth was not used"),
        (Flag.BROKEN, "updates whose numbers broke down: the track starts anew there"),
        (Flag.ABSURD, "updates beyond any chance: the filter's assumptions do not fit there"),
    ):
        rows = np.flatnonzero(u.having(flag))
        if rows.size:
            names = [t.name or "T001" for t in gathered.tracks]
            examples = tuple(f"track {names[u.track[i]]} at {u.time_s[i]:.6g} s" for i in rows[:3].tolist())
            said.append(Problem(gathered.log.source, text, int(rows.size), examples))
    short = [t.name or "T001" for i, t in enumerate(gathered.tracks) if not (u.used & (u.track == i)).any()]
    if short:
        text = "tracks with too few plots for a single update: no estimate"
        said.append(Problem(gathered.log.source, text, 0, tuple(f"track {n}" for n in short[:3])))
    return said


def _measured(gathered: Gathered) -> tuple[str, ...]:
    """The coordinates that any plot has."""
    return COORDINATES[:2] if all(t.plots.planar for t in gathered.tracks) else COORDINATES


def _split(values: Floats, runs: Sequence[Run]) -> list[Floats]:
    edges = np.cumsum([len(r.measurements) for r in runs])[:-1]
    return list(np.split(values, edges))


def _ordered(rows: Sequence[Estimate]) -> list[Estimate]:
    """Rows by quantity, then bin (the whole trial first), pooled before groups before tracks."""
    place = {q: i for i, q in enumerate(dict.fromkeys(r.quantity for r in rows))}

    def key(r: Estimate) -> tuple[float, ...]:
        low = -math.inf if math.isnan(r.bin_low) else r.bin_low
        return (place[r.quantity], low, r.track_id is not None, r.group is not None)

    return sorted(rows, key=key)
