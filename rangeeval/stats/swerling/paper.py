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
from rangeeval.stats.swerling.closed import (
    CONVERGED,
    DETECTION,
    EMPTY,
    GUARD,
    HIT,
    MISS,
    SPENT,
    closed_ml_b,
    closed_moments,
    density,
    density_one,
    density_three,
)
from rangeeval.stats.swerling.likelihood import detections, in_closed_form, log_likelihood, newton
from rangeeval.stats.swerling.looks import Case, Looks, Windows
from rangeeval.stats.swerling.terms import detection_probability_of, level_below

Floats = NDArray[np.float64]

METHODS = ("ml-b", "em-b", "em-a")
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
def _series_moments(kind, z, threshold, alpha, pulses, shape, firsts, lasts, s, out):  # type: ignore[no-untyped-def]
    """Eq. 15 for each window, whatever its looks are."""
    for i in range(len(firsts)):
        total = 0.0
        for k in range(firsts[i], lasts[i]):
            n, a = pulses[k], alpha[k]
            total += (_expected(kind[k], z[k], threshold[k], n, a * s[i], shape[k]) - n) / (n * a)
        out[i] = total / (lasts[i] - firsts[i])


def _moments(looks: Looks, windows: Windows, case: Case, s: Floats) -> Floats:
    """Eq. 15: missed looks filled in with their conditional mean, then the estimate by moments."""
    out = np.empty(len(windows))
    if in_closed_form(looks, case):
        closed_moments(
            looks.kind, looks.z, looks.threshold, looks.alpha, case.shape, windows.first, windows.last, s, out
        )
    else:
        _series_moments(
            looks.kind, looks.z, looks.threshold, looks.alpha, looks.pulses, case.shapes(looks.pulses),
            windows.first, windows.last, s, out,
        )  # fmt: skip
    return out


@compiled
def _expectations(kind, z, threshold, alpha, shape, firsts, lasts, s, old, value, slope, bend):  # type: ignore[no-untyped-def]
    """Q(s, old) of each window and its derivatives in ln s (eq. 11): g1 by 40-point Gauss-Legendre."""
    for i in range(len(firsts)):
        total, d1, d2 = 0.0, 0.0, 0.0
        seen_a, seen_t, m0, m1, m2 = -1.0, -1.0, 0.0, 0.0, 0.0
        for k in range(firsts[i], lasts[i]):
            a = alpha[k]
            if kind[k] == DETECTION:
                v0 = density(z[k], a * s[i], shape)
                v1, v2, _ = density_one(z[k], a * s[i]) if shape == 1.0 else density_three(z[k], a * s[i])
            else:
                if a != seen_a or threshold[k] != seen_t:
                    seen_a, seen_t = a, threshold[k]
                    m0, m1, m2, weight = 0.0, 0.0, 0.0, 0.0
                    for j in range(len(_NODES)):
                        y = 0.5 * seen_t * (_NODES[j] + 1.0)
                        w = _WEIGHTS[j] * math.exp(density(y, a * old[i], shape))
                        p, q, _ = density_one(y, a * s[i]) if shape == 1.0 else density_three(y, a * s[i])
                        weight += w
                        m0 += w * density(y, a * s[i], shape)
                        m1 += w * p
                        m2 += w * q
                    m0, m1, m2 = m0 / weight, m1 / weight, m2 / weight
                v0, v1, v2 = m0, m1, m2
            total += v0
            d1 += v1
            d2 += v2
        value[i], slope[i], bend[i] = total, d1, d2


def _q(looks: Looks, windows: Windows, case: Case, s: Floats, old: Floats) -> tuple[Floats, Floats, Floats]:
    value, slope, bend = (np.empty(len(windows)) for _ in range(3))
    _expectations(
        looks.kind, looks.z, looks.threshold, looks.alpha, case.shape, windows.first, windows.last, s, old, value,
        slope, bend,
    )  # fmt: skip
    return value, slope, bend


def _argmax_q(looks: Looks, windows: Windows, case: Case, old: Floats) -> Floats:
    return np.exp(newton(lambda rows, s: _q(looks, windows.take(rows), case, s, old[rows]), np.log(old)))


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
    quick = in_closed_form(looks, case)
    if method != "ml-b" and not quick:
        raise ValueError(f"{method} is defined for Swerling 1 to 4, single pulses and recorded amplitudes; use ml-a")
    begin = np.ascontiguousarray(np.broadcast_to(np.asarray(start, np.float64), len(windows)))
    if method == "ml-b" and quick:
        s, steps, why = np.empty(len(windows)), np.empty(len(windows), np.int64), np.empty(len(windows), np.int8)
        closed_ml_b(
            looks.kind, looks.z, looks.threshold, looks.alpha, case.shape, windows.first, windows.last, begin,
            absolute, relative, _MOST, s, steps, why,
        )  # fmt: skip
        return s, steps, why
    return iterate_together(looks, windows, case, method, begin, absolute, relative)


def iterate_together(
    looks: Looks, windows: Windows, case: Case, method: str, start: Floats, absolute: float, relative: float
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int8]]:
    """`iterate` for every method and sort of look, a step of all windows at a time."""
    known = np.where(looks.kind == HIT, looks.threshold, looks.z) - looks.pulses
    moments = np.where(looks.kind == MISS, 0.0, known / (looks.alpha * looks.pulses))
    size = windows.last - windows.first
    s = np.where(start > 0.0, start, np.maximum(0.0, windows.reduce(np.add, moments) / size))
    found = detections(looks, windows) > 0
    s[~found] = 0.0
    steps, why = np.zeros(len(windows), np.int64), np.where(found, SPENT, EMPTY).astype(np.int8)
    open_ = np.flatnonzero(found)

    def worth(rows: NDArray[np.int64], new: Floats, old: Floats) -> Floats:
        """What must not fall: Q for EM-B, else lnL."""
        value, some = np.full(len(rows), -np.inf), windows.take(rows)
        inside = new > 0.0 if method != "em-b" else (new > 0.0) & (old > 0.0)
        here = some.take(inside)
        value[inside] = (
            _q(looks, here, case, new[inside], old[inside])[0]
            if method == "em-b"
            else log_likelihood(looks, here, case, new[inside])[0]
        )
        return value

    for _ in range(_MOST):
        if not len(open_):
            break
        steps[open_] += 1
        old, some = s[open_], windows.take(open_)
        new = _moments(looks, some, case, old)
        if method == "em-a":
            inside = old > 0.0
            new[inside] = _argmax_q(looks, some.take(inside), case, old[inside])
        none = new <= 0.0
        new[none] = 0.0
        worse = np.zeros(len(open_), dtype=bool)
        if method != "em-a":
            worse = ~none & (worth(open_, new, old) < worth(open_, old, old))
        moved = np.abs(new - old)
        near = ~worse & (none | (moved < absolute) | (moved < relative * new))
        why[open_[worse]], why[open_[near]] = GUARD, CONVERGED
        s[open_] = np.where(worse, old, new)
        open_ = open_[~(worse | near)]
    return s, steps, why


@compiled
def _follow_median(kind, z, alpha, pulses, firsts, lasts, e, hits, dead, step, most, subtract, always, out):  # type: ignore[no-untyped-def]
    latest, ordered = np.zeros(hits), np.zeros(hits)
    begin = e
    for i in range(len(firsts)):
        e, held = begin, 0
        for k in range(firsts[i], lasts[i]):
            if kind[k] == MISS:
                e -= step
            else:
                n = pulses[k]
                latest[held % hits] = (z[k] - (n if subtract else 0.0)) / (n * alpha[k])
                held += 1
            if held >= hits and (kind[k] != MISS or always):
                for j in range(hits):  # a few numbers: sorted by insertion
                    place = j
                    while place > 0 and ordered[place - 1] > latest[j]:
                        ordered[place] = ordered[place - 1]
                        place -= 1
                    ordered[place] = latest[j]
                median = 0.5 * (ordered[(hits - 1) // 2] + ordered[hits // 2])
                m = 10.0 * math.log10(median) if median > 0.0 else -200.0
                if m > e + dead:
                    e += step * min(most, math.ceil((m - dead - e) / step))
                elif m < e - dead:
                    e -= step * min(most, math.ceil((e - dead - m) / step))
            out[k] = 10.0 ** (0.1 * e)


def median_rule(
    looks: Looks,
    windows: Windows | None = None,
    *,
    start: float = 1.5,
    hits: int = 5,
    dead_db: float = 1.0,
    step_db: float = 0.5,
    subtract_noise: bool = True,
    every_scan: bool = False,
    until_near: bool = False,
) -> Floats:
    """MED: the estimate after each look, moved 0.5 dB at a time by misses and by the median of the last detections.

    The paper leaves open whether noise is subtracted, whether the median is tested on missed scans too, and whether the
    estimate moves one step a look or steps until it is within 1 dB of the median (`until_near`): the defaults are the
    primary reading, and docs/explanation/rcs.md shows that only `until_near` gives the errors the paper describes. It
    begins anew with each of `windows` (side by side; all looks by default).
    """
    out = np.empty(len(looks))
    cut = windows or Windows.whole(looks)
    _follow_median(
        looks.kind, looks.z, looks.alpha, looks.pulses, cut.first, cut.last, 10.0 * math.log10(start), hits, dead_db,
        step_db, _MOST if until_near else 1, subtract_noise, every_scan, out,
    )  # fmt: skip
    return out


def expected_log(s: float, old: float, threshold: float, shape: float = 2.0) -> float:
    """g1 of the paper's Q: E[ln(y + 1 + 2/S) | y missed, S'] at S = `s`, S' = `old` (eq. 12 as corrected)."""
    half = 0.5 * threshold
    y = half * (_NODES + 1.0)
    weight = _WEIGHTS * np.exp([density(v, old, shape) for v in y])
    return float(weight @ np.log(y + 1.0 + 2.0 / s) / weight.sum())


__all__ = ["METHODS", "REASONS", "expected_log", "iterate", "median_rule"]
