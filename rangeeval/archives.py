"""The archive of a trial: one HDF5 file with its logs, settings, source hashes, what was set aside, and its results.

The logs are stored column by column as their parser gave them; nothing here looks inside. The layout is documented in
docs/reference/archive.md and read back by `rangeeval.parsers.archive`.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import InputError, one_line
from rangeeval.files import replacing
from rangeeval.model import KINDS, Log, Problem, Result, Table, Trial, gather, piece_rows
from rangeeval.model import layout as at
from rangeeval.model.result import without_nan

CHUNK = 65_536  # rows of a stored chunk: whole ones make a piece of CHUNK_ROWS
_NARROWEST = 16
# Measured on decimal logs: level 1 is half the size of none, and shuffling makes them bigger.
_STORED = {"compression": "gzip", "compression_opts": 1, "fletcher32": True}


def write_archive(
    trial: Trial,
    results: Sequence[Result],
    sha256: Mapping[str, str],
    path: str | os.PathLike[str],
    progress: Callable[[int], None] | None = None,
) -> Path:
    """Write a trial and its results as one archive, whole or not at all. Returns its path.

    `sha256`: of each source file, by its name. The same trial gives the same bytes. Raises InputError for a text
    longer than an archive's columns hold; OSError when the disk is full, and the old file stays.
    """
    import h5py

    target = Path(path)
    version = at.VERSION if trial.of_kind("snapshots") else at.WITHOUT_ARRAYS
    with replacing(target) as temporary:
        with temporary.open("r+b", buffering=0) as raw:
            disk = _Disk(raw, str(target))
            with h5py.File(disk, "w", userblock_size=at.HEADER_BYTES) as file:
                file.attrs["rangeeval_archive"] = version
                logs = [_write_log(file, number, log, disk, progress) for number, log in enumerate(trial.logs)]
                _write_meta(file, trial, logs, sha256)
                _write_text(file, at.RESULTS, _json([r.as_dict(series=True) for r in results]))
                _write_table(file.create_group(at.ESTIMATES), _estimate_columns(results))
            disk.check()
        _seal(temporary, version)
    return target


class _Disk:
    """The file under HDF5. A write that the disk refuses is remembered, not raised: HDF5 crashes on those.

    What was refused is kept in memory so that HDF5 can close in peace; `check` then raises the error.
    """

    def __init__(self, raw: Any, name: str) -> None:
        self.raw = raw
        self.name = name
        self.place = 0
        self.error: OSError | None = None
        self.kept: list[tuple[int, bytes]] = []

    def check(self) -> None:
        """Raise what the disk said, if it refused anything."""
        if self.error is not None:
            raise OSError(self.error.errno, self.error.strerror, self.name)

    def seek(self, offset: int, whence: int = 0) -> int:
        """Where the next read or write begins."""
        self.place = offset + (0 if whence == 0 else self.place if whence == 1 else self.raw.seek(0, 2))
        return self.place

    def tell(self) -> int:
        """Where that is."""
        return self.place

    def read(self, size: int) -> bytes:
        """That many bytes."""
        data = bytearray(size)
        self.readinto(data)
        return bytes(data)

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer; zeros where nothing was written."""
        view = memoryview(buffer).cast("B")
        view[:] = os.pread(self.raw.fileno(), len(view), self.place).ljust(len(view), b"\0")
        for offset, data in self.kept:
            low, high = max(offset, self.place), min(offset + len(data), self.place + len(view))
            if low < high:
                view[low - self.place : high - self.place] = data[low - offset : high - offset]
        self.place += len(view)
        return len(view)

    def write(self, data: Any) -> int:
        """Write all of it, or keep it."""
        view = memoryview(data).cast("B")
        done = 0
        try:
            while done < len(view) and self.error is None:
                done += os.pwrite(self.raw.fileno(), view[done:], self.place + done)
        except OSError as error:
            self.error = error
        if done < len(view):
            self.kept.append((self.place + done, bytes(view[done:])))
        self.place += len(view)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Make the file this long."""
        size = self.place if size is None else size
        try:
            self.raw.truncate(size)
        except OSError as error:
            self.error = self.error or error
        return size

    def flush(self) -> None:
        """Nothing is held back."""


def _seal(path: Path, version: int = at.WITHOUT_ARRAYS) -> None:
    """Read back what was written, and put its size and SHA-256 in front."""
    with path.open("r+b") as stream:
        stream.seek(at.HEADER_BYTES)
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
        size = stream.tell()
        stream.seek(0)
        stream.write(at.Header(version, size, digest).as_bytes())


def _write_log(file: Any, number: int, log: Log, disk: _Disk, progress: Callable[[int], None] | None) -> dict[str, Any]:
    group = file.create_group(f"{at.LOGS}/{number:03d}")
    group.attrs.update({"kind": log.kind, "source": _attribute(log.source), "residual_stage": log.stage})
    columns: dict[str, _Column] = {}
    problems: list[tuple[int, Problem]] = []
    rows = 0
    width = 1
    for piece_number, piece in enumerate(log.pieces(None)):
        problems += [(piece_number, problem) for problem in piece.problems]
        if not columns:
            # A piece that is not full is the last one.
            width = max((c.shape[1] for c in piece.columns.values() if c.ndim == 2), default=1)
            full = len(piece) == piece_rows(width)
            chunk = max(1, CHUNK // width) if full else min(CHUNK, max(1, len(piece)))
            columns = {name: _column(group, log, piece, name, chunk) for name in piece.columns}
        for column in columns.values():
            column.append(piece)
            disk.check()
        rows += len(piece)
        if progress is not None:
            progress(len(piece))
    return {
        "group": f"{number:03d}",
        "kind": log.kind,
        "source": log.source,
        "stage": log.stage,
        "rows": rows,
        "columns": list(columns),
        "text": [name for name, column in columns.items() if isinstance(column, _TextColumn)],
        "written": dict(log.written),
        "problems": [[piece_number, problem.as_dict()] for piece_number, problem in problems],
        **({"width": width, "array": without_nan(dataclasses.asdict(log.array))} if log.array else {}),
    }


def _column(group: Any, log: Log, piece: Table, name: str, chunk: int) -> _Column:
    known = {c.name: c for c in KINDS[log.kind].columns}.get(name)
    text = known is not None and known.text
    attributes = {"unit": known.unit if known else "", "written": _attribute(log.written.get(name, name))}
    if known is not None and known.wide:
        return _WideColumn(group, name, chunk, attributes, piece.wide(name))
    return (_TextColumn if text else _Column)(group, name, chunk, attributes)


class _Column:
    """A number column, extended piece by piece."""

    def __init__(self, group: Any, name: str, chunk: int, attributes: Mapping[str, str]) -> None:
        self.group, self.name, self.chunk, self.attributes = group, name, chunk, attributes
        self.rows = 0
        self.dataset = self._made(name, "f8")

    def _made(self, name: str, dtype: Any) -> Any:
        dataset = self.group.create_dataset(
            name, (self.rows,), dtype, maxshape=(None,), chunks=(self.chunk,), **_STORED
        )
        dataset.attrs.update(self.attributes)
        return dataset

    def append(self, piece: Table) -> None:
        """Add the rows of one more piece."""
        self._extend(piece.floats(self.name))

    def _extend(self, values: NDArray[Any]) -> None:
        self.dataset.resize((self.rows + len(values), *values.shape[1:]))
        self.dataset[self.rows :] = values
        self.rows += len(values)


class _WideColumn(_Column):
    """A wide column: float64, or HDF5's usual compound of a real and an imaginary part."""

    def __init__(self, group: Any, name: str, chunk: int, attributes: Mapping[str, str], like: NDArray[Any]) -> None:
        self.like = like
        super().__init__(group, name, chunk, attributes)

    def _made(self, name: str, dtype: Any) -> Any:
        width = self.like.shape[1]
        dataset = self.group.create_dataset(
            name, (0, width), self.like.dtype, maxshape=(None, width), chunks=(self.chunk, width), **_STORED
        )
        dataset.attrs.update(self.attributes)
        return dataset

    def append(self, piece: Table) -> None:
        """Add the rows of one more piece."""
        self._extend(piece.wide(self.name))


class _TextColumn(_Column):
    """A text column: UTF-8 of fixed length, which every HDF5 tool reads; made wider when a longer text comes."""

    def _made(self, name: str, dtype: Any) -> Any:
        import h5py

        self.width = getattr(self, "width", _NARROWEST)
        return super()._made(name, h5py.string_dtype("utf-8", self.width))

    def append(self, piece: Table) -> None:
        """Add the rows of one more piece."""
        labels = [label.encode("utf-8", "replace") for label in piece.labels.get(self.name, ())]
        longest = max((len(label) for label in labels), default=0)
        if longest > at.MAX_TEXT_BYTES:
            shown = one_line(max(labels, key=len).decode("utf-8", "replace"), 40)
            raise InputError(
                f"{one_line(self.group.attrs['source'])}: a text of {self.name} has {longest} bytes ('{shown}'); "
                f"an archive holds at most {at.MAX_TEXT_BYTES}"
            )
        if longest > self.width:
            self._widen(longest)
        table = np.array([*labels, b""], dtype=self.dataset.dtype)
        codes = piece.codes(self.name)
        for start in range(0, len(codes), CHUNK):
            self._extend(table[codes[start : start + CHUNK]])

    def _widen(self, longest: int) -> None:
        while self.width < longest:
            self.width *= 2
        old = self.dataset
        self.group.move(self.name, f"{self.name}.narrow")
        self.dataset = self._made(self.name, None)
        for start in range(0, self.rows, CHUNK):
            self.dataset[start : start + CHUNK] = old[start : start + CHUNK]
        del self.group[f"{self.name}.narrow"]


def _write_meta(file: Any, trial: Trial, logs: Sequence[Mapping[str, Any]], sha256: Mapping[str, str]) -> None:
    meta = {
        "name": trial.name,
        "settings": without_nan(dataclasses.asdict(trial.settings)),
        "sources": [
            {"name": s.name, "format": s.format, "kind": s.kind, "size": s.size, "sha256": sha256[s.name]}
            for s in trial.sources
        ],
        "problems": [problem.as_dict() for problem in trial.problems],
        "logs": list(logs),
    }
    _write_text(file, at.META, _json(meta))
    found = gather([*trial.problems, *(_problem(p) for log in logs for _, p in log["problems"])])
    _write_table(
        file.create_group(at.PROBLEMS),
        {
            "where": [p.where for p in found],
            "reason": [p.reason for p in found],
            "count": [float(p.count) for p in found],
            "rejected": [float(p.rejected) for p in found],
            "examples": ["; ".join(p.examples) for p in found],
        },
    )


def _problem(data: Mapping[str, Any]) -> Problem:
    return Problem(data["where"], data["reason"], data["count"], tuple(data["examples"]), data["rejected"])


def _estimate_columns(results: Sequence[Result]) -> dict[str, list[Any]]:
    rows = [{"analysis": result.analysis, **row.as_row()} for result in results for row in result.rows]
    columns: dict[str, list[Any]] = {name: [row[name] for row in rows] for name in (rows[0] if rows else {})
                                     if name != "flags" and all(name in row for row in rows)}  # fmt: skip
    if rows:
        columns["flags"] = [" ".join(row["flags"]) for row in rows]
    return columns


def _write_table(group: Any, columns: Mapping[str, Sequence[Any]]) -> None:
    """Columns of numbers or texts as datasets of a group."""
    import h5py

    for name, values in columns.items():
        if not values:
            continue
        data: NDArray[Any]
        if all(v is None or isinstance(v, str) for v in values):
            cells = [(v or "").encode("utf-8", "replace")[: at.MAX_TEXT_BYTES] for v in values]
            width = max(1, *(len(cell) for cell in cells))
            dtype = h5py.string_dtype("utf-8", width)
            data = np.array(cells, dtype)
        else:
            data, dtype = np.array([np.nan if v is None else float(v) for v in values]), np.dtype("f8")
        group.create_dataset(name, data=data, dtype=dtype, chunks=(min(len(values), CHUNK),), **_STORED)


def _write_text(file: Any, name: str, text: str) -> None:
    """JSON as bytes: compressed and checked like every column, unlike HDF5's own long strings."""
    data = np.frombuffer(text.encode("utf-8"), np.uint8)
    file.create_dataset(name, data=data, chunks=(min(len(data), 1 << 20),), **_STORED)


def _attribute(text: str) -> str:
    return one_line(text, 1000)


def _json(value: object) -> str:
    return json.dumps(value, allow_nan=False, ensure_ascii=False)
