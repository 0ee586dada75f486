"""The motion of one axis: static tilt, oscillation, noise, and what each method makes of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv, stdtrit

from rangeeval.analyses.attitude.gathering import Gathered
from rangeeval.analyses.attitude.setup import Setup, positions_of
from rangeeval.physics.attitude import Heights, height_weights, radii_from_oscillation, tilt
from rangeeval.stats.spectrum import SineFit, frequency_error, sine_fit, spectral_peak

Array = NDArray[np.float64]

CYCLES = 20  # of oscillation in a segment
SEGMENTS = 64
ENOUGH_SEGMENTS = 6
CHANCE = 0.001  # how often noise alone may pass for an oscillation


@dataclass(frozen=True)
class Measured:
    """A number with its standard error, degrees of freedom, and how many samples it counts as."""

    value: float
    error: float = math.nan
    freedom: float = math.inf
    n_eff: float = math.nan

    def interval(self, confidence: float) -> tuple[float, float]:
        """Two-sided interval, Student's t."""
        if not (math.isfinite(self.value) and math.isfinite(self.error) and self.freedom > 0):
            return math.nan, math.nan
        half = float(stdtrit(min(self.freedom, 1e9), 0.5 + confidence / 2)) * self.error
        return self.value - half, self.value + half


NOTHING = Measured(math.nan)


@dataclass(frozen=True)
class Radii:
    """The radii of an axis's sensors (m), their standard errors, and whether they came from the motion itself."""

    values: tuple[float, ...]
    errors: tuple[float, ...]
    from_motion: bool = False


@dataclass(frozen=True)
class Motion:
    """What is known of one axis. `alpha`, `single`: tilt over the block means (rad) by all sensors, and by one."""

    axis: str
    sensors: tuple[str, ...]
    radii: Radii | None
    calibrated: Radii | None
    heights: Heights | None
    alpha: Array
    single: Array
    single_sensor: str
    frequency: Measured
    static: Measured
    dynamic: Measured
    acceleration: Measured
    largest_acceleration: float
    pair_sigma: float
    pair_freedom: float
    sensor_sigma: tuple[float, ...]
    sensor_freedom: tuple[float, ...]
    skew: Measured
    misfit: Measured
    coherence: float
    flags: tuple[str, ...]
    noise_limit: float = math.nan
    static_segments: tuple[tuple[int, int], ...] = ()

    @property
    def single_index(self) -> int:
        """Which of its sensors stands for the single-sensor method."""
        return self.sensors.index(self.single_sensor)


def motion_of(axis: str, setup: Setup, gathered: Gathered, other_tilt: Array | None) -> Motion | None:
    """Everything about one axis; None when no sensor reads it. `other_tilt`: pitch, when roll is asked for."""
    rows = setup.of_axis(axis)
    if not rows:
        return None
    sensors, forces = setup.sensors(axis), gathered.forces[rows]
    g = setup.gravity * (np.cos(other_tilt) if other_tilt is not None else 1.0)
    g = np.where(np.isfinite(g), g, setup.gravity)
    flags: list[str] = []
    radii = _surveyed(setup, axis)
    heights = height_weights(radii.values) if radii and len(sensors) > 1 else None
    # Each channel shows the oscillation before any radius is needed; the angular acceleration where the channels' tilt
    # and swing cancel.
    found = _oscillation(gathered, [*forces, heights.slope @ forces] if heights is not None else list(forces))
    calibrated = _calibrated(setup, axis, gathered, forces, found)
    if radii is None and calibrated is not None and len(sensors) > 1:
        radii = calibrated
        flags.append("calibrated")
        heights = height_weights(radii.values)
    single_sensor = setup.single if setup.single in sensors else sensors[0]
    force_single = forces[sensors.index(single_sensor)]
    single = tilt(force_single, g)
    if heights is not None:
        centre, slope = heights.centre @ forces, heights.slope @ forces
        alpha = tilt(centre, g)
    else:
        centre, slope, alpha = force_single, None, single
        flags.append("one-sensor" if len(sensors) == 1 else "no-radii")
    motion = _fits(axis, gathered, alpha, slope, found, flags)
    if heights is None:
        motion = _from_one_sensor(motion, setup, radii, sensors.index(single_sensor))
    weights = heights.centre if heights is not None else np.eye(len(sensors))[sensors.index(single_sensor)]
    mean_g = float(np.mean(g)) if np.ndim(g) else float(g)
    pair_sigma, pair_freedom = _noise(gathered, axis, weights, found, centre)
    scale = mean_g * math.cos(motion.static.value) if math.isfinite(motion.static.value) else mean_g
    noises = [_noise(gathered, axis, unit, found, forces[i]) for i, unit in enumerate(np.eye(len(sensors)))]
    _quality(gathered, setup, axis, rows, flags)
    skew = _skew(gathered, forces, found) if len(sensors) > 1 else NOTHING
    if math.isfinite(skew.error) and abs(skew.value) > 4 * skew.error and abs(skew.value) > 2e-4:
        flags.append("clocks-differ")
    misfit = _misfit(gathered, radii, forces, found) if radii and len(sensors) > 2 else NOTHING
    if math.isfinite(misfit.error) and misfit.value > 4 * misfit.error:
        flags.append("not-rigid")
    return Motion(
        axis, sensors, radii, calibrated, heights, alpha, single, single_sensor, motion.frequency, motion.static,
        motion.dynamic, motion.acceleration, motion.largest, pair_sigma / scale, pair_freedom,
        tuple(s for s, _ in noises), tuple(f for _, f in noises), skew, misfit,
        _coherence(gathered, axis, found), tuple(dict.fromkeys([*flags, *motion.flags])), motion.noise_limit,
        motion.resting,
    )  # fmt: skip


# --- the oscillation --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Oscillation:
    """Its frequency (NaN when none stands out of the noise), with its standard error."""

    frequency_hz: float
    error_hz: float
    signal_to_noise: float
    series: int


def _longest(gathered: Gathered) -> slice:
    edges = np.flatnonzero(np.diff(gathered.stretch)) + 1
    starts = np.concatenate([[0], edges])
    stops = np.concatenate([edges, [gathered.stretch.size]])
    k = int(np.argmax(stops - starts))
    return slice(int(starts[k]), int(stops[k]))


def _oscillation(gathered: Gathered, series: Sequence[Array]) -> _Oscillation:
    """The strongest oscillation in any of the series, if it could not be noise."""
    where, step = _longest(gathered), gathered.interval_s * gathered.block
    best = _Oscillation(math.nan, math.nan, 0.0, 0)
    for k, values in enumerate(series):
        x, t = values[where], gathered.time_s[where]
        use = np.isfinite(x)
        n = int(use.sum())
        if n < 32 or use.mean() < 0.5:
            continue
        x = np.where(use, x, x[use].mean())
        frequency = spectral_peak(x, step, low_hz=4 / (x.size * step))
        if not math.isfinite(frequency):
            continue
        fit = sine_fit(t, x, frequency)
        sigma = math.sqrt(fit.left / max(n - 4, 1))
        ratio = fit.amplitude**2 * n / (4 * sigma**2) if sigma > 0 else math.inf
        # A record whose low end wanders has its own high lines there; they are no oscillation.
        if ratio > math.log(n / 2 / CHANCE) and ratio > best.signal_to_noise and frequency < 0.5 / step:
            best = _Oscillation(frequency, frequency_error(fit.amplitude, sigma, n, step), ratio, k)
    return best


@dataclass(frozen=True)
class _Fitted:
    frequency: Measured
    static: Measured
    dynamic: Measured
    acceleration: Measured
    largest: float
    flags: tuple[str, ...]
    noise_limit: float
    resting: tuple[tuple[int, int], ...]


def _fits(
    axis: str, gathered: Gathered, alpha: Array, slope: Array | None, found: _Oscillation, flags: list[str]
) -> _Fitted:
    """Sine fits over segments of `CYCLES` cycles or more: their scatter carries wander into the intervals."""
    t = gathered.time_s
    n = int(np.isfinite(alpha).sum())
    extra: list[str] = []
    if n < 8:
        return _Fitted(NOTHING, NOTHING, NOTHING, NOTHING, math.nan, ("few-samples",), math.nan, ())
    if not math.isfinite(found.frequency_hz):
        return _at_rest(gathered, alpha, n)
    f = found.frequency_hz
    duration = gathered.samples * gathered.interval_s
    count = int(np.clip(duration * f / CYCLES, 1, SEGMENTS))
    parts = np.array_split(np.arange(t.size), count)
    fits = [fit for part in parts if (fit := _fit(t[part], alpha[part], f))]
    if not fits:
        return _Fitted(NOTHING, NOTHING, NOTHING, NOTHING, math.nan, ("few-samples",), math.nan, ())
    static = _mean_of([x.offset for x in fits], [x.offset_error for x in fits], n)
    dynamic, varies = _amplitude(fits, n)
    acceleration, largest = NOTHING, math.nan
    if slope is not None:
        turned = [fit for part in parts if (fit := _fit(t[part], slope[part], f))]
        acceleration, faster = _amplitude(turned, n)
        varies = varies or faster
        largest = max(x.amplitude for x in turned) if varies else acceleration.value
    dynamic, acceleration, largest = _unblocked(gathered, f, dynamic, acceleration, largest)
    frequency_error_hz = found.error_hz
    if varies:
        extra.append("amplitude-varies")
        step = gathered.interval_s * gathered.block
        series = slope if slope is not None else alpha
        each = [
            spectral_peak(v[np.isfinite(v)], step, 0.5 * f, 1.5 * f) for part in parts if (v := series[part]).size >= 32
        ]
        each = [v for v in each if math.isfinite(v)]
        if len(each) >= 3:
            frequency_error_hz = max(frequency_error_hz, float(np.std(each, ddof=1)) / math.sqrt(len(each)))
    frequency = Measured(f, frequency_error_hz, math.inf, float(n))
    return _Fitted(frequency, static, dynamic, acceleration, largest, tuple(extra), math.nan, ())


def _unblocked(
    gathered: Gathered, f: float, dynamic: Measured, acceleration: Measured, largest: float
) -> tuple[Measured, Measured, float]:
    """Amplitudes with what block means take off them given back: sin(pi f B dt) / (B sin(pi f dt))."""
    if gathered.block == 1:
        return dynamic, acceleration, largest
    x = math.pi * f * gathered.interval_s
    gain = gathered.block * math.sin(x) / math.sin(gathered.block * x)
    back = [replace(m, value=m.value * gain, error=m.error * gain) for m in (dynamic, acceleration)]
    return back[0], back[1], largest * gain


def _at_rest(gathered: Gathered, alpha: Array, n: int) -> _Fitted:
    """No oscillation: the mean, with the scatter of batches, and what amplitude could have hidden in the noise."""
    batches = [float(np.nanmean(b)) for b in np.array_split(alpha, 16) if np.isfinite(b).any()]
    sigma = float(np.nanstd(alpha, ddof=1))
    white = sigma / math.sqrt(n)
    between = float(np.std(batches, ddof=1)) / math.sqrt(len(batches)) if len(batches) > 2 else 0.0
    error = max(white, between)
    n_eff = min(float(n), (sigma / error) ** 2) if error > 0 else float(n)
    static = Measured(float(np.nanmean(alpha)), error, len(batches) - 1 if between > white else n - 1, n_eff)
    limit = 2 * sigma * math.sqrt(math.log(n / 2 / CHANCE) / n)
    whole = ((0, alpha.size),)
    return _Fitted(NOTHING, static, NOTHING, NOTHING, math.nan, ("no-oscillation",), limit, whole)


def _fit(t: Array, x: Array, f: float) -> SineFit | None:
    return sine_fit(t, x, f) if np.isfinite(x).sum() >= 8 else None


def _mean_of(values: Sequence[float], errors: Sequence[float], n: int) -> Measured:
    """The mean over segments; its error the larger of what noise alone gives and what the segments scatter."""
    k = len(values)
    white = math.sqrt(sum(e * e for e in errors)) / k
    if k < ENOUGH_SEGMENTS:
        return Measured(float(np.mean(values)), white, max(n - 3, 1), float(n))
    d = np.asarray(values) - np.mean(values)
    scatter = float(d @ d) / (k - 1)
    lag_one = float(d[1:] @ d[:-1] / (d @ d)) if scatter > 0 else 0.0
    inflation = (1 + max(lag_one, 0.0)) / (1 - min(max(lag_one, 0.0), 0.9))
    between = math.sqrt(scatter * inflation / k)
    freedom = max(k / inflation - 1, 1.0)
    if between <= white:
        return Measured(float(np.mean(values)), white, freedom, float(n))
    return Measured(float(np.mean(values)), between, freedom, float(n) * (white / between) ** 2 if white > 0 else k)


def _amplitude(fits: Sequence[SineFit], n: int) -> tuple[Measured, bool]:
    """Root mean square of the segments' amplitudes, noise taken off, and whether they differ by more than noise."""
    squares = np.array([x.amplitude**2 - 2 * x.amplitude_error**2 for x in fits])
    errors = np.array([2 * x.amplitude * x.amplitude_error for x in fits])
    mean = _mean_of(squares.tolist(), errors.tolist(), n)
    if not mean.value > 0:
        return Measured(math.nan, n_eff=mean.n_eff), False
    root = math.sqrt(mean.value)
    amplitudes = np.array([x.amplitude for x in fits])
    noise = np.array([x.amplitude_error for x in fits])
    varies = False
    if len(fits) > 1 and (noise > 0).all():
        chi = float(np.sum((amplitudes - amplitudes.mean()) ** 2 / noise**2))
        # Noise-free records differ in the last digit: what does not matter is not called varying.
        varies = (
            bool(chi > 2 * gammaincinv((len(fits) - 1) / 2, 1 - CHANCE)) and float(np.ptp(amplitudes)) > 0.02 * root
        )
    return Measured(root, mean.error / (2 * root), mean.freedom, mean.n_eff), varies


def _from_one_sensor(found: _Fitted, setup: Setup, radii: Radii | None, index: int) -> _Fitted:
    """One accelerometer reads (g - R w^2) alpha_d: with its radius known the oscillation follows, without it nothing
    does.
    """
    seen = found.dynamic
    if radii is None or not math.isfinite(seen.value):
        return _Fitted(
            found.frequency, found.static, NOTHING, NOTHING, math.nan, found.flags, found.noise_limit, found.resting
        )
    w2 = (2 * math.pi * found.frequency.value) ** 2
    shrink = abs(1 - radii.values[index] * w2 / (setup.gravity * math.cos(found.static.value)))
    if shrink < 0.05:  # the sensor stands where swing and tilt cancel: it sees nothing of this motion
        return _Fitted(
            found.frequency,
            found.static,
            NOTHING,
            NOTHING,
            math.nan,
            (*found.flags, "unobservable"),
            found.noise_limit,
            found.resting,
        )
    dynamic = Measured(seen.value / shrink, seen.error / shrink, seen.freedom, seen.n_eff)
    swing = Measured(dynamic.value * w2, dynamic.error * w2, dynamic.freedom, dynamic.n_eff)
    return _Fitted(
        found.frequency,
        found.static,
        dynamic,
        swing,
        swing.value,
        (*found.flags, "assumes-sine"),
        found.noise_limit,
        found.resting,
    )


# --- radii ------------------------------------------------------------------------------------------------------------


def _surveyed(setup: Setup, axis: str) -> Radii | None:
    known = setup.radii_of(axis)
    return None if known is None else Radii(tuple(known), (setup.settings.radius_sigma_m,) * len(known))


def _calibrated(setup: Setup, axis: str, gathered: Gathered, forces: Array, found: _Oscillation) -> Radii | None:
    """Radii from the oscillation itself: where along the line of sensors its amplitude would vanish."""
    positions = positions_of(setup, axis)
    if positions is None or len(positions) < 2 or not math.isfinite(found.frequency_hz) or np.ptp(positions) == 0:
        return None
    fits = _phased(gathered, forces, found.frequency_hz)
    if fits is None:
        return None
    amplitudes, errors, offsets = fits
    static = float(np.mean(offsets)) / setup.gravity
    if abs(static) >= 1:
        return None

    def radii(a: Array) -> Array:
        return radii_from_oscillation(a, positions, found.frequency_hz, math.asin(static), setup.gravity)

    try:
        values = radii(amplitudes)
        parts = [
            (radii(amplitudes + e * unit) - values) ** 2 for e, unit in zip(errors, np.eye(len(errors)), strict=True)
        ]
    except ValueError:
        return None
    by_frequency = 2 * setup.gravity / (2 * math.pi * found.frequency_hz) ** 2 * found.error_hz / found.frequency_hz
    spread = np.sqrt(np.sum(parts, axis=0) + by_frequency**2)
    if not np.isfinite(spread).all() or float(spread.max()) > 10 * max(float(np.ptp(positions)), 1.0):
        return None
    return Radii(tuple(values.tolist()), tuple(spread.tolist()), from_motion=True)


def _phased(gathered: Gathered, forces: Array, f: float) -> tuple[Array, Array, Array] | None:
    """Signed amplitudes of the channels in the phase of the strongest, their errors, and the offsets."""
    fits = [_fit(gathered.time_s, x, f) for x in forces]
    if any(x is None for x in fits):
        return None
    some = [x for x in fits if x is not None]
    lead = max(some, key=lambda x: x.amplitude).phase
    amplitudes = np.array([x.amplitude * math.cos(x.phase - lead) for x in some])
    return amplitudes, np.array([x.amplitude_error for x in some]), np.array([x.offset for x in some])


# --- noise and faults -------------------------------------------------------------------------------------------------


def _noise(gathered: Gathered, axis: str, weights: Array, found: _Oscillation, series: Array) -> tuple[float, float]:
    """Sigma per sample (m/s^2) of a weighted sum of channels from the floor of its spectrum, and its degrees of
    freedom.
    """
    spectra = gathered.spectra[axis]
    nyquist = 0.5 / gathered.interval_s
    low = (
        2 * found.frequency_hz if math.isfinite(found.frequency_hz) and 2 * found.frequency_hz < 0.5 * nyquist else 0.0
    )
    if spectra.segments >= 2:
        level, freedom = spectra.floor(weights, low)
        if math.isfinite(level):
            return math.sqrt(level / (2 * gathered.interval_s)), freedom
    use = np.isfinite(series)
    if use.sum() < 8:
        return math.nan, math.nan
    if math.isfinite(found.frequency_hz):
        fit = sine_fit(gathered.time_s, series, found.frequency_hz)
        return math.sqrt(fit.left / max(fit.n - 4, 1) * gathered.block), max(fit.n - 4, 1)
    return float(np.nanstd(series, ddof=1)) * math.sqrt(gathered.block), float(use.sum() - 1)


def _quality(gathered: Gathered, setup: Setup, axis: str, rows: Sequence[int], flags: list[str]) -> None:
    total = max(gathered.samples, 1)
    if any(gathered.saturated[r] for r in rows):
        flags.append("saturated")
    if any(gathered.stuck[r] for r in rows):
        flags.append("stuck-sensor")
    beyond = gathered.beyond[axis] if len(rows) > 1 else gathered.beyond_channel[rows[0]]
    if beyond:
        flags.append("beyond-g")
    if beyond > 0.001 * total:
        flags.append("unusable")
    if gathered.counts["gaps"]:
        flags.append("gaps")
    if gathered.counts["clock_steps"]:
        flags.append("clock-step")


def _skew(gathered: Gathered, forces: Array, found: _Oscillation) -> Measured:
    """By how much the last sensor's samples are late against the first's (s), from their phases in the oscillation.

    A rigid body turns its sensors in phase or in opposition: any other phase is time, or a body that bends.
    """
    f = found.frequency_hz
    if not math.isfinite(f):
        return NOTHING
    first, last = _fit(gathered.time_s, forces[0], f), _fit(gathered.time_s, forces[-1], f)
    if first is None or last is None or min(first.amplitude, last.amplitude) <= 0:
        return NOTHING
    relative = [x.amplitude_error / x.amplitude for x in (first, last)]
    if max(relative) > 0.2:
        return NOTHING
    lag = math.remainder(first.phase - last.phase, math.pi)
    return Measured(
        lag / (2 * math.pi * f), math.hypot(*relative) / (2 * math.pi * f), max(first.n - 4, 1), float(first.n)
    )


def _misfit(gathered: Gathered, radii: Radii, forces: Array, found: _Oscillation) -> Measured:
    """Amplitude (m/s^2) of what three sensors or more read off a straight line over radii: zero for a rigid body."""
    if not math.isfinite(found.frequency_hz):
        return NOTHING
    r = np.asarray(radii.values)
    line = height_weights(radii.values)
    rest = forces - (line.centre @ forces)[None] - r[:, None] * (line.slope @ forces)[None]
    fits = [x for x in (_fit(gathered.time_s, row, found.frequency_hz) for row in rest) if x is not None]
    if not fits:
        return NOTHING
    worst = max(fits, key=lambda x: x.amplitude)
    return Measured(worst.amplitude, worst.amplitude_error, max(worst.n - 4, 1), float(worst.n))


def _coherence(gathered: Gathered, axis: str, found: _Oscillation) -> float:
    spectra = gathered.spectra[axis]
    if spectra.channels < 2 or spectra.segments < 3 or not math.isfinite(found.frequency_hz):
        return math.nan
    k = int(np.argmin(np.abs(spectra.frequency_hz - found.frequency_hz)))
    return float(spectra.coherence(0, spectra.channels - 1)[k])
