"""The page on a trend: which trials are out of line, where the level stepped, and a control chart for each bin."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from rangeeval.model import Estimate, Result
from rangeeval.reporting.blocks import Block, Figure, Mark, Notice, Panel, Paragraph, Section, Table
from rangeeval.reporting.wording import (
    MISSING,
    bin_text,
    estimate_text,
    interval_text,
    plain_number,
    quantity_name,
    unit_name,
    value_text,
)
from rangeeval.units import Shown, shown

NAME = "Trend"
NOTE = (
    "Limits: all charts together raise a false alarm in at most {false_alarm_rate:.0%} of pages of steady trials. "
    "“Between trials”: how much trials differ beyond their own intervals."
)
MOST_FIGURES = 24


@dataclass(frozen=True)
class _Chart:
    """The rows of one chart."""

    points: list[Estimate]
    levels: list[Estimate]
    steps: list[Estimate]

    @property
    def out(self) -> list[Estimate]:
        """The points beyond their limits."""
        return [p for p in self.points if p.extra.get("verdict") == "out"]

    @property
    def drifts(self) -> bool:
        """Whether the smoothed series leaves its limits."""
        return any(p.extra.get("drifts") for p in self.points)

    @property
    def alarmed(self) -> bool:
        """Whether anything stands out."""
        return bool(self.out or self.steps or self.drifts)

    @property
    def title(self) -> str:
        """What it is a chart of."""
        first = self.points[0]
        of = first.group or first.track_id
        return f"{quantity_name(first.quantity)}, {bin_text(first)}{f', {of}' if of else ''}"


def _charts(result: Result) -> list[_Chart]:
    found: dict[int, _Chart] = {}
    for row in result.rows:
        chart = found.setdefault(int(row.extra["chart"]), _Chart([], [], []))
        {"point": chart.points, "level": chart.levels, "step": chart.steps}[row.extra["kind"]].append(row)
    return [chart for chart in found.values() if chart.points]


def short_tables(result: Result, caption: str, *, summary: bool = False) -> list[Table]:
    """A line a chart; then the trials that are out of line, and the steps."""
    charts = _charts(result)
    tables = [_overview(charts, caption)]
    if out := [(chart, point) for chart in charts for point in chart.out]:
        rows = [
            [p.extra["trial"], p.extra["date"], p.extra["software"], chart.title, estimate_text(p), _limits(p),
             unit_name(p.unit)]
            for chart, p in out
        ]  # fmt: skip
        head = ["Trial", "Date", "Software", "Chart", "Estimate", "Limits", "Unit"]
        tables.append(Table("Trials out of line", head, rows, "llllrrl"))
    if steps := [(chart, step) for chart in charts for step in chart.steps]:
        rows = [
            [s.extra["last"], s.extra["first"], s.extra["date"], s.extra["software"], chart.title, _size(s),
             plain_number(s.extra["p_value"], 2)]
            for chart, s in steps
        ]  # fmt: skip
        head = ["After", "From", "Date", "Software", "Chart", "Size", "p"]
        tables.append(Table("Steps of the level", head, rows, "lllllrr"))
    return tables


def _overview(charts: Sequence[_Chart], caption: str) -> Table:
    rows = []
    for chart in charts:
        last = chart.levels[-1] if chart.levels else None
        unit = unit_name(chart.points[0].unit)
        rows.append([
            chart.title, str(len(chart.points)), f"{estimate_text(last)} {unit}".strip() if last else MISSING,
            _between(last) if last else MISSING, str(len(chart.out)) if last else MISSING,
            ("yes" if chart.drifts else "no") if last else MISSING, str(len(chart.steps)) if last else MISSING,
        ])  # fmt: skip
    head = ["Chart", "Trials", "Level now", "Between trials", "Out of line", "Drifts", "Steps"]
    return Table(caption, head, rows, "lrrrrlr")


def _between(level: Estimate) -> str:
    """The scatter from trial to trial, in the words of its scale."""
    sigma = float(level.extra["between_sigma"])
    if level.extra["scale"] == "logarithmic":
        return f"{plain_number(100 * sigma, 2)} %"
    if level.extra["scale"] == "arcsine":
        p = min(max(level.value, 0.0), 1.0)
        return plain_number(2 * math.sqrt(p * (1 - p)) * sigma, 2)
    unit = shown(level.unit)
    return f"{plain_number(sigma * (1.0 if unit.decibel else unit.scale), 2)} {unit.unit}".strip()


def _limits(point: Estimate) -> str:
    unit = shown(point.unit)
    low, high = (unit.value(point.extra[name]) for name in ("limit_low", "limit_high"))
    return f"{plain_number(low, 3)} to {plain_number(high, 3)}"


def _size(step: Estimate) -> str:
    if step.quantity.endswith("_ratio"):
        return f"× {value_text(step)} ({interval_text(step)})"
    return f"{estimate_text(step)} {unit_name(step.unit)}".strip()


def sections(result: Result) -> list[Section]:
    """The control charts, and how they are made."""
    charts = _charts(result)
    drawn = sorted(range(len(charts)), key=lambda i: (not charts[i].alarmed, i))[:MOST_FIGURES]
    blocks: list[Block] = [_verdict(charts)]
    if len(drawn) < len(charts):
        blocks.append(
            Paragraph(
                f"{len(drawn)} of {len(charts)} charts are drawn, first those where something stands out; the numbers "
                "of all are in results.json."
            )
        )
    blocks += [_figure(charts[i]) for i in sorted(drawn)]
    return [
        Section("Control charts", blocks, key="trend"),
        Section("The trials", [_trials(result)], level=2, key="trend-trials"),
        Section("How it was judged", _method(result), level=2, key="trend-method"),
    ]


def _verdict(charts: Sequence[_Chart]) -> Notice:
    judged = [chart for chart in charts if chart.levels]
    alarmed = sum(chart.alarmed for chart in judged)
    if not judged:
        return Notice("Too few trials for limits: each chart needs five with an interval.", "caution", "Not judged")
    if alarmed:
        return Notice(f"Something stands out in {alarmed} of {len(judged)} charts.", "caution", "Not steady")
    return Notice(f"Nothing stands out in {len(judged)} charts.", "good", "Steady")


def _figure(chart: _Chart) -> Figure:
    unit = shown(chart.points[0].unit)
    label = f"{quantity_name(chart.points[0].quantity)} ({unit.unit})".removesuffix(" ()")
    number = [float(p.extra["number"]) for p in chart.points]
    panels = [Panel(chart.title, "trial", label, _marks(chart, number, unit), share_x="trial")]
    if chart.levels:
        limit = chart.points[0].extra["smoothed_limit"]
        panels.append(
            Panel(
                "Smoothed (EWMA)", "trial", "standard deviations",
                [
                    Mark("line", x=number, y=[p.extra["smoothed"] for p in chart.points], role="measured"),
                    Mark("points", x=number, y=[p.extra["smoothed"] for p in chart.points], role="measured"),
                    Mark("rule", y=[-limit, limit], role="limit"),
                    Mark("rule", y=[0.0], role="reference"),
                ],
                share_x="trial",
            )
        )  # fmt: skip
    out = ", ".join(p.extra["trial"] for p in chart.out) or "none"
    steps = "; ".join(f"after {s.extra['last']}" for s in chart.steps) or "none"
    caption = f"{chart.title}: estimates with their intervals, level and limits. Out of line: {out}. Steps: {steps}."
    alt = f"Control chart of {chart.title} over {len(chart.points)} trials; out of line: {out}; steps: {steps}."
    return Figure(caption, alt, [panels])


def _marks(chart: _Chart, number: list[float], unit: Shown) -> list[Mark]:
    def values(name: str, points: Sequence[Estimate] = chart.points) -> list[float]:
        return [unit.value(getattr(p, name)) for p in points]

    marks = [
        Mark("errorbars", x=number, y=values("value"), low=values("low"), high=values("high"), label="estimate")
    ]  # fmt: skip
    if chart.levels:
        for name, label, role in (
            ("level", "level", "reference"), ("limit_low", "", "limit"), ("limit_high", "limits", "limit"),
        ):  # fmt: skip
            x, y = _broken(number, [unit.value(p.extra[name]) for p in chart.points], chart)
            marks.append(Mark("line", x=x, y=y, label=label, role=role))
        marks += [Mark("rule", x=[_place(chart, s) - 0.5 for s in chart.steps], role="none")] if chart.steps else []
    if chart.out:
        x = [float(p.extra["number"]) for p in chart.out]
        marks.append(Mark("points", x=x, y=values("value", chart.out), label="out of line", role="predicted"))
    return marks


def _place(chart: _Chart, step: Estimate) -> float:
    """The number of the first trial after a step."""
    before = sum(level.n for level in chart.levels[: chart.steps.index(step) + 1])
    return float(chart.points[before].extra["number"])


def _broken(x: list[float], y: list[float], chart: _Chart) -> tuple[list[float], list[float]]:
    """A line with a gap at each step."""
    across, up, start = [], [], 0
    for level in chart.levels:
        stop = start + level.n
        across += [x[start] - 0.5, *x[start:stop], x[stop - 1] + 0.5, x[stop - 1] + 0.5]
        up += [y[start], *y[start:stop], y[stop - 1], math.nan]
        start = stop
    return across[:-1], up[:-1]


def _trials(result: Result) -> Table:
    points = [row.extra for row in result.rows if row.extra["kind"] == "point"]
    out = Counter(point["number"] for point in points if point["verdict"] == "out")
    about = {point["number"]: [point[name] for name in ("trial", "date", "radar", "software")] for point in points}
    rows = [[str(number), *about[number], str(out[number] or "")] for number in sorted(about)]
    return Table("Trials", ["Number", "Trial", "Date", "Radar", "Software", "Out of line in charts"], rows, "rllllr")


def _method(result: Result) -> list[Block]:
    rate = f"{100 * result.settings['false_alarm_rate']:g} %"
    return [
        Paragraph(
            "Each trial's estimate is taken to be the level, plus a deviation from trial to trial, plus the error that "
            "its own interval states. So a trial with few samples has wide limits and counts little in the level. The "
            "scatter from trial to trial follows from the differences of successive trials, so that a step does not "
            "hide itself in it. Quantities above zero are judged as logarithms, probabilities by the arcsine of their "
            "root."
        ),
        Paragraph(
            "Limits are those of simulated steady series with the same intervals, put through the same estimators: of "
            f"all pages of steady trials, at most {rate} show a trial out of line somewhere, at most {rate} a drift, "
            f"and at most {rate} a step. The level steps where splitting the series makes its two sides differ by more "
            "than in those simulated series; at least three trials stand on either side. The size of a step that was "
            "found is on the large side: only clear ones are found."
        ),
    ]
