"""Polar plots: what is given by angle and radius, drawn as lines and points in a square panel with rings and spokes.

Angles go clockwise from the top, as on a compass: the nose of a target is up. The renderers know nothing of angles.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rangeeval.reporting.axes import ticks
from rangeeval.reporting.blocks import Mark, Panel

Floats = NDArray[np.float64]

_STEP = math.radians(2.0)  # of an arc
_ROOM = 1.17  # of the outer ring's radius: for the angles written around it


@dataclass(frozen=True)
class Sector:
    """A value over a stretch of angle (radians), its interval's ends, and what the pointer tells of it."""

    start: float
    end: float
    value: float
    low: float
    high: float
    text: str = ""


def polar_panel(
    title: str, sectors: Sequence[Sector], unit: str, *, label: str, level: float = math.nan, level_label: str = ""
) -> Panel:
    """Each sector as an arc at its value with a radial bar for its interval; `level`: a circle to compare with.

    The radius is linear from the innermost ring's value, which is written like those of the others.
    """
    shown = [v for s in sectors for v in (s.low, s.value, s.high) if math.isfinite(v)]
    shown += [level] if math.isfinite(level) else []
    least, most = (min(shown), max(shown)) if shown else (0.0, 1.0)
    room = 0.05 * max(most - least, 1.0)
    rings, names, _ = ticks((least - room, most + room), 5)
    step = rings[1] - rings[0] if len(rings) > 1 else 1.0
    centre = min(rings[0], least) - step
    outer = max(rings[-1], most)

    def radius(value: float) -> float:
        return max(value - centre, 0.0)

    marks = [*_frame(rings, names, unit, centre, outer)]
    if math.isfinite(level):
        marks.append(Mark("line", *_arc(0.0, 2 * math.pi, radius(level)), label=level_label, role="predicted"))
    across: list[Floats] = []
    up: list[Floats] = []
    gap = np.array([np.nan])
    for s in sectors:
        middle = 0.5 * (s.start + s.end)
        if math.isfinite(s.value):
            x, y = _arc(s.start, s.end, radius(s.value))
            across, up = [*across, x, gap], [*up, y, gap]
        ends = np.array([v for v in (s.low, s.high) if math.isfinite(v)])
        if ends.size == 2:
            r = np.maximum(ends - centre, 0.0)
            across, up = [*across, r * math.sin(middle), gap], [*up, r * math.cos(middle), gap]
    if across:
        marks.append(Mark("line", np.concatenate(across), np.concatenate(up)))
    seen = [s for s in sectors if math.isfinite(s.value)]
    at = [(radius(s.value), 0.5 * (s.start + s.end)) for s in seen]
    marks.append(Mark(
        "points", [r * math.sin(a) for r, a in at], [r * math.cos(a) for r, a in at], label=label,
        texts=[s.text for s in seen],
    ))  # fmt: skip
    edge = _ROOM * radius(outer)
    return Panel(title, marks=marks, x_limits=(-edge, edge), y_limits=(-edge, edge), square=True)


def _arc(start: float, end: float, radius: float) -> tuple[Floats, Floats]:
    angle = np.linspace(start, end, max(2, math.ceil((end - start) / _STEP) + 1))
    return radius * np.sin(angle), radius * np.cos(angle)


def _frame(rings: Sequence[float], names: Sequence[str], unit: str, centre: float, outer: float) -> list[Mark]:
    """Rings with their values, spokes every 30 degrees with theirs."""
    x: list[Floats] = []
    y: list[Floats] = []
    gap = np.array([np.nan])
    for ring in rings:
        a, b = _arc(0.0, 2 * math.pi, ring - centre)
        x, y = [*x, a, gap], [*y, b, gap]
    spokes = np.deg2rad(np.arange(0.0, 360.0, 30.0))
    for spoke in spokes:
        ends = np.array([0.0, outer - centre])
        x, y = [*x, ends * math.sin(spoke), gap], [*y, ends * math.cos(spoke), gap]
    around = 1.085 * (outer - centre)
    beside = math.radians(15.0)
    units = [f"{name} {unit}" if i == len(names) - 1 else name for i, name in enumerate(names)]
    return [
        Mark("line", np.concatenate(x), np.concatenate(y), role="grid"),
        Mark("text", around * np.sin(spokes), around * np.cos(spokes), texts=[f"{a:.0f}°" for a in np.rad2deg(spokes)]),
        Mark(
            "text", [(r - centre) * math.sin(beside) for r in rings], [(r - centre) * math.cos(beside) for r in rings],
            texts=units,
        ),
    ]  # fmt: skip
