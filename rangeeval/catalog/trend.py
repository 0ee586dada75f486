"""From one trial to the next: is a quantity steady, which trial is out of line, and where did the level step.

Only the indexed estimates are read, each with its own interval. See `stats.control` for the method.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import special

from rangeeval.catalog.store import Catalog, Found, Indexed
from rangeeval.catalog.terms import Terms
from rangeeval.errors import InputError
from rangeeval.model import Estimate, Problem, Result
from rangeeval.stats.control import LEAST_POINTS, Chart, Segment, judge_series
from rangeeval.stats.intervals import FloatArray

QUANTITIES = (
    "range_sigma", "elevation_sigma", "azimuth_sigma", "y_sigma", "z_sigma", "detection_probability", "rcs",
    "range_bias", "azimuth_bias", "elevation_bias",
)  # fmt: skip
"""What is looked at when no quantity is named."""


@dataclass(frozen=True)
class _Scale:
    """On which scale a quantity's intervals are symmetric and its error does not depend on its size."""

    name: str
    to: Callable[[FloatArray], FloatArray]
    back: Callable[[FloatArray], FloatArray]


_LINEAR = _Scale("linear", lambda x: x, lambda x: x)
_LOG = _Scale("logarithmic", np.log, np.exp)
_ARCSINE = _Scale(
    "arcsine", lambda p: np.arcsin(np.sqrt(np.clip(p, 0, 1))), lambda x: np.sin(np.clip(x, 0, math.pi / 2)) ** 2
)
_SIGNED = ("_bias", "_mean", "_offset")


def _scale_of(quantity: str, lows: Sequence[float]) -> _Scale:
    if "probability" in quantity:
        return _ARCSINE
    return _LOG if min(lows) > 0 and not quantity.endswith(_SIGNED) else _LINEAR


def trend(catalog: Catalog, terms: Terms | None = None, *, alpha: float = 0.05) -> Result:
    """Control charts of the quantities and bins that the terms leave, over the trials in order of date.

    Without a group in the terms, rows of all samples together are looked at. `alpha`: how often a page of steady charts
    raises a false alarm, of each kind (limits, drift, steps); it is shared among the charts.

    Returns
    -------
    Rows of three kinds (column `kind`): `point`, an estimate of a trial with the limits it is held against and
    `verdict` `in` or `out`; `level`, the weighted mean of the trials between two steps; `step`, the ratio (or
    difference) of two levels with `p_value`. `chart` numbers the charts.

    Raises
    ------
    InputError : nothing in the catalogue is what the terms say.
    """
    terms = terms or Terms()
    chosen: list[list[Indexed]] = []
    for series in catalog.series(terms):
        first = series[0].estimate
        wanted = terms.quantity is not None or first.quantity in QUANTITIES
        pooled = terms.group is not None or (first.group is None and first.track_id is None)
        if wanted and pooled and series[0].analysis != "check":
            chosen.append(series)
    if not chosen:
        raise InputError(
            f"{catalog.where}: no estimate in it is what was asked for; 'rangeeval catalog list' shows trials"
        )
    again: set[str] = set()
    every = [_Points.of(_once(series, again)) for series in chosen]
    charts = [points for points in every if points.of_trial]
    judged = sum(len(points.y) >= LEAST_POINTS for points in charts)
    results = list({point.result.id: point.result for points in charts for point in points.of_trial}.values())
    results.sort(key=lambda result: (not result.date, result.date, result.name, result.path))
    places = {result.id: place for place, result in enumerate(results, 1)}
    share = alpha / max(judged, 1)
    rows = [row for number, points in enumerate(charts, 1) for row in _rows(number, points, places, share)]
    settings = {
        "false_alarm_rate": alpha,
        "charts": len(charts),
        "charts_judged": judged,
        "trials": len(results),
        "terms": {k: v for k, v in terms.__dict__.items() if v not in (None, ())},
    }
    return Result("trend", tuple(rows), settings, tuple(_problems(catalog, results, again, every)), {}, _about(results))


def _once(series: Sequence[Indexed], again: set[str]) -> list[Indexed]:
    """One estimate a trial: where several files hold the same trial, the one indexed last."""
    newest: dict[str, Indexed] = {}
    for point in series:
        key = point.result.inputs or point.result.sha256
        if key in newest and newest[key].result.id != point.result.id:
            again.add(key)
        if key not in newest or newest[key].result.id < point.result.id:
            newest[key] = point
    kept = {id(point) for point in newest.values()}
    return [point for point in series if id(point) in kept]


@dataclass(frozen=True)
class _Points:
    """The estimates of one chart on their scale, with their error variances; `left_out`: those without an interval."""

    of_trial: tuple[Indexed, ...]
    scale: _Scale
    y: FloatArray
    v: FloatArray
    left_out: int

    @classmethod
    def of(cls, series: Sequence[Indexed]) -> _Points:
        usable = [p for p in series if _has_interval(p.estimate)]
        if not usable:
            return cls((), _LINEAR, np.empty(0), np.empty(0), len(series))
        scale = _scale_of(usable[0].estimate.quantity, [p.estimate.low for p in usable])
        value, low, high = (
            scale.to(np.array([getattr(p.estimate, name) for p in usable])) for name in ("value", "low", "high")
        )
        confidence = np.array([p.confidence if 0 < p.confidence < 1 else 0.95 for p in usable])
        sigma = (high - low) / (2 * special.ndtri((1 + confidence) / 2))
        return cls(tuple(usable), scale, value, sigma**2, len(series) - len(usable))


def _has_interval(row: Estimate) -> bool:
    return math.isfinite(row.value) and math.isfinite(row.low) and math.isfinite(row.high) and row.low < row.high


def _rows(number: int, points: _Points, places: Mapping[int, int], alpha: float) -> Iterator[Estimate]:
    chart = judge_series(points.y, points.v, alpha) if len(points.y) >= LEAST_POINTS else None
    for i, point in enumerate(points.of_trial):
        extra = {"chart": number, "kind": "point", "analysis": point.analysis, "number": places[point.result.id]}
        extra |= _trial(point.result)
        yield replace(point.estimate, extra={**extra, **(_judged(points, chart, i) if chart else _UNJUDGED)},
                      flags=point.estimate.flags if chart else (*point.estimate.flags, "few-trials"))  # fmt: skip
    if chart is None:
        return
    first = points.of_trial[0].estimate
    where: dict[str, Any] = {
        name: getattr(first, name) for name in ("variable", "bin_low", "bin_high", "group", "track_id")
    }
    back = points.scale.back
    for segment in chart.segments:
        half = 1.96 * math.sqrt(segment.variance)
        value, low, high = (float(back(np.array(segment.mean + d))) for d in (0.0, -half, half))
        yield Estimate(
            quantity=first.quantity, unit=first.unit, value=value, low=low, high=high, n=segment.stop - segment.start,
            **where,
            extra={
                "chart": number, "kind": "level", "first": _name(points, segment.start),
                "last": _name(points, segment.stop - 1), "between_sigma": math.sqrt(chart.tau2),
                "scale": points.scale.name,
            },
        )  # fmt: skip
    for (before, after), step in zip(pairwise(chart.segments), chart.steps, strict=True):
        quantity, unit, (value, low, high) = _step(points.scale, first, before, after)
        yield Estimate(
            quantity=quantity, unit=unit, value=value, low=low, high=high, n=after.stop - before.start, **where,
            extra={
                "chart": number, "kind": "step", "last": _name(points, step.at - 1), "first": _name(points, step.at),
                "date": points.of_trial[step.at].result.date, "software": points.of_trial[step.at].result.software,
                "p_value": step.p_value,
            },
        )  # fmt: skip


_UNJUDGED: dict[str, Any] = dict.fromkeys(
    ("level", "limit_low", "limit_high", "smoothed", "smoothed_limit", "drifts", "verdict")
)


def _judged(points: _Points, chart: Chart, i: int) -> dict[str, Any]:
    """What a point is held against, in the quantity's own unit."""
    reach = chart.limit * chart.sigma[i]
    level, low, high = (float(points.scale.back(chart.level[i] + d)) for d in (0.0, -reach, reach))
    drifts = abs(chart.smoothed[i]) > chart.smoothed_limit
    return {
        "level": level, "limit_low": low, "limit_high": high, "smoothed": float(chart.smoothed[i]),
        "smoothed_limit": chart.smoothed_limit, "drifts": bool(drifts),
        "verdict": "out" if abs(chart.deviation[i]) > chart.limit else "in",
    }  # fmt: skip


def _step(scale: _Scale, row: Estimate, before: Segment, after: Segment) -> tuple[str, str, tuple[float, float, float]]:
    """How large a step is, with its 95 % interval: a ratio on the logarithmic scale, else a difference."""
    if scale is _ARCSINE:
        levels = [float(scale.back(np.array(s.mean))) for s in (before, after)]
        variance = sum(math.sin(2 * s.mean) ** 2 * s.variance for s in (before, after))
        size = levels[1] - levels[0]
    else:
        size, variance = after.mean - before.mean, before.variance + after.variance
    half = 1.96 * math.sqrt(variance)
    ends = (size, size - half, size + half)
    if scale is _LOG:
        return f"{row.quantity}_ratio", "1", tuple(math.exp(end) for end in ends)  # type: ignore[return-value]
    return f"{row.quantity}_difference", row.unit, ends


def _name(points: _Points, i: int) -> str:
    return points.of_trial[i].result.name


def _trial(result: Found) -> dict[str, Any]:
    return {
        "trial": result.name, "date": result.date, "radar": result.radar, "software": result.software,
        "sha256": result.sha256,
    }  # fmt: skip


def _problems(
    catalog: Catalog, results: Sequence[Found], again: set[str], charts: Sequence[_Points]
) -> Iterator[Problem]:
    if again:
        yield Problem(
            catalog.where, f"{len(again)} trials are indexed more than once; the newest result of each counts"
        )
    if undated := [r.name for r in results if not r.date]:
        yield Problem(
            catalog.where, f"{len(undated)} trials have no date; they stand last, by name", 0, tuple(undated[:5])
        )
    if left_out := sum(points.left_out for points in charts):
        yield Problem(catalog.where, f"{left_out} estimates have no interval; they are in no chart")
    if few := sum(0 < len(points.y) < LEAST_POINTS for points in charts):
        yield Problem(catalog.where, f"{few} charts have fewer than {LEAST_POINTS} trials; they have no limits")


def _about(results: Sequence[Found]) -> dict[str, Any]:
    """The provenance: the words of the page, every handling mark there is, and the files."""

    def words(name: str) -> str:
        return " / ".join(sorted({getattr(result, name) for result in results} - {""}))

    dates = sorted(result.date for result in results if result.date)
    span = f"{dates[0]} to {dates[-1]}" if dates else "no dates"
    return {
        "trial": {
            "name": f"Trend over {len(results)} trials", "date": dates[-1] if dates else "", "radar": words("radar"),
            "handling": words("handling"), "software": words("software"), "description": span,
        },
        "inputs": [
            {"file": result.name, "kind": result.form, "format": result.date or "no date", "bytes": result.bytes,
             "sha256": result.sha256}
            for result in results
        ],
    }  # fmt: skip
