import math

import numpy as np
import pytest

from rangeeval.tracking import polar
from rangeeval.tracking.measurements import Measurements, azimuth_from_log, azimuth_to_log


def test_position_and_measurement_are_inverse():
    """To polar and back gives the same place in every octant."""
    p = np.random.default_rng(1).normal(0, 1e4, (200, 3))
    np.testing.assert_allclose(polar.to_position(polar.of_position(p)), p, atol=1e-8)


def test_the_jacobian_is_the_derivative_of_the_measurement():
    """Analytic and numerical Jacobian agree."""
    for p in np.random.default_rng(2).normal(0, 1e4, (20, 3)):
        numeric = np.array([(polar.of_position(p + e) - polar.of_position(p - e)) / 0.2 for e in 0.1 * np.eye(3)]).T
        np.testing.assert_allclose(polar.jacobian(p), numeric, rtol=1e-6, atol=1e-10)


def test_angles_have_no_derivative_at_the_zenith():
    """Straight overhead only range has a derivative; the rows of the angles are zero, not infinite."""
    np.testing.assert_array_equal(polar.jacobian([0.0, 0.0, 500.0]), [[0, 0, 1], [0, 0, 0], [0, 0, 0]])
    np.testing.assert_array_equal(polar.jacobian([0.0, 0.0, 0.0]), np.zeros((3, 3)))


@pytest.mark.parametrize("azimuth", [0.0, 0.7, -2.5])
def test_the_unbiased_conversion_is_unbiased_with_the_covariance_it_claims(azimuth):
    """Counted over 400,000 noisy measurements at 50 km with 50 mrad, where the plain conversion is 60 m off."""
    truth, sigma = np.array([50e3, azimuth, 0.6]), np.array([100.0, 0.05, 0.05])
    z = truth + sigma * np.random.default_rng(3).standard_normal((400_000, 3))
    place = polar.to_position(truth)
    y = polar.unbiased_position(z, sigma)
    error = np.sqrt(np.diag(np.cov(y.T)) / len(y))
    np.testing.assert_array_less(np.abs(y.mean(0) - place), 4 * error)
    assert np.max(np.abs(polar.to_position(z).mean(0) - place) / error) > 10
    claimed = polar.converted_covariance(truth, sigma, unbiased=True)
    scale = np.sqrt(np.diag(claimed))
    np.testing.assert_allclose(np.cov(y.T) / np.outer(scale, scale), claimed / np.outer(scale, scale), atol=0.01)


@pytest.mark.parametrize(("log", "filter_frame"), [(0.0, math.pi / 2), (math.pi / 2, 0.0), (1.5 * math.pi, -math.pi)])
def test_azimuth_of_a_log_is_turned_in_one_place(log, filter_frame):
    """North is y, east is x, west is minus x; and back."""
    assert azimuth_from_log(log) == pytest.approx(filter_frame)
    assert azimuth_to_log(filter_frame) == pytest.approx(log)
    assert Measurements.of_log([0.0], [1.0], [log], [0.1], sigma=(1, 1, 1)).z[0, 1] == pytest.approx(filter_frame)


@pytest.mark.parametrize("sigma", [(0.0, 1.0, 1.0), (1.0, np.nan, 1.0), (1.0, 1.0, -1.0)])
def test_a_sigma_that_cannot_be_is_refused(sigma):
    """A measured component needs a positive sigma."""
    with pytest.raises(ValueError, match="give a positive one"):
        Measurements.of([0.0], [[1.0, 1.0, 1.0]], sigma)
