"""The nouns of a page: text and plain numbers, placed alike by the HTML and the PDF renderer.

Whoever composes a report decides what is said and in which order; a renderer only places it. Nothing here
computes, formats a number or knows an analysis.
"""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Numbers = Sequence[float] | NDArray[np.floating] | NDArray[np.integer]

NoticeLevel = Literal["info", "good", "caution", "bad"]
Verdict = Literal["", "pass", "fail", "inconclusive", "info", "better", "worse", "equivalent"]
MarkKind = Literal["points", "line", "step", "bars", "stems", "band", "errorbars", "rule", "text", "heat"]
FigureSize = Literal["compact", "normal", "tall"]


_USED: dict[str, tuple[str, ...]] = {  # the series of a mark that go together
    **dict.fromkeys(("points", "line", "step", "bars", "stems"), ("x", "y")),
    "text": ("x", "y", "texts"),
    "band": ("x", "low", "high"),
    "errorbars": ("x", "y", "low", "high"),
}


@dataclass(frozen=True)
class Paragraph:
    """One paragraph of running text."""

    text: str


@dataclass(frozen=True)
class Notice:
    """A remark set apart from the text; its level is written out, not only coloured."""

    text: str
    level: NoticeLevel = "info"
    title: str = ""


@dataclass(frozen=True)
class Cell:
    """One cell of a table: its text, a verdict shown as a chip before it, and whether it stands out."""

    text: str = ""
    verdict: Verdict = ""
    strong: bool = False


@dataclass(frozen=True)
class Table:
    """Rows under a head; `align` has one letter a column, l, c or r (empty: the first l, the others r)."""

    caption: str
    head: Sequence[str]
    rows: Sequence[Sequence[str | Cell]]
    align: str = ""

    def __post_init__(self) -> None:
        columns = len(self.head)
        for number, row in enumerate(self.rows):
            if len(row) != columns:
                raise ValueError(f"table '{self.caption}': row {number} has {len(row)} cells, not {columns}")
        if self.align and (len(self.align) != columns or set(self.align) - set("lcr")):
            raise ValueError(f"table '{self.caption}': align '{self.align}' is not {columns} letters of l, c, r")

    @property
    def alignment(self) -> str:
        """One letter a column."""
        return self.align or "l" + "r" * (len(self.head) - 1)


@dataclass(frozen=True)
class Mark:
    """One series of a panel.

    Which numbers a kind uses:

    ==========  ==================================================================================
    points      `x`, `y`
    line        `x`, `y`; a value that is not finite breaks the line
    step        `x`, `y`; each y holds until the next x
    bars        `x` the n + 1 edges, `y` the n heights
    stems       `x`, `y`; a line from zero to each value
    band        `x`, `low`, `high`
    errorbars   `x`, `y`, `low`, `high`: the ends of the bars, not their lengths
    rule        `x` for vertical lines or `y` for horizontal ones, across the panel
    text        `x`, `y`, `texts`, centred there
    heat        `x` the n + 1 edges and `y` the m + 1, both evenly spaced, `z` m rows of n values from
                the lowest y on: light where low, dark where high; on linear axes
    ==========  ==================================================================================

    `role` is what the series means (`measured`, `predicted`, `reference`, `limit`, `group1`, `group2`, ...);
    the look follows from it. A mark with a `label` is listed in the figure's legend. `texts` of points are what the
    pointer tells of them, where x and y would say nothing.
    """

    kind: MarkKind
    x: Numbers = ()
    y: Numbers = ()
    low: Numbers = ()
    high: Numbers = ()
    label: str = ""
    role: str = "measured"
    texts: Sequence[str] = ()
    z: Sequence[Numbers] = ()

    def __post_init__(self) -> None:
        if self.kind == "heat":
            shape = [(len(self.y) - 1, len(self.x) - 1)] if len(self.z) else [(0, 0)]
            rows = {len(row) for row in self.z} or {0}
            if [(len(self.z), min(rows))] != shape or len(rows) > 1:
                raise ValueError(f"mark '{self.label}': {len(self.z)} rows of {rows} values, not {shape[0]}")
        used = [len(getattr(self, name)) for name in _USED.get(self.kind, ())]
        if self.kind == "bars":
            used[0] -= bool(used[0])
        if len(set(used)) > 1:
            raise ValueError(f"mark '{self.label}' of kind {self.kind}: its series differ in length, {used}")


@dataclass(frozen=True)
class Panel:
    """One pair of axes. Panels of a figure with the same `share_x` zoom together and have the same x axis.

    `square`: one scale both ways and no axes; its marks draw what a reader needs (`reporting.polar`).
    """

    title: str = ""
    x_label: str = ""
    y_label: str = ""
    marks: Sequence[Mark] = ()
    x_log: bool = False
    y_log: bool = False
    share_x: str = ""
    x_limits: tuple[float, float] | None = None
    y_limits: tuple[float, float] | None = None
    square: bool = False


@dataclass(frozen=True)
class Figure:
    """Panels in rows and columns over one caption; `alt` says in words what a reader would see."""

    caption: str
    alt: str
    panels: Sequence[Sequence[Panel | None]]
    size: FigureSize = "normal"

    @property
    def columns(self) -> int:
        """The width of the grid."""
        return max((len(row) for row in self.panels), default=0)


Block = Paragraph | Notice | Table | Figure


@dataclass(frozen=True)
class Section:
    """A heading and its blocks. `key` makes the HTML address (`#accuracy`); `level` 1 is a chapter."""

    title: str
    blocks: Sequence[Block] = ()
    own_page: bool = False
    level: int = 1
    key: str = ""


@dataclass(frozen=True)
class Document:
    """A whole report. `date` stamps the files, so it comes from the data, not from the clock."""

    title: str
    date: datetime.datetime
    subtitle: str = ""
    handling: str = ""
    meta: Sequence[tuple[str, str]] = ()
    sections: Sequence[Section] = ()
    language: str = "en"

    def __post_init__(self) -> None:
        if not (self.language.isascii() and self.language.isalpha() and 2 <= len(self.language) <= 3):
            raise ValueError(f"language '{self.language}' is not a code of two or three letters, such as 'en'")


def outline(document: Document) -> list[tuple[Section, int, str]]:
    """Each section with its heading level, which never skips one, and an address that is unique and plain."""
    placed: list[tuple[Section, int, str]] = []
    taken: set[str] = set()
    above = 0
    for number, section in enumerate(document.sections, start=1):
        above = max(1, min(section.level, above + 1, 4))
        plain = "".join(c if c.isascii() and c.isalnum() else "-" for c in section.key.lower()).strip("-")
        key = plain if plain and plain not in taken else f"{plain or 'section'}-{number}"
        taken.add(key)
        placed.append((section, above, key))
    return placed
