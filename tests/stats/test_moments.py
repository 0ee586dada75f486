import numpy as np
import pytest

from rangeeval.stats.moments import moments, weighted_moments


def test_moments_are_the_central_sums_of_each_group():
    """Each group gets its own count, mean and central power sums; gaps and negative groups are left out."""
    x = [1.0, 2.0, 6.0, np.nan, 5.0, 9.0]
    m = moments(x, [0, 0, 0, 0, 2, -1], 3)
    np.testing.assert_array_equal(m.n, [3, 0, 1])
    np.testing.assert_allclose(m.mean, [3, np.nan, 5])
    np.testing.assert_allclose([m.m2[0], m.m3[0], m.m4[0]], [14, 18, 98])
    assert m.skewness[0] == pytest.approx(np.sqrt(3) * 18 / 14**1.5)
    assert m.kurtosis[0] == pytest.approx(3 * 98 / 14**2)
    assert np.isnan(m.kurtosis[1:]).all()


def test_merged_chunks_give_the_moments_of_all_samples():
    """Chunks of any size, with empty groups among them, merge to the one-pass result, even about a mean of
    1e6.
    """
    rng = np.random.default_rng(3)
    x = 1e6 + rng.gamma(2.0, 3.0, 5000)
    g = np.sort(rng.integers(0, 5, x.size))
    w = rng.uniform(0, 2, x.size)
    merged, weighted = moments([], [], 5), weighted_moments([], [], [], 5)
    for part in np.split(np.arange(x.size), [7, 8, 1000, 3500]):
        merged = merged.merge(moments(x[part], g[part], 5))
        weighted = weighted.merge(weighted_moments(x[part], w[part], g[part], 5))
    for k in range(5):
        d, v = x[g == k] - x[g == k].mean(), w[g == k]
        assert merged.n[k] == d.size
        assert merged.mean[k] == pytest.approx(x[g == k].mean(), rel=1e-14)
        for power, total in ((2, merged.m2), (3, merged.m3), (4, merged.m4)):
            assert total[k] == pytest.approx(np.sum(d**power), rel=1e-8)
        centre = x[g == k].mean()
        squares = np.sum(v * (x[g == k] - centre) ** 2)
        assert weighted.sum_of_squares_about(merged.mean)[k] == pytest.approx(squares, rel=1e-8)


def test_zero_weights_and_missing_weights_count_nothing():
    """A sample without a weight or with weight zero has no influence on weighted sums."""
    m = weighted_moments([1.0, 5.0, 100.0, 7.0], [1.0, 1.0, np.nan, 0.0])
    assert (m.weight[0], m.mean[0], m.m2[0]) == (2, 3, 8)
    assert m.sum_of_squares_about(0.0)[0] == 26
    assert weighted_moments([1.0], [0.0]).sum_of_squares_about(0.0)[0] == 0


def test_lists_that_do_not_pair_up_are_refused():
    """Group numbers or weights in another number than the values are refused."""
    with pytest.raises(ValueError, match="3 values but 2 group numbers"):
        moments([1, 2, 3], [0, 0])
    with pytest.raises(ValueError, match="3 values but 2 weights"):
        weighted_moments([1, 2, 3], [1.0, 1.0])
