"""The source paper's other methods, for comparison: EM-A, ML-B, EM-B and the median rule MED.

They exist so that a result can be compared with one got by them; maximum_likelihood is exact, as quick, and does not
depend on where it starts.

References
----------
Jung and Hong (2017), eqs 10-15 with the errata of docs/explanation/rcs.md.
"""

# mypy: disable-error-code="call-arg"
# (kernels take what `arguments` packs: their number is numba\'s to check)
from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.compiled import compiled
from rangeeval.stats.swerling.likelihood import arguments, quick_case
from rangeeval.stats.swerling.looks import Case, Looks, Windows
from rangeeval.stats.swerling.terms import (
    DETECTION,
    HIT,
    MISS,
    detection_probability_of,
    level_below,
    look_terms,
    quick_value,
)

Floats = NDArray[np.float64]

CONVERGED, GUARD, EMPTY, SPENT = 0, 1, 2, 3
REASONS = ("converged", "guard", "no detection", "iterations spent")
_MOST = 500
_NODES, _WEIGHTS = (np.ascontiguousarray(a) for a in np.polynomial.legendre.leggauss(40))


@compiled
def _expected(kind, z, t, n, s, shape):  # type: ignore[no-untyped-def]
    """The mean of z given what the look shows."""
    if kind == DETECTION:
        return z
    if kind == MISS:
        return level_below(t, n, s, shape)
    limit = t if kind == HIT else z
    seen = detection_probability_of(limit, n, s, shape)
    return (n * (1.0 + s) - (1.0 - seen) * level_below(limit, n, s, shape)) / seen


@compiled
def _mean_of_moments(kind, z, threshold, alpha, pulses, shape, first, last, s):  # type: ignore[no-untyped-def]
    """Eq. 15: missed looks filled in with their conditional mean, then the estimate by moments."""
    total, seen_a, seen_t, level = 0.0, -1.0, -1.0, 0.0
    for k in range(first, last):
        n, a = pulses[k], alpha[k]
        if kind[k] == DETECTION:
            y = z[k]
        elif kind[k] == MISS:
            if a != seen_a or threshold[k] != seen_t:
                seen_a, seen_t = a, threshold[k]
                level = level_below(seen_t, n, a * s, shape[k])
            y = level
        else:
            y = _expected(kind[k], z[k], threshold[k], n, a * s, shape[k])
        total += (y - n) / (n * a)
    return total / (last - first)


@compiled
def _q(kind, z, threshold, alpha, shape, first, last, s, old):  # type: ignore[no-untyped-def]
    """Q(s, old) of one window and its derivatives in ln s (eq. 11): g1 by 40-point Gauss-Legendre."""
    value, d1, d2 = 0.0, 0.0, 0.0
    seen_a, seen_t, mv, m1, m2 = -1.0, -1.0, 0.0, 0.0, 0.0
    for k in range(first, last):
        a = alpha[k]
        if kind[k] == DETECTION:
            v, p, q = look_terms(DETECTION, z[k], threshold[k], 1, a * s, shape[k], 1.0)
        else:
            if a != seen_a or threshold[k] != seen_t:
                seen_a, seen_t = a, threshold[k]
                mv, m1, m2, total = 0.0, 0.0, 0.0, 0.0
                half = 0.5 * seen_t
                for i in range(len(_NODES)):
                    y = half * (_NODES[i] + 1.0)
                    w = _WEIGHTS[i] * math.exp(look_terms(DETECTION, y, seen_t, 1, a * old, shape[k], 1.0)[0])
                    v, p, q = look_terms(DETECTION, y, seen_t, 1, a * s, shape[k], 1.0)
                    total += w
                    mv += w * v
                    m1 += w * p
                    m2 += w * q
                mv, m1, m2 = mv / total, m1 / total, m2 / total
            v, p, q = mv, m1, m2
        value += v
        d1 += p
        d2 += q
    return value, d1, d2


@compiled
def _argmax_q(kind, z, threshold, alpha, shape, first, last, old):  # type: ignore[no-untyped-def]
    u, low, high = math.log(old), -math.inf, math.inf
    for _ in range(100):
        _, d1, d2 = _q(kind, z, threshold, alpha, shape, first, last, math.exp(u), old)
        if d1 > 0.0:
            low = u
        else:
            high = u
        step = -d1 / d2 if d2 < 0.0 else (1.0 if d1 > 0.0 else -1.0)
        new = u + max(-1.0, min(1.0, step))
        if not low < new < high:
            new = 0.5 * (low + high) if math.isfinite(low) and math.isfinite(high) else new
        if abs(new - u) < 1e-9:
            return math.exp(new)
        u = new
    return math.exp(u)


@compiled
def _plain_value(kind, z, threshold, alpha, pulses, shape, cells, quick, first, last, s):  # type: ignore[no-untyped-def]
    if quick:
        return quick_value(kind, z, threshold, alpha, shape[first], first, last, s)
    value = 0.0
    for k in range(first, last):
        value += look_terms(kind[k], z[k], threshold[k], pulses[k], alpha[k] * s, shape[k], cells)[0]
    return value


@compiled
def _iterate(  # type: ignore[no-untyped-def]
    kind,
    z,
    threshold,
    alpha,
    pulses,
    shape,
    cells,
    quick,
    firsts,
    lasts,
    start,
    method,
    absolute,
    relative,
    out,
    steps,
    why,
):
    """`method` 0: ML-B (guard on lnL), 1: EM-B (guard on Q), 2: EM-A (Q maximised)."""
    for i in range(len(firsts)):
        first, last = firsts[i], lasts[i]
        found, s = 0, 0.0
        for k in range(first, last):
            if kind[k] != MISS:
                found += 1
                y = z[k] if kind[k] != HIT else threshold[k]
                s += (y - pulses[k]) / (alpha[k] * pulses[k])
        s = max(0.0, s / (last - first))
        if start[i] > 0.0:
            s = start[i]
        steps[i], why[i] = 0, SPENT
        if found == 0:
            out[i], why[i] = 0.0, EMPTY
            continue
        known = -math.inf
        if method == 0 and s > 0.0:
            known = _plain_value(kind, z, threshold, alpha, pulses, shape, cells, quick, first, last, s)
        while steps[i] < _MOST:
            steps[i] += 1
            if method == 2 and s > 0.0:
                new = _argmax_q(kind, z, threshold, alpha, shape, first, last, s)
            else:
                new = _mean_of_moments(kind, z, threshold, alpha, pulses, shape, first, last, s)
            if new <= 0.0:
                s, why[i] = 0.0, CONVERGED
                break
            if method == 0:
                value = _plain_value(kind, z, threshold, alpha, pulses, shape, cells, quick, first, last, new)
                if value < known:
                    why[i] = GUARD
                    break
                known = value
            elif method == 1 and s > 0.0:
                after = _q(kind, z, threshold, alpha, shape, first, last, new, s)[0]
                if after < _q(kind, z, threshold, alpha, shape, first, last, s, s)[0]:
                    why[i] = GUARD
                    break
            moved = abs(new - s)
            s = new
            if moved < absolute or moved < relative * s:
                why[i] = CONVERGED
                break
        out[i] = s


METHODS = {"ml-b": 0, "em-b": 1, "em-a": 2}


def iterate(
    looks: Looks,
    windows: Windows,
    case: Case,
    method: str,
    *,
    start: ArrayLike = 0.0,
    absolute: float = 0.0,
    relative: float = 1e-6,
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int8]]:
    """Mean RCS of each window by `ml-b`, `em-b` or `em-a`; the iterations taken; why each stopped (see REASONS).

    ML-B and EM-B replace each missed z by its conditional mean and take the estimate by moments (eq. 15), until lnL
    (or Q) would fall or the step is small; EM-A maximises Q. With alphas that differ, ML-B and EM-B do *not* converge
    to the maximum likelihood. A window without detections gives 0.

    Parameters
    ----------
    start : the first s of each window; where 0, the mean of (z - n) / (n alpha) with misses counted as 0.
    absolute, relative : stop at a step below either; the paper's own is `absolute=1e-3, relative=0`.

    Raises
    ------
    ValueError : `em-a` or `em-b` for anything but detections and misses of single pulses, Swerling 1 to 4 (the paper
        defines Q only there).
    """
    if method != "ml-b" and not (
        bool((looks.pulses == 1).all()) and case.shape in (1.0, 2.0) and bool((looks.kind <= DETECTION).all())
    ):
        raise ValueError(f"{method} is defined for Swerling 1 to 4, single pulses and recorded amplitudes; use ml-a")
    out, steps = np.empty(len(windows)), np.empty(len(windows), np.int64)
    why = np.empty(len(windows), np.int8)
    begin = np.ascontiguousarray(np.broadcast_to(np.asarray(start, np.float64), len(windows)))
    _iterate(
        *arguments(looks, case), quick_case(looks, case) > 0, windows.first, windows.last, begin,
        METHODS[method], absolute, relative,
        out, steps, why,
    )  # fmt: skip
    return out, steps, why


@compiled
def _follow_median(kind, z, alpha, pulses, e, hits, dead, step, subtract, always, out):  # type: ignore[no-untyped-def]
    buffer = np.zeros(hits)
    held = 0
    for k in range(len(kind)):
        if kind[k] == MISS:
            e -= step
        else:
            n = pulses[k]
            buffer[held % hits] = (z[k] - (n if subtract else 0.0)) / (n * alpha[k])
            held += 1
        if held >= hits and (kind[k] != MISS or always):
            median = np.median(buffer)
            m = 10.0 * math.log10(median) if median > 0.0 else -math.inf
            if m > e + dead:
                e += step
            elif m < e - dead:
                e -= step
        out[k] = 10.0 ** (0.1 * e)


def median_rule(
    looks: Looks,
    *,
    start: float = 1.5,
    hits: int = 5,
    dead_db: float = 1.0,
    step_db: float = 0.5,
    subtract_noise: bool = True,
    every_scan: bool = False,
) -> Floats:
    """MED: the estimate after each look, moved 0.5 dB at a time by misses and by the median of the last detections.

    The paper leaves open whether noise is subtracted and whether the median is tested on missed scans too; the
    defaults are the primary reading.
    """
    out = np.empty(len(looks))
    _follow_median(
        looks.kind, looks.z, looks.alpha, looks.pulses, 10.0 * math.log10(start), hits, dead_db, step_db,
        subtract_noise, every_scan, out,
    )  # fmt: skip
    return out


def expected_log(s: float, old: float, threshold: float, shape: float = 2.0) -> float:
    """g1 of the paper's Q: E[ln(y + 1 + 2/S) | y missed, S'] at S = `s`, S' = `old` (eq. 12 as corrected)."""
    half = 0.5 * threshold
    y = half * (_NODES + 1.0)
    weight = _WEIGHTS * np.exp([look_terms(DETECTION, v, threshold, 1, old, shape, 1.0)[0] for v in y])
    return float(weight @ np.log(y + 1.0 + 2.0 / s) / weight.sum())


__all__ = ["METHODS", "REASONS", "expected_log", "iterate", "median_rule"]
