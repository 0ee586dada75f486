"""Steady series raise no more alarms than stated, and what is not steady is found."""

import numpy as np
import pytest

from rangeeval.stats.control import LEAST_POINTS, between_variance, judge_series


def series(rng, k, tau):
    """A steady series with errors of different size."""
    sigma = np.exp(rng.normal(0.0, 0.5, k))
    return rng.normal(0.0, tau, k) + rng.standard_normal(k) * sigma, sigma**2


@pytest.mark.parametrize("tau", [0.0, 0.5, 2.0])
def test_the_scatter_between_trials_is_found(tau):
    """The median over many series of 60 is near the truth."""
    rng = np.random.default_rng(1)
    v = np.exp(rng.normal(0.0, 0.5, 60)) ** 2
    y = rng.normal(0.0, tau, (2000, 60)) + rng.standard_normal((2000, 60)) * np.sqrt(v)
    found = between_variance(y, np.broadcast_to(v, y.shape))
    assert abs(np.median(found) - tau**2) < 0.12 + 0.05 * tau**2


def test_a_step_and_a_point_far_off_do_not_hide_in_the_scatter():
    """The estimate stays within a factor of two of the truth, where the plain mean of squares is ten times too large."""
    rng = np.random.default_rng(2)
    y = rng.normal(0.0, 1.0, (500, 30))
    y[:, 20:] += 10
    y[:, 7] += 20
    v = np.full_like(y, 1e-6)
    assert 0.5 < np.median(between_variance(y, v)) < 2.0
    assert np.median((np.diff(y) ** 2).mean(-1) / 2) > 10


def alarms(k, tau, runs, alpha=0.05):
    """The share of steady series with an alarm of each kind."""
    rng = np.random.default_rng(k)
    found = np.zeros(3)
    for seed in range(runs):
        chart = judge_series(*series(rng, k, tau), alpha, seed)
        found += [
            np.any(np.abs(chart.deviation) > chart.limit),
            np.any(np.abs(chart.smoothed) > chart.smoothed_limit),
            bool(chart.steps),
        ]
    return found / runs


@pytest.mark.slow
@pytest.mark.parametrize("k", [6, 12, 40])
@pytest.mark.parametrize("tau", [0.0, 0.5, 2.0])
def test_false_alarms_are_counted(k, tau):
    """Of 1,000 steady series at most the stated 5 % alarm (and three standard errors), for each kind of alarm."""
    assert alarms(k, tau, 1000).max() <= 0.05 + 3 * (0.05 * 0.95 / 1000) ** 0.5


def test_false_alarms_in_short():
    """The same with fewer series: of 60 none to eight."""
    assert alarms(10, 1.0, 60).max() <= 8 / 60


def test_a_step_is_placed_and_sized():
    """Of 1.5 at the 20th of 40 points with sigma 0.2, errors of 0.1 to 0.3."""
    rng = np.random.default_rng(4)
    sigma = rng.uniform(0.1, 0.3, 40)
    y = rng.normal(0.0, 0.2, 40) + rng.standard_normal(40) * sigma
    y[20:] += 1.5
    chart = judge_series(y, sigma**2)
    assert [step.at for step in chart.steps] == [20]
    step = chart.steps[0]
    assert abs(step.size - 1.5) < 3 * step.variance**0.5
    assert step.p_value < 0.01
    assert not np.any(np.abs(chart.deviation) > chart.limit)


def test_two_steps_are_found():
    """Up and back down."""
    rng = np.random.default_rng(5)
    y = rng.normal(0.0, 0.2, 45)
    y[15:30] += 2
    assert [step.at for step in judge_series(y, np.full(45, 0.01)).steps] == [15, 30]


def test_one_point_off_is_out_of_line_and_no_step_and_no_drift():
    """Also near the end, where a step would need three."""
    rng = np.random.default_rng(6)
    for place in (0, 12, 23, 24):
        y = rng.normal(0.0, 1.0, 25)
        y[place] += 12
        chart = judge_series(y, np.full(25, 0.04))
        assert chart.steps == ()
        assert list(np.flatnonzero(np.abs(chart.deviation) > chart.limit)) == [place]
        assert np.all(np.abs(chart.smoothed) <= chart.smoothed_limit)


def test_a_wide_interval_has_wide_limits():
    """The same deviation is out of line where the trial's interval is narrow, in line where it is wide."""
    rng = np.random.default_rng(7)
    y, v = rng.normal(0.0, 0.1, 24), np.full(24, 0.01)
    y[5], y[15] = 3.0, 3.0
    v[15] = 4.0
    chart = judge_series(y, v)
    assert list(np.flatnonzero(np.abs(chart.deviation) > chart.limit)) == [5]
    assert chart.sigma[15] > 10 * chart.sigma[6]


def test_a_slow_drift_shows_in_the_smoothed_series():
    """Where no single point is out of line."""
    rng = np.random.default_rng(8)
    y = rng.normal(0.0, 1.0, 60) + np.concatenate([np.zeros(30), np.linspace(0, 4, 30)])
    chart = judge_series(y, np.full(60, 0.01))
    assert chart.steps or np.any(np.abs(chart.smoothed) > chart.smoothed_limit)


def test_the_same_numbers_give_the_same_chart():
    """Simulation starts from the same seed."""
    y, v = series(np.random.default_rng(9), 12, 1.0)
    one, other = judge_series(y, v), judge_series(y, v)
    assert one.limit == other.limit
    assert one.deviation.tobytes() == other.deviation.tobytes()


def test_degenerate_series():
    """Points all alike give no alarm; too few are refused."""
    chart = judge_series(np.ones(8), np.zeros(8))
    assert np.all(chart.deviation == 0)
    assert chart.steps == ()
    with pytest.raises(ValueError, match="4 points"):
        judge_series(np.ones(LEAST_POINTS - 1), np.ones(LEAST_POINTS - 1))
