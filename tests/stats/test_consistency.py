import numpy as np
import pytest
from scipy.stats import chi2

from rangeeval.stats.consistency import average_bounds, consistency, normalised_squares, whiteness


def test_normalised_squares_are_chi_square():
    """Errors drawn from their covariance: the squares have the distribution's mean and quantiles."""
    rng = np.random.default_rng(1)
    a = rng.normal(size=(6, 6))
    p = a @ a.T
    squares = normalised_squares(rng.multivariate_normal(np.zeros(6), p, 20_000), p)
    assert squares.mean() == pytest.approx(6, rel=0.02)
    assert np.mean(squares < chi2.ppf(0.95, 6)) == pytest.approx(0.95, abs=0.005)


def test_missing_components_are_left_out():
    """A missing component leaves the squares of the others; all missing, or no covariance, leaves none."""
    p = np.array([[4.0, 1.0, 0.0], [1.0, 2.0, 0.5], [0.0, 0.5, 1.0]])
    e = np.array([1.0, np.nan, -1.0])
    kept = np.ix_([0, 2], [0, 2])
    assert normalised_squares(e, p) == pytest.approx(e[[0, 2]] @ np.linalg.solve(p[kept], e[[0, 2]]))
    assert np.isnan(normalised_squares(np.full(3, np.nan), p))
    assert np.isnan(normalised_squares(np.ones(3), -p))
    assert np.isnan(normalised_squares(np.ones(3), np.full((3, 3), np.nan)))


@pytest.mark.parametrize(
    ("dof", "count", "low", "high"), [(6, 100, 0.890, 1.116), (3, 1, 0.072, 3.116), (3, 100, 0.846, 1.166)]
)
def test_bounds_are_those_of_the_tables(dof, count, low, high):
    """Values that textbooks print."""
    assert average_bounds(dof, count) == (pytest.approx(low, abs=1e-3), pytest.approx(high, abs=1e-3))


def test_a_consistent_filter_is_called_so_in_nineteen_of_twenty_trials():
    """Counted: 95 % bounds hold a consistent average in 95 % of 2000 trials; wrong sigmas are told apart."""
    rng = np.random.default_rng(2)
    verdicts = [consistency(rng.chisquare(3, 200), 3).verdict for _ in range(2000)]
    assert verdicts.count("consistent") / 2000 == pytest.approx(0.95, abs=0.015)
    squares = rng.chisquare(3, 400)
    assert consistency(1.5 * squares, 3).verdict == "optimistic"
    assert consistency(0.6 * squares, 3).verdict == "pessimistic"
    assert consistency([np.nan], 3).verdict == "unknown"


def test_unequal_degrees_of_freedom_are_weighed():
    """Squares of 2 and 3 degrees of freedom together; those with none are left out."""
    found = consistency([2.0, 3.0, 50.0], [2, 3, 0])
    assert found.average == 1.0
    assert found.count == 2


def test_white_innovations_are_called_white_in_nineteen_of_twenty_trials():
    """Counted over 2000 sequences; a correlation of 0.4 is seen."""
    rng = np.random.default_rng(3)
    share = np.mean([whiteness(rng.normal(size=150)).white for _ in range(2000)])
    assert share == pytest.approx(0.95, abs=0.015)
    noise = rng.normal(size=501)
    found = whiteness(noise[1:] + 0.5 * noise[:-1])
    assert found.correlation == pytest.approx(0.4, abs=0.08)
    assert not found.white


def test_whiteness_leaves_out_pairs_with_a_missing_member():
    """Missing innovations break the chain, and too few give no answer."""
    assert whiteness([1.0, np.nan, 1.0, 1.0, np.nan]).count == 1
    assert np.isnan(whiteness([1.0]).correlation)


@pytest.mark.parametrize("confidence", [0.0, 1.0, 95])
def test_confidence_is_between_zero_and_one(confidence):
    """A percentage is refused."""
    with pytest.raises(ValueError, match="between 0 and 1"):
        average_bounds(3, 10, confidence)
