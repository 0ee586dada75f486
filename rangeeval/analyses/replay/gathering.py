"""The tracks to replay: plots by target or by association, and the measurement noise to give them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.replay.setup import METHODS
from rangeeval.errors import SettingsError, did_you_mean
from rangeeval.model import Problem, Trial
from rangeeval.model.plots import PlotLog, Plots, plots_of
from rangeeval.model.settings import ReplaySettings
from rangeeval.stats.local_noise import leave_one_out, noise_of
from rangeeval.stats.mean_square import Interval
from rangeeval.tracking.association import NO_TRACK, Grouping, Rules, group
from rangeeval.tracking.measurements import Measurements, azimuth_from_log, azimuth_to_log

Floats = NDArray[np.float64]

COORDINATES = ("range", "azimuth", "elevation")
ASSUMED = (30.0, 3e-3, 3e-3)  # where nothing says the noise: too few plots to show it
FIRST_GUESS = (50.0, 5e-3, 5e-3)  # for the gates of a first association, before the noise is known
LONG_GAP = 2.5  # usual intervals that a window of neighbours may pause


@dataclass(frozen=True)
class Noise:
    """The sigma of range (m), azimuth, elevation (rad), where each came from (`given`, `estimated`, `assumed`), and
    the estimates with their intervals.
    """

    sigma: tuple[float, float, float]
    origin: tuple[str, str, str]
    estimates: Mapping[str, Interval]


@dataclass(frozen=True)
class Track:
    """One track: its name, its plots, and what the filter is given of them."""

    name: str
    plots: Plots
    measurements: Measurements


@dataclass(frozen=True)
class Gathered:
    """All that replay works on."""

    tracks: tuple[Track, ...]
    log: PlotLog
    noise: Noise
    method: str
    interval_s: float
    counts: Mapping[str, int]
    problems: tuple[Problem, ...]


def gather_tracks(trial: Trial, method: str | None = None, progress: Callable[[int], None] | None = None) -> Gathered:
    """The trial's tracks in order of name, with their measurement noise.

    Raises InputError when the trial has no usable plots, SettingsError for an unknown association.
    """
    own = trial.settings.replay
    log = plots_of(trial, progress)
    method = method or own.association or ("id" if log.named else "global")
    if method not in METHODS:
        raise SettingsError(f"association '{method}' is not known; {did_you_mean(method, METHODS)}")
    problems = list(log.problems)
    if method == "id":
        targets = tuple(p for p in log.targets if p.target or not log.named)
        noise = noise_from(targets, own)
        tracks = tuple(_track(p.target, p, noise.sigma) for p in targets)
        stray = sum(len(p) for p in log.targets) - sum(len(p) for p in targets)
    else:
        tracks, noise, grouping, stray = _associated(log, method, trial)
        counts = f"tracks found: {grouping.tracks}, with a plot every {grouping.revisit_s:.4g} s"
        problems.append(Problem(log.source, f"plots were given to tracks by association ({method}): {counts}"))
    if stray:
        problems.append(Problem(log.source, "plots that belong to no track (clutter, or too few to start one)", stray))
    steps = np.concatenate([np.diff(t.plots.time_s) for t in tracks]) if tracks else np.empty(0)
    steps = steps[steps > 0]
    interval = float(np.median(steps)) if steps.size else 1.0
    counts_of = {**log.counts, "tracks": len(tracks), "without_track": stray}
    return Gathered(tracks, log, noise, method, interval, counts_of, tuple(problems))


def noise_from(targets: tuple[Plots, ...], own: ReplaySettings) -> Noise:
    """The noise the settings give; else what the plots' own scatter shows; else an assumption that is said."""
    given = (
        own.range_sigma_m,
        *(None if v is None else math.radians(v) for v in (own.azimuth_sigma_deg, own.elevation_sigma_deg)),
    )
    sigma, origin, estimates = [], [], {}
    residuals = [_scatter(p) for p in targets]
    for k, name in enumerate(COORDINATES):
        found = noise_of(np.concatenate([r[k] for r in residuals]) if residuals else np.empty(0))
        value = given[k]
        if value is not None:
            sigma.append(value)
            origin.append("given")
        elif math.isfinite(found.value) and found.value > 0:
            sigma.append(found.value)
            origin.append("estimated")
            estimates[name] = found
        else:
            sigma.append(ASSUMED[k])
            origin.append("assumed")
    return Noise((sigma[0], sigma[1], sigma[2]), (origin[0], origin[1], origin[2]), estimates)


def _scatter(plots: Plots) -> tuple[Floats, Floats, Floats]:
    """Leave-one-out residuals of range, azimuth and elevation."""
    step = np.diff(plots.time_s)
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 1.0
    t, gap = plots.time_s, LONG_GAP * usual
    azimuth = np.unwrap(plots.azimuth_rad)
    columns = (plots.range_m, azimuth, plots.elevation_rad)
    a, b, c = (leave_one_out(t, x, max_gap=gap) for x in columns)
    return a, b, c


def _track(name: str, plots: Plots, sigma: tuple[float, float, float]) -> Track:
    elevation = None if plots.planar else plots.elevation_rad
    measurements = Measurements.of_log(plots.time_s, plots.range_m, plots.azimuth_rad, elevation, sigma=sigma)
    return Track(name, plots, measurements)


def _associated(log: PlotLog, method: str, trial: Trial) -> tuple[tuple[Track, ...], Noise, Grouping, int]:
    """Tracks from all plots together: once with guessed noise for the gates, then with what those tracks show."""
    own = trial.settings.replay
    everything = _merged(log)
    rules = Rules(
        method="global" if method == "pda" else method,  # type: ignore[arg-type]
        max_speed_m_s=own.max_speed_m_s,
        revisit_s=trial.settings.radar.update_interval_s,
        detection_probability=own.detection_probability,
        clutter_per_m3=own.clutter_per_m3,
    )
    noise = noise_from((), own)
    guess = [s if o == "given" else f for s, o, f in zip(noise.sigma, noise.origin, FIRST_GUESS, strict=True)]
    z = np.stack([everything.range_m, azimuth_from_log(everything.azimuth_rad), everything.elevation_rad], -1)
    grouping = group(everything.time_s, z, guess, rules)
    found = tuple(everything.take(np.flatnonzero(grouping.track == k)) for k in range(grouping.tracks))
    noise = noise_from(found, own)
    from dataclasses import replace

    grouping = group(everything.time_s, z, noise.sigma, replace(rules, method=method, revisit_s=grouping.revisit_s))  # type: ignore[arg-type]
    tracks = []
    for k in range(grouping.tracks):
        name = f"T{k + 1:03d}"
        if grouping.shared:
            rows, polar, sigma = grouping.shared[k]
            plots = everything.take(rows, name)
            plots = Plots(
                name, plots.time_s, polar[:, 0], azimuth_to_log(polar[:, 1]), polar[:, 2], plots.snr_db, plots.source
            )
            tracks.append(Track(name, plots, Measurements.of(plots.time_s, polar, sigma)))
        else:
            tracks.append(_track(name, everything.take(np.flatnonzero(grouping.track == k), name), noise.sigma))
    return tuple(tracks), noise, grouping, int(np.count_nonzero(grouping.track == NO_TRACK))


def _merged(log: PlotLog) -> Plots:
    time, distance, azimuth, elevation, snr = (
        np.concatenate([getattr(p, name) for p in log.targets])
        for name in ("time_s", "range_m", "azimuth_rad", "elevation_rad", "snr_db")
    )
    return Plots("", time, distance, azimuth, elevation, snr, log.source).take(np.argsort(time, kind="stable"))
