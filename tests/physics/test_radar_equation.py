"""The radar equation and the sphere against numbers worked out by hand."""

import math

import numpy as np
import pytest

from rangeeval.physics.radar_equation import loop_gain_db, snr_of_square_metre, sphere_rcs


def test_alpha_falls_with_the_fourth_power_of_range():
    """A loop gain of 195 dB: 197.64 at 20 km, 16 times less at twice the range."""
    found = snr_of_square_metre([20_000.0, 40_000.0], 195.0)
    np.testing.assert_allclose(found, [197.6423537605236, 197.6423537605236 / 16], rtol=1e-12)


def test_energy_loss_and_attenuation_are_in_db():
    """3 dB more energy, 2 dB of loss, 0.1 dB/km one way over 10 km: 1 dB less."""
    plain = snr_of_square_metre(10_000.0, 180.0)
    found = snr_of_square_metre(10_000.0, 180.0, energy_db=3.0, loss_db=2.0, attenuation_db_per_km=0.1)
    assert 10 * math.log10(found / plain) == pytest.approx(-1.0, abs=1e-12)


def test_loop_gain_is_the_radar_equation_written_out():
    """E G G lambda^2 / ((4 pi)^3 k T F L)."""
    plain = 2.0 * 1e3 * 1e3 * 0.1**2 / ((4 * math.pi) ** 3 * 1.380649e-23 * 290.0 * 2.0 * 4.0)
    found = loop_gain_db(2.0, 30.0, 30.0, 0.1, 290.0, 10 * math.log10(2.0), 10 * math.log10(4.0))
    assert found == pytest.approx(10 * math.log10(plain), abs=1e-9)


@pytest.mark.parametrize(
    ("ka", "ratio"), [(5.0, 1.1688370491), (10.0, 0.929230216), (30.0, 1.0161001706), (19.7722, 0.9567753672)]
)
def test_a_sphere_is_not_its_shadow_until_it_is_large(ka, ratio):
    """RCS over pi r^2 from Riccati-Bessel functions with 40 digits; ka 19.7722: 17.8 cm at 5.3 GHz, 0.19 dB less."""
    radius = ka / (2 * math.pi)
    assert sphere_rcs(radius, 1.0) / (math.pi * radius**2) == pytest.approx(ratio, rel=1e-9)


def test_a_small_sphere_follows_rayleigh():
    """9 (ka)^4 pi r^2."""
    radius = 0.01 / (2 * math.pi)
    assert sphere_rcs(radius, 1.0) == pytest.approx(9 * 0.01**4 * math.pi * radius**2, rel=1e-3)
