"""The rows of replay that need no truth: NIS with its bounds, likelihood, whiteness, and what was not used."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.replay.gathering import COORDINATES, Gathered, Noise
from rangeeval.analyses.replay.pooled import Updates
from rangeeval.model import Bins, Estimate
from rangeeval.stats.consistency import average_bounds
from rangeeval.stats.correlation import lag_sums, ljung_box
from rangeeval.stats.mean_square import Interval, mean, sigma
from rangeeval.tracking.runs import Flag

Floats = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

UNITS = {"range": "m", "azimuth": "rad", "elevation": "rad"}
LAGS = 10
MUCH = 0.05  # share of gated plots from which the numbers are those of a chosen rest
NORMAL = 1.96


@dataclass(frozen=True)
class Place:
    """Which rows an estimate is of: a bin (or none), a track, a group."""

    rows: BoolArray
    variable: str | None = None
    low: float = math.nan
    high: float = math.nan
    track: str | None = None
    group: str | None = None

    def row(self, quantity: str, unit: str, found: Interval, flags: Sequence[str] = (), **extra: object) -> Estimate:
        """The estimate of a quantity here."""
        return Estimate(
            quantity=quantity, unit=unit, value=found.value, low=found.low, high=found.high, n=found.n,
            n_eff=found.n_eff, variable=self.variable, bin_low=self.low, bin_high=self.high, track_id=self.track,
            group=self.group, flags=tuple(dict.fromkeys(flags)), extra=extra,
        )  # fmt: skip


def places(u: Updates, bins: Bins, names: Sequence[str], *, per_track: bool, group: str | None = None) -> list[Place]:
    """The whole trial, every track, and every bin (each track in it with `per_track`)."""
    everything = np.ones(len(u.time_s), bool)
    found = [Place(everything, group=group)]
    if group is None:
        found += [Place(u.track == i, track=name or "T001") for i, name in enumerate(names)]
    index = bins.index(u.variable(bins))
    for b in np.unique(index[index >= 0]).tolist():
        low, high = bins.edges(b)
        inside = index == b
        found.append(Place(inside, bins.variable, low, high, group=group))
        if per_track and group is None:
            found += [
                Place(inside & (u.track == i), bins.variable, low, high, name or "T001")
                for i, name in enumerate(names)
                if (inside & (u.track == i)).any()
            ]
    return found


def innovation_rows(u: Updates, place: Place, bins: Bins, confidence: float, noise: Noise) -> list[Estimate]:
    """NIS with its acceptance region, likelihood, updates, and in whole tracks the whiteness of the innovations."""
    used = place.rows & u.used
    n = int(np.count_nonzero(used))
    flags = common_flags(u, place, bins, n, noise)
    nis, dof = u.nis[used], u.dof[used]
    found = mean(nis, confidence, u.track[used]).from_zero()
    bounds = nis_bounds(dof, confidence)
    verdict = []
    if n and bounds[0] <= bounds[1]:
        verdict = ["optimistic"] if found.value > bounds[1] else ["pessimistic"] if found.value < bounds[0] else []
    likelihood = u.log_likelihood[used]
    each = mean(likelihood, confidence, u.track[used])
    total = Interval(float(likelihood.sum()) if n else math.nan, n * each.low, n * each.high, n, each.n_eff)
    expected = float(dof.mean()) if n else math.nan
    ratio = (
        Interval(found.value / expected, found.low / expected, found.high / expected, n, found.n_eff) if n else found
    )
    rows = [
        place.row("nis_mean", "1", found, [*flags, *verdict], expected=expected, accept_low=bounds[0],
                  accept_high=bounds[1]),
        place.row("nis_ratio", "1", ratio, [*flags, *verdict], accept_low=bounds[0] / expected if n else math.nan,
                  accept_high=bounds[1] / expected if n else math.nan),
        place.row("log_likelihood", "1", total, flags),
        place.row("log_likelihood_per_update", "1", each, flags),
        place.row("updates", "1", exactly(n, int(np.count_nonzero(place.rows))), flags),
    ]  # fmt: skip
    for k, name in enumerate(COORDINATES):
        e = u.innovation[used, k]
        if np.isfinite(e).any():
            spread = sigma(e, confidence, u.track[used])
            rows.append(place.row(f"{name}_innovation_sigma", UNITS[name], spread, flags))
            if place.variable is None:
                rows += _whiteness(u, place, used, k, name, flags)
    if place.variable is None:
        rows += _counted(u, place, flags)
    return rows


def exactly(count: float, n: int) -> Interval:
    """A count of n rows: no doubt about it."""
    return Interval(float(count), float(count), float(count), n, float(n))


def nis_bounds(dof: NDArray[np.int64], confidence: float) -> tuple[float, float]:
    """Where the mean NIS of so many updates lies with this confidence if the filter is consistent (chi-square)."""
    total, n = float(dof.sum()), len(dof)
    if not n:
        return math.nan, math.nan
    low, high = average_bounds(total, 1, confidence)
    return float(low) * total / n, float(high) * total / n


def common_flags(u: Updates, place: Place, bins: Bins, n: int, noise: Noise) -> list[str]:
    """What a reader must know of these rows."""
    rows = place.rows
    flags = []
    if n < (bins.min_samples if place.track is None else 10):
        flags.append("few-samples")
    count = int(np.count_nonzero(rows))
    if count and np.count_nonzero(u.having(Flag.GATED)[rows]) > MUCH * count:
        flags.append("gated")
    elif u.having(Flag.GATED)[rows].any():
        flags.append("outliers")
    if np.count_nonzero(u.having(Flag.ABSURD)[rows]) > 0.001 * count:
        flags.append("inconsistent")
    if u.having(Flag.RESTARTED)[rows].any():
        flags.append("restarted")
    if u.having(Flag.OVERHEAD)[rows].any():
        flags.append("overhead")
    if u.having(Flag.REPEATED)[rows].any():
        flags.append("repeated-times")
    if u.having(Flag.BROKEN)[rows].any():
        flags.append("broken")
    if "assumed" in noise.origin[:2] or (noise.origin[2] == "assumed" and np.isfinite(u.elevation_rad[rows]).any()):
        flags.append("assumed-noise")
    elevation = np.isfinite(u.elevation_rad[rows])
    if count and not elevation.any():
        flags.append("planar")
    elif count and not elevation.all():
        flags.append("partial")
    return flags


def _whiteness(u: Updates, place: Place, used: BoolArray, k: int, name: str, flags: Sequence[str]) -> list[Estimate]:
    """Lag-one correlation of the normalised innovation with its interval, and the p-value of Ljung and Box."""
    x = u.whitened[used, k]
    n = int(np.count_nonzero(np.isfinite(x)))
    if n < 2 * LAGS:
        return []
    sums = lag_sums(x, LAGS, u.track[used])
    rho = sums.autocorrelation()
    pairs = float(sums.pairs[1])
    half = NORMAL / math.sqrt(pairs) if pairs else math.nan
    one = float(rho[1])
    test = ljung_box(rho, n, LAGS, sums.pairs)
    more = ["correlated"] if test.p_value < 0.01 else []
    return [
        place.row(
            f"{name}_innovation_correlation", "1", Interval(one, one - half, one + half, n, pairs), [*flags, *more]
        ),
        place.row(f"{name}_whiteness_p", "1", Interval(test.p_value, math.nan, math.nan, n, float(n)), [*flags, *more]),
    ]


_COUNTED = (
    ("gated", Flag.GATED), ("restarts", Flag.RESTARTED), ("starting", Flag.STARTING), ("disordered", Flag.DISORDERED),
)  # fmt: skip


def _counted(u: Updates, place: Place, flags: Sequence[str]) -> list[Estimate]:
    n = int(np.count_nonzero(place.rows))
    rows = []
    for name, flag in _COUNTED:
        count = int(np.count_nonzero(u.having(flag)[place.rows]))
        if count or name == "gated":
            rows.append(place.row(f"plots_{name}", "1", exactly(count, n), flags))
    return rows


def noise_rows(gathered: Gathered) -> list[Estimate]:
    """The measurement noise the filter was given, with its interval where the plots themselves showed it."""
    rows = []
    noise = gathered.noise
    planar = all(t.plots.planar for t in gathered.tracks)
    for k, name in enumerate(COORDINATES):
        if name == "elevation" and planar:
            continue
        found = noise.estimates.get(name, Interval(noise.sigma[k], math.nan, math.nan, 0, math.nan))
        flags = {"estimated": "from-scatter", "assumed": "assumed-noise"}.get(noise.origin[k], noise.origin[k])
        rows.append(Estimate(
            quantity=f"{name}_noise", unit=UNITS[name], value=noise.sigma[k], low=found.low, high=found.high, n=found.n,
            n_eff=found.n_eff, flags=(flags,),
        ))  # fmt: skip
    return rows
