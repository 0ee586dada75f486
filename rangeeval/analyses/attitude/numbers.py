"""From the motions to the estimates of the whole trial: tilt, oscillation, noise, errors by method, the budget."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rangeeval.analyses.attitude.motion import NOTHING, Measured, Motion
from rangeeval.analyses.attitude.setup import Setup
from rangeeval.model import Estimate
from rangeeval.physics.attitude import (
    gravity_error,
    height_weights,
    lever_error_peak,
    noise_amplification,
    single_error_peak,
    skew_error_peak,
    sway_error_peak,
)
from rangeeval.stats.intervals import sigma_interval

BUDGET = ("noise", "radii", "bias", "time_skew", "sway", "gravity")


@dataclass(frozen=True)
class Rows:
    """Writes the rows of one axis."""

    motion: Motion
    confidence: float
    samples: int

    def row(
        self, name: str, unit: str, measured: Measured, *flags: str, group: str | None = None, floor: float = -math.inf
    ) -> Estimate:
        """A row with its Student interval, not below `floor`."""
        low, high = measured.interval(self.confidence)
        return self.plain(
            name,
            unit,
            measured.value,
            max(low, floor) if math.isfinite(low) else low,
            high,
            measured.n_eff,
            *flags,
            group=group,
        )

    def plain(
        self,
        name: str,
        unit: str,
        value: float,
        low: float,
        high: float,
        n_eff: float,
        *flags: str,
        group: str | None = None,
    ) -> Estimate:
        """A row with the ends given."""
        return Estimate(
            quantity=f"{name}_{self.motion.axis}", unit=unit, value=value, low=low, high=high,
            n=self.samples, n_eff=n_eff,
            group=group, flags=tuple(dict.fromkeys((*self.motion.flags, *flags))),
        )  # fmt: skip

    def sigma(
        self, name: str, unit: str, value: float, freedom: float, *flags: str, group: str | None = None
    ) -> Estimate:
        """A row with the chi-square interval of a sigma."""
        low, high = (float(v) for v in sigma_interval(value, freedom, self.confidence))
        return self.plain(name, unit, value, low, high, freedom, *flags, group=group)


def motion_estimates(motion: Motion, setup: Setup, samples: int, confidence: float) -> list[Estimate]:
    """Everything about one axis that needs no target."""
    rows = Rows(motion, confidence, samples)
    dynamic, frequency = motion.dynamic, motion.frequency
    found = [
        rows.row("static", "rad", motion.static),
        rows.plain("dynamic_amplitude", "rad", math.nan, 0.0, motion.noise_limit, math.nan)
        if math.isfinite(motion.noise_limit)
        else rows.row("dynamic_amplitude", "rad", dynamic, floor=0.0),
        rows.row("frequency", "Hz", frequency, floor=0.0),
        _single_peak(rows, motion, setup),
    ]
    if motion.heights is not None and motion.radii is not None:
        found.append(rows.sigma("pair_error_sigma", "rad", motion.pair_sigma, motion.pair_freedom))
        found.append(_amplification(rows, motion.radii.values, motion.radii.errors))
    else:
        found += [rows.row("pair_error_sigma", "rad", NOTHING), rows.row("noise_amplification", "1", NOTHING)]
    found += _budget(rows, motion, setup)
    for i, sensor in enumerate(motion.sensors):
        found.append(
            rows.sigma("sensor_noise", "m/s^2", motion.sensor_sigma[i], motion.sensor_freedom[i], group=sensor)
        )
        if motion.radii is not None:
            r, e = motion.radii.values[i], motion.radii.errors[i]
            found.append(rows.row("radius", "m", Measured(r, e, math.inf, float(samples)), group=sensor))
        if motion.calibrated is not None and motion.radii is not None and not motion.radii.from_motion:
            seen, spread = motion.calibrated.values[i], math.hypot(motion.calibrated.errors[i], motion.radii.errors[i])
            away = abs(seen - motion.radii.values[i]) > 4 * spread
            found.append(rows.row(
                "radius_from_motion", "m", Measured(seen, motion.calibrated.errors[i], math.inf, float(samples)),
                *(["radius-disagrees"] if away else []), group=sensor,
            ))  # fmt: skip
    if math.isfinite(motion.skew.value):
        found.append(rows.row("time_skew", "s", motion.skew))
    if math.isfinite(motion.misfit.value):
        found.append(rows.row("height_misfit", "m/s^2", motion.misfit, floor=0.0))
    if math.isfinite(motion.coherence):
        found.append(rows.plain("coherence", "1", motion.coherence, math.nan, math.nan, math.nan))
    return found


def _single_peak(rows: Rows, motion: Motion, setup: Setup) -> Estimate:
    """Peak error of one accelerometer, from the measured angular acceleration: no noise in it.

    R alpha_dd is measured, at the peak -R w^2 alpha_d; where the amplitude varies, the segment that moved most counts.
    """
    turned, dynamic = motion.acceleration, motion.dynamic
    if motion.radii is None or not math.isfinite(turned.value):
        if "no-oscillation" in motion.flags and motion.radii is not None:
            return rows.plain("single_error_peak", "rad", math.nan, 0.0, math.nan, math.nan)
        return rows.row("single_error_peak", "rad", NOTHING)
    radius = motion.radii.values[motion.single_index]
    error = motion.radii.errors[motion.single_index]
    share = motion.largest_acceleration / turned.value
    amplitude = (
        dynamic.value if math.isfinite(dynamic.value) else turned.value / (2 * math.pi * motion.frequency.value) ** 2
    )

    def peak(swing: float, at: float) -> float:
        kappa = at * swing / (setup.gravity * amplitude)
        return float(single_error_peak(motion.static.value, amplitude * share, kappa * share / share))

    value = peak(turned.value, radius)
    by_swing = peak(turned.value + turned.error, radius) - value if math.isfinite(turned.error) else math.nan
    by_radius = peak(turned.value, radius + math.copysign(error, radius)) - value
    spread = math.hypot(by_swing, by_radius)
    flags = () if math.isfinite(value) else ("unusable",)
    return rows.row(
        "single_error_peak", "rad", Measured(value, spread, turned.freedom, turned.n_eff), *flags, floor=0.0
    )


def _amplification(rows: Rows, radii: tuple[float, ...], errors: tuple[float, ...]) -> Estimate:
    """The noise amplification factor; its interval is what the radii's uncertainty makes of it."""
    value = noise_amplification(radii)
    parts = []
    for i, e in enumerate(errors):
        moved = list(radii)
        moved[i] += e
        try:
            parts.append(noise_amplification(moved) - value)
        except ValueError:
            parts.append(math.inf)
    return rows.row("noise_amplification", "1", Measured(value, math.hypot(*parts)), floor=0.0)


def _budget(rows: Rows, motion: Motion, setup: Setup) -> list[Estimate]:
    """The standard deviation that each cause leaves in the tilt at the centre, and all together.

    Noise is measured; the rest follows from the tolerances in the settings and the motion that was found. A sinusoidal
    error counts with its root mean square.
    """
    if motion.heights is None or motion.radii is None:
        return []
    s, g = setup.settings, setup.gravity
    f = motion.frequency.value if math.isfinite(motion.frequency.value) else 0.0
    dynamic = motion.dynamic.value if math.isfinite(motion.dynamic.value) else 0.0
    static = motion.static.value if math.isfinite(motion.static.value) else 0.0
    radii, centre = motion.radii.values, motion.heights.centre
    levers = []
    for i, e in enumerate(motion.radii.errors):
        moved = list(radii)
        moved[i] += e
        # The weights made with wrong radii leave a lever of the true ones: sum(w' R).
        levers.append(float(height_weights(moved).centre @ np.asarray(radii)))
    lever = math.hypot(*levers)
    bias = float(np.linalg.norm(centre)) * s.bias_sigma_m_s2 / (g * math.cos(static))
    sine = 1 / math.sqrt(2)
    skew = float(skew_error_peak(radii[0], radii[-1], s.time_skew_s, f, dynamic, g)) if radii[0] != radii[-1] else 0.0
    parts: Mapping[str, float] = {
        "noise": motion.pair_sigma,
        "radii": float(lever_error_peak(lever, f, dynamic, g)) * sine,
        "bias": bias,
        "time_skew": skew * sine,
        "sway": float(sway_error_peak(s.sway_m, f, g)) * sine,
        "gravity": abs(float(gravity_error(static, s.gravity_sigma_m_s2 / g))),
    }
    found = []
    for name in BUDGET:
        if name == "noise":
            found.append(rows.sigma("budget_noise", "rad", parts[name], motion.pair_freedom))
        else:
            found.append(
                rows.plain(f"budget_{name}", "rad", parts[name], math.nan, math.nan, math.nan, "from-tolerance")
            )
    low, high = (float(v) for v in sigma_interval(motion.pair_sigma, motion.pair_freedom, rows.confidence))
    rest = math.hypot(*(v for k, v in parts.items() if k != "noise"))
    found.append(rows.plain(
        "budget_total", "rad", math.hypot(*parts.values()), math.hypot(low, rest), math.hypot(high, rest),
        motion.pair_freedom, "from-tolerance",
    ))  # fmt: skip
    return found
