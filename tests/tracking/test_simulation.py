from dataclasses import fields, replace

import numpy as np
import pytest

from rangeeval.physics.measurement import angle_sigma, cross_range_sigma, range_sigma
from rangeeval.stats import variance as va
from rangeeval.tracking import alpha_beta as ab
from rangeeval.tracking.simulation import Scenario, simulate

SETTLED = 110  # ceil(11 / 0.1): the angle gains start near 0.1 at long range


def chosen(log, low_km, high_km, widest_sine=0.5):
    """Settled updates in a bin of predicted range, within 30 degrees of boresight in both angles.

    Manoeuvring flights wander 10 km sideways by the end; further off, beam coordinates couple the axes.
    """
    r = log.range_predicted_m
    ahead = np.maximum(np.abs(log.y_true_m), np.abs(log.z_true_m)) < widest_sine * log.range_true_m
    return ahead & (r >= low_km * 1e3) & (r < high_km * 1e3) & (log.update >= SETTLED)


def range_ratio(log, m, ratio):
    """Assessed over true sigma of the filtered range."""
    t = va.track_sigma(log.range_residual_m[m], log.alpha_range[m], log.beta_range[m], ratio)
    return t.sigma / np.std(log.range_filtered_m[m] - log.range_true_m[m])


def angle_ratio(log, m, ratio, axis, *, per_sample=False):
    """Assessed over true sigma of a filtered array angle."""
    residual, predicted, alpha, beta = (
        getattr(log, name)[m] for name in (f"{axis}_residual_m", f"{axis}_predicted_m", f"alpha_{axis}", f"beta_{axis}")
    )
    g = va.angle_sigma(residual, alpha, beta, log.range_predicted_m[m], predicted, ratio)
    filtered = getattr(log, f"{axis}_filtered_m")[m] / log.range_filtered_m[m]
    true = getattr(log, f"{axis}_true_m")[m] / log.range_true_m[m]
    sigma = g.sigma_per_sample_rad if per_sample else g.sigma_rad
    return sigma / np.std(np.arcsin(filtered) - np.arcsin(true))


@pytest.fixture(scope="module")
def steady():
    """Forty flights at constant velocity."""
    return simulate(Scenario(flights=40), seed=3)


@pytest.fixture(scope="module")
def manoeuvring():
    """Two hundred flights that manoeuvre as the gains expect."""
    return simulate(Scenario(flights=200, acceleration_sigma_m_s2=5.0), seed=4)


def test_same_seed_gives_the_same_bits():
    """A scenario and a seed determine every number; another seed gives others."""
    scenario = Scenario(flights=2, miss_probability=0.1, outlier_probability=0.05, snr_log_sigma_db=1.0)
    one, two, other = (simulate(scenario, seed=s) for s in (1, 1, 2))
    for field in fields(one):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(two, field.name))
    assert not np.array_equal(one.range_residual_m[:50], other.range_residual_m[:50])


def test_log_obeys_the_filters_own_equations(steady):
    """Estimate = prediction + alpha residual, and gains are those of each axis' tracking index."""
    s = Scenario()
    for axis in ("range", "y", "z"):
        step = getattr(steady, f"alpha_{axis}") * getattr(steady, f"{axis}_residual_m")
        filtered = getattr(steady, f"{axis}_filtered_m") - getattr(steady, f"{axis}_predicted_m")
        np.testing.assert_allclose(filtered, step, atol=1e-9)
    snr = s.reference_snr_db + 40 * np.log10(s.reference_range_m / steady.range_predicted_m)
    sigma_theta = angle_sigma(snr, s.beamwidth_elevation_rad, s.monopulse_slope)
    for axis, sigma in {
        "range": range_sigma(snr, s.bandwidth_hz),
        "y": cross_range_sigma(sigma_theta, steady.range_predicted_m, steady.y_predicted_m / steady.range_predicted_m),
        "z": cross_range_sigma(sigma_theta, steady.range_predicted_m, steady.z_predicted_m / steady.range_predicted_m),
    }.items():
        alpha, beta = ab.gains_from_tracking_index(s.design_acceleration_m_s2 * s.interval_s**2 / sigma)
        np.testing.assert_allclose(getattr(steady, f"alpha_{axis}"), alpha, rtol=1e-10)
        np.testing.assert_allclose(getattr(steady, f"beta_{axis}"), beta, rtol=1e-10)


def test_angle_residual_is_formed_with_the_predicted_range():
    """With exact angles and poor range, (residual + prediction) / predicted range is the true sine to
    rounding.
    """
    scenario = Scenario(flights=2, range_floor_m=500.0, beamwidth_elevation_rad=1e-9, beamwidth_azimuth_rad=1e-9)
    log = simulate(scenario, seed=5)
    for axis in ("y", "z"):
        residual, predicted = getattr(log, f"{axis}_residual_m"), getattr(log, f"{axis}_predicted_m")
        measured = (residual + predicted) / log.range_predicted_m
        np.testing.assert_allclose(measured, getattr(log, f"{axis}_true_m") / log.range_true_m, atol=1e-9)


def test_tracker_predicts_the_true_path_without_noise():
    """With almost no measurement noise the prediction of a straight flight is the truth in every
    coordinate.
    """
    log = simulate(Scenario(flights=1, reference_snr_db=180.0, design_acceleration_m_s2=1e-9), seed=0)
    for axis in ("range", "y", "z"):
        error = getattr(log, f"{axis}_predicted_m") - getattr(log, f"{axis}_true_m")
        assert np.abs(error).max() < 0.05
    assert log.range_true_m[0] > 99_000
    assert log.range_true_m[-1] < 10_300


def test_assessed_range_sigma_is_right_at_constant_velocity(steady):
    """Eq 13 over truth is 0.96 to 1.04 in every 10 km from 15 to 85 km (full run: 0.98 to 1.03)."""
    ratios = [range_ratio(steady, chosen(steady, low, low + 10), ab.q_cv) for low in range(15, 85, 10)]
    assert 0.96 < min(ratios) <= max(ratios) < 1.04, ratios


@pytest.mark.parametrize("axis", ["y", "z"])
def test_assessed_angle_sigma_is_right_at_constant_velocity(steady, axis):
    """Eq 29 over truth is 0.92 to 1.08 in every 10 km from 25 to 85 km."""
    ratios = [angle_ratio(steady, chosen(steady, low, low + 10), ab.q_cv, axis) for low in range(25, 85, 10)]
    assert 0.92 < min(ratios) <= max(ratios) < 1.08, ratios


def test_wrong_ratio_misleads_when_the_target_manoeuvres(manoeuvring):
    """At the design manoeuvre eq 13 is 1.31, 1.09, 1.01, 0.97 of the truth at 22.5 to 82.5 km; alpha
    (1-alpha) right.
    """
    for low, printed in {20: 1.31, 40: 1.09, 60: 1.01, 80: 0.97}.items():
        m = chosen(manoeuvring, low, low + 5)
        assert range_ratio(manoeuvring, m, ab.q_cv) == pytest.approx(printed, abs=0.05)
        assert range_ratio(manoeuvring, m, ab.q_white) == pytest.approx(1.0, abs=0.04)


def test_residuals_of_a_manoeuvring_target_are_white_and_of_a_steady_one_not(steady, manoeuvring):
    """The lag-one correlation of range residuals is near its closed form at constant velocity, near 0 in
    manoeuvre.
    """
    found = []
    for log in (steady, manoeuvring):
        m = chosen(log, 40, 45)
        e = log.range_residual_m
        pairs = m[1:] & m[:-1] & (log.track[1:] == log.track[:-1])
        found.append(np.mean(e[1:][pairs] * e[:-1][pairs]) / np.mean(e[m] ** 2))
        expected = float(ab.lag_one_correlation_cv(log.alpha_range[m].mean(), log.beta_range[m].mean()))
    assert found[0] == pytest.approx(expected, abs=0.05)
    assert found[1] == pytest.approx(0.0, abs=0.05)


@pytest.mark.slow
def test_full_end_to_end_table():
    """250 flights: eq 13 over truth 0.97-1.03, eq 29 0.96-1.06 beyond 15 km, theta_a 1.10 +- 0.06 at
    12.5 km.
    """
    log = simulate(Scenario(flights=250), seed=6)
    for low in range(15, 85, 5):
        m = chosen(log, low, low + 5)
        assert range_ratio(log, m, ab.q_cv) == pytest.approx(1.0, abs=0.03), low
        for axis in ("y", "z"):
            assert 0.96 < angle_ratio(log, m, ab.q_cv, axis) < 1.06, (low, axis)
    near = chosen(log, 10, 15)
    assert range_ratio(log, near, ab.q_cv) == pytest.approx(0.98, abs=0.03)
    assert 1.04 < angle_ratio(log, near, ab.q_cv, "z") < 1.17

    log = simulate(Scenario(flights=250, acceleration_sigma_m_s2=5.0), seed=7)
    for low, printed in {20: 1.31, 40: 1.09, 60: 1.01, 80: 0.97}.items():
        m = chosen(log, low, low + 5)
        assert range_ratio(log, m, ab.q_cv) == pytest.approx(printed, abs=0.04)
        assert range_ratio(log, m, ab.q_white) == pytest.approx(1.0, abs=0.035)
    for low in range(45, 85, 5):
        m = chosen(log, low, low + 5)
        assert 0.85 < angle_ratio(log, m, ab.q_cv, "y") < 0.96
        assert angle_ratio(log, m, ab.q_white, "y") == pytest.approx(1.0, abs=0.06)


def test_independent_updates_leak_range_noise_into_the_angle():
    """45 degrees off boresight with poor range, eq 29 sees about 0.6 of the true theta_a; directions kept,
    all of it.
    """
    scenario = Scenario(
        flights=150,
        start_range_m=60_000.0,
        end_range_m=45_000.0,
        cross_range_m=37_000.0,
        bandwidth_hz=0.25e6,
        beamwidth_azimuth_rad=np.deg2rad(0.35),
        beamwidth_elevation_rad=np.deg2rad(0.35),
        reference_snr_db=20.0,
        reference_range_m=50_000.0,
    )
    ratios = []
    for keeps in (False, True):
        log = simulate(replace(scenario, keeps_direction=keeps), seed=8)
        m = chosen(log, 48, 55, widest_sine=1.0)
        assert m.sum() > 500
        ratios.append(angle_ratio(log, m, ab.q_cv, "z"))
    assert 0.5 < ratios[0] < 0.75
    assert ratios[1] == pytest.approx(1.0, abs=0.06)


def test_missed_detections_coast_on_the_prediction():
    """A missed update has no residual and zero gains, and its estimate is its prediction."""
    log = simulate(Scenario(flights=5, miss_probability=0.2), seed=9)
    missed = np.isnan(log.range_residual_m)
    assert missed.mean() == pytest.approx(0.2, abs=0.02)
    assert np.isnan(log.y_residual_m[missed]).all()
    assert (log.alpha_range[missed] == 0).all()
    assert (log.beta_z[missed] == 0).all()
    np.testing.assert_array_equal(log.range_filtered_m[missed], log.range_predicted_m[missed])
    assert not ab.usable(log.range_residual_m, log.alpha_range, log.beta_range)[missed].any()
    assert np.isfinite(log.range_residual_m[~missed]).all()


def test_outliers_are_marked_and_large():
    """Marked measurements scatter many times as much as the others."""
    log = simulate(Scenario(flights=10, outlier_probability=0.01, outlier_factor=20.0), seed=10)
    m = chosen(log, 60, 85)
    assert log.outlier.mean() == pytest.approx(0.01, abs=0.004)
    inside, outside = log.range_residual_m[m & log.outlier], log.range_residual_m[m & ~log.outlier]
    assert np.std(inside) > 5 * np.std(outside)


def test_waveform_switch_changes_the_range_noise_only_below_its_range():
    """Below 35 km the wide pulse has three times the range residual's scatter; beyond, nothing changes."""
    base = Scenario(flights=20, design_acceleration_m_s2=5.0)
    plain = simulate(base, seed=11)
    switched = simulate(replace(base, switch_range_m=35_000.0, bandwidth_near_hz=0.5e6), seed=11)
    np.testing.assert_array_equal(switched.waveform, (switched.range_predicted_m < 35_000).astype(int))
    far = plain.range_predicted_m > 36_000
    np.testing.assert_array_equal(plain.range_residual_m[far], switched.range_residual_m[far])
    m = chosen(switched, 25, 30)
    sigma_v = np.sqrt(
        np.mean(switched.range_residual_m[m] ** 2 / ab.residual_variance(switched.alpha_range, switched.beta_range)[m])
    )
    assert sigma_v == pytest.approx(range_sigma(switched.snr_true_db[m].mean(), 0.5e6), rel=0.06)


def test_outbound_leg_is_a_track_of_its_own():
    """Each flight turns into a second track that flies away, later in time."""
    log = simulate(Scenario(flights=2, outbound=True), seed=12)
    assert sorted(set(log.track)) == [0, 1, 2, 3]
    for track in range(4):
        m = log.track == track
        assert set(log.outbound[m]) == {track % 2}
        assert np.all(np.diff(log.time_s[m]) > 0)
        assert (np.diff(log.range_true_m[m]) > 0).all() == bool(track % 2)
    assert log.time_s[log.track == 1].min() > log.time_s[log.track == 0].max()


def test_heading_does_not_change_what_the_radar_sees():
    """A radar that faces elsewhere, with the flight turned alike, sees the same; a tilted face sees y
    lower.
    """
    north = simulate(Scenario(flights=1), seed=13)
    east = simulate(Scenario(flights=1, heading_rad=1.9), seed=13)
    np.testing.assert_allclose(east.z_predicted_m, north.z_predicted_m, atol=1e-5)
    np.testing.assert_allclose(east.range_residual_m, north.range_residual_m, atol=1e-5)
    tilted = simulate(Scenario(flights=1, tilt_rad=0.2), seed=13)
    np.testing.assert_allclose(tilted.range_true_m, north.range_true_m, rtol=1e-12)
    x = np.sqrt(north.range_true_m**2 - north.y_true_m**2 - north.z_true_m**2)
    np.testing.assert_allclose(tilted.y_true_m, np.cos(0.2) * north.y_true_m - np.sin(0.2) * x, rtol=1e-9)


def test_logged_snr_scatters_about_the_true_mean():
    """The logged SNR is the true mean, which falls with R^4, plus the scatter asked for."""
    log = simulate(Scenario(flights=5, snr_log_sigma_db=1.5), seed=14)
    np.testing.assert_allclose(log.snr_true_db, 20 + 40 * np.log10(80e3 / log.range_true_m), rtol=1e-12)
    assert np.std(log.snr_db - log.snr_true_db) == pytest.approx(1.5, rel=0.05)


def test_flights_that_do_not_fit_are_refused():
    """An end nearer than the passing distance, or a leg too short for a track, is refused with its
    numbers.
    """
    with pytest.raises(ValueError, match="passing at 5385"):
        simulate(Scenario(end_range_m=5_000.0), seed=0)
    with pytest.raises(ValueError, match="the flight has 1 measurements"):
        simulate(Scenario(start_range_m=10_001.0), seed=0)
