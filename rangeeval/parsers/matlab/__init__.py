"""MATLAB files: vectors, structs of vectors, struct arrays and cells as columns; complex matrices as array samples.

All of a file is read in a child process (`safe`): version 4 and 5 by SciPy, 7.3 by HDF5 under the same audit as any
other HDF5 file. Rows come from it piece by piece as plain numbers and text.
"""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import InputError
from rangeeval.model import CHUNK_ROWS, piece_rows
from rangeeval.parsers import safe, samples
from rangeeval.parsers.blocks import Block, Contents, Reader, SourceFile
from rangeeval.parsers.columns import Field, plain
from rangeeval.parsers.found import Described, contents
from rangeeval.parsers.matlab.version import HEADER_BYTES, known_order, version

_TABLES = "rangeeval.parsers.matlab.tables"
SECONDS = 50.0  # a cell array of a million texts takes SciPy ten


def recognises(head: bytes, path: Path) -> bool:
    """The header of version 5, or a first variable of version 4."""
    return version(head) in {"4", "5"}


def recognises_hdf5(head: bytes, path: Path) -> bool:
    """The header of version 7.3."""
    return version(head) == "7.3"


def read(file: SourceFile) -> Contents:
    """The logs of a MATLAB file: its variables as columns, and the fields of every struct in it."""
    with file.path.open("rb") as stream:
        head = stream.read(HEADER_BYTES)
    if version(head) == "5" and not known_order(head):
        raise InputError(f"{file.name}: is cut off or damaged: its header of 128 bytes does not end as MATLAB's do")
    # Loaded before the child is made of this process, or each child would load it anew.
    importlib.import_module("h5py" if version(head) == "7.3" else "scipy.io")
    times = [plain(written) for written, meant in file.columns.items() if plain(meant) in samples.TIMES]
    looked = safe.call(_TABLES, "look", str(file.path), file.name, times, seconds=SECONDS)
    child = _Child(str(file.path), times)
    nothing = (
        f"none of its variables is a column of a log: {looked['about']}. Columns under [[logs]] in trial.toml give "
        "them other names, also those of a matrix: 'data(:,1)'"
    )
    return contents(file, looked, child.reader, child.opened, nothing)


@dataclass(frozen=True)
class _Child:
    """The rows of a file, from a child process each time that they are read."""

    path: str
    times: Sequence[str]

    def parts(
        self, where: str, table: str, columns: Sequence[tuple[str, str, int]], rows: int, size: int
    ) -> Generator[list[NDArray[Any]], None, None]:
        """Columns (name, type, width) of a table, `size` rows at a time."""
        names = [name for name, _, _ in columns]
        asked = (self.times, table, names, rows, size)
        with contextlib.closing(safe.stream(_TABLES, "rows", self.path, where, *asked, seconds=SECONDS)) as buffers:
            for start, buffer in zip(range(0, max(rows, 1), size), buffers, strict=True):
                parts, at = [], 0
                for _, dtype, width in columns:
                    parts.append(np.frombuffer(buffer, dtype, min(size, rows - start) * width, at))
                    at += parts[-1].nbytes
                yield parts

    def reader(self, where: str, table: Described, usable: Sequence[Described]) -> Reader:
        """The columns of a table: those whose values came with the look, and those that the child is asked for."""
        held = {c["name"]: _held(c) for c in usable if "values" in c}

        def blocks(fields: Sequence[Field]) -> Iterator[Block]:
            wanted = [usable[f.position] for f in fields]
            asked = [(c["name"], c["dtype"], 1) for c in wanted if c["name"] not in held]
            rows = wanted[0]["rows"]
            row_bytes = sum(np.dtype(dtype).itemsize for _, dtype, _ in asked)
            size = min(CHUNK_ROWS, safe.LARGEST_BUFFER // max(row_bytes, 1))
            no_parts: Iterator[list[NDArray[Any]]] = ([] for _ in range(0, max(rows, 1), size))
            pieces = self.parts(where, table["path"], asked, rows, size) if asked else no_parts
            for start, parts in zip(count(0, size), pieces, strict=False):
                came = iter(parts)
                columns = [held[c["name"]][start : start + size] if c["name"] in held else next(came) for c in wanted]
                yield Block(columns, start)

        return blocks

    def opened(self, where: str, found: Described) -> samples.Opened:
        """The samples of an array, with their times."""

        @contextlib.contextmanager
        def opened() -> Iterator[samples.ReadRows]:
            sensors = found["sensors"]
            columns = [(name, dtype, sensors) for name, dtype in zip(found["datasets"], found["dtypes"], strict=True)]
            if found["time"]:
                columns.append((found["time"], found["time_dtype"], 1))
            pieces = self.parts(where, found["path"], columns, found["rows"], piece_rows(sensors))

            def read_rows(start: int, stop: int) -> tuple[NDArray[Any] | None, NDArray[Any]]:
                parts = next(pieces)
                time = parts.pop() if found["time"] else None
                return time, samples.joined([part.reshape(-1, sensors) for part in parts])

            with contextlib.closing(pieces):
                yield read_rows

        return opened


def _held(column: Described) -> NDArray[Any]:
    values = column["values"]
    return np.array([v.encode() for v in values] if column["kind"] == "text" else values, column["dtype"])
