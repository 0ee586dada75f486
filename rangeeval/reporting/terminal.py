"""Results on a terminal: the same tables as the report, as text."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from typing import IO, Any

from rangeeval.errors import one_line
from rangeeval.model import Estimate, Result
from rangeeval.reporting.blocks import Cell, Table
from rangeeval.reporting.layouts import heading, own
from rangeeval.reporting.tables import headline_table, short_tables
from rangeeval.reporting.wording import NBSP

_WIDE = 200  # columns when the output is no terminal


def as_text(result: Result, stream: IO[str] | None = None) -> str:
    """The result's short table as text, in colour when `stream` is a terminal, and what must be said beside it."""
    note: str = own(result.analysis, "NOTE", "")
    tables = short_tables(result, heading(result.analysis))
    return "\n".join(text_of(table, stream) for table in tables) + note.format(**result.settings) + "\n"


def text_of(table: Table, stream: IO[str] | None = None) -> str:
    """A table as text. Every cell is printed as plain text: nothing in a log can colour or clear a terminal."""
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text

    terminal = stream is not None and stream.isatty()
    console = Console(
        file=io.StringIO(),
        force_terminal=terminal,
        width=None if terminal else _WIDE,
        no_color=not terminal,
        soft_wrap=False,
    )
    rich = RichTable(
        title=Text(one_line(table.caption)), title_justify="left", box=None, pad_edge=False, header_style="bold"
    )
    sides = {"l": "left", "r": "right", "c": "center"}
    for head, align in zip(table.head, table.alignment, strict=True):
        rich.add_column(Text(one_line(head)), justify=sides[align])  # type: ignore[arg-type]
    colour = {"pass": "green", "better": "green", "fail": "red", "worse": "red", "inconclusive": "yellow"}
    for row in table.rows:
        cells = [c if isinstance(c, Cell) else Cell(c) for c in row]
        rich.add_row(*(Text(_plain(f"{c.verdict} {c.text}".strip()), style=colour.get(c.verdict, "")) for c in cells))
    console.print(rich)
    text: str = console.file.getvalue()  # type: ignore[attr-defined]
    return "\n".join(line.rstrip() for line in text.splitlines()) + "\n"


def _plain(text: str) -> str:
    return one_line(text.replace(NBSP, " "))


def outcomes_text(directory: str, outcomes: Sequence[Any], stream: IO[str] | None = None) -> str:
    """What came of many trials: how many were done, kept and failed, and why each failed."""
    counts = {status: sum(o.status == status for o in outcomes) for status in ("done", "kept", "failed")}
    rows = [[status, str(count)] for status, count in counts.items() if count]
    text = f"Results in {one_line(directory)}\n" + text_of(Table("", ["", "Trials"], rows, "lr"), stream)
    failed = [[o.path, o.why] for o in outcomes if o.status == "failed"]
    return text + (text_of(Table("", ["Failed", "Why"], failed, "ll"), stream) if failed else "")


def catalog_text(rows: Sequence[Mapping[str, Any]], stream: IO[str] | None = None) -> str:
    """The trials of a catalogue."""
    columns = ("date", "radar", "software", "name", "analyses", "estimates", "sha256", "path")
    cells = [[str(row[name])[: 12 if name == "sha256" else None] for name in columns] for row in rows]
    head = ["Date", "Radar", "Software", "Trial", "Analyses", "Estimates", "SHA-256", "File"]
    return text_of(Table(f"{len(rows)} trials", head, cells, "lllllrll"), stream)


def estimates_text(title: str, rows: Iterable[tuple[str, Estimate]], stream: IO[str] | None = None) -> str:
    """The estimates of a trial, given with their analysis: the short table of each."""
    by_analysis: dict[str, list[Estimate]] = {}
    for analysis, row in rows:
        by_analysis.setdefault(analysis, []).append(row)
    tables = [
        headline_table(Result(analysis, tuple(found)), caption=f"{title}: {heading(analysis)}")
        for analysis, found in by_analysis.items()
    ]
    return "".join(text_of(table, stream) for table in tables)


def inspection_text(found: Sequence[Mapping[str, Any]], stream: IO[str] | None = None) -> str:
    """What `inspect` found (its plain form), a block a file: kind, format, rows, span, gaps, columns, rejects."""
    return "\n".join(_inspected(item, stream) for item in found)


def _fact(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.9g}"
    if isinstance(value, (list, tuple)):
        shown = [f"({', '.join(map(_fact, v))})" if isinstance(v, (list, tuple)) else _fact(v) for v in value]
        return ", ".join(shown[:8]) + (f", ... ({len(shown)})" if len(shown) > 8 else "")
    return str(value)


def _inspected(item: Mapping[str, Any], stream: IO[str] | None) -> str:
    first, last = item["first_time_s"], item["last_time_s"]
    span = "no times" if first is None else f"{first:g} to {last:g} s ({last - first:g} s)"
    largest = item["largest_gap_s"]
    gaps = f"{item['gaps']}, the largest {largest:g} s" if item["gaps"] and largest is not None else str(item["gaps"])
    stage = f", residuals {item['stage']}" if item["kind"] == "residuals" else ""
    facts = [
        ["log", f"{item['kind']}{stage}"],
        ["format", f"{item['format']}, {item['size']:,} bytes"],
        ["SHA-256", item["sha256"]],
        ["rows", f"{item['rows']:,} used, {item['rejected']:,} set aside"],
        ["tracks", str(item["tracks"])],
        ["time", span],
        ["gaps", gaps],
    ]
    facts += [[name.replace("_", " "), _fact(value)] for name, value in (item.get("array") or {}).items()]
    columns = []
    for c in item["columns"]:
        missing = f"{c['missing']:,} missing" if c["missing"] else ""
        columns.append([c["written"], c["stored"] if c["stored"] != c["written"] else "", missing])
    inside = item["source"].partition(":")[2]
    title = f"{item['file']}:{inside}" if inside else item["file"]
    text = text_of(Table(title, ["", ""], facts, "ll"), stream)
    text += text_of(Table("", ["Column", "Stored as", ""], columns, "lll"), stream)
    for problem in item["problems"]:
        count = problem["count"]
        rows = f" ({count} row{'s' if count != 1 else ''})" if count else ""
        text += one_line(f"! {problem['reason']}{rows}") + "\n"
        text += "".join(f"  {one_line(example)}\n" for example in problem["examples"])
    return text
