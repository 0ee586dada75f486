import numpy as np
import pytest
from scipy import stats

from rangeeval.stats import diagnostics as di
from rangeeval.stats.moments import moments

X = np.random.default_rng(0).gamma(3.0, 2.0, 60)


def test_mean_test_agrees_with_students():
    """White samples give scipy's t test; memory divides t and the degrees of freedom."""
    reference = stats.ttest_1samp(X - 5, 0.0)
    t = di.mean_t_test(60, X.mean() - 5, X.std(ddof=1))
    assert (t.statistic, t.p_value) == (pytest.approx(reference.statistic), pytest.approx(reference.pvalue))
    slow = di.mean_t_test(60, X.mean() - 5, X.std(ddof=1), vif=4.0)
    assert (slow.statistic, slow.dof) == (pytest.approx(t.statistic / 2), 14)
    quick = di.mean_t_test(60, X.mean() - 5, X.std(ddof=1), vif=0.25)
    assert (quick.statistic, quick.dof) == (pytest.approx(t.statistic * 2), 59)
    assert np.isnan(di.mean_t_test(1, 1.0, 1.0).p_value)
    assert np.isnan(di.mean_t_test(5, 1.0, 0.0).p_value)


def test_normality_tests_agree_with_scipy():
    """Jarque-Bera from samples and from moments, and Shapiro-Wilk, give scipy's values."""
    reference = stats.jarque_bera(X)
    m = moments(X)
    for j in (di.jarque_bera(X), di.jarque_bera_from_moments(m.n[0], m.m2[0], m.m3[0], m.m4[0])):
        assert j.statistic == pytest.approx(reference.statistic, rel=1e-10)
        assert j.p_value == pytest.approx(reference.pvalue, rel=1e-9)
        assert j.skewness == pytest.approx(stats.skew(X))
        assert j.kurtosis == pytest.approx(stats.kurtosis(X, fisher=False))
    assert di.shapiro_wilk(X).p_value == pytest.approx(stats.shapiro(X).pvalue)
    for few in ([], [1.0, 2.0], [3.0, 3.0, 3.0]):
        assert np.isnan(di.shapiro_wilk(few).p_value)
    assert np.isnan(di.jarque_bera([2.0, 2.0]).p_value)


def test_rank_correlation_agrees_with_scipy():
    """Spearman's coefficient and p value are scipy's, with ties and gaps."""
    rng = np.random.default_rng(1)
    x, y = rng.integers(0, 8, 50).astype(float), rng.integers(0, 8, 50) + rng.normal(size=50)
    y += x / 4
    reference = stats.spearmanr(x, y)
    r = di.spearman(np.append(x, np.nan), np.append(y, 1.0))
    assert (r.statistic, r.p_value) == (pytest.approx(reference.statistic), pytest.approx(reference.pvalue))
    assert di.spearman([1, 2, 3], [10, 20, 40]).statistic == 1
    assert np.isnan(di.spearman([1, 1, 1], [1, 2, 3]).statistic)
    assert np.isnan(di.spearman([1, 2], [1, 2]).statistic)
    np.testing.assert_array_equal(di.ranks([5.0, 1.0, 5.0, 2.0]), [3.5, 1, 3.5, 2])


def test_robust_sigma_ignores_outliers():
    """The median absolute deviation finds sigma of a normal sample although 5 % of it are far out."""
    x = np.random.default_rng(2).normal(3.0, 2.0, 100_000)
    x[:5000] = 1e4
    assert di.mad_sigma(x[5000:]) == pytest.approx(2.0, rel=0.01)
    assert di.mad_sigma(x) == pytest.approx(2.0, rel=0.08)
    assert np.isnan(di.mad_sigma([np.nan]))
    assert pytest.approx(1 / stats.norm.ppf(0.75), rel=1e-12) == di.MAD_TO_SIGMA


def test_outliers_lie_beyond_four_robust_sigmas():
    """Only what is farther than k robust sigmas is marked; gaps are not; a normal sample loses 6 in
    100000.
    """
    x = np.concatenate([np.random.default_rng(3).standard_normal(200_000), [np.nan, 40.0]])
    mask = di.outlier_mask(x)
    assert mask[-1]
    assert not mask[-2]
    assert mask[:-1].mean() == pytest.approx(6.3e-5, abs=5e-5)
    edge = [-3.0, -1, -1, -1, 0, 1, 1, 1, 2.9]  # robust sigma 1.4826, so that 2 sigma is 2.965
    np.testing.assert_array_equal(np.flatnonzero(di.outlier_mask(edge, 2.0)), [0])
    assert not di.outlier_mask([np.nan]).any()


def test_gate_takes_the_printed_share_of_the_variance():
    """Truncating at 2, 2.5, 3, 3.5, 4 sigma leaves 0.774, 0.911, 0.973, 0.994, 0.999 of the variance."""
    k = np.array([2, 2.5, 3, 3.5, 4])
    np.testing.assert_allclose(di.gate_truncation_factor(k), [0.774, 0.911, 0.973, 0.994, 0.999], atol=6e-4)
    assert di.gate_truncation_factor(1.3) == pytest.approx(stats.truncnorm(-1.3, 1.3).var(), rel=1e-10)
    assert np.isnan(di.gate_truncation_factor(0.0))
