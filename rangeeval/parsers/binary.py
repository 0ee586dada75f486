"""Binary logs of fixed records, described in `trial.toml` as a list of names and types; read piece by piece."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import InputError
from rangeeval.model import CHUNK_ROWS, Problem
from rangeeval.model.settings import LogSettings
from rangeeval.parsers.blocks import Block, Contents, SourceFile, Written, log_from
from rangeeval.parsers.columns import Field, lay_out


def recognises(head: bytes, path: Path) -> bool:
    """Never: plain bytes could be anything."""
    return False


def described(settings: LogSettings) -> bool:
    """`trial.toml` lists the fields of the file's records."""
    return bool(settings.fields)


def read(file: SourceFile) -> Contents:
    """The log of the file's records; a last one that is cut off is counted among the rows set aside."""
    assert file.settings is not None
    header, record = file.settings.header_bytes, _record(file.settings)
    size = file.path.stat().st_size - header
    if size < 0:
        raise InputError(f"{file.name}: has {size + header} bytes, and trial.toml says header_bytes = {header}")
    rows, rest = divmod(size, record.itemsize)
    names = tuple(record.names or ())
    layout = lay_out(names, file.name, file.kind, file.columns)
    if layout is None:
        return Contents(unrecognised="its fields in trial.toml name no column of a known kind of log")
    cut_off: tuple[Problem, ...] = ()
    if rest:
        example = f"{file.name}[{rows}]: has {rest} of the {record.itemsize} bytes of a record"
        cut_off = (Problem(file.name, "the last record is cut off", 1, (example,), rejected=True),)

    def blocks(fields: Sequence[Field]) -> Iterator[Block]:
        with file.path.open("rb") as stream:
            stream.seek(header)
            for start in range(0, max(rows, 1), CHUNK_ROWS):
                count = min(CHUNK_ROWS, rows - start)
                data = stream.read(count * record.itemsize)
                if len(data) < count * record.itemsize:
                    raise InputError(f"{file.name}: was cut off while it was read")
                part = np.frombuffer(data, record, count)
                ended = start + count == rows
                yield Block([_values(part[names[f.position]], f) for f in fields], start, cut_off if ended else ())

    written = Written(file.name, names, blocks, lambda row: f"{file.name}[{row}]", rows=rows)
    return Contents((log_from(written, layout, file),), layout.problems)


def _record(settings: LogSettings) -> np.dtype[Any]:
    """The records' NumPy type: only the fields to read, each at its place."""
    place, kept = 0, []
    for field in settings.fields:
        if not field.padding:
            kept.append((field.name, field.numpy, place))
        place += field.bytes
    names, formats, offsets = zip(*kept, strict=True)
    size = settings.record_bytes or place
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})


def _values(part: NDArray[Any], field: Field) -> NDArray[Any]:
    """One field's values side by side. Any byte but 0 is true; a NaN that signals becomes one that does not."""
    if part.dtype.kind == "b":
        return np.asarray(part.view(np.uint8) != 0)
    if part.dtype.kind == "f":
        with np.errstate(invalid="ignore"):
            return part.astype(np.float64)
    return np.ascontiguousarray(part)
