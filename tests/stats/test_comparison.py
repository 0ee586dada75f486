"""Contrasts against scipy's distributions and printed examples; adjustment against its definition; all counted."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from rangeeval.stats import comparison as co


@pytest.mark.parametrize(("nu_a", "nu_b"), [(5.0, 8.0), (29.3, 146.8), (2000.0, 3.5)])
def test_a_ratio_of_sigmas_has_the_f_distribution(nu_a, nu_b):
    """Interval ends and both tails are those of scipy's F, whole numbers or not."""
    contrast = co.SigmaRatio(3.0, nu_a, 4.0, nu_b)
    f = stats.f(nu_b, nu_a)
    low, high = contrast.interval(0.9)
    assert low == pytest.approx(4 / 3 / math.sqrt(f.ppf(0.95)), rel=1e-9)
    assert high == pytest.approx(4 / 3 / math.sqrt(f.ppf(0.05)), rel=1e-9)
    for value in (0.5, 1.0, 2.0):
        assert contrast.above(value) == pytest.approx(f.sf((4 / 3 / value) ** 2), rel=1e-8)
        assert contrast.below(value) == pytest.approx(f.cdf((4 / 3 / value) ** 2), rel=1e-8)
    assert co.p_value(contrast, low) == pytest.approx(0.1)
    assert co.p_value(contrast, high) == pytest.approx(0.1)


def test_a_far_tail_keeps_its_digits():
    """P values far below the rounding of 1 - p are still right."""
    contrast = co.SigmaRatio(1.0, 200.0, 3.0, 200.0)
    assert contrast.above(1.0) == pytest.approx(stats.f(200, 200).sf(9.0), rel=1e-6)
    assert 0 < contrast.above(1.0) < 1e-40


def test_the_interval_of_a_ratio_covers_as_promised():
    """Of 8000 pairs of normal samples (12 and 30) with sigma ratio 1.7, 94.2 to 95.8 % of 95 % intervals hold it."""
    rng = np.random.default_rng(0)
    a = rng.standard_normal((8000, 12)).std(axis=1, ddof=1)
    b = 1.7 * rng.standard_normal((8000, 30)).std(axis=1, ddof=1)
    ends = [co.SigmaRatio(x, 11.0, y, 29.0).interval(0.95) for x, y in zip(a, b, strict=True)]
    assert np.mean([low <= 1.7 <= high for low, high in ends]) == pytest.approx(0.95, abs=0.008)


def test_means_with_t_intervals_give_welchs_test():
    """From value, ends and degrees of freedom alone: the p value and interval of scipy's test on the samples."""
    rng = np.random.default_rng(1)
    x, y = rng.normal(0, 1, 9), rng.normal(0.8, 3, 25)
    sides = []
    for sample in (x, y):
        nu = sample.size - 1.0
        half = stats.t(nu).ppf(0.95) * sample.std(ddof=1) / math.sqrt(sample.size)
        sides.append(co.Sides.of(sample.mean(), sample.mean() - half, sample.mean() + half, 0.9, nu))
    contrast = co.Difference(*sides)
    expected = stats.ttest_ind(y, x, equal_var=False)
    assert co.p_value(contrast, 0.0) == pytest.approx(expected.pvalue, rel=1e-9)
    ends = expected.confidence_interval(0.95)
    assert contrast.interval(0.95) == pytest.approx((ends.low, ends.high), rel=1e-9)


def test_each_side_of_a_skew_interval_counts_on_its_own():
    """Zou and Donner: the lower end of b - a uses the lower side of b and the upper one of a."""
    a, b = co.Sides.of(1.0, 0.6, 2.0, 0.95), co.Sides.of(3.0, 2.5, 5.0, 0.95)
    low, high = co.Difference(a, b).interval(0.95)
    assert low == pytest.approx(2.0 - math.hypot(0.5, 1.0))
    assert high == pytest.approx(2.0 + math.hypot(2.0, 0.4))
    ratio = co.Difference(
        co.Sides.of(0.0, -1.0, 1.0, 0.95), co.Sides.of(math.log(2), math.log(2) - 1, math.log(2) + 1, 0.95), True
    )
    assert ratio.effect == pytest.approx(2.0)
    assert ratio.interval(0.95) == pytest.approx((2 * math.exp(-math.sqrt(2)), 2 * math.exp(math.sqrt(2))))


@pytest.mark.parametrize(
    ("hits", "printed"),
    [((48, 80, 56, 70), (0.0524, 0.3339)), ((3, 10, 9, 10), (0.1705, 0.8090)), ((0, 10, 10, 10), (0.6075, 1.0))],
)
def test_shares_have_newcombes_interval(hits, printed):
    """Three rows of Newcombe (1998), Table II, method 10."""
    assert co.ShareDifference(*hits).interval(0.95) == pytest.approx(printed, abs=6e-5)


@pytest.mark.parametrize("hits", [(3, 20, 9, 15), (0, 7, 7, 9), (40, 400, 70, 300)])
def test_shares_are_tested_by_fishers_exact_test(hits):
    """Both tails are scipy's."""
    a, n_a, b, n_b = hits
    table = [[b, n_b - b], [a, n_a - a]]
    contrast = co.ShareDifference(*hits)
    assert contrast.above(0.0) == pytest.approx(stats.fisher_exact(table, "greater").pvalue, rel=1e-9)
    assert contrast.below(0.0) == pytest.approx(stats.fisher_exact(table, "less").pvalue, rel=1e-9)


def test_equal_shares_are_told_apart_no_more_often_than_stated():
    """Of 4000 pairs of equal shares at most 5 % have p <= 0.05 (the exact test keeps its level)."""
    rng = np.random.default_rng(2)
    a, b = rng.binomial(30, 0.8, 4000), rng.binomial(45, 0.8, 4000)
    p = [co.p_value(co.ShareDifference(x, 30, y, 45), 0.0) for x, y in zip(a.tolist(), b.tolist(), strict=True)]
    assert 0.005 < np.mean(np.array(p) <= 0.05) <= 0.05


def test_equivalence_needs_both_one_sided_tests():
    """p is the larger of the two tails: small inside the margin, one half at its edge, large outside."""
    inside, edge, outside = (co.SigmaRatio(1.0, 5000.0, r, 5000.0) for r in (1.0, 1.1, 1.3))
    assert co.p_equivalent(inside, 1 / 1.1, 1.1) < 1e-6
    assert co.p_equivalent(edge, 1 / 1.1, 1.1) == pytest.approx(0.5, abs=0.01)
    assert co.p_equivalent(outside, 1 / 1.1, 1.1) > 0.999


def test_false_equivalence_is_claimed_no_more_often_than_stated():
    """With the true ratio on the edge of the margin, 5 % of 4000 pairs are called equivalent (3.9 to 6.1 %)."""
    rng = np.random.default_rng(3)
    a = np.sqrt(rng.chisquare(2000, 4000) / 2000)
    b = 1.1 * np.sqrt(rng.chisquare(2000, 4000) / 2000)
    p = [co.p_equivalent(co.SigmaRatio(x, 2000.0, y, 2000.0), 1 / 1.1, 1.1) for x, y in zip(a, b, strict=True)]
    assert np.mean(np.array(p) <= 0.05) == pytest.approx(0.05, abs=0.011)


@pytest.mark.parametrize(
    "contrast",
    [
        co.SigmaRatio(1.0, 40.0, 1.1, 60.0),
        co.Difference(co.Sides(0.0, 1.0, 1.0, 20.0), co.Sides(1.0, 1.0, 1.0, 30.0)),
        co.ShareDifference(30.0, 40.0, 35.0, 42.0),
    ],
    ids=["sigma", "mean", "share"],
)
def test_the_number_that_would_decide_decides_and_fewer_would_not(contrast):
    """At that many times the samples the test is significant, at 3 % fewer it is not."""
    null = 1.0 if isinstance(contrast, co.SigmaRatio) else 0.0
    times = co.growth_to(contrast, lambda c: co.p_value(c, null) <= 0.01)
    assert times > 1.5
    assert co.p_value(contrast.grown(times), null) <= 0.01
    assert co.p_value(contrast.grown(times * 0.9), null) > 0.01


def test_equal_estimates_are_never_told_apart():
    """No number of samples tells a ratio of exactly 1 from 1."""
    assert co.growth_to(co.SigmaRatio(2.0, 9.0, 2.0, 9.0), lambda c: co.p_value(c, 1.0) <= 0.05) == math.inf


def test_adjusted_p_values_of_a_worked_example():
    """Four tests by hand; what is no test stays none and does not count."""
    p = [0.01, 0.04, math.nan, 0.03, 0.005]
    np.testing.assert_allclose(co.holm(p), [0.03, 0.06, math.nan, 0.06, 0.02])
    np.testing.assert_allclose(co.benjamini_hochberg(p), [0.02, 0.04, math.nan, 0.04, 0.02])
    assert co.holm([]).size == 0


@given(st.lists(st.floats(0, 1), min_size=1, max_size=12), st.floats(0.001, 0.5))
def test_adjustment_claims_what_the_step_procedures_claim(p, alpha):
    """p_adjusted <= alpha exactly where Holm's step-down and Benjamini-Hochberg's step-up reject, for any alpha."""
    order = np.argsort(p, kind="stable")
    ranked, m = np.array(p)[order], len(p)
    fails = ranked * (m - np.arange(m)) > alpha
    holm = int(np.argmax(fails)) if fails.any() else m
    passes = np.flatnonzero(ranked * m / np.arange(1, m + 1) <= alpha)
    bh = int(passes[-1]) + 1 if passes.size else 0
    for adjust, rejected in ((co.holm, holm), (co.benjamini_hochberg, bh)):
        claimed = adjust(p)[order] <= alpha
        assert claimed.tolist() == [i < rejected for i in range(m)]


def test_holm_keeps_the_chance_of_any_false_claim():
    """Of 3000 families of 30 true nulls, 5 % have any claim (3.8 to 5.2 %); unadjusted over 70 % would."""
    p = np.random.default_rng(4).uniform(size=(3000, 30))
    assert np.mean([co.holm(row).min() <= 0.05 for row in p]) == pytest.approx(0.045, abs=0.012)
    assert np.mean(p.min(axis=1) <= 0.05) > 0.7
