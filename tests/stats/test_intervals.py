import numpy as np
import pytest
from scipy import stats

from rangeeval.stats import intervals as iv


def test_sigma_interval_is_the_chi_square_one():
    """Ends agree with scipy's chi-square quantiles, for whole and broken degrees of freedom."""
    for nu in (0.7, 4.0, 23.4, 5000.0):
        low, high = iv.sigma_interval(10.0, nu, 0.9)
        assert low == pytest.approx(10 * np.sqrt(nu / stats.chi2.ppf(0.95, nu)), rel=1e-10)
        assert high == pytest.approx(10 * np.sqrt(nu / stats.chi2.ppf(0.05, nu)), rel=1e-10)
        assert iv.sigma_lower_bound(10.0, nu, 0.95) == pytest.approx(low)
        assert iv.sigma_upper_bound(10.0, nu, 0.95) == pytest.approx(high)
    assert np.isnan(iv.sigma_interval(10.0, 0.0)).all()
    with pytest.raises(ValueError, match="between 0 and 1"):
        iv.sigma_interval(1.0, 3.0, 95)


def test_interval_of_white_residuals_has_the_printed_width():
    """The 95 % interval is -20/+34 % at 30 samples and -12/+16 % at 100."""
    low, high = iv.sigma_interval(1.0, iv.degrees_of_freedom([30, 100]))
    np.testing.assert_allclose(low - 1, [-0.20, -0.12], atol=5e-3)
    np.testing.assert_allclose(high - 1, [0.34, 0.16], atol=5e-3)


@pytest.mark.parametrize("mean_removed", [True, False])
def test_sigma_interval_holds_the_truth_as_often_as_promised(mean_removed):
    """Over 20000 made-up bins of 12 normal samples the 95 % interval covers sigma 95 % of the time."""
    x = np.random.default_rng(8).standard_normal((20_000, 12))
    s = x.std(axis=1, ddof=1) if mean_removed else np.sqrt(np.mean(x**2, axis=1))
    low, high = iv.sigma_interval(s, iv.degrees_of_freedom(12, mean_removed=mean_removed))
    assert np.mean((low < 1) & (high > 1)) == pytest.approx(0.95, abs=0.006)


def test_heavy_tails_widen_the_interval():
    """For Laplace residuals (kurtosis 6) the plain interval covers under 85 %, the adjusted one 93 to
    97 %.
    """
    x = np.random.default_rng(9).laplace(size=(10_000, 200)) / np.sqrt(2)
    s = x.std(axis=1, ddof=1)
    covered = []
    for kurtosis in (3.0, 6.0):
        low, high = iv.sigma_interval(s, iv.degrees_of_freedom(200, kurtosis=kurtosis))
        covered.append(np.mean((low < 1) & (high > 1)))
    assert covered[0] < 0.85
    assert 0.93 < covered[1] < 0.97
    assert iv.degrees_of_freedom(100, kurtosis=5.0) == pytest.approx(99 / 2)
    assert np.isnan(iv.degrees_of_freedom(1.0))
    assert np.isnan(iv.degrees_of_freedom(10.0, kurtosis=1.0))


def test_largest_passing_ratio_matches_the_printed_table():
    """0.42, 0.61, 0.73, 0.78, 0.83, 0.88, 0.92, 0.95 at nu 4 to 499."""
    printed = [0.42, 0.61, 0.73, 0.78, 0.83, 0.88, 0.92, 0.95]
    np.testing.assert_allclose(iv.max_passing_ratio([4, 9, 19, 29, 49, 99, 199, 499]), printed, atol=5.5e-3)


def test_verdict_needs_a_bound_on_its_side():
    """Pass when the upper bound is within the limit, fail when the lower is beyond, else inconclusive."""
    ratio = float(iv.max_passing_ratio(29))
    assert iv.judge(20 * ratio * 0.999, 29, 20.0).verdict == "pass"
    assert iv.judge(20 * ratio * 1.001, 29, 20.0).verdict == "inconclusive"
    lower = float(iv.sigma_lower_bound(1.0, 29))
    assert iv.judge(20 / lower * 0.999, 29, 20.0).verdict == "inconclusive"
    assert iv.judge(20 / lower * 1.001, 29, 20.0).verdict == "fail"
    assert iv.judge(float("nan"), float("nan"), 20.0).verdict == "inconclusive"


def test_a_radar_just_beyond_its_limit_rarely_passes():
    """When sigma equals the limit, at most 5 % of trials pass and at most 5 % fail."""
    s = np.random.default_rng(10).standard_normal((20_000, 15)).std(axis=1, ddof=1)
    passed = np.mean(iv.sigma_upper_bound(s, 14) <= 1)
    failed = np.mean(iv.sigma_lower_bound(s, 14) > 1)
    assert passed == pytest.approx(0.05, abs=0.005)
    assert failed == pytest.approx(0.05, abs=0.005)


@pytest.mark.parametrize(("s", "limit"), [(16.0, 20.0), (19.0, 20.0), (21.0, 20.0), (26.0, 20.0)])
def test_further_samples_are_just_enough(s, limit):
    """With the number of samples it names the verdict is decided, with one fewer it is not."""
    n, nu = 10.0, 6.5
    more = iv.further_samples(s, nu, n, limit)
    assert more > 0
    assert iv.judge(s, nu * (n + more) / n, limit).verdict != "inconclusive"
    assert iv.judge(s, nu * (n + more - 1) / n, limit).verdict == "inconclusive"


def test_further_samples_at_the_ends():
    """None when decided, infinitely many when the estimate equals the limit, unknown without an estimate."""
    assert iv.further_samples(1.0, 30.0, 40.0, 20.0) == 0
    assert iv.further_samples(20.0, 30.0, 40.0, 20.0) == np.inf
    assert np.isnan(iv.further_samples(np.nan, 30.0, 40.0, 20.0))


def test_bins_judged_together_need_more_confidence_each():
    """Ten bins at a joint 95 % need 99.5 % each; no bins are refused."""
    assert iv.family_wise_confidence(0.95, 10) == pytest.approx(0.995)
    with pytest.raises(ValueError, match="at least 1"):
        iv.family_wise_confidence(0.95, 0)


def test_mean_interval_is_students():
    """The interval of a mean agrees with scipy for white samples, and grows with their memory."""
    low, high = iv.mean_interval(2.0, 3.0, 10)
    expected = stats.t.interval(0.95, 9, loc=2.0, scale=3 / np.sqrt(10))
    assert (low, high) == (pytest.approx(expected[0]), pytest.approx(expected[1]))
    wide = iv.mean_interval(2.0, 3.0, 10, vif=2.0)
    assert (wide[1] - 2.0) == pytest.approx(stats.t.ppf(0.975, 4) * 3 * np.sqrt(0.2))
    assert np.isnan(iv.mean_interval(2.0, 3.0, 1)).all()


def test_assessed_over_predicted_variance_has_the_squared_interval():
    """An estimate twice the predicted sigma is a ratio 4 between the squared ends; 1 inside means
    agreement.
    """
    ratio, low, high = iv.variance_ratio_interval(10.0, 30.0, 5.0)
    assert ratio == 4
    ends = iv.sigma_interval(2.0, 30.0)
    assert (low, high) == (pytest.approx(ends[0] ** 2), pytest.approx(ends[1] ** 2))
