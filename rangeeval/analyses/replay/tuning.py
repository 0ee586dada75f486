"""The noise and manoeuvre parameters that the plots support, with what tuning gained on tracks it had not seen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rangeeval.analyses.replay.gathering import COORDINATES, Noise, Track
from rangeeval.errors import InputError, SettingsError
from rangeeval.model import Estimate
from rangeeval.stats.mean_square import Interval, mean
from rangeeval.tracking import tuning
from rangeeval.tracking.filters import AlphaBeta, AnyFilter, Filter
from rangeeval.tracking.measurements import Measurements
from rangeeval.tracking.runs import Flag, Run, run_many
from rangeeval.tracking.tuning import Parameter

HELD_OUT = 4  # every fourth track judges the tuning, where there are so many
FEWEST_UPDATES = 20
UNBOUNDED = 300.0  # high over low end of an interval that says nothing
FEW_WILD = 0.02  # share of plots outside the gate up to which they are taken for wild ones
# Floors keep the search off edges that no real target supports: a simulated one that is exactly straight wants no
# process noise at all.
_FLOORS = {"sigma": 0.1, "sigma_turn": 1e-3, "prior_turn": 1e-3, "stay": 0.5, "noise": 0.02}
_NAMES = {
    "sigma": ("process_noise", "m_s2"), "sigma_turn": ("turn_noise", "rad_s"), "prior_turn": ("turn_prior", "rad_s"),
    "stay": ("stay_probability", "1"),
}  # fmt: skip


@dataclass(frozen=True)
class Value:
    """One tuned parameter: its quantity, unit, value with interval (none at its floor), and whether it stands there."""

    name: str
    unit: str
    value: Interval
    at_floor: bool


@dataclass(frozen=True)
class Tuned:
    """The tuned filter, its parameters, and what the likelihood of an update gained: on tracks tuned with, held out."""

    spec: Filter
    values: tuple[Value, ...]
    gain: Interval
    held_out: Interval | None
    given: tuple[float, float, float]

    def noise(self, before: Noise) -> Noise:
        """The measurement noise after tuning; what was not tuned stays."""
        sigma, origin, estimates = list(before.sigma), list(before.origin), dict(before.estimates)
        for found in self.values:
            name = found.name.removesuffix("_noise")
            if name in COORDINATES:
                k = COORDINATES.index(name)
                sigma[k], origin[k], estimates[name] = found.value.value, "tuned", found.value
        return Noise((sigma[0], sigma[1], sigma[2]), (origin[0], origin[1], origin[2]), estimates)

    def as_settings(self) -> dict[str, float]:
        """The values by name."""
        return {found.name: found.value.value for found in self.values}


def tune(spec: AnyFilter, tracks: Sequence[Track], sigma: tuple[float, float, float], confidence: float) -> Tuned:
    """Maximise the likelihood of the plots over measurement noise, process noise and how long the models last.

    On three tracks in four where there are four; the others only judge. `sigma` is the noise that the plots were given.
    A few plots far outside the gate of the untuned filter are left out: one wild plot would stand for a manoeuvre.

    Raises
    ------
    SettingsError : an alpha-beta filter, which has no likelihood of its own. InputError : too few plots.
    """
    if isinstance(spec, AlphaBeta):
        raise SettingsError("an alpha-beta filter has no likelihood to tune by; use --filter kalman or imm")
    train, judges = _split(tracks)
    parameters = _parameters(spec, planar=all(t.plots.planar for t in tracks))
    runs = run_many(spec, [t.measurements for t in train])
    updates = sum(int(r.used.sum()) for r in runs)
    if updates < max(FEWEST_UPDATES, 4 * len(parameters)):
        raise InputError(f"{updates} updates are too few to tune {len(parameters)} parameters with")
    found = tuning.tune(spec, _without_wild_plots(runs), parameters, confidence=confidence)
    values = tuple(
        _value(p, sigma, Interval(float(value), float(low), float(high), updates, float(updates)))
        for p, value, low, high in zip(parameters, found.values, found.low, found.high, strict=True)
    )
    held = _gain(spec, found.filter, judges, confidence) if judges else None
    return Tuned(found.filter, values, _gain(spec, found.filter, train, confidence), held, sigma)


def _split(tracks: Sequence[Track]) -> tuple[list[Track], list[Track]]:
    if len(tracks) < HELD_OUT:
        return list(tracks), []
    judges = [t for i, t in enumerate(tracks) if i % HELD_OUT == HELD_OUT - 1]
    return [t for i, t in enumerate(tracks) if i % HELD_OUT != HELD_OUT - 1], judges


def _without_wild_plots(runs: Sequence[Run]) -> list[Measurements]:
    """The plots without those outside the gate; all of them where that would be many: then the noise given is wrong."""
    gated = [(r.flags & int(Flag.GATED)) != 0 for r in runs]
    if sum(int(g.sum()) for g in gated) > FEW_WILD * sum(map(len, gated)):
        return [r.measurements for r in runs]
    return [
        replace(r.measurements, z=np.where(g[:, None], np.nan, r.measurements.z))
        for r, g in zip(runs, gated, strict=True)
    ]


def _parameters(spec: Filter, *, planar: bool) -> tuple[Parameter, ...]:
    """All of a filter's motion models, and the noise of every coordinate that there is."""
    return tuple(
        Parameter(p.kind, p.index, _FLOORS[p.kind], p.ceiling)
        for p in tuning.parameters_of(spec, motion=True, noise=True)
        if not (p.kind == "noise" and p.index == 2 and planar)
        and not (p.kind == "prior_turn" and len(spec.models) == 1)
    )


def _value(p: Parameter, sigma: tuple[float, float, float], found: Interval) -> Value:
    at_floor = found.value <= 1.001 * p.floor or found.value >= 0.9999 * p.ceiling
    if p.kind != "stay" and found.high > UNBOUNDED * found.low:  # the curvature is as good as none
        found = replace(found, low=math.nan, high=math.nan)
    if p.kind != "noise":
        name, unit = _NAMES[p.kind]
        return Value(f"{name}_{p.index + 1}", unit, found, at_floor)
    s = sigma[p.index]
    scaled = Interval(s * found.value, s * found.low, s * found.high, found.n, found.n_eff)
    return Value(f"{COORDINATES[p.index]}_noise", "m" if p.index == 0 else "rad", scaled, at_floor)


def _gain(before: Filter, after: Filter, tracks: Sequence[Track], confidence: float) -> Interval:
    """The mean difference of the log-likelihood per update, after less before, where both used the plot."""
    measurements = [t.measurements for t in tracks]
    a, b = run_many(before, measurements), run_many(after, measurements)
    both = [x.used & y.used for x, y in zip(a, b, strict=True)]
    difference = np.concatenate([(y.log_likelihood - x.log_likelihood)[u] for x, y, u in zip(a, b, both, strict=True)])
    mark = np.concatenate([np.full(int(u.sum()), i) for i, u in enumerate(both)])
    return mean(difference, confidence, mark)


def tuned_rows(found: Tuned) -> list[Estimate]:
    """The parameters with their intervals, and what tuning gained."""
    rows = [
        Estimate(
            quantity=f"tuned_{v.name}", unit=v.unit, value=v.value.value, low=v.value.low, high=v.value.high,
            n=v.value.n, n_eff=v.value.n_eff,
            flags=("tuned", *(["at-floor"] if v.at_floor else []),
                   *(["unobservable"] if not v.at_floor and math.isnan(v.value.low) else [])),
        )
        for v in found.values
    ]  # fmt: skip
    for name, gain in (("tuning_gain", found.gain), ("tuning_gain_held_out", found.held_out)):
        if gain is not None:
            rows.append(Estimate(
                quantity=name, unit="1", value=gain.value, low=gain.low, high=gain.high, n=gain.n, n_eff=gain.n_eff,
            ))  # fmt: skip
    return rows
