"""Where axes begin and end, and the round numbers written along them: the same for every renderer."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from rangeeval.reporting.blocks import Figure, Mark, Numbers, Panel
from rangeeval.reporting.style import HEAT_LEVELS

Floats = NDArray[np.float64]
Range = tuple[float, float]

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
MISSING_LEVEL = 255
_LARGEST = 1e300  # beyond it, the width of an axis overflows


def floats(values: Numbers) -> Floats:
    """Numbers as an array of doubles; what is too large to draw counts as not there."""
    array = np.asarray(values, dtype=np.float64).reshape(-1)
    too_large = np.abs(array) > _LARGEST
    return np.where(too_large, np.nan, array) if too_large.any() else array


def panels(figure: Figure) -> Iterator[tuple[int, int, Panel]]:
    """Each panel with its row and column."""
    for row, line in enumerate(figure.panels):
        for column, panel in enumerate(line):
            if panel is not None:
                yield row, column, panel


def views(figure: Figure) -> dict[tuple[int, int], tuple[Range, Range]]:
    """The x and y range of each panel; panels that share x have one x range."""
    own: dict[tuple[int, int], tuple[Range, Range]] = {}
    shared: dict[tuple[str, bool], list[float]] = {}
    for row, column, panel in panels(figure):
        own[row, column] = x, _ = _view(panel)
        if panel.share_x:
            shared.setdefault((panel.share_x, panel.x_log), []).extend(x)
    for row, column, panel in panels(figure):
        if panel.share_x:
            ends = shared[panel.share_x, panel.x_log]
            own[row, column] = (min(ends), max(ends)), own[row, column][1]
    return own


def _view(panel: Panel) -> tuple[Range, Range]:
    heats = [mark for mark in panel.marks if mark.kind == "heat" and len(mark.z)]
    if heats and not (panel.x_log or panel.y_log):  # they fill their panel
        edges_x, edges_y = (np.concatenate([floats(getattr(mark, name)) for mark in heats]) for name in "xy")
        y_ends = (float(edges_y.min()), float(edges_y.max()))
        return panel.x_limits or _padded([edges_x], False, 0.005), panel.y_limits or y_ends
    across = [floats(mark.x) for mark in panel.marks]
    up = [floats(part) for mark in panel.marks for part in (mark.y, mark.low, mark.high)]
    based = any(mark.kind in ("bars", "stems") for mark in panel.marks) and not panel.y_log
    x = _padded(across, panel.x_log, 0.02)
    y = _padded([*up, np.zeros(1)] if based else up, panel.y_log, 0.06)
    if based and all(np.nanmin(part, initial=0.0) >= 0 for part in up):
        y = (0.0, y[1])
    return panel.x_limits or x, panel.y_limits or y


def heat_levels(mark: Mark) -> NDArray[np.uint8]:
    """The values of a heat mark as levels of its colours, a row a y from the lowest on; 255 where missing."""
    values = np.array([floats(row) for row in mark.z]).reshape(len(mark.z), -1)
    there = np.isfinite(values)
    low, high = (float(values[there].min()), float(values[there].max())) if there.any() else (0.0, 0.0)
    scale = (HEAT_LEVELS - 1) / (high - low) if high > low else 0.0
    return np.where(there, np.rint((np.where(there, values, low) - low) * scale), MISSING_LEVEL).astype(np.uint8)


def _padded(arrays: Iterable[Floats], log: bool, share: float) -> Range:
    values = np.concatenate([*arrays, np.empty(0)])
    values = values[np.isfinite(values) & ((values > 0) | (not log))]
    if values.size == 0:
        return (0.1, 10.0) if log else (0.0, 1.0)
    low, high = float(values.min()), float(values.max())
    if log:
        low, high = math.log10(low), math.log10(high)
    if high - low <= 1e-12 * max(abs(low), abs(high)):
        room = 0.5 if log else abs(low) * 0.05 or 0.5
    else:
        room = (high - low) * share
    low, high = low - room, high + room
    return (10.0**low, 10.0 ** min(high, 300.0)) if log else (low, high)


def ticks(view: Range, most: int, log: bool = False) -> tuple[list[float], list[str], str]:
    """At most about `most` round values in a range, their labels, and a power of ten common to the labels."""
    low, high = view
    most = max(2, most)
    if log:
        values, labels = _log_ticks(low, high, most)
        if len(values) >= 2:
            return values, labels, ""
    for factor in (1.0, 0.5, 0.25):  # where one round number or none falls inside, take a finer step
        step = _round_step((high - low) / most * factor)
        first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
        if last - first >= min(2, most - 1):
            break
    largest = max(abs(low), abs(high))
    power = 3 * math.floor(math.log10(largest) / 3) if largest > 0 else 0
    power = power if wants_power(view) else 0
    unit = 10.0**power
    decimals = max(0, min(12, -math.floor(math.log10(step / unit) + 1e-9)))
    values = [number * step for number in range(first, min(last, first + 50) + 1)]
    labels = [f"{value / unit + 0.0:.{decimals}f}" for value in values]
    labels = [label.lstrip("-") if float(label) == 0 else label for label in labels]
    return values, [label.replace("-", "−") for label in labels], power_of_ten(power) if power else ""


def wants_power(view: Range) -> bool:
    """Whether labels read better with a power of ten: large or small, and not a short way far from zero."""
    largest = max(abs(view[0]), abs(view[1]))
    return (largest >= 1e6 or largest < 2e-3) and view[1] - view[0] > 1e-2 * largest


def power_of_ten(power: int) -> str:
    """`10⁻³`, in characters."""
    return "10" + str(power).translate(_SUPERSCRIPT)


def _round_step(least: float) -> float:
    decade = 10.0 ** math.floor(math.log10(least)) if least > 0 else 1.0
    return next(factor * decade for factor in (1, 2, 5, 10) if factor * decade >= least * (1 - 1e-9))


def _log_ticks(low: float, high: float, most: int) -> tuple[list[float], list[str]]:
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    for factors in ((1, 2, 3, 5, 7), (1, 2, 5), (1, 3), (1,)):
        values = [(f, p) for p in range(first, last + 1) for f in factors if low <= f * 10.0**p <= high]
        if len(values) <= most:
            break
    else:
        every = math.ceil(len(values) / most)
        values = [(f, p) for f, p in values if p % every == 0]
    plain = first >= -3 and last <= 4
    labels = [
        f"{f * 10.0**p:.{max(0, -p)}f}" if plain else power_of_ten(p) if f == 1 else f"{f}·{power_of_ten(p)}"
        for f, p in values
    ]
    return [f * 10.0**p for f, p in values], labels


def legend(figure: Figure) -> list[Mark]:
    """One mark for each label of a figure, in the order in which they first appear."""
    seen: dict[tuple[str, str], Mark] = {}
    for _, _, panel in panels(figure):
        for mark in panel.marks:
            if mark.label:
                seen.setdefault((mark.label, mark.role), mark)
    return list(seen.values())
