import numpy as np
import pytest

from rangeeval.tracking import alpha_beta as ab
from rangeeval.tracking.varying_gains import two_point_covariance, varying_gain_variances


def test_recursion_gives_the_variances_of_a_simulated_start():
    """Two-point start, gains that change, a coast and uneven intervals: Monte Carlo has the recursion's
    variances.
    """
    rng = np.random.default_rng(2)
    alpha = np.array([0.8, 0.7, 0.6, 0.0, 0.6, 0.5, 0.3, 0.2, 0.2, 0.2])
    beta = np.array([0.6, 0.4, 0.3, 0.0, 0.3, 0.2, 0.05, 0.02, 0.02, 0.02])
    interval = np.array([0.5, 0.5, 1.0, 0.5, 0.5, 2.0, 0.5, 0.5, 0.5, 0.5])
    sigma = np.array([3.0, 3.0, 5.0, 5.0, 5.0, 2.0, 2.0, 2.0, 1.0, 1.0])
    run = varying_gain_variances(alpha, beta, interval_s=interval, sigma_v=sigma)
    tracks = 200_000
    first, second = 3.0 * rng.standard_normal((2, tracks))
    x, v = second, (second - first) / 0.5  # the target stands at zero
    for k in range(alpha.size):
        predicted = x + interval[k] * v
        residual = sigma[k] * rng.standard_normal(tracks) - predicted
        x, v = predicted + alpha[k] * residual, v + beta[k] / interval[k] * residual
        assert residual.var() == pytest.approx(run.residual[k], rel=0.02)
        assert x.var() == pytest.approx(run.filtered[k], rel=0.02)
    np.testing.assert_array_equal(run.q, run.filtered / run.residual)


def test_recursion_settles_to_the_closed_forms():
    """With fixed gains the recursion ends in the steady state, and only the shape of sigma matters for q."""
    run = varying_gain_variances(np.full(500, 0.3), np.full(500, 0.06), interval_s=0.25, sigma_v=7.0)
    assert run.residual[-1] == pytest.approx(ab.residual_variance(0.3, 0.06, 7.0), rel=1e-12)
    assert run.q[-1] == pytest.approx(ab.q_cv(0.3, 0.06), rel=1e-12)


def test_a_given_start_is_used():
    """A start covariance of one's own replaces the two-point one; missing gains are a coast."""
    start = two_point_covariance(2.0, 0.5)
    np.testing.assert_allclose(start, [[4, 8], [8, 32]])
    own = varying_gain_variances([np.nan], [np.nan], interval_s=0.5, sigma_v=2.0, initial_covariance=np.eye(2))
    assert own.filtered[0] == pytest.approx(1.25)
    assert varying_gain_variances([], []).q.size == 0


def test_lists_of_different_length_are_refused():
    """Gains that do not pair up are refused with their shapes."""
    with pytest.raises(ValueError, match=r"alpha has shape \(2,\) and beta \(1,\)"):
        varying_gain_variances([0.1, 0.2], [0.1])
