"""Half-open bins."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rangeeval.model import Bins
from rangeeval.model.bins import OUTSIDE
from rangeeval.model.settings import BinSettings


def test_a_bin_holds_its_low_edge_and_not_its_high_one():
    """[low, high): an edge belongs to the bin above it; below the start, missing or absurd is in none."""
    values = np.array([0.0, 4999.999, 5000.0, -1.0, np.nan, np.inf, 1e30])
    assert Bins().index(values).tolist() == [0, 0, 1, OUTSIDE, OUTSIDE, OUTSIDE, OUTSIDE]


@given(st.floats(0, 1e6), st.floats(1, 1e4), st.floats(-1e3, 1e3))
def test_every_value_lies_in_the_edges_of_its_bin(value, width, start):
    """Index and edges agree, to rounding."""
    bins = Bins(width=width, start=start)
    i = int(bins.index(np.array([value]))[0])
    if i != OUTSIDE:
        low, high = bins.edges(i)
        assert low - 1e-6 <= value <= high + 1e-6


def test_constant_snr_bins_span_the_same_decibels():
    """With a span of 2 dB every bin's edges are 2 dB apart under the R^-4 law."""
    bins = Bins.of(BinSettings(start=10_000.0, snr_span_db=2.0))
    for i in range(20):
        low, high = bins.edges(i)
        assert 40 * np.log10(high / low) == pytest.approx(2.0)
        assert bins.index(np.array([low * 1.0001, high * 0.9999])).tolist() == [i, i]
