"""Parquet, read in batches of bounded size (extra `parquet`)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rangeeval.errors import InputError, MissingExtra, one_line
from rangeeval.model import CHUNK_ROWS, Problem
from rangeeval.parsers.blocks import Block, Coded, Contents, SourceFile, Written, log_from
from rangeeval.parsers.columns import Field, lay_out


def recognises(head: bytes, path: Path) -> bool:
    """The Parquet signature."""
    return head.startswith(b"PAR1")


def _opened(path: Path, where: str) -> Any:
    try:
        import pyarrow.parquet as pq
    except ImportError:
        raise MissingExtra("reading Parquet logs", "parquet") from None
    try:
        # pre_buffer would hold whole row groups: 6 GB for a log of 100 million rows.
        return pq.ParquetFile(path, pre_buffer=False)
    except Exception as error:  # Arrow wraps what it meets in many kinds of exception
        raise InputError(f"{where}: the Parquet file is damaged or cut off ({one_line(error, 120)})") from error


def read(file: SourceFile) -> Contents:
    """The log of a Parquet file; a schema metadata entry `residual_stage` counts."""
    with _opened(file.path, file.name) as parquet:
        try:
            schema = parquet.schema_arrow
            rows = parquet.metadata.num_rows
        except Exception as error:
            raise InputError(f"{file.name}: the Parquet file is damaged ({one_line(error, 120)})") from error
        kinds = {field.name: _kind(field.type) for field in schema}
        names = tuple(field.name for field in schema if kinds[field.name] != "other")
        stage = (schema.metadata or {}).get(b"residual_stage")
    layout = lay_out(names, file.name, file.kind, file.columns)
    if layout is None:
        return Contents(unrecognised="its schema names no column of a known kind of log")
    problems = layout.problems
    if other := [one_line(name, 60) for name, kind in kinds.items() if kind == "other"]:
        problems += (
            Problem(file.name, f"columns that are neither numbers nor text are not read: {', '.join(other[:10])}"),
        )

    def blocks(fields: Sequence[Field]) -> Iterator[Block]:
        start = 0
        with _opened(file.path, file.name) as parquet:
            try:
                for batch in parquet.iter_batches(CHUNK_ROWS, columns=[names[f.position] for f in fields]):
                    columns = [_values(batch.column(names[f.position]), f.text) for f in fields]
                    yield Block(columns, start)
                    start += batch.num_rows
            except InputError:
                raise
            except Exception as error:
                raise InputError(
                    f"{file.name}: rows from {start} on cannot be read, the file is damaged ({one_line(error, 120)})"
                ) from error

    written = Written(
        file.name,
        names,
        blocks,
        lambda row: f"{file.name}[{row}]",
        rows=rows,
        stage=stage.decode("utf-8", "replace") if stage else None,
    )
    return Contents((log_from(written, layout, file),), problems)


def _kind(kind: Any) -> str:
    import pyarrow.types as types

    if types.is_dictionary(kind):
        kind = kind.value_type
    if types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind) or types.is_decimal(kind):
        return "number"
    if types.is_string(kind) or types.is_large_string(kind):
        return "text"
    return "other"


def _values(column: Any, text: bool) -> Any:
    import pyarrow as pa
    import pyarrow.compute as pc

    if pa.types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    if text and _kind(column.type) == "text":
        coded = column.dictionary_encode()
        codes = pc.fill_null(coded.indices, -1).to_numpy(zero_copy_only=False)
        return Coded(codes, coded.dictionary.to_pylist())
    if _kind(column.type) == "text":
        return np.array(column.to_pylist(), dtype=object)
    if text and pa.types.is_integer(column.type) and column.null_count == 0:
        return column.to_numpy(zero_copy_only=False)
    # Integers beyond 2^53 lose digits as they would on any way to a number column.
    return column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
