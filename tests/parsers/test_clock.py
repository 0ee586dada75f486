"""Times of day in a text log, against seconds counted by hand."""

import datetime

import numpy as np
import pytest

from rangeeval.parsers import open_trial
from rangeeval.parsers.clock import Clock, is_clock


@pytest.mark.parametrize(
    ("cell", "seconds"),
    [("20:00:01:406", 72001.406), ("20:00:01.406", 72001.406), ("20:00:01,5", 72001.5), ("0:00:00", 0.0),
     ("23:59:60", 86400.0), ("07:08:09.000001", 25689.000001)],
)  # fmt: skip
def test_digits_after_the_last_mark_are_a_fraction(cell, seconds):
    """Three of them are milliseconds, one a tenth, whatever the mark."""
    assert is_clock(cell)
    assert Clock().seconds([cell])[0] == pytest.approx(seconds, abs=1e-9)


@pytest.mark.parametrize("cell", ["", "72001.4", "20:00", "25:00:00", "20:61:00", "20:00:61", "a:b:c", "20:00:01:"])
def test_other_cells_are_no_time_of_day(cell):
    """Missing or a number: not a clock."""
    assert not is_clock(cell)


def test_midnight_is_passed_once_and_small_steps_back_stay():
    """A step back by more than half a day is a new day; one of 0.2 s is a disorder of the log, on either side of it."""
    cells = ["23:59:59.9", "00:00:00.1", "23:59:59.95", "00:00:02", "00:00:01.8", "n/a", "00:00:03"]
    found = Clock().seconds(cells)
    np.testing.assert_allclose(found, [86399.9, 86400.1, 86399.95, 86402.0, 86401.8, np.nan, 86403.0])


def written(tmp_path, rows, name="plots.csv"):
    (tmp_path / name).write_text("time_s;range_m;azimuth_deg;\n" + "".join(f"{r};\n" for r in rows), encoding="utf-8")
    return open_trial(tmp_path / name)


def test_a_log_with_a_clock_is_read_past_midnight_and_bad_cells_are_named(tmp_path):
    """The header one field short, decimal points, one cell that is no time: its line is said, the clock goes on."""
    rows = ["23:59:56:000;1000.5;10.0", "half past;1000.0;10.0", ";900.0;9.0", "00:00:04:250;1001.0;10.5"]
    trial = written(tmp_path, rows)
    table = trial.logs[0].read()
    np.testing.assert_allclose(table.floats("time_s"), [86396.0, np.nan, 86404.25])
    (problem,) = (p for p in table.problems if p.rejected and "number" in p.reason)
    assert problem.count == 1
    assert "plots.csv:3" in problem.examples[0]
    assert "'half past'" in problem.examples[0]


def test_reading_twice_gives_the_same(tmp_path):
    """The clock starts anew with every pass over the log."""
    trial = written(tmp_path, ["23:59:59.5;1.0;1.0", "00:00:00.5;1.0;1.0"])
    a, b = (trial.logs[0].read().floats("time_s") for _ in range(2))
    assert a.tolist() == b.tolist() == [86399.5, 86400.5]


def test_a_long_log_is_the_same_in_pieces(tmp_path):
    """Fifty thousand rows over one midnight, in blocks."""
    start = datetime.datetime(2026, 1, 1, 20, tzinfo=datetime.UTC)
    times = [start + datetime.timedelta(seconds=0.5 * k) for k in range(50_000)]
    trial = written(tmp_path, [f"{t:%H:%M:%S}.{t.microsecond // 1000:03d};1000.0;10.0" for t in times])
    found = trial.logs[0].read().floats("time_s")
    np.testing.assert_allclose(found, 72000.0 + 0.5 * np.arange(50_000), atol=1e-9)


def test_plain_seconds_are_no_clock(tmp_path):
    """Numbers stay numbers."""
    trial = written(tmp_path, ["1.5;1.0;1.0", "2.5;1.0;1.0"])
    assert trial.logs[0].read().floats("time_s").tolist() == [1.5, 2.5]
