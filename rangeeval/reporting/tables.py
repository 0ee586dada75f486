"""Pivots of the tidy table: one row a bin (and group), a column a quantity, in the units people use."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rangeeval.model import Estimate, Result
from rangeeval.reporting.blocks import Cell, Table
from rangeeval.reporting.layouts import own
from rangeeval.reporting.wording import (
    bin_text,
    estimate_text,
    flags_text,
    plain_number,
    quantity_name,
    unit_name,
)
from rangeeval.units import shown


@dataclass(frozen=True)
class Line:
    """The estimates of one bin in one group or track, by quantity."""

    first: Estimate
    of: dict[str, Estimate]

    @property
    def flags(self) -> tuple[str, ...]:
        """The flags of all of them, each once."""
        return tuple(dict.fromkeys(flag for e in self.of.values() for flag in e.flags))


def lines(rows: Iterable[Estimate], quantities: Sequence[str] | None = None) -> list[Line]:
    """The rows gathered by bin, group and track, in the order they come."""
    found: dict[tuple[object, ...], Line] = {}
    for row in rows:
        if quantities is not None and row.quantity not in quantities:
            continue
        key = (str(row.bin_low), str(row.bin_high), row.group, row.track_id)
        if key not in found:
            found[key] = Line(row, {})
        found[key].of[row.quantity] = row
    return list(found.values())


def pooled(result: Result) -> list[Estimate]:
    """The rows of all samples together."""
    return [r for r in result.rows if r.group is None and r.track_id is None]


def headline_quantities(result: Result) -> tuple[str, ...]:
    """The quantities an analysis's short table shows; by default the first few it has."""
    present = dict.fromkeys(r.quantity for r in result.rows)
    chosen = tuple(q for q in own(result.analysis, "HEADLINE", ()) if q in present)
    return chosen or tuple(present)[:4]


def short_tables(result: Result, caption: str, *, summary: bool = False) -> list[Table]:
    """What a terminal shows of a result, or with `summary` the report's first page: the layout's own tables, or one."""
    tables: list[Table] | None = None
    if layout := own(result.analysis, "short_tables"):
        tables = layout(result, caption, summary=summary)
    return tables or [headline_table(result, caption=caption, rows=pooled(result) if summary else None)]


def headline_table(
    result: Result, *, caption: str, rows: Sequence[Estimate] | None = None, flags: bool = True
) -> Table:
    """The short table of a result: bins down, quantities across, each with its interval, flags last."""
    quantities = headline_quantities(result)
    chosen = without_lone_groups(lines(rows if rows is not None else result.rows, quantities))
    named = any(line.first.group or line.first.track_id for line in chosen)
    units = {r.quantity: unit_name(r.unit, r.quantity) for r in result.rows}
    head = ["Bin", *(["Group"] if named else []), "n"]
    head += [f"{quantity_name(q)}{f' ({units[q]})' if units[q] else ''}" for q in quantities] + ["Flags"] * flags
    body: list[list[str | Cell]] = []
    for line in chosen:
        cells: list[str | Cell] = [bin_text(line.first)]
        if named:
            cells.append(line.first.track_id or line.first.group or "all")
        cells.append(counts(line))
        cells += [estimate_text(line.of[q]) if q in line.of else "" for q in quantities]
        cells += [flags_text(line.flags)] * flags
        body.append(cells)
    return Table(caption, head, body, "l" * (2 if named else 1) + "r" * (1 + len(quantities)) + "l" * flags)


def without_lone_groups(chosen: Sequence[Line]) -> list[Line]:
    """The lines without a group that is all its bin holds: it would repeat the line of all together."""
    groups: dict[tuple[float, float], int] = {}
    for line in chosen:
        if line.first.group:
            edges = (line.first.bin_low, line.first.bin_high)
            groups[edges] = groups.get(edges, 0) + 1
    return [x for x in chosen if not x.first.group or groups[(x.first.bin_low, x.first.bin_high)] > 1]


def counts(line: Line) -> str:
    """The number of samples; one for each quantity where they differ."""
    each = [e.n for e in line.of.values()]
    return str(each[0]) if len(set(each)) == 1 else " / ".join(map(str, each))


def verdict_table(result: Result, *, caption: str) -> Table:
    """Every verdict of `check`: the estimate, the bound that decided, and how much more data would decide."""
    body: list[list[str | Cell]] = []
    for row in result.rows:
        extra = row.extra
        number = int(extra["requirement"])
        unit = shown(row.unit)
        bound, limit = (
            plain_number(unit.value(math.nan if v is None else v), 4) for v in (extra["bound"], extra["limit"])
        )
        body.append(
            [
                f"{number}. {quantity_name(row.quantity)}",
                bin_text(row),
                str(row.n),
                f"{estimate_text(row)} {unit.unit}",
                bound,
                limit,
                Cell(verdict=extra["verdict"]),
                Cell(verdict=extra["family_verdict"]),
                _more(extra),
            ]
        )
    head = ["Requirement", "Bin", "n", "Estimate", "Bound", "Limit", "Verdict", "All bins", "More samples"]
    return Table(caption, head, body, "llrrrrllr")


def _more(extra: Mapping[str, Any]) -> str:
    if extra["verdict"] != "inconclusive":
        return ""
    return "ratios disagree" if extra["more_samples"] is None else str(extra["more_samples"])
