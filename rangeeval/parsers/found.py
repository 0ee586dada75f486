"""From what a child process has found in a file to its logs: what formats of several tables and arrays share.

The child says in plain values what the file holds. `tables`: each a `path`, its `stage`, and `columns` with a `name`,
their number of `rows`, and a `kind` (number, text or other); it may be `of_matrix` (named by its place only) or
`single` (one value for all rows). `arrays`: samples of an array, see `samples.among`, with their `time`, what is `said`
of the array, and whether they are `likely` samples. `notes`: what is to be known of the file.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rangeeval.errors import InputError, one_line
from rangeeval.model import Log, Problem
from rangeeval.parsers import samples
from rangeeval.parsers.blocks import Contents, Reader, SourceFile, Written, log_from
from rangeeval.parsers.columns import known, lay_out, no_column, plain

Described = Mapping[str, Any]
TableReader = Callable[[str, Described, Sequence[Described]], Reader]
ArrayReader = Callable[[str, Described], samples.Opened]


def contents(
    file: SourceFile,
    looked: Described,
    reader: TableReader,
    opened: ArrayReader,
    nothing: str,
) -> Contents:
    """The logs of a file: every table that has the columns of one, and the samples of every array.

    `reader(where, table, usable columns)` and `opened(where, array)` read what the child found; `nothing` says what
    there is where no log is. Raises InputError and SettingsError for what cannot be used.
    """
    problems = [Problem(file.name, text) for text in looked["notes"]]
    arrays = [found for found in looked["arrays"] if found["likely"] or file.of_array]
    logs = [_snapshots(file, found, opened) for found in arrays]
    names = [column["name"] for table in looked["tables"] for column in table["columns"]]
    for written in file.columns:
        if names and plain(written) not in map(plain, names):
            raise no_column(written, _shown_names(looked), file.name)
    for table in looked["tables"]:
        if any(found["path"] == table["path"] for found in arrays) and _only_times(table):
            continue
        try:
            log, found = _table(file, table, reader)
        except InputError as error:
            # What could not be looked at may be what is missing.
            raise InputError("; ".join([str(error), *looked["notes"][:1]])) from None
        if log is not None:
            logs.append(log)
            problems += found
    return Contents(tuple(logs), tuple(problems)) if logs else Contents(unrecognised=nothing)


def _where(file: SourceFile, path: str) -> str:
    return f"{file.name}:{one_line(path, 100)}" if path.strip("/") else file.name


def _only_times(table: Described) -> bool:
    return all(c["name"].casefold() in samples.TIMES for c in table["columns"])


def _shown_names(looked: Described) -> list[str]:
    return [c["name"] for table in looked["tables"] for c in table["columns"] if not c.get("of_matrix")]


def _table(file: SourceFile, table: Described, reader: TableReader) -> tuple[Log | None, list[Problem]]:
    """The log of one table, or None, and what is not read of it."""
    where = _where(file, table["path"])
    given = {plain(written) for written in file.columns}

    def meant(column: Described) -> bool:
        return bool(known([column["name"]])) or plain(column["name"]) in given

    # The columns of a matrix have no name but their place, so only trial.toml makes them columns of a log.
    columns = [c for c in table["columns"] if not c.get("of_matrix") or plain(c["name"]) in given]
    usable = [c for c in columns if c["kind"] in {"number", "text"}]
    # What is no column of a log is worth a word of its own only where it is as long as one, and no other is called so.
    lengths = {c["rows"] for c in usable if meant(c)} or {c["rows"] for c in usable}
    times = Counter(plain(c["name"]) for c in usable)
    usable = [
        c for c in usable
        if meant(c) or (c["rows"] in lengths and not c.get("single") and times[plain(c["name"])] == 1)
    ]  # fmt: skip
    if file.kind is not None and not any(map(meant, usable)):
        return None, []
    names = tuple(c["name"] for c in usable)
    here = {plain(name) for name in names}
    renamed = {written: name for written, name in file.columns.items() if plain(written) in here}
    layout = lay_out(names, where, file.kind, renamed)
    if layout is None:
        return None, []
    problems = list(layout.problems)
    written = Written(
        where,
        names,
        reader(where, table, usable),
        lambda row: f"{where}[{row}]",
        lengths=tuple(c["rows"] for c in usable),
        stage=table["stage"],
    )
    if unread := sorted({c["name"] for c in columns} - set(names)):
        shown = ", ".join(one_line(name, 60) for name in unread[:10])
        why = "columns that are neither numbers nor text, or of another length, are not read"
        problems.append(Problem(where, f"{why}: {shown}"))
    return log_from(written, layout, file), problems


def _snapshots(file: SourceFile, found: Described, opened: ArrayReader) -> Log:
    """The log of an array's samples. Raises InputError for times of another length."""
    where = _where(file, found["path"])
    if found["time"] and found["time_rows"] != found["rows"]:
        raise InputError(
            f"{where}: columns of different lengths: {samples.shown(found['time'])} {found['time_rows']}, "
            f"{samples.shown(found['name'])} {found['rows']}"
        )
    said = samples.said_of(found["said"], where)
    name = samples.shown(found["name"])
    recorded = samples.Recorded(where, found["rows"], found["sensors"], opened(where, found), said, found["time"], name)
    return samples.snapshots_log(recorded, file)
