import dataclasses
import itertools

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from rangeeval.tracking import polar
from rangeeval.tracking.filters import FILTERS, PAPER_IMM, AlphaBeta, Filter, Model, kalman
from rangeeval.tracking.measurements import Measurements
from rangeeval.tracking.motion import noise_matrix, transition
from rangeeval.tracking.runs import Flag, run, smooth, smooth_many
from rangeeval.tracking.starting import three_point
from tests.tracking.tracks import SIGMA, flight, track

LINEAR = dataclasses.replace(kalman("cv", 20.0), update="converted")


def start(m):
    """Position and velocity from the first three plots, as the filter has them."""
    x, p = three_point(m.time_s[:3], m.z[:3], SIGMA)
    return x[:6], p[:6, :6]


def test_rts_is_the_batch_least_squares_solution():
    """With converted plots all is linear: one large weighted least-squares problem has the same states and
    covariances.
    """
    m = track(1, steps=14)
    found = smooth(run(LINEAR, m, detail=True))
    x0, p0 = start(m)
    f, q = transition("cv", np.zeros(9), 1.0)[1][:6, :6], noise_matrix("cv", 20.0, 0.0, 1.0, continuous=True)[:6, :6]
    n = len(m) - 2
    information, vector = np.zeros((6 * n, 6 * n)), np.zeros(6 * n)
    information[:6, :6] += np.linalg.inv(p0)
    vector[:6] += np.linalg.solve(p0, x0)
    link = np.hstack([-f, np.eye(6)])
    for k in range(1, n):
        part = slice(6 * k - 6, 6 * k + 6)
        information[part, part] += link.T @ np.linalg.solve(q, link)
        z = m.z[k + 2]
        c = np.linalg.inv(polar.converted_covariance(z, SIGMA))
        information[6 * k : 6 * k + 3, 6 * k : 6 * k + 3] += c
        vector[6 * k : 6 * k + 3] += c @ polar.to_position(z)
    covariance = np.linalg.inv(information)
    states = (covariance @ vector).reshape(n, 6)
    np.testing.assert_allclose(found.state[2:], states, rtol=0, atol=1e-5)
    for k in range(n):
        np.testing.assert_allclose(
            found.covariance[k + 2], covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6], rtol=1e-6, atol=1e-4
        )


@pytest.mark.parametrize("padding", ["reset", "zero", "unbiased"])
def test_models_that_are_the_same_smooth_as_one(padding):
    """An IMM of two equal models is one filter, and its smoother is RTS."""
    model = Model("cv", 20.0)
    two = Filter(models=(model, model), transition=((0.9, 0.1), (0.3, 0.7)), noise="discrete", padding=padding)
    m = track(2)
    one = smooth(run(dataclasses.replace(kalman("cv", 20.0), noise="discrete"), m, detail=True))
    found = smooth(run(two, m, detail=True))
    np.testing.assert_allclose(found.state, one.state, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.covariance, one.covariance, rtol=1e-6, atol=1e-4)


def by_every_sequence(spec, m):
    """Probabilities of the models at each plot after the third but one, by Bayes' rule over all sequences of models."""
    f = transition("cv", np.zeros(9), 1.0)[1][:6, :6]
    qs = [noise_matrix("cv", model.sigma_m_s2, 0.0, 1.0)[:6, :6] for model in spec.models]
    steps = len(m) - 3
    pi, exact = np.array(spec.transition), np.zeros((steps + 1, 2))
    for sequence in itertools.product(range(2), repeat=steps + 1):
        (x, p), weight = start(m), 0.5
        for k in range(1, steps + 1):
            weight *= pi[sequence[k - 1], sequence[k]]
            x, p = f @ x, f @ p @ f.T + qs[sequence[k]]
            z = m.z[k + 2]
            y, s = polar.to_position(z), p[:3, :3] + polar.converted_covariance(z, SIGMA)
            weight *= multivariate_normal.pdf(y, x[:3], s)
            gain = np.linalg.solve(s, p[:3]).T
            x, p = x + gain @ (y - x[:3]), p - gain @ s @ gain.T
        for k, model in enumerate(sequence):
            exact[k, model] += weight
    return exact / exact.sum(1, keepdims=True)


def onset(plots):
    """Two linear models, and plots around the onset of a turn."""
    models = (Model("cv", 2.0), Model("cv", 80.0))
    spec = Filter(models=models, transition=((0.9, 0.1), (0.2, 0.8)), noise="discrete", update="converted")
    times, states = flight(30)
    rows = slice(18, 18 + plots)
    z = polar.of_position(states[rows, :3]) + np.random.default_rng(5).standard_normal((plots, 3)) * SIGMA
    return spec, Measurements.of(times[rows], z, SIGMA)


def test_one_step_back_the_pair_weights_are_exact():
    """With one plot after the start nothing has been merged yet: the probabilities are those of Bayes' rule."""
    spec, m = onset(4)
    found = smooth(run(spec, m, detail=True)).mode_probability[2:]
    np.testing.assert_allclose(found, by_every_sequence(spec, m), rtol=1e-9)


def test_smoothed_probabilities_come_nearer_to_those_of_every_sequence_of_models():
    """Over nine plots, all 2^7 sequences worked out: smoothing takes away more than half of the filter's distance."""
    spec, m = onset(9)
    done = run(spec, m, detail=True)
    exact = by_every_sequence(spec, m)
    filtered = np.abs(done.mode_probability[2:] - exact)[:-1].mean()
    smoothed = np.abs(smooth(done).mode_probability[2:] - exact)[:-1].mean()
    assert smoothed < 0.5 * filtered


@pytest.mark.parametrize("name", ["imm", "imm-paper", "imm3", "kalman"])
def test_smoothing_beats_filtering_over_many_flights(name):
    """Over twenty flights the RMS error of position falls by a quarter or more, and stays consistent with its
    covariance.
    """
    truth = flight()[1]
    runs = [run(FILTERS[name], track(seed), detail=True) for seed in range(20)]
    found = smooth_many(runs)
    inside = slice(3, 57)
    filtered = np.sqrt(np.mean([np.sum((r.state - truth)[inside, :3] ** 2, 1) for r in runs]))
    smoothed = np.sqrt(np.mean([np.sum((s.state - truth)[inside, :3] ** 2, 1) for s in found]))
    assert smoothed < 0.75 * filtered


def test_many_smoothed_together_are_each_smoothed_alone():
    """Runs with the same times go in one go, others by themselves; the numbers are the same."""
    runs = [run(PAPER_IMM, track(seed, steps=20 + 5 * (seed == 2)), detail=True) for seed in range(3)]
    for together, alone in zip(smooth_many(runs), (smooth(r) for r in runs), strict=True):
        np.testing.assert_allclose(together.state, alone.state, rtol=0, atol=1e-7)


def test_missed_plots_gaps_and_restarts_are_bridged_or_kept_apart():
    """Missed plots are smoothed over; what lies before a restart learns nothing from what comes after."""
    m = track(3)
    z = m.z.copy()
    z[10:14] = np.nan
    z[30:, 0] += 100e3
    spec = dataclasses.replace(PAPER_IMM, gate_probability=1 - 1e-9, restart_after=2)
    found = run(spec, Measurements.of(m.time_s, z, SIGMA), detail=True)
    assert found.flags[31] & Flag.RESTARTED
    whole = smooth(found)
    assert np.all(np.isfinite(whole.state))
    before = smooth(
        run(PAPER_IMM, Measurements.of(m.time_s[:31], np.vstack([z[:30], [np.nan] * 3]), SIGMA), detail=True)
    )
    np.testing.assert_allclose(whole.state[:30], before.state[:30], atol=1e-6)
    error = np.linalg.norm(whole.state[10:14, :3] - flight()[1][10:14, :3], axis=1)
    assert np.max(error) < 200


def test_residuals_against_the_smoothed_track_have_the_covariance_they_say():
    """The smoothed track has followed the plots: residuals are smaller than R by H P H', counted over 60 flights."""
    runs = [run(FILTERS["imm"], track(seed), detail=True) for seed in range(60)]
    found = smooth_many(runs)
    inside = slice(5, 18)  # straight flight, before the turn
    measured = np.mean([s.residual[inside] ** 2 for s in found], axis=(0, 1))
    claimed = np.mean([np.diagonal(s.residual_covariance[inside], axis1=1, axis2=2) for s in found], axis=(0, 1))
    np.testing.assert_allclose(measured, claimed, rtol=0.15)
    assert np.all(claimed < 0.97 * SIGMA**2)


def test_what_cannot_be_smoothed_is_refused_in_words():
    """A run without detail, and one without covariances."""
    with pytest.raises(ValueError, match="detail=True"):
        smooth(run(PAPER_IMM, track(0)))
    with pytest.raises(ValueError, match="no covariances"):
        smooth(run(AlphaBeta(), track(0)))
