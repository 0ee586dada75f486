"""Exact maximum likelihood (the method ML-A) and what follows from the likelihood, over a batch of windows.

Everything is a function of u = ln s. The maximum is found by Newton steps of at most one neper inside a bracket of
the score's sign; where the likelihood may have several maxima (the alphas of a window more than 20 dB apart, false
alarms mixed in, a score that is not positive at s = 0) every one is found from a grid and the highest taken.
"""

# mypy: disable-error-code="call-arg"
# (kernels take what `arguments` packs: their number is numba\'s to check)
from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtri

from rangeeval.compiled import compiled
from rangeeval.stats.swerling.looks import Case, Looks, Windows
from rangeeval.stats.swerling.terms import (
    DETECTION,
    HIT,
    MISS,
    density_slope_one,
    density_slope_three,
    look_terms,
    miss_one,
    miss_three,
    score_at_zero,
)

Floats = NDArray[np.float64]

_SPREAD = 100.0  # alphas 20 dB apart
_GRID = 240


@compiled
def _slopes(kind, z, threshold, alpha, pulses, shape, cells, quick, first, last, s):  # type: ignore[no-untyped-def]
    """First and second derivative of lnL in ln s over one window.

    `quick` 1 or 3: single pulses of that Swerling case without hits or saturation, in closed form; equal looks are
    computed once.
    """
    d1, d2 = 0.0, 0.0
    if quick == 0:
        for k in range(first, last):
            _, a, b = look_terms(kind[k], z[k], threshold[k], pulses[k], alpha[k] * s, shape[k], cells)
            d1 += a
            d2 += b
        return d1, d2
    seen_a, seen_t, m1, m2 = -1.0, -1.0, 0.0, 0.0
    if quick == 1:
        for k in range(first, last):
            if kind[k] == MISS:
                if alpha[k] != seen_a or threshold[k] != seen_t:
                    seen_a, seen_t = alpha[k], threshold[k]
                    _, m1, m2 = miss_one(seen_t, seen_a * s)
                d1 += m1
                d2 += m2
            else:
                a, b = density_slope_one(z[k], alpha[k] * s)
                d1 += a
                d2 += b
        return d1, d2
    for k in range(first, last):
        if kind[k] == MISS:
            if alpha[k] != seen_a or threshold[k] != seen_t:
                seen_a, seen_t = alpha[k], threshold[k]
                _, m1, m2 = miss_three(seen_t, seen_a * s)
            d1 += m1
            d2 += m2
        else:
            a, b = density_slope_three(z[k], alpha[k] * s)
            d1 += a
            d2 += b
    return d1, d2


@compiled
def _value(kind, z, threshold, alpha, pulses, shape, cells, first, last, s):  # type: ignore[no-untyped-def]
    """lnL of one window and its first two derivatives in ln s."""
    value, d1, d2 = 0.0, 0.0, 0.0
    for k in range(first, last):
        v, a, b = look_terms(kind[k], z[k], threshold[k], pulses[k], alpha[k] * s, shape[k], cells)
        value += v
        d1 += a
        d2 += b
    return value, d1, d2


@compiled
def _newton(kind, z, threshold, alpha, pulses, shape, cells, quick, first, last, start, low, high):  # type: ignore[no-untyped-def]
    """The root of the score in ln s between `low` (score above zero) and `high` (below), from `start`."""
    u = start
    for _ in range(200):
        d1, d2 = _slopes(kind, z, threshold, alpha, pulses, shape, cells, quick, first, last, math.exp(u))
        if d1 > 0.0:
            low = u
        else:
            high = u
        step = 1.0 if d1 > 0.0 else -1.0
        if d2 < 0.0 and abs(d1) < -d2:
            step = -d1 / d2
        new = u + step
        if not low < new < high:
            new = 0.5 * (low + high) if low > -700.0 and high < 700.0 else u + step
        if abs(new - u) < 1e-6 and abs(step) < 1e-6:
            return u + step
        if high - low < 1e-13:
            return new
        u = new
    return u


@compiled
def _from_grid(kind, z, threshold, alpha, pulses, shape, cells, quick, first, last, at_zero):  # type: ignore[no-untyped-def]
    """The highest of all maxima that a grid of the score shows; -inf when it is at s = 0."""
    most, least = 0.0, math.inf
    top = 0.0
    for k in range(first, last):
        most = max(most, alpha[k])
        least = min(least, alpha[k])
        top = max(top, max(z[k], threshold[k]) / (alpha[k] * pulses[k]))
    low = math.log(1e-6 / most)
    step = (math.log(8.0 * top) - low) / (_GRID - 1)
    best, best_value = -math.inf, -math.inf
    if at_zero <= 0.0:
        best_value, _, _ = _value(kind, z, threshold, alpha, pulses, shape, cells, first, last, 1e-9 / most)
    u, before = low, 0.0
    i = 0
    while i < 4 * _GRID:
        slope, _ = _slopes(kind, z, threshold, alpha, pulses, shape, cells, quick, first, last, math.exp(u))
        if i > 0 and before > 0.0 >= slope:
            root = _newton(
                kind, z, threshold, alpha, pulses, shape, cells, quick, first, last, u - 0.5 * step, u - step, u
            )
            value, _, _ = _value(kind, z, threshold, alpha, pulses, shape, cells, first, last, math.exp(root))
            if value > best_value:
                best, best_value = root, value
        if i >= _GRID and slope <= 0.0:
            break
        before = slope
        u += step
        i += 1
    return best


@compiled
def _maximise(kind, z, threshold, alpha, pulses, shape, cells, quick, firsts, lasts, near, out):  # type: ignore[no-untyped-def]
    """ln s at the maximum of each window: -inf with no detection, +inf with hits and nothing that bounds them.

    With `near` above zero: the maximum next to it.
    """
    for i in range(len(firsts)):
        first, last = firsts[i], lasts[i]
        found, bounded, at_zero, start = 0, 0, 0.0, 0.0
        least, most = math.inf, 0.0
        seen_a, seen_t, m0 = -1.0, -1.0, 0.0
        for k in range(first, last):
            a = alpha[k]
            least, most = min(least, a), max(most, a)
            if kind[k] == DETECTION:
                found += 1
                bounded += 1
                start += max(z[k] - pulses[k], 0.0) / (a * pulses[k])
                at_zero += a * (z[k] - pulses[k])
            elif kind[k] == MISS:
                bounded += 1
                if a != seen_a or threshold[k] != seen_t:
                    seen_a, seen_t = a, threshold[k]
                    m0 = score_at_zero(MISS, 0.0, seen_t, a, pulses[k])
                at_zero += m0
            else:
                found += 1
                start += (threshold[k] if kind[k] == HIT else z[k]) / (a * pulses[k])
                at_zero += score_at_zero(kind[k], z[k], threshold[k], a, pulses[k])
        if found == 0:
            out[i] = -math.inf
        elif bounded == 0:
            out[i] = math.inf
        elif at_zero <= 0.0 or (near[i] <= 0.0 and (most > _SPREAD * least or cells > 1.0)):
            out[i] = _from_grid(kind, z, threshold, alpha, pulses, shape, cells, quick, first, last, at_zero)
        else:
            start = math.log(near[i] if near[i] > 0.0 else max(start / (last - first), 1e-3 / most))
            out[i] = _newton(
                kind, z, threshold, alpha, pulses, shape, cells, quick, first, last, start, -math.inf, math.inf
            )


@compiled
def _values(kind, z, threshold, alpha, pulses, shape, cells, firsts, lasts, s, value, slope, bend):  # type: ignore[no-untyped-def]
    for i in range(len(firsts)):
        value[i], slope[i], bend[i] = _value(kind, z, threshold, alpha, pulses, shape, cells, firsts[i], lasts[i], s[i])


@compiled
def _crossings(kind, z, threshold, alpha, pulses, shape, cells, firsts, lasts, start, target, reach, side, out):  # type: ignore[no-untyped-def]
    """Where lnL falls to `target` on one side of `start` (all in ln s); -inf below where it never does."""
    for i in range(len(firsts)):
        first, last = firsts[i], lasts[i]
        most = 0.0
        for k in range(first, last):
            most = max(most, alpha[k])
        floor = math.log(1e-9 / most)
        inner, outer = start[i], side * math.inf
        u = start[i] + side * reach[i]
        for _ in range(200):
            if side < 0.0 and u < floor:
                value, _, _ = _value(kind, z, threshold, alpha, pulses, shape, cells, first, last, math.exp(floor))
                if value > target[i]:
                    u = -math.inf
                    break
                u = floor
                if outer > floor:
                    u = 0.5 * (outer + inner)
            value, d1, _ = _value(kind, z, threshold, alpha, pulses, shape, cells, first, last, math.exp(u))
            above = value - target[i]
            if above > 0.0:
                inner = u
            else:
                outer = u
            step = -above / d1 if d1 * side < 0.0 else side
            step = max(-1.0, min(1.0, step))
            new = u + step
            if not min(inner, outer) < new < max(inner, outer):
                new = 0.5 * (inner + outer) if math.isfinite(outer) else u + side
            if abs(new - u) < 1e-11 or abs(outer - inner) < 1e-12:
                u = new
                break
            u = new
        out[i] = u


@dataclass(frozen=True)
class Fit:
    """The maximum of each window's likelihood.

    `s` (m^2) is 0 where nothing was detected and inf where nothing bounds it; `value`: lnL there, constants kept;
    `bend`: the second derivative of lnL in ln s, so that -1/bend is the variance of ln s.
    """

    s: Floats
    value: Floats
    bend: Floats

    @property
    def aic(self) -> Floats:
        """Akaike's criterion of this one-parameter model."""
        return np.asarray(2.0 - 2.0 * self.value)


def arguments(looks: Looks, case: Case) -> tuple[object, ...]:
    """What every kernel takes first."""
    return (
        looks.kind,
        looks.z,
        looks.threshold,
        looks.alpha,
        looks.pulses,
        case.shapes(looks.pulses),
        looks.cells,
    )


def quick_case(looks: Looks, case: Case) -> int:
    """1 or 3 where that case has its closed form for these looks, else 0."""
    plain = looks.cells == 1.0 and bool((looks.pulses == 1).all()) and bool((looks.kind <= DETECTION).all())
    return {1.0: 1, 2.0: 3}.get(case.shape, 0) if plain else 0


def log_likelihood(looks: Looks, windows: Windows, case: Case, s: Floats) -> tuple[Floats, Floats, Floats]:
    """lnL of each window at mean RCS `s` above zero, and its two derivatives in ln s."""
    value, slope, bend = (np.empty(len(windows)) for _ in range(3))
    _values(*arguments(looks, case), windows.first, windows.last, np.asarray(s, np.float64), value, slope, bend)
    return value, slope, bend


def maximum_likelihood(looks: Looks, windows: Windows, case: Case, near: ArrayLike = 0.0) -> Floats:
    """The exact maximum-likelihood mean RCS of each window (ML-A): 0 with no detection, inf with unbounded hits.

    Where `near` is above zero, the maximum next to it instead of the highest of all.
    """
    u = np.empty(len(windows))
    start = np.ascontiguousarray(np.broadcast_to(np.asarray(near, np.float64), len(windows)))
    _maximise(*arguments(looks, case), quick_case(looks, case), windows.first, windows.last, start, u)
    with np.errstate(over="ignore"):
        return np.exp(u)


def fit(looks: Looks, windows: Windows, case: Case) -> Fit:
    """The maximum with its likelihood and curvature."""
    s = maximum_likelihood(looks, windows, case)
    inside = (s > 0) & np.isfinite(s)
    alpha = _largest_alpha(looks, windows)
    at = np.where(inside, s, np.where(s > 0, 1e12, 1e-12) / alpha)  # lnL at 0 and at infinity, to rounding
    value, _slope, bend = log_likelihood(looks, windows, case, at)
    return Fit(s, value, np.where(inside, bend, np.nan))


def profile_interval(
    looks: Looks, windows: Windows, case: Case, found: Fit, confidence: float = 0.95
) -> tuple[Floats, Floats]:
    """Ends of the profile-likelihood interval of each window: where 2 (max lnL - lnL) reaches the chi-square quantile.

    With no detection: 0 and the exact upper limit s with P(all missed | s) = 1 - confidence. With nothing but hits: the
    exact lower limit, and inf. With the maximum at 0: 0 and the likelihood's cut.

    References
    ----------
    docs/explanation/rcs.md: of 20,000 windows each, 94.5 to 95.3 % hold the truth at a nominal 95 %.
    """
    cut = 0.5 * float(chdtri(1, 1.0 - confidence))
    low, high = np.zeros(len(windows)), np.full(len(windows), np.inf)
    alpha = _largest_alpha(looks, windows)
    inside = (found.s > 0) & np.isfinite(found.s)
    none = detections(looks, windows) == 0
    start = np.log(np.where(inside, found.s, np.where(np.isfinite(found.s), 1e-3, 1e9) / alpha))
    with np.errstate(invalid="ignore"):
        reach = np.where(inside, np.sqrt(2 * cut / np.maximum(-found.bend, 1e-6)), 1.0)
    reach = np.minimum(reach, 3.0)
    exact = math.log(1.0 - confidence)
    for side, end, wanted in ((-1.0, low, found.s > 0), (1.0, high, np.isfinite(found.s))):
        if not wanted.any():
            continue
        target = np.where(none | np.isinf(found.s), exact, found.value - cut)[wanted]
        out = np.empty(int(wanted.sum()))
        _crossings(
            *arguments(looks, case), windows.first[wanted], windows.last[wanted], start[wanted], target,
            reach[wanted], side, out,
        )  # fmt: skip
        end[wanted] = np.exp(out)
    return low, high


def detections(looks: Looks, windows: Windows) -> NDArray[np.int64]:
    """How many looks of each window saw the target."""
    total = np.concatenate([[0], np.cumsum(looks.kind != MISS)])
    return np.asarray(total[windows.last] - total[windows.first], dtype=np.int64)


def _largest_alpha(looks: Looks, windows: Windows) -> Floats:
    return np.array([looks.alpha[a:b].max() for a, b in zip(windows.first, windows.last, strict=True)])
