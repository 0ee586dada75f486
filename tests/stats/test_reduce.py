"""A reduced series looks like the whole one."""

from __future__ import annotations

import numpy as np
import pytest

from rangeeval.stats.reduce import decimate, thin


def test_decimate_keeps_every_extreme_of_every_column() -> None:
    """The lowest and highest of each pixel column survive, in order, and little else."""
    rng = np.random.default_rng(3)
    x, y = np.linspace(0.0, 1.0, 200_000), rng.normal(size=200_000)
    a, b = decimate(x, y, 500)
    assert a.size <= 4 * 500
    assert np.all(np.diff(a) > 0)
    column, kept = np.minimum((x * 500).astype(int), 499), np.minimum((a * 500).astype(int), 499)
    inner = slice(1, -1)  # an edge sample may fall to the neighbouring column by rounding
    for best in (np.maximum, np.minimum):
        whole = best.reduceat(y, np.searchsorted(column, np.arange(500)))
        part = best.reduceat(b, np.searchsorted(kept, np.arange(500)))
        assert np.mean(whole[inner] == part[inner]) > 0.99
    assert (b.min(), b.max(), a[0], a[-1]) == (y.min(), y.max(), x[0], x[-1])


def test_decimate_keeps_gaps_and_short_series() -> None:
    """A break in a line stays a break; a series that fits is returned as it is."""
    x = np.arange(10_000.0)
    y = np.sin(x)
    y[4000:5000] = np.nan
    assert np.isnan(decimate(x, y, 100)[1]).sum() == 1
    assert decimate([0, 1], [1, np.nan])[0].tolist() == [0, 1]


@pytest.mark.parametrize("size", [0, 1, 5])
def test_small_series_pass(size: int) -> None:
    """Nothing to reduce, nothing lost."""
    assert decimate(np.arange(size), np.ones(size), 2)[0].size == size
    assert thin(np.arange(size), np.ones(size), 1)[0].size == size or size > 1


def test_thin_keeps_one_point_a_pixel_and_all_extremes() -> None:
    """A million points become at most as many as there are pixels, with the outliers among them."""
    rng = np.random.default_rng(4)
    x, y = rng.uniform(size=300_000), rng.normal(size=300_000)
    y[123] = 40.0
    a, b = thin(x, y, 200, 100)
    assert a.size <= 200 * 100 + 2 * 200
    assert 40.0 in b
    assert b.min() == y.min()


def test_thin_drops_what_cannot_be_drawn() -> None:
    """Pairs with a value that is not finite are not points."""
    assert thin([1, np.nan, 3], [1, 2, np.inf])[0].tolist() == [1.0]
