"""Archives read back: as a trial whose logs stream like any other, as the results stored in it, and as a verdict.

An archive is looked into by a child process first, like every HDF5 file (`parsers.hdf5`): links, external storage,
virtual datasets and foreign filters are refused. Nothing in it is ever unpickled.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from rangeeval.errors import InputError, one_line
from rangeeval.model import (
    CHUNK_ROWS,
    KINDS,
    Log,
    Problem,
    Result,
    Source,
    Table,
    Trial,
    TrialSettings,
    piece_rows,
    settings_from,
)
from rangeeval.model import layout as at
from rangeeval.parsers import hdf5, safe
from rangeeval.parsers.labels import Labels

_LARGEST_META = 32 << 20
_LARGEST_RESULTS = 1 << 30


def recognises(head: bytes) -> bool:
    """The header that every archive begins with."""
    return head.startswith(at.MAGIC)


def is_archive(path: Path) -> bool:
    """Whether the file at this path begins like an archive."""
    try:
        with path.open("rb") as stream:
            return recognises(stream.read(len(at.MAGIC)))
    except OSError:
        return False


def header_of(path: str | os.PathLike[str]) -> at.Header:
    """The header of an archive. Raises InputError for what is none, of another version, damaged or cut off."""
    where = one_line(Path(path).name)
    try:
        with open(path, "rb") as stream:
            head = stream.read(at.HEADER_BYTES)
            size = stream.seek(0, os.SEEK_END)
    except OSError as error:
        raise InputError(f"{one_line(path)}: cannot be read ({error.strerror})") from None
    header = at.read_header(head, where)
    if size != header.size:
        what = "cut off" if size < header.size else "damaged"
        raise InputError(f"{where}: the archive is {what}: it has {size:,} bytes, its header says {header.size:,}")
    return header


def open_archive(path: str | os.PathLike[str], settings: TrialSettings | None = None) -> Trial:
    """The trial in an archive; its sources are the files it was made from, with their SHA-256.

    `settings` replaces the archived ones. Raises InputError for what is no archive, damaged, or of another version.
    """
    where = one_line(Path(path).name)
    header_of(path)
    looked = safe.call(__name__, "look", str(path), where)
    try:
        meta = json.loads(looked["meta"])
        stored = _without_none(meta["settings"])
        logs = tuple(_log(Path(path), entry, looked["columns"], where) for entry in meta["logs"])
        if settings is not None:
            logs = tuple(replace(g, array=settings.array.over(g.array)) if g.array else g for g in logs)
        sources = tuple(
            Source(s["name"], str(path), s["format"], s["kind"], int(s["size"]), str(s["sha256"]))
            for s in meta["sources"]
        )
        problems = tuple(_problem(p) for p in meta["problems"])
        name = str(meta["name"])
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise InputError(
            f"{where}: the archive is damaged: its description cannot be read ({one_line(error, 100)})"
        ) from None
    return Trial(name, logs, settings or settings_from(stored, f"{where}: settings"), sources, problems)


def archived_results(path: str | os.PathLike[str]) -> list[Result]:
    """The results stored in an archive. Raises InputError for what is no archive, damaged, or of another version."""
    where = one_line(Path(path).name)
    header_of(path)
    looked = safe.call(__name__, "look", str(path), where)
    if at.RESULTS not in looked["texts"]:
        raise InputError(f"{where}: the archive is damaged: it has no {at.RESULTS}")
    try:
        data = json.loads(_text(path, at.RESULTS, _LARGEST_RESULTS))
    except (ValueError, RecursionError, OSError, RuntimeError) as error:
        raise InputError(
            f"{where}: the archive is damaged: its results cannot be read ({one_line(error, 100)})"
        ) from None
    if not isinstance(data, list):
        raise InputError(f"{where}: the archive is damaged: its results are no list")
    return [Result.from_dict(item, f"{where}[{i}]") for i, item in enumerate(data)]


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _without_none(v) for k, v in value.items() if v is not None}
    return [_without_none(v) for v in value] if isinstance(value, list) else value


def _problem(data: Mapping[str, Any]) -> Problem:
    examples = tuple(str(e) for e in data["examples"])
    return Problem(str(data["where"]), str(data["reason"]), int(data["count"]), examples, bool(data["rejected"]))


def _log(path: Path, entry: Mapping[str, Any], held: Mapping[str, Any], where: str) -> Log:
    kind, group, rows = str(entry["kind"]), f"/{at.LOGS}/{entry['group']}", int(entry["rows"])
    if kind not in KINDS:
        raise InputError(f"{where}: holds a log of kind '{one_line(kind, 40)}', which this version does not know")
    if entry["stage"] not in {"predicted", "updated"}:
        raise InputError(f"{where}: the archive is damaged: residual_stage is '{one_line(entry['stage'], 40)}'")
    columns = tuple(str(name) for name in entry["columns"])
    text = frozenset(entry["text"])
    for name in columns:
        if name not in KINDS[kind].names:
            raise InputError(f"{where}: the archive is damaged: '{one_line(name, 60)}' is no column of a {kind} log")
        stored = held.get(f"{group}/{name}")
        wide = KINDS[kind].column(name).wide
        wanted = ("real", "complex") if wide else ("text",) if name in text else ("number",)
        if stored is None or stored["rows"] != rows or stored["kind"] not in wanted:
            raise InputError(
                f"{where}: the archive is damaged: {one_line(group)}/{name} should hold {rows} rows of {wanted[0]}s"
            )
    problems: dict[int, list[Problem]] = {}
    for number, problem in entry["problems"]:
        problems.setdefault(int(number), []).append(_problem(problem))
    size = piece_rows(int(entry.get("width", 1)))
    stored_log = _Stored(path, where, group, rows, columns, text, {k: tuple(v) for k, v in problems.items()}, size)
    written = {str(k): str(v) for k, v in entry["written"].items()}
    array = None
    if "array" in entry:
        said = {"array": _without_none(entry["array"])}
        array = settings_from(said, f"{where}: the archive is damaged: array").array
    return Log(kind, str(entry["source"]), columns, stored_log.pieces, rows, entry["stage"], written, array)


@dataclass(frozen=True)
class _Stored:
    """A log as an archive holds it: columns of a group, and the problems that its parser met in each piece."""

    path: Path
    where: str
    group: str
    rows: int
    columns: tuple[str, ...]
    text: frozenset[str]
    problems: Mapping[int, tuple[Problem, ...]] = field(default_factory=dict)
    size: int = CHUNK_ROWS

    def pieces(self, names: Collection[str] | None = None) -> Iterator[Table]:
        """The log piece by piece, the pieces it was archived from."""
        import h5py

        chosen = [n for n in self.columns if names is None or n in names]
        # A piece without columns would not know its length.
        chosen = chosen or [n for n in self.columns if n not in self.text][:1]
        labels = {name: Labels() for name in chosen if name in self.text}
        try:
            with hdf5.open_file(h5py, self.path) as file:
                for number, start in enumerate(range(0, max(self.rows, 1), self.size)):
                    stop = min(self.rows, start + self.size)
                    try:
                        data = {name: file[f"{self.group}/{name}"][start:stop] for name in chosen}
                    except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:
                        raise InputError(
                            f"{self.where}: rows {start} to {stop - 1} of {self.group} cannot be read, the archive is "
                            f"damaged ({one_line(error, 120)})"
                        ) from error
                    columns: dict[str, Any] = {
                        name: labels[name].code(values)
                        if name in labels
                        else np.asarray(values, np.complex128 if values.dtype.kind == "c" else np.float64)
                        for name, values in data.items()
                    }
                    texts = {name: coder.labels for name, coder in labels.items()}
                    yield Table(columns, texts, start, self.problems.get(number, ()))
        except (OSError, RuntimeError) as error:
            raise InputError(f"{self.where}: cannot be opened ({one_line(error, 120)})") from error


# --- verify ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Verified:
    """What was found in a whole archive."""

    path: str
    layout: int
    size: int
    sha256: str
    name: str
    logs: int
    rows: int
    sources: int
    results: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**self.__dict__, "results": list(self.results), "whole": True}


def verify(path: str | os.PathLike[str]) -> Verified:
    """Check an archive: every byte against its SHA-256, the structure, every row of every log, the results.

    Raises InputError that names the first thing found wrong.
    """
    where = one_line(Path(path).name)
    header = header_of(path)
    with open(path, "rb") as stream:
        stream.seek(at.HEADER_BYTES)
        found = hashlib.file_digest(stream, "sha256").hexdigest()
    if found != header.sha256:
        raise InputError(f"{where}: the archive is damaged: its SHA-256 is {found}, its header says {header.sha256}")
    trial = open_archive(path)
    rows = sum(len(piece) for log in trial.logs for piece in log.pieces(None))
    results = archived_results(path)
    return Verified(
        str(path), header.version, header.size, found, trial.title, len(trial.logs), rows, len(trial.sources),
        tuple(result.analysis for result in results),
    )  # fmt: skip


# --- in the child ----------------------------------------------------------------------------------------------------


def look(path: str) -> dict[str, Any]:
    """The description in an archive and the columns it has, as plain values. Raises InputError for what is refused."""
    looked = hdf5.audit(path)
    if looked["notes"]:
        raise InputError(f"the archive is not one that rangeeval wrote: {looked['notes'][0]}")
    columns: dict[str, dict[str, Any]] = {}
    for table in looked["tables"]:
        if table["form"] != "group":
            shown = one_line(table["path"], 100)
            raise InputError(f"the archive is not one that rangeeval wrote: '{shown}' is a table")
        for column in table["columns"]:
            if column["kind"] not in {"number", "text"}:
                shown = one_line(column["path"], 100)
                raise InputError(f"'{shown}' holds objects that are neither numbers nor text; such files are not read")
            columns[column["path"]] = {"rows": column["rows"], "kind": column["kind"]}
    for found in looked["arrays"]:
        (path_,) = found["datasets"]
        columns[path_] = {"rows": found["rows"], "kind": found["kind"]}
    if f"/{at.META}" not in columns:
        raise InputError(f"the archive is damaged: it has no {at.META}")
    texts = [name for name in (at.META, at.RESULTS) if f"/{name}" in columns]
    return {"meta": _text(path, at.META, _LARGEST_META), "columns": columns, "texts": texts}


def _text(path: str | os.PathLike[str], name: str, largest: int) -> str:
    import h5py

    with hdf5.open_file(h5py, Path(path)) as file:
        dataset = file[name]
        if dataset.ndim != 1 or dataset.dtype != np.uint8 or dataset.shape[0] > largest:
            raise InputError(f"the archive is damaged: {name} is not text of at most {largest} bytes")
        try:
            return bytes(dataset[()]).decode("utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"the archive is damaged: {name} cannot be read ({one_line(error, 100)})") from None


__all__ = [
    "Verified", "archived_results", "header_of", "is_archive", "open_archive", "recognises", "verify",
]  # fmt: skip
