import numpy as np
import pytest

from rangeeval.stats import variance as va
from rangeeval.stats.moments import moments, weighted_moments
from rangeeval.tracking import alpha_beta as ab

E = np.array([3.0, -4.0, 5.0, 0.0])


def test_three_modes_differ_as_they_say():
    """Paper keeps the mean with N - 1, zero_mean divides by N, mean_removed is the ordinary sample sigma."""
    m = moments(E)
    assert va.residual_sigma(m.n, m.mean, m.m2, "paper")[0] == pytest.approx(np.sqrt(50 / 3))
    assert va.residual_sigma(m.n, m.mean, m.m2, "zero_mean")[0] == pytest.approx(np.sqrt(50 / 4))
    assert va.residual_sigma(m.n, m.mean, m.m2, "mean_removed")[0] == pytest.approx(E.std(ddof=1))
    with pytest.raises(ValueError, match="mode is 'mean'"):
        va.residual_sigma(4, 1, 1, "mean")  # type: ignore[arg-type]


@pytest.mark.parametrize("mode", ["paper", "zero_mean", "mean_removed"])
def test_fewer_than_two_samples_have_no_sigma(mode):
    """One sample or none gives a missing sigma, never zero and never an error."""
    for e in ([], [3.0], [np.nan, 2.0]):
        t = va.track_sigma(e, 0.4, 0.1, ab.q_cv, mode=mode)
        assert np.isnan([t.sigma_residual, t.q, t.sigma, t.sigma_per_sample]).all()
    assert (t.n, t.n_dropped, t.mean) == (1, 1, 2.0)


@pytest.mark.parametrize("mode", ["paper", "zero_mean", "mean_removed"])
def test_expected_variance_is_what_many_correlated_samples_average(mode):
    """Over many bins of coloured residuals the mean variance is the stated multiple of the true one."""
    n, alpha, beta = 8, 0.5, 0.17
    c = ab.residual_autocovariance(alpha, beta, n - 1)
    covariance = c[np.abs(np.subtract.outer(np.arange(n), np.arange(n)))]
    x = np.random.default_rng(1).standard_normal((200_000, n)) @ np.linalg.cholesky(covariance).T
    k = np.arange(1, n)
    vif = 1 + 2 * np.sum((1 - k / n) * c[1:] / c[0])
    group = np.repeat(np.arange(len(x)), n)
    m = moments(x.ravel(), group, len(x))
    mean_variance = np.mean(va.residual_sigma(m.n, m.mean, m.m2, mode) ** 2) / c[0]
    assert mean_variance == pytest.approx(va.expected_variance_ratio(n, mode, vif), rel=5e-3)


def test_small_sample_sigma_is_low_by_c4():
    """The mean of sigma estimates over the true one is c4: 0.798, 0.940, 0.973, 0.991 at nu 1, 4, 9, 29."""
    nu = np.array([1, 4, 9, 29])
    np.testing.assert_allclose(va.c4(nu), [0.798, 0.940, 0.973, 0.991], atol=6e-4)
    x = np.random.default_rng(2).standard_normal((100_000, 5))
    assert x.std(axis=1, ddof=1).mean() == pytest.approx(va.c4(4), rel=3e-3)
    assert va.c4(1e6) == pytest.approx(1 - 1 / 4e6, abs=1e-8)
    assert np.isnan(va.c4(0))


def balanced(alpha, sigma_v=1.0):
    """Residuals of exactly the quasi-steady variance at each gain, once with each sign; and the true
    sigma.
    """
    beta = ab.beta_from_alpha(alpha)
    size = np.sqrt(ab.residual_variance(alpha, beta, sigma_v))
    truth = np.sqrt(np.mean(ab.filtered_variance(alpha, beta, sigma_v)))
    return np.concatenate([size, -size]), np.tile(alpha, 2), np.tile(beta, 2), truth


@pytest.mark.parametrize(
    ("alpha", "printed"),
    [
        (np.linspace(0.45, 0.55, 4001), 1.001),
        (np.linspace(0.4, 0.6, 4001), 1.003),
        (np.linspace(0.3, 0.7, 4001), 1.012),
        (np.linspace(0.2, 0.8, 4001), 1.031),
        (np.linspace(0.1, 0.9, 4001), 1.069),
        (np.array([0.4, 0.6]), 1.009),
        (np.array([0.3, 0.7]), 1.038),
        (np.array([0.2, 0.8]), 1.102),
        (np.array([0.1, 0.9]), 1.262),
    ],
)
def test_ratio_of_each_sample_stays_right_where_mean_gains_do_not(alpha, printed):
    """Mean gains overstate sigma by the printed factor, up to 1.262 with switching gains; per-sample ratios
    do not.
    """
    e, a, b, truth = balanced(alpha)
    t = va.track_sigma(e, a, b, ab.q_cv, mode="zero_mean")
    assert t.sigma / truth == pytest.approx(printed, abs=6e-4)
    assert t.sigma_per_sample == pytest.approx(truth, rel=1e-12)
    assert va.relative_difference(t.sigma, t.sigma_per_sample) == pytest.approx(printed - 1, abs=6e-4)


def test_adaptive_gains_mislead_mean_gains_most():
    """With alpha 0.2 to 0.8 that follows the noise, mean gains overstate sigma by about 23 %."""
    alpha = np.linspace(0.2, 0.8, 4001)
    sigma_v = 1 / ab.tracking_index(alpha, ab.beta_from_alpha(alpha))
    e, a, b, truth = balanced(alpha, sigma_v)
    t = va.track_sigma(e, a, b, ab.q_cv, mode="zero_mean")
    assert t.sigma / truth == pytest.approx(1.23, abs=0.01)
    assert t.sigma_per_sample == pytest.approx(truth, rel=1e-12)


@pytest.mark.parametrize(
    ("centre_km", "printed"),
    [
        (7.5, (0.936, 0.976)),
        (12.5, (0.975, 1.002)),
        (22.5, (0.993, 1.004)),
        (42.5, (0.993, 1.004)),
        (82.5, (0.993, 1.004)),
    ],
)
@pytest.mark.parametrize("sigma_at_80_km", [3.0, 7.07, 20.0, 60.0])
def test_a_wide_bin_near_the_radar_mixes_gains(centre_km, printed, sigma_at_80_km):
    """In a 5 km bin with SNR falling as R^-4 mean gains are within 0.7 % beyond 20 km, and up to 6 % low at 7.5 km."""
    r = np.linspace(centre_km - 2.5, centre_km + 2.5, 2001)
    sigma_v = sigma_at_80_km * (r / 80) ** 2
    alpha, _ = ab.gains_from_tracking_index(5.0 * 0.5**2 / sigma_v)
    e, a, b, truth = balanced(alpha, sigma_v)
    t = va.track_sigma(e, a, b, ab.q_cv, mode="zero_mean")
    assert printed[0] - 6e-4 <= t.sigma / truth <= printed[1] + 6e-4
    assert t.sigma_per_sample == pytest.approx(truth, rel=1e-12)


def test_sums_of_chunks_give_the_same_sigma_as_the_whole_bin():
    """Sigma from merged sums equals sigma from the raw samples, in every mode and with both forms of the
    ratio.
    """
    rng = np.random.default_rng(7)
    e = 5 + 20 * rng.standard_normal(500)
    a = rng.uniform(0.2, 0.8, e.size)
    b = ab.beta_from_alpha(a)
    for mode in ("paper", "zero_mean", "mean_removed"):
        whole = va.track_sigma(e, a, b, ab.q_cautious, mode=mode)
        m, w = moments(e[:100]), weighted_moments(e[:100], ab.q_cautious(a[:100], b[:100]))
        m, w = m.merge(moments(e[100:])), w.merge(weighted_moments(e[100:], ab.q_cautious(a[100:], b[100:])))
        assert va.residual_sigma(m.n, m.mean, m.m2, mode)[0] == pytest.approx(whole.sigma_residual, rel=1e-12)
        assert va.weighted_sigma(m.n, m.mean, w, mode)[0] == pytest.approx(whole.sigma_per_sample, rel=1e-12)
        q = ab.q_cautious(a, b)
        centre = e.mean() if mode == "mean_removed" else 0
        divisor = e.size if mode == "zero_mean" else e.size - 1
        by_hand = np.sqrt(np.sum(q * (e - centre) ** 2) / divisor)
        assert whole.sigma_per_sample == pytest.approx(by_hand, rel=1e-12)


def test_unusable_samples_are_dropped_and_counted():
    """Samples without a residual, with missing or with unstable gains do not enter, and their number is
    given.
    """
    e = np.array([3.0, np.nan, -4.0, 9.0, 9.0, 9.0])
    a = np.array([0.5, 0.5, 0.5, np.nan, 0.0, 1.8])
    b = np.array([0.2, 0.2, 0.2, 0.2, 0.0, 0.6])
    t = va.track_sigma(e, a, b, ab.q_cv, used=ab.usable(e, a, b), mode="paper")
    assert (t.n, t.n_dropped, t.mean) == (2, 4, -0.5)
    assert (t.sigma_residual, t.sigma) == (pytest.approx(5.0), pytest.approx(2.5))
    assert (t.alpha_mean, t.beta_mean) == (0.5, 0.2)


def test_angle_sigma_is_the_cross_range_sigma_seen_from_the_radar():
    """At 60 degrees off boresight and 10 km, 5 m across make 1 mrad; the mean predictions decide."""
    r, z = 10_000.0, 10_000.0 * np.sin(np.pi / 3)
    e = np.tile([10.0, -10.0], 50)
    g = va.angle_sigma(e, 0.5, 0.2, np.full(100, r), np.full(100, z), ab.q_cv, mode="zero_mean")
    assert g.sigma_rad == pytest.approx(1e-3, rel=1e-12)
    assert g.sigma_per_sample_rad == pytest.approx(1e-3, rel=1e-12)
    assert (g.flag, g.range_mean_m, g.cross_range_mean_m) == ("ok", r, pytest.approx(z))
    assert g.cross_range.sigma == pytest.approx(5.0)


def test_angle_sigma_uses_squares_of_means_and_per_sample_uses_each_range():
    """The printed form divides by E[R]^2 - E[y]^2; the per-sample form gives the truth when R varies in the
    bin.
    """
    r = np.repeat([20_000.0, 40_000.0], 2)
    y = np.repeat([6_000.0, -2_000.0], 2)
    theta = 1e-3 * np.array([1, -1, 1, -1])
    e = theta * np.sqrt(r**2 - y**2)
    g = va.angle_sigma(e, 0.5, 0.2, r, y, ab.q_cv, mode="zero_mean")
    assert g.sigma_per_sample_rad == pytest.approx(0.5e-3, rel=1e-12)
    assert g.sigma_rad == pytest.approx(0.5 * np.sqrt(np.mean(e**2)) / np.sqrt(30e3**2 - 2e3**2), rel=1e-12)


def test_impossible_or_grazing_geometry_is_flagged():
    """Cross-range beyond the range gives no sigma, a cosine below 0.1 a warning, one sample too few."""

    def flag(z, n=10):
        g = va.angle_sigma(np.resize([1.0, -1.0], n), 0.4, 0.1, np.full(n, 1e4), np.full(n, z), ab.q_cv, mode="paper")
        return g.flag, np.isnan(g.sigma_rad)

    assert flag(1e4 * np.sqrt(0.98)) == ("ok", False)
    assert flag(1e4 * np.sqrt(0.995)) == ("grazing", False)
    assert flag(1.2e4) == ("invalid", True)
    assert flag(-1e4) == ("invalid", True)
    assert flag(0.0, 1) == ("too_few", True)
    assert va.angle_sigma([], [], [], [], [], ab.q_cv).flag == "too_few"


def test_samples_without_a_prediction_leave_the_angle_only():
    """An angle sample needs its predictions as well: without them it is dropped."""
    g = va.angle_sigma([1.0, -1, 1], 0.4, 0.1, [1e4, 1e4, np.nan], [0.0, 0, 0], ab.q_cv)
    assert (g.cross_range.n, g.cross_range.n_dropped) == (2, 1)


def test_range_leak_compares_range_noise_with_the_angle_sigma():
    """At 45 degrees the leak is sigma_R / (R sigma_theta), and the bound adds both in quadrature."""
    z = 1e4 / np.sqrt(2)
    assert va.range_leak(3.0, 1e-3, 1e4, z) == pytest.approx(0.3)
    bound = va.angle_sigma_with_range_noise(4.0, 3.0 * np.sqrt(2), 1e4, z)
    assert bound == pytest.approx(5.0 / z, rel=1e-12)
