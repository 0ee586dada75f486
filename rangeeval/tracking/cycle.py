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

from rangeeval.compiled import compiled_borrowing, compiled_inside
from rangeeval.tracking.layout import (
    AT,
    CBAR,
    DENSITY,
    FILTERED,
    FILTERED_P,
    GAIN,
    KNOWN,
    LOG_L,
    MIX,
    MU,
    NU,
    PLOT,
    PREDICTED,
    PRODUCT,
    SQUARE,
    VARIANCE,
    WIDTH,
    H,
    P,
    S,
)
from rangeeval.tracking.mixing import mix
from rangeeval.tracking.motion import CA, CT, CV, predict, process_noise
from rangeeval.tracking.polar import EKF, measure, wrap
from rangeeval.tracking.starting import start, turn_from_acceleration
from rangeeval.tracking.updating import (
    cartesian_innovation,
    correct,
    forbid_parallel_turn,
    polar_innovation,
    project,
    whiten,
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

# Columns of what is written for each plot; the models' probabilities and details follow.
STATE, COVARIANCE, PREDICTED_STATE, PREDICTED_COVARIANCE, AT_COLUMN, INNOVATION = 0, 6, 42, 48, 84, 87
INNOVATION_COVARIANCE, NIS, DOF, LIKELIHOOD_COLUMN, GAINS, PROBABILITY = 90, 99, 100, 101, 102, 108


def scratch(models: int) -> tuple[FloatArray, FloatArray]:
    """Room for the kernel to work in (it owns no array itself): a row for each model and one more, see `layout`; the
    plots of a start.
    """
    return np.zeros((models + 1, WIDTH)), np.zeros((3, 7))


@compiled_borrowing
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
    s: FloatArray,
    starts: FloatArray,
) -> None:
    """Run every track, rows offsets[i] to offsets[i + 1], through the filter.

    The first five are a `Setup`, the last two `scratch`. `rows` (n, 7): time, range, azimuth, elevation and their
    sigmas. Writes the log-likelihood of each track into `total` and, above level LIKELIHOOD, each plot's row of `out`
    (columns above) and of `flags`.
    """
    both = s[motions.size]
    for track in range(offsets.size - 1):
        collected = 0  # plots of the start so far
        gated = 0  # gated plots in a row
        last = math.nan  # time of the state
        used = math.nan  # time of the newest used plot
        step = math.nan  # interval that pi and the process noise are for
        log_likelihood = 0.0
        flat = planar[track]
        for k in range(offsets[track], offsets[track + 1]):
            t = rows[k, 0]
            for i in range(3):
                sigma = limits[SCALE, i] * rows[k, 4 + i]
                both[PLOT + i] = rows[k, 1 + i]
                both[VARIANCE + i] = sigma * sigma
                both[KNOWN + i] = 1.0 if math.isfinite(rows[k, 1 + i]) else 0.0
            known = int(both[KNOWN] + both[KNOWN + 1] + both[KNOWN + 2])
            placed = both[KNOWN] + both[KNOWN + 1] == 2.0 and (flat or known == 3)
            startable = placed and both[PLOT] > 0.0
            flag = 0
            if known == 0:
                flag = MISSED
            elif known < 3 and not flat:
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
                    _set_step(motions, table, pi, o, step, s)
                last = t
                found, known = _cycle(motions, table, pi, limits, o, known, step, level, s)
                flag |= found
                if found & (GATED | BROKEN):
                    gated += 1
                elif known > 0:
                    gated, used = 0, t
                if found & BROKEN or (gated > 0 and gated == o.restart_after):
                    collected = 0
                    begins = startable
                    runs = False
                    flag |= RESTARTED
                else:
                    log_likelihood += both[LOG_L]
                    if level > LIKELIHOOD:
                        _write_update(motions.size, 0 if found & GATED else known, step, s, out[k])
            if begins:
                starts[collected, 0] = t
                for i in range(3):
                    missing = flat and i == 2
                    starts[collected, 1 + i] = 0.0 if missing else both[PLOT + i]
                    starts[collected, 4 + i] = 0.0 if missing else both[VARIANCE + i]
                collected += 1
                _begin(motions, table, o, collected, starts, flat, s)
                flag |= STARTING
                gated, last, used = 0, t, t
            if level > LIKELIHOOD:
                flags[k] = flag if collected > 0 else flag | MISSED
                if collected > 0:
                    _write_densities(motions.size, runs, level, s, out[k])
        total[track] = log_likelihood


@compiled_inside
def _begin(
    motions: IntArray, table: FloatArray, o: Scalars, count: int, starts: FloatArray, planar: bool, s: FloatArray
) -> None:
    """Start every model from the plots collected so far."""
    # without elevation the height is decoupled, and as wide as the speed allows in a reference interval
    height_sigma = o.speed * o.reference if planar else 0.0
    for j in range(motions.size):
        turns = motions[j] >= CT and o.turn_three_point and count == 3 and not planar
        s[j, MU] = table[j, START]
        start(s[j], count, starts, height_sigma, o.quadratic, o.speed, table[j, PRIOR], turns or motions[j] == CA)
        if turns:
            turn_from_acceleration(s[j], table[j, PRIOR])


@compiled_inside
def _set_step(motions: IntArray, table: FloatArray, pi: FloatArray, o: Scalars, dt: float, s: FloatArray) -> None:
    """Process noise of every model and the transition probabilities over `dt`."""
    models = motions.size
    for j in range(models):
        process_noise(s[j], motions[j], table[j, SIGMA], table[j, SIGMA_TURN], dt, o.reference, o.continuous)
    if models == 1 or math.fabs(dt - o.reference) <= 1e-9 * o.reference:
        for i in range(models):
            for j in range(models):
                pi[2 * models + i, j] = pi[i, j]
    else:
        _exponential(pi, dt, s[models])


@compiled_inside
def _exponential(pi: FloatArray, dt: float, room: FloatArray) -> None:
    """exp(generator dt) into the third m rows of `pi` (3 m, m), whose second m rows are the generator.

    Scaling, Taylor series by Horner's rule, squaring; at most three models.
    """
    m = pi.shape[1]
    scale = dt
    squarings = 0
    for i in range(m):
        while -pi[m + i, i] * scale > 0.25 and squarings < 60:
            scale *= 0.5
            squarings += 1
    for i in range(m):
        for j in range(m):
            pi[2 * m + i, j] = 1.0 if i == j else 0.0
    for n in range(13 + squarings):
        for i in range(m):
            for j in range(m):
                total = 0.0
                for a in range(m):
                    left = pi[m + i, a] * scale / (13 - n) if n < 13 else pi[2 * m + i, a]
                    total += left * pi[2 * m + a, j]
                room[PRODUCT + m * i + j] = total
        for i in range(m):
            for j in range(m):
                pi[2 * m + i, j] = room[PRODUCT + m * i + j] + (1.0 if n < 13 and i == j else 0.0)
    for i in range(m):
        row = 0.0
        for j in range(m):
            if pi[2 * m + i, j] < 0.0:
                pi[2 * m + i, j] = 0.0
            row += pi[2 * m + i, j]
        for j in range(m):
            pi[2 * m + i, j] /= row


@compiled_borrowing
def _over(pi: FloatArray, dt: float, room: FloatArray) -> None:
    _exponential(pi, dt, room)


def probabilities_over(pi: FloatArray, dt: float) -> FloatArray:
    """Transition probabilities (models, models) over `dt` from the generator in `Setup.pi`."""
    found = pi.copy()
    _over(found, float(dt), np.zeros(WIDTH))
    return found[2 * pi.shape[1] :]


@compiled_inside
def _cycle(
    motions: IntArray, table: FloatArray, pi: FloatArray, limits: FloatArray, o: Scalars, known: int, dt: float,
    level: int, s: FloatArray,
) -> tuple[int, int]:  # fmt: skip
    """Mix, predict, gate and update: flags and how many components were used.

    Into the mixture's row: the log-likelihood of the plot and, where there is output or a gate, the mixture's NIS (NaN
    otherwise), predicted measurement, innovation and its covariance.
    """
    models = motions.size
    both = s[models]
    both[LOG_L], both[SQUARE] = 0.0, math.nan
    flag = 0
    for j in range(models):
        own = s[j]
        own[CBAR] = 0.0
        for i in range(models):
            s[i, MIX] = pi[2 * models + i, j] * s[i, MU]
            own[CBAR] += s[i, MIX]
        for i in range(models):
            s[i, MIX] = s[i, MIX] / own[CBAR] if own[CBAR] > 0.0 else (1.0 if i == j else 0.0)
        mix(s, j, motions, o.padding, table[j, PRIOR])
        decay = math.exp(-dt * table[j, DECAY]) if table[j, DECAY] > 0.0 else 1.0
        predict(own, motions[j], dt, decay)
        if not measure(own):
            flag = OVERHEAD
    if flag == OVERHEAD:
        both[KNOWN + 1], both[KNOWN + 2] = 0.0, 0.0
        known = int(both[KNOWN])
    for j in range(models):
        polar_innovation(s[j], both)
        project(s[j])
    if level > LIKELIHOOD or limits[GATE, 0] < math.inf:
        _mixture(models, s)
        if known > 0:
            if math.isnan(whiten(both)):
                return flag | BROKEN, 0
            if both[SQUARE] > limits[GATE, known - 1]:
                flag |= GATED
            elif both[SQUARE] > limits[LIMIT, known - 1]:
                flag |= ABSURD
    if known > 0 and not flag & GATED:
        _update(motions, o, known, s)
    else:
        for j in range(models):
            s[j, MU] = s[j, CBAR]
            for c in range(DENSITY):
                s[j, FILTERED + c] = s[j, PREDICTED + c]
    sound = math.isfinite(both[LOG_L])
    for j in range(models):
        own = s[j]
        if table[j, PARALLEL] > 0.0:
            forbid_parallel_turn(own, table[j, PARALLEL])
        for a in range(6):
            limit = math.inf if a % 3 == 2 else DIVERGED  # the height may not be observed at all
            variance = own[FILTERED_P + 10 * a]
            sound = sound and math.isfinite(own[FILTERED + a]) and 0.0 < variance < limit
    return flag if sound else flag | BROKEN, known


@compiled_inside
def _mixture(models: int, s: FloatArray) -> None:
    """Predicted measurement, innovation and its covariance of the mixture of models, weighted by CBAR."""
    both, first = s[models], s[0]
    for c in range(9):
        both[S + c] = 0.0
    for i in range(6):  # AT, then NU; azimuths relative to the first model's, so that the cut at -pi is nowhere special
        both[AT + i] = first[AT + i]
        for j in range(1, models):
            difference = s[j, AT + i] - first[AT + i]
            both[AT + i] += s[j, CBAR] * (wrap(difference) if i % 3 == 1 else difference)
    both[AT + 1], both[NU + 1] = wrap(both[AT + 1]), wrap(both[NU + 1])
    for j in range(models):
        own = s[j]
        for i in range(3):
            difference = own[NU + i] - both[NU + i]
            own[PRODUCT + i] = wrap(difference) if i == 1 else difference
        for i in range(3):
            for k in range(3):
                both[S + 3 * i + k] += own[CBAR] * (own[S + 3 * i + k] + own[PRODUCT + i] * own[PRODUCT + k])


@compiled_inside
def _update(motions: IntArray, o: Scalars, known: int, s: FloatArray) -> None:
    """Update every model and the probabilities; the plot's log-likelihood, NaN when an update fails, into the
    mixture's row.
    """
    models = motions.size
    both = s[models]
    both[LOG_L] = math.nan
    top = -math.inf
    for j in range(models):
        own = s[j]
        if o.update != EKF and known == 3:
            cartesian_innovation(own, both, o.update)
            project(own)
        log_det = whiten(own)
        if math.isnan(log_det):
            return
        own[LOG_L] = -0.5 * (own[SQUARE] + log_det + known * LOG_2PI)
        correct(own, 6 if motions[j] == CV else 9)
        if own[CBAR] > 0.0:
            top = own[LOG_L] if own[LOG_L] > top else top
    total = 0.0
    for j in range(models):
        s[j, MU] = s[j, CBAR] * math.exp(s[j, LOG_L] - top) if s[j, CBAR] > 0.0 else 0.0
        total += s[j, MU]
    for j in range(models):
        s[j, MU] /= total
    both[LOG_L] = top + math.log(total)


@compiled_inside
def _write_densities(models: int, predicted: bool, level: int, s: FloatArray, out: FloatArray) -> None:
    """Mean and covariance of position and velocity and the models' probabilities, after and before the plot; for
    smoothing the models' densities.
    """
    for what in range(2 if predicted else 1):
        at, weight, to = (FILTERED, MU, STATE) if what == 0 else (PREDICTED, CBAR, PREDICTED_STATE)
        for c in range(to, to + 42):
            out[c] = 0.0
        for j in range(models):
            own = s[j]
            for a in range(6):
                out[to + a] += own[weight] * own[at + a]
        for j in range(models):
            own = s[j]
            w = own[weight]
            for a in range(6):
                d = own[at + a] - out[to + a]
                for b in range(6):
                    spread = own[at + P + 9 * a + b] + d * (own[at + b] - out[to + b])
                    out[to + 6 + 6 * a + b] += w * spread
            if what == 0 or level == DETAIL:
                out[PROBABILITY + what * models + j] = w
            if level == DETAIL:
                first = PROBABILITY + (2 + DENSITY * what) * models + DENSITY * j
                for c in range(DENSITY):
                    out[first + c] = own[at + c]


@compiled_inside
def _write_update(models: int, used: int, dt: float, s: FloatArray, out: FloatArray) -> None:
    """What a row with a prediction has beside its densities; `used` components were."""
    both = s[models]
    for i in range(3):
        out[AT_COLUMN + i] = both[AT + i]
        difference = both[PLOT + i] - both[AT + i]
        if math.isfinite(difference):
            out[INNOVATION + i] = wrap(difference) if i == 1 else difference
        for c in range(3):
            if both[KNOWN + i] > 0.0 and both[KNOWN + c] > 0.0:
                out[INNOVATION_COVARIANCE + 3 * i + c] = both[S + 3 * i + c]
    out[NIS], out[DOF], out[LIKELIHOOD_COLUMN] = both[SQUARE], used, both[LOG_L]
    if used > 0:
        _write_gains(models, dt, s, out)


@compiled_inside
def _write_gains(models: int, dt: float, s: FloatArray, out: FloatArray) -> None:
    """Weight of a residual along the line of sight, up and across, in position and (times dt) in velocity: d' K H d for
    each of these directions d.
    """
    both, axes = s[models], PRODUCT
    ca, sa, ce, se = math.cos(both[AT + 1]), math.sin(both[AT + 1]), math.cos(both[AT + 2]), math.sin(both[AT + 2])
    both[axes], both[axes + 1], both[axes + 2] = ce * ca, ce * sa, se
    both[axes + 3], both[axes + 4], both[axes + 5] = -se * ca, -se * sa, ce
    both[axes + 6], both[axes + 7], both[axes + 8] = -sa, ca, 0.0
    for i in range(3):
        for j in range(models):
            own = s[j]
            for m in range(3):
                seen, position, velocity = 0.0, 0.0, 0.0
                for a in range(3):
                    d = both[axes + 3 * i + a]
                    seen += own[H + 3 * m + a] * d
                    position += own[GAIN + 9 * m + a] * d
                    velocity += own[GAIN + 9 * m + 3 + a] * d
                out[GAINS + 2 * i] += own[MU] * seen * position
                out[GAINS + 2 * i + 1] += own[MU] * seen * velocity * dt
