"""Intervals of a probability from counts."""

import numpy as np
import pytest
from scipy.stats import binom

from rangeeval.stats.proportions import exact_interval, wilson_interval


def test_wilsons_interval_solves_its_equation():
    """(p - k/n)^2 = z^2 p (1 - p) / n at both ends."""
    low, high = wilson_interval(7, 20)
    for p in (low, high):
        assert (p - 0.35) ** 2 == pytest.approx(1.959964**2 * p * (1 - p) / 20, rel=1e-6)


def test_the_exact_interval_has_two_and_a_half_percent_in_each_tail():
    """Clopper and Pearson; one-sided where all or none were seen; no data is no knowledge."""
    low, high = exact_interval(7, 20)
    assert binom.sf(6, 20, low) == pytest.approx(0.025)
    assert binom.cdf(7, 20, high) == pytest.approx(0.025)
    assert exact_interval(0, 10)[0] == 0.0
    assert exact_interval(10, 10)[1] == 1.0
    np.testing.assert_allclose(exact_interval(0, 0), (0.0, 1.0))
