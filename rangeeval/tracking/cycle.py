"""The filter cycle over the plots of many tracks: start, mix, predict, gate, update, merge, as one compiled kernel.

A Kalman filter is the case of one model. Nothing is allocated inside the loops; `level` says what is written.

References
----------
Blom and Bar-Shalom (1988), The interacting multiple model algorithm; probabilities in the log domain.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rangeeval.compiled import compiled_ieee, compiled_inside
from rangeeval.tracking.mixing import RESET, mix, pad
from rangeeval.tracking.motion import CT, predict, process_noise, states_of
from rangeeval.tracking.polar import EKF, measure, wrap
from rangeeval.tracking.starting import start, turn_from_acceleration
from rangeeval.tracking.updating import (
    cartesian_innovation,
    cholesky_inverse,
    correct,
    forbid_parallel_turn,
    innovation_covariance,
    polar_innovation,
    quadratic,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

LIKELIHOOD, UPDATES, DETAIL = 0, 1, 2  # levels of output
LOG_2PI = math.log(2.0 * math.pi)
DIVERGED = 1e14  # variance (m^2, m^2/s^2) at which a filter knows nothing and rounding eats its covariance

# Values of runs.Flag, which this kernel cannot import.
STARTING, MISSED, PARTIAL, GATED, RESTARTED = 1, 2, 4, 8, 16
ABSURD, BROKEN, REPEATED, DISORDERED, OVERHEAD = 32, 64, 128, 256, 512


class Setup(NamedTuple):
    """A `filters.Filter` as numbers; the arrays come first and are passed one by one."""

    motions: IntArray  # (models,)
    table: FloatArray  # (models, 6): columns below
    pi: FloatArray  # (3 models, models): transition probabilities, generator per second, room for those of a step
    limits: FloatArray  # (3, 3): factor on sigma of each component; gate and absurd NIS by degrees of freedom
    scalars: Scalars


class Scalars(NamedTuple):
    """The single numbers of a setup."""

    reference: float
    speed: float
    acceleration: float
    restart_gap: float
    continuous: bool
    quadratic: bool
    turn_three_point: bool
    padding: int
    update: int
    start_plots: int
    restart_after: int


# Columns of Setup.table; rows of Setup.limits.
SIGMA, SIGMA_TURN, PRIOR, PARALLEL, DECAY, START = range(6)
SCALE, GATE, LIMIT = range(3)

# Rows of the scratch: of `weight` (4, models); of `v` (8 + 2 models, 3) and of `m` (2 + 3 models, 9), where those of
# one model after another follow; `x` (4 models, 9) and `p` (4 models, 81) hold filtered, mixed, predicted, padded
# densities.
MU, CBAR, MIX, LOG_L = range(4)
PLOT, VARIANCE, KNOWN, MEAN_AT, MEAN_NU, AXES, MODELS_V = 0, 1, 2, 3, 4, 5, 8
MEAN_S, INVERSE, MODELS_M = 0, 1, 2

# Columns of what is written for each plot; the models' probabilities and details follow.
STATE, COVARIANCE, PREDICTED_STATE, PREDICTED_COVARIANCE, AT_COLUMN, INNOVATION = 0, 6, 42, 48, 84, 87
INNOVATION_COVARIANCE, NIS, DOF, LIKELIHOOD_COLUMN, GAINS, PROBABILITY = 90, 99, 100, 101, 102, 108


def scratch(models: int) -> tuple[FloatArray, ...]:
    """Room for the kernel to work in: it owns no array itself, which halves its compilation."""
    k = models
    shapes = ((4, k), (4 * k, 9), (4 * k, 81), (8 + 2 * k, 3), (2 + 3 * k, 9), (162,), (k, 6), (k, 27), (3, 7))
    return tuple(np.zeros(shape) for shape in shapes)


@compiled_ieee
def run_tracks(
    motions: IntArray,
    table: FloatArray,
    pi: FloatArray,
    limits: FloatArray,
    o: Scalars,
    level: int,
    offsets: IntArray,
    rows: FloatArray,
    planar: BoolArray,
    total: FloatArray,
    out: FloatArray,
    flags: IntArray,
    weight: FloatArray,
    x: FloatArray,
    p: FloatArray,
    v: FloatArray,
    m: FloatArray,
    f: FloatArray,
    noise: FloatArray,
    shrink: FloatArray,
    starts: FloatArray,
) -> None:
    """Run every track, rows offsets[i] to offsets[i + 1], through the filter.

    The first five are a `Setup`, the last nine `scratch`. `rows` (n, 7): time, range, azimuth, elevation and their
    sigmas. Writes the log-likelihood of each track into `total` and, above level LIKELIHOOD, each plot's row of `out`
    (columns above) and of `flags`.
    """
    models = motions.size
    for track in range(offsets.size - 1):
        collected = 0  # plots of the start so far
        gated = 0  # gated plots in a row
        last = math.nan  # time of the state
        used = math.nan  # time of the newest used plot
        step = math.nan  # interval that pi and the process noise are for
        log_likelihood = 0.0
        for k in range(offsets[track], offsets[track + 1]):
            t = rows[k, 0]
            known = 0
            for i in range(3):
                v[PLOT, i] = rows[k, 1 + i]
                sigma = limits[SCALE, i] * rows[k, 4 + i]
                v[VARIANCE, i] = sigma * sigma
                measured = math.isfinite(rows[k, 1 + i])
                v[KNOWN, i] = 1.0 if measured else 0.0
                known += 1 if measured else 0
            startable = (
                v[KNOWN, 0] > 0.0 and v[KNOWN, 1] > 0.0 and (planar[track] or v[KNOWN, 2] > 0.0) and v[PLOT, 0] > 0.0
            )
            flag = 0
            if known == 0:
                flag = MISSED
            elif known < 3 and not planar[track]:
                flag = PARTIAL
            if collected > 0 and startable and t - used > o.restart_gap:
                flag |= RESTARTED
                collected = 0
            begins = startable and collected < o.start_plots and (collected == 0 or t > used)
            runs = collected > 0 and not begins
            if not math.isfinite(t) or (collected > 0 and t < last):
                flag |= DISORDERED
                runs, begins = False, False
            elif collected > 0 and t == last:
                flag |= REPEATED
            if runs:
                if t - last != step:
                    step = t - last
                    _set_step(motions, table, pi, o, step, noise, f)
                last = t
                found, nis, value, known = _cycle(
                    motions, table, pi, limits, o, known, step, level, weight, x, p, v, m, f, noise, shrink
                )
                flag |= found
                if found & (GATED | BROKEN):
                    gated += 1
                elif known > 0:
                    gated, used = 0, t
                if found & BROKEN or (gated > 0 and gated == o.restart_after):
                    collected = 0
                    begins = startable
                    flag |= RESTARTED
                else:
                    log_likelihood += value
                    if level > LIKELIHOOD:
                        _write_update(models, known, found, nis, value, step, level, weight, x, p, v, m, shrink, out, k)
            if begins:
                starts[collected, 0] = t
                for i in range(3):
                    missing = planar[track] and i == 2
                    starts[collected, 1 + i] = 0.0 if missing else v[PLOT, i]
                    starts[collected, 4 + i] = 0.0 if missing else v[VARIANCE, i]
                collected += 1
                _begin(motions, table, o, collected, starts, planar[track], weight, x, p, v, m, f)
                flag |= STARTING
                gated, last, used = 0, t, t
            if level > LIKELIHOOD:
                flags[k] = flag if collected > 0 else flag | MISSED
                if collected > 0:
                    _write_state(models, level, weight, x, p, out, k)
        total[track] = log_likelihood


@compiled_inside
def _begin(
    motions: IntArray, table: FloatArray, o: Scalars, count: int, starts: FloatArray, planar: bool,
    weight: FloatArray, x: FloatArray, p: FloatArray, v: FloatArray, m: FloatArray, f: FloatArray,
) -> None:  # fmt: skip
    """Start every model from the plots collected so far."""
    # without elevation the height is decoupled, and as wide as the speed allows in a reference interval
    height_sigma = o.speed * o.reference if planar else 0.0
    for j in range(motions.size):
        weight[MU, j] = table[j, START]
        start(count, starts, height_sigma, o.quadratic, o.speed, o.acceleration, x, p, j, v, AXES, m, MODELS_M, f)
        if motions[j] >= CT:
            if o.turn_three_point and count == 3 and not planar:
                turn_from_acceleration(x, p, j, table[j, PRIOR], f)
            else:
                pad(RESET, table[j, PRIOR], x, p, j, j, f)


@compiled_inside
def _set_step(
    motions: IntArray, table: FloatArray, pi: FloatArray, o: Scalars, dt: float, noise: FloatArray, f: FloatArray
) -> None:
    """Process noise of every model and the transition probabilities over `dt`."""
    models = motions.size
    for j in range(models):
        process_noise(motions[j], table[j, SIGMA], table[j, SIGMA_TURN], dt, o.reference, o.continuous, noise, j)
    if models == 1 or abs(dt - o.reference) <= 1e-9 * o.reference:
        for i in range(models):
            for j in range(models):
                pi[2 * models + i, j] = pi[i, j]
    else:
        exponential(pi, dt, f)


@compiled_ieee
def exponential(pi: FloatArray, dt: float, f: FloatArray) -> None:
    """exp(generator dt) into the third m rows of `pi` (3 m, m), whose second m rows are the generator.

    Scaling, Taylor series and squaring; at most three models. `f` is scratch.
    """
    m = pi.shape[1]
    size = 0.0
    for i in range(m):
        size = max(size, abs(pi[m + i, i]) * dt)
    halvings = 0
    while size > 0.25 and halvings < 60:
        size *= 0.5
        halvings += 1
    scale = dt * 0.5**halvings
    term, power, product = 0, 9, 18  # matrices in f
    for i in range(m):
        for j in range(m):
            f[term + 3 * i + j] = 1.0 if i == j else 0.0
            f[power + 3 * i + j] = f[term + 3 * i + j]
    for n in range(1, 14 + halvings):
        for i in range(m):
            for j in range(m):
                total = 0.0
                for a in range(m):
                    if n < 14:
                        total += f[term + 3 * i + a] * pi[m + a, j] * scale / n
                    else:
                        total += f[power + 3 * i + a] * f[power + 3 * a + j]
                f[product + 3 * i + j] = total
        for i in range(m):
            for j in range(m):
                f[term + 3 * i + j] = f[product + 3 * i + j]
                f[power + 3 * i + j] = f[product + 3 * i + j] + (f[power + 3 * i + j] if n < 14 else 0.0)
    for i in range(m):
        row = 0.0
        for j in range(m):
            row += max(f[power + 3 * i + j], 0.0)
        for j in range(m):
            pi[2 * m + i, j] = max(f[power + 3 * i + j], 0.0) / row


@compiled_inside
def _cycle(
    motions: IntArray, table: FloatArray, pi: FloatArray, limits: FloatArray, o: Scalars, known: int, dt: float,
    level: int,
    weight: FloatArray, x: FloatArray, p: FloatArray, v: FloatArray, m: FloatArray, f: FloatArray,
    noise: FloatArray, shrink: FloatArray,
) -> tuple[int, float, float, int]:  # fmt: skip
    """Mix, predict, gate and update: flags, NIS, log-likelihood and how many components were used."""
    models = motions.size
    flag = 0
    for j in range(models):
        total = 0.0
        for i in range(models):
            weight[MIX, i] = pi[2 * models + i, j] * weight[MU, i]
            total += weight[MIX, i]
        weight[CBAR, j] = total
        for i in range(models):
            weight[MIX, i] = weight[MIX, i] / total if total > 0.0 else (1.0 if i == j else 0.0)
        mix(j, motions, o.padding, table[j, PRIOR], weight, x, p, f)
        decay = math.exp(-dt * table[j, DECAY]) if table[j, DECAY] > 0.0 else 1.0
        predict(motions[j], dt, decay, noise, j, x, p, models + j, 2 * models + j, f)
        if not measure(x, 2 * models + j, v, MODELS_V + j, m, MODELS_M + j):
            flag = OVERHEAD
    if flag == OVERHEAD:
        for i in range(1, 3):
            known -= 1 if v[KNOWN, i] > 0.0 else 0
            v[KNOWN, i] = 0.0
    for j in range(models):
        at, nu = MODELS_V + j, MODELS_V + models + j
        h, r, s = MODELS_M + j, MODELS_M + models + j, MODELS_M + 2 * models + j
        polar_innovation(v, PLOT, VARIANCE, KNOWN, at, nu, m, h, r)
        innovation_covariance(p, 2 * models + j, m, h, r, s)
    nis = math.nan
    if level > LIKELIHOOD or limits[GATE, 0] < math.inf:
        _mixture(models, weight, v, m)
        if known > 0:
            if math.isnan(cholesky_inverse(m, MEAN_S, INVERSE)):
                return flag | BROKEN, nis, 0.0, 0
            nis = quadratic(m, INVERSE, v, MEAN_NU)
            if nis > limits[GATE, known - 1]:
                flag |= GATED
            elif nis > limits[LIMIT, known - 1]:
                flag |= ABSURD
    value = 0.0
    if known > 0 and not flag & GATED:
        value = _update(motions, o, known, weight, x, p, v, m, shrink, f)
    else:
        for j in range(models):
            weight[MU, j] = weight[CBAR, j]
            for a in range(9):
                x[j, a] = x[2 * models + j, a]
            for c in range(81):
                p[j, c] = p[2 * models + j, c]
    sound = math.isfinite(value)
    for j in range(models):
        if table[j, PARALLEL] > 0.0:
            forbid_parallel_turn(table[j, PARALLEL], x, p, j, f)
        for a in range(6):
            limit = math.inf if a % 3 == 2 else DIVERGED  # the height may not be observed at all
            sound = sound and math.isfinite(x[j, a]) and p[j, 10 * a] > 0.0 and p[j, 10 * a] < limit
    return flag if sound else flag | BROKEN, nis, value, known


@compiled_inside
def _mixture(models: int, weight: FloatArray, v: FloatArray, m: FloatArray) -> None:
    """Predicted measurement, innovation and its covariance of the mixture of models, weighted by cbar."""
    for what in range(2):  # azimuths relative to the first model's, so that the cut at -pi is nowhere special
        first, mean = MODELS_V + what * models, MEAN_AT + what
        for i in range(3):
            v[mean, i] = v[first, i]
            for j in range(1, models):
                difference = v[first + j, i] - v[first, i]
                v[mean, i] += weight[CBAR, j] * (wrap(difference) if i == 1 else difference)
        v[mean, 1] = wrap(v[mean, 1])
    for c in range(9):
        m[MEAN_S, c] = 0.0
    for j in range(models):
        nu, s, w = MODELS_V + models + j, MODELS_M + 2 * models + j, weight[CBAR, j]
        d0 = v[nu, 0] - v[MEAN_NU, 0]
        d1 = wrap(v[nu, 1] - v[MEAN_NU, 1])
        d2 = v[nu, 2] - v[MEAN_NU, 2]
        d = (d0, d1, d2)
        for i in range(3):
            for k in range(3):
                m[MEAN_S, 3 * i + k] += w * (m[s, 3 * i + k] + d[i] * d[k])


@compiled_inside
def _update(
    motions: IntArray, o: Scalars, known: int, weight: FloatArray, x: FloatArray, p: FloatArray, v: FloatArray,
    m: FloatArray, shrink: FloatArray, f: FloatArray,
) -> float:  # fmt: skip
    """Update every model and the probabilities; gives the log-likelihood of the plot, NaN when an update fails."""
    models = motions.size
    top = -math.inf
    for j in range(models):
        row, at, nu = 2 * models + j, MODELS_V + j, MODELS_V + models + j
        h, r, s = MODELS_M + j, MODELS_M + models + j, MODELS_M + 2 * models + j
        if o.update != EKF and known == 3:
            cartesian_innovation(o.update, v, PLOT, VARIANCE, at, nu, x, row, m, r)
            for c in range(9):
                m[h, c] = 1.0 if c % 4 == 0 else 0.0
            innovation_covariance(p, row, m, h, r, s)
        log_det = cholesky_inverse(m, s, INVERSE)
        if math.isnan(log_det):
            return math.nan
        weight[LOG_L, j] = -0.5 * (quadratic(m, INVERSE, v, nu) + log_det + known * LOG_2PI)
        correct(states_of(motions[j]), m, h, r, INVERSE, v, nu, x, p, row, j, shrink, j, f)
        if weight[CBAR, j] > 0.0:
            top = max(top, weight[LOG_L, j])
    total = 0.0
    for j in range(models):
        c = weight[CBAR, j]
        weight[MU, j] = c * math.exp(weight[LOG_L, j] - top) if c > 0.0 else 0.0
        total += weight[MU, j]
    for j in range(models):
        weight[MU, j] /= total
    return top + math.log(total)


@compiled_inside
def _merge(
    models: int,
    weight: FloatArray,
    which: int,
    x: FloatArray,
    p: FloatArray,
    row: int,
    out: FloatArray,
    k: int,
    to: int,
) -> None:
    """Mean (6) and covariance (36) of position and velocity over the models in `row` on, into columns of `out`."""
    for c in range(to, to + 42):
        out[k, c] = 0.0
    for j in range(models):
        for a in range(6):
            out[k, to + a] += weight[which, j] * x[row + j, a]
    for j in range(models):
        for a in range(6):
            d = x[row + j, a] - out[k, to + a]
            for b in range(6):
                out[k, to + 6 + 6 * a + b] += weight[which, j] * (
                    p[row + j, 9 * a + b] + d * (x[row + j, b] - out[k, to + b])
                )


@compiled_inside
def _write_state(
    models: int, level: int, weight: FloatArray, x: FloatArray, p: FloatArray, out: FloatArray, k: int
) -> None:
    """The state of a row, the models' probabilities and, for smoothing, their densities."""
    _merge(models, weight, MU, x, p, 0, out, k, STATE)
    for j in range(models):
        out[k, PROBABILITY + j] = weight[MU, j]
    if level == DETAIL:
        _write_models(models, x, p, 0, out, k, PROBABILITY + 2 * models)


@compiled_inside
def _write_models(models: int, x: FloatArray, p: FloatArray, row: int, out: FloatArray, k: int, to: int) -> None:
    """The models' densities, 90 columns each."""
    for j in range(models):
        for a in range(9):
            out[k, to + 90 * j + a] = x[row + j, a]
        for c in range(81):
            out[k, to + 90 * j + 9 + c] = p[row + j, c]


@compiled_inside
def _write_update(
    models: int, known: int, flag: int, nis: float, value: float, dt: float, level: int, weight: FloatArray,
    x: FloatArray, p: FloatArray, v: FloatArray, m: FloatArray, shrink: FloatArray, out: FloatArray, k: int,
) -> None:  # fmt: skip
    """What a row with a prediction has beside its state."""
    _merge(models, weight, CBAR, x, p, 2 * models, out, k, PREDICTED_STATE)
    for i in range(3):
        out[k, AT_COLUMN + i] = v[MEAN_AT, i]
        if math.isfinite(v[PLOT, i]):
            difference = v[PLOT, i] - v[MEAN_AT, i]
            out[k, INNOVATION + i] = wrap(difference) if i == 1 else difference
        for c in range(3):
            if v[KNOWN, i] > 0.0 and v[KNOWN, c] > 0.0:
                out[k, INNOVATION_COVARIANCE + 3 * i + c] = m[MEAN_S, 3 * i + c]
    out[k, NIS] = nis
    used = known > 0 and not flag & GATED
    out[k, DOF] = known if used else 0
    out[k, LIKELIHOOD_COLUMN] = value
    if used:
        _write_gains(models, dt, weight, v, shrink, out, k)
    if level == DETAIL:
        for j in range(models):
            out[k, PROBABILITY + models + j] = weight[CBAR, j]
        _write_models(models, x, p, 2 * models, out, k, PROBABILITY + 92 * models)


@compiled_inside
def _write_gains(
    models: int, dt: float, weight: FloatArray, v: FloatArray, shrink: FloatArray, out: FloatArray, k: int
) -> None:
    """Weight of a residual along the line of sight, up and across, in position and (times dt) in velocity."""
    az, el = v[MEAN_AT, 1], v[MEAN_AT, 2]
    ca, sa, ce, se = math.cos(az), math.sin(az), math.cos(el), math.sin(el)
    v[AXES, 0], v[AXES, 1], v[AXES, 2] = ce * ca, ce * sa, se
    v[AXES + 1, 0], v[AXES + 1, 1], v[AXES + 1, 2] = -se * ca, -se * sa, ce
    v[AXES + 2, 0], v[AXES + 2, 1], v[AXES + 2, 2] = -sa, ca, 0.0
    for i in range(3):
        for j in range(models):
            for a in range(3):
                for b in range(3):
                    part = weight[MU, j] * v[AXES + i, a] * v[AXES + i, b]
                    out[k, GAINS + 2 * i] += part * shrink[j, 3 * a + b]
                    out[k, GAINS + 2 * i + 1] += part * shrink[j, 9 + 3 * a + b] * dt
