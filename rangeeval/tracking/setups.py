"""A filter's description turned into the numbers its kernel takes, and checked on the way."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import special

from rangeeval.tracking.cycle import Scalars, Setup
from rangeeval.tracking.filters import AnyFilter, Filter
from rangeeval.tracking.mixing import PADDINGS
from rangeeval.tracking.motion import MOTIONS
from rangeeval.tracking.polar import UPDATES

FloatArray = NDArray[np.float64]

_HALF_DOF = np.array([0.5, 1.0, 1.5])
_ABSURD = 2.0 * special.gammainccinv(_HALF_DOF, 1e-12)  # NIS beyond any chance
START_PLOTS = {"one-point": 1, "two-point": 2, "three-point": 3, "quadratic": 3}


def setup_of(spec: Filter) -> Setup:
    """The numbers of a filter.

    Raises
    ------
    ValueError : a number or name that no filter can have, in words.
    """
    models = spec.models
    pi = np.array(spec.transition, dtype=np.float64)
    m = len(models)
    if pi.shape != (m, m) or not (np.all(pi >= 0) and np.allclose(pi.sum(1), 1.0, atol=1e-9)):
        raise ValueError(f"transition must be {m} x {m} with rows that sum to 1, one row for each model")
    start = np.array(spec.start_probabilities or [1.0 / m] * m, dtype=np.float64)
    if start.shape != (m,) or not (np.all(start >= 0) and abs(start.sum() - 1.0) < 1e-9):
        raise ValueError(f"start_probabilities must be {m} numbers that sum to 1, one for each model")
    if any(not model.sigma_m_s2 >= 0 or not model.sigma_turn_rad_s >= 0 for model in models):
        raise ValueError("a process noise is negative or not a number; give 0 or more")
    if not spec.reference_interval_s > 0:
        raise ValueError(f"reference_interval_s is {spec.reference_interval_s}; give seconds above 0")
    table = np.zeros((m, 6))
    for row, model, probability in zip(table, models, start, strict=True):
        turns = model.motion.startswith("ct")
        row[:] = (
            model.sigma_m_s2,
            model.sigma_turn_rad_s,
            model.prior_turn_rad_s if turns else spec.start_acceleration_m_s2,
            model.parallel_turn_rad_s if turns and math.isfinite(model.parallel_turn_rad_s) else 0.0,
            1.0 / model.turn_decay_s,
            probability,
        )
    return Setup(
        motions=np.array([MOTIONS[_known(model.motion, MOTIONS)] for model in models], dtype=np.int64),
        table=table,
        pi=np.concatenate([pi, generator(pi) / spec.reference_interval_s, pi]),
        limits=limits_of(spec),
        scalars=Scalars(
            reference=float(spec.reference_interval_s),
            speed=float(spec.start_speed_m_s),
            acceleration=float(spec.start_acceleration_m_s2),
            restart_gap=float(spec.restart_gap_s),
            continuous=spec.noise == "continuous",
            quadratic=spec.start == "quadratic",
            turn_three_point=spec.turn_start == "three-point",
            padding=PADDINGS[_known(spec.padding, PADDINGS)],
            update=UPDATES[_known(spec.update, UPDATES)],
            start_plots=START_PLOTS[_known(spec.start, START_PLOTS)],
            restart_after=int(spec.restart_after),
        ),
    )


def limits_of(spec: AnyFilter) -> FloatArray:
    """Factors on sigma, gate and absurd NIS of a filter (3, 3); ValueError when they make no sense."""
    if not 0 < spec.gate_probability <= 1:
        raise ValueError(f"gate_probability is {spec.gate_probability}; give a probability above 0, 1 for no gate")
    if not all(scale > 0 for scale in spec.noise_scale):
        raise ValueError("noise_scale has a factor that is not above 0")
    return np.array([spec.noise_scale, gates(spec.gate_probability), _ABSURD])


def gates(probability: float) -> FloatArray:
    """Chi-square quantiles (3,) of 1, 2 and 3 degrees of freedom; infinite for probability 1."""
    if probability == 1.0:
        return np.full(3, math.inf)
    return np.asarray(2.0 * special.gammaincinv(_HALF_DOF, probability), dtype=np.float64)


def generator(pi: FloatArray) -> FloatArray:
    """Generator (per reference interval) of transition probabilities: their matrix logarithm; NaN if it is not real.

    NaN means that no process in continuous time has these probabilities (a model left sooner than it is stayed in): the
    filter then runs at the reference interval only.
    """
    if pi.shape == (1, 1):
        return np.zeros((1, 1))
    if pi.shape == (2, 2):
        second = pi[0, 0] + pi[1, 1] - 1.0
        if second <= 0:
            return np.full((2, 2), math.nan)
        factor = math.log(second) / (second - 1.0) if second < 1.0 else 1.0
        two: FloatArray = factor * (pi - np.eye(2))
        return two
    values, vectors = np.linalg.eig(pi)
    if np.any((values.real <= 0) & (np.abs(values.imag) < 1e-12)) or np.linalg.cond(vectors) > 1e10:
        return np.full(pi.shape, math.nan)
    logarithm = (vectors * np.log(values.astype(np.complex128))) @ np.linalg.inv(vectors)
    real = np.ascontiguousarray(logarithm.real)
    # a rate a little below zero (a model reached only through another) is made up for by clipping; a large one is not
    if np.max(np.abs(logarithm.imag)) > 1e-9 or np.min(real + 1e3 * np.eye(len(real))) < -0.1:
        return np.full(pi.shape, math.nan)
    return real


def _known(name: str, table: dict[str, int]) -> str:
    if name not in table:
        raise ValueError(f"'{name}' is none of {', '.join(table)}")
    return name
