"""From columns as a file holds them to canonical pieces of a log: units, missing and unusable values, even pieces."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import InputError, one_line
from rangeeval.model import CHUNK_ROWS, Log, Problem, Table, gather
from rangeeval.model.settings import UNKNOWN_ARRAY, LogSettings, SensorArray
from rangeeval.model.table import MAX_SHOWN
from rangeeval.parsers.checks import Checks
from rangeeval.parsers.columns import Field, Layout
from rangeeval.parsers.labels import Labels

AnyArray = NDArray[Any]


@dataclass(frozen=True)
class SourceFile:
    """A file to read: where it is, how messages call it, and what `trial.toml` says about it and about the array."""

    path: Path
    name: str
    settings: LogSettings | None = None
    array: SensorArray = UNKNOWN_ARRAY

    @property
    def kind(self) -> str | None:
        """The kind that `trial.toml` gives it."""
        return self.settings.kind if self.settings else None

    @property
    def of_array(self) -> bool:
        """Whether real numbers in it may be samples of an array: `trial.toml` says so, or describes an array."""
        return self.kind == "snapshots" or (self.kind is None and self.array != UNKNOWN_ARRAY)

    @property
    def columns(self) -> Mapping[str, str]:
        """The names that `trial.toml` gives its columns."""
        return self.settings.columns if self.settings else {}


@dataclass(frozen=True)
class Coded:
    """A text column that the reader has coded already: codes into `categories`, -1 where missing."""

    codes: AnyArray
    categories: Sequence[object]


@dataclass(frozen=True)
class Block:
    """Some rows of a file, any number of them: the wanted columns in the order asked for.

    `rows` are the rows' numbers in the file (a text file: lines), or the first of consecutive ones. `problems` are
    about rows that the reader has left out.
    """

    columns: Sequence[AnyArray | Coded]
    rows: int | NDArray[np.int64] = 0
    problems: tuple[Problem, ...] = ()

    def row(self, i: int) -> int:
        """The number in the file of the block's row i."""
        if isinstance(self.rows, int):
            return self.rows + i
        return int(self.rows[i]) if len(self.rows) else 0


Reader = Callable[[Sequence[Field]], Iterator[Block]]


@dataclass(frozen=True)
class Written:
    """One log as a file holds it, before its columns mean anything.

    `lengths`: rows of each column, where a file stores columns apart. `place` words a row's number for a message.
    """

    where: str
    names: tuple[str, ...]
    blocks: Reader
    place: Callable[[int], str]
    rows: int | None = None
    lengths: tuple[int, ...] | None = None
    stage: str | None = None
    kind: str | None = None


@dataclass(frozen=True)
class Contents:
    """What a file was found to hold: its logs with their columns' meaning, and what was wrong with it."""

    logs: tuple[Log, ...] = ()
    problems: tuple[Problem, ...] = ()
    unrecognised: str = field(default="")


def log_from(written: Written, layout: Layout, file: SourceFile) -> Log:
    """Make the log that reads `written` piece by piece. Raises InputError for columns of different lengths."""
    rows = written.rows
    if written.lengths is not None:
        lengths = {f.name: written.lengths[f.position] for f in layout.fields}
        if len(set(lengths.values())) > 1:
            shown = ", ".join(f"{name} {n}" for name, n in lengths.items())
            raise InputError(f"{written.where}: columns of different lengths: {shown}")
        rows = next(iter(lengths.values()))
    stage = written.stage or "predicted"
    if stage not in {"predicted", "updated"}:
        raise InputError(f"{written.where}: residual_stage is '{one_line(stage, 40)}'; known: predicted, updated")
    if file.settings is not None and file.settings.residual_stage != "predicted":
        stage = file.settings.residual_stage

    def pieces(names: Collection[str] | None = None) -> Iterator[Table]:
        fields = [f for f in layout.fields if names is None or f.name in names]
        # A piece without columns would not know its length.
        fields = fields or [f for f in layout.fields if not f.text][:1]
        tables = _checked(_even(_tables(written, fields), fields, CHUNK_ROWS), written, layout.kind)
        return _ahead(tables) if rows is None or rows > CHUNK_ROWS else tables

    return Log(
        layout.kind,
        written.where,
        tuple(f.name for f in layout.fields),
        pieces,
        rows,
        stage,
        {f.name: f.written for f in layout.fields},
    )


def _tables(written: Written, fields: Sequence[Field]) -> Iterator[Table]:
    labels = {f.name: Labels() for f in fields if f.text}
    for block in written.blocks(fields):
        columns: dict[str, NDArray[np.float64] | NDArray[np.int32]] = {}
        problems = list(block.problems)
        bad: NDArray[np.bool_] | None = None
        for f, values in zip(fields, block.columns, strict=True):
            if f.text:
                coder = labels[f.name]
                columns[f.name] = (
                    coder.recode(values.codes, values.categories) if isinstance(values, Coded) else coder.code(values)
                )
                continue
            assert not isinstance(values, Coded)
            columns[f.name], bad = _numbers(f, values, block, written, bad, problems)
        table = Table(columns, {name: coder.labels for name, coder in labels.items()}, block.row(0), tuple(problems))
        yield table if bad is None else table.take(~bad)


def _numbers(
    f: Field,
    values: AnyArray,
    block: Block,
    written: Written,
    bad: NDArray[np.bool_] | None,
    problems: list[Problem],
) -> tuple[NDArray[np.float64], NDArray[np.bool_] | None]:
    """Numbers in the stored unit, and the rows to leave out with those of the columns before (each counted once)."""
    if values.dtype.kind in "OSU":
        values, bad = _parsed(f, values, block, written, bad, problems)
    numbers = np.asarray(values, dtype=np.float64)
    # A finite sum is the cheap proof that all are finite; NaN or an overflow asks for the exact look.
    with np.errstate(over="ignore", invalid="ignore"):
        suspicious = not np.isfinite(numbers.sum())
    if suspicious and (infinite := np.isinf(numbers)).any():
        fresh = infinite if bad is None else infinite & ~bad
        if fresh.any():
            problems.append(_left_out(f, fresh, block, written, "rows with an infinite number", "is infinite"))
        bad = fresh if bad is None else bad | fresh
    if f.unit.transform is not None:
        before = np.isfinite(numbers)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            numbers = f.unit.to_si(numbers)
        lost = before & ~np.isfinite(numbers)
        if (lost if bad is None else lost & ~bad).any():
            numbers[lost] = np.nan
            why = f"numbers in '{one_line(f.written, 60)}' that {f.name} cannot express; taken as missing"
            problems.append(replace(_left_out(f, lost, block, written, why, "cannot be converted"), rejected=False))
    elif f.unit.factor != 1.0:
        numbers = numbers * f.unit.factor
    return numbers, bad


def _left_out(f: Field, rows: NDArray[np.bool_], block: Block, written: Written, reason: str, what: str) -> Problem:
    first = np.flatnonzero(rows)[:MAX_SHOWN]
    column = one_line(f.written, 60)
    examples = tuple(f"{written.place(block.row(int(i)))}: {column} {what}" for i in first)
    return Problem(written.where, reason, int(np.count_nonzero(rows)), examples, rejected=True)


MISSING = frozenset({"", "nan", "n/a", "-", "-nan"})  # compared without regard to case


def _parsed(
    f: Field,
    values: AnyArray,
    block: Block,
    written: Written,
    bad: NDArray[np.bool_] | None,
    problems: list[Problem],
) -> tuple[NDArray[np.float64], NDArray[np.bool_] | None]:
    """Numbers out of cells of text, cell by cell (an array format that stores numbers as text)."""
    numbers = np.full(len(values), np.nan)
    wrong = np.zeros(len(values), bool)
    examples: list[str] = []
    for i, cell in enumerate(values.tolist()):
        text = cell.decode("utf-8", "replace") if isinstance(cell, bytes) else str(cell if cell is not None else "")
        text = text.strip()
        if text.casefold() in MISSING:
            continue
        try:
            numbers[i] = float(text)
        except ValueError:
            if bad is not None and bad[i]:
                continue
            wrong[i] = True
            if len(examples) < MAX_SHOWN:
                examples.append(not_a_number(written.place(block.row(i)), f.written, text))
    if not wrong.any():
        return numbers, bad
    problems.append(Problem(written.where, TEXT_IN_NUMBERS, int(wrong.sum()), tuple(examples), rejected=True))
    return numbers, wrong if bad is None else bad | wrong


TEXT_IN_NUMBERS = "rows with text in a number column"


def not_a_number(place: str, column: str, cell: str, expected: str = "a number") -> str:
    """The line about a cell that is not a number."""
    return f"{place}: {one_line(column, 60)} is '{one_line(cell, 40)}', not {expected}"


def _even(tables: Iterator[Table], fields: Sequence[Field], size: int) -> Iterator[Table]:
    """The same rows in pieces of exactly `size` (the last one shorter, empty when there is no row)."""
    held: list[Table] = []
    problems: list[Problem] = []
    count = 0
    yielded = False
    for table in tables:
        problems += table.problems
        start = 0
        while count + len(table) - start >= size:
            stop = start + size - count
            yield _joined([*held, _cut(table, start, stop)], problems, fields)
            held, problems, count, start, yielded = [], [], 0, stop, True
        if start < len(table):
            held.append(_cut(table, start, len(table)))
            count += len(table) - start
    if held or problems or not yielded:
        yield _joined(held, problems, fields)


def _cut(table: Table, start: int, stop: int) -> Table:
    if start == 0 and stop == len(table):
        return table
    return Table({n: c[start:stop] for n, c in table.columns.items()}, table.labels, table.first_row + start)


def _joined(parts: Sequence[Table], problems: Sequence[Problem], fields: Sequence[Field]) -> Table:
    found = gather(problems)
    if not parts:
        empty: dict[str, Any] = {f.name: np.empty(0, np.int32 if f.text else np.float64) for f in fields}
        return Table(empty, {f.name: () for f in fields if f.text}, 0, found)
    if len(parts) == 1:
        return replace(parts[0], problems=found)
    last = parts[-1]
    columns: dict[str, Any] = {n: np.concatenate([p.columns[n] for p in parts]) for n in last.columns}
    return Table(columns, last.labels, parts[0].first_row, found)


def _checked(pieces: Iterator[Table], written: Written, kind: str) -> Iterator[Table]:
    checks = Checks(written.where, kind)
    for piece in pieces:
        found = checks.look(piece)
        yield replace(piece, problems=piece.problems + found) if found else piece


def _ahead(pieces: Iterator[Table]) -> Iterator[Table]:
    """Read the next piece in a thread while the last one is worked on; the order is that of the file."""
    with ThreadPoolExecutor(1, thread_name_prefix="rangeeval-read") as reader:
        coming = reader.submit(next, pieces, None)
        while (piece := coming.result()) is not None:
            coming = reader.submit(next, pieces, None)
            yield piece
            del piece
