"""Small tables for the figures: attitude and its error over time, spectra, Allan deviation, errors over the path."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from rangeeval.analyses.attitude.gathering import Gathered
from rangeeval.analyses.attitude.motion import Motion
from rangeeval.analyses.attitude.pointing import Pointing
from rangeeval.analyses.attitude.setup import Setup
from rangeeval.stats.allan import allan_deviation, allan_interval_freedom, averaging_lengths
from rangeeval.stats.reduce import decimate

Array = NDArray[np.float64]
Columns = Mapping[str, list[float]]

ACROSS = 350  # pixel columns of a small plot
CLOSE_CYCLES = 12


def motion_series(motion: Motion, setup: Setup, gathered: Gathered) -> dict[str, Columns]:
    """Series of one axis: `<axis>/pair|single` over time, `<axis>/close`, `<axis>/spectrum`, `<axis>/allan`."""
    a, t = motion.axis, gathered.time_s
    series: dict[str, Columns] = {}
    broken = _with_breaks(gathered)
    lines = {"single": motion.single}
    if motion.heights is not None:
        lines["pair"] = motion.alpha
        lines["single_error"] = motion.single - motion.alpha
    for name, values in lines.items():
        x, y = decimate(broken(t, t), broken(values, np.full(values.size, np.nan)), ACROSS)
        series[f"{a}/{name}"] = {"time_s": x.tolist(), "angle": y.tolist()}
    if math.isfinite(motion.frequency.value):
        series[f"{a}/close"] = _close(motion, gathered)
    spectra = gathered.spectra.get(a)
    if spectra is not None and spectra.segments:
        scale = 1 / (setup.gravity * math.cos(motion.static.value if math.isfinite(motion.static.value) else 0.0)) ** 2
        i = motion.single_index
        table = {"frequency": spectra.frequency_hz[1:-1], "single": spectra.density(np.eye(len(motion.sensors))[i])[1:-1] * scale}
        if motion.heights is not None:
            table["pair"] = spectra.density(motion.heights.centre)[1:-1] * scale
        kept: dict[str, list[float]] = {}
        for name in [n for n in table if n != "frequency"]:
            f, p = _by_decade(table["frequency"], table[name])
            kept |= {"frequency": f.tolist(), name: p.tolist()}
        if spectra.channels > 1 and spectra.segments > 2:
            kept["coherence"] = _by_decade(table["frequency"], spectra.coherence(0, spectra.channels - 1)[1:-1], mean=True)[1].tolist()
        series[f"{a}/spectrum"] = kept
    if motion.static_segments and motion.heights is not None:
        series |= _allan(motion, gathered)
    return series


def _with_breaks(gathered: Gathered):  # type: ignore[no-untyped-def]
    """A function that puts a value between stretches, so that a line breaks there."""
    edges = np.flatnonzero(np.diff(gathered.stretch)) + 1

    def insert(values: Array, filler: Array) -> Array:
        return np.insert(values, edges, filler[edges])

    return insert


def _close(motion: Motion, gathered: Gathered) -> Columns:
    """A few cycles where the motion is largest: what a long record shows only as a band."""
    t, width = gathered.time_s, CLOSE_CYCLES / motion.frequency.value
    away = np.abs(motion.alpha - motion.static.value)
    best = int(np.nanargmax(np.where(np.isfinite(away), away, -1.0)))
    middle = float(np.clip(t[best], t[0] + width / 2, max(t[-1] - width / 2, t[0] + width / 2)))
    inside = np.flatnonzero((t >= middle - width / 2) & (t <= middle + width / 2))
    inside = inside[:: max(1, inside.size // 600)]
    found = {"time_s": t[inside].tolist(), "single": motion.single[inside].tolist()}
    if motion.heights is not None:
        found["pair"] = motion.alpha[inside].tolist()
    return found


def _by_decade(frequency: Array, density: Array, lines: int = 500, *, mean: bool = False) -> tuple[Array, Array]:
    """At most about `lines` lines, evenly in the logarithm of frequency; the highest of those joined (or their mean)."""
    if frequency.size <= lines:
        return frequency, density
    edges = np.unique(np.searchsorted(frequency, np.geomspace(frequency[0], frequency[-1], lines)))
    edges = edges[edges < frequency.size]
    count = np.diff(np.append(edges, frequency.size))
    joined = np.add.reduceat(density, edges) / count if mean else np.maximum.reduceat(density, edges)
    return np.add.reduceat(frequency, edges) / count, joined


def _allan(motion: Motion, gathered: Gathered) -> dict[str, Columns]:
    step = gathered.interval_s * gathered.block
    pieces = [motion.alpha[a:b] for a, b in motion.static_segments]
    values = max(pieces, key=lambda v: v.size)
    whole = np.split(values, np.flatnonzero(~np.isfinite(values)))
    values = max((w[np.isfinite(w)] for w in whole), key=lambda v: v.size)
    lengths = averaging_lengths(values.size)
    if lengths.size < 3:
        return {}
    deviation = allan_deviation(values, lengths)
    freedom = np.array([max(allan_interval_freedom(values.size, int(m)), 1.0) for m in lengths])
    low = deviation * np.sqrt(freedom / stats.chi2.ppf(0.975, freedom))
    high = deviation * np.sqrt(freedom / stats.chi2.ppf(0.025, freedom))
    return {
        f"{motion.axis}/allan": {
            "tau_s": (lengths * step).tolist(), "deviation": deviation.tolist(), "low": low.tolist(), "high": high.tolist()
        }
    }  # fmt: skip


def pointing_series(found: Pointing) -> dict[str, Columns]:
    """`path` and `pointing/<method>`: errors over range, with the pair's sigma beside them."""
    path = found.path
    order = np.argsort(path.time_s, kind="stable")
    every = order[:: max(1, order.size // 1500)]
    series: dict[str, Columns] = {
        "path": {
            "time_s": path.time_s[every].tolist(), "range_m": path.range_m[every].tolist(),
            "azimuth": path.azimuth[every].tolist(), "elevation": path.elevation[every].tolist(),
        }
    }  # fmt: skip
    for method, errors in found.report.items():
        for angle, values in zip(("azimuth", "elevation"), errors, strict=True):
            if np.isfinite(values).any():
                x, y = decimate(path.time_s[order], values[order], ACROSS)
                at = np.interp(x, path.time_s[order], path.range_m[order])
                series[f"pointing/{method}/{angle}"] = {"time_s": x.tolist(), "range_m": at.tolist(), "error": y.tolist()}
    for angle, values in zip(("azimuth", "elevation"), found.pair_sigma, strict=True):
        if np.isfinite(values).any():
            series[f"pointing/pair/{angle}"] = {
                "time_s": path.time_s[every].tolist(), "range_m": path.range_m[every].tolist(), "sigma": values[every].tolist()
            }  # fmt: skip
    return series
