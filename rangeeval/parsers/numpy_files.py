"""NumPy `.npz` (an array a column, or one structured array) and structured `.npy`; streamed, and never pickled.

An array of two dimensions holds the samples of an array of sensors.
"""

from __future__ import annotations

import contextlib
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from rangeeval.errors import InputError, one_line
from rangeeval.model import CHUNK_ROWS, Problem
from rangeeval.parsers import samples
from rangeeval.parsers.blocks import Block, Contents, SourceFile, Written, log_from
from rangeeval.parsers.columns import Field, lay_out

_MAX_MEMBERS = 10_000
_MAX_ROW_BYTES = 1 << 16
# What zipfile and NumPy raise on damaged files; reading a header of text even raises what a tokenizer does.
_DAMAGE = (
    ValueError, OSError, EOFError, zlib.error, zipfile.BadZipFile, NotImplementedError, RuntimeError, KeyError,
    TypeError, OverflowError, SyntaxError, MemoryError, RecursionError, tokenize.TokenError,
)  # fmt: skip


def recognises_npz(head: bytes, path: Path) -> bool:
    """A zip archive all of whose members are `.npy` arrays."""
    if not head.startswith(b"PK\x03\x04"):
        return False
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
    except _DAMAGE:
        # A cut-off archive has lost its list of members; its first one still tells.
        return b".npy" in head[:300]
    return bool(names) and all(name.endswith(".npy") for name in names)


def recognises_npy(head: bytes, path: Path) -> bool:
    """The signature of a NumPy array file."""
    return head.startswith(b"\x93NUMPY")


def _shape_header(stream: IO[bytes], where: str) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Shape, whether stored column by column, and type of the array that begins here. Raises InputError for pickles."""
    version = npy.read_magic(stream)
    reader = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
    if version not in {(1, 0), (2, 0), (3, 0)}:
        raise InputError(f"{where}: version {version} of the NumPy format is not known")
    shape, by_column, dtype = reader(stream)
    if dtype.hasobject:
        raise InputError(f"{where}: holds pickled Python objects, which are never read")
    return tuple(map(int, shape)), bool(by_column), dtype


def _array_header(stream: IO[bytes], where: str) -> tuple[int, np.dtype[Any], int]:
    """Rows, type and bytes of a row of the array that begins here; -1 rows for what is no column."""
    shape, _, dtype = _shape_header(stream, where)
    if len(shape) != 1 or dtype.itemsize > _MAX_ROW_BYTES:
        return -1, dtype, 0
    return int(shape[0]), dtype, int(dtype.itemsize)


def _kind(dtype: np.dtype[Any]) -> str:
    if dtype.shape != ():
        return "other"
    return "number" if dtype.kind in "iufb" else "text" if dtype.kind in "SU" else "other"


def _rows(stream: IO[bytes], dtype: np.dtype[Any], rows: int, where: str) -> Iterator[NDArray[Any]]:
    """The array's rows in blocks; a stream that ends early is an error."""
    done = 0
    while done < rows:
        count = min(CHUNK_ROWS, rows - done)
        data = bytearray()
        while len(data) < count * dtype.itemsize:
            part = stream.read(count * dtype.itemsize - len(data))
            if not part:
                held = done + len(data) // max(dtype.itemsize, 1)
                raise InputError(f"{where}: is cut off: it declares {rows} rows and holds {held}")
            data += part
        yield np.frombuffer(data, dtype, count)
        done += count


def read_npy(file: SourceFile) -> Contents:
    """The log of a structured array file."""
    try:
        with file.path.open("rb") as stream:
            shape, by_column, dtype = _shape_header(stream, file.name)
            begins = stream.tell()
    except InputError:
        raise
    except _DAMAGE as error:
        raise InputError(f"{file.name}: the NumPy file is damaged ({one_line(error, 120)})") from error
    if len(shape) == 2 and (dtype.kind == "c" or (dtype.kind in "iuf" and file.of_array)):
        return _samples_of_npy(file, shape, by_column, dtype, begins)
    one = len(shape) == 1 and dtype.itemsize <= _MAX_ROW_BYTES
    rows, size = (shape[0], int(dtype.itemsize)) if one else (-1, 0)
    if rows < 0 or dtype.names is None:
        return Contents(unrecognised="its array has no named columns")
    if begins + rows * size > file.path.stat().st_size:
        held = (file.path.stat().st_size - begins) // max(size, 1)
        raise InputError(f"{file.name}: is cut off: it declares {rows} rows and holds {held}")

    def opened() -> IO[bytes]:
        stream = file.path.open("rb")
        stream.seek(begins)
        return stream

    return _structured(file, dtype, rows, opened)


def _samples_of_npy(
    file: SourceFile, shape: tuple[int, ...], by_column: bool, dtype: np.dtype[Any], begins: int
) -> Contents:
    """Samples of an array, row after row or (a transposed array) column after column."""
    rows, sensors = shape
    if begins + rows * sensors * dtype.itemsize > file.path.stat().st_size:
        raise InputError(f"{file.name}: is cut off: it declares {rows} x {sensors} numbers of {dtype.itemsize} bytes")

    @contextlib.contextmanager
    def opened() -> Iterator[samples.ReadRows]:
        with file.path.open("rb") as stream:

            def part(first: int, count: int) -> NDArray[Any]:
                stream.seek(begins + first * dtype.itemsize)
                data = stream.read(count * dtype.itemsize)
                if len(data) < count * dtype.itemsize:
                    raise InputError(f"{file.name}: was cut off while it was read")
                return np.frombuffer(data, dtype)

            def read_rows(start: int, stop: int) -> tuple[None, NDArray[Any]]:
                if not by_column:
                    return None, part(start * sensors, (stop - start) * sensors).reshape(-1, sensors)
                return None, np.column_stack([part(s * rows + start, stop - start) for s in range(sensors)])

            yield read_rows

    recorded = samples.Recorded(file.name, rows, sensors, opened)
    return Contents((samples.snapshots_log(recorded, file),))


def _structured(file: SourceFile, dtype: np.dtype[Any], rows: int, opened: Any) -> Contents:
    assert dtype.names is not None
    kinds = {name: _kind(dtype[name]) for name in dtype.names}
    names = tuple(name for name in dtype.names if kinds[name] != "other")
    layout = lay_out(names, file.name, file.kind, file.columns)
    if layout is None:
        return Contents(unrecognised="its array names no column of a known kind of log")

    def blocks(fields: Sequence[Field]) -> Iterator[Block]:
        start = 0
        try:
            with opened() as stream:
                for part in _rows(stream, dtype, rows, file.name):
                    yield Block([np.ascontiguousarray(part[names[f.position]]) for f in fields], start)
                    start += len(part)
        except _DAMAGE as error:
            raise InputError(f"{file.name}: cannot be read from row {start} on ({one_line(error, 120)})") from error

    written = Written(file.name, names, blocks, lambda row: f"{file.name}[{row}]", rows=rows)
    return Contents((log_from(written, layout, file),), layout.problems + _set_aside(file, kinds))


def _set_aside(file: SourceFile, kinds: dict[str, str]) -> tuple[Problem, ...]:
    other = [one_line(name, 60) for name, kind in kinds.items() if kind == "other"]
    if not other:
        return ()
    reason = f"arrays that are neither columns of numbers nor of text are not read: {', '.join(other[:10])}"
    return (Problem(file.name, reason),)


def read_npz(file: SourceFile) -> Contents:
    """The log of an array archive: an array a column, or one structured array."""
    described: dict[str, tuple[int, np.dtype[Any]]] = {}
    wide: dict[str, tuple[tuple[int, ...], np.dtype[Any]]] = {}
    try:
        with zipfile.ZipFile(file.path) as archive:
            members = archive.infolist()
            if len(members) > _MAX_MEMBERS:
                raise InputError(f"{file.name}: holds {len(members)} arrays; at most {_MAX_MEMBERS} are read")
            for member in members:
                name = member.filename.removesuffix(".npy")
                if name in described:
                    raise InputError(f"{file.name}: holds the array '{one_line(name, 60)}' twice")
                with archive.open(member) as stream:
                    shape, by_column, dtype = _shape_header(stream, f"{file.name}:{one_line(name, 60)}")
                if len(shape) == 2 and not by_column:
                    wide[name] = (shape, dtype)
                one = len(shape) == 1 and dtype.itemsize <= _MAX_ROW_BYTES
                rows, size = (shape[0], int(dtype.itemsize)) if one else (-1, 0)
                if rows * size > member.file_size:
                    raise InputError(
                        f"{file.name}: '{one_line(name, 60)}' declares {rows} rows and holds {member.file_size} bytes"
                    )
                described[name] = (rows, dtype)
    except InputError:
        raise
    except _DAMAGE as error:
        raise InputError(f"{file.name}: the array archive is damaged or cut off ({one_line(error, 120)})") from error
    if (found := _samples_of_npz(file, described, wide)) is not None:
        return found
    if len(described) == 1:
        name, (rows, dtype) = next(iter(described.items()))
        if dtype.names is not None and rows >= 0:
            return _structured(file, dtype, rows, lambda: _OneMember(file.path, f"{name}.npy"))
    kinds = {name: _kind(dtype) if rows >= 0 else "other" for name, (rows, dtype) in described.items()}
    names = tuple(name for name, kind in kinds.items() if kind != "other")
    layout = lay_out(names, file.name, file.kind, file.columns)
    if layout is None:
        return Contents(unrecognised="its arrays are no columns of a known kind of log")

    def blocks(fields: Sequence[Field]) -> Iterator[Block]:
        start = 0
        wanted = [names[f.position] for f in fields]
        try:
            with zipfile.ZipFile(file.path) as archive:
                readers = []
                for name in wanted:
                    stream = archive.open(f"{name}.npy")
                    rows, dtype, _ = _array_header(stream, f"{file.name}:{one_line(name, 60)}")
                    readers.append(_rows(stream, dtype, rows, f"{file.name}:{one_line(name, 60)}"))
                for parts in zip(*readers, strict=True):
                    yield Block(parts, start)
                    start += len(parts[0])
        except _DAMAGE as error:
            raise InputError(f"{file.name}: cannot be read from row {start} on ({one_line(error, 120)})") from error

    written = Written(
        file.name,
        names,
        blocks,
        lambda row: f"{file.name}[{row}]",
        lengths=tuple(described[name][0] for name in names),
    )
    return Contents((log_from(written, layout, file),), layout.problems + _set_aside(file, kinds))


def _samples_of_npz(
    file: SourceFile,
    described: dict[str, tuple[int, np.dtype[Any]]],
    wide: dict[str, tuple[tuple[int, ...], np.dtype[Any]]],
) -> Contents | None:
    """Samples of an array with times and facts beside them; None when no array in the archive is that."""
    positions = any(name.startswith("sensor_position") for name in described)
    candidates = [
        name for name, (_, dtype) in wide.items()
        if dtype.kind == "c" or (dtype.kind in "iuf" and name in samples.NAMES and (positions or file.of_array))
    ]  # fmt: skip
    if not candidates:
        if any(name in samples.NAMES and rows < 0 for name, (rows, _) in described.items()) and positions:
            raise InputError(
                f"{file.name}: 'samples' is not stored row by row in two dimensions (snapshots, sensors); save it with "
                "np.ascontiguousarray"
            )
        return None
    named = [name for name in candidates if name in samples.NAMES]
    if len(candidates) > 1 and len(named) != 1:
        names = ", ".join(one_line(name, 60) for name in candidates[:5])
        raise InputError(f"{file.name}: holds several complex arrays ({names}); call the samples 'samples'")
    (name,) = named or candidates
    (rows, sensors), dtype = wide[name]
    time = next((n for n in described if n.casefold() in samples.TIMES), "")
    if time and described[time][0] != rows:
        raise InputError(f"{file.name}: columns of different lengths: {time} {described[time][0]}, {name} {rows}")
    facts = {n: _member(file, n) for n in samples.FACTS if n in described}
    said = samples.said_of(facts, file.name)

    @contextlib.contextmanager
    def opened() -> Iterator[samples.ReadRows]:
        with contextlib.ExitStack() as stack:
            body = stack.enter_context(_OneMember(file.path, f"{name}.npy"))
            times = stack.enter_context(_OneMember(file.path, f"{time}.npy")) if time else None

            def read_rows(start: int, stop: int) -> tuple[NDArray[Any] | None, NDArray[Any]]:
                try:
                    values = _whole(body, dtype, (stop - start) * sensors).reshape(-1, sensors)
                    when = None if times is None else _whole(times, described[time][1], stop - start)
                except _DAMAGE as error:
                    raise InputError(
                        f"{file.name}: cannot be read from row {start} on ({one_line(error, 120)})"
                    ) from error
                return when, values

            yield read_rows

    recorded = samples.Recorded(file.name, rows, sensors, opened, said, time, samples.shown(name))
    return Contents((samples.snapshots_log(recorded, file),))


def _whole(stream: IO[bytes], dtype: np.dtype[Any], count: int) -> NDArray[Any]:
    data = stream.read(count * dtype.itemsize)
    if len(data) < count * dtype.itemsize:
        raise EOFError(f"expected {count} numbers more")
    return np.frombuffer(data, dtype)


def _member(file: SourceFile, name: str) -> NDArray[Any]:
    """A small array of an archive, whole. Raises InputError when it is not a few numbers."""
    with zipfile.ZipFile(file.path) as archive, archive.open(f"{name}.npy") as stream:
        shape, by_column, dtype = _shape_header(stream, f"{file.name}:{one_line(name, 60)}")
        count = int(np.prod(shape, dtype=object))
        if dtype.kind not in "iuf" or count > 3 * samples.MAX_SENSORS:
            raise InputError(f"{file.name}: {name} is not made of a few numbers")
        try:
            return _whole(stream, dtype, count).reshape(shape, order="F" if by_column else "C")
        except _DAMAGE as error:
            raise InputError(f"{file.name}: {name} cannot be read ({one_line(error, 120)})") from error


class _OneMember:
    """One array of an archive as a stream that stands at its first row."""

    def __init__(self, path: Path, member: str) -> None:
        self.path = path
        self.member = member

    def __enter__(self) -> IO[bytes]:
        self.archive = zipfile.ZipFile(self.path)
        stream = self.archive.open(self.member)
        _array_header(stream, self.member)
        return stream

    def __exit__(self, *_: object) -> None:
        self.archive.close()
