"""Tracks from a recording by each method, as the same table of numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from rangeeval.analyses.bearing.frame import wrapped
from rangeeval.analyses.bearing.recording import Recording
from rangeeval.arrays import options as arrays
from rangeeval.arrays.bounds import beam_width, crb
from rangeeval.arrays.options import JointOptions, PastOptions, StartUncertainty, Track
from rangeeval.arrays.spectra import beamformer, capon, covariance, esprit, music, root_music
from rangeeval.arrays.tracker import start as find_targets
from rangeeval.arrays.tracker import track
from rangeeval.errors import InputError

Floats = NDArray[np.float64]

TRACKERS = ("joint-ml", "ryu", "modified")
PER_BLOCK = {"music": music, "root-music": root_music, "esprit": esprit}
METHODS = (*TRACKERS, *PER_BLOCK)
COASTING = ("none", "hard", "soft")
SOFT = 1000.0  # kappa of the soft coasting, which covers the correlation of successive windows
HARD_BEAMS = 0.75  # of a beam width, within which hard coasting leaves the innovation out
COHERENT = 0.5  # share of the power that one wave must carry for a block's bearing to count, with one target
BLOCK = 10


@dataclass(frozen=True)
class How:
    """How to track: the method and its options; what is None is chosen from the recording.

    `block`: snapshots a step of `joint-ml`, or of a block method. `acceleration_rad_s2`: sigma of the acceleration of
    a bearing that the filter expects.
    """

    method: str = "joint-ml"
    targets: int | None = None
    block: int | None = None
    acceleration_rad_s2: float | None = None
    lag_compensation: bool = False
    coasting: str = "none"


@dataclass(frozen=True)
class Tracked:
    """Bearings (T, N) of the array's frame with their sigma, at `sample` (T,), a place among the snapshots.

    `power` (T, N) and `noise` (T,) are those of a sensor, NaN where the method has none. `track` is that of a tracker.
    """

    how: How
    sample: Floats
    bearing_rad: Floats
    sigma_rad: Floats
    rate_rad: Floats
    power: Floats
    noise: Floats
    guard: Floats
    guard_threshold: float
    bits: NDArray[np.uint8]
    process_variance: float
    start: StartUncertainty
    coherence: Floats
    flags: tuple[str, ...] = ()
    track: Track | None = None

    @property
    def targets(self) -> int:
        """How many."""
        return int(self.bearing_rad.shape[1])

    def at(self, sample: Floats) -> Floats:
        """Bearings (samples, N) at other snapshots: by the tracker's own rates, or between blocks by straight lines."""
        if self.track is not None:
            return self.track.at(sample)
        found = np.empty((len(sample), self.targets))
        for n in range(self.targets):
            there = np.isfinite(self.bearing_rad[:, n])
            if not there.any():
                found[:, n] = np.nan
                continue
            unwrapped = np.unwrap(self.bearing_rad[there, n])
            found[:, n] = wrapped(np.interp(sample, self.sample[there], unwrapped, left=np.nan, right=np.nan))
        return found


def follow(recording: Recording, how: How) -> Tracked | None:
    """Track the targets of a recording; None where none was found.

    Raises InputError for a method the array cannot serve, or more targets than it can tell apart.
    """
    targets, bearings, rates, flags = _start(recording, how)
    if targets is not None and recording.geometry.sensors < targets + 1:
        raise InputError(
            f"{recording.where}: {targets} targets need {targets + 1} sensors, and {recording.geometry.sensors} gave a "
            "signal"
        )
    if targets == 0:
        return None
    try:
        if how.method in PER_BLOCK:
            assert targets is not None
            return _per_block(recording, replace(how, targets=targets), flags)
        return _tracked(recording, how, bearings, rates, flags)
    except ValueError as error:
        raise InputError(f"{recording.where}: {error}") from None


def _start(recording: Recording, how: How) -> tuple[int | None, Floats, Floats | None, tuple[str, ...]]:
    """Number of targets, bearings and rates at the first snapshot, and what is to be said about them."""
    given = recording.array.start_bearing_deg
    wanted = how.targets or recording.array.targets
    if given and (wanted is None or wanted == len(given)):
        return len(given), np.deg2rad(given), None, ()
    if wanted is not None and (how.method in PER_BLOCK or recording.geometry.sensors < wanted + 1):
        return wanted, np.empty(0), None, ()
    found = find_targets(recording.geometry, recording.snapshots, targets=wanted)
    return len(found.bearing_rad), np.asarray(found.bearing_rad), np.asarray(found.rate_rad), found.flags


def _uncertainty(recording: Recording, given: bool) -> StartUncertainty:
    """Of the start: the paper's where `trial.toml` gives bearings, else what one block can tell."""
    if given and recording.bins == 1:
        return StartUncertainty()
    beam = beam_width(recording.geometry)
    return StartUncertainty(max(beam / 10, math.radians(0.5)), max(beam / 200, 1e-4 * recording.bins))


def _process_variance(recording: Recording, how: How) -> float:
    """Of the acceleration, per snapshot^2; by default the specification's, where a bin counts as a snapshot."""
    if how.acceleration_rad_s2 is None:
        return float(1e-10 * recording.bins**4)
    return float((how.acceleration_rad_s2 * recording.interval_s**2) ** 2)


def _tracked(recording: Recording, how: How, bearings: Floats, rates: Floats | None, flags: tuple[str, ...]) -> Tracked:
    q = _process_variance(recording, how)
    start = _uncertainty(recording, bool(recording.array.start_bearing_deg))
    options: JointOptions | PastOptions
    threshold = math.nan
    if how.method == "joint-ml":
        block = how.block or max(1, round(BLOCK / recording.bins))
        options = JointOptions(block=block, process_variance=q, start=start)
        threshold = options.guard_threshold
    else:
        beam = beam_width(recording.geometry)
        options = PastOptions(
            process_variance=q,
            lag_compensation=how.lag_compensation,
            hard_coasting_rad=HARD_BEAMS * beam if how.coasting == "hard" else None,
            soft_coasting=SOFT if how.coasting == "soft" else None,
            start=start,
        )
        flags = (*flags, "nominal-sigma")
    found = track(how.method, recording.geometry, recording.snapshots, bearings, rates, options)
    return Tracked(
        replace(how, targets=found.bearing_rad.shape[1]), found.sample, found.bearing_rad, found.bearing_sigma_rad,
        found.rate_rad, found.power, found.noise, found.guard, threshold, found.flags, q, start,
        np.full(len(found.sample), np.nan), flags, found,
    )  # fmt: skip


def _per_block(recording: Recording, how: How, flags: tuple[str, ...]) -> Tracked:
    """Bearings of each block by themselves, put to the targets nearest before; sigma is the Cramer-Rao bound."""
    assert how.targets is not None
    geometry, targets = recording.geometry, how.targets
    sensors, bins = geometry.sensors, recording.bins
    block = how.block or max(2 * BLOCK, 2 * sensors) // bins or 1
    block = min(max(block, -(-2 * sensors // bins)), len(recording.snapshots))
    estimate = PER_BLOCK[how.method]
    count = len(recording.snapshots) // block
    bearing, sigma, power = (np.full((count, targets), np.nan) for _ in range(3))
    noise, coherence = np.full(count, np.nan), np.full(count, np.nan)
    bits = np.zeros((count, targets), np.uint8)
    grid = np.linspace(*geometry.sector, 721)
    beam = beam_width(geometry)
    for i in range(count):
        part = recording.snapshots[i * block : (i + 1) * block]
        whole = np.isfinite(part.reshape(block, -1)).all(axis=1)
        if np.count_nonzero(whole) < max(2, sensors // bins):
            bits[i] = arrays.MISSING
            continue
        cov = covariance(part)
        found = np.asarray(estimate(geometry, cov, targets))
        total = float(np.real(np.trace(cov, axis1=-2, axis2=-1)).sum()) / sensors
        if not total > 0:
            bits[i] = arrays.MISSING
            continue
        coherence[i] = float(beamformer(geometry, cov, grid).max()) / total
        eigenvalues = np.sort(np.linalg.eigvalsh(cov), axis=-1)
        noise[i] = float(eigenvalues[..., : sensors - targets].mean())
        place = _matched(bearing[:i], found, targets)
        bearing[i, place] = found
        heard = np.asarray(capon(geometry, cov, found)) / bins - noise[i] / sensors
        power[i, place] = np.maximum(heard, 1e-3 * noise[i] / sensors)
        bits[i, place] |= _near(found, beam)
        if targets == 1 and coherence[i] < COHERENT:
            bits[i] |= arrays.FADED
        sigma[i, place] = _bound(recording, found, power[i, place], float(noise[i]), int(np.count_nonzero(whole)))
    nothing = np.full((count, targets), np.nan)
    sample = np.arange(count, dtype=np.float64) * block + (block - 1) / 2
    return Tracked(
        how, sample, bearing, sigma, nothing, power, noise, np.full(count, np.nan), math.nan, bits,
        _process_variance(recording, how), StartUncertainty(), coherence, (*flags, "bound-sigma"),
    )  # fmt: skip


def _bound(recording: Recording, bearing: Floats, power: Floats, noise: float, snapshots: int) -> Floats:
    variance = np.diag(np.asarray(crb(recording.geometry, bearing, power, noise, snapshots)))
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(np.where(variance > 0, variance, np.nan)))


def _near(bearing: Floats, beam: float) -> NDArray[np.uint8]:
    """Which of these bearings are within a beam width of another."""
    apart = np.abs(wrapped(bearing[:, None] - bearing[None])) + np.diag(np.full(len(bearing), np.inf))
    return np.where(apart.min(axis=1, initial=np.inf) < beam, arrays.UNRESOLVED, 0).astype(np.uint8)


def _matched(before: Floats, found: Floats, targets: int) -> NDArray[np.intp]:
    """Which target each bearing is of: together nearest to where the targets were last."""
    last = np.full(targets, np.nan)
    for n in range(targets if len(before) else 0):
        there = np.flatnonzero(np.isfinite(before[:, n]))
        if len(there):
            last[n] = before[there[-1], n]
    cost = np.abs(wrapped(found[:, None] - last[None]))
    cost = np.where(np.isfinite(cost), cost, math.pi)
    rows, columns = linear_sum_assignment(cost)
    place = np.empty(len(found), np.intp)
    place[rows] = columns
    return place


__all__ = ["COASTING", "METHODS", "PER_BLOCK", "TRACKERS", "How", "Tracked", "follow"]
