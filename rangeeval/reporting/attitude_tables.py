"""The tables of attitude: motion and methods by axis, errors by bin and method, the budget. Angles in degrees."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from rangeeval.model import Estimate, Result
from rangeeval.reporting.blocks import Cell, Table
from rangeeval.reporting.wording import MISSING, bin_text, estimate_text, flags_text, plain_number

DEGREE = math.pi / 180
METHODS = ("none", "single", "pair")
METHOD_NAMES = {"none": "No attitude", "single": "One accelerometer", "pair": "Pair"}
AXIS_NAMES = {"x": "x (roll)", "z": "z (pitch)"}

MOTION = (
    ("static", "Static tilt (°)"),
    ("dynamic_amplitude", "Dynamic amplitude (°)"),
    ("frequency", "Frequency (Hz)"),
    ("single_error_peak", "Peak error of one accelerometer (°)"),
    ("pair_error_sigma", "σ of the pair, sensor noise (°)"),
    ("noise_amplification", "Noise amplification of the pair"),
    ("time_skew", "Time skew between sensors (ms)"),
    ("coherence", "Coherence at the oscillation"),
    ("height_misfit", "Off a straight line over heights (m/s²)"),
)
BUDGET = (
    ("noise", "Sensor noise (measured)"),
    ("radii", "Radii"),
    ("bias", "Accelerometer bias"),
    ("time_skew", "Time skew"),
    ("sway", "Sway of the rotation centre"),
    ("gravity", "Gravity"),
    ("total", "All together"),
)


def in_degrees(estimate: Estimate) -> Estimate:
    """The same estimate in degrees where it is an angle, and times in milliseconds."""
    scale, unit = {"rad": (1 / DEGREE, "°"), "s": (1e3, "ms")}.get(estimate.unit, (1.0, estimate.unit))
    if scale == 1.0:
        return estimate
    return dataclasses.replace(
        estimate, value=estimate.value * scale, low=estimate.low * scale, high=estimate.high * scale, unit=unit
    )


def of_trial(result: Result) -> dict[str, Estimate]:
    """The whole-trial estimates by quantity."""
    return {r.quantity: r for r in result.rows if r.variable is None and r.group is None}


def short_tables(result: Result, caption: str, *, summary: bool = False) -> list[Table]:
    """What a terminal shows: the motion, and the pointing error by bin if there was a target; a summary: the motion."""
    return [motion_table(result, caption, short=summary), *([] if summary else error_tables(result))]


def motion_table(result: Result, caption: str, *, short: bool = False) -> Table:
    """Quantities down, axes across; the six that matter most when `short`."""
    rows = of_trial(result)
    axes = [a for a in AXIS_NAMES if f"static_{a}" in rows]
    body: list[list[str | Cell]] = []
    for name, words in MOTION[: 6 if short else None]:
        found = [rows.get(f"{name}_{a}") for a in axes]
        if any(r is not None for r in found):
            body.append([words, *(_text(r) for r in found)])
    flags = [
        flags_text(
            dict.fromkeys(f for q, r in rows.items() if q.endswith(f"_{a}") for f in r.flags if f != "from-tolerance")
        )
        for a in axes
    ]
    if any(flags):
        body.append(["Flags", *flags])
    return Table(caption, ["", *(AXIS_NAMES[a] for a in axes)], body)


def _text(estimate: Estimate | None) -> str:
    if estimate is None:
        return MISSING
    shown = in_degrees(estimate)
    if not math.isfinite(shown.value) and math.isfinite(shown.high):
        return f"below {plain_number(shown.high, 2)}"
    return estimate_text(shown)


def error_tables(result: Result) -> list[Table]:
    """Root mean square pointing error, a table an angle: bins down, methods across."""
    tables = []
    for angle in ("azimuth", "elevation"):
        bins: dict[tuple[float, float], dict[str, Estimate]] = {}
        for r in result.rows:
            if r.quantity == f"{angle}_error_rms" and r.group:
                bins.setdefault((r.bin_low, r.bin_high), {})[r.group] = r
        body: list[list[str | Cell]] = []
        for _, found in sorted(bins.items()):
            cells: list[str | Cell] = [bin_text(next(iter(found.values()))), str(max(r.n for r in found.values()))]
            cells += [_text(found.get(m)) for m in METHODS]
            flags = dict.fromkeys(f for r in found.values() for f in r.flags if f != "propagated")
            body.append([*cells, flags_text(flags)])
        if body:
            head = ["Bin", "n", *(f"{METHOD_NAMES[m]} (°)" for m in METHODS), "Flags"]
            tables.append(Table(f"{angle.capitalize()} error by method (root mean square)", head, body, "lrrrrl"))
    return tables


def budget_table(result: Result) -> Table | None:
    """What each cause leaves in the pair's attitude (degrees, one sigma)."""
    rows = of_trial(result)
    axes = [a for a in AXIS_NAMES if f"budget_total_{a}" in rows]
    if not axes:
        return None
    given = _tolerances(result)
    body: list[list[str | Cell]] = []
    for name, words in BUDGET:
        strong = name == "total"
        cells: list[str | Cell] = [Cell(words, strong=strong), given.get(name, "")]
        cells += [Cell(_text(rows[f"budget_{name}_{a}"]), strong=strong) for a in axes]
        body.append(cells)
    head = ["Cause", "Taken as", *(f"{AXIS_NAMES[a]} (°)" for a in axes)]
    return Table("Error budget of the pair's attitude (1 σ)", head, body, "ll" + "r" * len(axes))


def _tolerances(result: Result) -> dict[str, str]:
    s = result.settings
    return {
        "noise": "from the spectrum's floor",
        "radii": f"{s['radius_sigma_m'] * 1e3:g} mm each",
        "bias": f"{s['bias_sigma_m_s2'] * 1e3 / 9.80665:.2g} mg each",
        "time_skew": f"{s['time_skew_s'] * 1e3:g} ms",
        "sway": f"{s['sway_m'] * 1e3:g} mm at the oscillation",
        "gravity": f"{s['gravity_sigma_m_s2'] * 1e5:.3g} mGal",
    }


def sensor_table(result: Result) -> Table | None:
    """Radii and noise of every sensor."""
    found: dict[tuple[str, str], dict[str, Estimate]] = {}
    for r in result.rows:
        name, _, axis = r.quantity.rpartition("_")
        if r.group and r.variable is None and name in {"radius", "radius_from_motion", "sensor_noise"}:
            found.setdefault((axis, r.group), {})[name] = r
    if not found:
        return None
    body: list[list[str | Cell]] = [
        [
            f"{sensor.replace('_', ' ')}, {AXIS_NAMES[axis]}",
            *(_text(rows.get(q)) for q in ("radius", "radius_from_motion")),
            _milli(rows.get("sensor_noise")),
            flags_text(f for r in rows.values() for f in r.flags if f == "radius-disagrees"),
        ]
        for (axis, sensor), rows in found.items()
    ]
    head = ["Accelerometer", "Radius used (m)", "Radius from the motion (m)", "Noise (mm/s², 1 σ)", "Flags"]
    return Table("Accelerometers", head, body, "lrrrl")


def _milli(estimate: Estimate | None) -> str:
    if estimate is None:
        return MISSING
    scaled = (estimate.value * 1e3, estimate.low * 1e3, estimate.high * 1e3)
    return estimate_text(dataclasses.replace(estimate, value=scaled[0], low=scaled[1], high=scaled[2]))


def binned(rows: Sequence[Estimate], quantity: str, group: str) -> list[Estimate]:
    """The rows of one quantity and method that have a value, by bin."""
    return sorted(
        (r for r in rows if r.quantity == quantity and r.group == group and math.isfinite(r.value)),
        key=lambda r: r.bin_low,
    )
