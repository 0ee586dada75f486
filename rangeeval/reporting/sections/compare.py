"""The chapter on a comparison: verdicts, ratio or difference per bin, the curves, and what was not alike."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rangeeval.model import Estimate, Result
from rangeeval.reporting.blocks import Block, Cell, Figure, Mark, Notice, Panel, Paragraph, Section, Table
from rangeeval.reporting.sections.common import flag_notices
from rangeeval.reporting.wording import (
    MISSING,
    bin_text,
    estimate_text,
    in_shown_unit,
    plain_number,
    quantity_name,
)
from rangeeval.units import shown, shown_variable

NAME = "Comparison"
NOTE = (
    "Each trial against {reference}; p adjusted over {tests} tests ({adjust}); ratios within {margin:.0%} count as "
    "equivalent."
)

ON_A_PAGE = 3  # panels

VERDICTS = ("better", "worse", "equivalent", "inconclusive")
UNLIKE = "unlike-"  # flags of what else differs between the trials in a bin
_ADJUSTED = {
    "holm": "Holm: the chance of any false claim in the whole table stays below the level",
    "bh": "Benjamini and Hochberg: the expected share of false claims among all claims stays below the level",
}


def sections(result: Result) -> list[Section]:
    """Verdicts with figures, what was not alike about the trials, the method."""
    return [
        Section("Comparison", _overview(result), key="compare"),
        Section("What was not alike", [_differences(result)], level=2, key="compare-differences"),
        Section("How the trials were compared", _method(result), level=2, key="compare-method"),
    ]


def short_tables(result: Result, caption: str, *, summary: bool = False) -> list[Table]:
    """What a terminal shows: every test. A summary: how many bins of each quantity had which verdict."""
    return [_tally(result)] if summary else [_tests(result, caption, result.rows), _differences(result)]


def summary_figure(result: Result) -> Figure:
    """The first ratios over the bins, for the summary page."""
    ratios = [q for q in _quantities(result.rows) if _binned(result, q) and _binned(result, q)[0].unit == "1"]
    return _effects(result, ratios[:3] or _quantities(result.rows)[:3])[0]


def _trials(result: Result) -> list[str]:
    """The trials that are compared with the reference."""
    return [str(name) for name in result.settings["trials"][1:]]


def _quantities(rows: Sequence[Estimate]) -> list[str]:
    return list(dict.fromkeys(row.quantity for row in rows))


def _overview(result: Result) -> list[Block]:
    blocks: list[Block] = [_notice(result, trial) for trial in _trials(result)]
    blocks += _effects(result, _quantities(result.rows))
    curves = [panel for quantity in _quantities(result.rows) if (panel := _curves(result, quantity))]
    caption = "The quantities themselves, each with its interval, the trials over each other (side by side in a bin)."
    blocks += _figures(caption, _alt(result), curves)
    blocks += [
        _tests(result, f"Every test of {_with_unit(rows[0])}", rows, named=False)
        for quantity in _quantities(result.rows) if (rows := [r for r in result.rows if r.quantity == quantity])
    ]  # fmt: skip
    return [*blocks, *flag_notices(result)]


def _notice(result: Result, trial: str) -> Notice:
    rows = [row for row in result.rows if row.extra["trial"] == trial]
    count = {word: sum(row.extra["verdict"] == word for row in rows) for word in VERDICTS}
    unsigned = sum(bool(row.extra["differs"]) and row.extra["verdict"] == "inconclusive" for row in rows)
    tally = ", ".join(f"{number} {word}" for word, number in count.items())
    more = f"; {unsigned} of the inconclusive differ, in a quantity that has no better side" if unsigned else ""
    signed = [row for row in rows if row.extra["verdict"] in {"better", "worse"}]
    unlike = sum(bool(_unlike(row)) for row in signed)
    more += f"; {unlike} of the {len(signed)} better or worse stand where more than the radar differs" if unlike else ""
    level = "bad" if count["worse"] else "good" if count["better"] or count["equivalent"] else "info"
    text = f"Of {len(rows)} tests against {result.settings['reference']}: {tally}{more}."
    return Notice(text, level, trial)  # type: ignore[arg-type]


def _tally(result: Result) -> Table:
    body: list[list[str | Cell]] = []
    for trial in _trials(result):
        for quantity in _quantities(result.rows):
            rows = [r for r in result.rows if r.quantity == quantity and r.extra["trial"] == trial]
            counts = [str(sum(r.extra["verdict"] == word for r in rows)) for word in VERDICTS]
            body.append([trial, quantity_name(quantity), *counts, str(sum(bool(r.extra["differs"]) for r in rows))])
    head = ["Trial", "Quantity", *(word.capitalize() for word in VERDICTS), "Differs"]
    caption = f"Bins by verdict against {result.settings['reference']}"
    return Table(caption, head, body, "llrrrrr")


def _tests(result: Result, caption: str, rows: Sequence[Estimate], *, named: bool = True) -> Table:
    """One line a test: both estimates, the effect, the p value, the verdict, and how many samples would decide.

    `named`: each line says its quantity; otherwise all are of one.
    """
    several = len(_trials(result)) > 1
    grouped = any(row.group for row in rows)
    unlike = any(_unlike(row) for row in rows)
    body: list[list[str | Cell]] = []
    for row in rows:
        extra = row.extra
        cells: list[str | Cell] = [str(extra["trial"])] if several else []
        cells += [_with_unit(row)] if named else []
        cells += [row.group or ""] if grouped else []
        differs = bool(extra["differs"]) and extra["verdict"] == "inconclusive"
        sign = ("× " if extra["measure"] == "ratio" else "Δ ") if named else ""
        body.append([
            *cells, bin_text(row), estimate_text(_of(row, "reference")), estimate_text(_of(row, "trial")),
            sign + estimate_text(row), _p(extra["p_adjusted"]), Cell("differs" if differs else "", extra["verdict"]),
            _more(row), *([_unlike(row)] if unlike else []),
        ])  # fmt: skip
    effect = "Ratio × or difference Δ" if named else str(rows[0].extra["measure"]).capitalize()
    first = [*(["Trial"] if several else []), *(["Quantity"] if named else []), *(["Group"] if grouped else []), "Bin"]
    head = [*first, "Reference", "Compared", effect, "p, adjusted", "Verdict", "More samples"]
    head += ["Not alike"] * unlike
    return Table(caption, head, body, "l" * len(first) + "rrrrlr" + "l" * unlike)


def _unlike(row: Estimate) -> str:
    """What else differs between the two trials there, in words."""
    words = [flag.removeprefix(UNLIKE) for flag in row.flags if flag.startswith(UNLIKE)]
    return ", ".join("SNR" if word == "snr" else word for word in words)


def _with_unit(row: Estimate) -> str:
    unit = shown(str(row.extra["of_unit"])).unit
    return quantity_name(row.quantity) + (f" ({unit})" if unit else "")


def _of(row: Estimate, which: str) -> Estimate:
    """The estimate of the reference or of the trial behind a comparison."""
    value, low, high = (_number(row.extra[f"{which}_{end}"]) for end in ("value", "low", "high"))
    return Estimate(
        quantity=row.quantity, unit=str(row.extra["of_unit"]), value=value, low=low, high=high, variable=row.variable,
        bin_low=row.bin_low, bin_high=row.bin_high, flags=row.flags,
    )  # fmt: skip


def _number(value: object) -> float:
    return float(value) if isinstance(value, (int, float)) else math.nan


def _p(value: object) -> str:
    p = _number(value)
    return MISSING if math.isnan(p) else "<\u00a00.0001" if p < 1e-4 else f"{p:.4f}" if p < 0.1 else f"{p:.2f}"


def _more(row: Estimate) -> str:
    if row.extra["verdict"] != "inconclusive" or row.extra["differs"]:
        return ""
    more = row.extra["more_samples"]
    return MISSING if more is None else f"{more:,}"


def _binned(result: Result, quantity: str) -> list[Estimate]:
    return [r for r in result.rows if r.quantity == quantity and r.variable is not None]


def _label(result: Result, row: Estimate, trial: str) -> str:
    several = len(_trials(result)) > 1
    return ", ".join([*([trial] if several else []), *([row.group] if row.group else [])]) or "with interval"


def _across(row: Estimate) -> tuple[float, str]:
    unit = shown_variable(row.variable or "")
    return unit.scale, f"{(row.variable or '').capitalize()} ({unit.unit})".removesuffix(" ()")


def _figures(caption: str, alt: str, panels: Sequence[Panel]) -> list[Figure]:
    """The panels below each other, as many to a figure as a page has room for."""
    return [
        Figure(caption, alt, [[panel] for panel in panels[start : start + ON_A_PAGE]])
        for start in range(0, len(panels), ON_A_PAGE)
    ]


def _effects(result: Result, quantities: Sequence[str]) -> list[Figure]:
    """The ratio or difference of quantities over the bins; the line is "the same"."""
    panels: list[Panel] = []
    for quantity in quantities:
        rows = _binned(result, quantity)
        if not rows:
            continue
        ratio = rows[0].extra["measure"] == "ratio"
        unit = shown(rows[0].unit)
        scale, x_label = _across(rows[0])
        marks = [Mark("rule", y=[1.0 if ratio else 0.0], label="the same", role="reference")]
        if ratio:
            margin = 1.0 + float(result.settings["margins"].get(quantity, result.settings["margin"]))
            marks.append(Mark("rule", y=[1.0 / margin, margin], label="margin of equivalence", role="limit"))
        series: dict[str, list[Estimate]] = {}
        for row in rows:
            if math.isfinite(row.value) and math.isfinite(row.low) and math.isfinite(row.high):
                series.setdefault(_label(result, row, str(row.extra["trial"])), []).append(row)
        for number, (label, found) in enumerate(series.items(), start=1):
            marks.append(Mark(
                "errorbars", _places(found, scale, number, len(series)),
                [unit.value(r.value) for r in found], low=[unit.value(r.low) for r in found],
                high=[unit.value(r.high) for r in found], label=label, role=f"group{number}",
            ))  # fmt: skip
        what = "ratio" if ratio else f"difference ({unit.unit})".removesuffix(" ()")
        panels.append(Panel(f"{quantity_name(quantity)}: {what}", x_label, what, marks, y_log=ratio, share_x="bins"))
    confidence = result.settings["confidence"] * 100
    caption = (
        f"Each trial against {result.settings['reference']} per bin, with {confidence:g} % intervals of the single "
        "bin: among many bins some exclude “the same” by chance, which the verdicts allow for."
    )
    return _figures(caption, _alt(result), panels or [_whole(result)])


def _places(rows: Sequence[Estimate], scale: float, number: int, of: int) -> list[float]:
    """The middles of the bins, those of several series a little apart so that none hides another."""
    aside = (number - 0.5 * (of + 1)) * 0.12
    return [(0.5 * (r.bin_low + r.bin_high) + aside * (r.bin_high - r.bin_low)) * scale for r in rows]


def _whole(result: Result) -> Panel:
    """Where no quantity has bins: the ratios beside each other."""
    rows = [r for r in result.rows if r.extra["measure"] == "ratio" and math.isfinite(r.low + r.high)]
    marks = [
        Mark("rule", y=[1.0], label="the same", role="reference"),
        Mark("errorbars", [float(i) for i, _ in enumerate(rows, start=1)], [r.value for r in rows],
             low=[r.low for r in rows], high=[r.high for r in rows], label="with interval", role="group1"),
    ]  # fmt: skip
    return Panel("Ratios of the whole trial, in the order of the table", "Test", "Ratio", marks, y_log=True)


def _curves(result: Result, quantity: str) -> Panel | None:
    """The quantity itself over the bins: the reference and every trial."""
    rows = _binned(result, quantity)
    series: dict[str, list[Estimate]] = {}
    for row in rows:
        for which in ("reference", "trial"):
            estimate = _of(row, which)
            name = str(row.extra[which]) + (f", {row.group}" if row.group else "")
            if math.isfinite(estimate.value) and estimate not in series.setdefault(name, []):
                series[name].append(estimate)
    if not any(series.values()):
        return None
    unit = shown(str(rows[0].extra["of_unit"]))
    scale, x_label = _across(rows[0])
    marks = [
        Mark("errorbars", _places(found, scale, number, len(series)), [unit.value(e.value) for e in found],
             low=[unit.value(e.low if math.isfinite(e.low) else e.value) for e in found],
             high=[unit.value(e.high if math.isfinite(e.high) else e.value) for e in found],
             label=name, role=f"group{number}")
        for number, (name, found) in enumerate(series.items(), start=1) if found
    ]  # fmt: skip
    name = quantity_name(quantity)
    return Panel(name, x_label, f"{name} ({unit.unit})".removesuffix(" ()"), marks, share_x="bins")


def _alt(result: Result) -> str:
    return " ".join(f"{_notice(result, trial).title}: {_notice(result, trial).text}" for trial in _trials(result))


def _differences(result: Result) -> Table:
    """What was not the same: one line a fact, a column a trial."""
    names = [str(name) for name in result.settings["trials"]]
    body: list[list[str | Cell]] = [
        [str(found["what"]), *(_fact(value) for value in found["values"])] for found in result.settings["differences"]
    ]
    body = body or [["nothing that the trials record", *("" for _ in names)]]
    return Table("What was not alike about the trials", ["What", *names], body, "l" * (1 + len(names)))


def _fact(value: object) -> str:
    if isinstance(value, float):
        return plain_number(value, 6)
    return MISSING if value is None else str(value)


def _method(result: Result) -> list[Block]:
    s = result.settings
    level = (1 - s["confidence"]) * 100
    within = ", ".join(
        f"{quantity_name(name)} {in_shown_unit(float(value), _unit(result, name))}"
        for name, value in s["margins"].items()
    )
    return [
        Paragraph(
            "A ratio of sigmas has the F distribution, with the degrees of freedom of both (from the effective number "
            "of samples); a difference of detection probabilities is tested with Fisher's exact test; other quantities "
            "from their intervals, ratios on a logarithmic scale. The trials are taken as independent."
        ),
        Paragraph(
            f"p values are adjusted over all {s['tests']} tests. {_ADJUSTED[s['adjust']]} ({level:g} %). A trial is "
            "better or worse where the adjusted p value is within that level and the quantity has a better side "
            "(smaller errors, larger detection probability, bias nearer zero); a difference in any other quantity is "
            "marked “differs” and has no verdict."
        ),
        Paragraph(
            f"Equivalent: two one-sided tests, adjusted in the same way, show the ratio within "
            f"{1 / (1 + s['margin']):.3f} to {1 + s['margin']:.3f}"
            f"{f', and within the stated margin of {within}' if within else ''}. A difference in its own unit is "
            "judged equivalent only where a margin was stated. “More samples” is how many more each trial would need "
            "until a test decides, if the estimates stay as they are."
        ),
    ]  # fmt: skip


def _unit(result: Result, quantity: str) -> str:
    return next((r.unit for r in result.rows if r.quantity == quantity), "")
