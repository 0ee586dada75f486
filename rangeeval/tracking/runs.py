"""Run recorded plots through a tracking filter: one call gives every update of a track, another smooths it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from rangeeval.tracking.filters import AnyFilter, Filter
from rangeeval.tracking.measurements import Measurements

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
    REPAIRED = 64  # a covariance was not positive definite and was repaired, or the update had to be skipped
    REPEATED = 128  # the same time as the plot before
    DISORDERED = 256  # earlier than the plot before, or no time: not used
    OVERHEAD = 512  # so near to the zenith that azimuth says nothing: azimuth not used


@dataclass(frozen=True)
class Run:
    """Every update of one track: arrays with one row a plot (n), in the order of the measurements.

    Attributes
    ----------
    state : (n, 6), filtered position (m) and velocity (m/s), ENU; of a missed or gated plot the prediction.
    covariance : (n, 6, 6).
    predicted_state, predicted_covariance : (n, 6), (n, 6, 6), before the update; NaN while starting.
    predicted : (n, 3), predicted range, azimuth (counter-clockwise from x), elevation; NaN while starting.
    innovation : (n, 3), measured less predicted, azimuth wrapped; NaN where a component was not measured. Gated plots
        have theirs too.
    innovation_covariance : (n, 3, 3), of the (mixture's) innovation; an unmeasured component has row and column NaN.
    nis : (n,), normalised innovation squared with `nis_dof` (n,) degrees of freedom; NaN and 0 without innovation.
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
    """Run many tracks (or Monte Carlo runs) through a filter in one compiled call; the same numbers as one by one."""
    raise NotImplementedError


def log_likelihood(spec: Filter, tracks: Sequence[Measurements]) -> FloatArray:
    """The log-likelihood (tracks,) of each track: `run` reduced to what tuning needs."""
    raise NotImplementedError


def smooth(run: Run) -> Smoothed:
    """Smooth a run made with `detail=True`: RTS for one model, the IMM smoother with pair weights for several.

    Raises
    ------
    ValueError : the run holds no detail, or is of an alpha-beta filter (which has no covariances).
    """
    raise NotImplementedError
