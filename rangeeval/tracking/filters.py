"""The tracking filters that recorded plots can be run through: what each assumes, in SI units.

A `Filter` is one motion model (a Kalman filter) or several (an interacting multiple model filter, IMM). `AlphaBeta` is
the fixed-gain filter in beam coordinates. `FILTERS` names the ready-made ones; `dataclasses.replace` changes a value.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Motion = Literal["cv", "ca", "ct", "ct-second-order"]
Padding = Literal["reset", "zero", "unbiased", "unbiased-cross"]
Update = Literal["ekf", "converted", "unbiased", "decorrelated"]
Start = Literal["three-point", "quadratic", "two-point", "one-point"]
Noise = Literal["discrete", "continuous"]


@dataclass(frozen=True)
class Model:
    """One motion model.

    Attributes
    ----------
    motion : `cv` constant velocity, 6 states [p v]; `ca` constant acceleration, 9 states [p v a]; `ct` constant vector
        turn rate w (dv/dt = w x v), 9 states [p v w], discretised exactly; `ct-second-order` the same to second order
        in the time step.
    sigma_m_s2 : process noise. `cv`, `ct`: acceleration, constant over one reference interval and independent between
        them. `ca`: increment of the acceleration per reference interval.
    sigma_turn_rad_s : `ct`: increment of each component of w per reference interval.
    prior_turn_rad_s : `ct`: sigma of each component of w at the start, and whenever a turn begins (reset padding).
    parallel_turn_rad_s : `ct`: sigma of a pseudo-measurement that w has no part along v (which no motion shows);
        infinite: none is made. Needed when a turn model runs alone; 0.02 does well.
    turn_decay_s : `ct`: time constant with which w decays (first-order Gauss-Markov); infinite: it does not.
    """

    motion: Motion = "cv"
    sigma_m_s2: float = 10.0
    sigma_turn_rad_s: float = 0.0
    prior_turn_rad_s: float = 0.15
    parallel_turn_rad_s: float = math.inf
    turn_decay_s: float = math.inf


@dataclass(frozen=True)
class Filter:
    """A Kalman filter (one model) or an IMM filter (several), and how it starts, updates, gates and restarts.

    Attributes
    ----------
    models : one `Model` each.
    transition : row-stochastic; `transition[i][j]` is the probability of model j one reference interval after model i.
    start_probabilities : of the models at the start; empty: all alike.
    reference_interval_s : the interval to which `transition` and all process noises refer.
    noise : `continuous`: the noise of a step adds up to the same over any division of it, so that plots may come at
        any times; `discrete`: the acceleration is constant over each step, as the source paper has it. Both agree
        with the reference interval in the variance of velocity.
    padding : what a model without turn rate (or acceleration) says about it when it is mixed into one that has it:
        `reset` drawn anew from its prior, `zero` known to be zero, `unbiased` what that model last believed,
        `unbiased-cross` the same with correlations.
    update : `ekf` on range, azimuth, elevation; `converted` to Cartesian, conventional; `unbiased` with the
        multiplicative correction; `decorrelated` unbiased, covariance at the prediction.
    start : from the first plots: `three-point` differences, `quadratic` the same with the velocity at the newest plot,
        `two-point`, `one-point` (velocity zero with `start_speed_m_s`). Fewer plots: the best that they allow.
    turn_start : w at the start: `zero`, or `three-point` from velocity and acceleration (which is noisy).
    start_speed_m_s, start_acceleration_m_s2 : prior sigma of each component where the plots at hand do not show it.
    gate_probability : plots whose NIS exceeds this quantile of chi-square are gated: not used, as if missed. 1: none.
    restart_after : restart the track after this many gated plots in a row; 0: never.
    restart_gap_s : restart after a gap without used plots longer than this.
    noise_scale : factors on the sigmas of range, azimuth, elevation of the measurements.
    """

    models: tuple[Model, ...] = (Model(),)
    transition: tuple[tuple[float, ...], ...] = ((1.0,),)
    start_probabilities: tuple[float, ...] = ()
    reference_interval_s: float = 1.0
    noise: Noise = "continuous"
    padding: Padding = "reset"
    update: Update = "ekf"
    start: Start = "three-point"
    turn_start: Literal["zero", "three-point"] = "zero"
    start_speed_m_s: float = 300.0
    start_acceleration_m_s2: float = 30.0
    gate_probability: float = 1.0
    restart_after: int = 0
    restart_gap_s: float = math.inf
    noise_scale: tuple[float, float, float] = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class AlphaBeta:
    """The alpha-beta filter: prediction in Cartesian, update in beam coordinates (range, y up, z right of the face).

    Attributes
    ----------
    alpha, beta : fixed gains of range, y, z; without them the gains of each update follow from the tracking index
        `design_acceleration_m_s2` T^2 / sigma (Kalata), sigma being that of the measurement in the same axis.
    heading_rad : direction of the boresight, clockwise from north; missing: an antenna that turns to each target.
    tilt_rad : tilt of the face, up.
    Start, gate and restart as in `Filter`. The gate uses the residuals against the steady-state residual variance.
    """

    alpha: tuple[float, float, float] | None = None
    beta: tuple[float, float, float] | None = None
    design_acceleration_m_s2: float = 10.0
    heading_rad: float | None = None
    tilt_rad: float = 0.0
    gate_probability: float = 1.0
    restart_after: int = 0
    restart_gap_s: float = math.inf
    noise_scale: tuple[float, float, float] = (1.0, 1.0, 1.0)


AnyFilter = Filter | AlphaBeta


def kalman(motion: Motion = "cv", sigma_m_s2: float = 10.0) -> Filter:
    """A Kalman filter with one motion model; a turn model alone gets the pseudo-measurement that keeps it
    observable.
    """
    if motion in ("ct", "ct-second-order"):
        return Filter(models=(Model(motion, sigma_m_s2, sigma_turn_rad_s=0.02, parallel_turn_rad_s=0.02),))
    return Filter(models=(Model(motion, sigma_m_s2),))


# Jung (1999), eqs 18 and 19; what the paper leaves open (padding, priors) as in docs/explanation/imm.md.
PAPER_IMM = Filter(
    models=(Model("cv", math.sqrt(10.0)), Model("ct-second-order", 40.0, sigma_turn_rad_s=0.05, prior_turn_rad_s=0.15)),
    transition=((0.9, 0.1), (0.1, 0.9)),
    noise="discrete",
)

# The same structure after maximum-likelihood tuning on the paper's scenario (1 m/s^2 of the first model is a floor).
TUNED_IMM = Filter(
    models=(Model("cv", 1.0), Model("ct-second-order", 5.8, sigma_turn_rad_s=1e-3, prior_turn_rad_s=0.072)),
    transition=((0.986, 0.014), (0.033, 0.967)),
    noise="discrete",
)

# The three models that the paper compares with, at textbook values.
TEXTBOOK_IMM3 = Filter(
    models=(Model("cv", math.sqrt(10.0)), Model("ca", 5.0), Model("ca", 40.0)),
    transition=((0.95, 0.0, 0.05), (0.0, 0.95, 0.05), (1 / 3, 1 / 3, 1 / 3)),
    noise="discrete",
    padding="zero",
)

FILTERS: dict[str, AnyFilter] = {
    "alpha-beta": AlphaBeta(),
    "kalman": kalman("cv"),
    "kalman-ca": kalman("ca"),
    "kalman-ct": kalman("ct"),
    "imm": Filter(
        models=(Model("cv", 1.0), Model("ct", 6.0, sigma_turn_rad_s=0.005, prior_turn_rad_s=0.07)),
        transition=((0.98, 0.02), (0.04, 0.96)),
    ),
    "imm3": Filter(
        models=(Model("cv", 1.0), Model("ca", 2.0), Model("ca", 20.0)),
        transition=((0.95, 0.0, 0.05), (0.0, 0.95, 0.05), (1 / 3, 1 / 3, 1 / 3)),
        padding="zero",
    ),
    "imm-paper": PAPER_IMM,
}
