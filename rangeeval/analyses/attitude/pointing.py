"""What the attitude does to azimuth and elevation over the target's path: per bin, by method."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.attitude.gathering import Gathered
from rangeeval.analyses.attitude.motion import Motion
from rangeeval.analyses.attitude.setup import Setup
from rangeeval.analyses.attitude.targets import Path
from rangeeval.errors import SettingsError
from rangeeval.model import Bins, Estimate, Trial
from rangeeval.physics.attitude import tilt
from rangeeval.physics.pointing import designation_error, report_error, report_sensitivity, small_angle_designation
from rangeeval.stats.intervals import sigma_interval
from rangeeval.stats.mean_square import root_mean_square

Array = NDArray[np.float64]
METHODS = ("none", "single", "pair")


@dataclass(frozen=True)
class Attitudes:
    """(alpha_x, alpha_z) at each detection by method, NaN where none is had; the pair's sigmas and what is missing."""

    of: Mapping[str, tuple[Array, Array]]
    sigma: tuple[Array, Array]
    sigma_freedom: float
    single_excess: tuple[float, float]
    flags: tuple[str, ...]


@dataclass(frozen=True)
class Pointing:
    """Errors (azimuth, elevation) in rad at each detection by method and kind, and the bin of each detection."""

    path: Path
    report: Mapping[str, tuple[Array, Array]]
    designation: Mapping[str, tuple[Array, Array]]
    small_angle: Mapping[str, tuple[Array, Array]]
    pair_sigma: tuple[Array, Array]
    noise_square: Mapping[str, tuple[Array, ...]]
    attitudes: Attitudes
    bin: NDArray[np.int32]


def attitudes_at(setup: Setup, gathered: Gathered, motions: Mapping[str, Motion]) -> Attitudes:
    """The attitude at every detection: what the radar assumed, what one sensor says, what all sensors say."""
    count = gathered.at_times.shape[1]
    s, g = setup.settings, setup.gravity
    flags: list[str] = []
    by_axis: dict[str, dict[str, Array]] = {}
    sigma: list[Array] = []
    freedom, excess = math.inf, []
    for axis in ("z", "x"):
        motion = motions.get(axis)
        if motion is None:
            flags.append("one-axis")
            zero = np.zeros(count)
            by_axis[axis] = {"single": zero, "pair": zero}
            sigma.append(np.zeros(count))
            excess.append(0.0)
            continue
        forces = gathered.at_times[setup.of_axis(axis)]
        cosine = {m: np.cos(by_axis["z"][m]) if axis == "x" else 1.0 for m in ("single", "pair")}
        i = motion.single_index
        single = tilt(forces[i], g * cosine["single"])
        if motion.heights is None:
            flags.append("one-sensor" if len(motion.sensors) == 1 else "no-radii")
            pair = np.full(count, np.nan)
            excess.append(math.nan)
        else:
            pair = tilt(motion.heights.centre @ forces, g * cosine["pair"])
            excess.append(
                motion.pair_sigma**2 - 2 * float(motion.heights.centre[i]) * (motion.sensor_sigma[i] / g) ** 2
            )
        by_axis[axis] = {"single": single, "pair": pair}
        sigma.append(motion.pair_sigma * np.sqrt(gathered.noise_left))
        freedom = min(freedom, motion.pair_freedom) if math.isfinite(motion.pair_freedom) else freedom
        flags += [
            f
            for f in motion.flags
            if f in {"unusable", "saturated", "stuck-sensor", "clock-step", "calibrated", "not-rigid"}
        ]
    of = {m: (by_axis["x"][m], by_axis["z"][m]) for m in ("single", "pair")}
    of["none"] = tuple(np.full(count, math.radians(v)) for v in (s.assumed_x_deg, s.assumed_z_deg))  # type: ignore[assignment]
    return Attitudes(of, (sigma[1], sigma[0]), freedom, (excess[1], excess[0]), tuple(dict.fromkeys(flags)))


def pointing_of(
    trial: Trial, setup: Setup, gathered: Gathered, motions: Mapping[str, Motion], path: Path, bins: Bins
) -> Pointing:
    """Errors by exact rotations (and the paper's small-angle forms) at every detection. The truth is the pair's
    attitude.
    """
    found = attitudes_at(setup, gathered, motions)
    heading = math.radians(trial.settings.site.heading_deg)
    true, az, el = found.of["pair"], path.azimuth, path.elevation
    report, designation, small = {}, {}, {}
    for method in ("none", "single"):
        measured = found.of[method]
        report[method] = report_error(az, el, heading, true, measured)
        designation[method] = designation_error(az, el, heading, true, measured)
        small[method] = small_angle_designation(az - heading, el, measured[0] - true[0], measured[1] - true[1])
    by_error = report_sensitivity(az, el, heading, true)
    left = gathered.noise_left
    sigma = tuple(np.hypot(by_x * found.sigma[0], by_z * found.sigma[1]) for by_x, by_z in by_error)
    # The pair's own noise stands in every difference against it: taken off the squares.
    squares = {"none": [s**2 for s in found.sigma], "single": [v * left for v in found.single_excess]}
    noise = {method: tuple(by_x**2 * x + by_z**2 * z for by_x, by_z in by_error) for method, (x, z) in squares.items()}
    variable = {
        "range": path.range_m, "azimuth": path.azimuth, "elevation": path.elevation, "time": path.time_s
    }.get(bins.variable)  # fmt: skip
    if variable is None:
        raise SettingsError(
            f"bins.variable '{bins.variable}' is not known of {path.source}; use range, azimuth, elevation or time"
        )
    return Pointing(path, report, designation, small, (sigma[0], sigma[1]), noise, found, bins.index(variable))


def pointing_estimates(found: Pointing, bins: Bins, confidence: float) -> list[Estimate]:
    """Per bin and method: root mean square of the report error (azimuth, elevation), its mean and peak, and the same
    root mean square of the designation error and by the small-angle forms.
    """
    rows: list[Estimate] = []
    used = np.unique(found.bin[found.bin >= 0]).tolist()
    for k, angle in enumerate(("azimuth", "elevation")):
        for b in used:
            inside = found.bin == b
            for method in METHODS:
                rows += _in_bin(found, bins, b, inside, k, angle, method, confidence)
    return rows


def _in_bin(
    found: Pointing, bins: Bins, b: int, inside: NDArray[np.bool_], k: int, angle: str, method: str, confidence: float
) -> list[Estimate]:
    low_edge, high_edge = bins.edges(b)
    flags = list(found.attitudes.flags)

    def row(name: str, value: float, low: float, high: float, n: int, n_eff: float, *more: str) -> Estimate:
        return Estimate(
            quantity=f"{angle}_{name}", unit="rad", value=value, low=low, high=high, n=n, n_eff=n_eff,
            variable=bins.variable, bin_low=low_edge, bin_high=high_edge, group=method,
            flags=tuple(dict.fromkeys((*flags, *more))),
        )  # fmt: skip

    everything = int(np.count_nonzero(inside))
    if method == "pair":
        sigma = found.pair_sigma[k][inside]
        sigma = sigma[np.isfinite(sigma)]
        _count_flags(flags, sigma.size, everything, bins)
        if not sigma.size:
            return [row("error_rms", math.nan, math.nan, math.nan, 0, math.nan)]
        value = float(np.sqrt(np.mean(sigma**2)))
        low, high = (float(v) for v in sigma_interval(value, found.attitudes.sigma_freedom, confidence))
        return [row("error_rms", value, low, high, sigma.size, found.attitudes.sigma_freedom, "propagated")]
    error = found.report[method][k][inside]
    use = np.isfinite(error)
    error = error[use]
    _count_flags(flags, error.size, everything, bins)
    if not error.size:
        return [row("error_rms", math.nan, math.nan, math.nan, 0, math.nan)]
    noise = float(np.mean(found.noise_square[method][k][inside][use]))
    value, low, high, n_eff, limited = root_mean_square(error, noise, confidence)
    more = ["noise-limited"] if limited else []
    designation = found.designation[method][k][inside][use]
    small = found.small_angle[method][k][inside][use]
    none = (math.nan, math.nan)
    return [
        row("error_rms", value, low, high, error.size, n_eff, *more),
        row("error_mean", float(np.mean(error)), *none, error.size, n_eff),
        row("error_peak", float(np.max(np.abs(error))), *none, error.size, n_eff),
        row("designation_error_rms", *root_mean_square(designation, noise, confidence)[:3], error.size, n_eff, *more),
        row("small_angle_error_rms", *root_mean_square(small, noise, confidence)[:3], error.size, n_eff, *more),
    ]


def _count_flags(flags: list[str], n: int, everything: int, bins: Bins) -> None:
    if n < max(bins.min_samples, 2):
        flags.append("few-samples")
    if n < everything:
        flags.append("no-attitude")
