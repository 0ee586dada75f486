"""The chapter on truth: bias, sigma and RMS of the plots per bin, and the offset between the clocks."""

from __future__ import annotations

import math
from typing import Any

from rangeeval.model import Estimate, Result
from rangeeval.reporting.blocks import Block, Cell, Figure, Mark, Notice, Panel, Paragraph, Section, Table
from rangeeval.reporting.sections.common import flag_notices
from rangeeval.reporting.tables import lines
from rangeeval.reporting.wording import MISSING, bin_text, estimate_text, flags_text
from rangeeval.units import shown, shown_variable

NAME = "Errors against truth"
NOTE = "Plot less truth, with {confidence:.0%} intervals that count the memory of the errors."
_COORDINATES = {"range": "m", "azimuth": "rad", "elevation": "rad"}
_PARTS = {"bias": "bias", "sigma": "σ", "rms": "RMS"}


def sections(result: Result) -> list[Section]:
    """The errors per bin, the clocks, and the method."""
    return [
        Section("Errors against truth", _overview(result), key="truth"),
        Section("How errors were assessed", _method(result), level=2, key="truth-method"),
    ]


def short_tables(result: Result, caption: str, *, summary: bool = False) -> list[Table]:
    """One table a coordinate, and the time offset; on the summary one line a coordinate, the figure has the bins."""
    if summary:
        return [_whole_table(result, "Errors of the plots against truth, whole trial"), _offset_table(result)]
    return [*_tables(result, caption), _offset_table(result)]


def summary_figure(result: Result) -> Figure | None:
    """Bias and sigma over the bins."""
    return _by_bin(result)


def _plain(result: Result) -> list[Estimate]:
    return [r for r in result.rows if r.group is None]


def _tables(result: Result, caption: str) -> list[Table]:
    found = []
    named = any(r.track_id for r in result.rows if r.quantity != "time_offset")
    for coordinate, unit in _COORDINATES.items():
        wanted = [f"{coordinate}_{p}" for p in _PARTS]
        body: list[list[str | Cell]] = []
        for line in lines(_plain(result), wanted):
            cells: list[str | Cell] = [bin_text(line.first)]
            if named:
                cells.append(line.first.track_id or "all")
            cells.append(str(line.first.n))
            cells += [estimate_text(line.of[q]) if q in line.of else MISSING for q in wanted]
            body.append([*cells, flags_text(line.flags)])
        if body:
            head = [f"{coordinate.capitalize()} {word} ({shown(unit).unit})" for word in _PARTS.values()]
            head = ["Bin", *(["Target"] if named else []), "n", *head, "Flags"]
            found.append(Table(f"{caption}: {coordinate}", head, body, "l" * (1 + named) + "rrrrl"))
    return found


def _whole_table(result: Result, caption: str) -> Table:
    body: list[list[str | Cell]] = []
    for coordinate, unit in _COORDINATES.items():
        wanted = [f"{coordinate}_{p}" for p in _PARTS]
        rows = [r for r in _plain(result) if r.variable is None and r.track_id is None]
        for line in lines(rows, wanted):
            name = f"{coordinate.capitalize()} ({shown(unit).unit})"
            body.append([name, str(line.first.n), *(estimate_text(line.of[q]) for q in wanted), flags_text(line.flags)])
    return Table(caption, ["Coordinate", "n", "Bias", "σ", "RMS", "Flags"], body, "lrrrrl")


def _offset_table(result: Result) -> Table:
    body: list[list[str | Cell]] = [
        [r.track_id or "all", str(r.n), estimate_text(r), flags_text(r.flags)]
        for r in result.rows if r.quantity == "time_offset"
    ]  # fmt: skip
    return Table(
        "Time offset: how late the truth's times are (s)", ["Target", "n", "Offset (s)", "Flags"], body, "lrrl"
    )


def _overview(result: Result) -> list[Block]:
    blocks: list[Block] = []
    offset = next((r for r in result.rows if r.quantity == "time_offset" and r.track_id is None), None)
    if offset is not None and offset.low * offset.high > 0:
        applied = float(result.settings.get("time_offset_applied") or 0.0)
        done = f"{applied:g} s was taken out." if applied else "The errors here are with it (--remove-offset)."
        blocks.append(Notice(
            f"The clocks differ: the truth's times are late by {estimate_text(offset)} s (early if negative). {done}",
            "caution", "Time offset",
        ))  # fmt: skip
    drawn = _by_bin(result)
    blocks += [drawn] if drawn else []
    blocks += _tables(result, "Every bin")
    blocks += [_offset_table(result), *_scatter(result)]
    return [*blocks, *flag_notices(result)]


def _by_bin(result: Result) -> Figure | None:
    panels = []
    for coordinate, unit_name in _COORDINATES.items():
        unit = shown(unit_name)
        marks = []
        variable = ""
        for part, role in (("sigma", "measured"), ("bias", "group2")):
            rows = [
                r for r in _plain(result)
                if r.quantity == f"{coordinate}_{part}" and r.variable and r.track_id is None and math.isfinite(r.value)
            ]  # fmt: skip
            if not rows:
                continue
            variable = rows[0].variable or ""
            scale = shown_variable(variable).scale
            x = [0.5 * (r.bin_low + r.bin_high) * scale for r in rows]
            ends = [[unit.value(getattr(r, end) if math.isfinite(getattr(r, end)) else r.value) for r in rows]
                    for end in ("low", "high")]  # fmt: skip
            marks.append(Mark("errorbars", x, [unit.value(r.value) for r in rows], low=ends[0], high=ends[1],
                              label=_PARTS[part], role=role))  # fmt: skip
        if marks:
            name = f"{variable.capitalize()} ({shown_variable(variable).unit})"
            title = coordinate.capitalize()
            panels.append([Panel(title, name, f"{title} error ({unit.unit})", marks, share_x="bins")])
    if not panels:
        return None
    return Figure(
        "Bias and σ of the plots against truth, with their intervals, per bin.", "Bias and sigma by bin.", panels
    )


def _numbers(values: Any) -> list[float]:
    return [math.nan if v is None else float(v) for v in values]


def _scatter(result: Result) -> list[Block]:
    panels = []
    for coordinate, unit_name in _COORDINATES.items():
        data = result.series.get(f"errors/{coordinate}")
        if data:
            unit = shown(unit_name)
            marks = [Mark("points", [1e-3 * v for v in _numbers(data["range_m"])],
                          [unit.value(v) for v in _numbers(data["error"])], role="measured")]  # fmt: skip
            panels.append(
                [Panel(coordinate.capitalize(), "Range (km)", f"Error ({unit.unit})", marks, share_x="range")]
            )
    data = result.series.get("range_rate")
    if data:
        marks = [Mark("points", _numbers(data["rate_m_s"]), _numbers(data["error"]), role="measured")]
        panels.append(
            [
                Panel(
                    "Range error over range rate: its slope is the time offset",
                    "Range rate (m/s)",
                    "Range error (m)",
                    marks,
                )
            ]
        )
    return [Figure("Every plot less the truth.", "Errors over range.", panels)] if panels else []


def _method(result: Result) -> list[Block]:
    gap = result.settings.get("max_gap")
    longest = max((float(v) for v in dict(gap).values()), default=math.nan) if gap else math.nan
    return [Paragraph(
        "Truth was interpolated to the time of every plot by cubics through neighbouring points, never over a gap "
        f"(longest allowed here: {longest:g} s). Bias is the mean error; σ its scatter about that mean; RMS both "
        "together. Intervals count the memory of the errors, so slow wander widens them. The time offset is the slope "
        "of the errors over the rates of range, azimuth and elevation, all together; it cannot be told from a bias "
        "while the rates stay the same."
    )]  # fmt: skip
