import numpy as np
import pytest
import sympy as sp

from rangeeval.tracking import alpha_beta as ab
from rangeeval.tracking.varying_gains import varying_gain_variances

ALPHAS = np.array([0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95])
STABLE_GAINS = [
    (0.1, 0.005),
    (0.3, 0.3),
    (0.5, 0.17),
    (0.5, 0.9),
    (0.9, 0.93),
    (1.0, 1.0),
    (1.2, 0.8),
    (1.5, 0.3),
]


@pytest.fixture(scope="module")
def symbolic():
    """Covariances of the fixed-gain filter solved from its error recursion, with any process noise."""
    a, b, t, s, q11, q12, q22 = sp.symbols("a b t s q11 q12 q22", positive=True)
    p11, p12, p22 = sp.symbols("p11 p12 p22")
    phi = sp.Matrix([[1, t], [0, 1]])
    h = sp.Matrix([[1, 0]])
    gain = sp.Matrix([a, b / t])
    keep = sp.eye(2) - gain * h
    q = sp.Matrix([[q11, q12], [q12, q22]])
    p = sp.Matrix([[p11, p12], [p12, p22]])
    after = keep * (phi * p * phi.T + q) * keep.T + gain * gain.T * s**2
    equations = [after[0, 0] - p11, after[0, 1] - p12, after[1, 1] - p22]
    solution = sp.solve(equations, [p11, p12, p22], dict=True)[0]
    p = p.subs(solution)
    predicted = phi * p * phi.T + q
    c0 = predicted[0, 0] + s**2
    innovation = predicted * h.T - gain * c0
    c1 = (h * phi * innovation)[0]
    c2 = (h * phi * keep * phi * innovation)[0]
    names = {"p": p, "pbar": predicted, "c0": c0, "c1": c1, "c2": c2}
    return (a, b, t, s, q11, q12, q22), names


@pytest.mark.parametrize(
    ("function", "entry"),
    [
        (lambda a, b, t, s: ab.residual_variance(a, b, s), lambda n: n["c0"]),
        (lambda a, b, t, s: ab.predicted_variance(a, b, s), lambda n: n["pbar"][0, 0]),
        (lambda a, b, t, s: ab.filtered_variance(a, b, s), lambda n: n["p"][0, 0]),
        (ab.position_velocity_covariance, lambda n: n["p"][0, 1]),
        (ab.velocity_variance, lambda n: n["p"][1, 1]),
        (lambda a, b, t, s: ab.q_cv(a, b), lambda n: n["p"][0, 0] / n["c0"]),
        (lambda a, b, t, s: ab.phi_cv(a, b), lambda n: n["pbar"][0, 0] / n["c0"]),
        (lambda a, b, t, s: ab.lag_one_correlation_cv(a, b), lambda n: n["c1"] / n["c0"]),
    ],
    ids=["residual", "predicted", "filtered", "covariance", "velocity", "q_cv", "phi_cv", "rho_1"],
)
def test_steady_state_closed_forms_solve_the_filters_own_covariance_equation(symbolic, function, entry):
    """Each closed form is the exact solution of the filter's covariance equation without process noise."""
    (a, b, t, s, *q), names = symbolic
    exact = entry(names).subs(dict.fromkeys(q, 0))
    for alpha, beta in STABLE_GAINS:
        values = {a: sp.Rational(str(alpha)), b: sp.Rational(str(beta)), t: sp.Rational(1, 4), s: 3}
        assert float(function(alpha, beta, 0.25, 3.0)) == pytest.approx(float(exact.subs(values)), rel=1e-12)


def test_own_autocovariance_identity_holds_for_any_process_noise(symbolic):
    """The variances follow from the residuals' autocovariance at lags 0 to 2, whatever the process noise."""
    (a, b, t, s, *q), n = symbolic
    predicted = a * n["c0"] + (2 - a - b) * n["c1"] - n["c2"]
    assert sp.simplify(predicted - n["pbar"][0, 0]) == 0
    assert sp.simplify(n["p"][0, 0] - ((1 - a) ** 2 * n["pbar"][0, 0] + a**2 * s**2)) == 0
    values = {a: sp.Rational(3, 10), b: sp.Rational(1, 5), t: 2, s: 5, q[0]: 7, q[1]: 1, q[2]: 3}
    c = [float(n[name].subs(values)) for name in ("c0", "c1", "c2")]
    own = ab.variances_from_autocovariance(*c, 0.3, 0.2)
    assert own.predicted == pytest.approx(float(n["pbar"][0, 0].subs(values)), rel=1e-12)
    assert own.measurement == pytest.approx(25.0, rel=1e-12)
    assert own.filtered == pytest.approx(float(n["p"][0, 0].subs(values)), rel=1e-12)


def test_velocity_covariances_scale_with_the_update_interval():
    """Halving the interval doubles cov(position, velocity) and quadruples var(velocity)."""
    gains = (0.4, 0.1)
    for t in (0.1, 2.0):
        filtered, _ = ab.steady_state_covariance(*gains, interval_s=t, sigma_v=3.0)
        assert ab.position_velocity_covariance(*gains, t, 3.0) == pytest.approx(filtered[0, 1], rel=1e-12)
        assert ab.velocity_variance(*gains, t, 3.0) == pytest.approx(filtered[1, 1], rel=1e-12)


def test_steady_state_is_the_limit_of_the_recursion_with_process_noise():
    """The Lyapunov solution equals what the covariance recursion settles to, in units with T not 1."""
    t, sigma_v, sigma_a, alpha, beta = 0.5, 10.0, 8.0, 0.45, 0.2
    phi = np.array([[1, t], [0, 1]])
    keep = np.eye(2) - np.outer([alpha, beta / t], [1, 0])
    q = sigma_a**2 * np.array([[t**4 / 4, t**3 / 2], [t**3 / 2, t**2]])
    gain = np.outer([alpha, beta / t], [alpha, beta / t]) * sigma_v**2
    p = np.eye(2)
    for _ in range(400):
        p = keep @ (phi @ p @ phi.T + q) @ keep.T + gain
    filtered, predicted = ab.steady_state_covariance(alpha, beta, interval_s=t, sigma_v=sigma_v, sigma_a=sigma_a)
    np.testing.assert_allclose(filtered, p, rtol=1e-11)
    np.testing.assert_allclose(predicted, phi @ p @ phi.T + q, rtol=1e-11)


def test_stability_is_poles_inside_the_unit_circle():
    """Gains are stable exactly where both poles of the filter lie inside the unit circle."""
    rng = np.random.default_rng(1)
    alpha, beta = rng.uniform(-0.5, 2.5, 2000), rng.uniform(-0.5, 4.5, 2000)
    largest = [np.abs(np.roots([1, a + b - 2, 1 - a])).max() for a, b in zip(alpha, beta, strict=True)]
    np.testing.assert_array_equal(ab.is_stable(alpha, beta), np.array(largest) < 1)
    assert not ab.is_stable(np.nan, 0.1)
    assert not ab.is_stable(0.0, 0.0)


def test_unstable_gains_have_no_variance():
    """Outside the stability triangle every variance and ratio is missing, not negative."""
    for function in (ab.residual_variance, ab.filtered_variance, ab.q_cv, ab.phi_cv):
        assert np.isnan(function(1.8, 0.6))
        assert np.isnan(function(0.0, 0.0))
    assert np.isnan(ab.residual_autocovariance(1.8, 0.6, 3)).all()
    np.testing.assert_array_equal(ab.usable([1.0, np.nan, 1.0], [0.4, 0.4, 1.8], [0.1, 0.1, 0.6]), [1, 0, 0])


def test_gains_of_the_tracking_index_are_the_kalman_gains():
    """The gains equal those the Riccati recursion settles to for the same manoeuvre and noise."""
    t, sigma_v, sigma_a = 0.5, 12.0, 9.0
    q = sigma_a**2 * np.array([[t**4 / 4, t**3 / 2], [t**3 / 2, t**2]])
    phi = np.array([[1, t], [0, 1]])
    p = np.eye(2)
    for _ in range(2000):
        predicted = phi @ p @ phi.T + q
        k = predicted[:, 0] / (predicted[0, 0] + sigma_v**2)
        p = predicted - np.outer(k, predicted[0])
    alpha, beta = ab.gains_from_tracking_index(sigma_a * t**2 / sigma_v)
    assert (alpha, beta) == (pytest.approx(k[0], rel=1e-11), pytest.approx(k[1] * t, rel=1e-11))


@pytest.mark.parametrize("index", [1e-14, 1e-6, 0.01, 1.0, 30.0, 1e8])
def test_gains_keep_their_digits_at_any_tracking_index(index):
    """Gains agree with 60-digit arithmetic to 14 digits from tiny to huge indices, and lead back to the
    index.
    """
    lam = sp.Float(repr(index), 60)
    s = (4 + lam - sp.sqrt(8 * lam + lam**2)) / 4
    alpha, beta = ab.gains_from_tracking_index(index)
    assert alpha == pytest.approx(float(1 - s**2), rel=1e-14)
    assert beta == pytest.approx(float(2 * (1 - s) ** 2), rel=1e-14)
    if index < 1e4:
        assert ab.tracking_index(alpha, beta) == pytest.approx(index, rel=1e-9)
        assert ab.beta_from_alpha(alpha) == pytest.approx(beta, rel=1e-8)


def test_no_manoeuvre_means_no_gain():
    """Index zero gives zero gains; a negative one gives none."""
    assert ab.gains_from_tracking_index(0.0) == (0.0, 0.0)
    assert np.isnan(ab.gains_from_tracking_index(-1.0)[0])


def test_constant_velocity_ratio_is_wrong_by_the_printed_factor_when_the_target_manoeuvres_as_designed():
    """With the design manoeuvre, sigma from q_cv over the true sigma is 0.875 at alpha 0.05 up to 1.626 at
    0.95.
    """
    printed = [0.875, 0.885, 0.907, 0.933, 0.963, 1, 1.047, 1.112, 1.210, 1.400, 1.626]
    beta = ab.beta_from_alpha(ALPHAS)
    for alpha, b, ratio in zip(ALPHAS, beta, printed, strict=True):
        sigma_a = float(ab.tracking_index(alpha, b))
        filtered = ab.steady_state_covariance(alpha, float(b), sigma_a=sigma_a)[0][0, 0]
        residual = ab.residual_autocovariance(alpha, float(b), 0, sigma_a=sigma_a)[0]
        assert np.sqrt(ab.q_cv(alpha, b) * residual / filtered) == pytest.approx(ratio, abs=6e-4)
        assert ab.q_white(alpha) * residual == pytest.approx(filtered, rel=1e-9)


def test_cautious_ratio_is_the_larger_one():
    """The ratio for judging a requirement is never below either of the two."""
    beta = ab.beta_from_alpha(ALPHAS)
    expected = np.maximum(ab.q_cv(ALPHAS, beta), ab.q_white(ALPHAS))
    np.testing.assert_array_equal(ab.q_cautious(ALPHAS, beta), expected)
    assert ab.q_cautious(1.2, 0.8) == ab.q_cv(1.2, 0.8)


@pytest.mark.parametrize("sigma_a", [0.0, 0.1, 1.0, 20.0])
@pytest.mark.parametrize(("alpha", "beta"), STABLE_GAINS)
def test_ratio_follows_from_the_predictions_share_and_stays_in_the_bracket(alpha, beta, sigma_a):
    """q = alpha^2 + (1 - 2 alpha) phi for any manoeuvre, so sigma lies in the bracket that needs no model."""
    filtered, predicted = ab.steady_state_covariance(alpha, beta, sigma_a=sigma_a)
    residual = predicted[0, 0] + 1
    q = filtered[0, 0] / residual
    assert ab.q_from_phi(alpha, predicted[0, 0] / residual) == pytest.approx(q, rel=1e-10)
    low, high = ab.bracket_factors(alpha)
    assert low - 1e-9 <= np.sqrt(q) <= high + 1e-9
    assert sorted([low**2, high**2]) == pytest.approx(sorted([ab.q_from_phi(alpha, 0), ab.q_from_phi(alpha, 1)]))


def test_alpha_one_half_gives_one_quarter_whatever_else():
    """At alpha 1/2 sigma of the estimate is half that of the residual, for any beta and any motion."""
    np.testing.assert_allclose(ab.q_cv(0.5, np.linspace(0.01, 2.9, 30)), 0.25, rtol=1e-14)
    np.testing.assert_allclose(ab.q_from_phi(0.5, np.linspace(0, 1, 11)), 0.25)


def test_residuals_are_white_only_with_optimal_gains():
    """The theoretical autocorrelation vanishes at the design manoeuvre, is negative below it, positive
    above.
    """
    alpha, beta = 0.3, float(ab.beta_from_alpha(0.3))
    design = float(ab.tracking_index(alpha, beta))
    rho = [ab.residual_autocovariance(alpha, beta, 12, sigma_a=k * design) for k in (0, 1, 3)]
    assert rho[0][1] / rho[0][0] == pytest.approx(ab.lag_one_correlation_cv(alpha, beta), rel=1e-10)
    assert np.abs(rho[1][1:] / rho[1][0]).max() < 1e-12
    assert rho[2][1] > 0.2 * rho[2][0]


def test_theoretical_autocovariance_is_that_of_simulated_residuals():
    """Residuals of a simulated filter have the autocovariance that theory gives, with T not 1."""
    alpha, beta, t, sigma_v, sigma_a = 0.4, 0.3, 0.5, 2.0, 12.0
    rng = np.random.default_rng(5)
    tracks, updates = 4000, 90
    x, v, xh, vh = (np.zeros(tracks) for _ in range(4))
    residuals = np.empty((updates, tracks))
    for k in range(updates):
        a = sigma_a * rng.standard_normal(tracks)
        x, v = x + v * t + a * t**2 / 2, v + a * t
        xb = xh + t * vh
        residuals[k] = x + sigma_v * rng.standard_normal(tracks) - xb
        xh, vh = xb + alpha * residuals[k], vh + beta / t * residuals[k]
    settled = residuals[40:]
    c = ab.residual_autocovariance(alpha, beta, 4, interval_s=t, sigma_v=sigma_v, sigma_a=sigma_a)
    for lag in range(5):
        measured = np.mean(settled[lag:] * settled[: len(settled) - lag])
        assert measured == pytest.approx(c[lag], abs=0.015 * c[0])


def test_steady_acceleration_leaves_the_printed_lag():
    """A noise-free filter behind an accelerating target settles to the closed-form residual and errors."""
    alpha, beta, t, a = 0.4, 0.15, 0.5, 20.0
    xh = vh = 0.0
    for k in range(1, 400):
        x, v = a * (k * t) ** 2 / 2, a * k * t
        residual = x - (xh + t * vh)
        xh, vh = xh + t * vh + alpha * residual, vh + beta / t * residual
    assert residual == pytest.approx(ab.residual_mean_under_acceleration(a, beta, t), rel=1e-8)
    assert xh - x == pytest.approx(ab.filtered_bias_under_acceleration(a, alpha, beta, t), rel=1e-8)
    assert vh - v == pytest.approx(ab.velocity_bias_under_acceleration(a, alpha, beta, t), rel=1e-8)
    assert ab.rms_with_lag(3.0, residual, alpha) == pytest.approx(np.hypot(3.0, xh - x), rel=1e-8)


def test_startup_length_reaches_the_steady_state():
    """After ceil(11 / alpha) updates from a two-point start sigma is within 1 %, and so it stays."""
    assert ab.startup_length([0.1, 0.2, 0.3, 0.5, 0.7]).tolist() == [110, 55, 37, 22, 16]
    assert ab.startup_length([0.0, -1.0, np.nan]).tolist() == [0, 0, 0]
    for alpha in (0.1, 0.2, 0.3, 0.5, 0.7):
        beta = float(ab.beta_from_alpha(alpha))
        n = int(ab.startup_length(alpha))
        run = varying_gain_variances(np.full(600, alpha), np.full(600, beta))
        off = np.abs(np.sqrt(run.filtered / ab.filtered_variance(alpha, beta)) - 1)
        assert off[n:].max() < 0.01
        assert off[: n // 3].max() > 0.01


def test_updates_until_settled_match_the_printed_table():
    """Sigma settles within 10/5/1 % after 97/102/108 updates at alpha 0.1, down to 1/2/3 at alpha 0.7."""
    printed = {0.1: (97, 102, 108), 0.2: (25, 39, 46), 0.3: (14, 14, 25), 0.5: (5, 6, 7), 0.7: (1, 2, 3)}
    for alpha, counts in printed.items():
        beta = float(ab.beta_from_alpha(alpha))
        run = varying_gain_variances(np.full(400, alpha), np.full(400, beta))
        off = np.abs(np.sqrt(run.filtered / ab.filtered_variance(alpha, beta)) - 1)
        settled = tuple(int(np.flatnonzero(off > tolerance).max(initial=-1)) + 1 for tolerance in (0.1, 0.05, 0.01))
        assert settled == counts, alpha


def test_samples_to_tell_regimes_match_the_printed_ones():
    """Telling noise only from fitting gains takes about 2300, 870, 220, 73 residuals at alpha 0.2 to 0.7."""
    alpha = np.array([0.2, 0.3, 0.5, 0.7])
    needed = ab.samples_to_tell_regimes(alpha, ab.beta_from_alpha(alpha))
    np.testing.assert_allclose(needed, [2300, 870, 220, 73], rtol=0.015)


def test_functions_keep_the_shape_of_their_arrays():
    """Arrays broadcast, and a million gains give a million ratios."""
    alpha = np.random.default_rng(0).uniform(0.05, 0.95, 1_000_000)
    assert ab.q_cv(alpha, ab.beta_from_alpha(alpha)).shape == alpha.shape
    assert ab.q_cv(alpha[:6].reshape(2, 3), 0.1).shape == (2, 3)
    assert np.ndim(ab.q_cv(0.3, 0.1)) == 0
