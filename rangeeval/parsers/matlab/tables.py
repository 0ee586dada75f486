"""From MATLAB variables to tables and arrays of samples, and their rows; in the child process.

The variables of a file are one table, and the fields of every struct. A vector is a column; so is a cell array, or a
field of an array of structs, with a number or a text in each element. The columns of a matrix are called as MATLAB
calls them: `data(:,3)`. A single number or text beside longer columns holds for all rows.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import InputError, one_line
from rangeeval.parsers import samples
from rangeeval.parsers.columns import plain
from rangeeval.parsers.matlab import hdf5_files, scipy_files
from rangeeval.parsers.matlab.cells import as_column, as_structs, unrolled
from rangeeval.parsers.matlab.values import Cells, Matrix, Stored, Struct, Texts, Unread, Value, Wanted, check_depth
from rangeeval.parsers.matlab.version import HEADER_BYTES, version

_WIDEST_MATRIX = 64  # columns that may be named one by one
_WIDEST_TEXT = 256
_SHOWN = 4
_MOST_NOTES = 20
_MOST_HELD = 500_000


@dataclass(frozen=True)
class _Column:
    """A column of a table, or the samples of an array (`width` numbers a row).

    `of_matrix`: it has no name but its place. `single`: it stands once for all rows. `cells`: it was made of cells,
    which takes long.
    """

    name: str
    kind: str
    rows: int
    dtype: str = ""
    read: Callable[[int, int], NDArray[Any]] = lambda start, stop: np.empty(0)
    width: int = 1
    of_matrix: bool = False
    single: bool = False
    cells: bool = False

    def buffer(self, start: int, stop: int) -> bytes:
        """Rows as they go to the parent, in numbers of the type that it was told."""
        with np.errstate(invalid="ignore"):  # a NaN that signals becomes one that does not
            return self.read(start, stop).astype(self.dtype).tobytes()

    def over(self, rows: int) -> _Column:
        """The same in so many rows, where it is a single one."""
        if self.rows != 1 or rows <= 1:
            return self
        first = self.read(0, 1)
        # A text of as many letters as there are rows may be a letter a row, laid the wrong way; it is left as it is.
        if self.kind == "text" and len(text := first[0].decode()) >= rows and len(text) % rows == 0:
            return self
        return replace(self, rows=rows, read=lambda start, stop: np.repeat(first, stop - start), single=True)


@dataclass
class _Table:
    """The variables of a file or the fields of a struct."""

    path: str
    columns: list[_Column] = field(default_factory=list)
    wide: list[_Column] = field(default_factory=list)
    said: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    stage: str | None = None


Names = Collection[str]


def look(path: str, times: Names) -> dict[str, Any]:
    """What a file holds, in plain values: see `parsers.found`; `about` says in words what its variables are.

    `times`: names of times, in lower case, that `trial.toml` knows.
    """
    variables = _variables(path)
    tables = list(_tables("", variables, times, 0))
    hold = sum(column.rows for table in tables for column in table.columns if column.cells) <= _MOST_HELD
    about = [f"{one_line(name, 60)} ({_words(name, value)})" for name, value in list(variables.items())[:_SHOWN]]
    if len(variables) > _SHOWN:
        about.append(f"{len(variables) - _SHOWN} more")
    return {
        "tables": [_described(table, times, hold) for table in tables if table.columns],
        "arrays": [array for table in tables if (array := _array(table)) is not None],
        "notes": [note for table in tables for note in table.notes][:_MOST_NOTES],
        "about": "; ".join(about) or "there are none",
    }


def rows(path: str, times: Names, table: str, names: Sequence[str], length: int, size: int) -> Iterator[bytes]:
    """The named columns of a table of `length` rows, `size` at a time: the rows of the first, then of the next."""
    needed = {name.split("(")[0] for name in names} | set(samples.TIMES) | set(times)
    wanted = Wanted(table, frozenset(needed))
    for candidate in _tables("", _variables(path, wanted), times, 0):
        held = {c.name: c for c in (*candidate.columns, *candidate.wide)} if candidate.path == table else {}
        if set(names) <= held.keys():
            columns = [held[name].over(length) for name in names]
            for start in range(0, max(length, 1), size):
                yield b"".join(column.buffer(start, min(start + size, length)) for column in columns)
            return
    raise InputError("the file changed while it was read")


def _variables(path: str, wanted: Wanted | None = None) -> dict[str, Value]:
    with Path(path).open("rb") as stream:
        newer = version(stream.read(HEADER_BYTES)) == "7.3"
    return hdf5_files.variables(path, wanted) if newer else scipy_files.variables(path, wanted)


# --- tables ----------------------------------------------------------------------------------------------------------


def _tables(
    path: str, fields: Mapping[str, Value], times: Names, depth: int, *, cells: bool = False
) -> Iterator[_Table]:
    """The table of these fields, then those of the structs among them; `cells`: these stood in an array of structs."""
    check_depth(depth)
    table = _Table(path)
    inner: list[tuple[str, Struct]] = []
    for name, value in fields.items():
        structs = as_structs(value) if isinstance(value, Cells) else value
        if isinstance(structs, Struct):
            inner.append((name, structs))
        elif isinstance(value, Cells):
            _add(table, name, as_column(value), cells=True)
        else:
            _add(table, name, value, cells=cells)
    yield table
    for name, struct in inner:
        here = f"{path}.{name}" if path else name
        inside = unrolled(struct, lambda name: _is_time(name, times))
        yield from _tables(here, inside, times, depth + 1, cells=cells or struct.elements != 1)


def _is_time(name: str, times: Names) -> bool:
    return name.casefold() in samples.TIMES or plain(name) in times


def _described(table: _Table, times: Names, hold: bool) -> dict[str, Any]:
    """A table for the parent; what was made of cells comes with its values. What is single holds for all times."""
    length = next((c.rows for c in table.columns if c.kind == "number" and _is_time(c.name, times)), 0)
    keys = ("name", "kind", "rows", "dtype", "of_matrix", "single")
    columns = []
    for column in (column.over(length) for column in table.columns):
        columns.append({key: getattr(column, key) for key in keys})
        if hold and column.cells and column.kind != "other":
            values = column.read(0, column.rows).tolist()
            columns[-1]["values"] = [v.decode() for v in values] if column.kind == "text" else values
    return {"path": table.path, "stage": table.stage, "columns": columns}


def _add(table: _Table, name: str, value: Value, *, cells: bool = False) -> None:
    if isinstance(value, Texts):
        if name == "residual_stage" and len(value.rows) == 1:
            table.stage = value.rows[0].strip()
        else:
            table.columns.append(replace(_text(name, value.rows), cells=cells))
    elif isinstance(value, (np.ndarray, Stored)):
        few = value.shape[0] * value.shape[1] <= 3 * samples.MAX_SENSORS
        if name in samples.FACTS and few and value.dtype.kind != "c":
            table.said[name] = np.asarray(value[:, :], np.float64).tolist()
        if 1 in value.shape or 0 in value.shape:
            table.columns.append(replace(_vector(name, value), cells=cells))
        else:
            _add_matrix(table, name, value)
    elif isinstance(value, Unread):
        table.columns.append(_Column(name, "other", 0))
        if value.instead:
            table.notes.append(f"{one_line(name, 60)} is a {_words(name, value)}")


def _wire(dtype: np.dtype[Any]) -> str:
    """How numbers of this type go to the parent: whole ones as they are, others in double precision."""
    if dtype.kind in "iu":
        return dtype.newbyteorder("<").str
    return {"b": "|u1", "f": "<f8", "c": "<c16"}[dtype.kind]


def _vector(name: str, value: Matrix) -> _Column:
    across = value.shape[1] != 1

    def read(start: int, stop: int) -> NDArray[Any]:
        return value[0, start:stop] if across else value[start:stop, 0]

    length = 0 if 0 in value.shape else max(value.shape)
    return _Column(name, "other" if value.dtype.kind == "c" else "number", length, _wire(value.dtype), read)


def _add_matrix(table: _Table, name: str, value: Matrix) -> None:
    length, width = value.shape
    kind, dtype = "complex" if value.dtype.kind == "c" else "real", _wire(value.dtype)
    table.wide.append(_Column(name, kind, length, dtype, lambda start, stop: value[start:stop, :], width))
    if kind == "complex" or width > _WIDEST_MATRIX:
        return
    for i in range(width):

        def read(start: int, stop: int, i: int = i) -> NDArray[Any]:
            return value[start:stop, i]

        table.columns.append(_Column(f"{name}(:,{i + 1})", "number", length, dtype, read, of_matrix=True))


def _text(name: str, texts: Sequence[str]) -> _Column:
    encoded = [text.rstrip().encode("utf-8", "replace") for text in texts]
    width = max(map(len, encoded), default=0)
    if width > _WIDEST_TEXT:
        return _Column(name, "other", len(texts))
    values = np.array(encoded, f"S{max(width, 1)}")
    return _Column(name, "text", len(texts), values.dtype.str, lambda start, stop: values[start:stop])


# --- arrays and words ------------------------------------------------------------------------------------------------


def _array(table: _Table) -> dict[str, Any] | None:
    """The samples of an array in a table, with their times and what is said of the array; None for none."""
    time = next((c for c in table.columns if c.kind == "number" and c.name.casefold() in samples.TIMES), None)
    placed = any(name.startswith("sensor_position") for name in table.said)
    wide = [
        {"name": c.name, "path": c.name, "kind": c.kind, "rows": c.rows, "sensors": c.width}
        for c in table.wide
        if c.name not in table.said
    ]
    found = samples.among(wide, table.path or "/")
    if found is None:
        return None
    named = found["name"].casefold() in samples.NAMES
    timed = time is not None and time.rows == found["rows"]
    dtypes = {c.name: c.dtype for c in table.wide}
    return {
        **found,
        "path": table.path,
        "dtypes": [dtypes[name] for name in found["datasets"]],
        "time": time.name if time else "",
        "time_rows": time.rows if time else 0,
        "time_dtype": time.dtype if time else "",
        "said": table.said,
        # Complex numbers alone may be anything that someone had in the workspace.
        "likely": placed or (found["kind"] == "complex" and (named or timed)),
    }


def _words(name: str, value: Value) -> str:
    """What a variable is, for someone who looks for a log in it."""
    if isinstance(value, Cells):
        inside = as_structs(value)
        return f"{len(value.items)} cells" + (f" of structs with {_names(inside)}" if inside else "")
    if isinstance(value, Struct):
        number = "struct" if value.elements == 1 else f"{value.elements} structs"
        return f"{number} with {_names(value)}"
    if isinstance(value, Unread):
        instead = value.instead.replace("{}", one_line(name, 60))
        return value.what + (f", which is not read; save {instead}" if instead else "")
    return "text" if isinstance(value, Texts) else "x".join(map(str, value.shape))


def _names(struct: Struct) -> str:
    names = [one_line(name, 40) for name in list(struct.fields)[:5]]
    return ", ".join(names) + (", ..." if len(struct.fields) > len(names) else "")
