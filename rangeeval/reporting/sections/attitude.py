"""The chapter on attitude: how the radar moved, what each method makes of it, and what that does to pointing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rangeeval.model import Result
from rangeeval.reporting.attitude_tables import (
    AXIS_NAMES,
    DEGREE,
    METHOD_NAMES,
    METHODS,
    binned,
    budget_table,
    error_tables,
    in_degrees,
    motion_table,
    of_trial,
    sensor_table,
    short_tables,
)
from rangeeval.reporting.blocks import Block, Figure, Mark, Notice, Panel, Paragraph, Section
from rangeeval.reporting.sections.common import flag_notices
from rangeeval.reporting.wording import estimate_text
from rangeeval.units import shown_variable

NOTE = (
    "Intervals: {confidence:.0%}. The pair's attitude stands for the truth; sway of the rotation centre, "
    "bias and wrong radii are not in its σ but in the budget (--format json)."
)

_DEG = 1 / DEGREE
_ANGLES = {"azimuth": "Azimuth", "elevation": "Elevation"}


def sections(result: Result) -> list[Section]:
    """The motion, the pointing error, and how both were had."""
    found = [Section("Attitude", _motion(result), key="attitude")]
    pointing = _pointing(result)
    if pointing:
        found.append(Section("Pointing error from attitude", pointing, level=2, key="attitude-pointing"))
    found.append(Section("How attitude was assessed", _method(result), level=2, key="attitude-method"))
    return found


def summary_figure(result: Result) -> Figure | None:
    """Attitude over a few cycles by method, and the pointing error by bin where there is one."""
    return _by_bin(result) or _over_time(result)


def _axes(result: Result) -> list[str]:
    return [a for a in AXIS_NAMES if f"{a}/single" in result.series]


def _floats(values: Sequence[Any]) -> list[float]:
    return [float("nan") if v is None else float(v) for v in values]


def _degrees(values: Sequence[Any]) -> list[float]:
    return [float("nan") if v is None else float(v) * _DEG for v in values]


def _motion(result: Result) -> list[Block]:
    words = _in_words(result)
    blocks: list[Block] = [Paragraph(words)] if words else []
    blocks += [f for f in (_over_time(result), _errors(result), _spectra(result), _allan(result)) if f is not None]
    blocks.append(motion_table(result, "Motion and methods by axis"))
    budget = budget_table(result)
    if budget is not None:
        blocks += [
            budget,
            Paragraph(
                "Sensor noise is measured in this trial; the other causes follow from the tolerances named beside them "
                "(trial.toml, [attitude]) and the motion found. They are systematic: averaging does not lessen "
                "them, and "
                "the interval of the total holds the noise's uncertainty only. Sway of the rotation centre "
                "looks like tilt "
                "to every accelerometer of the line, so no number of them removes it."
            ),
        ]
    sensors = sensor_table(result)
    if sensors is not None:
        blocks.append(sensors)
    return blocks + flag_notices(result)


def _in_words(result: Result) -> str:
    rows = of_trial(result)
    parts = []
    for axis in _axes(result):
        amplitude, frequency = rows.get(f"dynamic_amplitude_{axis}"), rows.get(f"frequency_{axis}")
        static, peak = rows[f"static_{axis}"], rows.get(f"single_error_peak_{axis}")
        name = {"x": "Roll", "z": "Pitch"}[axis]
        text = f"{name} stood at {static.value * _DEG:.2f}°"
        if amplitude is not None and frequency is not None and math.isfinite(amplitude.value):
            text += f" and swung by {amplitude.value * _DEG:.2g}° at {frequency.value:.3g} Hz"
        elif amplitude is not None and math.isfinite(amplitude.high):
            text += f"; an oscillation, if any, was below {amplitude.high * _DEG:.1g}°"
        if peak is not None and math.isfinite(peak.value):
            text += f", which one accelerometer misreads by up to {peak.value * _DEG:.2g}°"
        parts.append(text)
    return ". ".join(parts) + "." if parts else ""


def _lines(series: Mapping[str, Any], role: str, label: str) -> list[Mark]:
    """A record drawn as a line, or as the band between its lowest and highest where it is long; broken at gaps."""
    marks: list[Mark] = []
    pieces: dict[Any, list[int]] = {}
    for i, number in enumerate(series["stretch"]):
        pieces.setdefault(number, []).append(i)
    for number, rows in enumerate(pieces.values()):
        x = [series["time_s"][i] for i in rows]
        name = label if number == 0 else ""
        if "angle" in series:
            marks.append(Mark("line", x, _degrees([series["angle"][i] for i in rows]), label=name, role=role))
            continue
        low, high = (_degrees([series[end][i] for i in rows]) for end in ("low", "high"))
        marks.append(Mark("band", x, low=low, high=high, role=role))
        marks += [Mark("line", x, low, label=name, role=role), Mark("line", x, high, role=role)]
    return marks


def _over_time(result: Result) -> Figure | None:
    grid: list[list[Panel | None]] = []
    for axis in _axes(result):
        whole = _lines(result.series[f"{axis}/single"], "single", METHOD_NAMES["single"].lower())
        if f"{axis}/pair" in result.series:
            whole += _lines(result.series[f"{axis}/pair"], "pair", METHOD_NAMES["pair"].lower())
        row: list[Panel | None] = [
            Panel(f"α{axis}: the whole record", "Time (s)", f"α{axis} (°)", whole, share_x="time")
        ]
        close = result.series.get(f"{axis}/close")
        if close is not None:
            marks = [
                Mark("line", _floats(close["time_s"]), _degrees(close[m]), label=METHOD_NAMES[m].lower(), role=m)
                for m in ("single", "pair")
                if m in close
            ]
            row.append(Panel(f"α{axis}: where it moved most", "Time (s)", f"α{axis} (°)", marks))
        grid.append(row)
    if not grid:
        return None
    return Figure(
        "Attitude over time. One accelerometer takes its own acceleration for tilt; the pair does not. A long "
        "record is drawn "
        "as the band between its lowest and highest values.",
        "Attitude of each axis over time by one accelerometer and by the pair. " + _in_words(result),
        grid,
    )


def _errors(result: Result) -> Figure | None:
    axes = [a for a in _axes(result) if f"{a}/single_error" in result.series]
    if not axes:
        return None
    rows = of_trial(result)
    grid: list[list[Panel | None]] = [[]]
    for axis in axes:
        error = result.series[f"{axis}/single_error"]
        sigma = in_degrees(rows[f"pair_error_sigma_{axis}"]).value
        ends = [float(error["time_s"][0]), float(error["time_s"][-1])]
        marks = [
            *_lines(error, "single", "one accelerometer less pair"),
            Mark("band", ends, low=[-2 * sigma] * 2, high=[2 * sigma] * 2, label="pair, ±2σ of its noise", role="pair"),
        ]
        peak = in_degrees(rows[f"single_error_peak_{axis}"]).value
        if math.isfinite(peak):
            marks.append(Mark("rule", y=[-peak, peak], label="peak without noise", role="limit"))
        grid[0].append(Panel(f"Error of α{axis}", "Time (s)", "Error (°)", marks, share_x="time"))
    return Figure(
        "Attitude error over time: one accelerometer against the pair, and the band in which the pair's own "
        "noise keeps it.",
        "Error of one accelerometer over time beside the band of the pair's noise.",
        grid,
    )


def _spectra(result: Result) -> Figure | None:
    grid: list[list[Panel | None]] = [[]]
    rows = of_trial(result)
    for axis in _axes(result):
        data = result.series.get(f"{axis}/spectrum")
        if data is None:
            continue
        marks = [
            Mark(
                "line",
                _floats(data["frequency"]),
                [math.sqrt(float(v)) * _DEG for v in data[m]],
                label=METHOD_NAMES[m].lower(),
                role=m,
            )
            for m in ("single", "pair")
            if m in data
        ]
        frequency = rows[f"frequency_{axis}"].value
        if math.isfinite(frequency):
            marks.append(Mark("rule", x=[frequency], label="oscillation", role="limit"))
        grid[0].append(Panel(f"Spectrum of α{axis}", "Frequency (Hz)", "°/√Hz", marks, x_log=True, y_log=True))
    if not grid[0]:
        return None
    return Figure(
        "Amplitude spectral density of the tilt each method reads (Welch, Hann windows). Where the two part, one "
        "accelerometer reads acceleration.",
        "Spectra of the tilt by one accelerometer and by the pair.",
        grid,
    )


def _allan(result: Result) -> Figure | None:
    grid: list[list[Panel | None]] = [[]]
    for axis in _axes(result):
        data = result.series.get(f"{axis}/allan")
        if data is None:
            continue
        marks = [
            Mark(
                "band",
                _floats(data["tau_s"]),
                low=_degrees(data["low"]),
                high=_degrees(data["high"]),
                label="95 % interval",
                role="pair",
            ),
            Mark(
                "line",
                _floats(data["tau_s"]),
                _degrees(data["deviation"]),
                label="Allan deviation of the pair's tilt",
                role="pair",
            ),
        ]
        grid[0].append(
            Panel(f"Allan deviation of α{axis}", "Averaging time (s)", "Deviation (°)", marks, x_log=True, y_log=True)
        )
    if not grid[0]:
        return None
    return Figure(
        "Allan deviation at rest: where it stops falling, averaging longer helps no more.",
        "Allan deviation of the tilt over averaging time.",
        grid,
    )


# --- pointing ---------------------------------------------------------------------------------------------------------


def _pointing(result: Result) -> list[Block]:
    if not any(r.variable for r in result.rows):
        return [Notice(
            "The trial holds no truth, plots or residual log that shows where the target was, so the attitude "
            "error cannot "
            "be carried on to azimuth and elevation.", "info",
        )]  # fmt: skip
    blocks: list[Block] = []
    along = _along_path(result)  # the figure by bin stands on the summary
    blocks += [along] if along is not None else []
    blocks += error_tables(result)
    blocks.append(_forms(result))
    return blocks


def _along_path(result: Result) -> Figure | None:
    grid: list[list[Panel | None]] = [[], []]
    for angle, name in _ANGLES.items():
        for column, (key, label, scale) in enumerate((("range_m", "Range (km)", 1e-3),)):
            marks = []
            for method in ("single", "none"):
                data = result.series.get(f"pointing/{method}/{angle}")
                if data is not None:
                    x = [float(v) * scale for v in data[key]]
                    marks.append(
                        Mark("points", x, _degrees(data["error"]), label=METHOD_NAMES[method].lower(), role=method)
                    )
            pair = result.series.get(f"pointing/pair/{angle}")
            if pair is not None:
                x = [float(v) * scale for v in pair[key]]
                band = [2 * v for v in _degrees(pair["sigma"])]
                marks.append(Mark("band", x, low=[-v for v in band], high=band, label="pair, ±2σ", role="pair"))
            if marks:
                grid[column].append(Panel(f"{name} error", label, "Error (°)", marks, share_x="range"))
    path = result.series.get("path")
    if not grid[0] or path is None:
        return None
    km = [float(v) * 1e-3 for v in path["range_m"]]
    for angle, name in _ANGLES.items():
        values = _degrees(path[angle])
        if angle == "azimuth":
            values = [v - 360 if v > 180 else v for v in values]
        grid[1].append(Panel(f"The target's {name.lower()}", "Range (km)", f"{name} (°)",
                             [Mark("points", km, values, role="reference")], share_x="range"))  # fmt: skip
    return Figure(
        "Report error over the target's path: what the attitude error does to the azimuth and elevation that the radar "
        "reports. Below: where the target was.",
        "Azimuth and elevation error over range by method, and the target's azimuth and elevation.",
        grid,
    )


def _by_bin(result: Result) -> Figure | None:
    variable = str(result.settings.get("variable"))
    across = shown_variable(variable)
    grid: list[list[Panel | None]] = [[]]
    for angle, name in _ANGLES.items():
        marks = []
        for method in METHODS:
            chosen = [in_degrees(r) for r in binned(result.rows, f"{angle}_error_rms", method)]
            chosen = [r for r in chosen if r.value > 0 and (not math.isfinite(r.low) or r.low > 0)]
            if chosen:
                marks.append(Mark(
                    "errorbars", [0.5 * (r.bin_low + r.bin_high) * across.scale for r in chosen],
                    [r.value for r in chosen],
                    low=[r.low if math.isfinite(r.low) else r.value for r in chosen],
                    high=[r.high if math.isfinite(r.high) else r.value for r in chosen],
                    label=METHOD_NAMES[method].lower(), role=method,
                ))  # fmt: skip
        if marks:
            grid[0].append(Panel(
                f"{name} error", f"{variable.capitalize()} ({across.unit})", "Root mean square (°)", marks,
                y_log=True, share_x="bins",
            ))  # fmt: skip
    if not grid[0]:
        return None
    return Figure(
        "Pointing error per bin by method, with intervals. The gap between the methods is what an attitude "
        "measurement is "
        "worth.",
        "Root mean square azimuth and elevation error per bin by method.",
        grid,
        "tall",
    )


def _forms(result: Result) -> Paragraph:
    """How the exact errors and the small-angle forms compare in this trial."""
    parts = []
    for method in ("none", "single"):
        for angle in _ANGLES:
            designation = binned(result.rows, f"{angle}_designation_error_rms", method)
            short = {r.bin_low: r for r in binned(result.rows, f"{angle}_small_angle_error_rms", method)}
            away = [abs(short[r.bin_low].value - r.value) * _DEG for r in designation if r.bin_low in short]
            if away:
                parts.append(f"{angle}, {METHOD_NAMES[method].lower()}: {max(away):.2g}°")
    differ = "; ".join(parts)
    return Paragraph(
        "These are report errors: a measured direction turned back to the earth frame with a wrong attitude. "
        "The designation "
        "error, of a beam sent to a known direction, has the opposite sign to first order and stands in "
        "results.json beside "
        "it. Both are exact rotations. The paper's small-angle forms (equations 19 and 20) leave out the "
        "product of pitch "
        f"error and roll; the largest difference to the exact designation error in any bin here is: {differ or 'none'}."
    )


def _method(result: Result) -> list[Block]:
    s = result.settings
    confidence = f"{s['confidence'] * 100:g} %"
    path = s.get("path")
    source = f"The target's path comes from the {path} log ({s['path_source']}). " if path else ""
    rows = of_trial(result)
    noise = next((rows[f"pair_error_sigma_{a}"] for a in _axes(result) if f"pair_error_sigma_{a}" in rows), None)
    blocks: list[Block] = [
        Paragraph(
            "An accelerometer at radius R from the rotation axis reads f = g sin α + R α″. Readings at two or "
            "more radii lie on "
            "a straight line over R; its value at R = 0 is g sin α, whatever the motion, and its slope the angular "
            "acceleration. Pitch follows from asin(f/g), roll from asin(f/(g cos αz)). The pair's attitude "
            "stands for the "
            "truth against which no attitude and one accelerometer are judged; its own noise is taken off "
            "their squares."
        ),
        Paragraph(
            f"g = {s['gravity']:.6g} m/s² ({s['gravity_from']}). One accelerometer means the "
            f"{str(s['single_sensor']).replace('_', ' ')} one. "
            f"{source}Attitude is interpolated linearly to each detection; detections in a gap are left out and "
            "counted."
        ),
        Paragraph(
            f"Intervals are {confidence}. Static tilt and amplitude: sine fits over segments of at least 20 "
            "cycles, Student's t on "
            "the scatter between segments (with its correlation) or on the noise, whichever is larger. "
            "Frequency: error of a "
            "windowed spectral peak under the noise, or the scatter of segments. Noise: chi-square on the "
            "spectrum's floor. "
            "Noise amplification and peak error: propagated from the radii's tolerance and the fits. Root mean "
            "square errors "
            "of no attitude and one accelerometer: Student's t on the mean square, its correlation counted "
            "(Newey and West); "
            "of the pair: propagated from its noise by the derivatives of the exact rotations."
        ),
        Paragraph(
            "Assumptions: the body is rigid between the sensors; they sit on one line through the rotation centre with "
            "parallel axes and are sampled at one instant; the centre does not accelerate. A bend shows as "
            "lost coherence, a "
            "phase between the sensors (time skew) or, with three sensors and more, as readings off the straight line."
        ),
    ]  # fmt: skip
    if noise is not None and math.isfinite(noise.value):
        words = (
            f"The pair's noise on the first axis is {estimate_text(in_degrees(noise))}° per sample, "
            f"{s['sampling_interval']:.4g} s apart; a band limit of twice the oscillation would lessen it."
        )
        blocks.append(Paragraph(words))
    return blocks


__all__ = ["NOTE", "sections", "short_tables", "summary_figure"]
