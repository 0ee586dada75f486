"""Tables and logs: columns of equal length in SI units, read piece by piece."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import InputError, did_you_mean
from rangeeval.model.kinds import KINDS, LogKind
from rangeeval.model.settings import SensorArray

CHUNK_ROWS = 262_144  # part of the results' definition: fixed pieces give the same bits whatever the machine

MAX_SHOWN = 5

ColumnArray = NDArray[np.float64] | NDArray[np.int32] | NDArray[np.complex128]


def piece_rows(width: int = 1) -> int:
    """Rows of a piece of a log whose widest column has `width` numbers a row: so many that pieces are of one size."""
    return max(1, CHUNK_ROWS // max(width, 1))


@dataclass(frozen=True)
class Problem:
    """Something found in the input that its reader must know: where, what, how often, and the first few cases.

    `reason` is a whole sentence without the place; `examples` name rows (`residuals.csv:3: range_residual_m is
    'oops', not a number`). `count` is how many rows it concerns (0: the file as a whole). `rejected` says that those
    rows were set aside.
    """

    where: str
    reason: str
    count: int = 0
    examples: tuple[str, ...] = ()
    rejected: bool = False

    def merged(self, other: Problem) -> Problem:
        """The two together, when they are the same problem in the same place."""
        return replace(self, count=self.count + other.count, examples=(self.examples + other.examples)[:MAX_SHOWN])

    def __str__(self) -> str:
        rows = f" ({self.count} row{'s' if self.count != 1 else ''})" if self.count else ""
        return f"{self.where}: {self.reason}{rows}"

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        return {
            "where": self.where,
            "reason": self.reason,
            "count": self.count,
            "examples": list(self.examples),
            "rejected": self.rejected,
        }


def real_or_complex(values: NDArray[Any]) -> NDArray[np.float64] | NDArray[np.complex128]:
    """Numbers in double precision, complex where they are."""
    return np.asarray(values, np.complex128) if values.dtype.kind == "c" else np.asarray(values, np.float64)


def gather(problems: Collection[Problem]) -> tuple[Problem, ...]:
    """The same problems, those of one place and reason merged, in the order they were met."""
    merged: dict[tuple[str, str], Problem] = {}
    for p in problems:
        key = (p.where, p.reason)
        merged[key] = merged[key].merged(p) if key in merged else p
    return tuple(merged.values())


@dataclass(frozen=True)
class Table:
    """One piece of a log: columns of equal length.

    Number columns are float64 in SI units, NaN where missing. Text columns are int32 codes into `labels[name]`
    (-1 where missing); later pieces of a log may only append labels, so a code means the same in every piece. A wide
    column (rows, sensors) is float64 or complex128. `first_row` is the number, in the source, of the first row (for a
    text file: its line), for messages.
    """

    columns: Mapping[str, ColumnArray]
    labels: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    first_row: int = 0
    problems: tuple[Problem, ...] = ()

    def __len__(self) -> int:
        for column in self.columns.values():
            return len(column)
        return 0

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def floats(self, name: str) -> NDArray[np.float64]:
        """A number column; all NaN when the log does not have it."""
        column = self.columns.get(name)
        if column is None:
            return np.full(len(self), np.nan)
        return np.asarray(column, dtype=np.float64)

    def codes(self, name: str) -> NDArray[np.int32]:
        """The codes of a text column; all 0 when the log does not have it."""
        column = self.columns.get(name)
        if column is None:
            return np.zeros(len(self), np.int32)
        return np.asarray(column, dtype=np.int32)

    def wide(self, name: str) -> NDArray[np.float64] | NDArray[np.complex128]:
        """A wide column, (rows, sensors) (KeyError when the log does not have it)."""
        return real_or_complex(self.columns[name])

    def texts(self, name: str) -> list[str]:
        """A text column as text, '' where missing."""
        labels = (*self.labels.get(name, ()), "")
        return [labels[code] for code in self.codes(name)]

    def take(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> Table:
        """The rows chosen by an index or a mask."""
        return replace(self, columns={n: c[rows] for n, c in self.columns.items()})


Chunks = Callable[[Collection[str] | None], Iterator[Table]]


@dataclass(frozen=True)
class Log:
    """One log of a trial: its kind, where it came from, its stored columns, and how to read it piece by piece.

    `pieces(names)` yields tables of at most `CHUNK_ROWS` rows with those of the named columns the log has (all when
    None), converted to SI, with the problems met in them; reading twice gives the same. `stage` is `predicted` for
    residuals before the update, `updated` for those after it. `written` is the name each column has in its file.
    `array` is what is known of the array behind a snapshots log.
    """

    kind: str
    source: str
    columns: tuple[str, ...]
    pieces: Chunks
    rows: int | None = None
    stage: str = "predicted"
    written: Mapping[str, str] = field(default_factory=dict)
    array: SensorArray | None = None

    @property
    def definition(self) -> LogKind:
        """The kind's columns."""
        return KINDS[self.kind]

    def __contains__(self, name: str) -> bool:
        return name in self.columns

    def read(self, names: Collection[str] | None = None) -> Table:
        """The whole log as one table. For logs known to fit; big ones go through `pieces`."""
        tables = list(self.pieces(names))
        if len(tables) == 1:
            return tables[0]
        if not tables:
            return Table({})
        last = tables[-1]
        return Table(
            {n: np.concatenate([t.columns[n] for t in tables]) for n in last.columns},
            last.labels,
            tables[0].first_row,
            gather([p for t in tables for p in t.problems]),
        )


def log_of(kind: str, columns: Mapping[str, object], source: str = "table", array: SensorArray | None = None) -> Log:
    """Make a log from plain columns in memory (a dict of sequences, or a pandas DataFrame), in stored units and names.

    `array` goes with a snapshots log, whose `samples` are (rows, sensors). Raises InputError naming the nearest
    column when one is unknown, or the one that is missing.
    """
    definition = KINDS[kind]
    data: dict[str, ColumnArray] = {}
    labels: dict[str, tuple[str, ...]] = {}
    width = 1
    for name in columns:
        if name not in definition.names:
            raise InputError(
                f"{source}: '{name}' is not a column of a {kind} log; {did_you_mean(name, definition.names)}"
            )
        values = columns[name]
        if definition.column(name).text:
            codes: dict[str, int] = {}
            data[name] = np.array([codes.setdefault(str(v), len(codes)) for v in values], np.int32)  # type: ignore[attr-defined]
            labels[name] = tuple(codes)
        elif definition.column(name).wide:
            wide = np.asarray(values)
            if wide.ndim != 2 or wide.dtype.kind not in "iufc":
                raise InputError(f"{source}: {name} has the shape {wide.shape}, expected numbers (rows, sensors)")
            data[name] = real_or_complex(wide)
            width = wide.shape[1]
        else:
            data[name] = np.asarray(values, dtype=np.float64)
    lengths = {len(c) for c in data.values()}
    if len(lengths) > 1:
        raise InputError(f"{source}: columns of different lengths {sorted(lengths)}")
    if lacking := definition.missing(data):
        raise InputError(f"{source}: a {kind} log needs the column {lacking[0]}")
    table = Table(data, labels)

    def pieces(names: Collection[str] | None) -> Iterator[Table]:
        chosen = {n: c for n, c in data.items() if names is None or n in names}
        size = piece_rows(width)
        for start in range(0, max(len(table), 1), size):
            yield Table({n: c[start : start + size] for n, c in chosen.items()}, labels, start)

    return Log(kind, source, tuple(data), pieces, len(table), array=array)
