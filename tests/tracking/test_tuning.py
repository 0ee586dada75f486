import dataclasses

import numpy as np
import pytest

from rangeeval.tracking import polar
from rangeeval.tracking.filters import FILTERS, PAPER_IMM, kalman
from rangeeval.tracking.measurements import Measurements
from rangeeval.tracking.motion import noise_matrix, transition
from rangeeval.tracking.runs import log_likelihood
from rangeeval.tracking.tuning import Parameter, parameters_of, tune
from tests.tracking.tracks import SIGMA, track

CV = dataclasses.replace(kalman("cv", 3.0), noise="discrete")
NOISE = parameters_of(CV, motion=False, noise=True)


def wandering(seed, sigma_m_s2, steps=120, sigma=SIGMA):
    """Plots of a target that really has white acceleration."""
    rng = np.random.default_rng(seed)
    f = transition("cv", np.zeros(9), 1.0)[1][:6, :6]
    x = np.array([30e3, 20e3, 5e3, -200.0, 60.0, 0.0])
    shape = np.vstack([0.5 * np.eye(3), np.eye(3)])
    places = np.empty((steps, 3))
    for k in range(steps):
        places[k] = x[:3]
        x = f @ x + shape @ rng.normal(0, sigma_m_s2, 3)
    assert noise_matrix("cv", 2.0, 0.0, 1.0)[0, 3] == 2.0  # the filter's noise is this one
    return Measurements.of(
        np.arange(steps, dtype=float), polar.of_position(places) + rng.standard_normal((steps, 3)) * sigma, SIGMA
    )


def test_tuning_finds_the_noise_that_was_there():
    """Process noise of ten tracks within its interval, and the likelihood is higher than that of the truth."""
    tracks = [wandering(seed, 8.0) for seed in range(10)]
    found = tune(CV, tracks, [Parameter("sigma", 0, 0.01, 1e3)])
    assert found.converged
    assert found.low[0] < 8.0 < found.high[0]
    assert found.high[0] / found.low[0] < 1.5
    assert found.filter.models[0].sigma_m_s2 == pytest.approx(found.values[0])
    truth = dataclasses.replace(CV, models=(dataclasses.replace(CV.models[0], sigma_m_s2=8.0),))
    assert found.after >= log_likelihood(truth, tracks).sum()
    assert found.after == pytest.approx(float(log_likelihood(found.filter, tracks).sum()))


def test_measurement_noise_comes_with_its_interval():
    """Sigmas that are wrong by 0.5, 2 and 3 are found, with intervals that hold them."""
    wrong = np.array([0.5, 2.0, 3.0])
    tracks = [wandering(seed, 3.0, sigma=SIGMA * wrong) for seed in range(4)]
    found = tune(CV, tracks, NOISE)
    assert np.all((found.low < wrong) & (wrong < found.high))
    np.testing.assert_allclose(found.filter.noise_scale, wrong, rtol=0.2)


def test_a_parameter_at_its_floor_has_no_interval():
    """A target that flies exactly straight wants no process noise: the floor holds, and no interval is made up."""
    found = tune(CV, [wandering(1, 0.0)], [Parameter("sigma", 0, 0.5, 1e3)])
    assert found.values[0] == 0.5
    assert np.isnan(found.low[0])


def test_tracks_held_out_tell_whether_tuning_helped():
    """Tuning an IMM on some flights raises the likelihood of others."""
    found = tune(PAPER_IMM, [track(seed) for seed in range(4)], hold_out=[track(seed) for seed in range(10, 14)])
    assert np.all(found.held_after > found.held_before)
    assert found.after > found.before
    assert sum(found.filter.transition[0]) == pytest.approx(1.0)
    assert len(found.parameters) == 6


def test_a_gate_is_open_while_tuning_and_back_after_it():
    """Throwing plots away must not pay."""
    gated = dataclasses.replace(CV, gate_probability=0.9, restart_after=3)
    found = tune(gated, [wandering(2, 8.0)], [Parameter("sigma", 0, 0.01, 1e3)])
    plain = tune(CV, [wandering(2, 8.0)], [Parameter("sigma", 0, 0.01, 1e3)])
    assert found.values[0] == plain.values[0]
    assert (found.filter.gate_probability, found.filter.restart_after) == (0.9, 3)


def test_staying_less_leaves_in_the_old_proportions():
    """The ways out of a model share what is left as before."""
    found = tune(FILTERS["imm3"], [track(0)], [Parameter("stay", 2, 0.2, 0.9999)], intervals=False)
    row = found.filter.transition[2]
    assert row[0] == pytest.approx(row[1])
    assert row[2] == pytest.approx(found.values[0])


def test_nothing_to_tune_is_said():
    """No parameters, or no plot after the start."""
    with pytest.raises(ValueError, match="at least one parameter"):
        tune(CV, [track(0)], [])
    with pytest.raises(ValueError, match="needs 4 plots"):
        tune(CV, [track(0, steps=3)])


@pytest.mark.slow
def test_the_interval_of_measurement_noise_holds_the_truth_as_often_as_it_says():
    """Counted over 150 tracks of 120 plots: 95 % intervals hold the true sigma in 90 to 98.5 % of cases."""
    both = (*NOISE, Parameter("sigma", 0, 0.01, 1e3))
    hits = np.zeros(3)
    for seed in range(150):
        found = tune(dataclasses.replace(CV, models=kalman("cv", 3.0).models), [wandering(1000 + seed, 3.0)], both)
        hits += (found.low[:3] < 1.0) & (found.high[:3] > 1.0)
    assert np.all((hits / 150 > 0.90) & (hits / 150 < 0.99)), hits / 150
