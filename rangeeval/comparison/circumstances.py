"""What else was not alike in a bin of two trials: SNR, gains, path. A difference there need not be the radar's."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from rangeeval.model import Estimate, Result

Place = tuple[str, str | None, float, float, str | None, str | None]
"""Analysis, bin variable and edges, group, track."""

Rows = Mapping[str, Estimate]
"""The rows of one place by quantity."""

SNR_DB = 1.0
APART = 1.1  # a ratio of gains or levers beyond this, or its inverse


@dataclass(frozen=True)
class Circumstance:
    """What may differ: the flag, the quantities it bears on, and how it is told from the rows of one bin."""

    flag: str
    bears_on: tuple[str, ...]
    differs: Callable[[Rows, Rows], bool]


def _snr(a: Rows, b: Rows) -> bool:
    """By more than a decibel, and by more than the intervals."""
    x, y = a.get("snr"), b.get("snr")
    if x is None or y is None or not abs(x.value - y.value) > SNR_DB:
        return False
    return not (x.low <= y.high and y.low <= x.high)


def _gains(axis: str) -> Callable[[Rows, Rows], bool]:
    return lambda a, b: any(_apart(_value(a, f"{g}_{axis}"), _value(b, f"{g}_{axis}")) for g in ("alpha", "beta"))


def _path(angle: str, axis: str) -> Callable[[Rows, Rows], bool]:
    """Whether a metre across is another angle: by the range flown, and by how far off boresight."""

    def lever(rows: Rows) -> float:
        return _value(rows, f"{angle}_sigma") / (_value(rows, f"{axis}_sigma") or math.nan)

    return lambda a, b: _apart(lever(a), lever(b))


CIRCUMSTANCES = (
    Circumstance("unlike-snr", ("*_sigma", "*_sigma_*"), _snr),
    Circumstance("unlike-gains", ("range_*",), _gains("range")),
    Circumstance("unlike-gains", ("y_*", "elevation_*"), _gains("y")),
    Circumstance("unlike-gains", ("z_*", "azimuth_*"), _gains("z")),
    Circumstance("unlike-path", ("elevation_sigma*",), _path("elevation", "y")),
    Circumstance("unlike-path", ("azimuth_sigma*",), _path("azimuth", "z")),
)


def by_place(results: Sequence[Result]) -> dict[Place, dict[str, Estimate]]:
    """The rows of a trial's results, by place and quantity."""
    found: dict[Place, dict[str, Estimate]] = {}
    for result in results:
        for row in result.rows:
            found.setdefault(place_of(result.analysis, row), {})[row.quantity] = row
    return found


def place_of(analysis: str, row: Estimate) -> Place:
    """Where a row stands; edges to nine digits, an open or missing one as infinite (NaN is no key)."""
    low, high = (float(f"{e:.9g}") if math.isfinite(e) else math.inf for e in (row.bin_low, row.bin_high))
    return analysis, row.variable, low, high, row.group, row.track_id


def unlike(quantity: str, a: Rows, b: Rows) -> Iterator[str]:
    """The flags of a comparison of `quantity`, from the rows of its bin in both trials."""
    for circumstance in CIRCUMSTANCES:
        if any(fnmatchcase(quantity, name) for name in circumstance.bears_on) and circumstance.differs(a, b):
            yield circumstance.flag


def _value(rows: Rows, quantity: str) -> float:
    return rows[quantity].value if quantity in rows else math.nan


def _apart(x: float, y: float) -> bool:
    return x > 0.0 and y > 0.0 and not 1.0 / APART <= x / y <= APART
