"""Tuning a filter by the likelihood of its innovations: parameters that make the recorded plots most probable.

The search runs over logarithms and logits, so that nothing leaves its range, with floors where a likelihood would go to
the edge (a simulated target that is exactly straight wants no process noise at all). Intervals come from the curvature
of the log-likelihood at its maximum; a parameter at its floor has none.

References
----------
Likelihood of a state space model from its innovations: Schweppe (1965). Search: Nelder and Mead (1965).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from rangeeval.tracking.cycle import LIKELIHOOD, PRIOR, SCALE, SIGMA, SIGMA_TURN, Setup, run_tracks, scratch
from rangeeval.tracking.filters import Filter
from rangeeval.tracking.measurements import Measurements
from rangeeval.tracking.runs import Batch, log_likelihood
from rangeeval.tracking.setups import generator, setup_of

FloatArray = NDArray[np.float64]

Kind = Literal["sigma", "sigma_turn", "prior_turn", "stay", "noise"]


@dataclass(frozen=True)
class Parameter:
    """One number of a filter that tuning may change.

    `kind`: `sigma`, `sigma_turn`, `prior_turn` of a model, the probability to `stay` in it over one reference interval
    (the ways out keep their proportions), or the `noise` factor of a component (0 range, 1 azimuth, 2 elevation);
    `index` of the model or component, from 0. `floor` and `ceiling` in the parameter's own unit.
    """

    kind: Kind
    index: int
    floor: float
    ceiling: float

    @property
    def name(self) -> str:
        """What people call it: `sigma 1` is of the first model, `noise range` a factor."""
        if self.kind == "noise":
            return f"noise {('range', 'azimuth', 'elevation')[self.index]}"
        return f"{self.kind.replace('_', ' ')} {self.index + 1}"


def parameters_of(spec: Filter, *, motion: bool = True, noise: bool = False) -> tuple[Parameter, ...]:
    """All parameters of a filter's motion models, and of its measurement noise, with floors that suit aircraft."""
    chosen: list[Parameter] = []
    if motion:
        for i, model in enumerate(spec.models):
            chosen.append(Parameter("sigma", i, 0.01, 1e3))
            if model.motion.startswith("ct"):
                chosen.append(Parameter("sigma_turn", i, 1e-4, 1.0))
                chosen.append(Parameter("prior_turn", i, 1e-3, 2.0))
        if len(spec.models) > 1:
            chosen += [Parameter("stay", i, 0.5, 0.9999) for i in range(len(spec.models))]
    if noise:
        chosen += [Parameter("noise", i, 1e-3, 1e3) for i in range(3)]
    return tuple(chosen)


@dataclass(frozen=True)
class Tuned:
    """A tuned filter and how it was found.

    Attributes
    ----------
    filter : with the tuned values.
    parameters, values : what was tuned and to what.
    low, high : interval of each value at `confidence`; NaN at a floor or where the likelihood has no curvature.
    before, after : log-likelihood of all tracks with the given and the tuned filter.
    held_before, held_after : the same of each held-out track (tracks,): tuning helps only if these rise too.
    evaluations : of the log-likelihood.
    converged : the search ended by itself.
    """

    filter: Filter
    parameters: tuple[Parameter, ...]
    values: FloatArray
    low: FloatArray
    high: FloatArray
    confidence: float
    before: float
    after: float
    held_before: FloatArray
    held_after: FloatArray
    evaluations: int
    converged: bool


def tune(
    spec: Filter,
    tracks: Sequence[Measurements],
    parameters: Sequence[Parameter] | None = None,
    *,
    hold_out: Sequence[Measurements] = (),
    confidence: float = 0.95,
    evaluations: int = 4000,
    intervals: bool = True,
) -> Tuned:
    """Find the parameters of a filter under which the innovations of the tracks are most probable.

    Plots outside the gate do not enter the likelihood, so tuning sets no gate and no restart by gated plots: a gate
    would pay for throwing plots away.

    Parameters
    ----------
    parameters : default `parameters_of(spec)`, without measurement noise.
    hold_out : tracks that are not tuned on, only judged with.

    Raises
    ------
    ValueError : no track has a plot with a prediction, or there is nothing to tune.
    """
    chosen = tuple(parameters_of(spec) if parameters is None else parameters)
    if not chosen:
        raise ValueError("nothing to tune: give at least one parameter")
    open_spec = replace(spec, gate_probability=1.0, restart_after=0)
    likelihood = Likelihood(open_spec, chosen, Batch.of(tracks))
    given = likelihood.values
    start = np.array([_inward(p, value) for p, value in zip(chosen, given, strict=True)])
    before = likelihood(given)
    if before == 0.0:
        raise ValueError("no track has a plot after its start, so there is nothing to tune on; a track needs 4 plots")
    found = minimize(
        likelihood.negative,
        start,
        method="Nelder-Mead",
        options={
            "maxfev": evaluations,
            "xatol": 1e-3,
            "fatol": 1e-4,
            "adaptive": len(chosen) > 4,
            "initial_simplex": np.vstack([start, start + 0.4 * np.eye(len(chosen))]),
        },
    )
    values = likelihood.outward(found.x)
    low = np.full(len(chosen), np.nan)
    high = low.copy()
    if intervals:
        low, high = _intervals(likelihood, found.x, confidence)
    tuned = likelihood.filter(values)
    held = Batch.of(hold_out)
    return Tuned(
        filter=replace(tuned, gate_probability=spec.gate_probability, restart_after=spec.restart_after),
        parameters=chosen,
        values=values,
        low=low,
        high=high,
        confidence=confidence,
        before=before,
        after=likelihood(values),
        held_before=log_likelihood(open_spec, held),
        held_after=log_likelihood(tuned, held),
        evaluations=likelihood.count,
        converged=bool(found.success),
    )


class Likelihood:
    """The log-likelihood of tracks as a function of chosen parameters: one setup, rewritten in place at each call."""

    def __init__(self, spec: Filter, parameters: Sequence[Parameter], batch: Batch) -> None:
        self.spec = spec
        self.parameters = tuple(parameters)
        self.batch = batch
        self.setup: Setup = setup_of(spec)
        self.room = scratch(len(spec.models))
        self.total = np.zeros(batch.planar.size)
        self.nothing = np.empty((0, 0)), np.empty(0, dtype=np.int64)
        self.count = 0
        self.values = np.array([_read(self.setup, p) for p in self.parameters])
        steps = np.diff(batch.rows[:, 0])
        self.uneven = bool(np.any(np.abs(steps - spec.reference_interval_s) > 1e-9 * spec.reference_interval_s))

    def __call__(self, values: FloatArray) -> float:
        """Log-likelihood of all tracks; minus infinity where the values cannot be."""
        self.count += 1
        _write(self.setup, self.parameters, values)
        if self.uneven and not np.all(np.isfinite(self.setup.pi)):
            return -math.inf
        b = self.batch
        run_tracks(*self.setup, LIKELIHOOD, b.offsets, b.rows, b.planar, self.total, *self.nothing, *self.room)
        return float(np.sum(self.total))

    def outward(self, inner: FloatArray) -> FloatArray:
        """Values of the search's unbounded coordinates, held at floor and ceiling."""
        return np.array([_outward(p, u) for p, u in zip(self.parameters, inner, strict=True)])

    def negative(self, inner: FloatArray) -> float:
        """What the search makes small; beyond floor or ceiling it rises slowly, so that the search turns back."""
        values = self.outward(inner)
        back = np.array([_inward(p, value) for p, value in zip(self.parameters, values, strict=True)])
        value = self(values)
        return 1e300 if not math.isfinite(value) else -value + 1e-3 * float(np.sum((inner - back) ** 2))

    def filter(self, values: FloatArray) -> Filter:
        """The filter with these values."""
        _write(self.setup, self.parameters, values)
        table, m = self.setup.table, len(self.spec.models)
        models = tuple(
            replace(model, sigma_m_s2=float(row[SIGMA]), sigma_turn_rad_s=float(row[SIGMA_TURN]))
            if not model.motion.startswith("ct")
            else replace(
                model,
                sigma_m_s2=float(row[SIGMA]),
                sigma_turn_rad_s=float(row[SIGMA_TURN]),
                prior_turn_rad_s=float(row[PRIOR]),
            )
            for model, row in zip(self.spec.models, table, strict=True)
        )
        a, b, c = self.setup.limits[SCALE].tolist()
        transition = tuple(tuple(row) for row in self.setup.pi[:m].tolist())
        return replace(self.spec, models=models, transition=transition, noise_scale=(a, b, c))


def _intervals(likelihood: Likelihood, at: FloatArray, confidence: float) -> tuple[FloatArray, FloatArray]:
    """Normal intervals in the search's coordinates, from second differences of the log-likelihood; carried outward."""
    from scipy.special import ndtri

    n = len(at)
    low, high = np.full(n, np.nan), np.full(n, np.nan)
    edge = np.array([
        value <= p.floor * 1.001 or value >= p.ceiling * 0.9999
        for p, value in zip(likelihood.parameters, likelihood.outward(at), strict=True)
    ])  # fmt: skip
    free = np.flatnonzero(~edge)
    step = 0.05

    def value(change: FloatArray) -> float:
        return likelihood(likelihood.outward(at + change))

    middle = value(np.zeros(n))
    curvature = np.zeros((len(free), len(free)))
    for a, i in enumerate(free):
        for b, k in enumerate(free[: a + 1]):
            di, dk = np.zeros(n), np.zeros(n)
            di[i], dk[k] = step, step
            if i == k:
                second = (value(di) - 2 * middle + value(-di)) / step**2
            else:
                second = (value(di + dk) - value(di - dk) - value(dk - di) + value(-di - dk)) / (4 * step**2)
            curvature[a, b] = curvature[b, a] = -second
    if len(free) == 0 or not np.all(np.isfinite(curvature)) or np.any(np.linalg.eigvalsh(curvature) <= 0):
        return low, high
    half = float(ndtri(0.5 + confidence / 2)) * np.sqrt(np.diag(np.linalg.inv(curvature)))
    for i, h in zip(free, half, strict=True):
        p = likelihood.parameters[i]
        low[i], high[i] = _outward(p, at[i] - h), _outward(p, at[i] + h)
    return low, high


def _read(setup: Setup, p: Parameter) -> float:
    if p.kind == "noise":
        return float(setup.limits[SCALE, p.index])
    if p.kind == "stay":
        return float(setup.pi[p.index, p.index])
    return float(setup.table[p.index, _COLUMN[p.kind]])


def _write(setup: Setup, parameters: Sequence[Parameter], values: FloatArray) -> None:
    m = len(setup.motions)
    moved = False
    for p, value in zip(parameters, values.tolist(), strict=True):
        if p.kind == "noise":
            setup.limits[SCALE, p.index] = value
        elif p.kind == "stay":
            row = setup.pi[p.index]
            ways_out = 1.0 - row[p.index]
            row *= (1.0 - value) / ways_out if ways_out > 0 else 0.0
            if ways_out <= 0:
                row[:] = (1.0 - value) / (m - 1)
            row[p.index] = value
            moved = True
        else:
            setup.table[p.index, _COLUMN[p.kind]] = value
    if moved:
        setup.pi[m : 2 * m] = generator(setup.pi[:m]) / setup.scalars.reference


_COLUMN = {"sigma": SIGMA, "sigma_turn": SIGMA_TURN, "prior_turn": PRIOR}


def _inward(p: Parameter, value: float) -> float:
    held = min(max(value, p.floor), p.ceiling)
    return math.log(held / (1.0 - held)) if p.kind == "stay" else math.log(held)


def _outward(p: Parameter, inner: float) -> float:
    value = 1.0 / (1.0 + math.exp(-inner)) if p.kind == "stay" else math.exp(min(inner, 700.0))
    return min(max(value, p.floor), p.ceiling)
