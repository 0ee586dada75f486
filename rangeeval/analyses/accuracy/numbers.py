"""From the cells to the estimates: sigma, its interval, the bracket, the tests and the flags of every bin."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from rangeeval.analyses.accuracy.gathering import Axis, Gathered, Place
from rangeeval.model import Bins, Estimate
from rangeeval.model.settings import Radar
from rangeeval.physics.measurement import angle_sigma, filtered_sigma, range_sigma, snr_from_db, snr_to_db
from rangeeval.stats import cells as c
from rangeeval.stats.cells import Cell
from rangeeval.stats.clusters import cluster_excess
from rangeeval.stats.correlation import LagSums, MeanMemory, effective_samples_from, ljung_box, mean_memory
from rangeeval.stats.diagnostics import (
    MAD_TO_SIGMA,
    gate_truncation_factor,
    jarque_bera_from_moments,
    mean_t_test,
    shapiro_wilk,
    spearman,
)
from rangeeval.stats.intervals import degrees_of_freedom, mean_interval, sigma_interval, variance_ratio_interval
from rangeeval.stats.variance import angle_sigma_with_range_noise, range_leak, sigma_to_angle
from rangeeval.tracking.alpha_beta import (
    bracket_factors,
    lag_one_correlation_cv,
    q_cv,
    rms_with_lag,
    variances_from_autocovariance,
)

Array = NDArray[np.float64]

# Thresholds of the flags. A test that fires once in a thousand bins of a sound trial cries wolf about once a report.
TEST_LEVEL = 0.001
GAINS_VARY = 0.02
ROBUST_DIFFERS = 0.2
ROBUST_SCATTER = 2.3  # over sqrt(n): 2.5 standard deviations of s / robust s - 1 for normal samples
GRAZING_COSINE = 0.1
LEAK = 0.3
ALIKE = 2.33  # one-sided 1 %: manoeuvre beyond the gains' design is where intervals under-cover, so be told early
OWN_BIN_CORRELATION = 100  # samples; bins with fewer borrow the correlation of all bins of their group
OWN_VARIANCES = 1000
SHAPIRO_BELOW = 100
TRACKS_DIFFER = 0.05  # level of the test
FEW_A_TRACK = 5.0  # degrees of freedom a track, and updates that each lasts: the tracks then tell more than its samples
UNEVEN_WEIGHTS = 1.01  # mean square of the weights over their squared mean
MAD_EFFICIENCY = 0.3675  # of the median absolute deviation against the standard deviation, for normal samples


@dataclass(frozen=True)
class Method:
    """The choices that turn sums into numbers."""

    bins: Bins
    confidence: float
    paper: bool
    radar: Radar

    @property
    def ungated(self) -> float:
        """What an association gate of known width took from a sigma, as a factor to give it back (1 without one)."""
        gate = self.radar.association_gate_sigmas
        return 1.0 if gate is None or self.paper else float(gate_truncation_factor(gate)) ** -0.5


@dataclass(frozen=True)
class Memory:
    """What the samples' correlation makes of their number."""

    rho: Array
    n_eff: float
    mean: MeanMemory


@dataclass(frozen=True)
class Here:
    """One axis in one place: its cell, what was made of it, and how a row about it is written."""

    axis: Axis
    cell: Cell
    place: Place
    method: Method
    memory: Memory
    sigmas: Sigmas
    p_values: Mapping[str, float]
    flags: tuple[str, ...]
    freedom: Freedom

    def row(
        self,
        quantity: str,
        unit: str,
        value: float,
        interval: tuple[float, float] = (math.nan, math.nan),
        **extra: float,
    ) -> Estimate:
        """A row with the interval given, or none."""
        low, high = self.method.bins.edges(self.place.bin)
        return Estimate(
            quantity=quantity,
            unit=unit,
            value=value,
            low=interval[0],
            high=interval[1],
            n=self.cell.n,
            n_eff=self.memory.n_eff,
            variable=self.method.bins.variable,
            bin_low=low,
            bin_high=high,
            track_id=self.place.track or None,
            group=self.place.group or None,
            flags=self.flags,
            extra=extra,
        )

    def sigma_row(self, quantity: str, unit: str, value: float, nu: float) -> Estimate:
        """A row with the chi-square interval of a sigma on `nu` degrees of freedom."""
        low, high = sigma_interval(value, nu, self.method.confidence)
        return self.row(quantity, unit, value, (float(low), float(high)), nu=nu)


@dataclass(frozen=True)
class Sigmas:
    """The sigmas of one axis in one place (m): of the residual and of the estimate, by the ratios that may hold."""

    mean: float
    residual: float
    estimate: float
    white: float
    mean_gains: float
    residual_robust: float
    alpha: float
    beta: float
    q: float


@dataclass(frozen=True)
class Freedom:
    """Degrees of freedom behind the sigmas: plain sum of squares, those weighted for track and angle, MAD."""

    residual: float
    track: float
    angle: float
    robust: float


def _memory(cell: Cell, shared: LagSums | None) -> Memory:
    """Effective number of samples: from the bin's own correlation, or from `shared` where the bin holds too few."""
    n, own = cell.n, cell.lag_sums()
    if n < 2 or not own.products[0] > 0:
        return Memory(np.array([1.0]), float(n), MeanMemory(1.0, max(n - 1.0, 1.0)))
    known = shared if n < OWN_BIN_CORRELATION else None
    return Memory(own.autocorrelation(), effective_samples_from(own, known), _mean_of_tracks(cell, mean_memory(own)))


def _mean_of_tracks(cell: Cell, memory: MeanMemory) -> MeanMemory:
    """The memory of a mean; where tracks differ by more than their samples explain, the tracks count as the samples."""
    values = cell.kept[c.VALUE]
    expected = values.size * memory.inflation * float(cell.sums[c.M2]) / (cell.n - 1)
    excess = cluster_excess(values, cell.kept[c.TRACK], expected, TRACKS_DIFFER)
    return MeanMemory(memory.inflation * excess.ratio, min(memory.dof, excess.dof))


def _shared_correlations(cells: Mapping[Place, Cell]) -> dict[tuple[str, str], LagSums]:
    """The lag sums of all bins of a group, track or all together, every bin on the scale of its own variance."""
    totals: dict[tuple[str, str], LagSums] = {}
    for place, cell in cells.items():
        sums = cell.lag_sums()
        if cell.n < 2 or not sums.products[0] > 0:
            continue
        key, scaled = (place.track, place.group), sums.standardised()
        totals[key] = totals[key].merge(scaled) if key in totals else scaled
    return totals


def _freedom(cell: Cell, memory: Memory, sigmas: Sigmas, flags: tuple[str, ...], *, paper: bool) -> Freedom:
    """Fewer degrees of freedom where tails are heavy, where a few samples carry a sum of squares, where tracks differ.

    The angle of a close target weighs a sample with 1 / R^2; gains, SNR and range that change inside a bin do the like.
    The kurtosis of the weighted samples says how much, and is believed where something says that they are uneven; their
    memory is then that of the weighted samples too. Where tracks differ by more than their samples explain (another
    path past the radar), the tracks count, and always where targets manoeuvre or a track is hardly more than a sample.
    """
    n, s = cell.n, cell.sums
    if n < 2:
        return Freedom(*[math.nan] * 4)
    plain = float(jarque_bera_from_moments(n, s[c.M2], s[c.M3], s[c.M4]).kurtosis)
    heavy, manoeuvres = "not-normal" in flags, "manoeuvre" in flags
    tracks = np.unique(cell.kept[c.TRACK]).size
    varies = not {"snr-varies", "range-varies"}.isdisjoint(flags)
    mean = 0.0 if paper else sigmas.mean

    def freedom(kurtosis: float, squares: Array, n_eff: float, *, uneven: bool) -> float:
        nu = _positive(float(degrees_of_freedom(n_eff)))
        if heavy and kurtosis > 3.0:
            nu = _positive(float(degrees_of_freedom(n_eff, kurtosis=kurtosis)))
        elif uneven and kurtosis > 3.0:
            # The kurtosis of n samples is at most n, and falls short the more the nearer it comes to that.
            nu *= 3.0 / (kurtosis * (1.0 + kurtosis / n))
        expected = 2.0 * float(squares.sum()) ** 2 * n / (nu * squares.size)
        lasting = nu < FEW_A_TRACK * tracks and n_eff < n / FEW_A_TRACK
        level = 1.0 if manoeuvres or lasting else TRACKS_DIFFER
        return nu / cluster_excess(squares, cell.kept[c.TRACK], expected, level).allowance

    def weighted(row: int) -> float:
        spread = cell.weight_spread(row) > UNEVEN_WEIGHTS
        own = spread and cell.exact and n >= OWN_BIN_CORRELATION
        n_eff = effective_samples_from(cell.weighted_lag_sums(row, mean)) if own else memory.n_eff
        return freedom(cell.weighted_kurtosis(row, mean), cell.squares(row, mean), n_eff, uneven=varies or spread)

    return Freedom(
        freedom(plain, (cell.kept[c.VALUE] - mean) ** 2, memory.n_eff, uneven=varies),
        weighted(c.WEIGHT),
        weighted(c.ANGLE_WEIGHT),
        _positive(MAD_EFFICIENCY * float(degrees_of_freedom(memory.n_eff))),
    )


def _positive(nu: float) -> float:
    return nu if nu > 0 else math.nan


def bin_estimates(gathered: Gathered, method: Method) -> Iterator[Estimate]:
    """Every quantity in every bin: for each quantity and bin all samples together first, then groups, then tracks."""
    found: dict[str, dict[Place, Estimate]] = {}
    shared = {axis.name: _shared_correlations(gathered.cells[axis.name]) for axis in gathered.axes}
    places = sorted({p for of_axis in gathered.cells.values() for p in of_axis})
    for place in places:
        sigma_range = math.nan
        for axis in gathered.axes:
            here = _here(axis, gathered.cells[axis.name][place], place, shared[axis.name], method, sigma_range)
            rows = _axis_rows(here)
            if axis.angle is None:
                sigma_range = here.sigmas.estimate
                rows += _range_rows(here)
            else:
                rows += _angle_rows(here, axis.angle, sigma_range)
            for estimate in rows:
                found.setdefault(estimate.quantity, {})[place] = estimate
    order = sorted(places, key=lambda p: (p.bin, bool(p.track), bool(p.group), p.group, p.track))
    for of_place in found.values():
        for place in order:
            if place in of_place:
                yield of_place[place]


def _here(
    axis: Axis, cell: Cell, place: Place, shared: Mapping[tuple[str, str], LagSums], method: Method, sigma_range: float
) -> Here:
    memory = _memory(cell, shared.get((place.track, place.group)))
    sigmas = _sigmas(cell, method)
    p_values = _p_values(cell, memory, sigmas)
    flags = _flags(axis, cell, memory, sigmas, p_values, sigma_range, method)
    freedom = _freedom(cell, memory, sigmas, flags, paper=method.paper)
    return Here(axis, cell, place, method, memory, sigmas, p_values, flags, freedom)


def _root(squares: float, n: int) -> float:
    return math.sqrt(max(squares, 0.0) / (n - 1)) if n > 1 else math.nan


def _sigmas(cell: Cell, method: Method) -> Sigmas:
    n, s = cell.n, cell.sums
    mean = float(s[c.MEAN]) if n else math.nan
    alpha, beta = cell.mean_of(c.SUM_ALPHA), cell.mean_of(c.SUM_BETA)
    q = float(q_cv(alpha, beta))
    residual = method.ungated * _root(float(s[c.M2]) + (n * mean * mean if method.paper and n else 0.0), n)
    mean_gains = residual * math.sqrt(q) if n > 1 else math.nan
    if method.paper:
        estimate, white = mean_gains, residual * math.sqrt(max(alpha * (1.0 - alpha), 0.0)) if n > 1 else math.nan
    else:
        estimate, white = (method.ungated * _root(cell.centred(first, mean), n) for first in (c.Q0, c.W0))
    robust = MAD_TO_SIGMA * cell.median_absolute_deviation() if n > 1 else math.nan
    return Sigmas(mean, residual, estimate, white, mean_gains, robust, alpha, beta, q)


def _p_values(cell: Cell, memory: Memory, sigmas: Sigmas) -> dict[str, float]:
    """p values of the tests on one bin: no bias, white, normal, and one variance over SNR and over range."""
    n, s = cell.n, cell.sums
    if n < 2 or not s[c.M2] > 0:
        return dict.fromkeys(("bias", "whiteness", "normality", "snr_homogeneity", "range_homogeneity"), math.nan)
    covariances, pairs = cell.covariances()
    rho = covariances / covariances[0]
    spread = math.sqrt(s[c.M2] / (n - 1))
    small = n < SHAPIRO_BELOW and cell.exact
    normality = (
        shapiro_wilk(cell.kept[c.VALUE]).p_value
        if small
        else jarque_bera_from_moments(n, s[c.M2], s[c.M3], s[c.M4]).p_value
    )
    size = np.abs(cell.kept[c.VALUE] - sigmas.mean)
    return {
        "bias": mean_t_test(n, sigmas.mean, spread, memory.mean.inflation, memory.mean.dof).p_value,
        "whiteness": ljung_box(rho, n, 10, pairs).p_value if s[c.LONGEST] > 10 and n > 20 else math.nan,
        "normality": float(normality),
        "snr_homogeneity": spearman(size, cell.kept[c.SNR]).p_value if s[c.N_SNR] else math.nan,
        "range_homogeneity": spearman(size, cell.kept[c.RANGE]).p_value,
    }


def _flags(
    axis: Axis,
    cell: Cell,
    memory: Memory,
    sigmas: Sigmas,
    p: Mapping[str, float],
    sigma_range: float,
    method: Method,
) -> tuple[str, ...]:
    n, s = cell.n, cell.sums
    flags: list[str] = []
    if n < max(method.bins.min_samples, 2):
        flags.append("few-samples")
    if n < 2:
        return tuple(flags)
    if p["whiteness"] < TEST_LEVEL:
        flags.append("correlated")
    if len(memory.rho) > 1 and memory.rho[1] > ALIKE / math.sqrt(n):
        flags.append("manoeuvre")
    if p["bias"] < TEST_LEVEL:
        flags.append("biased")
    if p["normality"] < TEST_LEVEL:
        flags.append("not-normal")
    differs = max(ROBUST_DIFFERS, ROBUST_SCATTER / math.sqrt(n))
    if sigmas.residual_robust > 0 and abs(sigmas.residual / sigmas.residual_robust - 1.0) > differs:
        flags.append("outliers")
    per_sample = method.ungated * _root(cell.centred(c.Q0, 0.0 if method.paper else sigmas.mean), n)
    if per_sample > 0 and abs(sigmas.mean_gains / per_sample - 1.0) > GAINS_VARY:
        flags.append("gains-vary")
    if p["snr_homogeneity"] < TEST_LEVEL:
        flags.append("snr-varies")
    if p["range_homogeneity"] < TEST_LEVEL:
        flags.append("range-varies")
    if s[c.N_STARTUP] > n:
        flags.append("steady-state")
    if axis.angle is not None:
        flags += _angle_flags(cell, sigmas, sigma_range)
    return tuple(flags)


def _angle_flags(cell: Cell, sigmas: Sigmas, sigma_range: float) -> list[str]:
    mean_range, mean_cross = cell.mean_of(c.SUM_R), cell.mean_of(c.SUM_C)
    sigma_angle, cosine = (float(v) for v in sigma_to_angle(sigmas.estimate, mean_range, mean_cross))
    if not math.isfinite(sigma_angle):
        return ["unobservable"]
    flags = ["grazing"] if cosine < GRAZING_COSINE or cell.sums[c.N_BEYOND] else []
    if float(range_leak(sigma_range, sigma_angle, mean_range, mean_cross)) > LEAK:
        flags.append("range-leak")
    return flags


def _axis_rows(here: Here) -> list[Estimate]:
    """What residuals and gains say of one axis, in metres."""
    a, cell, sigmas, row, sigma_row = here.axis.name, here.cell, here.sigmas, here.row, here.sigma_row
    s, some = cell.sums, cell.n > 0
    kurtosis = jarque_bera_from_moments(cell.n, s[c.M2], s[c.M3], s[c.M4])
    low, high = (float(v) for v in bracket_factors(sigmas.alpha))
    spread = _root(float(s[c.M2]), cell.n)
    memory, nu = here.memory.mean, here.freedom
    ends = mean_interval(sigmas.mean, spread, cell.n, memory.inflation, here.method.confidence, memory.dof)
    return [
        sigma_row(f"{a}_sigma", "m", sigmas.estimate, nu.track),
        sigma_row(f"{a}_sigma_white", "m", sigmas.white, nu.track),
        sigma_row(f"{a}_sigma_bracket_low", "m", low * sigmas.residual, nu.residual),
        sigma_row(f"{a}_sigma_bracket_high", "m", high * sigmas.residual, nu.residual),
        row(f"{a}_rms_with_lag", "m", float(rms_with_lag(sigmas.estimate, sigmas.mean, sigmas.alpha))),
        sigma_row(f"{a}_sigma_mean_gains", "m", sigmas.mean_gains, nu.residual),
        sigma_row(f"{a}_sigma_robust", "m", sigmas.residual_robust * math.sqrt(sigmas.q), nu.robust),
        sigma_row(f"{a}_residual_sigma", "m", sigmas.residual, nu.residual),
        sigma_row(f"{a}_residual_sigma_robust", "m", sigmas.residual_robust, nu.robust),
        row(f"{a}_residual_mean", "m", sigmas.mean, (float(ends[0]), float(ends[1])), nu=memory.dof),
        row(f"{a}_residual_min", "m", float(s[c.MIN_X]) if some else math.nan),
        row(f"{a}_residual_max", "m", float(s[c.MAX_X]) if some else math.nan),
        row(f"{a}_residual_skewness", "1", float(kurtosis.skewness)),
        row(f"{a}_residual_kurtosis", "1", float(kurtosis.kurtosis)),
        *_correlation_rows(here),
        *(row(f"{a}_{test}_p", "1", p) for test, p in here.p_values.items()),
        row(f"alpha_{a}", "1", sigmas.alpha),
        row(f"alpha_{a}_min", "1", float(s[c.MIN_ALPHA]) if some else math.nan),
        row(f"alpha_{a}_max", "1", float(s[c.MAX_ALPHA]) if some else math.nan),
        row(f"beta_{a}", "1", sigmas.beta),
    ]


def _correlation_rows(here: Here) -> list[Estimate]:
    """Lag-one correlation beside what the gains give when there is noise only, and the estimate it leads to (Mehra)."""
    a, cell, sigmas, n = here.axis.name, here.cell, here.sigmas, here.cell.n
    rho = float(here.memory.rho[1]) if len(here.memory.rho) > 1 else math.nan
    half = float(stdtrit(np.inf, 0.5 + here.method.confidence / 2)) / math.sqrt(n) if n else math.nan
    rows = [
        here.row(f"{a}_residual_correlation", "1", rho, (max(rho - half, -1.0), min(rho + half, 1.0))),
        here.row(f"{a}_residual_correlation_noise_only", "1", float(lag_one_correlation_cv(sigmas.alpha, sigmas.beta))),
    ]
    steady = cell.sums[c.MAX_ALPHA] <= 1.1 * cell.sums[c.MIN_ALPHA]
    if n >= OWN_VARIANCES and steady and len(here.memory.rho) > 2:
        c0, c1, c2 = (float(v) * sigmas.residual**2 for v in here.memory.rho[:3])
        own = float(variances_from_autocovariance(c0, c1, c2, sigmas.alpha, sigmas.beta).filtered)
        rows.append(here.row(f"{a}_sigma_autocovariance", "m", math.sqrt(own) if own > 0 else math.nan))
    return rows


def _range_rows(here: Here) -> list[Estimate]:
    """The range axis's own: mean range, SNR, and the sigma that SNR and bandwidth predict."""
    cell, radar = here.cell, here.method.radar
    rows = [here.row("range_predicted_mean", "m", cell.mean_of(c.SUM_R)), *_snr_rows(here)]
    measured = float(range_sigma(0.0, radar.bandwidth_hz)) * math.sqrt(2.0) if radar.bandwidth_hz else 0.0
    return rows + _prediction_rows(
        here, "range", "m", measured, radar.range_floor_m, here.sigmas.estimate, here.freedom.track
    )


def _snr_rows(here: Here) -> list[Estimate]:
    s, n = here.cell.sums, here.cell.sums[c.N_SNR]
    if not n:
        return []
    mean = s[c.SUM_SNR] / n
    linear = snr_from_db(here.cell.kept[c.SNR])
    spread = float(np.std(linear[np.isfinite(linear)], ddof=1)) if n > 1 else math.nan
    low, high = (float(v) for v in mean_interval(mean, spread, n, 1.0, here.method.confidence))
    return [
        here.row("snr", "dB", float(snr_to_db(mean)), (float(snr_to_db(low)), float(snr_to_db(high)))),
        here.row("snr_min", "dB", float(s[c.MIN_SNR])),
        here.row("snr_max", "dB", float(s[c.MAX_SNR])),
    ]


def _prediction_rows(
    here: Here, name: str, unit: str, at_unit_snr: float, floor: float, assessed: float, nu: float
) -> list[Estimate]:
    """The sigma predicted from SNR, and the assessed variance over the predicted one.

    `at_unit_snr`: the measurement's sigma at 2 SNR = 1. The mean of the predicted variances of the samples.
    """
    s, n = here.cell.sums, here.cell.sums[c.N_SNR]
    if n and at_unit_snr:
        predicted = math.sqrt((at_unit_snr**2 * s[c.SUM_NOISE] + floor**2 * s[c.SUM_FLOOR]) / n)
    elif floor:  # no SNR, or no parameters to use it: the floor is all that is known of the noise
        predicted = float(filtered_sigma(floor, here.sigmas.alpha, here.sigmas.beta))
    else:
        return []
    ratio, low, high = variance_ratio_interval(assessed, nu, predicted, here.method.confidence)
    return [
        here.row(f"predicted_{name}_sigma", unit, predicted),
        here.row(f"{name}_variance_ratio", "1", float(ratio), (float(low), float(high))),
    ]


def _angle_rows(here: Here, angle: str, sigma_range: float) -> list[Estimate]:
    """The array angle: theta_e from y, theta_a from z, in radians."""
    cell, sigmas, method = here.cell, here.sigmas, here.method
    n, mean_range, mean_cross = cell.n, cell.mean_of(c.SUM_R), cell.mean_of(c.SUM_C)

    def angle_of(sigma: float) -> float:
        return float(sigma_to_angle(sigma, mean_range, mean_cross)[0])

    by_means = angle_of(sigmas.estimate)
    if method.paper or not math.isfinite(by_means) or cell.sums[c.N_BEYOND]:
        estimate, white = by_means, angle_of(sigmas.white)
    else:
        estimate, white = (method.ungated * _root(cell.centred(first, sigmas.mean), n) for first in (c.U0, c.V0))
    low, high = (float(v) for v in bracket_factors(sigmas.alpha))
    nu = here.freedom
    rows = [
        here.sigma_row(f"{angle}_sigma", "rad", estimate, nu.angle),
        here.sigma_row(f"{angle}_sigma_white", "rad", white, nu.angle),
        here.sigma_row(f"{angle}_sigma_bracket_low", "rad", angle_of(low * sigmas.residual), nu.residual),
        here.sigma_row(f"{angle}_sigma_bracket_high", "rad", angle_of(high * sigmas.residual), nu.residual),
        here.sigma_row(f"{angle}_sigma_mean_gains", "rad", angle_of(sigmas.mean_gains), nu.residual),
        here.sigma_row(
            f"{angle}_sigma_robust", "rad", angle_of(sigmas.residual_robust * math.sqrt(sigmas.q)), nu.robust
        ),
        here.row(
            f"{angle}_sigma_leak_bound",
            "rad",
            float(angle_sigma_with_range_noise(sigmas.estimate, sigma_range, mean_range, mean_cross)),
        ),
        here.row(f"{here.axis.name}_predicted_mean", "m", mean_cross),
    ]
    radar = method.radar
    beamwidth = radar.beamwidth_elevation_deg if angle == "elevation" else radar.beamwidth_azimuth_deg
    floor = radar.elevation_floor_deg if angle == "elevation" else radar.azimuth_floor_deg
    measured = 0.0
    if beamwidth:
        measured = float(angle_sigma(0.0, math.radians(beamwidth), radar.monopulse_slope)) * math.sqrt(2.0)
    return rows + _prediction_rows(here, angle, "rad", measured, math.radians(floor), estimate, nu.angle)
