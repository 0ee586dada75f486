"""The chapter on replay: does the filter fit its innovations, the trajectory, the modes, filters compared, tracks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from rangeeval.model import Estimate, Result
from rangeeval.reporting.blocks import Block, Cell, Figure, Mark, Notice, Panel, Paragraph, Section, Table
from rangeeval.reporting.sections.common import flag_notices
from rangeeval.reporting.tables import Line, lines
from rangeeval.reporting.wording import MISSING, bin_text, estimate_text, flags_text, plain_number, span_text, unit_name
from rangeeval.units import shown, shown_variable

NAME = "Replay"
NOTE = (
    "Filter: {filter}. NIS ratio: 1 when the filter's noise fits its innovations; in brackets its {confidence:.0%} "
    "interval. Innovations show no constant bias of the radar."
)
MANY = 40  # tracks in a table; the rest is in the estimates
_COORDINATES = ("range", "azimuth", "elevation")
_COLUMNS = {
    "nis_ratio": "NIS ratio", "log_likelihood_per_update": "Log-likelihood per update",
    "range_innovation_sigma": "Range innovation σ (m)", "azimuth_innovation_sigma": "Azimuth innovation σ (arcmin)",
    "elevation_innovation_sigma": "Elevation innovation σ (arcmin)", "position_rms": "Position RMS error (m)",
}  # fmt: skip
_NARROW = tuple(q for q in _COLUMNS if q not in ("log_likelihood_per_update", "position_rms"))
_ERRORS = {
    "x_rms": "x, east (m)", "y_rms": "y, north (m)", "z_rms": "z, up (m)", "position_rms": "Position (m)",
    "velocity_rms": "Velocity (m/s)", "prediction_rms": "Prediction (m)", "plot_rms": "Plots themselves (m)",
    "nees_mean": "NEES",
}  # fmt: skip
_ERROR_TABLES = (
    ("RMS error of the filtered position; axes x east, y north, z up", ("x_rms", "y_rms", "z_rms", "position_rms")),
    ("RMS error of velocity, of the prediction, and of the plots themselves; NEES, which is 6 (planar 4) if all fits",
     ("velocity_rms", "prediction_rms", "plot_rms", "nees_mean")),
)  # fmt: skip
_SETS = (
    "ospa", "ospa_localisation", "ospa_cardinality", "gospa", "gospa_localisation", "gospa_missed", "gospa_false",
    "track_completeness", "track_ambiguity", "track_spuriousness", "track_purity",
)  # fmt: skip


def sections(result: Result) -> list[Section]:
    """Consistency, innovations, modes, comparison, truth, tracks, and the method."""
    found = [Section("Replay", _overview(result), key="replay")]
    for title, key, blocks in (
        ("Innovations", "innovations", _innovations(result)),
        ("Which model when", "modes", _modes(result)),
        ("Filters compared", "filters", _filters(result)),
        ("Replayed tracks against truth", "replay-truth", _truth(result)),
        ("Track by track", "replay-tracks", _tracks(result)),
        ("How replay was assessed", "replay-method", _method(result)),
    ):
        if blocks:
            found.append(Section(title, blocks, level=2, key=key))
    return found


def short_tables(result: Result, caption: str, *, summary: bool = False) -> list[Table]:
    """What a terminal and the summary show: consistency and errors, bin by bin, and filters compared."""
    if summary:
        return [_bin_table(result, caption, _NARROW)]
    found = (_noise_table(result), _tuned_table(result), _filter_table(result), _paired_table(result))
    return [_bin_table(result, caption), *(t for t in found if t)]


def summary_figure(result: Result) -> Figure | None:
    """The trajectories."""
    return _trajectory(result)


def _of(result: Result, *, binned: bool | None = None, track: bool = False, group: bool = False) -> list[Estimate]:
    return [
        r for r in result.rows
        if (r.track_id is not None) == track and (r.group is not None) == group
        and (binned is None or (r.variable is not None) == binned)
    ]  # fmt: skip


def _whole(result: Result, quantity: str) -> Estimate | None:
    return next((r for r in _of(result, binned=False) if r.quantity == quantity), None)


def _numbers(values: Sequence[Any]) -> list[float]:
    return [math.nan if v is None else float(v) for v in values]


def _extra(row: Estimate, name: str) -> float:
    value = row.extra.get(name)
    return float(value) if isinstance(value, (int, float)) else math.nan


def _cells(line: Line, quantities: Sequence[str]) -> list[str | Cell]:
    return [estimate_text(line.of[q]) if q in line.of else MISSING for q in quantities]


def _bin_table(result: Result, caption: str, columns: Sequence[str] = tuple(_COLUMNS)) -> Table:
    chosen = [q for q in columns if any(r.quantity == q for r in _of(result))]
    body = [
        [bin_text(line.first), str(line.first.n), *_cells(line, chosen), flags_text(line.flags)]
        for line in lines(_of(result), chosen)
    ]
    return Table(caption, ["Bin", "Updates", *(_COLUMNS[q] for q in chosen), "Flags"], body,
                 "l" + "r" * (1 + len(chosen)) + "l")  # fmt: skip


_ORIGIN = {
    "given": "given in trial.toml", "from-scatter": "from the plots' own scatter", "tuned": "by the likelihood",
    "assumed-noise": "assumed: too few plots to show it",
}  # fmt: skip


def _noise_table(result: Result) -> Table:
    body = []
    for coordinate in _COORDINATES:
        row = _whole(result, f"{coordinate}_noise")
        if row is not None:
            where = next((_ORIGIN[f] for f in row.flags if f in _ORIGIN), "")
            body.append([coordinate.capitalize(), estimate_text(row), unit_name(row.unit), where])
    return Table("Measurement noise given to the filter", ["Coordinate", "σ", "Unit", "Where from"], body, "lrll")


def _tuned_table(result: Result) -> Table | None:
    body: list[list[str | Cell]] = []
    for r in result.rows:
        if r.quantity.startswith("tuned_") and not r.quantity.endswith(
            ("range_noise", "azimuth_noise", "elevation_noise")
        ):
            unit = {"m_s2": "m/s²", "rad_s": "rad/s"}.get(r.unit, "")
            words = r.quantity.removeprefix("tuned_").replace("_", " ")
            body.append([words, estimate_text(replace(r, unit=unit)), unit, flags_text(r.flags)])
        elif r.quantity.startswith("tuning_gain"):
            where = " on tracks held out" if r.quantity.endswith("held_out") else ""
            body.append([f"gain in log-likelihood per update{where}", estimate_text(r), "", flags_text(r.flags)])
    if not body:
        return None
    return Table(
        "Tuned to the plots (numbers count the filter's models)", ["Parameter", "Value", "Unit", "Flags"], body, "lrll"
    )


def _verdict(result: Result) -> list[Block]:
    """Whether the filter fits, in words."""
    row = _whole(result, "nis_ratio")
    if row is None or not math.isfinite(row.value):
        return [Notice("No track has an update: nothing can be said of the filter.", "caution", "Replay")]
    region = span_text(*(plain_number(_extra(row, f"accept_{end}"), 3) for end in ("low", "high")))
    head = f"NIS ratio {estimate_text(row)}; a filter whose assumptions hold lies in {region}"
    if "optimistic" in row.flags:
        text = ". It believes itself better than it is: more measurement or process noise, or another model, is needed."
        return [Notice(head + text, "caution", "Optimistic filter")]
    if "pessimistic" in row.flags:
        text = ". It allows for more noise than there is: safe, but it smooths less than it could (--tune)."
        return [Notice(head + text, "info", "Pessimistic filter")]
    return [Notice(head + ".", "good", "Consistent filter")]


def _overview(result: Result) -> list[Block]:
    s = result.settings
    blocks: list[Block] = [*_verdict(result), _noise_table(result)]
    blocks += [tuned] if (tuned := _tuned_table(result)) else []
    blocks.append(_bin_table(result, f"Every bin, with {s['confidence'] * 100:g} % intervals", _NARROW))
    drawn = _trajectory(result)
    blocks += [drawn] if drawn else []
    return [*blocks, *flag_notices(result)]


def _named(result: Result, prefix: str) -> list[tuple[str, Any]]:
    return [(k.removeprefix(prefix), v) for k, v in result.series.items() if k.startswith(prefix)]


def _trajectory(result: Result) -> Figure | None:
    above, height = [], []
    for number, (name, data) in enumerate(_named(result, "trajectory/"), start=1):
        east, north = (_numbers(data[c]) for c in ("east_m", "north_m"))
        x, y = ([1e-3 * v for v in values] for values in (east, north))
        role = f"group{number}"
        above.append(Mark("line", x, y, label=f"track {name}", role=role))
        across = [math.hypot(a, b) for a, b in zip(x, y, strict=True)]
        if "up_m" in data:
            height.append(Mark("line", across, [1e-3 * v for v in _numbers(data["up_m"])], role=role))
    for number, (_, data) in enumerate(_named(result, "truth/")):
        x, y = ([1e-3 * v for v in _numbers(data[c])] for c in ("east_m", "north_m"))
        above.append(Mark("line", x, y, label="truth" if not number else "", role="reference"))
        if "up_m" in data:
            up = [1e-3 * v for v in _numbers(data["up_m"])]
            height.append(Mark("line", [math.hypot(a, b) for a, b in zip(x, y, strict=True)], up, role="reference"))
    if not above:
        return None
    panels = [Panel("From above", "East (km)", "North (km)", above)]
    panels += [Panel("Height", "Ground range (km)", "Up (km)", height)] if height else []
    return Figure(
        "The filtered trajectory of the longest tracks, from above"
        + (", and in height over ground range." if height else "; there is no elevation, so in the slant plane."),
        f"Paths of {len(_named(result, 'trajectory/'))} tracks around the radar.",
        [panels],
    )


def _innovations(result: Result) -> list[Block]:
    names = list(dict.fromkeys(k.split("/", 2)[2] for k in result.series if k.startswith("innovation/")))
    blocks: list[Block] = []
    for name in names[:2]:
        panels = []
        for c in _COORDINATES:
            data = result.series.get(f"innovation/{c}/{name}")
            bound = result.series.get(f"bound/{c}/{name}")
            if not data or not bound:
                continue
            unit = shown("m" if c == "range" else "rad")
            line = [v * unit.scale for v in _numbers(bound["value"])]
            marks = [
                *_bands(_numbers(bound["time_s"]), line),
                Mark("points", _numbers(data["time_s"]), [v * unit.scale for v in _numbers(data["value"])],
                     label="innovation", role="measured"),
            ]  # fmt: skip
            panels.append([Panel(c.capitalize(), "Time (s)", f"{c.capitalize()} ({unit.unit})", marks, share_x="time")])
        if panels:
            blocks.append(Figure(
                f"Innovations of track {name} with the bounds the filter itself gives: 19 in 20 should lie inside.",
                f"Innovations of track {name} over time.", panels,
            ))  # fmt: skip
    body: list[list[str | Cell]] = []
    for c in _COORDINATES:
        rho, p = _whole(result, f"{c}_innovation_correlation"), _whole(result, f"{c}_whiteness_p")
        if rho is not None:
            body.append([c.capitalize(), estimate_text(rho), plain_number(p.value, 2) if p else MISSING])
    if body:
        blocks.append(Table(
            "Whiteness: innovations of a filter that fits are not correlated from plot to plot",
            ["Coordinate", "Correlation at lag one", "p of Ljung and Box, 10 lags"], body,
        ))  # fmt: skip
        blocks.append(Paragraph(
            "A negative correlation says that the filter follows noise (too much process noise); a positive one that "
            "it lags behind manoeuvres (too little)."
        ))  # fmt: skip
    return blocks


def _bands(time: Sequence[float], line: Sequence[float]) -> list[Mark]:
    """The bounds as a band for each stretch without a gap; only the first is listed in the legend."""
    pieces: list[tuple[list[float], list[float]]] = [([], [])]
    for t, v in zip(time, line, strict=True):
        if math.isfinite(v):
            pieces[-1][0].append(t)
            pieces[-1][1].append(v)
        elif pieces[-1][0]:
            pieces.append(([], []))
    return [
        Mark("band", x, low=[-v for v in y], high=y, label="" if k else "±2σ of the filter", role="predicted")
        for k, (x, y) in enumerate(p for p in pieces if len(p[0]) > 1)
    ]


def _modes(result: Result) -> list[Block]:
    words = list(result.settings.get("modes") or [])
    panels = []
    for name, data in _named(result, "modes/"):
        time = _numbers(data["time_s"])
        marks = [
            Mark("line", time, _numbers(data[f"mode_{m}"]), label=f"{m}: {text}", role=f"group{m}")
            for m, text in enumerate(words, start=1)
        ]
        panels.append([Panel(f"Track {name}", "Time (s)", "Probability", marks, share_x="", y_limits=(-0.03, 1.03))])
    if not panels:
        return []
    return [Figure(
        "How probable each motion model is after every plot. A switch that lasts is a manoeuvre; flicker says that the "
        "models are too alike for this noise.", "Probabilities of the models over time.", panels[:3],
    )]  # fmt: skip


def _filter_table(result: Result) -> Table | None:
    wanted = ("nis_ratio", "log_likelihood_per_update", "range_innovation_sigma", "position_rms", "velocity_rms")
    rows = [r for r in _of(result, binned=False, group=True) if r.quantity in wanted]
    if not rows:
        return None
    present = [q for q in wanted if any(r.quantity == q for r in rows)]
    heads = {**_COLUMNS, "velocity_rms": "Velocity RMS error (m/s)"}
    body: list[list[str | Cell]] = [
        [line.first.group or "", str(line.first.n), *_cells(line, present), flags_text(line.flags)]
        for line in lines(rows, present)
    ]
    return Table("The filters on the same plots", ["Filter", "Updates", *(heads[q] for q in present), "Flags"], body,
                 "l" + "r" * (1 + len(present)) + "l")  # fmt: skip


def _paired_table(result: Result) -> Table | None:
    wanted = {
        "log_likelihood_difference": "Log-likelihood per update",
        "squared_error_difference": "Squared error (m²)",
    }
    body: list[list[str | Cell]] = []
    for r in result.rows:
        if r.quantity in wanted and r.group:
            half = 0.5 * (r.high - r.low)
            body.append([r.group, wanted[r.quantity], plain_number(r.value, 4), f"±{plain_number(half, 3)}",
                         str(r.n), flags_text(r.flags)])  # fmt: skip
    if not body:
        return None
    head = ["Filters", "Difference of", "Mean", "Interval", "Updates", "Verdict on the first"]
    return Table("Paired differences, update by update", head, body, "llrrrl")


def _filters(result: Result) -> list[Block]:
    found = [t for t in (_filter_table(result), _paired_table(result)) if t]
    if not found:
        return []
    text = (
        "All filters had the same plots, so their differences are judged update by update; the interval counts the "
        "memory of the differences. The likelihood needs no truth."
    )
    panel = _rms_by_filter(result)
    return [Paragraph(text), *found, *([panel] if panel else [])]


def _rms_by_filter(result: Result) -> Figure | None:
    rows = [r for r in _of(result, binned=True, group=True) if r.quantity == "position_rms" and math.isfinite(r.value)]
    names = list(dict.fromkeys(r.group or "" for r in rows))
    if not names or not rows:
        return None
    unit = shown_variable(rows[0].variable or "")
    marks = []
    for number, name in enumerate(names, start=1):
        own = [r for r in rows if r.group == name]
        centres = [0.5 * (r.bin_low + r.bin_high) * unit.scale for r in own]
        marks.append(Mark("line", centres, [r.value for r in own], label=name, role=f"group{number}"))
    panel = Panel("Position error", f"{(rows[0].variable or '').capitalize()} ({unit.unit})", "RMS error (m)", marks)
    return Figure("Position RMS error of each filter, bin by bin.", "Position errors of the filters by bin.", [[panel]])


def _truth(result: Result) -> list[Block]:
    rows = _of(result)
    present = [q for q in _ERRORS if any(r.quantity == q for r in rows)]
    if not present:
        return []
    blocks: list[Block] = []
    for caption, wanted in _ERROR_TABLES:
        shown_ = [q for q in wanted if q in present]
        body = [[bin_text(line.first), *_cells(line, shown_), flags_text(line.flags)] for line in lines(rows, shown_)]
        head = ["Bin", *(_ERRORS[q] for q in shown_), "Flags"]
        blocks += [Table(caption, head, body, "l" + "r" * len(shown_) + "l")] if shown_ else []
    curves = _axis_figure(result)
    blocks += [curves] if curves else []
    sets: list[list[str | Cell]] = [
        [r.quantity.replace("_", " "), estimate_text(r), unit_name(r.unit) if r.unit != "m^2" else "m²"]
        for q in _SETS if (r := _plain_squares(_whole(result, q))) is not None
    ]  # fmt: skip
    if sets:
        blocks.append(
            Table("Sets of tracks against sets of targets, over all times", ["Measure", "Value", "Unit"], sets, "lrl")
        )
    held = [
        r
        for r in _of(result, binned=False, track=True)
        if r.quantity in ("track_breaks", "identity_changes", "track_latency")
    ]
    if held:
        body = [
            [line.first.track_id or "", *(plain_number(line.of[q].value, 4) if q in line.of else MISSING
                                          for q in ("track_breaks", "identity_changes", "track_latency"))]
            for line in lines(held)[:MANY]
        ]  # fmt: skip
        blocks.append(
            Table("How each target was followed", ["Target", "Breaks", "Changes of track", "Latency (s)"], body)
        )
    return blocks


def _plain_squares(row: Estimate | None) -> Estimate | None:
    """A row in m^2 that is no radar cross section: shown as it is, not in dBsm."""
    return replace(row, unit="m²") if row is not None and row.unit == "m^2" else row


def _axis_figure(result: Result) -> Figure | None:
    panels = []
    for quantity in ("x_rms", "y_rms", "z_rms"):
        rows = [r for r in _of(result, binned=True) if r.quantity == quantity and math.isfinite(r.value)]
        if len(rows) < 2:
            continue
        unit = shown_variable(rows[0].variable or "")
        centres = [0.5 * (r.bin_low + r.bin_high) * unit.scale for r in rows]
        low, high = ([_or(getattr(r, end), r.value) for r in rows] for end in ("low", "high"))
        label = "RMS error, with interval"
        mark = Mark("errorbars", centres, [r.value for r in rows], low=low, high=high, label=label, role="measured")
        across = f"{(rows[0].variable or '').capitalize()} ({unit.unit})"
        panels.append([Panel(_ERRORS[quantity], across, "RMS (m)", [mark], share_x="bins")])
    if not panels:
        return None
    return Figure("RMS error of the filtered position, axis by axis.", "Errors by axis and bin.", panels)


def _or(value: float, other: float) -> float:
    return value if math.isfinite(value) else other


def _tracks(result: Result) -> list[Block]:
    wanted = ("nis_ratio", "log_likelihood", "updates")
    rows = [r for r in _of(result, binned=False, track=True) if r.quantity in wanted]
    found = lines(rows, wanted)
    if len(found) < 2:
        return []
    body: list[list[str | Cell]] = [
        [line.first.track_id or "", f"{line.of['updates'].value:.0f}", estimate_text(line.of["nis_ratio"]),
         plain_number(line.of["log_likelihood"].value, 6), flags_text(line.flags)]
        for line in found[:MANY]
    ]  # fmt: skip
    blocks: list[Block] = [
        Table("Every track", ["Track", "Updates", "NIS ratio", "Log-likelihood", "Flags"], body, "lrrrl")
    ]
    if len(found) > MANY:
        blocks.append(Paragraph(f"The first {MANY} of {len(found)} tracks; all are in results.json."))
    return blocks


def _method(result: Result) -> list[Block]:
    s = result.settings
    scatter = "estimated from the scatter of the plots about parabolas through their neighbours"
    origin = ", ".join(
        f"{k} {scatter if v == 'estimated' else v}" for k, v in dict(s["measurement_noise_from"]).items()
    )
    how = "their target_id" if s["association"] == "id" else f"{s['association']} association"
    text = (
        f"Plots were given to tracks by {how} and run through the filter '{s['filter']}'. Measurement noise: {origin}. "
        "The normalised innovation squared (NIS) compares every innovation with the covariance the filter expects of "
        "it; its mean over its degrees of freedom is 1 when all assumptions hold. The log-likelihood of the plots "
        "compares filters and parameters without truth."
    )
    blind = (
        "Innovations cannot show a constant bias of the radar: the filter follows it. They judge the filter's "
        "assumptions, not its accuracy; that needs truth."
    )
    return [Paragraph(text), Notice(blind, "info", "What innovations cannot show")]
