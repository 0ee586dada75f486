"""Tracks against surveyed bearings: which target each is of, errors near crossings and far from them, bounds beside."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from rangeeval.analyses.bearing.frame import Frame
from rangeeval.analyses.bearing.recording import Recording
from rangeeval.analyses.bearing.tracking import Tracked
from rangeeval.angles import wrapped
from rangeeval.arrays.assessment import outcome
from rangeeval.arrays.bounds import beam_width, posterior_crb
from rangeeval.arrays.options import JointOptions
from rangeeval.arrays.tracker import track
from rangeeval.errors import InputError
from rangeeval.model import Problem, Trial
from rangeeval.physics.geodesy import north_up_east

Floats = NDArray[np.float64]

MOST_BOUNDED = 5_000  # snapshots up to which the bound of a track is computed
LIMIT_RAD = math.radians(2.0)
TAIL = 0.05


@dataclass(frozen=True)
class Truth:
    """Bearings (K, N) of the array's frame at every snapshot, NaN outside what was surveyed; names in order."""

    names: tuple[str, ...]
    bearing_rad: Floats
    problems: tuple[Problem, ...] = ()


@dataclass(frozen=True)
class Judged:
    """Errors (K, N) of the tracks, NaN where there is no truth; in the order of the tracks.

    `order`: the truth of each track, by its start. `near`: another true bearing is within a beam width. `bound_rad`,
    `straight_bound_rad` (K, N): sigma of the best tracker with the filter's process noise, and with none.
    `outcome`: held, swapped or lost; `each`: of each track.
    """

    names: tuple[str, ...]
    truth_rad: Floats
    error_rad: Floats
    near: NDArray[np.bool_]
    beam_rad: float
    bound_rad: Floats
    straight_bound_rad: Floats
    outcome: str
    each: tuple[str, ...]


def gather_truth(trial: Trial, recording: Recording) -> Truth | None:
    """The surveyed bearings of a trial at the snapshots' times; None without a truth log."""
    if not trial.of_kind("truth"):
        return None
    log = trial.log("truth")
    table = log.read()
    frame = Frame.of(recording.array)
    if "bearing_rad" in table:
        bearing = table.floats("bearing_rad")
    elif "north_m" in table:
        bearing = frame.of_compass(np.arctan2(table.floats("east_m"), table.floats("north_m")))
    else:
        site = trial.settings.site
        if site.latitude_deg is None or site.longitude_deg is None:
            raise InputError(f"{log.source}: true positions in latitude and longitude need [site] in trial.toml")
        stood = (math.radians(site.latitude_deg), math.radians(site.longitude_deg), site.height_m)
        latitude, longitude = (np.deg2rad(table.floats(f"{name}_deg")) for name in ("latitude", "longitude"))
        north, _, east = north_up_east(latitude, longitude, table.floats("height_m"), stood).T
        bearing = frame.of_compass(np.arctan2(east, north))
    time, codes = table.floats("time_s"), table.codes("target_id")
    labels = table.labels.get("target_id", ("1",))
    used = np.isfinite(time) & np.isfinite(bearing)
    columns, names = [], []
    for code, name in enumerate(labels):
        mine = used & (codes == code)
        if np.count_nonzero(mine) < 2:
            continue
        order = np.argsort(time[mine], kind="stable")
        unwrapped = np.unwrap(bearing[mine][order])
        columns.append(np.interp(recording.time_s, time[mine][order], unwrapped, left=np.nan, right=np.nan))
        names.append(name)
    if not columns:
        return None
    found = _seen(recording, np.column_stack(columns))
    problems = table.problems
    if not np.isfinite(found).any():
        problems += (Problem(log.source, "no surveyed bearing falls in the time of the snapshots"),)
    return Truth(tuple(names), found, problems)


def _seen(recording: Recording, bearing: Floats) -> Floats:
    """True bearings as the array can tell them: those of a line are folded into its broadside half."""
    if recording.geometry.linear:
        return np.asarray(np.arcsin(np.clip(np.sin(bearing), -1, 1)))
    return wrapped(bearing)


def judge(recording: Recording, tracked: Tracked, truth: Truth) -> Judged | None:
    """The errors of the tracks; None where they and the truth have no time in common."""
    samples = np.arange(len(recording.time_s), dtype=np.float64)
    inside = (samples >= tracked.sample[0] - 0.5) & (samples <= tracked.sample[-1] + 0.5)
    if tracked.track is not None:
        inside[:] = True
    bearing = tracked.at(samples)
    bearing[~inside] = np.nan
    both = np.isfinite(truth.bearing_rad).any(axis=1) & np.isfinite(bearing).any(axis=1)
    if not both.any():
        return None
    place = _order(bearing[both], truth.bearing_rad[both])
    known = place >= 0
    true = np.where(known[None, :], truth.bearing_rad[:, np.maximum(place, 0)], np.nan)
    names = tuple(truth.names[p] if p >= 0 else f"extra {i + 1}" for i, p in enumerate(place.tolist()))
    beam = beam_width(recording.geometry)
    error = wrapped(bearing - true)
    bound, straight = _bounds(recording, tracked, true)
    last = np.flatnonzero(both)
    tail = last[int((1 - TAIL) * len(last)) :]
    each = tuple("extra" if place[n] < 0 else "held" if _within(error[tail, n]) else "lost" for n in range(len(names)))
    complete = bool(known.all()) and bool(np.isfinite(true[tail]).all()) and bool(np.isfinite(bearing[tail]).all())
    together = outcome(bearing[both], true[both], limit_rad=LIMIT_RAD, tail=TAIL) if complete else (
        "held" if set(each) == {"held"} else "lost"
    )  # fmt: skip
    if together == "swapped":
        each = tuple("swapped" if e == "lost" else e for e in each)
    return Judged(names, true, error, _near(truth.bearing_rad, place, beam), beam, bound, straight, together, each)


def _within(error: Floats) -> bool:
    error = error[np.isfinite(error)]
    return len(error) > 0 and bool((np.abs(error) <= LIMIT_RAD).all())


def _order(bearing: Floats, truth: Floats) -> NDArray[np.intp]:
    """The truth of each track by the first snapshots of both; -1 for a track beyond the number of truths."""
    first = max(1, round(TAIL * len(bearing)))
    apart = np.abs(wrapped(bearing[:first, :, None] - truth[:first, None, :]))
    there = np.isfinite(apart)
    cost = np.where(there, apart, 0.0).sum(axis=0) / np.maximum(there.sum(axis=0), 1)
    cost = np.where(there.any(axis=0), cost, math.pi)
    rows, columns = linear_sum_assignment(cost)
    place = np.full(bearing.shape[1], -1, np.intp)
    place[rows] = columns
    return place


def _near(truth: Floats, place: NDArray[np.intp], beam: float) -> NDArray[np.bool_]:
    near = np.zeros((len(truth), len(place)), bool)
    for n, p in enumerate(place.tolist()):
        others = np.delete(truth, p, axis=1) if p >= 0 else truth
        with np.errstate(invalid="ignore"):
            if p >= 0 and others.shape[1]:
                near[:, n] = (np.abs(wrapped(others - truth[:, p : p + 1])) < beam).any(axis=1)
    return near


def _bounds(recording: Recording, tracked: Tracked, true: Floats) -> tuple[Floats, Floats]:
    """The best tracker's sigma at every snapshot, with the filter's process noise and with none."""
    nothing = np.full(true.shape, np.nan)
    whole = np.isfinite(true).all(axis=1)
    if not whole.all() or len(true) > MOST_BOUNDED:
        return nothing, nothing
    power, noise = _powers(recording, tracked, true)
    if not (np.isfinite(power).all() and math.isfinite(noise) and noise > 0):
        return nothing, nothing
    found = []
    for q in (tracked.process_variance, 0.0):
        variance = posterior_crb(
            recording.geometry, true, power, noise, process_variance=q,
            start_bearing_sigma_rad=tracked.start.bearing_rad, start_rate_sigma_rad=tracked.start.rate_rad,
        )  # fmt: skip
        found.append(np.sqrt(np.maximum(variance, 0.0)))
    return found[0], found[1]


def _powers(recording: Recording, tracked: Tracked, true: Floats) -> tuple[Floats, float]:
    """Mean power of each source and of the noise; a method that has none borrows those of `joint-ml`."""
    if np.isfinite(tracked.power).any():
        return np.nanmean(tracked.power, axis=0), float(np.nanmean(tracked.noise))
    options = JointOptions(process_variance=tracked.process_variance, start=tracked.start)
    found = track("joint-ml", recording.geometry, recording.snapshots, true[0], None, options)
    return found.power.mean(axis=0), float(found.noise.mean())


__all__ = ["Judged", "Truth", "gather_truth", "judge"]
