"""What is flagged and left in: time order, repetitions, likely wrong units."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rangeeval.model import Problem, Table, gather
from rangeeval.parsers.checks import Checks
from tests.parsers.samples import csv_text, read, text_log


def found(time: list[float], track: list[int] | None = None, size: int = 1000) -> list[Problem]:
    """The problems of a log read in pieces of `size` rows."""
    checks = Checks("log", "plots")
    problems: list[Problem] = []
    labels = ("A", "B", "C", "D")
    for start in range(0, len(time), size):
        columns: dict[str, Any] = {"time_s": np.array(time[start : start + size], float)}
        if track is not None:
            columns["target_id"] = np.array(track[start : start + size], np.int32)
        problems += checks.look(Table(columns, {"target_id": labels} if track is not None else {}))
    return list(gather(problems))


@pytest.mark.parametrize("size", [1, 2, 3, 1000])
def test_time_going_backwards_is_counted_with_its_largest_step(size: int) -> None:
    """Backward steps within a track, also over the edge of a piece; tracks interleaved are in order."""
    assert found([0, 0.5, 1, 1.5], [0, 1, 0, 1], size) == []
    assert found([0, 0, 1, 1], [0, 1, 0, 1], size) == []
    assert found([5, 6, 7, 0, 1, 2], [0, 0, 0, 1, 1, 1], size) == []
    problems = found([5, 3, 4, 1, 9, 10], [0, 0, 0, 0, 1, -1], size)
    assert "time goes backwards" in problems[0].reason
    assert problems[0].count == 2
    assert "largest step 3 s" in problems[0].examples


def test_repeated_rows_are_counted() -> None:
    """The same track and time twice, side by side or apart; nothing is left out."""
    problems = found([0, 1, 1, 2], [0, 0, 0, 0])
    assert [(p.count, p.rejected) for p in problems] == [(1, False)]
    assert [p.count for p in found([0, 1, 2, 0, 1, 2])] == [1, 3]


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 6), st.integers(-1, 3)), max_size=30), st.integers(1, 31))
def test_backward_steps_are_those_of_a_plain_count(rows: list[tuple[int, int]], size: int) -> None:
    """The count equals the one of a plain loop over each track, whatever the piece size."""
    last: dict[int, int] = {}
    backward = 0
    for time, track in rows:
        backward += track in last and time < last[track]
        last[track] = time
    problems = found([r[0] for r in rows], [r[1] for r in rows], size)
    assert sum(p.count for p in problems if "backwards" in p.reason) == backward


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"range_predicted_km": [1e5, 1e5]}, "the median of range_predicted_m is 1e+08 m"),
        ({"range_predicted_m": [30.0, 31.0]}, "the median of range_predicted_m is 30.5 m"),
        (
            {"range_predicted_m": [3e4, 3e4], "y_predicted_km": [100.0, 100.0]},
            "y_predicted_m exceeds range_predicted_m",
        ),
    ],
)
def test_a_likely_wrong_unit_is_flagged(change: dict[str, list[float]], says: str, tmp_path: Path) -> None:
    """Ranges no radar has, and a y beyond the range: flagged in words, nothing changed."""
    columns = {n: np.array(v) for n, v in ({"time_s": [0.0, 1.0], "range_residual_m": [1.0, 2.0]} | change).items()}
    table = read(text_log(tmp_path, csv_text(columns)))
    assert any(says in p.reason and not p.rejected for p in table.problems)
    assert len(table) == 2


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 3), st.integers(-1, 3)), max_size=12).map(sorted), st.integers(1, 13))
def test_a_log_in_time_order_counts_its_repetitions(rows: list[tuple[int, int]], size: int) -> None:
    """In a log sorted by time, every row whose track and time were there before is counted, in pieces of any size."""
    problems = found([r[0] for r in rows], [r[1] for r in rows], size)
    assert not any("backwards" in p.reason for p in problems)
    assert sum(p.count for p in problems if "repeat" in p.reason) == len(rows) - len(set(rows))
