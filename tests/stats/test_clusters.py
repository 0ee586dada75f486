"""Clusters: alike ones change nothing, different ones are seen, and intervals that heed them cover."""

import numpy as np
import pytest
from scipy import stats

from rangeeval.stats.clusters import Excess, cluster_excess


def test_alike_clusters_are_left_alone_but_for_the_level_of_the_test():
    """Of 2000 totals of independent samples in 6 clusters, 5 % are taken to differ (3.5 to 6.5 %)."""
    rng = np.random.default_rng(0)
    marks = np.repeat(np.arange(6), 20)
    found = [cluster_excess(rng.standard_normal(120), marks, 120.0) for _ in range(2000)]
    assert np.mean([f.ratio > 1.0 for f in found]) == pytest.approx(0.05, abs=0.015)
    assert {f.dof for f in found} == {5.0, np.inf}


def test_the_variance_of_a_total_is_found_from_its_clusters():
    """Clusters with levels of their own: the ratio is the true variance of the total over that of its samples."""
    rng = np.random.default_rng(1)
    marks = np.repeat(np.arange(400), 10)
    x = rng.standard_normal(4000) + np.repeat(rng.standard_normal(400), 10)
    assert cluster_excess(x, marks, 4000.0).ratio == pytest.approx(11.0, rel=0.15)


def test_few_clusters_widen_an_interval_as_students_t():
    """The allowance is the ratio times the squared ratio of the quantiles of t and of the normal distribution."""
    assert Excess().allowance == pytest.approx(1.0)
    expected = 2.5 * (stats.t(3).ppf(0.975) / stats.norm.ppf(0.975)) ** 2
    assert Excess(2.5, 3.0).allowance == pytest.approx(expected)


@pytest.mark.parametrize("marks", [np.zeros(5), np.arange(0)])
def test_a_single_cluster_tells_nothing(marks):
    """One cluster, or none, is no excess."""
    assert cluster_excess(np.ones(marks.size), marks, 1.0) == Excess()
