"""The chapter on RCS and detection: RCS per bin, over time and over aspect, detection probability, and the fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from rangeeval.model import Estimate, Result
from rangeeval.reporting.blocks import Block, Cell, Figure, Mark, Notice, Panel, Paragraph, Section, Table
from rangeeval.reporting.polar import Sector, polar_panel
from rangeeval.reporting.sections.common import flag_notices
from rangeeval.reporting.tables import lines
from rangeeval.reporting.wording import (
    MISSING,
    bin_text,
    decimals_for,
    estimate_text,
    flags_text,
    in_shown_unit,
    plain_number,
)
from rangeeval.units import shown, shown_variable

NAME = "Detection probability and RCS"
HEADLINE = ("detection_probability", "rcs")
NOTE = (
    "Intervals: {confidence:.0%}. {case_verdict} "
    "An error of the radar equation goes straight into the RCS and is in no interval."
)

_DBSM = shown("m^2")
_TESTS = (
    ("amplitude_ad_p", "Amplitudes (Anderson-Darling)"),
    ("amplitude_ks_p", "Amplitudes (Kolmogorov-Smirnov)"),
    ("detections_p", "Number of detections"),
)


def sections(result: Result) -> list[Section]:
    """Results, the fit behind them, and the method."""
    return [
        Section("RCS and detection", _overview(result), key="rcs"),
        Section("Does the fluctuation model hold", _fit(result), level=2, key="rcs-fit"),
        Section("How RCS was assessed", _method(result), level=2, key="rcs-method"),
    ]


def summary_figure(result: Result) -> Figure:
    """Detection probability and RCS over the bins, for the summary page."""
    return Figure(
        "Detection probability with its interval against the fitted model, and mean RCS with its interval, per bin.",
        _alt(result),
        [[_probability_panel(result), _rcs_panel(result)]],
    )


def short_tables(result: Result, caption: str, *, summary: bool = False) -> list[Table]:
    """What a terminal and the report's first page show: one table for both."""
    return [rcs_table(result, caption)]


def rcs_table(result: Result, caption: str) -> Table:
    """One line a bin (and target): detections, probability, and the RCS in dBsm and in m^2."""
    wanted = ("detection_probability", "detection_probability_model", "rcs")
    chosen = lines((r for r in result.rows if r.group is None), wanted)
    named = any(line.first.track_id for line in chosen)
    head = ["Bin", *(["Target"] if named else []), "Looks", "Seen", "Pd", "Model", "RCS (dBsm)", "RCS (m²)"]
    body: list[list[str | Cell]] = []
    for line in chosen:
        cells: list[str | Cell] = [bin_text(line.first)]
        if named:
            cells.append(line.first.track_id or "all")
        rcs = line.of.get("rcs")
        cells += [str(line.first.n), str(line.first.extra.get("detections", ""))]
        seen, model = (line.of.get(q) for q in wanted[:2])
        cells += [estimate_text(seen) if seen else MISSING, _share(model.value) if model else MISSING]
        cells += [estimate_text(rcs), _square_metres(rcs)] if rcs else [MISSING, MISSING]
        cells.append(flags_text(line.flags))
        body.append(cells)
    return Table(caption, [*head, "Flags"], body, "l" * (2 if named else 1) + "r" * 6 + "l")


def _share(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else MISSING


def _square_metres(row: Estimate) -> str:
    """The same in m^2."""
    return estimate_text(replace(row, unit="m²"))


def _pooled(result: Result, quantity: str, *, bins: bool = True) -> list[Estimate]:
    return [
        r for r in result.rows
        if r.quantity == quantity and r.group is None and r.track_id is None and (r.variable is not None) == bins
    ]  # fmt: skip


def _whole(result: Result, quantity: str) -> Estimate | None:
    return next(iter(_pooled(result, quantity, bins=False)), None)


def _alt(result: Result) -> str:
    rcs = _whole(result, "rcs")
    seen = _whole(result, "detection_probability")
    parts = []
    if rcs:
        parts.append(f"mean RCS of the whole trial {estimate_text(rcs)} dBsm")
    if seen:
        parts.append(f"detection probability {estimate_text(seen)} over {seen.n} looks")
    return ("; ".join(parts) + ".").capitalize()


def _across(result: Result) -> tuple[str, float, str]:
    variable = str(result.settings["variable"])
    unit = shown_variable(variable)
    names = {"snr": "SNR of 1 m²", "time": "Time", "range": "Range", "aspect": "Aspect"}
    name = names.get(variable, variable.capitalize())
    return variable, unit.scale, f"{name} ({unit.unit})"


def _rcs_marks(rows: Sequence[Estimate], scale: float, label: str, role: str) -> list[Mark]:
    """Estimates with intervals, and limits where there is no estimate."""
    good = [r for r in rows if math.isfinite(r.value) and r.value > 0]
    marks = [Mark(
        "errorbars", [0.5 * (r.bin_low + r.bin_high) * scale for r in good], [_DBSM.value(r.value) for r in good],
        low=[_DBSM.value(r.low if r.low > 0 else 1e-3 * r.value) for r in good],
        high=[_DBSM.value(r.high if math.isfinite(r.high) else r.value) for r in good],
        label=label, role=role,
    )]  # fmt: skip
    for flag, end, words in (
        ("upper-limit", "high", "upper limit, nothing detected"),
        ("lower-limit", "low", "lower limit, nothing but hits"),
    ):
        limits = [r for r in rows if flag in r.flags and 0 < getattr(r, end) < math.inf]
        if limits:
            x = [0.5 * (r.bin_low + r.bin_high) * scale for r in limits]
            marks.append(Mark("points", x, [_DBSM.value(getattr(r, end)) for r in limits], label=words, role="limit"))
    return marks


def _whole_marks(result: Result) -> list[Mark]:
    whole = _whole(result, "rcs")
    if whole is None or not math.isfinite(whole.value):
        return []
    label = "whole trial, one RCS"
    return [Mark("rule", y=[_DBSM.value(whole.value)], label=label, role="predicted")]


def _rcs_panel(result: Result) -> Panel:
    _, scale, name = _across(result)
    marks = [*_whole_marks(result), *_rcs_marks(_pooled(result, "rcs"), scale, "per bin, with interval", "measured")]
    return Panel("Mean RCS", name, "RCS (dBsm)", marks, share_x="bins")


def _probability_panel(result: Result) -> Panel:
    variable, scale, name = _across(result)
    measured = _pooled(result, "detection_probability")
    marks: list[Mark] = []
    curve = result.series.get("curve")
    if curve and variable == "range":
        x = [float(v) * scale for v in curve["range_m"]]
        value, low, high = ([math.nan if v is None else float(v) for v in curve[c]] for c in ("value", "low", "high"))
        marks += [
            Mark("band", x, low=low, high=high, label="band of the model", role="predicted"),
            Mark("line", x, value, label="model at the fitted RCS", role="predicted"),
        ]
    else:
        model = _pooled(result, "detection_probability_model")
        x = [0.5 * (r.bin_low + r.bin_high) * scale for r in model]
        marks.append(Mark("points", x, [r.value for r in model], label="model at the fitted RCS", role="predicted"))
    marks.append(Mark(
        "errorbars", [0.5 * (r.bin_low + r.bin_high) * scale for r in measured], [r.value for r in measured],
        low=[r.low for r in measured], high=[r.high for r in measured],
        label="detected share, with interval", role="measured",
    ))  # fmt: skip
    return Panel("Detection probability", name, "Pd", marks, share_x="bins", y_limits=(0.0, 1.03))


def _overview(result: Result) -> list[Block]:
    s = result.settings
    blocks: list[Block] = [Notice(str(s["case_verdict"]), "info", "Fluctuation")]
    homogeneous = _whole(result, "rcs_homogeneity_p")
    if homogeneous is not None and homogeneous.value < 0.01:
        blocks.append(Notice(
            f"One mean RCS does not fit all bins (p = {plain_number(homogeneous.value, 2)}). If the target is one and "
            "seen from one side, the loss or energy model behind snr_per_m2 is wrong, or clutter is counted as target; "
            "else the RCS changes with aspect.", "caution", "RCS differs between bins",
        ))  # fmt: skip
    if s.get("calibration_db"):
        blocks.append(Notice(
            f"The calibration of the radar (standard error {s['calibration_db']:g} dB) is common to every RCS here "
            f"and in "
            "none of the intervals.", "info", "Calibration",
        ))  # fmt: skip
    blocks.append(rcs_table(result, f"Every bin, with {s['confidence'] * 100:g} % intervals"))
    blocks.append(Figure(
        "Share of looks that were detected, with Wilson intervals, against what the fitted RCS and the radar equation "
        "give; the band is the model at the ends of the interval of the RCS.", _alt(result),
        [[_probability_panel(result)], [_rcs_panel(result)]],
    ))  # fmt: skip
    distances = _ranges_table(result)
    blocks += [distances] if distances else []
    blocks += _aspect(result)
    blocks += _sliding(result)
    return [*blocks, *flag_notices(result)]


def _ranges_table(result: Result) -> Table | None:
    body: list[list[str | Cell]] = []
    for row in result.rows:
        if row.quantity.startswith("detection_range_") and math.isfinite(row.value):
            low, high = sorted((row.low * 1e-3, row.high * 1e-3))
            digits = decimals_for(low, high)
            shown_digits = 1 if digits is None else digits
            ends = f"{low:.{shown_digits}f} to {high:.{shown_digits}f}" if math.isfinite(low + high) else MISSING
            percent = row.quantity.removeprefix("detection_range_")
            body.append([f"{percent} %", f"{row.value * 1e-3:.{shown_digits}f}", ends, flags_text(row.flags)])
    if not body:
        return None
    return Table(
        "Range at which the model's detection probability falls to", ["Pd", "Range (km)", "Interval", "Flags"], body,
        "lrrl",
    )  # fmt: skip


def _aspect(result: Result) -> list[Block]:
    data = result.series.get("aspect")
    if not data:
        return []
    rows = [
        Estimate(
            quantity="rcs", unit="m^2", value=_number(s), low=_number(low), high=_number(high),
            bin_low=float(a), bin_high=float(b), flags=("upper-limit",) if s is None or s != s else (),
        )
        for a, b, s, low, high in zip(*(data[c] for c in ("low_rad", "high_rad", "rcs_m2", "low_m2", "high_m2")),
                                      strict=True)
    ]  # fmt: skip
    degrees = shown_variable("aspect")
    marks = [*_whole_marks(result), *_rcs_marks(rows, degrees.scale, "per aspect, with interval", "measured")]
    x_limits = (degrees.scale * float(data["low_rad"][0]), degrees.scale * float(data["high_rad"][-1]))
    plain = Panel("The same over a straight axis", "Aspect (°)", "RCS (dBsm)", marks, x_limits=x_limits)
    whole = _whole(result, "rcs")
    level = _decibels(whole.value) if whole else math.nan
    around = polar_panel(
        "Mean RCS over aspect", [_sector(row) for row in rows], "dBsm", label="per aspect, with interval", level=level,
        level_label="whole trial, one RCS",
    )  # fmt: skip
    return [Figure(
        "Mean RCS over aspect: the nose is up, angles go clockwise from it, rings are in dBsm, bars are intervals. "
        "Where nothing was detected there is only an upper limit, drawn on the straight axis.",
        _alt(result), [[around, plain]], "tall",
    )]  # fmt: skip


def _sector(row: Estimate) -> Sector:
    value, low, high = (_decibels(v) for v in (row.value, row.low, row.high))
    stretch = f"{math.degrees(row.bin_low):.0f}° to {math.degrees(row.bin_high):.0f}°"
    return Sector(row.bin_low, row.bin_high, value, low, high, f"{stretch}: {estimate_text(row)} dBsm")


def _number(value: object) -> float:
    return float(value) if isinstance(value, (int, float)) else math.nan


def _sliding(result: Result) -> list[Block]:
    panels = []
    for name, data in result.series.items():
        if not name.startswith("sliding/"):
            continue
        x = [float(v) for v in data["time_s"]]
        value, low, high = ([_decibels(v) for v in data[c]] for c in ("rcs_m2", "low_m2", "high_m2"))
        target = name.removeprefix("sliding/")
        finite = [v for v in value if math.isfinite(v)]
        floor = min(finite, default=-20.0) - 6.0
        marks = [Mark("band", x, low=[max(v, floor) if v == v else floor for v in low], high=high,
                      label="interval", role="measured"),
                 Mark("line", x, value, label="sliding estimate", role="measured"), *_whole_marks(result)]  # fmt: skip
        title = f"RCS over the last {result.settings['window']} looks" + (f", target {target}" if target else "")
        panels.append([Panel(title, "Time (s)", "RCS (dBsm)", marks, share_x="time")])
    if not panels:
        return []
    return [Figure(
        f"Sliding estimate of the mean RCS over {result.settings['window']} looks, with its interval. Its width is the "
        "point: so few looks say little.", "Sliding mean RCS over time.", panels[:6],
    )]  # fmt: skip


def _decibels(value: object) -> float:
    number = _number(value)
    return 10.0 * math.log10(number) if 0 < number < math.inf else math.nan


def _case_name(case: str) -> str:
    return "Free shape" if case == "free" else f"Swerling {case}"


def _fit(result: Result) -> list[Block]:
    s = result.settings
    blocks: list[Block] = []
    bars = result.series.get("amplitudes")
    if bars:
        edges = [float(v) for v in bars["low_db"]] + [float(bars["high_db"][-1])]
        centres = [0.5 * (a + b) for a, b in pairwise(edges)]
        marks = [Mark("bars", edges, [float(v) for v in bars["count"]], label="detected", role="measured")]
        for number, case in enumerate(s["cases"], start=2):
            fitted = result.series.get(f"amplitudes/{case}")
            if fitted:
                expected = [float(v) for v in fitted["expected"]]
                marks.append(Mark("line", centres, expected, label=_case_name(str(case)), role=f"group{number}"))
        panel = Panel("Amplitudes", "Power over mean noise power (dB)", "Detections", marks)
        blocks.append(Figure(
            "Amplitudes of the detections, and how many each fitted case expects in the same steps.",
            "Histogram of detected amplitudes with the curves of the fitted cases.", [[panel]],
        ))  # fmt: skip
    cases = [[_case_name(str(r.group)), plain_number(r.value, 7)] for r in result.rows if r.quantity == "aic_all_bins"]
    if cases:
        blocks.append(Paragraph(str(s["case_verdict"])))
        blocks.append(
            Table("Akaike's criterion of each case, one RCS a bin (smaller is better)", ["Case", "AIC"], cases)
        )
        shape = _whole(result, "swerling_shape")
        if shape is not None:
            blocks.append(Paragraph(
                f"With a free shape the best is K = {estimate_text(shape)} (Swerling 1: 1, Swerling 3: 2, steady: "
                "beyond reach); it is shown for comparison and chosen only when asked for."
            ))  # fmt: skip
    tested = [q for q, _ in _TESTS if _whole(result, q) is not None]
    if tested:
        body: list[list[str | Cell]] = []
        for line in lines((r for r in result.rows if r.group is None and r.track_id is None),
                          (*tested, "amplitude_correlation")):  # fmt: skip
            rho = line.of.get("amplitude_correlation")
            body.append([
                bin_text(line.first), *(plain_number(line.of[q].value, 2) if q in line.of else MISSING for q in tested),
                estimate_text(rho) if rho else MISSING,
            ])  # fmt: skip
        head = ["Bin", *(words for q, words in _TESTS if q in tested), "Correlation of consecutive looks"]
        blocks.append(Table(f"p-values of the fitted model ({s['replicates']} bootstrap replicates)", head, body))
    return blocks


_METHODS = {
    "ml-a": "exact maximum likelihood (ML-A)",
    "em-a": "expectation maximisation (EM-A)",
    "ml-b": "the approximate iteration with a guard on the likelihood (ML-B)",
    "em-b": "the approximate iteration with a guard on Q (EM-B)",
    "med": "the median rule (MED)",
}


_INTERVALS = {
    "profile": "profile likelihood",
    "bootstrap": "parametric bootstrap, quantiles of the RCS fitted to looks simulated with the RCS found",
    "credible": "Bayesian, equal tails, prior 1 / (s + 1 / mean snr_per_m2)",
}


def _method(result: Result) -> list[Block]:
    s = result.settings
    amplitude = "signal plus noise over mean noise power" if s["amplitude"] == "signal-plus-noise" else (
        "signal over mean noise power; 1 a pulse was added"
    )  # fmt: skip
    gain = f" The loop gain is {in_shown_unit(s['loop_gain_db'], 'dB')}." if s.get("loop_gain_db") is not None else ""
    return [
        Paragraph(
            f"Estimator: {_METHODS.get(str(s['method']), str(s['method']))}. A detection contributes the density of "
            f"its "
            "amplitude, a miss the probability that the echo stayed below the threshold of its own look, both for the "
            "mean SNR that the RCS would give there. Leaving misses out would bias the RCS upward where few looks are "
            "detected."
        ),
        Paragraph(
            f"Amplitudes were read as {amplitude} (set by [detections] in trial.toml).{gain} An error of x dB in the "
            f"SNR "
            "of 1 m² is an error of -x dB in every RCS."
        ),
        Paragraph(
            f"Intervals: {_INTERVALS[str(s.get('interval', 'profile'))]}. Where nothing was detected the number is a "
            "one-sided upper limit, where nothing bounds the RCS from above a lower limit, both exact. The case is "
            "chosen over the whole trial, never in a bin; where cases are not distinguishable the interval holds those "
            "of each of them."
        ),
        Paragraph(
            "Assumptions: looks are independent; every detection is the target; the RCS is one number inside a bin. "
            "p-values come from a parametric bootstrap, since the RCS is estimated from the same looks."
        ),
    ]
