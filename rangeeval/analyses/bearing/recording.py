"""A snapshots log made ready for the array room: samples in even steps, dead sensors out, broad band taken apart."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.arrays.broadband import bin_snapshots
from rangeeval.arrays.geometry import ArrayGeometry
from rangeeval.arrays.health import ArrayHealth, check_snapshots
from rangeeval.arrays.patterns import OMNIDIRECTIONAL, ElementPattern, baffle, cosine
from rangeeval.errors import InputError
from rangeeval.model import Log, Problem, SensorArray, Trial, gather

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]

MOST_BYTES = 2 << 30  # of samples held at once
_UNEVEN = 0.1  # of a step
_GAPS = 3  # times as many steps as snapshots is no record with gaps but one of uneven times
_CROSSINGS = 8  # a block of broad-band samples lasts so many times what the wave takes across the array
MOST_BINS = 64


@dataclass(frozen=True)
class Recording:
    """Snapshots (K, sensors), or in broad band (K, bins, sensors), at even times; a missing one is NaN.

    `interval_s`: from one to the next. `sensors` names those that are left. `flags`: what concerns all bearings.
    """

    where: str
    array: SensorArray
    geometry: ArrayGeometry
    time_s: Floats
    interval_s: float
    snapshots: Complex
    sensors: tuple[str, ...]
    health: ArrayHealth
    problems: tuple[Problem, ...]
    flags: tuple[str, ...]

    @property
    def bins(self) -> int:
        """Frequency bins; 1 in narrow band."""
        return self.geometry.bins

    @property
    def usable(self) -> NDArray[np.bool_]:
        """(K,) which snapshots have no missing sample."""
        return np.asarray(np.isfinite(self.snapshots.reshape(len(self.snapshots), -1)).all(axis=1))


def gather_recording(
    trial: Trial, span: tuple[float, float], progress: Callable[[int], None] | None = None
) -> Recording:
    """The snapshots of a trial between two times. Raises InputError, in one line, for what no bearing follows from."""
    log = trial.log("snapshots")
    array = trial.settings.array.over(log.array or SensorArray())
    where = log.source
    for name, words in (
        ("sensor_position_m", "where the sensors stand"),
        ("propagation_speed_m_s", "how fast the wave travels (about 1500 in sea water, 340 in air)"),
    ):
        if not getattr(array, name):
            raise InputError(f"{where}: has no {name}, {words}; give it in the file or in [array] of trial.toml")
    time, samples, problems = _read(log, span, progress)
    if len(array.sensor_position_m) != samples.shape[1]:
        raise InputError(
            f"{where}: its samples have {samples.shape[1]} columns and sensor_position_m has "
            f"{len(array.sensor_position_m)} rows, expected one row a sensor"
        )
    time, samples, interval, more = _even(where, time, samples)
    problems += more
    names = array.sensors or tuple(str(i + 1) for i in range(samples.shape[1]))
    health = check_snapshots(samples.astype(np.complex128))
    keep = np.setdiff1d(np.arange(samples.shape[1]), health.dead)
    problems += _health_problems(where, names, health)
    if len(keep) < 2:
        raise InputError(f"{where}: {len(keep)} of its {samples.shape[1]} sensors gave a signal; bearings need 2")
    array_left = replace(array, sensor_position_m=tuple(array.sensor_position_m[i] for i in keep))
    if len(array.facing_deg) > 1:
        if len(array.facing_deg) != samples.shape[1]:
            raise InputError(
                f"{where}: array.facing_deg has {len(array.facing_deg)} angles for {samples.shape[1]} sensors"
            )
        array_left = replace(array_left, facing_deg=tuple(array.facing_deg[i] for i in keep))
    samples = samples[:, keep]
    if samples.dtype.kind == "c":
        if array.frequency_hz is None:
            raise InputError(
                f"{where}: has no frequency_hz, the frequency of its snapshots; give it in the file or in [array] of "
                "trial.toml"
            )
        snapshots, frequency = samples, np.array([array.frequency_hz])
    else:
        time, interval, snapshots, frequency = _apart(where, array_left, time, interval, samples)
    time, snapshots, more = _heard(where, time, snapshots)
    problems += more
    geometry = geometry_of(array_left, frequency, where)
    flags = tuple(
        flag
        for flag, there in (
            ("dead-sensor", health.dead),
            ("weak-sensor", health.weak),
            ("clipped", health.clipped),
        )
        if there
    )
    return Recording(
        where, array, geometry, time, interval, snapshots, tuple(names[i] for i in keep), health,
        gather(problems), flags,
    )  # fmt: skip


def _read(
    log: Log, span: tuple[float, float], progress: Callable[[int], None] | None
) -> tuple[Floats, NDArray[Any], list[Problem]]:
    times, parts, held = [], [], 0
    problems: list[Problem] = []
    for piece in log.pieces(("time_s", "samples")):
        problems += piece.problems
        time = piece.floats("time_s")
        inside = (time >= span[0]) & (time <= span[1])
        samples = piece.wide("samples")
        times.append(time[inside])
        parts.append(samples if inside.all() else samples[inside])
        held += parts[-1].nbytes
        if progress is not None:
            progress(len(piece))
        if held > MOST_BYTES:
            raise InputError(
                f"{log.source}: holds more than {MOST_BYTES >> 30} GiB of samples from {times[0][0]:g} s to "
                f"{time[-1]:g} s; give a part of the time (--from, --to)"
            )
    time = np.concatenate(times) if times else np.empty(0)
    if len(time) < 2:
        between = "" if math.isinf(span[0]) and math.isinf(span[1]) else f" from {span[0]:g} to {span[1]:g} s"
        raise InputError(f"{log.source}: has {len(time)} snapshots{between}; bearings need many")
    return time, np.concatenate(parts), problems


def _even(where: str, time: Floats, samples: NDArray[Any]) -> tuple[Floats, NDArray[Any], float, list[Problem]]:
    """The samples at even times: in order, a gap filled with missing ones."""
    problems: list[Problem] = []
    steps = np.diff(time)
    if backward := int(np.count_nonzero(steps < 0)):
        problems.append(Problem(where, "time goes backwards; the snapshots are put in order", backward))
        order = np.argsort(time, kind="stable")
        time, samples = time[order], samples[order]
        steps = np.diff(time)
    if repeated := int(np.count_nonzero(steps == 0)):
        problems.append(Problem(where, "snapshots that repeat the time of another are not used", repeated))
        keep = np.concatenate([[True], steps > 0])
        time, samples = time[keep], samples[keep]
        steps = np.diff(time)
    if len(time) < 2:
        raise InputError(f"{where}: all its snapshots are of one time")
    interval = float(np.median(steps))
    place = np.rint((time - time[0]) / interval).astype(np.int64)
    count = int(place[-1]) + 1
    off = np.abs(time - time[0] - place * interval) > _UNEVEN * interval
    if (np.diff(place) < 1).any() or count > _GAPS * len(time) or 2 * np.count_nonzero(off) > len(time):
        problems.append(Problem(where, "the times of the snapshots are uneven; rates hold for their mean step"))
        return time, samples, float((time[-1] - time[0]) / (len(time) - 1)), problems
    if count > len(time):
        problems.append(Problem(where, "snapshots missing in gaps", count - len(time)))
        filled = np.full((count, samples.shape[1]), np.nan, samples.dtype)
        filled[place] = samples
        samples, time = filled, time[0] + interval * np.arange(count)
    return time, samples, interval, problems


def _heard(where: str, time: Floats, snapshots: Complex) -> tuple[Floats, Complex, list[Problem]]:
    """From the first whole snapshot to the last; those of a recorder that dropped out (zero in all) are missing."""
    flat = snapshots.reshape(len(snapshots), -1)
    silent = (flat == 0).all(axis=1)
    problems = []
    if silent.any():
        reason = "snapshots that are zero in all sensors (a recorder that dropped out); they are not used"
        problems.append(Problem(where, reason, int(np.count_nonzero(silent))))
        snapshots = snapshots.copy()
        snapshots[silent] = np.nan
        flat = snapshots.reshape(len(snapshots), -1)
    whole = np.flatnonzero(np.isfinite(flat).all(axis=1))
    if len(whole) < 2:
        raise InputError(f"{where}: {len(whole)} of its {len(snapshots)} snapshots are whole; bearings need many")
    used = slice(whole[0], whole[-1] + 1)
    return time[used], snapshots[used], problems


def _health_problems(where: str, names: tuple[str, ...], health: ArrayHealth) -> list[Problem]:
    found = []
    for sensors, words in (
        (health.dead, "dead (silent or constant) sensors, left out"),
        (health.weak, "sensors more than 20 dB weaker than the others"),
        (health.clipped, "clipped sensors: samples stand at one extreme value; bearings may be biased"),
    ):
        if sensors:
            found.append(Problem(where, f"{words}: {', '.join(names[i] for i in sensors)}"))
    return found


def _apart(
    where: str, array: SensorArray, time: Floats, interval: float, samples: Floats
) -> tuple[Floats, float, Complex, Floats]:
    """Real samples as snapshots of frequency bins."""
    rate = array.sampling_rate_hz or 1.0 / interval
    if not array.band_hz and array.frequency_hz is not None and rate < 2 * array.frequency_hz:
        raise InputError(
            f"{where}: its samples are real, {rate:.6g} a second; narrow-band snapshots at {array.frequency_hz:g} Hz "
            "are complex (in-phase and quadrature), and a time series needs more than twice that rate"
        )
    positions = np.array(array.sensor_position_m)
    apart = np.linalg.norm(positions[:, None] - positions[None], axis=2)
    assert array.propagation_speed_m_s is not None
    across = float(apart.max()) / array.propagation_speed_m_s
    block = array.block_s or _CROSSINGS * across
    length = max(16, round(block * rate))
    if 2 * length > len(samples):
        raise InputError(
            f"{where}: {len(samples)} samples hold no two blocks of {length / rate:g} s; give block_s in [array] "
            "of trial.toml"
        )
    line = rate / length
    if array.band_hz:
        low, high = array.band_hz
    elif array.frequency_hz is not None:
        low, high = array.frequency_hz - line, array.frequency_hz + line
    else:
        nearest = float(np.median(np.where(apart > 0, apart, np.inf).min(axis=1)))
        low, high = 2 * line, array.propagation_speed_m_s / nearest
    high = min(high, 0.5 * rate - line)
    if high <= low:
        raise InputError(
            f"{where}: no frequency lies between {low:g} and {high:g} Hz at {rate:g} samples a second; give band_hz in "
            "[array] of trial.toml"
        )
    if (high - low) / line > MOST_BINS:
        raise InputError(
            f"{where}: the band {low:g} to {high:g} Hz has {(high - low) / line:.0f} bins in blocks of "
            f"{length / rate:g} s; at most {MOST_BINS} are used: give a narrower band_hz or a smaller block_s in "
            "[array] of trial.toml"
        )
    found = bin_snapshots(samples, rate, length, band_hz=(low, high))
    centre = np.asarray(found.centre_sample)
    when = np.interp(centre, np.arange(len(time)), time)
    step = float(np.median(np.diff(when))) if len(when) > 1 else length / rate
    snapshots = found.snapshots if len(found.frequency_hz) > 1 else found.snapshots[:, 0]
    return when, step, snapshots, found.frequency_hz


def geometry_of(array: SensorArray, frequency_hz: Floats, where: str) -> ArrayGeometry:
    """The array as the array room wants it. Raises InputError for one that cannot be."""
    assert array.propagation_speed_m_s is not None
    sector = array.sector_deg
    try:
        return ArrayGeometry(
            np.array(array.sensor_position_m, dtype=np.float64), frequency_hz, array.propagation_speed_m_s,
            _pattern(array), np.deg2rad(array.facing_deg) if array.facing_deg else None,
            math.radians(array.elevation_deg), (math.radians(sector[0]), math.radians(sector[1])) if sector else None,
        ).centred()  # fmt: skip
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None


def _pattern(array: SensorArray) -> ElementPattern:
    if array.pattern == "cosine":
        return cosine(array.pattern_exponent)
    if array.pattern == "baffle":
        return baffle(array.pattern_back, array.pattern_exponent)
    return OMNIDIRECTIONAL


__all__ = ["MOST_BINS", "Recording", "gather_recording", "geometry_of"]
