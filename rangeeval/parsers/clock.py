"""Times of day (`20:00:01.406`, `20:00:01:406`, `20:00:01,406`) as seconds, running on past midnight."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

DAY_S = 86400.0
_CLOCK = re.compile(r"([01]?\d|2[0-4]):([0-5]\d):([0-5]\d|60)(?:[.,:](\d{1,9}))?")
MISSING = frozenset({"", "nan", "n/a", "-"})


def is_clock(cell: str) -> bool:
    """Whether a cell is a time of day."""
    return _CLOCK.fullmatch(cell.strip()) is not None


def is_missing(cell: str) -> bool:
    """Whether a cell says that there is no time."""
    return cell.strip().casefold() in MISSING


class Clock:
    """Turns times of day into seconds since the midnight before the log's first row, piece by piece.

    A step back by more than half a day is midnight; a smaller one is a small disorder of the log, and stays. The digits
    after the last mark are a decimal fraction, so three of them are milliseconds.
    """

    def __init__(self) -> None:
        self._last: float | None = None
        self._days = 0

    def seconds(self, cells: Sequence[object]) -> NDArray[np.float64]:
        """Seconds of each cell, NaN where missing. Raises ValueError for one that is no time of day."""
        return np.array([self._one(str(cell).strip()) for cell in cells], dtype=np.float64)

    def _one(self, cell: str) -> float:
        if is_missing(cell):
            return float("nan")
        found = _CLOCK.fullmatch(cell)
        if found is None:
            raise ValueError(f"'{cell}' is not a time of day")
        hours, minutes, seconds, fraction = found.groups()
        time = int(hours) * 3600 + int(minutes) * 60 + int(seconds) + (float(f"0.{fraction}") if fraction else 0.0)
        return self.run_on(time)

    def run_on(self, time: float) -> float:
        """The next row's seconds since midnight, counted on from the midnight before the first row."""
        if self._last is not None:
            if time - self._last < -DAY_S / 2:
                self._days += 1
            elif time - self._last > DAY_S / 2 and self._days:
                self._days -= 1  # a late row of the day before
        self._last = time
        return time + self._days * DAY_S

    def copy(self) -> Clock:
        """The same clock, to try with."""
        other = Clock()
        other._last, other._days = self._last, self._days
        return other
