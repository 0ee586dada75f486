import numpy as np
import pytest

from rangeeval.stats import correlation as co
from rangeeval.stats import intervals as iv
from rangeeval.stats.diagnostics import mean_t_test
from rangeeval.tracking import alpha_beta as ab

ALPHAS = (0.1, 0.2, 0.3, 0.5, 0.7, 0.9)


def theory(alpha, times_design, n):
    """Theoretical variance and autocorrelation (lags 0 to n - 1) of residuals with optimal gains."""
    beta = float(ab.beta_from_alpha(alpha))
    design = float(ab.tracking_index(alpha, beta))
    c = ab.residual_autocovariance(alpha, beta, n - 1, sigma_a=times_design * design)
    return c[0], c / c[0]


def residuals(alpha, times_design, n, bins, seed):
    """Residuals (bins x n) of a simulated, settled alpha-beta filter."""
    beta = float(ab.beta_from_alpha(alpha))
    sigma_a = times_design * float(ab.tracking_index(alpha, beta))
    rng = np.random.default_rng(seed)
    settle = int(ab.startup_length(alpha))
    x, v, xh, vh = (np.zeros(bins) for _ in range(4))
    out = np.empty((n, bins))
    for k in range(-settle, n):
        a = sigma_a * rng.standard_normal(bins)
        x, v = x + v + a / 2, v + a
        xb = xh + vh
        e = x + rng.standard_normal(bins) - xb
        xh, vh = xb + alpha * e, vh + beta * e
        if k >= 0:
            out[k] = e
    return out.T


def coverage(x, variance, nu):
    """Share of 95 % intervals of sigma that hold the true one."""
    low, high = iv.sigma_interval(x.std(axis=1, ddof=1), nu)
    return np.mean((low**2 < variance) & (high**2 > variance))


@pytest.mark.parametrize(
    ("times_design", "printed"),
    [
        (0, [0.98, 0.96, 0.94, 0.87, 0.78, 0.60]),
        (1, [1, 1, 1, 1, 1, 1]),
        (3, [0.57, 0.47, 0.45, 0.47, 0.56, 0.73]),
    ],
)
def test_effective_samples_match_the_printed_table(times_design, printed):
    """Of 100 residuals the printed share is effective: noise only, optimal gains, three times the
    manoeuvre.
    """
    share = [co.effective_samples(theory(a, times_design, 100)[1], 100) / 100 for a in ALPHAS]
    np.testing.assert_allclose(share, printed, atol=6e-3)


def test_variance_inflation_matches_the_printed_table():
    """The mean of 100 residuals is far better known than white ones at constant velocity, worse in
    manoeuvre.
    """
    quiet = [co.variance_inflation(theory(a, 0, 100)[1], 100) for a in ALPHAS]
    lively = [co.variance_inflation(theory(a, 3, 100)[1], 100) for a in ALPHAS]
    np.testing.assert_allclose(quiet, [0.10, 0.05, 0.03, 0.02, 0.01, 0.007], atol=6e-3)
    np.testing.assert_allclose(lively, [6.8, 6.0, 5.1, 3.7, 2.7, 1.7], atol=0.06)


@pytest.mark.parametrize(("alpha", "times_design"), [(0.3, 0), (0.5, 1), (0.3, 3), (0.9, 0)])
def test_interval_with_effective_samples_covers_as_promised(alpha, times_design):
    """Over 4000 bins of 100 correlated residuals the 95 % interval with the theoretical n_eff covers 93 to 97
    %.
    """
    x = residuals(alpha, times_design, 100, 4000, 11)
    variance, rho = theory(alpha, times_design, 100)
    assert x.var() == pytest.approx(variance, rel=0.02)
    assert 0.93 < coverage(x, variance, iv.degrees_of_freedom(co.effective_samples(rho, 100))) < 0.97


def test_counting_every_correlated_sample_covers_too_little():
    """With three times the design manoeuvre the interval that counts all samples covers under 85 %."""
    x = residuals(0.3, 3, 100, 4000, 12)
    assert coverage(x, theory(0.3, 3, 100)[0], iv.degrees_of_freedom(100)) < 0.85


@pytest.mark.parametrize(("alpha", "times_design"), [(0.3, 0), (0.3, 1), (0.3, 3)])
def test_interval_with_estimated_effective_samples_covers(alpha, times_design):
    """With n_eff estimated from the bin's own 100 samples a 95 % interval still covers 92 to 99 %."""
    x = residuals(alpha, times_design, 100, 1500, 13)
    nu = iv.degrees_of_freedom([co.effective_samples_of(row) for row in x])
    assert 0.92 < coverage(x, theory(alpha, times_design, 100)[0], nu) < 0.99


@pytest.mark.slow
@pytest.mark.parametrize("n", [30, 100, 400])
def test_estimated_effective_samples_fall_short_only_far_beyond_the_design(n):
    """Six times the design manoeuvre leaves 0.79/0.88/0.94 of the promised 0.95, and 0.65/0.58/0.58 if all
    count.
    """
    x = residuals(0.3, 6, n, 6000, 14)
    variance = theory(0.3, 6, n)[0]
    nu = iv.degrees_of_freedom([co.effective_samples_of(row) for row in x])
    printed = {30: (0.79, 0.65), 100: (0.88, 0.58), 400: (0.94, 0.58)}[n]
    assert coverage(x, variance, nu) == pytest.approx(printed[0], abs=0.05)
    assert coverage(x, variance, iv.degrees_of_freedom(n)) == pytest.approx(printed[1], abs=0.09)


@pytest.mark.slow
@pytest.mark.parametrize("times_design", [0, 1, 3])
@pytest.mark.parametrize("alpha", ALPHAS)
def test_interval_covers_in_every_regime(alpha, times_design):
    """From 20000 bins each, theoretical n_eff covers 94.3 to 96.3 %; with the mean removed up to 97.5 % in
    manoeuvre.
    """
    x = residuals(alpha, times_design, 100, 20_000, 15)
    variance, rho = theory(alpha, times_design, 100)
    n_eff = co.effective_samples(rho, 100)
    low, high = iv.sigma_interval(np.sqrt(np.mean(x**2, axis=1)), n_eff)
    assert 0.943 < np.mean((low**2 < variance) & (high**2 > variance)) < 0.963
    # Removing the mean of samples with long memory (alpha 0.1, 3 x design: 0.971) errs to the safe side.
    assert 0.943 < coverage(x, variance, iv.degrees_of_freedom(n_eff)) < (0.975 if times_design == 3 else 0.957)


@pytest.mark.parametrize("times_design", [0, 3])
def test_mean_test_with_inflation_rejects_five_percent(times_design):
    """With the variance inflation 4 to 6 % are rejected; naively 0 % (noise only) or over 30 % (3 x
    design).
    """
    x = residuals(0.3, times_design, 100, 4000, 16)
    vif = co.variance_inflation(theory(0.3, times_design, 100)[1], 100)
    s = np.sqrt(theory(0.3, times_design, 100)[0])
    reject = [np.mean([mean_t_test(100, m, s, v).p_value < 0.05 for m in x.mean(axis=1)]) for v in (vif, 1.0)]
    assert 0.035 < reject[0] < 0.06
    assert reject[1] < 0.001 if times_design == 0 else reject[1] > 0.3


def test_autocorrelation_has_divisor_n():
    """Lag products are divided by N at every lag, with the mean removed."""
    x = np.array([1.0, 4.0, 2.0, 7.0, 6.0])
    d = x - 4
    np.testing.assert_allclose(co.autocorrelation(x, 2), [1, d[1:] @ d[:-1] / (d @ d), d[2:] @ d[:-2] / (d @ d)])
    assert np.isnan(co.autocorrelation([3.0, 3.0, 3.0], 1)).all()


def test_stretches_are_pooled_without_pairs_across_their_ends():
    """Pooled sums use pairs within stretches only, the common mean, and equal the sums of merged parts."""
    rng = np.random.default_rng(17)
    parts = [1e5 + rng.standard_normal(n).cumsum() for n in (40, 3, 25)]
    x, mark = np.concatenate(parts), np.repeat([0, 1, 2], [40, 3, 25])
    pooled = co.lag_sums(x, 5, mark, origin=1e5)
    merged = co.lag_sums(parts[0], 5, origin=1e5)
    for part in parts[1:]:
        merged = merged.merge(co.lag_sums(part, 5, origin=1e5))
    d = [p - x.mean() for p in parts]
    by_hand = [sum(p[k:] @ p[: len(p) - k] for p in d if len(p) > k) / 68 for k in range(6)]
    for sums in (pooled, merged):
        np.testing.assert_allclose(sums.autocovariance(), by_hand, rtol=1e-9)
        assert (sums.n, sums.longest) == (68, 40)
        np.testing.assert_array_equal(sums.pairs, [68, 65, 62, 59, 57, 55])
    with pytest.raises(ValueError, match="make both alike"):
        merged.merge(co.lag_sums(x, 4, origin=1e5))


def test_a_gap_keeps_its_place_and_counts_nowhere():
    """A missing sample separates its neighbours by two lags, not one."""
    sums = co.lag_sums([1.0, np.nan, 3.0, 2.0], 2)
    np.testing.assert_array_equal(sums.pairs, [3, 1, 1])
    np.testing.assert_array_equal(sums.products, [14, 6, 3])
    assert np.isnan(co.lag_sums([], 2).mean)


def test_pooled_effective_samples_agree_with_one_long_stretch():
    """Ten stretches of 100 tell the same n_eff as theory for such stretches, within 10 %."""
    x = residuals(0.3, 3, 100, 200, 18)
    n_eff = co.effective_samples_of(x.ravel(), np.repeat(np.arange(200), 100))
    assert n_eff / x.size == pytest.approx(co.effective_samples(theory(0.3, 3, 100)[1], 100) / 100, rel=0.1)


def test_number_of_lags_follows_the_rule():
    """floor(min(10 log10 n, n / 4, longest - 1)): 20 at 100, 7 at 30, 0 below 4; short stretches tell their own lags."""
    assert [co.default_lags(n) for n in (0, 3, 30, 100, 1000)] == [0, 0, 7, 20, 30]
    assert co.default_lags(1000, 20) == 19
    assert co.default_lags(1000, 1) == 0


def test_ljung_box_rejects_as_often_as_promised():
    """White residuals are called coloured 5 % of the time, residuals at constant velocity nearly always at n
    1000.
    """
    x = residuals(0.5, 1, 200, 2000, 19)
    p = [co.ljung_box(co.autocorrelation(row, 10), 200).p_value for row in x]
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.015)
    coloured = residuals(0.5, 0, 1000, 50, 20)
    assert all(co.ljung_box(co.autocorrelation(row, 10), 1000).p_value < 0.01 for row in coloured)
    assert np.isnan(co.ljung_box([1.0], 1).p_value)


def test_ljung_box_is_the_printed_sum():
    """Q = N (N+2) sum r_k^2 / (N-k); with two stretches the pairs replace N - k."""
    rho = np.array([1.0, 0.3, -0.2])
    expected = 20 * 22 * (0.09 / 19 + 0.04 / 18)
    assert co.ljung_box(rho, 20, 2).statistic == pytest.approx(expected)
    pooled = co.ljung_box(rho, 20, 2, pairs=[20, 18, 16])
    assert pooled.statistic == pytest.approx(20 * 22 * (0.09 / 18 + 0.04 / 16))
    assert pooled.p_value == pytest.approx(np.exp(-pooled.statistic / 2))


def test_variance_of_the_mean_is_found_from_correlated_data():
    """Newey-West and batch means find the scatter of the mean of 1000 samples with memory within 10 and
    15 %.
    """
    x = residuals(0.5, 3, 1000, 400, 21)
    c0, rho = theory(0.5, 3, 1000)
    truth = c0 * co.variance_inflation(rho, 1000) / 1000
    assert x.mean(axis=1).var() == pytest.approx(truth, rel=0.2)
    assert np.mean([co.newey_west(row, 20) for row in x]) == pytest.approx(truth, rel=0.1)
    assert np.mean([co.batch_means(row)[0] for row in x]) == pytest.approx(truth, rel=0.15)
    assert co.batch_means(x[0])[1] == 30
    assert np.isnan(co.newey_west([1.0]))
    assert np.isnan(co.batch_means([1.0, 2.0])[0])


def test_newey_west_is_the_triangular_sum():
    """(c0 + 2 sum (1 - k/(L+1)) c_k) / n with divisor-n autocovariances."""
    x = np.array([1.0, 4.0, 2.0, 7.0, 6.0, 1.0])
    d = x - x.mean()
    c = [d[k:] @ d[: 6 - k] / 6 for k in range(3)]
    assert co.newey_west(x, 2) == pytest.approx((c[0] + 2 * (2 / 3 * c[1] + 1 / 3 * c[2])) / 6)


def test_a_known_memory_shrinks_the_naive_coverage_as_documented():
    """AR(1) with correlation 0.9: counting every sample of 200 covers under 50 %, n_eff of the truth over 90
    %.
    """
    rng = np.random.default_rng(22)
    x = np.empty((3000, 200))
    x[:, 0] = rng.standard_normal(3000)
    for k in range(1, 200):
        x[:, k] = 0.9 * x[:, k - 1] + np.sqrt(1 - 0.81) * rng.standard_normal(3000)
    low, high = iv.sigma_interval(np.sqrt(np.mean(x**2, axis=1)), 200)
    assert np.mean((low < 1) & (high > 1)) < 0.5
    low, high = iv.sigma_interval(np.sqrt(np.mean(x**2, axis=1)), co.effective_samples(0.9 ** np.arange(200), 200))
    assert np.mean((low < 1) & (high > 1)) > 0.9
