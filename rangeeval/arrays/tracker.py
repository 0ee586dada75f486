"""Bearings of several targets over time from the snapshots of one array: one call for every method."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.arrays.bounds import beam_width
from rangeeval.arrays.geometry import ArrayGeometry
from rangeeval.arrays.joint import track_joint
from rangeeval.arrays.manifold import manifold, steering
from rangeeval.arrays.options import (
    COASTED,
    FADED,
    METHODS,
    MISSING,
    OUTSIDE,
    UNMODELLED,
    UNRESOLVED,
    JointOptions,
    PastOptions,
    Track,
)
from rangeeval.arrays.past import track_past
from rangeeval.arrays.starting import Start, start

Array = NDArray[np.float64]
Snapshots = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class _Job:
    """Checked input: snapshots (runs, K, bins, M), usable (runs, K), starts (runs, N)."""

    geometry: ArrayGeometry
    x: Snapshots
    usable: NDArray[np.bool_]
    bearing: Array
    rate: Array
    single: bool

    @property
    def targets(self) -> int:
        return int(self.bearing.shape[1])


def track(
    method: str,
    geometry: ArrayGeometry,
    snapshots: ArrayLike,
    start_bearing_rad: ArrayLike,
    start_rate_rad: ArrayLike | None = None,
    options: PastOptions | JointOptions | None = None,
) -> Track:
    """Track N targets from where they start; the bearings of a full circle are not wrapped, so that they are smooth.

    Parameters
    ----------
    method : one of METHODS.
    snapshots : (K, M), (K, bins, M), or either with a leading axis of runs (Monte Carlo). A snapshot that holds a NaN
        is a missing one: the targets are then only predicted.
    start_bearing_rad, start_rate_rad : (N,) or (runs, N); at the first snapshot for `joint-ml`, and one snapshot before
        it for the others, as published. Rates are 0 when not given.
    options : those of the method.

    Raises
    ------
    ValueError : unknown method, shapes that do not fit, fewer sensors than targets plus one, `ryu` off a line, options
        of another method, a record shorter than a block.
    """
    if method not in METHODS:
        raise ValueError(f"the method is {method!r}; known: {', '.join(METHODS)}")
    if method == "ryu" and not geometry.linear:
        raise ValueError("ryu is derived for line arrays, and these sensors do not stand in a line; use modified")
    wanted = JointOptions if method == "joint-ml" else PastOptions
    chosen = wanted() if options is None else options
    if not isinstance(chosen, wanted):
        raise ValueError(f"{method} takes {wanted.__name__}, not {type(chosen).__name__}")
    job = _checked(geometry, snapshots, start_bearing_rad, start_rate_rad)
    if isinstance(chosen, JointOptions):
        return _track_joint(job, chosen)
    return _track_past(method, job, chosen)


def _checked(geometry: ArrayGeometry, snapshots: ArrayLike, bearing: ArrayLike, rate: ArrayLike | None) -> _Job:
    x = np.asarray(snapshots, dtype=np.complex128)
    inner = (geometry.sensors,) if geometry.bins == 1 else (geometry.bins, geometry.sensors)
    if x.ndim not in (len(inner) + 1, len(inner) + 2) or x.shape[-len(inner) :] != inner:
        expected = " x ".join(["snapshots", *(["bins"] if geometry.bins > 1 else []), "sensors"])
        raise ValueError(
            f"snapshots of shape {x.shape} for {geometry.bins} bins and {geometry.sensors} sensors; give {expected}"
        )
    single = x.ndim == len(inner) + 1
    runs = 1 if single else x.shape[0]
    x = x.reshape(runs, -1, geometry.bins, geometry.sensors)
    starts = np.atleast_1d(np.asarray(bearing, dtype=np.float64))
    n = starts.shape[-1]
    if not n:
        raise ValueError("no bearing to start from")
    if geometry.sensors < n + 1:
        raise ValueError(f"{n} targets on {geometry.sensors} sensors; {n + 1} sensors or more are needed")
    try:
        bearings = np.array(np.broadcast_to(starts, (runs, n)))
        rates = np.array(np.broadcast_to(np.asarray(0.0 if rate is None else rate, dtype=np.float64), (runs, n)))
    except ValueError:
        raise ValueError(f"starts of shapes {starts.shape} and {np.asarray(rate).shape} for {runs} runs") from None
    if not (np.isfinite(bearings).all() and np.isfinite(rates).all()):
        raise ValueError("a bearing or rate to start from is not a number")
    usable: NDArray[np.bool_] = np.asarray(np.isfinite(x).all(axis=(2, 3)))
    if not usable.all():
        x = np.where(usable[:, :, None, None], x, 0.0)
    return _Job(geometry, np.ascontiguousarray(x), usable, bearings, rates, single)


def _track_joint(job: _Job, options: JointOptions) -> Track:
    runs, count, bins, _ = job.x.shape
    n, blocks = job.targets, count // options.block
    if blocks < 1:
        raise ValueError(f"{count} snapshots are less than one block of {options.block}")
    out = np.empty((runs, 5, blocks, n))
    powers, noises = np.empty((runs, blocks, bins, n)), np.empty((runs, blocks, bins))
    guards, counts = np.empty((runs, blocks)), np.empty((runs, blocks), np.int64)
    array = manifold(job.geometry)
    for run in range(runs):
        track_joint(
            array, job.x[run], job.usable[run], job.bearing[run], job.rate[run], options.start.bearing_rad,
            options.start.rate_rad, options.start_sample, options.opening, options.block, options.iterations,
            options.process_variance, options.largest_step_rad, options.limit_together, options.memory,
            options.guard_window, np.zeros((bins, n)), np.zeros(bins), out[run], powers[run], noises[run],
            guards[run], counts[run],
        )  # fmt: skip
    power, noise = powers.mean(axis=2), noises.mean(axis=2)
    beam_noise = noise / job.geometry.sensors
    flags: Any = np.where(counts == 0, MISSING, 0)[..., None] | np.where(power < beam_noise[..., None], FADED, 0)
    flags |= np.where(guards > options.guard_threshold, UNMODELLED, 0)[..., None]
    sample = options.block * np.arange(blocks) + 0.5 * (options.block - 1)
    return _assembled("joint-ml", job, sample, out, power, noise, guards, flags)


def _track_past(method: str, job: _Job, options: PastOptions) -> Track:
    runs, count, bins, _ = job.x.shape
    n = job.targets
    out, coasted = np.empty((runs, 5, count, n)), np.empty((runs, count, n), np.bool_)
    array = manifold(job.geometry)
    for run in range(runs):
        a = steering(job.geometry, job.bearing[run])[0].reshape(bins, job.geometry.sensors, n)
        basis = np.ascontiguousarray(np.linalg.qr(a)[0])
        track_past(
            array, job.x[run], job.usable[run], job.bearing[run], job.rate[run], options.start.bearing_rad,
            options.start.rate_rad, basis, options.forgetting, options.process_variance, options.measurement_variance,
            options.lag_compensation, options.hard_coasting_rad or 0.0, options.soft_coasting or 0.0,
            options.source_power or 0.0, out[run], coasted[run],
        )  # fmt: skip
    flags: Any = np.where(job.usable, 0, MISSING)[..., None] | np.where(coasted, COASTED, 0)
    nothing = np.full((runs, count), np.nan)
    power = np.full((runs, count, n), np.nan)
    return _assembled(method, job, np.arange(count, dtype=np.float64), out, power, nothing, nothing, flags)


def _assembled(
    method: str,
    job: _Job,
    sample: Array,
    out: Array,
    power: Array,
    noise: Array,
    guard: Array,
    flags: NDArray[np.int64],
) -> Track:
    """The track, with the flags that follow from its bearings alone."""
    bearing, sigma, rate, rate_sigma, innovation = out.swapaxes(0, 1)
    low, high = job.geometry.sector
    if not job.geometry.full_circle:
        flags = flags | np.where((bearing < low) | (bearing > high), OUTSIDE, 0)
    flags = flags | np.where(_crowded(job.geometry, bearing), UNRESOLVED, 0)
    if job.single:
        parts = (bearing[0], sigma[0], rate[0], rate_sigma[0], innovation[0], power[0], noise[0], guard[0], flags[0])
    else:
        parts = (bearing, sigma, rate, rate_sigma, innovation, power, noise, guard, flags)
    return Track(method, sample, *parts[:-1], parts[-1].astype(np.uint8))


def _crowded(geometry: ArrayGeometry, bearing: Array) -> NDArray[np.bool_]:
    """Whether another target is nearer than a beam width: of (runs, T, N)."""
    n = bearing.shape[-1]
    close = np.zeros(bearing.shape, bool)
    if n < 2:
        return close
    low, high = geometry.sector
    grid = np.linspace(low, high, 13)
    width = np.array([beam_width(geometry, b) for b in grid])
    inside = np.mod(bearing - low, 2 * math.pi) + low if geometry.full_circle else np.clip(bearing, low, high)
    own = np.interp(inside, grid, width)
    for i in range(n):
        for k in range(i):
            apart = np.abs(np.mod(bearing[..., i] - bearing[..., k] + math.pi, 2 * math.pi) - math.pi)
            close[..., i] |= apart < own[..., i]
            close[..., k] |= apart < own[..., k]
    return close


__all__ = ["Start", "start", "track"]
