"""Tracks from a recording by each method, as the same table of numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from rangeeval.analyses.bearing.recording import Recording
from rangeeval.angles import wrapped
from rangeeval.arrays import options as arrays
from rangeeval.arrays.bounds import beam_width, crb
from rangeeval.arrays.geometry import ArrayGeometry
from rangeeval.arrays.manifold import steering
from rangeeval.arrays.options import JointOptions, PastOptions, StartUncertainty, Track
from rangeeval.arrays.spectra import beamformer, covariance, esprit, music, root_music
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
_START_BLOCK = 20
_FAR_BEAMS = 1.5
_REMEMBERED = 8  # blocks through which a straight line says where a target is expected


@dataclass(frozen=True)
class How:
    """How to track: the method and its options; what is None is chosen from the recording.

    `counted`: the number of targets is to be found, whatever the trial says.
    `block`: snapshots a step of `joint-ml`, or of a block method. `acceleration_rad_s2`: sigma of the acceleration of
    a bearing that the filter expects.
    """

    method: str = "joint-ml"
    targets: int | None = None
    counted: bool = False
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


@dataclass(frozen=True)
class _Start:
    """Number of targets, and for a tracker their bearings and rates (per snapshot) at the first one, with sigmas."""

    targets: int
    bearing_rad: Floats
    rate_rad: Floats
    uncertainty: StartUncertainty
    flags: tuple[str, ...] = ()


def follow(recording: Recording, how: How) -> Tracked | None:
    """Track the targets of a recording; None where none was found.

    Raises InputError for a method the array cannot serve, or more targets than it can tell apart.
    """
    given = recording.array.start_bearing_deg
    wanted = None if how.counted else how.targets or recording.array.targets or len(given) or None
    if wanted is not None and recording.geometry.sensors < wanted + 1:
        raise InputError(
            f"{recording.where}: {wanted} targets need {wanted + 1} sensors, and {recording.geometry.sensors} gave a "
            "signal"
        )
    try:
        start = _start(recording, how, wanted)
        if start.targets == 0:
            return None
        if how.method in PER_BLOCK:
            return _per_block(recording, replace(how, targets=start.targets), start.flags)
        return _tracked(recording, how, start)
    except ValueError as error:
        raise InputError(f"{recording.where}: {error}") from None


def _start(recording: Recording, how: How, wanted: int | None) -> _Start:
    array, nothing = recording.array, np.empty(0)
    if wanted is not None and how.method in PER_BLOCK:
        return _Start(wanted, nothing, nothing, StartUncertainty())
    if array.start_bearing_deg and wanted == len(array.start_bearing_deg):
        bearing = np.deg2rad(array.start_bearing_deg)
        if array.start_rate_deg_s:
            rate = np.deg2rad(array.start_rate_deg_s) * recording.interval_s
            return _Start(wanted, bearing, rate, StartUncertainty())
        # The rates are open: as uncertain as one block would leave them.
        open_rate = math.sqrt(2.0) * 0.1 * beam_width(recording.geometry) / _START_BLOCK
        return _Start(wanted, bearing, 0.0 * bearing, StartUncertainty(rate_rad=open_rate * recording.bins))
    block = min(_START_BLOCK, max(recording.geometry.sensors + 1, -(-_START_BLOCK // recording.bins)))
    found = find_targets(recording.geometry, recording.snapshots, targets=wanted, block=block)
    return _Start(len(found.bearing_rad), found.bearing_rad, found.rate_rad, found.uncertainty, found.flags)


def _process_variance(recording: Recording, how: How) -> float:
    """Of the acceleration, per snapshot^2: by default that of the source papers, more for the longer steps of bins."""
    if how.acceleration_rad_s2 is None:
        return float(1e-10 * recording.bins**2)
    return float((how.acceleration_rad_s2 * recording.interval_s**2) ** 2)


def _tracked(recording: Recording, how: How, begun: _Start) -> Tracked:
    q, start, flags = _process_variance(recording, how), begun.uncertainty, begun.flags
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
    found = track(how.method, recording.geometry, recording.snapshots, begun.bearing_rad, begun.rate_rad, options)
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
    block = how.block or max(1, -(-max(2 * BLOCK, 2 * sensors) // bins))
    block = min(max(block, -(-(sensors + 1) // bins)), len(recording.snapshots))
    estimate = PER_BLOCK[how.method]
    count = len(recording.snapshots) // block
    bearing, sigma, power = (np.full((count, targets), np.nan) for _ in range(3))
    noise, coherence = np.full(count, np.nan), np.full(count, np.nan)
    bits = np.full((count, targets), arrays.MISSING, np.uint8)
    beam = beam_width(geometry)
    grid = np.linspace(*geometry.sector, int(np.clip(4 * np.ptp(geometry.sector) / beam, 31, 721)))
    for i in range(count):
        part = recording.snapshots[i * block : (i + 1) * block]
        whole = np.isfinite(part.reshape(block, -1)).all(axis=1)
        if np.count_nonzero(whole) < max(2, sensors // bins):
            continue
        cov = covariance(part)
        total = float(np.real(np.trace(cov, axis1=-2, axis2=-1)).sum()) / sensors
        found = np.asarray(estimate(geometry, cov, targets)) if total > 0 else np.empty(0)
        if not len(found):
            continue
        coherence[i] = float(beamformer(geometry, cov, grid).max()) / total
        place, kept = _matched(bearing[:i], found, targets, _FAR_BEAMS * beam)
        if not kept.any():
            continue
        place, found = place[kept], found[kept]
        bearing[i, place] = found
        heard, noises = _powers(geometry, cov, found)
        power[i, place], noise[i] = heard.mean(axis=0), noises.mean()
        bits[i, place] = _near(found, beam)
        if targets == 1 and coherence[i] < COHERENT:
            bits[i] |= arrays.FADED
        variance = np.diag(crb(geometry, found, heard, noises, int(np.count_nonzero(whole))))
        sigma[i, place] = np.sqrt(np.where(variance > 0, variance, np.nan))
    nothing = np.full((count, targets), np.nan)
    sample = np.arange(count, dtype=np.float64) * block + (block - 1) / 2
    return Tracked(
        how, sample, bearing, sigma, nothing, power, noise, np.full(count, np.nan), math.nan, bits,
        _process_variance(recording, how), StartUncertainty(), coherence, (*flags, "bound-sigma"),
    )  # fmt: skip


def _powers(geometry: ArrayGeometry, cov: NDArray[np.complex128], bearing: Floats) -> tuple[Floats, Floats]:
    """Power of each source (bins, N) and of the noise (bins,) in a block, least squares on R = A P A^H + s I.

    The noise is what the sources' responses leave, over the dimensions left; a power is at least a thousandth of it.
    """
    a = steering(geometry, bearing)[0].reshape(geometry.bins, geometry.sensors, len(bearing))
    e = cov.reshape(geometry.bins, geometry.sensors, geometry.sensors)
    inverse = np.linalg.pinv(a)
    left = np.eye(geometry.sensors) - a @ inverse
    noise = np.real(np.trace(left @ e, axis1=1, axis2=2)) / (geometry.sensors - len(bearing))
    noise = np.maximum(noise, 1e-12 * np.real(np.trace(e, axis1=1, axis2=2)))
    clean = e - noise[:, None, None] * np.eye(geometry.sensors)
    power = np.real(np.einsum("bnm,bml,bnl->bn", inverse, clean, inverse.conj()))
    return np.maximum(power, 1e-3 * noise[:, None]), noise


def _near(bearing: Floats, beam: float) -> NDArray[np.uint8]:
    """Which of these bearings are within a beam width of another."""
    apart = np.abs(wrapped(bearing[:, None] - bearing[None])) + np.diag(np.full(len(bearing), np.inf))
    return np.where(apart.min(axis=1, initial=np.inf) < beam, arrays.UNRESOLVED, 0).astype(np.uint8)


def _matched(before: Floats, found: Floats, targets: int, far_rad: float) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Which target each bearing is of, and whether it is taken.

    Together nearest to where straight lines through the last blocks lead. Of several targets one that has a line takes
    no bearing farther than `far_rad` from it: that is a side lobe.
    """
    expected, led = np.full(targets, np.nan), np.zeros(targets, bool)
    for n in range(targets):
        there = np.flatnonzero(np.isfinite(before[:, n]))[-_REMEMBERED:]
        if len(there):
            bearing = np.unwrap(before[there, n])
            expected[n] = bearing[-1]
            led[n] = len(there) > 2
            if led[n]:
                expected[n] = np.polyfit(there - len(before), bearing, 1)[1]
    cost = np.abs(wrapped(found[:, None] - expected[None]))
    cost = np.where(np.isfinite(cost), cost, math.pi)
    rows, place = linear_sum_assignment(cost)
    far = (cost[rows, place] > far_rad) & led[place] & (targets > 1)
    order = np.argsort(rows)
    return place[order], ~far[order]


__all__ = ["COASTING", "METHODS", "PER_BLOCK", "TRACKERS", "How", "Tracked", "follow"]
