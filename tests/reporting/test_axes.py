"""Axes hold their data and are labelled with round numbers."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rangeeval.reporting.axes import ticks


@pytest.mark.parametrize(
    ("view", "most", "log", "labels", "power"),
    [
        ((0.0, 1.0), 5, False, ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"], ""),
        ((-25.0, 25.0), 6, False, ["−20", "−10", "0", "10", "20"], ""),
        ((0.0, 3.2e6), 4, False, ["0", "1", "2", "3"], "10⁶"),
        ((0.0, 4e-7), 4, False, ["0", "100", "200", "300", "400"], "10⁻⁹"),
        ((1.0, 1000.0), 5, True, ["1", "10", "100", "1000"], ""),
        ((1e-9, 1e-3), 4, True, ["10⁻⁸", "10⁻⁶", "10⁻⁴"], ""),
    ],
)
def test_ticks(view: tuple[float, float], most: int, log: bool, labels: list[str], power: str) -> None:
    """Round numbers, as many decimals as the step needs, a common power where numbers are large or small."""
    assert ticks(view, most, log)[1:] == (labels, power)


@given(
    st.floats(-1e12, 1e12, allow_subnormal=False), st.floats(1e-9, 1e12), st.integers(2, 10)
)  # fmt: skip
def test_ticks_are_few_inside_and_rising(low: float, span: float, most: int) -> None:
    """For any range the ticks lie in it, in order, and are not many more than asked for."""
    high = low + span
    if high - low < 1e-9 * abs(low):
        return
    values, labels, _ = ticks((low, high), most)
    assert len(values) == len(labels) <= 4 * most + 2
    assert values == sorted(values)
    assert all(low - 1e-6 * span <= value <= high + 1e-6 * span for value in values)
