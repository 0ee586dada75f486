"""Small tables for the figures: attitude and its error over time, spectra, Allan deviation, errors over the path."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincinv

from rangeeval.analyses.attitude.gathering import Gathered
from rangeeval.analyses.attitude.motion import Motion
from rangeeval.analyses.attitude.pointing import Pointing
from rangeeval.analyses.attitude.setup import Setup
from rangeeval.stats.allan import allan_deviation, allan_interval_freedom, averaging_lengths, steady_stretch
from rangeeval.stats.reduce import thin

Array = NDArray[np.float64]
Columns = Mapping[str, list[float]]

ACROSS = 350  # pixel columns of a small plot
CLOSE_CYCLES = 12


def motion_series(motion: Motion, setup: Setup, gathered: Gathered) -> dict[str, Columns]:
    """Series of one axis: `<axis>/pair|single` over time, `<axis>/close`, `<axis>/spectrum`, `<axis>/allan`."""
    a, t = motion.axis, gathered.time_s
    series: dict[str, Columns] = {}
    lines = {"single": motion.single}
    if motion.heights is not None:
        lines["pair"] = motion.alpha
        lines["single_error"] = motion.single - motion.alpha
    for name, values in lines.items():
        series[f"{a}/{name}"] = _drawn(t, values, gathered.stretch, motion.frequency.value)
    if math.isfinite(motion.frequency.value):
        series[f"{a}/close"] = _close(motion, gathered)
    spectra = gathered.spectra.get(a)
    if spectra is not None and spectra.segments:
        scale = 1 / (setup.gravity * math.cos(motion.static.value if math.isfinite(motion.static.value) else 0.0)) ** 2
        i = motion.single_index
        table = {
            "frequency": spectra.frequency_hz[1:-1],
            "single": spectra.density(np.eye(len(motion.sensors))[i])[1:-1] * scale,
        }
        if motion.heights is not None:
            table["pair"] = spectra.density(motion.heights.centre)[1:-1] * scale
        kept: dict[str, list[float]] = {}
        for name in [n for n in table if n != "frequency"]:
            f, p = _by_decade(table["frequency"], table[name])
            kept |= {"frequency": f.tolist(), name: p.tolist()}
        if spectra.channels > 1 and spectra.segments > 2:
            kept["coherence"] = _by_decade(
                table["frequency"], spectra.coherence(0, spectra.channels - 1)[1:-1], mean=True
            )[1].tolist()
        series[f"{a}/spectrum"] = kept
    if motion.heights is not None:
        series |= _allan(motion, gathered)
    return series


def _drawn(time: Array, values: Array, stretch: NDArray[np.int64], frequency_hz: float) -> Columns:
    """A line, or for a long record the lowest and highest of each pixel column; `stretch` tells where gaps are.

    A column holds two cycles or more, else the envelope would beat with the columns.
    """
    if values.size <= 4 * ACROSS:
        return {"time_s": time.tolist(), "angle": values.tolist(), "stretch": stretch.astype(float).tolist()}
    edges = np.flatnonzero(np.diff(stretch)) + 1
    span = max(float(time[-1] - time[0]), 1e-9)
    columns = ACROSS if not math.isfinite(frequency_hz) else min(ACROSS, max(span * frequency_hz / 2, 1.0))
    found: dict[str, list[float]] = {"time_s": [], "low": [], "high": [], "stretch": []}
    for part in np.split(np.arange(values.size), edges):
        part = part[np.isfinite(values[part])]
        if not part.size:
            continue
        count = int(np.clip(columns * (time[part[-1]] - time[part[0]]) / span, 1, max(part.size // 4, 1)))
        starts = np.linspace(0, part.size, count, endpoint=False).astype(np.intp)
        v = values[part]
        low, high = np.minimum.reduceat(v, starts), np.maximum.reduceat(v, starts)
        # The columns' middles, drawn out to the ends of the stretch.
        t = 0.5 * (time[part[starts]] + time[part[np.append(starts[1:], part.size) - 1]])
        t[0], t[-1] = time[part[0]], time[part[-1]]
        found["time_s"] += t.tolist()
        found["low"] += low.tolist()
        found["high"] += high.tolist()
        found["stretch"] += [float(stretch[part[0]])] * count
    return found


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
    """At most about `lines` lines, evenly in the logarithm of frequency: the highest of those joined, or the mean."""
    if frequency.size <= lines:
        return frequency, density
    edges = np.unique(np.searchsorted(frequency, np.geomspace(frequency[0], frequency[-1], lines)))
    edges = edges[edges < frequency.size]
    count = np.diff(np.append(edges, frequency.size))
    joined = np.add.reduceat(density, edges) / count if mean else np.maximum.reduceat(density, edges)
    return np.add.reduceat(frequency, edges) / count, joined


def _at_rest(motion: Motion, gathered: Gathered, step: float) -> Array:
    """The longest stretch of the record in which the radar did not move: all of it, or where only noise is left."""
    if motion.static_segments:
        pieces = [motion.alpha[a:b] for a, b in motion.static_segments]
        whole = [w for v in pieces for w in np.split(v, np.flatnonzero(~np.isfinite(v)))]
        return max((w[np.isfinite(w)] for w in whole), key=lambda v: v.size)
    cycles = 2.0 / (motion.frequency.value * step) if math.isfinite(motion.frequency.value) else 0.0
    window = max(math.ceil(cycles), 16)
    parts = np.split(motion.alpha, np.flatnonzero(np.diff(gathered.stretch)) + 1)
    sigma = motion.pair_sigma / math.sqrt(gathered.block)
    return max((part[steady_stretch(part, sigma, window)] for part in parts), key=lambda v: v.size)


def _allan(motion: Motion, gathered: Gathered) -> dict[str, Columns]:
    step = gathered.interval_s * gathered.block
    values = _at_rest(motion, gathered, step)
    lengths = averaging_lengths(values.size)
    if lengths.size < 3:
        return {}
    deviation = allan_deviation(values, lengths)
    freedom = np.array([max(allan_interval_freedom(values.size, int(m)), 1.0) for m in lengths])
    low = deviation * np.sqrt(freedom / (2 * gammaincinv(freedom / 2, 0.975)))
    high = deviation * np.sqrt(freedom / (2 * gammaincinv(freedom / 2, 0.025)))
    return {
        f"{motion.axis}/allan": {
            "tau_s": (lengths * step).tolist(), "deviation": deviation.tolist(),
            "low": low.tolist(), "high": high.tolist()
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
                x, y = thin(path.range_m[order], values[order], 2 * ACROSS, 300)
                series[f"pointing/{method}/{angle}"] = {"range_m": x.tolist(), "error": y.tolist()}
    for angle, values in zip(("azimuth", "elevation"), found.pair_sigma, strict=True):
        if np.isfinite(values).any():
            series[f"pointing/pair/{angle}"] = {
                "time_s": path.time_s[every].tolist(), "range_m": path.range_m[every].tolist(),
                "sigma": values[every].tolist()
            }  # fmt: skip
    return series
