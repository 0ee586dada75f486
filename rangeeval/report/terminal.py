"""Results on a terminal: the same tables as the report, as text."""

from __future__ import annotations

import io
from typing import IO, TYPE_CHECKING

from rangeeval.errors import one_line
from rangeeval.report.blocks import Cell, Table
from rangeeval.report.tables import headline_table, verdict_table

if TYPE_CHECKING:
    from rangeeval.model import Result

_WIDE = 200  # columns when the output is no terminal
_NOTE = {
    "accuracy": (
        "σ: random error only, with its {confidence:.0%} interval. "
        "A constant bias leaves no trace in residuals and is not in these numbers."
    ),
    "check": "All bins: the verdict at the level that holds for all bins of the requirement together (Bonferroni).",
}


def as_text(result: Result, stream: IO[str] | None = None) -> str:
    """The result's short table as text, in colour when `stream` is a terminal."""
    table = (
        verdict_table(result, caption="Requirements")
        if result.analysis == "check"
        else headline_table(result, caption=result.analysis.capitalize())
    )
    return text_of(table, stream) + _NOTE.get(result.analysis, "").format(**result.settings) + "\n"


def text_of(table: Table, stream: IO[str] | None = None) -> str:
    """A table as text. Every cell is printed as plain text: nothing in a log can colour or clear a terminal."""
    from rich.console import Console
    from rich.table import Table as RichTable
    from rich.text import Text

    terminal = stream is not None and stream.isatty()
    console = Console(
        file=io.StringIO(), force_terminal=terminal, width=None if terminal else _WIDE, no_color=not terminal, soft_wrap=False
    )
    rich = RichTable(title=Text(one_line(table.caption)), title_justify="left", box=None, pad_edge=False, header_style="bold")
    sides = {"l": "left", "r": "right", "c": "center"}
    for head, align in zip(table.head, table.alignment, strict=True):
        rich.add_column(Text(one_line(head)), justify=sides[align])  # type: ignore[arg-type]
    colour = {"pass": "green", "fail": "red", "inconclusive": "yellow"}
    for row in table.rows:
        cells = [c if isinstance(c, Cell) else Cell(c) for c in row]
        rich.add_row(*(Text(one_line(c.text), style=colour.get(c.verdict, "")) for c in cells))
    console.print(rich)
    text: str = console.file.getvalue()  # type: ignore[attr-defined]
    return "\n".join(line.rstrip() for line in text.splitlines()) + "\n"
