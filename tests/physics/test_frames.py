import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rangeeval.physics import frames as fr


def test_heading_turns_the_forward_axis_from_north_to_east():
    """At heading 90 degrees a target in the east is straight ahead, one in the north on the left."""
    c = fr.attitude_matrix(np.pi / 2)
    np.testing.assert_allclose(fr.turn(c, [0, 0, 1]), [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(fr.turn(c, [1, 0, 0]), [0, 0, -1], atol=1e-15)


def test_positive_alpha_z_lowers_the_front_and_positive_alpha_x_raises_the_right():
    """The body axes, seen in NUE, go the stated way: front down, right side up."""
    forward = fr.turn_back(fr.attitude_matrix(0.0, 0.0, 0.1), [1, 0, 0])
    right = fr.turn_back(fr.attitude_matrix(0.0, 0.1, 0.0), [0, 0, 1])
    assert forward[1] == pytest.approx(-np.sin(0.1))
    assert right[1] == pytest.approx(np.sin(0.1))


def test_attitude_matrix_is_an_intrinsic_rotation_with_opposite_signs():
    """C is the inverse of the body's rotation Y(-h) Z(-az) X(-ax), and sends up where the closed form
    says.
    """
    rng = np.random.default_rng(0)
    for h, ax, az in rng.uniform(-1, 1, (20, 3)):
        c = fr.attitude_matrix(h, ax, az)
        body = Rotation.from_euler("YZX", [-h, -az, -ax]).as_matrix()
        np.testing.assert_allclose(c, body.T, atol=1e-14)
        up = [-np.sin(az), np.cos(ax) * np.cos(az), np.sin(ax) * np.cos(az)]
        np.testing.assert_allclose(c @ [0, 1, 0], up, atol=1e-14)


def test_a_tilted_face_looks_up():
    """A target on the boresight of a face at heading 30 and tilt 15 degrees is at elevation 15, azimuth
    30.
    """
    el, az = np.deg2rad(15.0), np.deg2rad(30.0)
    target = 50e3 * np.array([np.cos(el) * np.cos(az), np.sin(el), np.cos(el) * np.sin(az)])
    np.testing.assert_allclose(fr.turn(fr.face_matrix(az, el), target), [50e3, 0, 0], atol=1e-9)


def test_turning_there_and_back_returns_many_positions():
    """Arrays of attitudes turn arrays of positions one by one, and back without loss."""
    rng = np.random.default_rng(1)
    p, h, t = rng.normal(size=(50, 3)), rng.normal(size=50), rng.normal(size=50)
    c = fr.face_matrix(h, t)
    there = fr.turn(c, p)
    np.testing.assert_allclose(there[7], c[7] @ p[7], atol=1e-15)
    np.testing.assert_allclose(fr.turn_back(c, there), p, atol=1e-14)


def test_array_coordinates_and_beam_coordinates_are_inverse():
    """R, R sin(theta_e), R sin(theta_a) lead back to the position; impossible ones to nothing."""
    p = np.array([[30e3, 4e3, -9e3], [10e3, 0.0, 0.0]])
    r, sin_e, sin_a = fr.array_coordinates(p)
    assert r[0] == pytest.approx(np.linalg.norm(p[0]))
    np.testing.assert_allclose(fr.beam_to_cartesian(r, r * sin_e, r * sin_a), p, rtol=1e-12)
    assert np.isnan(fr.beam_to_cartesian(1.0, 0.9, 0.9)).all()


def test_array_angles_are_not_azimuth_and_elevation():
    """Angles of a position agree with atan2 and asin of its coordinates, both ways."""
    p = np.array([20e3, 12e3, 15e3])
    r, sin_e, sin_a = fr.array_coordinates(p)
    az, el = fr.array_angles_to_azimuth_elevation(np.arcsin(sin_e), np.arcsin(sin_a))
    assert az == pytest.approx(np.arctan2(p[2], p[0]), rel=1e-13)
    assert el == pytest.approx(np.arcsin(p[1] / r), rel=1e-13)
    assert abs(az - np.arcsin(sin_a)) > 0.05
    np.testing.assert_allclose(
        fr.azimuth_elevation_to_array_angles(az, el), [np.arcsin(sin_e), np.arcsin(sin_a)], rtol=1e-13
    )
    assert np.isnan(fr.array_angles_to_azimuth_elevation(1.2, 1.2)).all()


def test_small_errors_convert_as_finite_differences_do():
    """The first-order error formulas agree with differences of the exact conversion, both ways."""
    az, el, d_el, d_a, h = 0.6, 0.4, 2.0, -3.0, 1e-6
    theta_e, theta_a = fr.azimuth_elevation_to_array_angles(az, el)
    plus = fr.array_angles_to_azimuth_elevation(theta_e + h * d_el, theta_a + h * d_a)[0]
    minus = fr.array_angles_to_azimuth_elevation(theta_e - h * d_el, theta_a - h * d_a)[0]
    d_az = fr.azimuth_error(az, el, d_el, d_a)
    assert d_az == pytest.approx((plus - minus) / (2 * h), rel=1e-8)
    assert fr.theta_a_error(az, el, d_az, d_el) == pytest.approx(d_a, rel=1e-12)
