import numpy as np
import pytest

from rangeeval.physics import attitude as at
from rangeeval.physics.frames import attitude_matrix

G = 9.80665
DEG = np.pi / 180


def test_tilt_of_a_still_sensor_is_the_arc_sine_and_beyond_g_is_missing():
    """f = g sin(alpha) gives alpha back; a reading beyond g has no tilt, or is clipped where that is asked for."""
    alpha = np.linspace(-1.5, 1.5, 31)
    assert at.tilt(G * np.sin(alpha), G) == pytest.approx(alpha, rel=1e-12)
    force = np.array([G, -G, 1.0001 * G, -20.0, np.nan])
    assert at.tilt(force, G)[:2] == pytest.approx([np.pi / 2, -np.pi / 2])
    assert np.isnan(at.tilt(force, G)[2:]).all()
    assert at.tilt(force, G, clip=True)[:4] == pytest.approx([np.pi / 2, -np.pi / 2, np.pi / 2, -np.pi / 2])
    assert at.out_of_domain(force, G).tolist() == [False, False, True, True, False]


FIGURE_3 = """
0.161 0.644 1.449  2.577  4.029
0.322 1.288 2.899  5.158  8.074
0.483 1.932 4.350  7.748 12.155
0.644 2.577 5.803 10.350 16.291
0.805 3.221 7.259 12.969 20.503
"""


def test_one_accelerometer_has_the_peak_errors_of_figure_3():
    """Amplitudes 0.2 to 1 degree by 0.2 to 1 Hz at 5 m give the published grid; at 2 Hz and 0.8 degrees there is none."""
    printed = np.array([[float(v) for v in line.split()] for line in FIGURE_3.strip().splitlines()])
    steps = np.array([0.2, 0.4, 0.6, 0.8, 1.0])
    peak = at.single_error_peak(0.0, steps[:, None] * DEG, at.lever_ratio(5.0, steps[None, :], G))
    assert np.rad2deg(peak) == pytest.approx(printed, abs=5.1e-4)
    assert np.isfinite(at.single_error_peak(0.0, 0.6 * DEG, at.lever_ratio(5.0, 2.0, G)))
    assert np.isnan(at.single_error_peak(0.0, 0.8 * DEG, at.lever_ratio(5.0, 2.0, G)))


def test_one_accelerometer_on_the_table_1_radar():
    """kappa is 12.88; the largest errors over a fine record are 2.583 degrees (x) and 3.873 degrees (z)."""
    assert at.lever_ratio(5.0, 0.8, G) == pytest.approx(12.88217, abs=1e-5)
    t = np.linspace(0, 1.25, 100_001)
    for static, dynamic, peak in ((3.0, 0.2, 2.583), (2.0, 0.3, 3.873)):
        w = 2 * np.pi * 0.8
        alpha = DEG * (static + dynamic * np.sin(w * t))
        force = at.reading(alpha, -DEG * dynamic * w**2 * np.sin(w * t), 5.0, G)
        seen = np.rad2deg(np.abs(at.tilt(force, G) - alpha).max())
        assert seen == pytest.approx(peak, abs=6e-4)
        assert np.rad2deg(
            at.single_error_peak(static * DEG, dynamic * DEG, at.lever_ratio(5.0, 0.8, G))
        ) == pytest.approx(seen, rel=1e-7)


@pytest.mark.parametrize("radii", [(5.0, 1.0), (5.0, 0.0), (5.0, -5.0), (-1.0, -4.0), (5.0, 4.5)])
def test_a_pair_gives_tilt_and_acceleration_of_any_motion(radii):
    """Made-up tilt and angular acceleration, unrelated to each other, come back to rounding."""
    rng = np.random.default_rng(2)
    alpha, swing = rng.uniform(-0.3, 0.3, 500), rng.normal(0, 0.5, 500)
    upper, lower = (at.reading(alpha, swing, r, G) for r in radii)
    assert at.pair_tilt(upper, lower, *radii, G) == pytest.approx(alpha, abs=2e-14)
    assert at.pair_acceleration(upper, lower, *radii) == pytest.approx(swing, abs=1e-12)
    shape = at.height_weights(radii).centre
    assert shape.sum() == pytest.approx(1.0)
    assert shape == pytest.approx([-radii[1] / (radii[0] - radii[1]), radii[0] / (radii[0] - radii[1])])


def test_equal_radii_are_refused():
    """Two sensors at one radius cannot tell tilt from acceleration, and neither can one."""
    with pytest.raises(ValueError, match="different radii"):
        at.pair_tilt(1.0, 1.0, 3.0, 3.0, G)
    with pytest.raises(ValueError, match="different radii"):
        at.height_weights([2.0])


AMPLIFICATION = {
    (5, -5): 0.707, (5, 0): 1.0, (5, 1): 1.275, (5, 2): 1.795, (5, 2.5): 2.236, (5, 3): 2.915, (5, 4): 6.403,
    (5, 4.5): 13.45, (6, 5): 7.810,
}  # fmt: skip


@pytest.mark.parametrize(("radii", "factor"), AMPLIFICATION.items())
def test_noise_amplification_is_the_published_one_and_what_noise_does(radii, factor):
    """The table of factors; and 200 000 noisy samples scatter by it."""
    assert at.noise_amplification(radii) == pytest.approx(factor, rel=4e-4)
    rng = np.random.default_rng(5)
    noise = 0.01 * rng.standard_normal((2, 200_000))
    seen = at.pair_tilt(*(G * np.sin(0.05) + noise), *radii, G).std()
    assert at.tilt_sigma(at.height_weights(radii).centre, [0.01, 0.01], G, 0.05) == pytest.approx(seen, rel=0.01)


def test_unequal_noises_follow_the_lever_rule():
    """sigma = sqrt(R_U^2 sigma_L^2 + R_L^2 sigma_U^2) / (|R_U - R_L| g cos alpha)."""
    weights = at.height_weights((5.0, 1.0)).centre
    expected = np.sqrt(25 * 0.02**2 + 1 * 0.03**2) / (4 * G * np.cos(0.1))
    assert at.tilt_sigma(weights, [0.03, 0.02], G, 0.1) == pytest.approx(expected, rel=1e-14)


def test_more_sensors_are_a_least_squares_line():
    """Three sensors give the motion exactly, follow numpy's polynomial fit under noise, and amplify it as the formula says."""
    radii = np.array([5.0, 3.0, 1.0])
    rng = np.random.default_rng(1)
    force = at.reading(0.04, 0.3, radii, G) + 0.02 * rng.standard_normal(3)
    line = at.height_weights(radii.tolist())
    slope, centre = np.polyfit(radii, force, 1)
    assert (line.centre @ force, line.slope @ force) == pytest.approx((centre, slope))
    formula = np.sqrt(np.sum(radii**2) / (3 * np.sum(radii**2) - np.sum(radii) ** 2))
    assert at.noise_amplification(radii.tolist()) == pytest.approx(formula, rel=1e-12)
    sigma = np.array([0.01, 0.05, 0.02])
    weighted = at.height_weights(radii.tolist(), sigma.tolist())
    slope, centre = np.polyfit(radii, force, 1, w=1 / sigma)
    assert (weighted.centre @ force, weighted.slope @ force) == pytest.approx((centre, slope))


def test_a_rigid_body_that_rocks_about_two_axes_is_read_exactly():
    """Specific force of points of a turning body, by finite differences of their positions, is linear in height and gives both angles."""
    rng = np.random.default_rng(3)
    h, step = np.array([4.0, 1.0]), 1e-3
    p = rng.uniform(0.02, 0.06, 4)

    def angles(t):
        return p[0] + p[1] * np.sin(5 * t + 1), p[2] + p[3] * np.sin(4 * t)

    def position(t, height):
        return attitude_matrix(0.0, *angles(t)).T @ np.array([0.0, height, 0.0])

    t = 0.7
    body = attitude_matrix(0.0, *angles(t))
    readings = []
    for height in h:
        nodes = [position(t + k * step, height) for k in (-2, -1, 0, 1, 2)]
        acceleration = (-nodes[0] + 16 * nodes[1] - 30 * nodes[2] + 16 * nodes[3] - nodes[4]) / (12 * step**2)
        readings.append(body @ (acceleration + np.array([0.0, G, 0.0])))
    # A height above the centre is a negative radius.
    line = at.height_weights((-h).tolist())
    force_x = line.centre @ [f[2] for f in readings]
    force_z = line.centre @ [-f[0] for f in readings]
    alpha_x, alpha_z = at.two_axis_tilt(force_x, force_z, G)
    assert (alpha_x, alpha_z) == pytest.approx(angles(t), abs=2e-8)
    # The plain arc sine of the roll reading is off by tan(ax) (1 - cos(az)).
    off = at.tilt(force_x, G) - alpha_x
    assert off == pytest.approx(-np.tan(alpha_x) * (1 - np.cos(alpha_z)), rel=0.01)


def test_systematic_errors_have_their_published_sizes():
    """A shift of 0.1 m: 0.077 deg; 1 mg: 0.072 deg; 10 ms: 0.030 deg; 1 mm of sway: 0.148 deg; g off by 0.1 %: 0.003 deg; 0.1 s late: 0.149 deg."""
    lever = at.residual_lever((5.0, 1.0), (0.1, 0.1))
    assert lever == pytest.approx(-0.1)
    deg = np.rad2deg
    assert deg(at.lever_error_peak(lever, 0.8, 0.3 * DEG, G)) == pytest.approx(0.077, abs=5e-4)
    assert deg(at.lever_error_peak(0.5, 0.8, 0.3 * DEG, G)) == pytest.approx(0.39, abs=5e-3)
    weights = at.height_weights((5.0, 1.0)).centre
    assert deg(at.bias_error(weights, (0.0, 1e-3 * G), G)) == pytest.approx(0.072, abs=5e-4)
    assert deg(at.skew_error_peak(5.0, 1.0, 0.01, 0.8, 0.3 * DEG, G)) == pytest.approx(0.030, abs=5e-4)
    assert deg(at.sway_error_peak(1e-3, 0.8, G)) == pytest.approx(0.148, abs=5e-4)
    assert deg(at.gravity_error(3 * DEG, 1e-3)) == pytest.approx(-0.003, abs=5e-5)
    assert deg(at.latency_error_peak(0.1, 0.8, 0.3 * DEG)) == pytest.approx(0.149, abs=5e-4)


def test_systematic_errors_are_what_a_record_shows():
    """Wrong radii, a bias and a time skew put into a noise-free record err by as much as their formulas say."""
    t, w, f = np.linspace(0, 2.5, 20_001), 2 * np.pi * 0.8, 0.8
    static, dynamic = 0.01, 0.3 * DEG

    def force(radius, time=t):
        return at.reading(static + dynamic * np.sin(w * time), -dynamic * w**2 * np.sin(w * time), radius, G)

    alpha = static + dynamic * np.sin(w * t)
    wrong = at.pair_tilt(force(5.0), force(1.0), 5.05, 0.9, G) - alpha
    assert np.abs(wrong).max() == pytest.approx(
        at.lever_error_peak(at.residual_lever((5.0, 1.0), (0.05, -0.1)), f, dynamic, G), rel=1e-3
    )
    biased = at.pair_tilt(force(5.0) + 0.02, force(1.0) - 0.01, 5.0, 1.0, G) - alpha
    assert biased.mean() == pytest.approx(
        at.bias_error(at.height_weights((5.0, 1.0)).centre, (0.02, -0.01), G, static), rel=1e-3
    )
    late = at.pair_tilt(force(5.0), force(1.0, t - 0.01), 5.0, 1.0, G) - alpha
    assert np.abs(late).max() == pytest.approx(at.skew_error_peak(5.0, 1.0, 0.01, f, dynamic, G), rel=2e-3)


def test_radii_come_back_from_an_oscillation():
    """Signed amplitudes and the spacing give both radii of a pair, and three of three, at any signs."""
    w2 = (2 * np.pi * 0.8) ** 2
    for radii in ([5.0, 1.0], [3.0, -2.0], [0.2, -1.5], [5.0, 3.0, 1.0]):
        r = np.array(radii)
        amplitudes = (G * np.cos(0.04) - r * w2) * 0.005
        found = at.radii_from_oscillation(amplitudes, r - r[-1], 0.8, 0.04, G)
        assert found == pytest.approx(r, abs=1e-9)
    rho, d = (G - 5 * w2) / (G - 1 * w2), 4.0
    assert at.radii_from_oscillation([rho, 1.0], [d, 0.0], 0.8, 0.0, G)[0] == pytest.approx(
        G / w2 - rho * d / (1 - rho)
    )
    with pytest.raises(ValueError, match="equal amplitudes"):
        at.radii_from_oscillation([1.0, 1.0], [4.0, 0.0], 0.8, 0.0, G)


def test_a_radius_follows_from_a_reference_attitude():
    """Least squares against a known attitude gives the radius, a bias apart, within its standard error."""
    rng = np.random.default_rng(8)
    t = np.arange(0, 60, 0.02)
    alpha, swing = 0.02 * np.sin(5 * t), -0.5 * np.sin(5 * t)
    force = at.reading(alpha, swing, 3.2, G) + 0.1 + 0.05 * rng.standard_normal(t.size)
    radius, error = at.radius_from_reference(force, alpha, swing, G)
    assert abs(radius - 3.2) < 4 * error < 0.05
