"""Rows of plain values as CSV, JSON and Parquet, written as they come: an export may be larger than memory."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator, Mapping
from itertools import chain, islice
from pathlib import Path
from typing import IO, Any

from rangeeval.errors import MissingExtra
from rangeeval.files import replacing
from rangeeval.model.result import without_nan

_AT_ONCE = 50_000  # rows of a Parquet row group
_FORMULA = ("=", "+", "-", "@", "\t", "\r")

Rows = Iterable[Mapping[str, Any]]


def write_text(rows: Rows, form: str, stream: IO[str]) -> None:
    """Write rows of the same columns as `csv` or `json` (a list of objects; NaN is null)."""
    if form == "csv":
        _write_csv(rows, stream)
    else:
        stream.write("[")
        for number, row in enumerate(rows):
            stream.write(",\n " if number else "\n ")
            json.dump(without_nan(row), stream, ensure_ascii=False, allow_nan=False)
        stream.write("\n]\n")


def _write_csv(rows: Rows, stream: IO[str]) -> None:
    """Columns that only some rows have come last; text that a spreadsheet takes for a formula gets an apostrophe."""
    held = iter(rows)
    first = list(islice(held, _AT_ONCE))
    columns = list(dict.fromkeys(name for row in first for name in row))
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_cell(row.get(name)) for name in columns] for row in chain(first, held))


def _cell(value: object) -> object:
    if isinstance(value, str) and value.startswith(_FORMULA):
        return f"'{value}"
    return "" if value is None or value != value else value


def write_parquet(rows: Rows, path: Path) -> None:
    """Write rows of the same columns as one Parquet file, whole or not at all. Raises MissingExtra without pyarrow."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise MissingExtra("writing Parquet", "parquet") from None

    held = iter(rows)
    first = list(islice(held, _AT_ONCE))
    kinds = {name: _kind(pyarrow, name, first) for name in (first[0] if first else {})}
    schema = pyarrow.schema(list(kinds.items()))

    def groups() -> Iterator[list[Mapping[str, Any]]]:
        group = first
        while group:
            yield group
            group = list(islice(held, _AT_ONCE))

    with replacing(path) as temporary, parquet.ParquetWriter(temporary, schema, compression="zstd") as writer:
        for group in groups():
            columns = {
                name: pyarrow.array([row[name] for row in group], kind, from_pandas=True)
                for name, kind in kinds.items()
            }  # fmt: skip
            writer.write_table(pyarrow.table(columns, schema=schema))


def _kind(pyarrow: Any, name: str, rows: list[Mapping[str, Any]]) -> Any:
    """A column's type by its values: text, whole numbers, or numbers."""
    values = [row[name] for row in rows if row[name] is not None]
    if values and all(isinstance(value, int) for value in values):
        return pyarrow.int64()
    return (
        pyarrow.float64() if values and all(isinstance(value, (int, float)) for value in values) else pyarrow.string()
    )
