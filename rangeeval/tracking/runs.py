"""Run recorded plots through a tracking filter: one call gives every update of a track, another smooths it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from rangeeval.angles import wrapped
from rangeeval.tracking import beam, polar
from rangeeval.tracking.alpha_beta import is_stable
from rangeeval.tracking.cycle import (
    AT_COLUMN,
    COVARIANCE,
    DETAIL,
    DOF,
    GAINS,
    INNOVATION,
    INNOVATION_COVARIANCE,
    LIKELIHOOD,
    LIKELIHOOD_COLUMN,
    NIS,
    PREDICTED_COVARIANCE,
    PREDICTED_STATE,
    PROBABILITY,
    STATE,
    UPDATES,
    Setup,
    run_tracks,
    scratch,
)
from rangeeval.tracking.filters import AlphaBeta, AnyFilter, Filter
from rangeeval.tracking.measurements import Measurements
from rangeeval.tracking.setups import limits_of, setup_of
from rangeeval.tracking.smoothing import Densities, backward, merged, retrodicted

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Flag(IntFlag):
    """What happened at an update; several may hold, 0 is an ordinary update."""

    STARTING = 1  # a plot the track was started from: no prediction, no innovation
    MISSED = 2  # nothing measured: the state is the prediction
    PARTIAL = 4  # some components measured, not all
    GATED = 8  # measured but outside the gate: not used, the state is the prediction
    RESTARTED = 16  # the track was given up and starts anew with this plot (STARTING holds too)
    ABSURD = 32  # used, but the NIS is beyond any chance (1e-12): the filter's assumptions do not fit
    BROKEN = 64  # the numbers broke down (not finite, or a covariance not positive definite): the track starts anew
    REPEATED = 128  # the same time as the plot before
    DISORDERED = 256  # earlier than the plot before, or no time: not used
    OVERHEAD = 512  # so near to the zenith that azimuth says nothing: azimuth not used


@dataclass(frozen=True)
class Run:
    """Every update of one track: arrays with one row a plot (n), in the order of the measurements.

    Attributes
    ----------
    state : (n, 6), filtered position (m) and velocity (m/s), ENU; of a missed or gated plot the prediction.
    covariance : (n, 6, 6); NaN for alpha-beta, which has none.
    predicted_state, predicted_covariance : (n, 6), (n, 6, 6), before the update; NaN while starting.
    predicted : (n, 3), predicted range, azimuth (counter-clockwise from x), elevation; NaN while starting.
    innovation : (n, 3), measured less predicted, azimuth wrapped; NaN where a component was not measured. Gated plots
        have theirs too.
    innovation_covariance : (n, 3, 3), of the (mixture's) innovation; an unmeasured component has row and column NaN.
    nis : (n,), normalised innovation squared with `nis_dof` (n,) degrees of freedom; NaN without innovation. `nis_dof`
        is 0 where the plot was not used, so also where it was gated.
    log_likelihood : (n,), log density of the plot given those before, of range, azimuth and elevation; 0 where none
        was used. With a converted-measurement update it is that of the Cartesian position (per m^3).
    mode_probability : (n, models), after the update.
    gains : (n, 3, 2), alpha and beta of range, elevation (y), azimuth (z): the weight of a residual in position and,
        times the interval, in rate along the line of sight and across it. 0 where no update was made.
    flags : (n,), of `Flag`.
    planar : no elevation at all: the third axis is not estimated, leave it out.
    """

    filter: AnyFilter
    measurements: Measurements
    state: FloatArray
    covariance: FloatArray
    predicted_state: FloatArray
    predicted_covariance: FloatArray
    predicted: FloatArray
    innovation: FloatArray
    innovation_covariance: FloatArray
    nis: FloatArray
    nis_dof: IntArray
    log_likelihood: FloatArray
    mode_probability: FloatArray
    gains: FloatArray
    flags: IntArray
    planar: bool
    detail: Detail | None = field(repr=False, default=None)

    @property
    def used(self) -> NDArray[np.bool_]:
        """(n,), the updates that entered the likelihood: measured, not gated, not starting."""
        return self.nis_dof > 0

    @property
    def total_log_likelihood(self) -> float:
        """Sum over the used updates."""
        return float(np.sum(self.log_likelihood))


@dataclass(frozen=True)
class Detail:
    """What smoothing needs of each update: every model's densities (n, models, 9) and (n, models, 9, 9)."""

    state: FloatArray
    covariance: FloatArray
    predicted_state: FloatArray
    predicted_covariance: FloatArray
    predicted_probability: FloatArray


@dataclass(frozen=True)
class Smoothed:
    """The best estimate of a trajectory from all plots, before and after: one row a plot.

    It is correlated with the plots. Residuals against it have covariance `residual_covariance` = R - H P H', not R.

    Attributes
    ----------
    state, covariance : (n, 6), (n, 6, 6), ENU.
    mode_probability : (n, models).
    residual : (n, 3), measured less smoothed; NaN where not measured.
    residual_covariance : (n, 3, 3).
    """

    state: FloatArray
    covariance: FloatArray
    mode_probability: FloatArray
    residual: FloatArray
    residual_covariance: FloatArray


def run(spec: AnyFilter, measurements: Measurements, *, detail: bool = False) -> Run:
    """Run one track through a filter; with `detail` the run can be smoothed."""
    return run_many(spec, [measurements], detail=detail)[0]


def run_many(spec: AnyFilter, tracks: Sequence[Measurements], *, detail: bool = False) -> list[Run]:
    """Run many tracks (or Monte Carlo runs) through a filter in one compiled call; the same numbers as one by one.

    Raises
    ------
    ValueError : the filter's numbers make no sense, or its transition probabilities cannot be spread over other
        intervals than their own and the plots need that.
    """
    if isinstance(spec, AlphaBeta):
        return _run_beam(spec, tracks)
    batch = Batch.of(tracks)
    level = DETAIL if detail else UPDATES
    table, flags = run_table(spec, batch, level)[1:]
    return [_cut(spec, track, batch, i, table, flags, detail) for i, track in enumerate(tracks)]


def log_likelihood(spec: Filter, tracks: Sequence[Measurements] | Batch) -> FloatArray:
    """The log-likelihood (tracks,) of each track: `run` reduced to what tuning needs."""
    return run_table(spec, tracks if isinstance(tracks, Batch) else Batch.of(tracks), LIKELIHOOD)[0]


def run_table(spec: Filter, batch: Batch, level: int) -> tuple[FloatArray, FloatArray, IntArray]:
    """The kernel's own output: log-likelihood of each track, and above level LIKELIHOOD the table and flags of the
    rows.
    """
    setup = setup_of(spec)
    _check_intervals(setup, batch)
    models = len(spec.models)
    n = len(batch.rows) if level > LIKELIHOOD else 0
    total = np.zeros(batch.planar.size)
    table = np.full((n, PROBABILITY + models * (182 if level == DETAIL else 1)), np.nan)
    table[:, DOF:PROBABILITY] = 0.0
    flags = np.zeros(n, dtype=np.int64)
    run_tracks(*setup, level, batch.offsets, batch.rows, batch.planar, total, table, flags, *scratch(models))
    return total, table, flags


@dataclass(frozen=True)
class Batch:
    """Tracks end to end: `rows` (n, 7) of time, range, azimuth, elevation and sigmas; rows `offsets[i]` to
    `offsets[i + 1]` are track i.
    """

    offsets: IntArray
    rows: FloatArray
    planar: NDArray[np.bool_]

    @classmethod
    def of(cls, tracks: Sequence[Measurements]) -> Batch:
        """Tracks end to end."""
        offsets = np.zeros(len(tracks) + 1, dtype=np.int64)
        np.cumsum([len(track) for track in tracks], out=offsets[1:])
        rows = np.empty((int(offsets[-1]), 7))
        for i, track in enumerate(tracks):
            part = rows[offsets[i] : offsets[i + 1]]
            part[:, 0], part[:, 1:4], part[:, 4:7] = track.time_s, track.z, track.sigma
        return cls(offsets, rows, np.array([track.planar for track in tracks], dtype=np.bool_))


def smooth(run: Run) -> Smoothed:
    """Smooth a run made with `detail=True`: RTS for one model, the IMM smoother with pair weights for several.

    Each stretch between a start and the next restart is smoothed for itself; the plots before the last one of a start
    get its state carried back at constant velocity. Rows without any state stay NaN.

    Raises
    ------
    ValueError : the run holds no detail, or is of an alpha-beta filter (which has no covariances).
    """
    return smooth_many([run])[0]


def smooth_many(runs: Sequence[Run]) -> list[Smoothed]:
    """Smooth runs of one filter; runs with the same times and flags are smoothed in one go (as in a Monte Carlo)."""
    alike: dict[bytes, list[int]] = {}
    for i, each in enumerate(runs):
        if not isinstance(each.filter, Filter):
            raise ValueError("an alpha-beta filter has no covariances to smooth with; smooth a Kalman or IMM run")
        if each.detail is None:
            raise ValueError("the run holds no detail of its models; make it with detail=True")
        key = each.measurements.time_s.tobytes() + each.flags.tobytes() + repr(each.filter).encode()
        alike.setdefault(key, []).append(i)
    found: dict[int, Smoothed] = {}
    for group in alike.values():
        found.update(zip(group, _smooth_alike([runs[i] for i in group]), strict=True))
    return [found[i] for i in range(len(runs))]


def _smooth_alike(runs: Sequence[Run]) -> list[Smoothed]:
    first = runs[0]
    assert isinstance(first.filter, Filter)
    setup = setup_of(first.filter)
    time = first.measurements.time_s
    details = [each.detail for each in runs if each.detail is not None]
    filtered = Densities(
        np.stack([d.state for d in details], 1),
        np.stack([d.covariance for d in details], 1),
        np.stack([each.mode_probability for each in runs], 1),
    )
    predicted = Densities(
        np.stack([d.predicted_state for d in details], 1),
        np.stack([d.predicted_covariance for d in details], 1),
        np.stack([d.predicted_probability for d in details], 1),
    )
    state = np.stack([each.state for each in runs], 1)
    covariance = np.stack([each.covariance for each in runs], 1)
    probability = filtered.probability.copy()
    stepped = np.isfinite(predicted.state[:, 0, 0, 0])
    starting = (first.flags & Flag.STARTING) > 0
    rows = np.flatnonzero(stepped | starting)
    densities, later = None, -1
    for row in rows[::-1]:
        if densities is None or (first.flags[later] & Flag.RESTARTED):
            densities = Densities(*(part[row] for part in filtered))
        elif stepped[later]:
            dt = float(time[later] - time[row])
            densities = backward(
                setup,
                densities,
                Densities(*(part[later] for part in predicted)),
                Densities(*(part[row] for part in filtered)),
                dt,
            )
        else:  # a plot of the start before its last
            carried = retrodicted(setup, state[later], covariance[later], float(time[later] - time[row]))
            state[row], covariance[row], later = *carried, row
            continue
        state[row], covariance[row] = merged(densities)
        probability[row], later = densities.probability, row
    return [_against_plots(each, state[:, i], covariance[:, i], probability[:, i]) for i, each in enumerate(runs)]


def _against_plots(run: Run, state: FloatArray, covariance: FloatArray, probability: FloatArray) -> Smoothed:
    assert isinstance(run.filter, Filter)
    m = run.measurements
    residual = m.z - polar.of_position(state[:, :3])
    residual[:, 1] = wrapped(residual[:, 1])
    h = polar.jacobian(state[:, :3])
    noise = np.einsum("ni,ij->nij", (m.sigma * np.array(run.filter.noise_scale)) ** 2, np.eye(3))
    left = noise - h @ covariance[:, :3, :3] @ np.swapaxes(h, -1, -2)
    unknown = ~np.isfinite(residual)
    left[unknown] = np.nan
    np.swapaxes(left, -1, -2)[unknown] = np.nan
    return Smoothed(state, covariance, probability, residual, left)


def _run_beam(spec: AlphaBeta, tracks: Sequence[Measurements]) -> list[Run]:
    batch = Batch.of(tracks)
    n = len(batch.rows)
    out = np.full((n, beam.WIDTH), np.nan)
    out[:, beam.DOF :] = 0.0
    flags = np.zeros(n, dtype=np.int64)
    fixed = np.full(6, np.nan)
    if (spec.alpha is None) != (spec.beta is None):
        raise ValueError("alpha and beta go together: give both, or neither for gains by the tracking index")
    if spec.alpha is not None and spec.beta is not None:
        fixed[0::2], fixed[1::2] = spec.alpha, spec.beta
        if not np.all(is_stable(fixed[0::2], fixed[1::2])):
            raise ValueError(
                f"gains alpha {spec.alpha} and beta {spec.beta} are not stable; 2 alpha + beta must be below 4"
            )
    beam.run_tracks(
        fixed,
        float(spec.design_acceleration_m_s2),
        math.nan if spec.heading_rad is None else math.pi / 2 - spec.heading_rad,
        float(spec.tilt_rad),
        limits_of(spec),
        int(spec.restart_after),
        float(spec.restart_gap_s),
        batch.offsets,
        batch.rows,
        batch.planar,
        out,
        flags,
    )
    return [_cut_beam(spec, track, batch, i, out, flags) for i, track in enumerate(tracks)]


def _cut_beam(spec: AlphaBeta, track: Measurements, batch: Batch, i: int, out: FloatArray, flags: IntArray) -> Run:
    part = out[batch.offsets[i] : batch.offsets[i + 1]]
    n = len(part)
    missing = np.full((n, 6, 6), np.nan)
    variances = np.full((n, 3, 3), np.nan)
    known = np.isfinite(part[:, beam.VARIANCE : beam.VARIANCE + 3])
    variances[known[:, :, None] & known[:, None, :]] = 0.0
    variances[:, range(3), range(3)] = part[:, beam.VARIANCE : beam.VARIANCE + 3]
    return Run(
        filter=spec,
        measurements=track,
        state=part[:, beam.STATE : beam.STATE + 6],
        covariance=missing,
        predicted_state=part[:, beam.PREDICTED_STATE : beam.PREDICTED_STATE + 6],
        predicted_covariance=missing,
        predicted=part[:, beam.PREDICTED : beam.PREDICTED + 3],
        innovation=part[:, beam.INNOVATION : beam.INNOVATION + 3],
        innovation_covariance=variances,
        nis=part[:, beam.NIS],
        nis_dof=part[:, beam.DOF].astype(np.int64),
        log_likelihood=part[:, beam.LIKELIHOOD],
        mode_probability=np.ones((n, 1)),
        gains=part[:, beam.GAINS : beam.GAINS + 6].reshape(n, 3, 2),
        flags=flags[batch.offsets[i] : batch.offsets[i + 1]],
        planar=bool(batch.planar[i]),
    )


def _cut(
    spec: Filter, track: Measurements, batch: Batch, i: int, table: FloatArray, flags: IntArray, detail: bool
) -> Run:
    """Track `i`'s part of the kernel's table, column by column."""
    part = table[batch.offsets[i] : batch.offsets[i + 1]]
    n, m = len(part), len(spec.models)

    def columns(start: int, *shape: int) -> FloatArray:
        return part[:, start : start + math.prod(shape)].reshape(n, *shape)

    def models(start: int) -> tuple[FloatArray, FloatArray]:
        both = columns(start, m, 90)
        return both[:, :, :9], both[:, :, 9:].reshape(n, m, 9, 9)

    more = None
    if detail:
        filtered, predicted = models(PROBABILITY + 2 * m), models(PROBABILITY + 92 * m)
        more = Detail(*filtered, *predicted, columns(PROBABILITY + m, m))
    return Run(
        filter=spec,
        measurements=track,
        state=columns(STATE, 6),
        covariance=columns(COVARIANCE, 6, 6),
        predicted_state=columns(PREDICTED_STATE, 6),
        predicted_covariance=columns(PREDICTED_COVARIANCE, 6, 6),
        predicted=columns(AT_COLUMN, 3),
        innovation=columns(INNOVATION, 3),
        innovation_covariance=columns(INNOVATION_COVARIANCE, 3, 3),
        nis=part[:, NIS],
        nis_dof=part[:, DOF].astype(np.int64),
        log_likelihood=part[:, LIKELIHOOD_COLUMN],
        mode_probability=columns(PROBABILITY, m),
        gains=columns(GAINS, 3, 2),
        flags=flags[batch.offsets[i] : batch.offsets[i + 1]],
        planar=bool(batch.planar[i]),
        detail=more,
    )


def _check_intervals(setup: Setup, batch: Batch) -> None:
    """Refuse plots at other intervals than the reference when the transition probabilities have no generator."""
    if np.all(np.isfinite(setup.pi)):
        return
    steps = np.diff(batch.rows[:, 0])
    steps[batch.offsets[1:-1] - 1] = setup.scalars.reference
    if np.any(np.abs(steps - setup.scalars.reference) > 1e-9 * setup.scalars.reference):
        raise ValueError(
            "these transition probabilities leave a model sooner than one reference interval "
            f"({setup.scalars.reference:g} s) and cannot be spread over the plots' other intervals; "
            "give larger probabilities of staying"
        )
