import numpy as np
import pytest

from rangeeval.physics.geodesy import earth_fixed, latitude_longitude, north_up_east


def test_axes_of_the_ellipsoid():
    """On the equator the earth-fixed position is the semi-major axis away, at the pole the semi-minor one."""
    assert earth_fixed(0.0, 0.0, 0.0) == pytest.approx([6378137.0, 0.0, 0.0])
    assert earth_fixed(np.pi / 2, 0.0, 0.0) == pytest.approx([0.0, 0.0, 6356752.3142], abs=1e-3)


def test_a_high_target_far_away_is_lower_than_a_flat_earth_says():
    """2 km up and 100 km north of a site, a target stands 1214 m above its horizontal, at 0.695 degrees."""
    lat, lon = np.deg2rad(36.0), np.deg2rad(127.0)
    far = lat + 100_000.0 / 6_358_000.0
    north, up, east = north_up_east(far, lon, 2000.0, (lat, lon, 0.0))
    assert np.hypot(north, up) == pytest.approx(100_000, rel=2e-3)
    assert east == pytest.approx(0.0, abs=1e-6)
    assert up == pytest.approx(1214.0, abs=4.0)
    assert np.rad2deg(np.arctan2(up, north)) == pytest.approx(0.695, abs=0.003)


def test_small_steps_are_north_up_and_east():
    """One arc second of latitude is about 31 m north; of longitude about 25 m east at 36 degrees; height is up."""
    site = (np.deg2rad(36.0), np.deg2rad(127.0), 100.0)
    second = np.deg2rad(1 / 3600)
    assert north_up_east(site[0] + second, site[1], 100.0, site) == pytest.approx([30.82, 0.0, 0.0], abs=0.02)
    assert north_up_east(site[0], site[1] + second, 100.0, site) == pytest.approx([0.0, 0.0, 25.04], abs=0.02)
    assert north_up_east(site[0], site[1], 107.0, site) == pytest.approx([0.0, 7.0, 0.0], abs=1e-6)


@pytest.mark.parametrize("latitude", [-89.9, -45.0, 0.0, 36.4, 75.0])
def test_a_point_in_the_horizontal_plane_stands_above_its_latitude_and_longitude(latitude):
    """The point lies on the normal of the ellipsoid there: what is left beside the normal is below 2 micrometres."""
    site = (np.deg2rad(latitude), np.deg2rad(127.0), 100.0)
    sin, cos = np.sin(site[0]), np.cos(site[0])
    rng = np.random.default_rng(1)
    north, east = rng.uniform(-1e6, 1e6, (2, 1000))
    found = latitude_longitude(north, east, site)
    there = earth_fixed(*site) + np.stack(
        [-north * sin * np.cos(site[1]) - east * np.sin(site[1]),
         -north * sin * np.sin(site[1]) + east * np.cos(site[1]), north * cos], axis=-1,
    )  # fmt: skip
    upwards = (earth_fixed(*found, 1e6) - earth_fixed(*found, 0.0)) / 1e6
    away = there - earth_fixed(*found, 0.0)
    beside = away - np.sum(away * upwards, axis=-1, keepdims=True) * upwards
    assert np.linalg.norm(beside, axis=-1).max() < 2e-6
