"""The noise and manoeuvre parameters that the plots support: the likelihood of the innovations, maximised."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit, logit, ndtri

from rangeeval.analyses.replay.gathering import COORDINATES, Noise, Track
from rangeeval.errors import InputError, SettingsError
from rangeeval.model import Estimate
from rangeeval.stats.mean_square import Interval, mean
from rangeeval.tracking.filters import AlphaBeta, AnyFilter, Filter
from rangeeval.tracking.runs import Batch, log_likelihood, run_many

Floats = NDArray[np.float64]

HELD_OUT = 4  # every fourth track judges the tuning, where there are so many
FEWEST_UPDATES = 20
STEP = 0.05  # of the numerical curvature, in the logarithm
FLOOR_SHARE = 1e-3  # so near to a bound, in the logarithm, a value stands at it
EVALUATIONS = 250  # of the likelihood for each parameter, at most


@dataclass(frozen=True)
class Knob:
    """One parameter: its name and unit, how it is read from a filter and put into one, and what it is kept between.

    `scale`: the unit's worth of a value (a measurement noise is a factor on the sigma that the plots were given).
    `probability`: searched on the logit scale instead of the logarithm.
    """

    name: str
    unit: str
    get: Callable[[Filter], float]
    put: Callable[[Filter, float], Filter]
    low: float
    high: float
    scale: float = 1.0
    probability: bool = False

    def to_line(self, value: float) -> float:
        """The value on the scale it is searched on."""
        return float(logit(value)) if self.probability else math.log(value)

    def of_line(self, x: float) -> float:
        """A value back from that scale."""
        return float(expit(x)) if self.probability else math.exp(x)


@dataclass(frozen=True)
class Tuned:
    """The tuned filter; each parameter with its interval; what the likelihood gained, and on tracks held out."""

    spec: Filter
    knobs: tuple[Knob, ...]
    values: tuple[Interval, ...]
    at_floor: tuple[bool, ...]
    gain: Interval
    held_out: Interval | None
    evaluations: int
    given: tuple[float, float, float]

    def noise(self, before: Noise) -> Noise:
        """The measurement noise after tuning; what was not tuned stays."""
        sigma, origin, estimates = list(before.sigma), list(before.origin), dict(before.estimates)
        for knob, value in zip(self.knobs, self.values, strict=True):
            name = knob.name.removesuffix("_noise")
            if name in COORDINATES:
                k = COORDINATES.index(name)
                sigma[k], origin[k], estimates[name] = value.value, "tuned", value
        return Noise((sigma[0], sigma[1], sigma[2]), (origin[0], origin[1], origin[2]), estimates)

    def as_settings(self) -> dict[str, float]:
        """The values as `[replay]` of trial.toml has them, as far as it has them."""
        return {knob.name: value.value for knob, value in zip(self.knobs, self.values, strict=True)}


def tune(spec: AnyFilter, tracks: Sequence[Track], sigma: tuple[float, float, float], confidence: float) -> Tuned:
    """Maximise the likelihood of the plots over measurement noise, process noise and how long the models last.

    Nelder and Mead on logarithms (logits of probabilities) within bounds, on three tracks in four where there are four;
    the others only judge. Intervals from the curvature of the likelihood at its maximum, all parameters together.

    Raises
    ------
    SettingsError : an alpha-beta filter, which has no likelihood of its own. InputError : too few plots.
    """
    if isinstance(spec, AlphaBeta):
        raise SettingsError("an alpha-beta filter has no likelihood to tune by; use --filter kalman or imm")
    train, judges = _split(tracks)
    batch = Batch.of([t.measurements for t in train])
    knobs = _knobs(spec, sigma, planar=all(t.plots.planar for t in tracks))
    updates = sum(int(r.used.sum()) for r in run_many(spec, [t.measurements for t in train]))
    if updates < max(FEWEST_UPDATES, 4 * len(knobs)):
        raise InputError(f"{updates} updates are too few to tune {len(knobs)} parameters with")
    open_ = replace(spec, gate_probability=1.0, restart_after=0)  # a gate would pay for throwing plots away

    def with_values(x: Floats) -> Filter:
        found = open_
        for knob, value in zip(knobs, x, strict=True):
            found = knob.put(found, knob.of_line(float(value)))
        return found

    evaluations = 0

    def cost(x: Floats) -> float:
        nonlocal evaluations
        evaluations += 1
        total = float(np.sum(log_likelihood(with_values(x), batch)))
        return -total if math.isfinite(total) else 1e300

    bounds = [(k.to_line(k.low), k.to_line(k.high)) for k in knobs]
    start = np.array(
        [min(max(k.to_line(k.get(spec)), a + STEP), b - STEP) for k, (a, b) in zip(knobs, bounds, strict=True)]
    )
    best = start
    for _ in range(2):  # a second start from the first answer: the simplex has often become too flat by then
        simplex = np.vstack([best, *(_moved(best, i, bounds) for i in range(len(best)))])
        options = {"initial_simplex": simplex, "xatol": 2e-3, "fatol": 1e-2, "maxfev": EVALUATIONS * len(knobs)}
        best = minimize(cost, best, method="Nelder-Mead", bounds=bounds, options=options).x
    at_bound = tuple(bool(x - a < FLOOR_SHARE or b - x < FLOOR_SHARE) for x, (a, b) in zip(best, bounds, strict=True))
    error = _errors(cost, best, at_bound)
    z = float(ndtri(0.5 + confidence / 2))
    values = tuple(
        Interval(
            k.scale * k.of_line(x),
            k.scale * k.of_line(x - z * s),
            k.scale * k.of_line(x + z * s),
            updates,
            float(updates),
        )
        for k, x, s in zip(knobs, best.tolist(), error.tolist(), strict=True)
    )
    found = replace(with_values(best), gate_probability=spec.gate_probability, restart_after=spec.restart_after)
    gain = _gain(spec, found, train, confidence)
    held = _gain(spec, found, judges, confidence) if judges else None
    return Tuned(found, knobs, values, at_bound, gain, held, evaluations, sigma)


def _split(tracks: Sequence[Track]) -> tuple[list[Track], list[Track]]:
    if len(tracks) < HELD_OUT:
        return list(tracks), []
    judges = [t for i, t in enumerate(tracks) if i % HELD_OUT == HELD_OUT - 1]
    return [t for i, t in enumerate(tracks) if i % HELD_OUT != HELD_OUT - 1], judges


def _moved(x: Floats, i: int, bounds: Sequence[tuple[float, float]]) -> Floats:
    moved = x.copy()
    moved[i] += 0.3 if x[i] + 0.3 < bounds[i][1] else -0.3
    return moved


def _knobs(spec: Filter, sigma: tuple[float, float, float], *, planar: bool) -> tuple[Knob, ...]:
    """A filter's parameters: noise of each coordinate, then of each model its noise, its prior, its persistence."""
    found: list[Knob] = []
    for i, name in enumerate(COORDINATES[:2] if planar else COORDINATES):
        unit = "m" if name == "range" else "rad"
        found.append(Knob(f"{name}_noise", unit, _scale_of(i), _put_scale(i), 0.02, 50.0, scale=sigma[i]))
    for m, model in enumerate(spec.models, start=1):
        floor = 0.1 if m == 1 else 0.3
        found.append(
            Knob(f"process_noise_{m}", "m_s2", _of_model(m, "sigma_m_s2"), _put(m, "sigma_m_s2"), floor, 300.0)
        )
        if model.motion.startswith("ct") and len(spec.models) > 1:
            found.append(
                Knob(
                    f"turn_prior_{m}", "rad_s", _of_model(m, "prior_turn_rad_s"), _put(m, "prior_turn_rad_s"), 1e-3, 1.0
                )
            )
    if len(spec.models) == 2:
        found += [
            Knob(f"stay_probability_{m}", "1", _stay(m), _put_stay(m), 0.5, 0.9999, probability=True) for m in (1, 2)
        ]
    return tuple(found)


def _scale_of(i: int) -> Callable[[Filter], float]:
    return lambda spec: spec.noise_scale[i]


def _put_scale(i: int) -> Callable[[Filter, float], Filter]:
    def put(spec: Filter, value: float) -> Filter:
        a, b, c = (value if k == i else v for k, v in enumerate(spec.noise_scale))
        return replace(spec, noise_scale=(a, b, c))

    return put


def _of_model(m: int, name: str) -> Callable[[Filter], float]:
    return lambda spec: float(getattr(spec.models[m - 1], name))


def _put(m: int, name: str) -> Callable[[Filter, float], Filter]:
    def put(spec: Filter, value: float) -> Filter:
        models = tuple(replace(o, **{name: value}) if k == m - 1 else o for k, o in enumerate(spec.models))
        return replace(spec, models=models)

    return put


def _stay(m: int) -> Callable[[Filter], float]:
    return lambda spec: spec.transition[m - 1][m - 1]


def _put_stay(m: int) -> Callable[[Filter, float], Filter]:
    def put(spec: Filter, value: float) -> Filter:
        own = (value, 1.0 - value) if m == 1 else (1.0 - value, value)
        rows = tuple(own if k == m - 1 else row for k, row in enumerate(spec.transition))
        return replace(spec, transition=rows)

    return put


def _errors(cost: Callable[[Floats], float], best: Floats, at_bound: Sequence[bool]) -> Floats:
    """Standard errors from the inverse of the numerical curvature; NaN at a bound or where it is not a maximum."""
    found = np.full(len(best), np.nan)
    free = [i for i, b in enumerate(at_bound) if not b]
    n = len(free)
    if not n:
        return found
    centre = cost(best)
    h = np.zeros((n, n))

    def at(*moves: tuple[int, float]) -> float:
        x = best.copy()
        for i, step in moves:
            x[free[i]] += step
        return cost(x)

    for i in range(n):
        h[i, i] = (at((i, STEP)) - 2 * centre + at((i, -STEP))) / STEP**2
        for j in range(i):
            h[i, j] = h[j, i] = (
                at((i, STEP), (j, STEP))
                - at((i, STEP), (j, -STEP))
                - at((i, -STEP), (j, STEP))
                + at((i, -STEP), (j, -STEP))
            ) / (4 * STEP**2)
    try:
        variance = np.diag(np.linalg.inv(h))
    except np.linalg.LinAlgError:
        return found
    found[free] = np.where(variance > 0, np.sqrt(np.abs(variance)), np.nan)
    return found


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
    rows = []
    for knob, value, floor in zip(found.knobs, found.values, found.at_floor, strict=True):
        flags = ("tuned", "at-floor") if floor else ("tuned",)
        if floor or not math.isfinite(value.low):
            value = replace(value, low=math.nan, high=math.nan)
        rows.append(Estimate(
            quantity=f"tuned_{knob.name}", unit=knob.unit, value=value.value, low=value.low, high=value.high, n=value.n,
            n_eff=value.n_eff, flags=flags,
        ))  # fmt: skip
    gains = [("tuning_gain", found.gain, ())]
    if found.held_out is not None:
        gains.append(("tuning_gain_held_out", found.held_out, ()))
    for name, gain, flags in gains:
        rows.append(Estimate(
            quantity=name, unit="1", value=gain.value, low=gain.low, high=gain.high, n=gain.n, n_eff=gain.n_eff,
            flags=flags,
        ))  # fmt: skip
    return rows
