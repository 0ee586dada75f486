import numpy as np
import pytest

from rangeeval.angles import wrapped
from rangeeval.physics import pointing as po
from rangeeval.physics.frames import attitude_matrix

DEG = np.pi / 180


def worst(delta, alpha_x, elevation_limit):
    """Largest error of the small-angle forms against exact rotations, and the largest true errors (deg)."""
    az = np.linspace(-np.pi, np.pi, 361)
    el = np.linspace(0, elevation_limit, 13) * DEG
    a, e = np.meshgrid(az, el)
    errors = np.zeros(4)
    for dx in (-delta, delta):
        for dz in (-delta, delta):
            # The exact misalignment applied to radar-frame directions.
            turned = np.einsum("ij,...j->...i", po.misalignment(alpha_x * DEG, dx * DEG, dz * DEG), po.direction(a, e))
            exact = [wrapped(x - y) for x, y in zip(po.azimuth_elevation(turned), (a, e), strict=True)]
            short = po.small_angle_designation(a, e, dx * DEG, dz * DEG)
            off = [np.rad2deg(np.abs(wrapped(s - x))).max() for s, x in zip(short, exact, strict=True)]
            true = [np.rad2deg(np.abs(x)).max() for x in exact]
            errors = np.maximum(errors, [off[1], off[0], true[1], true[0]])
    return errors


PRINTED = [
    (0.1, 3, [(0.0002, 0.0054), (0.0002, 0.0054), (0.0004, 0.0055)], (0.141, 0.250)),
    (1, 0, [(0.002, 0.018), (0.010, 0.018), (0.032, 0.018)], (1.41, 2.46)),
    (1, 3, [(0.004, 0.070), (0.013, 0.070), (0.034, 0.071)], (1.41, 2.51)),
    (4, 3, [(0.058, 0.490), (0.202, 0.502), (0.618, 0.536)], (5.66, 10.2)),
]


@pytest.mark.parametrize(("delta", "alpha_x", "columns", "peaks"), PRINTED)
def test_small_angle_forms_err_as_much_as_the_table_says(delta, alpha_x, columns, peaks):
    """The published accuracy of the small-angle forms, to the digits printed, over all azimuths and error signs."""
    for limit, (elevation, azimuth) in zip((5, 30, 60), columns, strict=True):
        seen = worst(delta, alpha_x, limit)
        assert seen[0] == pytest.approx(elevation, rel=0.03, abs=6e-5 if elevation < 1e-3 else 6e-4)
        assert seen[1] == pytest.approx(azimuth, rel=0.03, abs=6e-5 if azimuth < 1e-2 else 6e-4)
    assert seen[2:] == pytest.approx(peaks, rel=6e-3)


def test_a_misalignment_is_the_exact_step_between_frames():
    """A_x(ax) A_x(dax) A_z(daz) A_x(ax)^T takes true radar coordinates to believed ones, for random attitudes."""
    rng = np.random.default_rng(4)
    h, ax, az, dx, dz = rng.uniform(-0.5, 0.5, (5, 200))
    vector = rng.normal(size=(200, 3))
    true = np.einsum("nij,nj->ni", attitude_matrix(h, ax, az), vector)
    believed = np.einsum("nij,nj->ni", attitude_matrix(h, ax + dx, az + dz), vector)
    assert np.einsum("nij,nj->ni", po.misalignment(ax, dx, dz), true) == pytest.approx(believed, abs=1e-14)


def test_first_order_matrices_keep_and_drop_the_cross_term():
    """Eq 15 agrees with the exact matrix to second order; eq 16 (alpha_x = 0) loses 0.21 degrees of azimuth at 4 x 3 degrees."""
    dx, dz = 1e-4, -2e-4
    assert po.misalignment_first_order(0.05, dx, dz) == pytest.approx(po.misalignment(0.05, dx, dz), abs=1e-7)
    ahead = po.misalignment(3 * DEG, 0.0, 4 * DEG) @ np.array([1.0, 0.0, 0.0])
    assert np.rad2deg(po.azimuth_elevation(ahead)[0]) == pytest.approx(0.210, abs=1e-3)
    assert po.small_angle_designation(0.0, 0.0, 0.0, 4 * DEG)[0] == pytest.approx(0.0)
    length = np.linalg.norm(po.misalignment_first_order(0.0, 4 * DEG, 4 * DEG) @ po.direction(-np.pi / 4, 0.0))
    assert length == pytest.approx(1.0049, abs=1e-4)


def test_small_angle_forms_are_safe_in_every_quadrant_and_missing_at_the_zenith():
    """Azimuths beyond 90 degrees keep their quadrant; where the asin's argument exceeds 1 the elevation is missing."""
    for azimuth in np.deg2rad([-170.0, -100.0, 100.0, 170.0]):
        d_az, _ = po.small_angle_designation(azimuth, 0.2, 0.01, -0.01)
        assert abs(d_az) < 0.01
    assert np.isnan(po.small_angle_designation(0.0, 88 * DEG, 0.0, 4 * DEG)[1])
    assert np.isfinite(po.designation_error(0.0, 88 * DEG, 0.0, (0.0, 0.0), (0.0, 4 * DEG))[1])


def test_the_two_errors_oppose_each_other():
    """Report error is minus designation error to first order, for a level true attitude; both are zero without an error."""
    az, el = 0.7, 0.3
    designation = po.designation_error(az, el, 0.2, (0.0, 0.0), (1e-4, -2e-4))
    report = po.report_error(az, el, 0.2, (0.0, 0.0), (1e-4, -2e-4))
    assert np.array(report) == pytest.approx(-np.array(designation), rel=2e-3)
    first = po.first_order_designation(az - 0.2, el, 1e-4, -2e-4)
    assert np.array(designation) == pytest.approx(np.array(first), rel=2e-3, abs=1e-7)
    assert np.array(po.report_error(az, el, 0.2, (0.03, 0.02), (0.03, 0.02))) == pytest.approx(0.0, abs=1e-15)


def test_a_lowered_front_reports_high_and_a_raised_right_side_low():
    """A radar that takes itself for level reports a target ahead too high by alpha_z, one to the right too low by alpha_x."""
    _, el = po.report_error(0.0, 0.1, 0.0, (0.0, 0.02), (0.0, 0.0))
    assert el == pytest.approx(0.02)
    _, el = po.report_error(np.pi / 2, 0.1, 0.0, (0.02, 0.0), (0.0, 0.0))
    assert el == pytest.approx(-0.02)


def test_the_largest_errors_are_the_hypotenuse():
    """Over all azimuths |d_El| reaches hypot(dax, daz) and |d_Az| tan(El) times that."""
    az = np.linspace(0, 2 * np.pi, 100_001)
    d_az, d_el = po.first_order_designation(az, 0.6, 0.003, 0.004)
    assert np.abs(d_el).max() == pytest.approx(0.005, rel=1e-6)
    assert np.abs(d_az).max() == pytest.approx(0.005 * np.tan(0.6), rel=1e-6)


def test_sigmas_propagate_as_random_errors_do():
    """Independent normal attitude errors scatter azimuth and elevation by the propagated sigmas."""
    rng = np.random.default_rng(6)
    dx, dz = 0.001 * rng.standard_normal(200_000), 0.002 * rng.standard_normal(200_000)
    d_az, d_el = po.designation_error(0.8, 0.5, 0.0, (0.0, 0.0), (dx, dz))
    across, up = po.pointing_sigma(0.8, 0.5, 0.001, 0.002)
    assert (d_az.std(), d_el.std()) == pytest.approx((across, up), rel=0.01)


def test_a_tilted_radar_turns_pitch_noise_into_azimuth():
    """At 3 degrees of roll and 1 degree of elevation azimuth scatters as the sensitivities say, 2.5 times what a level radar's does."""
    rng = np.random.default_rng(7)
    dx, dz = 0.002 * rng.standard_normal((2, 100_000))
    attitude = (3 * DEG, 2 * DEG)
    d_az, d_el = po.report_error(0.02, 1 * DEG, 0.0, attitude, (attitude[0] + dx, attitude[1] + dz))
    (ax, az), (ex, ez) = po.report_sensitivity(0.02, 1 * DEG, 0.0, attitude)
    assert d_az.std() == pytest.approx(0.002 * np.hypot(ax, az), rel=0.01)
    assert d_el.std() == pytest.approx(0.002 * np.hypot(ex, ez), rel=0.01)
    level = po.pointing_sigma(0.02, 1 * DEG, 0.002, 0.002)[0]
    assert d_az.std() / level == pytest.approx(2.5, rel=0.25)


def test_correction_undoes_what_the_attitude_did():
    """Angles made by a radar that takes itself for level come back to the truth with its real attitude."""
    rng = np.random.default_rng(9)
    az, el = rng.uniform(0, 2 * np.pi, 300), rng.uniform(-0.1, 1.2, 300)
    ax, azz = rng.uniform(-0.1, 0.1, (2, 300))
    d_az, d_el = po.report_error(az, el, 0.4, (ax, azz), (0.0, 0.0))
    back = po.corrected(az + d_az, el + d_el, 0.4, (0.0, 0.0), (ax, azz))
    assert wrapped(back[0] - az) == pytest.approx(0.0, abs=1e-12)
    assert back[1] == pytest.approx(el, abs=1e-12)
