"""Small tables for the figures: sliding RCS, detection probability over range, amplitudes against the cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.rcs.gathering import Gathered
from rangeeval.analyses.rcs.numbers import RangeLaw
from rangeeval.stats.swerling import DETECTION, Case, Looks
from rangeeval.stats.swerling.detection import detection_probability
from rangeeval.stats.swerling.likelihood import in_closed_form

Floats = NDArray[np.float64]
Columns = Mapping[str, list[float]]

POINTS = 1500
CURVE = 120
MODELLED = 200


def sliding_series(time_s: Floats, s: Floats, low: Floats, high: Floats, hits: NDArray[np.int64]) -> Columns:
    """The sliding estimate, thinned to what a plot shows: of each stretch, the lowest and the highest are kept."""
    n = len(time_s)
    keep = np.arange(n)
    if n > POINTS:
        edges = np.linspace(0, n, POINTS // 2 + 1).astype(int)
        finite = np.where(np.isfinite(s), s, 0.0)
        ends = [(a + int(np.argmin(finite[a:b])), a + int(np.argmax(finite[a:b])))
                for a, b in pairwise(edges) if b > a]  # fmt: skip
        keep = np.unique(np.array(ends).reshape(-1))
    return {
        "time_s": time_s[keep].tolist(),
        "rcs_m2": s[keep].tolist(),
        "low_m2": low[keep].tolist(),
        "high_m2": high[keep].tolist(),
        "detections": hits[keep].astype(float).tolist(),
    }


def curve_series(law: RangeLaw, case: Case, ends: Floats) -> Columns:
    """The model's detection probability over range, with its band."""
    ranges = np.geomspace(max(0.5 * law.nearest, 1.0), 1.3 * law.farthest, CURVE)
    value, low, high = (law.probability(ranges, case, float(s)) for s in ends)
    return {"range_m": ranges.tolist(), "value": value.tolist(), "low": low.tolist(), "high": high.tolist()}


def amplitude_series(gathered: Gathered, s_of_look: Mapping[str, Floats], cases: Sequence[Case]) -> dict[str, Columns]:
    """Histogram of detected amplitudes in dB, and how many each fitted case expects in the same steps."""
    looks = gathered.looks
    hit = looks.kind == DETECTION
    if hit.sum() < 5:
        return {}
    db = 10.0 * np.log10(looks.z[hit])
    count = int(np.clip(np.sqrt(hit.sum()), 8, 40))
    edges = np.linspace(db.min(), db.max() + 1e-9, count + 1)
    counts, _ = np.histogram(db, bins=edges)
    found: dict[str, Columns] = {
        "amplitudes": {"low_db": edges[:-1].tolist(), "high_db": edges[1:].tolist(), "count": counts.tolist()}
    }
    for case in cases:
        most = MODELLED if in_closed_form(looks, case) else MODELLED // 8  # a series of thousands of terms each
        chosen = np.unique(np.linspace(0, len(looks) - 1, most).round().astype(int))
        some = looks.take(np.asarray(chosen, np.int64))
        s = s_of_look[case.name][chosen]
        expected = _expected(some, case, s, 10.0 ** (0.1 * edges)) * len(looks) / len(chosen)
        found[f"amplitudes/{case.name}"] = {"low_db": edges[:-1].tolist(), "expected": expected.tolist()}
    return found


def _expected(looks: Looks, case: Case, s: Floats, edges: Floats) -> Floats:
    """Expected detections in each step of amplitude, summed over looks."""
    level = np.where(np.isfinite(s), s, 0.0) * looks.alpha
    above = np.stack([
        detection_probability(level, np.maximum(edge, looks.threshold), case, looks.pulses) for edge in edges
    ])  # fmt: skip
    return np.asarray(-np.diff(above.sum(axis=1)))
