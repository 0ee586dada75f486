"""Noise from scatter, where noise and motion are chosen."""

import numpy as np
import pytest

from rangeeval.stats.local_noise import leave_one_out, noise_of


def test_the_residual_is_that_of_a_parabola_fitted_to_the_neighbours():
    """Against numpy's polynomial fit, window by window, at uneven times."""
    rng = np.random.default_rng(3)
    t, x = np.cumsum(rng.uniform(0.5, 1.5, 30)), rng.normal(size=30)
    found = leave_one_out(t, x)
    for i in range(3, 27):
        rows = np.array([j for j in range(i - 3, i + 4) if j != i])
        a = np.vander(t[rows] - t[i], 3)
        fit, *_ = np.linalg.lstsq(a, x[rows], rcond=None)
        leverage = np.linalg.inv(a.T @ a)[2, 2]
        assert found[i] == pytest.approx((x[i] - fit[2]) / np.sqrt(1 + leverage))
    assert np.isnan(found[[0, 1, 2, 27, 28, 29]]).all()


def test_known_noise_is_found_under_acceleration_and_outliers():
    """10 m under 3 g of steady acceleration, with one sample in two hundred a kilometre off."""
    rng = np.random.default_rng(4)
    t = np.arange(4000.0)
    x = 15 * t**2 + rng.normal(0, 10, t.size)
    x[::200] += 1000.0
    found = noise_of(leave_one_out(t, x))
    assert found.value == pytest.approx(10.0, rel=0.1)


def test_the_interval_holds_the_noise_about_as_often_as_it_says():
    """Of 400 logs of 60 plots, 90 to 99 %."""
    rng = np.random.default_rng(5)
    t, held = np.arange(60.0), 0
    for _ in range(400):
        found = noise_of(leave_one_out(t, rng.normal(0, 2.0, 60)))
        held += found.low <= 2.0 <= found.high
    assert 0.90 <= held / 400 <= 0.99


@pytest.mark.parametrize("n", [0, 1, 6, 9])
def test_too_few_samples_give_nothing(n):
    """NaN, not a guess."""
    assert np.isnan(noise_of(leave_one_out(np.arange(n), np.zeros(n))).value)


def test_no_window_spans_a_gap_or_a_missing_value():
    """Seven samples around each are without a residual."""
    t = np.arange(40.0)
    t[20:] += 100
    x = np.zeros(40)
    x[5] = np.nan
    found = leave_one_out(t, x, max_gap=5.0)
    assert np.isnan(found[2:9]).all()
    assert np.isnan(found[17:23]).all()
    assert np.isfinite(found[23:37]).all()
