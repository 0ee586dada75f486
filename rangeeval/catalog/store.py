"""The SQLite file: which files are indexed, and every estimate in them, by what it is an estimate of.

It holds nothing that is not in the archives and results it was made from. Each file is added in a transaction of its
own, in write-ahead mode: a kill leaves all of a file's estimates in it or none, and readers are never kept waiting.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rangeeval.catalog.terms import Terms
from rangeeval.errors import InputError, one_line
from rangeeval.model import Estimate, Result
from rangeeval.model.identity import trial_hash_of
from rangeeval.model.result import COLUMNS, without_nan

APPLICATION = 0x52455643  # "REVC": tells our file from any other SQLite database
LAYOUT = 1
_PATIENCE_SECONDS = 60.0  # for another process to finish writing

_SCHEMA = """
CREATE TABLE result (
    id INTEGER PRIMARY KEY, sha256 TEXT NOT NULL UNIQUE, inputs TEXT NOT NULL, path TEXT NOT NULL, form TEXT NOT NULL,
    name TEXT NOT NULL, date TEXT NOT NULL, radar TEXT NOT NULL, software TEXT NOT NULL, handling TEXT NOT NULL,
    version TEXT NOT NULL, analyses TEXT NOT NULL, estimates INTEGER NOT NULL, bytes INTEGER NOT NULL
);
CREATE INDEX result_of_inputs ON result (inputs);
CREATE INDEX result_of_path ON result (path);
CREATE TABLE what (
    id INTEGER PRIMARY KEY, analysis TEXT NOT NULL, quantity TEXT NOT NULL, unit TEXT NOT NULL, variable TEXT,
    bin_low REAL, bin_high REAL, track_id TEXT, grp TEXT
);
CREATE UNIQUE INDEX what_once ON what (
    analysis, quantity, unit, ifnull(variable, ''), ifnull(bin_low, 1e999), ifnull(bin_high, 1e999),
    ifnull(track_id, char(0)), ifnull(grp, char(0))
);
CREATE TABLE estimate (
    what INTEGER NOT NULL REFERENCES what, result INTEGER NOT NULL REFERENCES result ON DELETE CASCADE,
    position INTEGER NOT NULL, confidence REAL, n INTEGER, n_eff REAL, value REAL, low REAL, high REAL,
    flags TEXT NOT NULL, extra TEXT, PRIMARY KEY (what, result, position)
) WITHOUT ROWID;
CREATE INDEX estimate_of_result ON estimate (result, position);
CREATE VIEW estimates AS
    SELECT result.name AS trial, result.date, result.radar, result.software, result.path, what.analysis, what.track_id,
        what.grp AS "group", what.variable, what.bin_low, what.bin_high, what.quantity, what.unit, estimate.n,
        estimate.n_eff, estimate.value, estimate.low, estimate.high, estimate.confidence, estimate.flags
    FROM estimate JOIN result ON result.id = estimate.result JOIN what ON what.id = estimate.what;
"""


@dataclass(frozen=True)
class Entry:
    """A file to index: its SHA-256, where it is, `archive` or `results`, its size, and the results in it."""

    sha256: str
    path: str
    form: str
    size: int
    results: tuple[Result, ...]


@dataclass(frozen=True)
class Added:
    """What came of a file: `added`, `known` (the same content is there), `moved` (known, its old place is empty), or
    `replaced` (another content was known at this place). `same`: an indexed file of the same trial.
    """

    path: str
    status: str
    same: str = ""


@dataclass(frozen=True)
class Found:
    """One indexed file; `id` is its number in this catalogue."""

    id: int
    sha256: str
    inputs: str
    path: str
    form: str
    name: str
    date: str
    radar: str
    software: str
    handling: str
    version: str
    analyses: str
    estimates: int
    bytes: int

    def as_row(self) -> dict[str, Any]:
        """What a table shows."""
        return {k: v for k, v in self.__dict__.items() if k not in {"id", "inputs", "bytes"}}


@dataclass(frozen=True)
class Indexed:
    """An estimate with the file it is from, its analysis, and the confidence of its interval."""

    result: Found
    analysis: str
    confidence: float
    estimate: Estimate

    def as_row(self) -> dict[str, Any]:
        """The trial's columns, those of the contract, and as JSON what an analysis adds to them."""
        about = {"trial": self.result.name, "date": self.result.date, "radar": self.result.radar}
        about |= {"software": self.result.software, "sha256": self.result.sha256, "analysis": self.analysis}
        row = {**about, **replace(self.estimate, extra={}).as_row(), "confidence": self.confidence}
        extra = json.dumps(without_nan(self.estimate.extra), ensure_ascii=False) if self.estimate.extra else None
        return {**row, "flags": " ".join(self.estimate.flags), "extra": extra}


@contextlib.contextmanager
def open_catalog(path: str | os.PathLike[str], *, create: bool = False) -> Iterator[Catalog]:
    """The catalogue in a file, made when it is not there and `create` says so; `:memory:` for one that is not kept.

    Raises InputError for a file that is no catalogue, is damaged, or is of a newer layout.
    """
    where = one_line(path)
    if str(path) != ":memory:" and not create and not Path(path).is_file():
        raise InputError(f"{where}: no catalogue there; 'rangeeval catalog add DIR' makes one")
    with _told(where):
        connection = sqlite3.connect(path, timeout=_PATIENCE_SECONDS, isolation_level=None)
    try:
        with _told(where):
            _prepare(connection, where)
        yield Catalog(connection, where)
    finally:
        connection.close()


def _prepare(connection: sqlite3.Connection, where: str) -> None:
    """Check whose file it is before anything else is asked of it; make the tables where there are none."""
    connection.execute("PRAGMA trusted_schema = OFF")
    connection.execute("PRAGMA cell_size_check = ON")
    application, layout = _marks(connection)
    if not application and not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
        connection.execute("PRAGMA journal_mode = WAL")  # a share that cannot keeps a rollback journal: as safe, slower
        connection.execute("PRAGMA synchronous = FULL")
        connection.execute("BEGIN IMMEDIATE")
        if _marks(connection) == (0, 0):  # else another process was first
            for statement in _SCHEMA.split(";\n"):
                connection.execute(statement)
            connection.execute(f"PRAGMA application_id = {APPLICATION}")
            connection.execute(f"PRAGMA user_version = {LAYOUT}")
        connection.execute("COMMIT")
        application, layout = _marks(connection)
    if application != APPLICATION:
        raise InputError(f"{where}: a database, but not a catalogue of rangeeval; give another file with --catalog")
    if layout != LAYOUT:
        raise InputError(
            f"{where}: a catalogue of layout {layout}, this version reads layout {LAYOUT}; it is only an index: "
            "give another file with --catalog and add the archives to it"
        )
    connection.execute("PRAGMA synchronous = FULL")  # what was said to be added survives a power cut too
    connection.execute("PRAGMA foreign_keys = ON")


def _marks(connection: sqlite3.Connection) -> tuple[int, int]:
    application = connection.execute("PRAGMA application_id").fetchone()[0]
    return int(application), int(connection.execute("PRAGMA user_version").fetchone()[0])


@contextlib.contextmanager
def _told(where: str) -> Iterator[None]:
    """What SQLite raises, as one line."""
    try:
        yield
    except sqlite3.OperationalError as error:
        if "locked" in str(error):
            raise InputError(f"{where}: another process is writing to the catalogue; try again") from error
        raise InputError(f"{where}: the catalogue cannot be used ({one_line(error, 100)})") from error
    except (sqlite3.Error, TypeError, ValueError) as error:
        raise InputError(
            f"{where}: not a catalogue, or a damaged one ({one_line(error, 100)}); it is only an index: move it away "
            "and 'rangeeval catalog add' the archives again"
        ) from error


class Catalog:
    """An open catalogue. Every method raises InputError when the file turns out damaged or cannot be written."""

    def __init__(self, connection: sqlite3.Connection, where: str) -> None:
        self._connection = connection
        self.where = where
        self._whats: dict[tuple[Any, ...], int] = {}

    def knows(self, sha256: str) -> str | None:
        """The path under which a content is indexed."""
        with _told(self.where):
            row = self._connection.execute("SELECT path FROM result WHERE sha256 = ?", (sha256,)).fetchone()
        return None if row is None else str(row[0])

    def move(self, sha256: str, path: str) -> None:
        """The same content is at another place now."""
        with self._change() as connection:
            connection.execute("UPDATE result SET path = ? WHERE sha256 = ?", (path, sha256))

    def add(self, entry: Entry) -> Added:
        """Index a file, all of it or nothing."""
        with self._change() as connection:
            return self._add(connection, entry)

    def rebuild(self, entries: Iterable[Entry]) -> list[Added]:
        """Forget everything and index these files instead; a kill leaves the old index."""
        with self._change() as connection:
            for table in ("estimate", "result", "what"):
                connection.execute(f"DELETE FROM {table}")
            self._whats.clear()
            return [self._add(connection, entry) for entry in entries]

    @contextlib.contextmanager
    def _change(self) -> Iterator[sqlite3.Connection]:
        with _told(self.where):
            self._connection.execute("BEGIN IMMEDIATE")
            try:
                yield self._connection
                self._connection.execute("COMMIT")
            except BaseException:
                self._whats.clear()
                with contextlib.suppress(sqlite3.Error):
                    self._connection.execute("ROLLBACK")
                raise

    def _add(self, connection: sqlite3.Connection, entry: Entry) -> Added:
        if known := connection.execute("SELECT path FROM result WHERE sha256 = ?", (entry.sha256,)).fetchone():
            return Added(entry.path, "known", str(known[0]))
        replaced = connection.execute("DELETE FROM result WHERE path = ?", (entry.path,)).rowcount
        provenance = entry.results[0].provenance if entry.results else {}
        about = provenance.get("trial", {})
        inputs = trial_hash_of(provenance)
        same = connection.execute("SELECT path FROM result WHERE inputs = ? AND inputs != ''", (inputs,)).fetchone()
        words = [str(about.get(key) or "") for key in ("name", "date", "radar", "software", "handling")]
        cursor = connection.execute(
            "INSERT INTO result (sha256, inputs, path, form, name, date, radar, software, handling, version, analyses, "
            "estimates, bytes) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (
                entry.sha256, inputs, entry.path, entry.form, *words,
                str(provenance.get("versions", {}).get("rangeeval") or ""),
                " ".join(result.analysis for result in entry.results),
                sum(len(result.rows) for result in entry.results), entry.size,
            ),
        )  # fmt: skip
        connection.executemany(
            "INSERT INTO estimate VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            self._estimates(connection, int(cursor.lastrowid or 0), entry.results),
        )
        return Added(entry.path, "replaced" if replaced else "added", str(same[0]) if same else "")

    def _estimates(
        self, connection: sqlite3.Connection, number: int, results: Sequence[Result]
    ) -> Iterator[tuple[Any, ...]]:
        position = 0
        for result in results:
            confidence = result.settings.get("confidence")
            stated = float(confidence) if isinstance(confidence, (int, float)) else None
            for row in result.rows:
                what = self._what(connection, result.analysis, row)
                extra = json.dumps(without_nan(row.extra), ensure_ascii=False) if row.extra else None
                yield (
                    what, number, position, stated, row.n, row.n_eff, row.value, row.low, row.high,
                    " ".join(row.flags), extra,
                )  # fmt: skip
                position += 1

    def _what(self, connection: sqlite3.Connection, analysis: str, row: Estimate) -> int:
        """The number of what a row is an estimate of."""
        edges = [None if math.isnan(edge) else edge for edge in (row.bin_low, row.bin_high)]
        key = (analysis, row.quantity, row.unit, row.variable, *edges, row.track_id, row.group)
        if key not in self._whats:
            columns = ("analysis", "quantity", "unit", "variable", "bin_low", "bin_high", "track_id", "grp")
            connection.execute(
                f"INSERT OR IGNORE INTO what ({', '.join(columns)}) VALUES ({', '.join('?' * len(columns))})", key
            )
            found = connection.execute(
                f"SELECT id FROM what WHERE {' AND '.join(f'{column} IS ?' for column in columns)}", key
            )
            self._whats[key] = int(found.fetchone()[0])
        return self._whats[key]

    def results(self, terms: Terms | None = None) -> list[Found]:
        """The indexed files, by date and name; those that hold what the terms say."""
        terms = terms or Terms()
        where, values = terms.of_result
        held, more = terms.of_what
        if more:
            where += (
                f" AND EXISTS (SELECT 1 FROM what JOIN estimate ON estimate.what = what.id WHERE {held} "
                "AND estimate.result = result.id)"
            )
        columns = ", ".join(f"result.{name}" for name in Found.__dataclass_fields__)
        with _told(self.where):
            rows = self._connection.execute(
                f"SELECT {columns} FROM result WHERE {where} ORDER BY date = '', date, name, path", (*values, *more)
            )
            return [Found(*row) for row in rows]

    def estimates(self, terms: Terms | None = None) -> Iterator[Indexed]:
        """The estimates that the terms leave, trial by trial, in the order of their results."""
        terms = terms or Terms()
        held, values = terms.of_what
        chosen = f"estimate.what IN (SELECT id FROM what WHERE {held}) AND " if values else ""
        for result in self.results(terms):
            condition = f"WHERE {chosen}estimate.result = ? ORDER BY position"
            yield from (_indexed(result, row) for row in self._rows(condition, (*values, result.id)))

    def series(self, terms: Terms | None = None) -> Iterator[list[Indexed]]:
        """For each thing that the terms leave (a quantity in a bin, of a group or track), its estimates by date."""
        terms = terms or Terms()
        results = {result.id: result for result in self.results(terms)}
        order = {number: place for place, number in enumerate(results)}
        held, values = terms.of_what
        with _told(self.where):
            numbers = self._connection.execute(
                f"SELECT id FROM what WHERE {held} ORDER BY analysis, quantity, grp IS NOT NULL, grp, "
                "track_id IS NOT NULL, track_id, variable, bin_low",
                values,
            ).fetchall()
        for (number,) in numbers:
            rows = [row for row in self._rows("WHERE estimate.what = ?", (number,)) if row[0] in results]
            if rows:
                yield [_indexed(results[row[0]], row) for row in sorted(rows, key=lambda row: order[row[0]])]

    def _rows(self, condition: str, values: tuple[Any, ...]) -> Iterator[tuple[Any, ...]]:
        with _told(self.where):
            yield from self._connection.execute(
                "SELECT result, analysis, confidence, track_id, grp, variable, bin_low, bin_high, quantity, unit, n, "
                f"n_eff, value, low, high, flags, extra FROM estimate JOIN what ON what.id = estimate.what {condition}",
                values,
            )

    def check(self) -> None:
        """Look at every page of the file. Raises InputError when one is damaged."""
        with _told(self.where):
            said = [str(row[0]) for row in self._connection.execute("PRAGMA integrity_check")]
            said += [f"a row of {row[0]} belongs to nothing" for row in
                     self._connection.execute("PRAGMA foreign_key_check")]  # fmt: skip
            if said != ["ok"]:
                raise ValueError(said[0])


def _indexed(result: Found, row: Sequence[Any]) -> Indexed:
    _, analysis, confidence, *cells, flags, extra = row
    values: Mapping[str, Any] = dict(zip(COLUMNS[:-1], (_tracked(cells)), strict=True))
    estimate = Estimate(**values, flags=tuple(flags.split()), extra=json.loads(extra) if extra else {})
    return Indexed(result, analysis, _number(confidence), estimate)


def _tracked(cells: Sequence[Any]) -> list[Any]:
    """The cells in the contract's order, missing numbers as NaN."""
    track, group, variable, low_edge, high_edge, quantity, unit, n, *numbers = cells
    edges = [_number(low_edge), _number(high_edge)]
    return [track, group, variable, *edges, quantity, unit, n, *(_number(value) for value in numbers)]


def _number(value: Any) -> float:
    return math.nan if value is None else float(value)
