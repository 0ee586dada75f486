import dataclasses
import math
import warnings

import numpy as np
import pytest

from rangeeval.angles import wrapped
from rangeeval.tracking import polar
from rangeeval.tracking.filters import FILTERS, PAPER_IMM, TEXTBOOK_IMM3, AlphaBeta, Filter, Model, kalman
from rangeeval.tracking.measurements import Measurements
from rangeeval.tracking.motion import noise_matrix, transition
from rangeeval.tracking.runs import Flag, log_likelihood, run, run_many
from rangeeval.tracking.starting import three_point
from tests.tracking.tracks import SIGMA, flight, track

EXACT = dataclasses.replace(
    PAPER_IMM, models=(PAPER_IMM.models[0], dataclasses.replace(PAPER_IMM.models[1], motion="ct"))
)
KALMAN = dataclasses.replace(kalman("cv", 20.0), noise="discrete")


def with_z(measurements, row, value):
    """The same measurements with something else in one row."""
    z = measurements.z.copy()
    z[row] = value
    return dataclasses.replace(measurements, z=z)


def sound(found):
    """No state is missing once a track has begun, and every variance is positive."""
    begun = np.flatnonzero(np.isfinite(found.state[:, 0]))
    assert begun.size
    assert np.all(np.isfinite(found.state[begun[0] :]))
    if not isinstance(found.filter, AlphaBeta):
        assert np.all(np.linalg.eigvalsh(found.covariance[begun[0] :]) > 0)
    assert np.all(np.isfinite(found.log_likelihood))


def filterpy_imm(measurements, spec):
    """filterpy's IMM of two extended Kalman filters, both with nine states: that of straight flight has its turn rate
    drawn anew after each update.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from filterpy.kalman import ExtendedKalmanFilter, IMMEstimator

    class One(ExtendedKalmanFilter):
        def __init__(self, model, x, p):
            super().__init__(dim_x=9, dim_z=3)
            self.model, self.R = model, np.diag(SIGMA**2)
            self.x, self.P = x.copy(), p.copy()
            self.anew()

        def anew(self):
            if self.model.motion == "cv":
                self.x[6:], self.P[6:], self.P[:, 6:] = 0.0, 0.0, 0.0
                self.P[6:, 6:] = np.eye(3) * spec.models[1].prior_turn_rad_s ** 2

        def predict(self, u=None):
            moved, f = transition(self.model.motion, self.x, 1.0)
            if self.model.motion == "cv":
                f = f.copy()
                f[6:, 6:] = np.eye(3)
                moved = f @ self.x
            q = noise_matrix(self.model.motion, self.model.sigma_m_s2, self.model.sigma_turn_rad_s, 1.0)
            self.x, self.P = moved.copy(), f @ self.P @ f.T + q

        def update(self, z):
            def residual(a, b):
                d = a - b
                d[1] = wrapped(d[1])
                return d

            super().update(
                z,
                lambda x: np.hstack([polar.jacobian(x[:3]), np.zeros((3, 6))]),
                lambda x: polar.of_position(x[:3]),
                residual=residual,
            )
            self.anew()

    x, p = three_point(measurements.time_s[:3], measurements.z[:3], SIGMA)
    x[6:], p[6:], p[:, 6:] = 0.0, 0.0, 0.0
    p[6:, 6:] = np.eye(3) * spec.models[1].prior_turn_rad_s ** 2
    imm = IMMEstimator([One(model, x, p) for model in spec.models], [0.5, 0.5], np.array(spec.transition))
    states, probabilities = [], []
    for z in measurements.z[3:]:
        imm.predict()
        imm.update(z)
        states.append(imm.x[:6].copy())
        probabilities.append(imm.mu.copy())
    return np.array(states), np.array(probabilities)


@pytest.mark.parametrize("spec", [PAPER_IMM, EXACT], ids=["second-order", "exact"])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_imm_agrees_with_filterpy(spec, seed):
    """Positions agree to 1e-9 m, velocities to 1e-9 m/s, probabilities to 1e-11 with an independent implementation."""
    pytest.importorskip("filterpy")
    measurements = track(seed)
    found = run(spec, measurements)
    states, probabilities = filterpy_imm(measurements, spec)
    np.testing.assert_allclose(found.state[3:], states, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.mode_probability[3:], probabilities, rtol=0, atol=1e-11)


def test_the_kalman_filter_is_the_textbook_recursion():
    """States, covariances, innovations, NIS and likelihood of an EKF written out in numpy."""
    m = track(3)
    found = run(KALMAN, m)
    x, p = three_point(m.time_s[:3], m.z[:3], SIGMA)
    x, p = x[:6], p[:6, :6]
    f, q = transition("cv", np.zeros(9), 1.0)[1][:6, :6], noise_matrix("cv", 20.0, 0.0, 1.0)[:6, :6]
    for k in range(3, len(m)):
        x, p = f @ x, f @ p @ f.T + q
        h = np.hstack([polar.jacobian(x[:3]), np.zeros((3, 3))])
        s = h @ p @ h.T + np.diag(SIGMA**2)
        nu = m.z[k] - polar.of_position(x[:3])
        nu[1] = wrapped(nu[1])
        np.testing.assert_allclose(found.innovation[k], nu, atol=1e-9)
        np.testing.assert_allclose(found.innovation_covariance[k], s, rtol=1e-9)
        nis = nu @ np.linalg.solve(s, nu)
        assert found.nis[k] == pytest.approx(nis)
        assert found.log_likelihood[k] == pytest.approx(-0.5 * (nis + np.linalg.slogdet(2 * np.pi * s)[1]))
        gain = p @ h.T @ np.linalg.inv(s)
        x, p = x + gain @ nu, p - gain @ s @ gain.T
        np.testing.assert_allclose(found.state[k], x, rtol=1e-10, atol=1e-8)
        np.testing.assert_allclose(found.covariance[k], p, rtol=1e-8, atol=1e-6)
    assert found.total_log_likelihood == pytest.approx(float(log_likelihood(KALMAN, [m])[0]))


@pytest.mark.parametrize("name", [*FILTERS])
def test_many_tracks_give_the_bits_of_one_by_one(name):
    """A batch is the same code: every number is equal to the last bit."""
    tracks = [track(seed, steps=20 + seed) for seed in range(3)]
    for together, alone in zip(run_many(FILTERS[name], tracks), (run(FILTERS[name], t) for t in tracks), strict=True):
        for field in ("state", "covariance", "innovation", "nis", "mode_probability", "gains", "flags"):
            np.testing.assert_array_equal(getattr(together, field), getattr(alone, field))


@pytest.mark.parametrize("name", [*FILTERS])
@pytest.mark.parametrize("turned", [1.0, 2.5, -2.0])
def test_north_is_nowhere_special(name, turned):
    """Turning the whole scene about the vertical, through north and through the cut at 180 degrees, turns the
    states.
    """
    c, s = math.cos(turned), math.sin(turned)
    matrix = np.kron(np.eye(2), np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]))
    plain, found = run(FILTERS[name], track(1)), run(FILTERS[name], track(1, turned=turned))
    np.testing.assert_allclose(found.state, plain.state @ matrix.T, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.nis, plain.nis, rtol=1e-7)


@pytest.mark.parametrize("spec", [PAPER_IMM, TEXTBOOK_IMM3, FILTERS["imm"]])
def test_a_missed_detection_moves_probabilities_by_the_transition_alone(spec):
    """Without a plot mu becomes Pi' mu: no likelihood is used, none is invented."""
    found = run(spec, with_z(track(2), 20, np.nan))
    np.testing.assert_allclose(
        found.mode_probability[20], np.array(spec.transition).T @ found.mode_probability[19], rtol=1e-12
    )
    assert found.flags[20] == Flag.MISSED
    assert found.nis_dof[20] == 0
    assert found.log_likelihood[20] == 0
    np.testing.assert_array_equal(found.state[20], found.predicted_state[20])


@pytest.mark.parametrize("component", [0, 1, 2])
def test_a_missing_component_is_the_limit_of_a_very_noisy_one(component):
    """Leaving out range, azimuth or elevation of one plot gives what a sigma of a million times its own gives."""
    m = track(4)
    gone = with_z(m, (15, component), np.nan)
    sigma = m.sigma.copy()
    sigma[15, component] *= 1e6
    found, limit = run(EXACT, gone), run(EXACT, dataclasses.replace(m, sigma=sigma))
    np.testing.assert_allclose(found.state[15:20], limit.state[15:20], rtol=1e-8, atol=1e-4)
    assert found.flags[15] == Flag.PARTIAL
    assert found.nis_dof[15] == 2


def test_transition_probabilities_over_two_intervals_are_those_of_one_squared():
    """Plots every 2 s, with missed ones between, or just every 2 s: nearly the same probabilities."""
    m = track(5, steps=40)
    z = m.z.copy()
    z[3::2] = np.nan
    missed = run(dataclasses.replace(EXACT, noise="continuous"), dataclasses.replace(m, z=z))
    keep = np.r_[0:3, 4:40:2]
    sparse = run(dataclasses.replace(EXACT, noise="continuous"), Measurements.of(m.time_s[keep], m.z[keep], SIGMA))
    pi = np.array(EXACT.transition)
    sole = run(EXACT, Measurements.of([0.0, 1.0, 2.0, 4.0], np.vstack([m.z[:3], [np.nan] * 3]), SIGMA))
    np.testing.assert_allclose(sole.mode_probability[3], np.linalg.matrix_power(pi.T, 2) @ [0.5, 0.5], rtol=1e-10)
    assert np.max(np.abs(missed.mode_probability[keep] - sparse.mode_probability)) < 0.35  # two mixings are not one


@pytest.mark.parametrize("transition_", [((0.3, 0.7), (0.6, 0.4)), ((0.2, 0.8, 0.0), (0.0, 0.2, 0.8), (0.8, 0.0, 0.2))])
def test_probabilities_without_a_generator_are_refused_for_other_intervals(transition_):
    """A model that is left sooner than one interval has no continuous-time process; at its own interval it runs."""
    spec = Filter(models=(Model(),) * len(transition_), transition=transition_)
    sound(run(spec, track(0)))
    with pytest.raises(ValueError, match="cannot be spread"):
        run(spec, track(0, dt=0.7))


@pytest.mark.parametrize("padding", ["reset", "zero", "unbiased", "unbiased-cross"])
@pytest.mark.parametrize("update", ["ekf", "converted", "unbiased", "decorrelated"])
def test_every_option_tracks_the_target(padding, update):
    """All paddings and updates stay within a few sigma of the truth."""
    found = run(dataclasses.replace(EXACT, padding=padding, update=update), track(6))
    sound(found)
    error = found.state[5:, :3] - flight()[1][5:, :3]
    assert np.sqrt(np.mean(np.sum(error**2, 1))) < 110


@pytest.mark.parametrize("name", [*FILTERS])
def test_without_elevation_the_track_lives_in_the_plane(name):
    """The height stays zero, NIS has two degrees of freedom, and turning the elevation off changes no other number of a
    target at height zero.
    """
    m = track(7)
    plane = dataclasses.replace(m, z=np.column_stack([m.z[:, :2], np.full(len(m), np.nan)]))
    found = run(FILTERS[name], plane)
    assert found.planar
    np.testing.assert_array_equal(found.state[:, [2, 5]], 0.0)
    used = found.nis_dof > 0
    assert used.sum() > 50
    assert set(found.nis_dof[used]) == {2}
    truth = flight()[1]
    slant = np.linalg.norm(truth[:, :3], axis=1)
    azimuth = np.arctan2(truth[:, 1], truth[:, 0])
    error = found.state[10:, :2] - (slant[:, None] * np.column_stack([np.cos(azimuth), np.sin(azimuth)]))[10:]
    assert np.sqrt(np.mean(np.sum(error**2, 1))) < 250


def test_a_plane_filter_is_the_two_dimensional_one():
    """Against an EKF with four states, written out."""
    m = track(8)
    plane = Measurements.of(m.time_s, np.column_stack([m.z[:, :2], np.full(len(m), np.nan)]), SIGMA)
    found = run(KALMAN, plane)
    x9, p9 = three_point(m.time_s[:3], np.column_stack([m.z[:3, :2], np.zeros(3)]), SIGMA)
    pick = [0, 1, 3, 4]
    x, p = x9[pick], p9[np.ix_(pick, pick)]
    f = transition("cv", np.zeros(9), 1.0)[1][np.ix_(pick, pick)]
    q = noise_matrix("cv", 20.0, 0.0, 1.0)[np.ix_(pick, pick)]
    for k in range(3, len(m)):
        x, p = f @ x, f @ p @ f.T + q
        r = math.hypot(x[0], x[1])
        h = np.array([[x[0] / r, x[1] / r, 0, 0], [-x[1] / r**2, x[0] / r**2, 0, 0]])
        s = h @ p @ h.T + np.diag(SIGMA[:2] ** 2)
        nu = plane.z[k, :2] - [r, math.atan2(x[1], x[0])]
        gain = p @ h.T @ np.linalg.inv(s)
        x, p = x + gain @ nu, p - gain @ s @ gain.T
        np.testing.assert_allclose(found.state[k, pick], x, rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(found.covariance[k][np.ix_(pick, pick)], p, rtol=1e-7, atol=1e-6)


@pytest.mark.parametrize("name", [*FILTERS])
@pytest.mark.parametrize("plots", [0, 1, 2, 3])
def test_few_plots_give_what_they_allow(name, plots):
    """None gives nothing, one a place, two a velocity: all flagged as the start, with no innovation."""
    m = track(0)
    found = run(FILTERS[name], Measurements.of(m.time_s[:plots], m.z[:plots], SIGMA))
    assert np.all(np.isfinite(found.state))
    starting = min(plots, 2 if name == "alpha-beta" else 3)
    np.testing.assert_allclose(found.state[:starting, :3], polar.to_position(m.z[:starting]), rtol=1e-12)
    assert np.all(found.flags[:starting] & Flag.STARTING)
    assert np.all(np.isnan(found.nis[:starting]))


@pytest.mark.parametrize("name", [*FILTERS])
def test_bad_plots_are_flagged_and_spoil_nothing(name):
    """Repeated times, times backwards, no time, a plot at the radar, a gap of 40 s, all in one track."""
    m = track(1)
    time, z = m.time_s.copy(), m.z.copy()
    time[10], time[20], time[30], z[40] = time[9], time[15], np.nan, [0.0, 0.3, 0.1]
    time[45:] += 40.0
    found = run(FILTERS[name], Measurements.of(time, z, SIGMA))
    sound(found)
    assert found.flags[10] & Flag.REPEATED
    assert found.flags[20] & Flag.DISORDERED
    assert found.flags[30] & Flag.DISORDERED
    assert np.any(found.flags[40:46] & (Flag.ABSURD | Flag.BROKEN))


@pytest.mark.parametrize("name", ["kalman", "kalman-ca", "kalman-ct", "imm", "imm3"])
def test_predicted_covariances_are_symmetric_to_the_last_bit(name):
    """A difference of one bit between the triangles, carried on over many plots, would grow without bound."""
    predicted = run(FILTERS[name], track(1), detail=True).detail.predicted_covariance[3:]
    assert np.all(np.isfinite(predicted))
    np.testing.assert_array_equal(predicted, np.swapaxes(predicted, -1, -2))


@pytest.mark.parametrize("name", [*FILTERS])
def test_a_jump_is_gated_and_then_followed(name):
    """A target that jumps by 100 km is not believed for two plots; with the third the track starts anew there."""
    m = track(2)
    z = m.z.copy()
    z[12:, 0] += 100e3
    spec = dataclasses.replace(FILTERS[name], gate_probability=1 - 1e-6, restart_after=3)
    found = run(spec, Measurements.of(m.time_s, z, SIGMA))
    sound(found)
    assert np.all(found.flags[12:14] & Flag.GATED)
    assert found.flags[14] & Flag.RESTARTED
    assert found.flags[14] & Flag.STARTING
    assert np.linalg.norm(found.state[18, :3] - polar.to_position(z[18])) < 2000.0


@pytest.mark.parametrize("name", [*FILTERS])
@pytest.mark.parametrize("factor", [0.01, 100.0])
def test_noise_a_hundred_times_wrong_shows_in_the_nis(name, factor):
    """Sigmas a hundred times too small or too large: no number breaks, and the NIS says it."""
    m = track(3)
    found = run(FILTERS[name], dataclasses.replace(m, sigma=m.sigma * factor))
    sound(found)
    per_dof = np.nansum(found.nis) / max(found.nis_dof.sum(), 1)
    assert per_dof > 3 if factor < 1 else per_dof < 0.5


def test_a_pass_overhead_keeps_every_filter_whole():
    """A target that flies straight over the radar, some plots within metres of the zenith."""
    times = np.arange(0.0, 60.0)
    position = np.column_stack([-9000 + 300 * times, np.full(60, 1e-4), np.full(60, 3000.0)])
    z = polar.of_position(position)
    for name, spec in FILTERS.items():
        found = run(spec, Measurements.of(times, z, (10.0, 0.001, 0.001)))
        sound(found)
        assert np.linalg.norm(found.state[-1, :3] - position[-1]) < 500, name


def test_a_plot_at_the_zenith_gives_its_range_only():
    """When the prediction is at the zenith, azimuth and elevation are not used, and the row says so."""
    times = np.arange(0.0, 7.0)
    position = np.column_stack([-900 + 300 * times, np.zeros(7), np.full(7, 3000.0)])
    z = polar.of_position(position)
    found = run(kalman("cv", 1.0), Measurements.of(times, z, (1e-3, 1e-9, 1e-9)))
    assert found.flags[3] & Flag.OVERHEAD
    assert found.nis_dof[3] == 1
    sound(found)


def test_gains_are_the_weights_of_a_residual_along_and_across_the_line_of_sight():
    """For alpha-beta they are its own; a Kalman filter in steady motion has the alpha and beta of its tracking
    index.
    """
    steps, sigma = 400, np.array([20.0, 2e-6, 2e-6])
    times = np.arange(steps, dtype=float)
    z = np.column_stack([1e7 + 1.0 * times, np.full(steps, 0.3), np.zeros(steps)])
    m = Measurements.of(times, z, sigma)
    found = run(dataclasses.replace(kalman("cv", 2.0), noise="discrete"), m)
    kalata = run(AlphaBeta(design_acceleration_m_s2=2.0), m)
    np.testing.assert_allclose(found.gains[-1], kalata.gains[-1], rtol=1e-3)
    np.testing.assert_array_equal(run(AlphaBeta((0.5,) * 3, (0.2,) * 3), m).gains[5], [[0.5, 0.2]] * 3)


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        (Filter(transition=((0.5,),)), "sum to 1"),
        (Filter(models=(Model(), Model())), "2 x 2"),
        (Filter(models=(Model("cv", -1.0),)), "process noise is negative"),
        (Filter(models=(Model("jerk"),)), "'jerk' is none of cv, ca, ct"),
        (Filter(reference_interval_s=0.0), "above 0"),
        (Filter(gate_probability=1.5), "probability above 0"),
        (Filter(noise_scale=(1.0, 0.0, 1.0)), "noise_scale"),
        (Filter(start_probabilities=(0.5,)), "start_probabilities"),
        (AlphaBeta(alpha=(1.9,) * 3, beta=(0.5,) * 3), "not stable"),
        (AlphaBeta(alpha=(0.5,) * 3), "go together"),
    ],
)  # fmt: skip
def test_a_filter_that_cannot_be_is_refused_in_words(spec, words):
    """One line says what is wrong."""
    with pytest.raises(ValueError, match=words):
        run(spec, track(0))


def test_a_turn_model_alone_stays_observable():
    """Turn rate along the velocity shows in no motion: with the pseudo-measurement its variance stays bounded."""
    m = track(9, steps=200)
    loose = Filter(models=(Model("ct", 5.0, sigma_turn_rad_s=0.02),))
    tight = kalman("ct", 5.0)

    def along(spec):
        found = run(spec, m, detail=True)
        v = found.state[-1, 3:] / np.linalg.norm(found.state[-1, 3:])
        return math.sqrt(v @ found.detail.covariance[-1, 0, 6:, 6:] @ v)

    assert along(loose) > 0.1
    assert along(tight) < 0.03
