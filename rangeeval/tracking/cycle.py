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

from rangeeval.compiled import compiled
from rangeeval.tracking.mixing import mix
from rangeeval.tracking.motion import CT, predict, process_noise, states_of
from rangeeval.tracking.polar import EKF, conventional_covariance, convert, measure, wrap
from rangeeval.tracking.starting import start, turn_from_acceleration
from rangeeval.tracking.updating import (
    cartesian_innovation,
    cholesky_inverse,
    forbid_parallel_turn,
    innovation_covariance,
    joseph,
    polar_innovation,
    quadratic,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

LIKELIHOOD, UPDATES, DETAIL = 0, 1, 2  # levels of output
LOG_2PI = math.log(2.0 * math.pi)

# Values of runs.Flag, which this kernel cannot import.
STARTING, MISSED, PARTIAL, GATED, RESTARTED = 1, 2, 4, 8, 16
ABSURD, BROKEN, REPEATED, DISORDERED, OVERHEAD = 32, 64, 128, 256, 512


class Setup(NamedTuple):
    """A `filters.Filter` as numbers. Few arrays: each costs compile time wherever it is passed."""

    motions: IntArray  # (models,)
    table: FloatArray  # (models, 6): the columns below
    pi: FloatArray  # (2, models, models): transition probabilities, generator per second
    limits: FloatArray  # (3, 3): factor on sigma of each component; gate and absurd NIS by degrees of freedom
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


SIGMA, SIGMA_TURN, PRIOR, PARALLEL, DECAY, START = range(6)  # columns of Setup.table
SCALE, GATE, LIMIT = range(3)  # rows of Setup.limits


class Work(NamedTuple):
    """Scratch of the cycle, allocated once."""

    x: FloatArray  # (4, models, 9): FILTERED, MIXED, PREDICTED, PADDED
    p: FloatArray  # (4, models, 9, 9)
    q: FloatArray  # (models, 6)
    pi: FloatArray  # (models, models), over the step at hand
    weight: FloatArray  # (4, models): MU, CBAR, MIX, LOG_L
    vector: FloatArray  # (2, models, 3): AT (predicted measurement), NU
    matrix: FloatArray  # (3, models, 3, 3): H, R, S
    shrink: FloatArray  # (models, 9, 3): K H
    mean: FloatArray  # (5, 3): of the mixture, predicted measurement, innovation, its covariance (3 rows)
    inverse: FloatArray  # (3, 3)
    scratch: FloatArray  # (24, 9)
    plot: FloatArray  # (2, 3): variance, and 1 where measured
    starts: FloatArray  # (3, 7): time, range, azimuth, elevation, variances of the plots of the start


FILTERED, MIXED, PREDICTED, PADDED = range(4)
MU, CBAR, MIX, LOG_L = range(4)
AT, NU = range(2)
H, R, S = range(3)

# Columns of what is written for each plot; the models' probabilities and details follow.
STATE, COVARIANCE, PREDICTED_STATE, PREDICTED_COVARIANCE, AT_COLUMN, INNOVATION = 0, 6, 42, 48, 84, 87
INNOVATION_COVARIANCE, NIS, DOF, LIKELIHOOD_COLUMN, GAINS, PROBABILITY = 90, 99, 100, 101, 102, 108


@compiled
def workspace(models: int) -> Work:
    """Fresh scratch for a number of models."""
    m = models
    return Work(
        np.zeros((4, m, 9)), np.zeros((4, m, 9, 9)), np.zeros((m, 6)), np.zeros((m, m)), np.zeros((4, m)),
        np.zeros((2, m, 3)), np.zeros((3, m, 3, 3)), np.zeros((m, 9, 3)), np.zeros((5, 3)), np.zeros((3, 3)),
        np.zeros((24, 9)), np.zeros((2, 3)), np.zeros((3, 7)),
    )  # fmt: skip


@compiled
def run_tracks(
    setup: Setup,
    level: int,
    offsets: IntArray,
    rows: FloatArray,
    planar: BoolArray,
    total: FloatArray,
    table: FloatArray,
    flags: IntArray,
) -> None:
    """Run every track, rows offsets[i] to offsets[i + 1], through the filter.

    `rows` (n, 7): time, range, azimuth, elevation and their sigmas. Writes the log-likelihood of each track into `total`
    and, above level LIKELIHOOD, each plot's row of `table` (its columns above) and `flags`.
    """
    models = setup.motions.size
    w = workspace(models)
    for track in range(offsets.size - 1):
        collected = 0  # plots of the start so far
        gated = 0  # gated plots in a row
        last = math.nan  # time of the state
        used = math.nan  # time of the newest used plot
        step = math.nan  # interval that pi and q are for
        log_likelihood = 0.0
        for k in range(offsets[track], offsets[track + 1]):
            t = rows[k, 0]
            z = rows[k, 1:4]
            known = _read(setup, w, rows[k])
            startable = known >= 2 and w.plot[1, 0] > 0.0 and w.plot[1, 1] > 0.0 and z[0] > 0.0
            startable = startable and (planar[track] or w.plot[1, 2] > 0.0)
            flag = 0
            if known == 0:
                flag = MISSED
            elif known < 3 and not planar[track]:
                flag = PARTIAL
            if collected > 0 and startable and t - used > setup.restart_gap:
                flag |= RESTARTED
                collected = 0
            begins = startable and collected < setup.start_plots and (collected == 0 or t > used)
            runs = collected > 0 and not begins
            if not math.isfinite(t) or (collected > 0 and t < last):
                flag |= DISORDERED
                runs, begins = False, False
            elif collected > 0 and t == last:
                flag |= REPEATED
            if runs:
                if t - last != step:
                    step = t - last
                    _noise(setup, w, step)
                last = t
                found, nis, value, known = _cycle(setup, w, z, known, step, level)
                flag |= found
                if found & (GATED | BROKEN):
                    gated += 1
                elif known > 0:
                    gated, used = 0, t
                if found & BROKEN or (gated > 0 and gated == setup.restart_after):
                    collected = 0
                    begins = startable
                    flag |= RESTARTED
                    runs = False
                else:
                    log_likelihood += value
                    if level > LIKELIHOOD:
                        _write_update(models, w, z, known, found, nis, value, step, level, table[k])
            if begins:
                _begin(setup, w, collected, t, z, planar[track])
                collected += 1
                flag |= STARTING
                gated, last, used = 0, t, t
            if level > LIKELIHOOD:
                flags[k] = flag if collected > 0 else flag | MISSED
                if collected > 0:
                    _write_state(models, w, level, table[k])
        total[track] = log_likelihood


@compiled
def _read(setup: Setup, w: Work, row: FloatArray) -> int:
    """Variances of a plot and what was measured of it; gives how many components."""
    known = 0
    for i in range(3):
        sigma = setup.limits[SCALE, i] * row[4 + i]
        w.plot[0, i] = sigma * sigma
        w.plot[1, i] = 1.0 if math.isfinite(row[1 + i]) else 0.0
        known += 1 if w.plot[1, i] > 0.0 else 0
    return known


@compiled
def _begin(setup: Setup, w: Work, collected: int, t: float, z: FloatArray, planar: bool) -> None:
    """Start every model from the plots collected so far and this one."""
    row = w.starts[collected]
    row[0], row[1], row[2], row[3] = t, z[0], z[1], 0.0 if planar else z[2]
    row[4], row[5], row[6] = w.plot[0, 0], w.plot[0, 1], 0.0 if planar else w.plot[0, 2]
    count = collected + 1
    positions, covariances = np.empty((3, 3)), np.empty((3, 3, 3))
    for n in range(count):
        row = w.starts[n]
        convert(row[1], row[2], row[3], positions[n])
        conventional_covariance(row[1], row[2], row[3], row[4], row[5], row[6], covariances[n])
        if planar:  # the height is not known: decoupled, and as wide as the speed allows in a reference interval
            covariances[n, 2, 2] = (setup.speed * setup.reference) ** 2
    x, p = np.empty(9), np.empty((9, 9))
    start(count, w.starts[:, 0], positions, covariances, setup.quadratic, setup.speed, setup.acceleration, x, p)
    turning_x, turning_p = np.zeros(9), np.zeros((9, 9))
    if setup.turn_three_point and count == 3 and not planar:
        turn_from_acceleration(x, p, turning_x, turning_p)
    else:
        turning_x[:6] = x[:6]
        turning_p[:6, :6] = p[:6, :6]
    for j in range(setup.motions.size):
        w.weight[MU, j] = setup.table[j, START]
        turns = setup.motions[j] >= CT
        for a in range(9):
            w.x[FILTERED, j, a] = turning_x[a] if turns else x[a]
            for b in range(9):
                w.p[FILTERED, j, a, b] = turning_p[a, b] if turns else p[a, b]
            if turns and a >= 6 and turning_p[a, a] == 0.0:
                w.p[FILTERED, j, a, a] = setup.table[j, PRIOR] ** 2


@compiled
def _noise(setup: Setup, w: Work, dt: float) -> None:
    """Process noise of every model and the transition probabilities over `dt`."""
    models = setup.motions.size
    for j in range(models):
        process_noise(
            setup.motions[j], setup.table[j, SIGMA], setup.table[j, SIGMA_TURN], dt, setup.reference, setup.continuous,
            w.q[j],
        )  # fmt: skip
    if models == 1 or abs(dt - setup.reference) <= 1e-9 * setup.reference:
        for i in range(models):
            for j in range(models):
                w.pi[i, j] = setup.pi[0, i, j]
    else:
        exponential(setup.pi[1], dt, w.pi)


@compiled
def exponential(generator: FloatArray, dt: float, pi: FloatArray) -> None:
    """exp(generator dt) into `pi`: transition probabilities over dt, by scaling, Taylor series and squaring."""
    m = generator.shape[0]
    size = 0.0
    for i in range(m):
        size = max(size, abs(generator[i, i]) * dt)
    halvings = 0
    while size > 0.25 and halvings < 60:
        size *= 0.5
        halvings += 1
    scaled = generator * (dt / 2.0**halvings)
    term = np.eye(m)
    total = np.eye(m)
    for n in range(1, 14):
        product = np.zeros((m, m))
        for i in range(m):
            for j in range(m):
                for a in range(m):
                    product[i, j] += term[i, a] * scaled[a, j] / n
        term = product
        total = total + term
    for _ in range(halvings):
        product = np.zeros((m, m))
        for i in range(m):
            for j in range(m):
                for a in range(m):
                    product[i, j] += total[i, a] * total[a, j]
        total = product
    for i in range(m):
        row = 0.0
        for j in range(m):
            total[i, j] = max(total[i, j], 0.0)
            row += total[i, j]
        for j in range(m):
            pi[i, j] = total[i, j] / row


@compiled
def _cycle(setup: Setup, w: Work, z: FloatArray, known: int, dt: float, level: int) -> tuple[int, float, float, int]:
    """Mix, predict, gate and update: flags, NIS, log-likelihood and how many components were used."""
    models = setup.motions.size
    flag = 0
    if not _predict(setup, w, dt):
        flag = OVERHEAD
        for i in range(1, 3):
            if w.plot[1, i] > 0.0:
                w.plot[1, i] = 0.0
                known -= 1
    for j in range(models):
        polar_innovation(z, w.plot, w.vector[AT, j], w.matrix[H, j], w.vector[NU, j], w.matrix[R, j])
        innovation_covariance(w.p[PREDICTED, j], w.matrix[H, j], w.matrix[R, j], w.matrix[S, j])
    nis = math.nan
    if level > LIKELIHOOD or setup.limits[GATE, 0] < math.inf:
        _mixture(models, w)
        if known > 0:
            if math.isnan(cholesky_inverse(w.mean[2:], w.inverse)):
                return flag | BROKEN, nis, 0.0, 0
            nis = quadratic(w.inverse, w.mean[1])
            if nis > setup.limits[GATE, known - 1]:
                flag |= GATED
            elif nis > setup.limits[LIMIT, known - 1]:
                flag |= ABSURD
    value = 0.0
    if known > 0 and not flag & GATED:
        value = _update(setup, w, z, known)
    else:
        for j in range(models):
            w.weight[MU, j] = w.weight[CBAR, j]
            for a in range(9):
                w.x[FILTERED, j, a] = w.x[PREDICTED, j, a]
                for b in range(9):
                    w.p[FILTERED, j, a, b] = w.p[PREDICTED, j, a, b]
    sound = math.isfinite(value)
    for j in range(models):
        if setup.table[j, PARALLEL] > 0.0:
            forbid_parallel_turn(setup.table[j, PARALLEL], w.x[FILTERED, j], w.p[FILTERED, j], w.scratch)
        for a in range(6):
            variance = w.p[FILTERED, j, a, a]
            sound = sound and math.isfinite(w.x[FILTERED, j, a]) and variance > 0.0 and variance < math.inf
    return flag if sound else flag | BROKEN, nis, value, known


@compiled
def _predict(setup: Setup, w: Work, dt: float) -> bool:
    """Mix and predict every model, and its measurement; False where azimuth or elevation cannot be used."""
    models = setup.motions.size
    usable = True
    for j in range(models):
        total = 0.0
        for i in range(models):
            w.weight[MIX, i] = w.pi[i, j] * w.weight[MU, i]
            total += w.weight[MIX, i]
        w.weight[CBAR, j] = total
        for i in range(models):
            w.weight[MIX, i] = w.weight[MIX, i] / total if total > 0.0 else (1.0 if i == j else 0.0)
        mix(j, setup.motions, setup.padding, setup.table[j, PRIOR], w.weight[MIX], w.x, w.p, w.scratch)
        decay = math.exp(-dt * setup.table[j, DECAY]) if setup.table[j, DECAY] > 0.0 else 1.0
        predict(
            setup.motions[j], dt, decay, w.q[j], w.x[MIXED, j], w.p[MIXED, j], w.x[PREDICTED, j], w.p[PREDICTED, j],
            w.scratch,
        )  # fmt: skip
        if not measure(w.x[PREDICTED, j], w.vector[AT, j], w.matrix[H, j]):
            usable = False
    return usable


@compiled
def _mixture(models: int, w: Work) -> None:
    """Predicted measurement, innovation and its covariance of the mixture of models, weighted by cbar."""
    for i in range(5):
        for k in range(3):
            w.mean[i, k] = 0.0
    for what in range(2):  # AT, NU: azimuths relative to the first model's, so that north is nowhere special
        for j in range(models):
            for i in range(3):
                difference = w.vector[what, j, i] - w.vector[what, 0, i]
                w.mean[what, i] += w.weight[CBAR, j] * (wrap(difference) if i == 1 else difference)
        for i in range(3):
            w.mean[what, i] += w.vector[what, 0, i]
        w.mean[what, 1] = wrap(w.mean[what, 1])
    for j in range(models):
        d0 = w.vector[NU, j, 0] - w.mean[1, 0]
        d1 = wrap(w.vector[NU, j, 1] - w.mean[1, 1])
        d2 = w.vector[NU, j, 2] - w.mean[1, 2]
        d = (d0, d1, d2)
        for i in range(3):
            for k in range(3):
                w.mean[2 + i, k] += w.weight[CBAR, j] * (w.matrix[S, j, i, k] + d[i] * d[k])


@compiled
def _update(setup: Setup, w: Work, z: FloatArray, known: int) -> float:
    """Update every model and the probabilities; gives the log-likelihood of the plot, NaN when an update fails."""
    models = setup.motions.size
    top = -math.inf
    for j in range(models):
        h, r, s, nu = w.matrix[H, j], w.matrix[R, j], w.matrix[S, j], w.vector[NU, j]
        if setup.update != EKF and known == 3:
            cartesian_innovation(setup.update, z, w.plot[0], w.vector[AT, j], w.x[PREDICTED, j], nu, r)
            for i in range(3):
                for k in range(3):
                    h[i, k] = 1.0 if i == k else 0.0
            innovation_covariance(w.p[PREDICTED, j], h, r, s)
        log_det = cholesky_inverse(s, w.inverse)
        if math.isnan(log_det):
            return math.nan
        w.weight[LOG_L, j] = -0.5 * (quadratic(w.inverse, nu) + log_det + known * LOG_2PI)
        joseph(
            states_of(setup.motions[j]), h, r, w.inverse, nu, w.x[PREDICTED, j], w.p[PREDICTED, j], w.x[FILTERED, j],
            w.p[FILTERED, j], w.shrink[j], w.scratch,
        )  # fmt: skip
        if w.weight[CBAR, j] > 0.0:
            top = max(top, w.weight[LOG_L, j])
    total = 0.0
    for j in range(models):
        c = w.weight[CBAR, j]
        w.weight[MU, j] = c * math.exp(w.weight[LOG_L, j] - top) if c > 0.0 else 0.0
        total += w.weight[MU, j]
    for j in range(models):
        w.weight[MU, j] /= total
    return top + math.log(total)


@compiled
def _merge(models: int, weights: FloatArray, x: FloatArray, p: FloatArray, row: FloatArray) -> None:
    """Mean (6) and covariance (36) of position and velocity over the models, into 42 numbers of `row`."""
    for a in range(42):
        row[a] = 0.0
    for j in range(models):
        for a in range(6):
            row[a] += weights[j] * x[j, a]
    for j in range(models):
        for a in range(6):
            d = x[j, a] - row[a]
            for b in range(6):
                row[6 + 6 * a + b] += weights[j] * (p[j, a, b] + d * (x[j, b] - row[b]))


@compiled
def _write_state(models: int, w: Work, level: int, row: FloatArray) -> None:
    """The state of a row, the models' probabilities and, for smoothing, their densities."""
    _merge(models, w.weight[MU], w.x[FILTERED], w.p[FILTERED], row[STATE:])
    for j in range(models):
        row[PROBABILITY + j] = w.weight[MU, j]
    if level == DETAIL:
        _write_models(models, w.x[FILTERED], w.p[FILTERED], row[PROBABILITY + 2 * models :])


@compiled
def _write_models(models: int, x: FloatArray, p: FloatArray, row: FloatArray) -> None:
    column = 0
    for j in range(models):
        for a in range(9):
            row[column + a] = x[j, a]
            for b in range(9):
                row[column + 9 + 9 * a + b] = p[j, a, b]
        column += 90


@compiled
def _write_update(
    models: int, w: Work, z: FloatArray, known: int, flag: int, nis: float, value: float, dt: float, level: int,
    row: FloatArray,
) -> None:  # fmt: skip
    """What a row with a prediction has beside its state."""
    _merge(models, w.weight[CBAR], w.x[PREDICTED], w.p[PREDICTED], row[PREDICTED_STATE:])
    for i in range(3):
        row[AT_COLUMN + i] = w.mean[0, i]
        if math.isfinite(z[i]):
            difference = z[i] - w.mean[0, i]
            row[INNOVATION + i] = wrap(difference) if i == 1 else difference
        for k in range(3):
            if w.plot[1, i] > 0.0 and w.plot[1, k] > 0.0:
                row[INNOVATION_COVARIANCE + 3 * i + k] = w.mean[2 + i, k]
    row[NIS] = nis
    used = known > 0 and not flag & GATED
    row[DOF] = known if used else 0
    row[LIKELIHOOD_COLUMN] = value
    for a in range(6):
        row[GAINS + a] = 0.0
    if used:
        _write_gains(models, w, dt, row[GAINS:])
    if level == DETAIL:
        for j in range(models):
            row[PROBABILITY + models + j] = w.weight[CBAR, j]
        _write_models(models, w.x[PREDICTED], w.p[PREDICTED], row[PROBABILITY + 92 * models :])


@compiled
def _write_gains(models: int, w: Work, dt: float, row: FloatArray) -> None:
    """Weight of a residual along the line of sight, up and across, in position and (times dt) in velocity."""
    az, el = w.mean[0, 1], w.mean[0, 2]
    ca, sa, ce, se = math.cos(az), math.sin(az), math.cos(el), math.sin(el)
    axes = w.scratch
    axes[0, 0], axes[0, 1], axes[0, 2] = ce * ca, ce * sa, se
    axes[1, 0], axes[1, 1], axes[1, 2] = -se * ca, -se * sa, ce
    axes[2, 0], axes[2, 1], axes[2, 2] = -sa, ca, 0.0
    for i in range(3):
        for j in range(models):
            for a in range(3):
                for b in range(3):
                    part = w.weight[MU, j] * axes[i, a] * axes[i, b]
                    row[2 * i] += part * w.shrink[j, a, b]
                    row[2 * i + 1] += part * w.shrink[j, 3 + a, b] * dt
