"""The chapter on accuracy: sigma over the bins, the groups beside each other, the method, and a page a bin."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rangeeval.model import Estimate, Result
from rangeeval.reporting.blocks import Block, Cell, Figure, Mark, Notice, Panel, Paragraph, Section, Table
from rangeeval.reporting.sections.common import flag_notices
from rangeeval.reporting.tables import Line, counts, headline_table, lines, pooled, without_lone_groups
from rangeeval.reporting.wording import (
    FLAGS,
    MISSING,
    bin_text,
    edges_text,
    estimate_text,
    interval_text,
    plain_number,
    quantity_name,
    span_text,
    value_text,
)
from rangeeval.units import shown, shown_variable

AXES = {"range": "range_sigma", "y": "elevation_sigma", "z": "azimuth_sigma"}
_NAMES = {"range": "Range", "y": "Elevation (y)", "z": "Azimuth (z)"}

HEADLINE = ("range_sigma", "elevation_sigma", "azimuth_sigma")
NOTE = (
    "σ: random error only, with its {confidence:.0%} interval. "
    "A constant bias leaves no trace in residuals and is not in these numbers."
)
SUMMARY_NOTICE = Notice(
    "These numbers come from the tracker's own residuals and gains, without truth. They show the random error. A "
    "constant bias (range zero offset, boresight error) leaves no trace in residuals and is not in any number here.",
    "info",
    "What these numbers cannot see",
)


def sections(result: Result) -> list[Section]:
    """Overview, method, and one page for each bin."""
    found = [
        Section("Accuracy", _overview(result), key="accuracy"),
        Section("How accuracy was assessed", _method(result), level=2, key="accuracy-method"),
    ]
    by_bin = {(r.bin_low, r.bin_high): r for r in pooled(result)}
    numbers = {low: int(i) for i, low in zip(_column(result, "number"), _column(result, "low"), strict=True)}
    found += [_bin_page(result, edges, numbers.get(edges[0])) for edges in by_bin]
    return found


def _column(result: Result, name: str) -> Sequence[Any]:
    return result.series.get("bins", {}).get(name, ())


def _centre(rows: Sequence[Estimate], scale: float) -> list[float]:
    return [0.5 * (r.bin_low + r.bin_high) * scale for r in rows]


def summary_figure(result: Result) -> Figure:
    """Sigma over the bins, for the summary page."""
    everything, variable = pooled(result), str(result.settings["variable"])
    return Figure(
        "Random error per bin, assessed with its interval and (dashed) predicted from SNR and the radar's parameters.",
        _alt(everything),
        [[_sigma_panel(everything, q, variable, bracket=False) for q in AXES.values() if _has(everything, q)]],
    )


def _overview(result: Result) -> list[Block]:
    variable = str(result.settings["variable"])
    everything = pooled(result)
    blocks: list[Block] = []
    groups = headline_table(result, caption="Every bin, all together and by group", flags=False)
    if "Group" in groups.head:
        blocks.append(groups)
    blocks.append(
        Figure(
            "Random error per bin with the bracket that holds for any motion of the target.",
            _alt(everything),
            [[_sigma_panel(everything, q, variable, bracket=True)] for q in AXES.values() if _has(everything, q)],
        )
    )
    blocks.append(_bracket_table(everything))
    if _has(everything, "range_variance_ratio"):
        blocks += _prediction(everything)
    samples = [_samples_panel(result, axis) for axis in AXES if f"{axis}/all" in result.series]
    if samples:
        caption = "Residuals over predicted range: a thinned sample of every bin, its extremes always kept."
        alt = "Residuals of each axis against predicted range."
        blocks.append(Figure(caption, alt, [[panel] for panel in samples]))
    return blocks + flag_notices(result)


def _has(rows: Sequence[Estimate], quantity: str) -> bool:
    return any(r.quantity == quantity and math.isfinite(r.value) for r in rows)


def _alt(rows: Sequence[Estimate]) -> str:
    parts = []
    for quantity in AXES.values():
        values = [shown(r.unit).value(r.value) for r in rows if r.quantity == quantity and math.isfinite(r.value)]
        if values:
            unit = next(shown(r.unit).unit for r in rows if r.quantity == quantity)
            parts.append(f"{quantity_name(quantity)} from {min(values):.3g} to {max(values):.3g} {unit}")
    return "; ".join(parts) + "." if parts else "No sigma could be had."


def _sigma_panel(rows: Sequence[Estimate], quantity: str, variable: str, *, bracket: bool) -> Panel:
    unit, across = shown(next(r.unit for r in rows if r.quantity == quantity)), shown_variable(variable)
    chosen = [r for r in rows if r.quantity == quantity and math.isfinite(r.value)]
    x = _centre(chosen, across.scale)
    marks = []
    brackets = [
        [r for r in rows if r.quantity == f"{quantity}_bracket_{end}" and math.isfinite(r.value)]
        for end in ("low", "high")
    ]
    if bracket and brackets[0] and len(brackets[0]) == len(brackets[1]):
        low, high = ([unit.value(r.value) for r in side] for side in brackets)
        marks.append(
            Mark(
                "band",
                _centre(brackets[0], across.scale),
                low=low,
                high=high,
                label="bracket, any motion",
                role="reference",
            )
        )
    predicted = [r for r in rows if r.quantity == f"predicted_{quantity}" and math.isfinite(r.value)]
    if predicted:
        y = [unit.value(r.value) for r in predicted]
        marks.append(Mark("line", _centre(predicted, across.scale), y, label="predicted from SNR", role="predicted"))
    marks.append(Mark(
        "errorbars", x, [unit.value(r.value) for r in chosen],
        low=[unit.value(r.low if math.isfinite(r.low) else r.value) for r in chosen],
        high=[unit.value(r.high if math.isfinite(r.high) else r.value) for r in chosen],
        label="assessed, with interval", role="measured",
    ))  # fmt: skip
    return Panel(
        quantity_name(quantity),
        f"{_variable_name(variable)} ({across.unit})".removesuffix(" ()"),
        f"{quantity_name(quantity)} ({unit.unit})",
        marks,
        share_x="bins",
    )


def _variable_name(variable: str) -> str:
    return {"range": "Predicted range", "snr": "SNR", "time": "Time"}.get(variable, variable.capitalize())


def _samples_panel(result: Result, axis: str) -> Panel:
    data = result.series[f"{axis}/all"]
    ranges = [float(v) * 1e-3 for v in data["range_m"]]
    marks = [
        Mark("points", ranges, [float(v) for v in data["residual"]], role="measured"),
        Mark("rule", y=[0.0], role="reference"),
    ]
    return Panel(f"{_NAMES[axis]} residuals", "Predicted range (km)", "Residual (m)", marks, share_x="range")


def _prediction(rows: Sequence[Estimate]) -> list[Block]:
    body: list[list[str | Cell]] = []
    names = [q.removesuffix("_sigma") for q in AXES.values() if _has(rows, f"predicted_{q}")]
    for line in lines(rows, [f"{n}_variance_ratio" for n in names] + [f"predicted_{n}_sigma" for n in names] + ["snr"]):
        cells: list[str | Cell] = [bin_text(line.first), _short(line, "snr")]
        for n in names:
            predicted, ratio = line.of.get(f"predicted_{n}_sigma"), line.of.get(f"{n}_variance_ratio")
            cells += [value_text(predicted) if predicted else MISSING, estimate_text(ratio) if ratio else MISSING]
        body.append(cells)
    head = ["Bin", "SNR (dB)"]
    for n in names:
        unit = next(shown(r.unit).unit for r in rows if r.quantity == f"predicted_{n}_sigma")
        head += [f"{n.capitalize()} predicted ({unit})", "Variance ratio"]
    words = Paragraph(
        "The predicted sigma is what thermal noise alone would leave after the filter, from the logged SNR, "
        "bandwidth and "
        "beamwidths, for a target at constant velocity. The variance ratio is assessed over predicted: above 1 "
        "speaks of "
        "clutter, multipath, manoeuvre or waveform effects, below 1 of a pessimistic noise model. An interval that "
        "holds 1 "
        "is agreement."
    )
    return [words, Table("Assessed against predicted", head, body)]


def _bracket_table(rows: Sequence[Estimate]) -> Table:
    head, body = ["Bin"], []
    present = [q for q in AXES.values() if _has(rows, q)]
    for quantity in present:
        unit = next(shown(r.unit).unit for r in rows if r.quantity == quantity)
        head += [f"{quantity_name(quantity)} ({unit})", "Optimal gains", "Bracket"]
    ends = ("", "_white", "_bracket_low", "_bracket_high")
    for line in lines(rows, [q + end for q in present for end in ends]):
        cells: list[str | Cell] = [bin_text(line.first)]
        for quantity in present:
            value, white = (_value(line, quantity + end) for end in ends[:2])
            bracket = [_rough(line, quantity + end) for end in ends[2:]]
            cells += [value, white, span_text(*bracket)]
        body.append(cells)
    return Table(
        "What the motion model makes of it: noise only, optimal gains, and the bracket that needs no model", head, body
    )


def _value(line: Line, quantity: str) -> str:
    return value_text(line.of[quantity]) if quantity in line.of else MISSING


def _rough(line: Line, quantity: str) -> str:
    """Two digits: enough for the ends of a bracket."""
    if quantity not in line.of:
        return MISSING
    estimate = line.of[quantity]
    return plain_number(shown(estimate.unit).value(estimate.value), 2)


def _method(result: Result) -> list[Block]:
    settings = result.settings
    if settings["estimator"] == "paper":
        steps = (
            "Estimator: the source paper's formulas to the letter. In each bin the residual variance is the sum of "
            "squares "
            "over N - 1 without removing the mean; the bin means of the gains give the ratio of filtered to residual "
            "variance, (2α² - 3αβ + 2β) / (2(2α + β)). Every usable sample is taken, start-up included, groups "
            "together."
        )
    else:
        steps = (
            "Estimator: recommended. The first 11/α updates after a track begins, restarts after a coast, or changes "
            "its "
            "gains are left out. In each bin the mean residual is removed and reported; each sample is weighted with "
            "the "
            "ratio of filtered to residual variance of its own gains, (2α² - 3αβ + 2β) / (2(2α + β)); angles "
            "divide each sample by its own R² - y²."
        )
    return [
        Paragraph(steps),
        Paragraph(
            "Intervals: chi-square on the effective number of samples, which counts their correlation (Bartlett): "
            "N / (1 + 2 Σ (1 - k/N) ρ²). Bins with fewer than 100 samples borrow the correlation of all bins. Where "
            "the "
            "residuals are not normal and heavy-tailed, the degrees of freedom shrink with the kurtosis."
        ),
        Paragraph(
            "Assumptions: measurement noise is white; gains change slowly against the filter's memory; the target "
            "keeps its "
            "velocity over that memory. Where the last fails, the truth lies between the noise-only and the "
            "optimal-gain "
            "ratio if the manoeuvre stays within the design; the bracket min(α, 1-α) to max(α, 1-α) times the "
            "residual sigma "
            "holds for any motion."
        ),
        Paragraph(
            "Angles are the array's own: sin θe = y/R and sin θa = z/R. θe is the elevation over the array's normal "
            "plane; θa "
            "is not the azimuth away from the principal plane."
        ),
    ]


_BIN_ROWS = (
    ("σ of the estimate (m)", "{a}_sigma"),
    ("  by optimal-gain ratio", "{a}_sigma_white"),
    ("  robust", "{a}_sigma_robust"),
    ("  bracket, any motion", "{a}_sigma_bracket_low"),
    ("RMS with lag (m)", "{a}_rms_with_lag"),
    ("Residual σ (m)", "{a}_residual_sigma"),
    ("Residual mean (m)", "{a}_residual_mean"),
    ("Kurtosis (normal: 3)", "{a}_residual_kurtosis"),
    ("Lag-one correlation", "{a}_residual_correlation"),
    ("  for noise only", "{a}_residual_correlation_noise_only"),
    ("Mean α", "alpha_{a}"),
    ("Mean β", "beta_{a}"),
    ("p, no bias", "{a}_bias_p"),
    ("p, white", "{a}_whiteness_p"),
    ("p, normal", "{a}_normality_p"),
    ("p, one σ over SNR", "{a}_snr_homogeneity_p"),
    ("p, one σ over range", "{a}_range_homogeneity_p"),
)


def _bin_page(result: Result, edges: tuple[float, float], number: int | None) -> Section:
    variable = str(result.settings["variable"])
    title = f"{_variable_name(variable)} {edges_text(variable, *edges)}"
    of = {r.quantity: r for r in pooled(result) if (r.bin_low, r.bin_high) == edges}
    present = [axis for axis in AXES if f"{axis}_sigma" in of]
    here = [r for r in result.rows if (r.bin_low, r.bin_high) == edges]
    blocks: list[Block] = [_bin_headline(here)]
    blocks += _flag_words(of, present)
    grid = [row for axis in present if (row := _bin_panels(result.series, axis, number, of))]
    if grid:
        blocks.append(Figure(
            "Samples over time; histogram with the normal curve; Q-Q; autocorrelation with white noise's 95 % limits.",
            _bin_alt(title, of, present),
            grid, "compact",
        ))  # fmt: skip
    body: list[list[str | Cell]] = []
    for name, pattern in _BIN_ROWS:
        rows = [of.get(pattern.format(a=axis)) for axis in present]
        if any(r is not None and math.isfinite(r.value) for r in rows):
            cells: list[str | Cell] = [name]
            for axis, r in zip(present, rows, strict=True):
                if r is None:
                    cells += [MISSING, MISSING]
                elif r.quantity.endswith("_bracket_low"):
                    cells += ["", span_text(value_text(r), value_text(of[f"{axis}_sigma_bracket_high"]))]
                else:
                    cells += [value_text(r), interval_text(r)]
            body.append(cells)
    head = [""]
    for axis in present:
        head += [_NAMES[axis], "Interval"]
    blocks.append(Table("Numbers", head, body))
    return Section(title, blocks, own_page=True, level=2, key=f"bin-{number if number is not None else edges[0]:g}")


def _bin_alt(title: str, of: Mapping[str, Estimate], present: Sequence[str]) -> str:
    parts = [f"{_NAMES[axis]} sigma {estimate_text(of[axis + '_sigma'])} m" for axis in present]
    return f"{title}: " + ", ".join(parts) + "."


def _bin_headline(rows: Sequence[Estimate]) -> Table:
    """The bin in a line, and a line for each group when there is more than one."""
    quantities = [q for q in (*AXES.values(), "snr") if any(r.quantity == q for r in rows)]
    chosen = without_lone_groups(lines(rows, quantities))
    head = ["Samples of", "n", "Effective"]
    for q in quantities:
        unit = next(shown(r.unit).unit for r in rows if r.quantity == q)
        head.append(f"{quantity_name(q)} ({unit})")
    body: list[list[str | Cell]] = []
    for line in chosen:
        strong = not (line.first.group or line.first.track_id)
        cells = [line.first.group or line.first.track_id or "all", counts(line), plain_number(line.first.n_eff, 4)]
        cells += [_short(line, q) for q in quantities]
        body.append([Cell(c, strong=strong) for c in cells])
    return Table("The bin in short", head, body, "l" + "r" * (len(head) - 1))


def _short(line: Line, quantity: str) -> str:
    """The estimate with its interval; of the SNR, which needs none here, one decimal."""
    if quantity not in line.of:
        return MISSING
    return f"{line.of[quantity].value:.1f}" if quantity == "snr" else estimate_text(line.of[quantity])


def _flag_words(of: Mapping[str, Estimate], present: Sequence[str]) -> list[Block]:
    axes_of: dict[str, list[str]] = {}
    for axis in present:
        for flag in of[f"{axis}_sigma"].flags:
            axes_of.setdefault(flag, []).append(_NAMES[axis].lower())
    if not axes_of:
        return [Notice("No test raised a flag in this bin.", "good")]
    every = len(present)
    text = " ".join(
        f"{flag}{'' if len(axes) == every else ' (' + ', '.join(axes) + ')'}: {FLAGS.get(flag, '')}"
        for flag, axes in axes_of.items()
    )
    return [Notice(text, "caution", "Flags")]


def _bin_panels(
    series: Mapping[str, Any], axis: str, number: int | None, of: Mapping[str, Estimate]
) -> list[Panel | None]:
    here = f"{axis}/{number}"
    if f"{here}/samples" not in series:
        return []
    name = _NAMES[axis]
    samples = series[f"{here}/samples"]
    panels: list[Panel | None] = [
        Panel(
            name, "Time (s)", "Residual (m)",
            [Mark("points", samples["time_s"], samples["residual"]), Mark("rule", y=[0.0], role="reference")],
            share_x="time",
        )
    ]  # fmt: skip
    if f"{here}/histogram" not in series:
        return panels
    mean, sigma = of[f"{axis}_residual_mean"].value, of[f"{axis}_residual_sigma"].value
    bars = series[f"{here}/histogram"]
    edges = [*bars["low"], bars["high"][-1]]
    width = edges[1] - edges[0]
    total = sum(bars["count"])
    steps = [edges[0] + (edges[-1] - edges[0]) * i / 80 for i in range(81)]
    curve = [
        total * width * math.exp(-0.5 * ((x - mean) / sigma) ** 2) / (sigma * math.sqrt(2 * math.pi)) for x in steps
    ]
    qq, acf = series[f"{here}/qq"], series[f"{here}/autocorrelation"]
    ends = [qq["normal"][0], qq["normal"][-1]]
    limit = 1.96 / math.sqrt(max(of[f"{axis}_sigma"].n, 1))
    panels += [
        Panel("Histogram", "Residual (m)", "Samples",
              [Mark("bars", edges, bars["count"]), Mark("line", steps, curve, role="predicted")]),
        Panel("Q-Q", "Normal quantile", "Residual (m)",
              [Mark("points", qq["normal"], qq["residual"]),
               Mark("line", ends, [mean + sigma * z for z in ends], role="predicted")]),
        Panel("Autocorrelation", "Lag (updates)", "ρ",
              [Mark("stems", acf["lag"], acf["correlation"]), Mark("rule", y=[-limit, limit], role="limit"),
               Mark("rule", y=[0.0], role="reference")]),
    ]  # fmt: skip
    return panels
