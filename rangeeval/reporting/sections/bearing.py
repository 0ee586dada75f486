"""The chapter on bearings: tracks with their bands, the beamformer under them, spectra, and what spoils bearings."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rangeeval.model import Estimate, Result
from rangeeval.reporting.blocks import Block, Cell, Figure, FigureSize, Mark, Notice, Panel, Paragraph, Section, Table
from rangeeval.reporting.sections.common import flag_notices
from rangeeval.reporting.wording import (
    MISSING,
    NBSP,
    estimate_text,
    flags_text,
    interval_text,
    plain_number,
    value_text,
)
from rangeeval.units import shown

NAME = "Bearings"
HEADLINE = ("bearing_rms", "bearing_bias")
NOTE = (
    "Intervals: {confidence:.0%}. σ is the filter's own; errors of the array's positions and phases and of the wave's "
    "speed are in none of it."
)

_DEGREES = shown("rad", "bearing")
_PER_BLOCK = ("music", "root-music", "esprit")
_STEEP = 180.0  # a step beyond this is a bearing that went round
_METHODS = {
    "joint-ml": "maximum likelihood of all bearings at once, block by block (joint-ml)",
    "ryu": "the subspace tracker for lines as published (ryu): PAST, closed-form innovation, a Kalman filter a target",
    "modified": "the subspace tracker for any array as published (modified): PAST, closed-form innovation, a Kalman "
    "filter a target",
    "music": "MUSIC, each block by itself",
    "root-music": "root-MUSIC, each block by itself",
    "esprit": "total-least-squares ESPRIT, each block by itself",
}


def sections(result: Result) -> list[Section]:
    """Tracks, what the array heard, and the method."""
    return [
        Section("Bearings", _overview(result), key="bearing"),
        Section("What the array heard", _heard(result), level=2, key="bearing-heard"),
        Section("How bearings were found", _method(result), level=2, key="bearing-method"),
    ]


def summary_figure(result: Result) -> Figure:
    """The tracks, for the summary page; where there is none, what the beamformer heard."""
    return _track_figure(result, "normal") if _names(result) else waterfall_figure(result)


def short_tables(result: Result, caption: str, *, summary: bool = False) -> list[Table]:
    """What a terminal and the report's first page show: targets, then the errors where there is truth."""
    tables = [_targets(result, caption)] if _names(result) else []
    if errors := _errors(result, each=not summary):
        tables.append(errors)
    if not summary or not tables:
        tables.append(_array(result))
    return tables


def _names(result: Result) -> list[str]:
    found = dict.fromkeys(r.track_id for r in result.rows if r.track_id is not None)
    return [name for name in found if name is not None]


def _row(result: Result, quantity: str, track: str | None = None, group: str | None = None) -> Estimate | None:
    return next(
        (
            r
            for r in result.rows
            if (r.quantity, r.track_id, r.group) == (quantity, track, group) and r.variable is None
        ),
        None,
    )


def _number(row: Estimate | None, scale: float = 1.0, digits: int = 3) -> str:
    return plain_number(row.value * scale, digits) if row is not None else MISSING


def _count(row: Estimate | None) -> str:
    return f"{row.value:,.0f}" if row is not None else MISSING


def _targets(result: Result, caption: str) -> Table:
    """One line a target: where from and to, sigma, SNR, how much of the time it was heard."""
    head = ["Target", "From (°)", "To (°)", "σ (°)", "SNR (dB)", "Updates", "Heard", "Flags"]
    body: list[list[str | Cell]] = []
    for name in _names(result):
        first, last = _row(result, "bearing_first", name), _row(result, "bearing_last", name)
        coverage = _row(result, "coverage", name)
        body.append([
            name, estimate_text(first) if first else MISSING, estimate_text(last) if last else MISSING,
            _number(_row(result, "bearing_sigma", name), _DEGREES.scale), _number(_row(result, "snr", name)),
            _count(_row(result, "updates", name)),
            f"{coverage.value * 100:.0f}{NBSP}%" if coverage else MISSING, flags_text(first.flags if first else ()),
        ])  # fmt: skip
    return Table(caption, head, body, "lrrrrrrl")


def _errors(result: Result, *, each: bool = True) -> Table | None:
    """Errors against truth with the bounds beside: all, near crossings, far from them, each target."""
    places: list[tuple[str, str | None, str | None]] = [("all", None, None)]
    places += [("near another target", None, "near"), ("far from others", None, "far")]
    places += [(name, name, None) for name in _names(result)] if each else []
    body: list[list[str | Cell]] = []
    for words, track, group in places:
        rms, bias = (_row(result, f"bearing_{q}", track, group) for q in ("rms", "bias"))
        if rms is None:
            continue
        bounds = [_row(result, q, track, group) for q in ("bearing_bound", "bearing_bound_straight")]
        body.append([
            words, str(rms.n), value_text(rms), interval_text(rms), estimate_text(bias) if bias else MISSING,
            *(_number(bound, _DEGREES.scale) for bound in bounds),
            plain_number((rms.value * _DEGREES.scale) ** 2, 3), flags_text(rms.flags),
        ])  # fmt: skip
    if not body:
        return None
    flagged = any(row[-1] for row in body)
    outcome = str(result.settings.get("outcome") or "")
    head = ["Errors", "n", "RMS (°)", "Interval", "Bias (°)", "Bound (°)", "Bound, straight", "MSE (deg²)", "Flags"]
    words = {
        "held": "every target held to the end",
        "swapped": "targets swapped their names",
        "lost": "a target was lost",
    }.get(outcome, "")
    caption = f"Bearings against truth{': ' + words if words else ''}"
    if not flagged:
        head, body = head[:-1], [row[:-1] for row in body]
    return Table(caption, head, body, "lrrrrrrr" + "l" * flagged)


_ARRAY = (
    ("beam_width", "Beam width (°)", _DEGREES.scale),
    ("ambiguity_level", "Highest response elsewhere (dB)", 1.0),
    ("snapshots_usable", "Snapshots usable", 1.0),
    ("guard_alarms", "Guard alarms", 1.0),
    ("coherence", "Median coherence of a block", 1.0),
)


def _array(result: Result) -> Table:
    body: list[list[str | Cell]] = []
    for quantity, words, scale in _ARRAY:
        row = _row(result, quantity)
        if row is not None:
            body.append([words, _number(row, scale), str(row.n or ""), flags_text(row.flags)])
    for quantity, words in (("sources_mdl", "Sources by MDL"), ("sources_aic", "Sources by AIC")):
        row = _row(result, quantity)
        if row is not None:
            most = f"{row.value:.0f} ({row.low:.0f} to {row.high:.0f})"
            body.append([words, most, str(row.n), flags_text(row.flags)])
    return Table("The array and what it heard", ["", "", "n", "Flags"], body, "lrrl")


def _overview(result: Result) -> list[Block]:
    s = result.settings
    frame = "clockwise from north" if s["bearings"] == "compass" else "from the array's x axis towards its y axis"
    if s["linear"] and s["bearings"] != "compass":
        frame = "from broadside, towards the line's positive end"
    blocks: list[Block] = [Notice(
        f"Bearings are counted {frame}, towards the source. An error of the sensors' positions or phases, or of the "
        "wave's speed, moves all of them and is in no interval here.", "info", "What the intervals leave out",
    )]  # fmt: skip
    if s["linear"]:
        blocks.append(Notice(
            "A line of sensors cannot tell one side from the other: each bearing has a mirror image behind the line.",
            "info", "Line array",
        ))  # fmt: skip
    if not _names(result):
        blocks.append(Notice("No source stood out of the noise, so no track was begun.", "caution", "No track"))
        return [*blocks, _array(result), waterfall_figure(result), *flag_notices(result)]
    blocks.append(_targets(result, f"Targets, with {s['confidence'] * 100:g} % intervals"))
    if errors := _errors(result):
        blocks.append(errors)
        blocks.append(Paragraph(
            "Near another target: its true bearing is within a beam width. The bound is the Cramér-Rao bound of a "
            "tracker that expects the filter's process noise, and of one that knows the bearings to be straight: a "
            "good filter lies between the two."
        ))  # fmt: skip
    blocks.append(_track_figure(result, "tall"))
    blocks += [waterfall_figure(result), _array(result)]
    return [*blocks, *flag_notices(result)]


def _track_figure(result: Result, size: FigureSize) -> Figure:
    panels = [[_tracks(result)]]
    if size == "tall" and (error := _error_panel(result)) is not None:
        panels.append([error])
    return Figure("Bearing of each target over time, with its interval.", _alt(result), panels, size)


def _alt(result: Result) -> str:
    parts = []
    for name in _names(result):
        first, last = _row(result, "bearing_first", name), _row(result, "bearing_last", name)
        if first and last:
            parts.append(f"target {name} from {value_text(first)}° to {value_text(last)}°")
    return ("; ".join(parts) or "no track") + "."


def _series(result: Result, beginning: str) -> list[tuple[str, dict[str, list[float]]]]:
    found = []
    for name, data in result.series.items():
        if name.startswith(beginning):
            columns = {c: [math.nan if v is None else float(v) for v in values] for c, values in data.items()}
            found.append((name.removeprefix(beginning), columns))
    return found


def _broken(values: Sequence[float]) -> list[float]:
    """Degrees of a line, with a break (NaN) where the bearing goes round the circle."""
    degrees = [v * _DEGREES.scale for v in values]
    return [math.nan if i and abs(v - degrees[i - 1]) > _STEEP else v for i, v in enumerate(degrees)]


def _marks(result: Result, *, bands: bool) -> list[Mark]:
    marks = [
        Mark("line", data["time_s"], _broken(data["truth_rad"]), label="" if number else "truth", role="reference")
        for number, (_, data) in enumerate(_series(result, "bearing/"))
        if bands and "truth_rad" in data
    ]
    per_block = str(result.settings["method"]) in _PER_BLOCK
    for number, (name, data) in enumerate(_series(result, "bearing/"), start=1):
        x, role, label = data["time_s"], f"group{number}", f"target {name}"
        if per_block:
            heard = [v * _DEGREES.scale if h else math.nan for v, h in _pairs(data, "bearing_rad", "heard")]
            marks.append(Mark("points", x, heard, label=label, role=role))
            continue
        if bands:
            low, high = ([v * _DEGREES.scale for v in data[c]] for c in ("low_rad", "high_rad"))
            marks.append(Mark("band", x, low=low, high=high, role=role))
        marks.append(Mark("line", x, _broken(data["bearing_rad"]), label=label, role=role))
    return marks


def _pairs(data: dict[str, list[float]], first: str, second: str) -> list[tuple[float, float]]:
    return list(zip(data[first], data[second], strict=True))


def _error_panel(result: Result) -> Panel | None:
    """How far each track is off the truth, over time."""
    marks = []
    for number, (_, data) in enumerate(_series(result, "bearing/"), start=1):
        if "truth_rad" not in data:
            return None
        off = [math.remainder(b - t, 2 * math.pi) * _DEGREES.scale for b, t in _pairs(data, "bearing_rad", "truth_rad")]
        kind = "points" if str(result.settings["method"]) in _PER_BLOCK else "line"
        marks.append(Mark(kind, data["time_s"], off, role=f"group{number}"))  # type: ignore[arg-type]
    marks.append(Mark("rule", y=(0.0,), role="reference"))
    return Panel("Error against truth", _time_label(result), "Error (°)", marks, share_x="time")


def _time_label(result: Result) -> str:
    zero = str(result.settings.get("time_zero") or "")
    return f"Time (s) from {zero}" if zero else "Time (s)"


def _tracks(result: Result) -> Panel:
    return Panel("Bearings", _time_label(result), "Bearing (°)", _marks(result, bands=True), share_x="time")


def waterfall_figure(result: Result) -> Figure:
    """The beamformer over time, with the tracks over it."""
    data = result.series["waterfall"]
    x = [float(v) for v in data["time_edge_s"]]
    y = [float(v) * _DEGREES.scale for v in data["bearing_edge_rad"]]
    level = [math.nan if v is None else float(v) for v in data["level_db"]]
    columns = len(x) - 1
    z = [level[i * columns : (i + 1) * columns] for i in range(len(y) - 1)]
    marks = [
        Mark("heat", x, y, z=z, label="beamformer, dB below its highest, dark: high"),
        *_marks(result, bands=False),
    ]
    panel = Panel(
        "Beamformer and tracks", _time_label(result), "Bearing (°)", marks, share_x="time", y_limits=(y[0], y[-1])
    )
    return Figure(
        "Power of the conventional beamformer over time, each block against its own highest (down to 15 dB below), "
        "with the tracks over it.", f"Beamformer waterfall; {_alt(result)}", [[panel]], "tall",
    )  # fmt: skip


def _heard(result: Result) -> list[Block]:
    blocks: list[Block] = []
    panels = []
    for number, (_, data) in enumerate(_series(result, "spectrum/")):
        at = data["time_s"][0]
        x = [v * _DEGREES.scale for v in data["bearing_rad"]]
        marks = [
            Mark("line", x, [max(v, -40.0) for v in data[f"{name}_db"]], label=label, role=role)
            for name, label, role in (
                ("beamformer", "beamformer", "reference"), ("capon", "minimum variance", "group1"),
                ("music", "MUSIC", "group2"),
            )
        ]  # fmt: skip
        where = [v for v in _at(result, at) if math.isfinite(v)]
        if where:
            marks.append(Mark("rule", x=where, label="tracks" if number == 0 else "", role="limit"))
        panels.append(Panel(f"At {at:.6g} s", "Bearing (°)", "dB", marks, x_limits=(min(x), max(x))))
    if panels:
        rows = [panels[i : i + 2] for i in range(0, len(panels), 2)]
        blocks.append(Figure(
            "Spectra of single blocks of snapshots, each below its own highest; the rules are the tracks then.",
            "Spectra of the beamformer, minimum variance and MUSIC over bearing at a few times.", rows, "compact",
        ))  # fmt: skip
    lines = []
    for _, data in _series(result, "sources"):
        marks = [
            Mark("step", data["time_s"], data["mdl"], label="sources by MDL", role="measured"),
            Mark("step", data["time_s"], data["aic"], label="by AIC", role="group2"),
            Mark("rule", y=(float(result.settings["targets"]),), label="targets tracked", role="reference"),
        ]
        lines.append([Panel("Number of sources", _time_label(result), "Sources", marks, share_x="time")])
    for _, data in _series(result, "guard"):
        marks = [
            Mark("line", data["time_s"], data["eigenvalue"], label="guard", role="measured"),
            Mark("rule", y=(float(result.settings["guard_threshold"]),), label="alarm", role="limit"),
        ]
        lines.append([Panel("Largest eigenvalue left", _time_label(result), "", marks, share_x="time")])
    for _, data in _series(result, "coherence"):
        marks = [Mark("line", data["time_s"], data["share"], label="coherence", role="measured")]
        lines.append([Panel("Share of the power in one wave", _time_label(result), "", marks, share_x="time",
                            y_limits=(0.0, 1.0))])  # fmt: skip
    if lines:
        blocks.append(Figure(
            "How many sources blocks of snapshots show, and whether one is not modelled: the largest eigenvalue of the "
            "covariance whitened by the model. Sources that move are over-counted.",
            "Number of sources and guard over time.", lines, "compact",
        ))  # fmt: skip
    return blocks


def _at(result: Result, time_s: float) -> list[float]:
    found = []
    for _, data in _series(result, "bearing/"):
        nearest = min(range(len(data["time_s"])), key=lambda i: abs(data["time_s"][i] - time_s))
        found.append(data["bearing_rad"][nearest] * _DEGREES.scale)
    return found


def _method(result: Result) -> list[Block]:
    s = result.settings
    frequencies = [float(f) for f in s["frequency_hz"]]
    span = f"{frequencies[0]:g} Hz" if len(frequencies) == 1 else (
        f"{len(frequencies)} frequencies from {frequencies[0]:g} to {frequencies[-1]:g} Hz"
    )  # fmt: skip
    number = "as given" if s["targets_given"] else "as MDL found it in the first blocks"
    blocks: list[Block] = [Paragraph(
        f"Method: {_METHODS[str(s['method'])]}. {s['snapshots']:,} snapshots of {s['sensors']} sensors at {span}, "
        f"{float(s['interval_s']):.4g} s apart; a wave of {float(s['propagation_speed_m_s']):g} m/s. Number of "
        f"targets: {s['targets']}, {number}."
    )]  # fmt: skip
    if s["method"] in ("ryu", "modified"):
        blocks.append(Paragraph(
            "The gain of this tracker follows from the ratio of two settings alone, so its σ is nominal: it says how "
            "the filter weighs, not how far it errs. Near a crossing the subspace cannot show two sources, and the "
            "straight prediction decides which target is which."
        ))  # fmt: skip
    elif s["method"] == "joint-ml":
        blocks.append(Paragraph(
            "All bearings are one state with one covariance. Where two targets cross, their difference is carried by "
            "the prediction while their centre is measured; σ grows there by itself."
        ))  # fmt: skip
    else:
        blocks.append(Paragraph(
            "Each block stands by itself; bearings are put to the target nearest before. σ is the Cramér-Rao bound of "
            "the block at the power found, which no estimator beats."
        ))  # fmt: skip
    blocks.append(Paragraph(
        "Assumptions: plane waves, one each source; sources that do not follow one another's signal; white noise of "
        "one power in all sensors; sensors where the log says they stand."
    ))  # fmt: skip
    return blocks
