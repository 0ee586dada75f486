import numpy as np
import pytest

from rangeeval.physics.gravity import normal_gravity


def test_normal_gravity_has_its_published_values():
    """Equator, 36.4 north, 45 and the poles agree with the WGS 84 formula's known values."""
    known = {0.0: 9.7803253359, 36.4: 9.798535, 45.0: 9.806198, 90.0: 9.832185}
    for latitude, gravity in known.items():
        assert normal_gravity(np.deg2rad(latitude)) == pytest.approx(gravity, abs=6e-7)


def test_gravity_falls_by_a_third_of_a_milligal_a_metre():
    """The free-air gradient is 3.086e-6 per second squared, within a thousandth at any latitude."""
    latitude = np.deg2rad([0.0, 45.0, 90.0])
    fall = normal_gravity(latitude, 0.0) - normal_gravity(latitude, 100.0)
    assert fall / 100.0 == pytest.approx(3.086e-6, rel=2e-3)


def test_the_wrong_gravity_costs_a_fifth_of_an_arc_minute():
    """9.81 in place of the local value at 36.4 north reads 3 degrees 0.21' wrong."""
    g = normal_gravity(np.deg2rad(36.4))
    wrong = np.arcsin(g * np.sin(np.deg2rad(3.0)) / 9.81) - np.deg2rad(3.0)
    assert abs(np.rad2deg(wrong)) * 60 == pytest.approx(0.21, abs=0.005)
