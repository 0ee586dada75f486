"""The rows of replay that need truth: errors by axis, NEES, set distances, and who followed whom."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.replay.gathering import Gathered
from rangeeval.analyses.replay.numbers import Place
from rangeeval.analyses.replay.pooled import Updates
from rangeeval.model import Bins, Estimate
from rangeeval.model.paths import TruePath, partner
from rangeeval.model.settings import ReplaySettings
from rangeeval.physics.polar import polar
from rangeeval.stats.consistency import average_bounds, normalised_squares
from rangeeval.stats.mean_square import Interval, mean, rms
from rangeeval.stats.proportions import wilson_interval
from rangeeval.stats.track_quality import (
    NOBODY,
    Association,
    Counts,
    assign,
    continuity,
    count,
    distances,
    gospa,
    ospa,
    purity,
)
from rangeeval.tracking.runs import Flag, Run

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

AXES = (("x", "east"), ("y", "north"), ("z", "up"))
SCANS = 2000  # times at most at which sets of tracks and truths are compared
PAIRS = 2_000_000  # of a track and a truth at one time, at most
ORDER = 2.0  # of OSPA and GOSPA
FLOOR_SHARE = 0.1  # of the OSPA cutoff: the truth's own error, and the filter's when it has no covariance


@dataclass(frozen=True)
class Compared:
    """State less truth of every row (n, 6), ENU; NaN where the row's track has no truth then."""

    error: Floats
    raw: Floats
    true: Floats


def true_states(path: TruePath, time_s: Floats, planar: bool) -> Floats:
    """Position and velocity (n, 6), ENU, of the truth; of a planar track its slant plane."""
    position, velocity = path.at(time_s)
    if planar:
        place = polar(position)
        distance, azimuth = place[:, 0], place[:, 1]
        with np.errstate(invalid="ignore", divide="ignore"):
            rate = np.sum(position * velocity, axis=1) / distance
            turn = (position[:, 0] * velocity[:, 2] - position[:, 2] * velocity[:, 0]) / (
                position[:, 0] ** 2 + position[:, 2] ** 2
            )
        east, north = distance * np.sin(azimuth), distance * np.cos(azimuth)
        zero = np.where(np.isfinite(east), 0.0, np.nan)
        return np.stack(
            [east, north, zero, rate * np.sin(azimuth) + turn * north, rate * np.cos(azimuth) - turn * east, zero], -1
        )
    return np.concatenate([position[:, [2, 0, 1]], velocity[:, [2, 0, 1]]], axis=1)


def compare(gathered: Gathered, runs: Sequence[Run], paths: Mapping[str, TruePath], own: ReplaySettings) -> Compared:
    """Each row's state less the truth of its own target; without a name in common, of the truth its track is on."""
    names = list(paths)
    errors, raw, true = [], [], []
    for track, run in zip(gathered.tracks, runs, strict=True):
        time = run.measurements.time_s
        name = partner(track.name, paths) if gathered.method == "id" else None
        if name is not None:
            states = true_states(paths[name], time, run.planar)
        else:
            candidates = [true_states(paths[n], time, run.planar) for n in names]
            apart = np.stack([_sigmas(run.state, run.covariance, c, own, run.planar) for c in candidates], axis=1)
            on = assign(np.zeros(len(time), int), apart)
            states = np.full((len(time), 6), np.nan)
            for j, c in enumerate(candidates):
                states[on == j] = c[on == j]
        true.append(states)
        errors.append(run.state - states)
        raw.append(_cartesian(run) - states[:, :3])
    none = np.empty((0, 6))
    return Compared(
        np.concatenate(errors) if errors else none,
        np.concatenate(raw) if raw else none[:, :3],
        np.concatenate(true) if true else none,
    )


def _cartesian(run: Run) -> Floats:
    distance, azimuth, elevation = run.measurements.z.T
    elevation = np.zeros_like(distance) if run.planar else elevation
    across = distance * np.cos(elevation)
    return np.stack([across * np.cos(azimuth), across * np.sin(azimuth), distance * np.sin(elevation)], -1)


def _sigmas(state: Floats, covariance: Floats, true: Floats, own: ReplaySettings, planar: bool) -> Floats:
    """Mahalanobis distance of positions to the truth, with a floor for the truth's own error."""
    d = 2 if planar else 3
    away = state[:, :d] - true[:, :d]
    s = np.nan_to_num(covariance[:, :d, :d]) + np.eye(d) * (FLOOR_SHARE * own.ospa_cutoff_m) ** 2
    known = np.isfinite(away.sum(axis=1))
    solved = np.linalg.solve(s, np.where(known[:, None], away, 0.0)[..., None])[..., 0]
    return np.where(known, np.sqrt(np.maximum(np.sum(away * solved, axis=1), 0.0)), np.nan)


def error_rows(u: Updates, found: Compared, place: Place, confidence: float, flags: Sequence[str]) -> list[Estimate]:
    """Root mean square by axis, of position, velocity and prediction, and the NEES, of the rows of a place."""
    # Plots that the filter did not use count: leaving them out would flatter a filter that loses its target.
    used = place.rows & u.tracked & np.isfinite(found.error[:, 0])
    if not used.any():
        return []
    mark = u.track[used]
    planar = not np.isfinite(u.elevation_rad[place.rows]).any()
    rows = []
    for k, (axis, direction) in enumerate(AXES):
        if planar and axis == "z":
            continue
        rows.append(place.row(f"{axis}_rms", "m", rms(found.error[used, k], confidence, mark), flags, axis=direction))
    lengths = {
        "position_rms": ("m", found.error[used, :3]), "velocity_rms": ("m_s", found.error[used, 3:]),
        "prediction_rms": ("m", (u.predicted_state[used] - found.true[used])[:, :3]),
        "plot_rms": ("m", found.raw[used]),
    }  # fmt: skip
    for name, (unit, e) in lengths.items():
        rows.append(place.row(name, unit, rms(np.linalg.norm(e, axis=1), confidence, mark), flags))
    keep = [0, 1, 3, 4] if planar else [0, 1, 2, 3, 4, 5]
    nees = normalised_squares(found.error[used][:, keep], u.covariance[used][:, keep][:, :, keep])
    n = int(np.count_nonzero(np.isfinite(nees)))
    if n:
        value, dof = mean(nees, confidence, mark).from_zero(), len(keep)
        low, high = (dof * float(v) for v in average_bounds(dof, n, confidence))
        verdict = ["optimistic"] if value.value > high else ["pessimistic"] if value.value < low else []
        more = {"expected": float(dof), "accept_low": low, "accept_high": high}
        rows.append(place.row("nees_mean", "1", value, [*flags, *verdict], **more))
    return rows


# --- sets of tracks against sets of truths ---------------------------------------------------------------------------


@dataclass(frozen=True)
class Scene:
    """Every track and every truth at common times (steps): positions NaN where there is none."""

    time_s: Floats
    tracks: Floats
    covariance: Floats
    truths: Floats


def scene(gathered: Gathered, runs: Sequence[Run], paths: Mapping[str, TruePath]) -> Scene:
    """The scene at one time a revisit; a track counts from its first update to its last, moved on at its velocity."""
    planar = all(r.planar for r in runs)
    time = [run.measurements.time_s for run in runs]
    step = max(gathered.interval_s, 1e-3)
    first, last = min(float(t[0]) for t in time), max(float(t[-1]) for t in time)
    at_once = sum(float(t[-1] - t[0]) for t in time) / max(last - first, step)  # tracks at a time, on average
    room = min(SCANS, int(PAIRS / (max(at_once, 1.0) * max(len(paths), 1))), int(PAIRS / len(runs)))
    count_ = max(min(int((last - first) / step) + 1, room), 2)
    at = np.linspace(first, last, count_)
    tracks = np.full((count_, len(runs), 3), np.nan)
    covariance = np.full((count_, len(runs), 3, 3), np.nan)
    for i, run in enumerate(runs):
        alive = np.flatnonzero((run.flags & int(Flag.STARTING | Flag.DISORDERED)) == 0)
        alive = alive[np.isfinite(run.state[alive, 0])]
        if not alive.size:
            continue
        t = run.measurements.time_s[alive]
        k = np.searchsorted(t, at + 1e-9, side="right") - 1
        there = (k >= 0) & (at <= t[-1] + 0.5 * step)
        there &= at - t[np.maximum(k, 0)] <= run.filter.restart_gap_s  # longer, and the track was given up meanwhile
        rows, dt = alive[k[there]], at[there] - t[k[there]]
        there_rows = np.flatnonzero(there)
        tracks[there_rows, i] = run.state[rows, :3] + run.state[rows, 3:] * dt[:, None]
        p, w = run.covariance[rows], dt[:, None, None]
        cross = p[:, :3, 3:]
        covariance[there_rows, i] = p[:, :3, :3] + w * (cross + np.swapaxes(cross, 1, 2)) + w**2 * p[:, 3:, 3:]
    truths = np.stack([true_states(path, at, planar)[:, :3] for path in paths.values()], axis=1)
    return Scene(at, tracks, covariance, truths)


def set_rows(s: Scene, names: Sequence[str], bins: Bins, own: ReplaySettings, confidence: float) -> list[Estimate]:
    """OSPA and GOSPA over time, completeness, ambiguity and spuriousness per bin, continuity of each target."""
    cutoff = own.ospa_cutoff_m
    o, g = [], []
    for tracks, truths in zip(s.tracks, s.truths, strict=True):
        apart = distances(tracks, truths)
        o.append(ospa(apart, cutoff, ORDER))
        g.append(gospa(apart, cutoff, ORDER))
    whole = Place(np.ones(0, bool))
    rows = [
        whole.row(name, unit, mean(values, confidence).from_zero())
        for name, unit, values in (
            ("ospa", "m", [v.total for v in o]),
            ("ospa_localisation", "m", [v.localisation for v in o]),
            ("ospa_cardinality", "m", [v.cardinality for v in o]),
            ("gospa", "m", [v.distance for v in g]),
            ("gospa_localisation", "m^2", [v.localisation for v in g]),
            ("gospa_missed", "m^2", [v.missed for v in g]),
            ("gospa_false", "m^2", [v.false for v in g]),
        )
    ]
    association = associate(s, own)
    rows += _quality_rows(s, association, bins, confidence)
    for name, c in zip(names, continuity(association, s.time_s), strict=True):
        of = Place(np.ones(0, bool), track=name or "T001")
        steps = int(np.count_nonzero(association.present[:, names.index(name)]))
        for quantity, unit, value in (
            ("track_breaks", "1", float(c.breaks)), ("identity_changes", "1", float(c.identity_changes)),
            ("track_latency", "s", c.latency_s),
        ):  # fmt: skip
            flags = [] if math.isfinite(value) else ["never-held"]
            rows.append(of.row(quantity, unit, Interval(value, value, value, steps, float(steps)), flags))
    pure = list(purity(association).values())
    if pure:
        rows.append(whole.row("track_purity", "1", mean(np.array(pure), confidence)))
    return rows


def associate(s: Scene, own: ReplaySettings) -> Association:
    """Which truth every track is on at every time, by Mahalanobis distance with hysteresis."""
    steps, count_ = np.nonzero(np.isfinite(s.tracks[:, :, 0]))
    position, cov = s.tracks[steps, count_], s.covariance[steps, count_]
    d = 2 if not np.any(np.nan_to_num(s.truths[..., 2])) else 3
    state = np.concatenate([position, np.zeros_like(position)], axis=1)
    padded = np.zeros((len(steps), 6, 6))
    padded[:, :3, :3] = cov
    apart = [_sigmas(state, padded, s.truths[steps, j], own, d == 2) for j in range(s.truths.shape[1])]
    distance = np.stack(apart, axis=1) if apart else np.empty((len(steps), 0))
    order = np.lexsort((steps, count_))
    truth = np.full(len(steps), NOBODY, np.int64)
    truth[order] = assign(count_[order], distance[order])
    return Association(steps[order], count_[order], truth[order], np.isfinite(s.truths[..., 0]))


def _quality_rows(s: Scene, a: Association, bins: Bins, confidence: float) -> list[Estimate]:
    rows = _ratios(Place(np.ones(0, bool)), sum(count(a).values(), Counts()), confidence)
    if bins.variable != "range":
        return rows
    with np.errstate(invalid="ignore"):
        truth_bin = bins.index(np.linalg.norm(s.truths, axis=-1))
        track_bin = bins.index(np.linalg.norm(s.tracks[a.step, a.track], axis=-1))
    for b, counts in count(a, truth_bin, track_bin).items():
        rows += _ratios(Place(np.ones(0, bool), "range", *bins.edges(b)), counts, confidence)
    return rows


def _ratios(place: Place, c: Counts, confidence: float) -> list[Estimate]:
    found = []
    for name, value, k, n in (
        ("track_completeness", c.completeness, c.held, c.present),
        ("track_spuriousness", c.spuriousness, c.tracks - c.assigned, c.tracks),
    ):
        low, high = wilson_interval(k, n, confidence)
        if n:
            found.append(place.row(name, "1", Interval(value, float(low), float(high), n, float(n)), ["correlated"]))
    if c.held:
        found.append(
            place.row("track_ambiguity", "1", Interval(c.ambiguity, math.nan, math.nan, c.held, float(c.held)))
        )
    return found
