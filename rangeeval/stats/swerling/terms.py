"""One look: its log-likelihood and what it says about the mean RCS, for every Swerling case and any number of pulses.

The statistic z is the power over the mean noise power of one pulse, summed over n pulses: signal *plus* noise. Seen
through a latent count j, the model has terms that are all positive, so nothing cancels: j is negative binomial with
shape K and mean n S (Poisson for a steady target), and z given j is gamma with shape n + j and scale 1. Derivatives
are with respect to u = ln s; for them only the mean and the variance of j given the look are needed (Louis 1982).

Single pulses of Swerling 1 (K = 1) and Swerling 3 (K = 2) have the closed forms of `closed`.

References
----------
Swerling (1960), IRE Trans. IT-6, for the cases; Jung and Hong (2017), eqs 1-3, for Swerling 3 of one pulse; Louis
(1982), J. R. Stat. Soc. B 44, for the second derivative. docs/explanation/rcs.md has the derivation.
"""

from __future__ import annotations

import math

from rangeeval.compiled import compiled
from rangeeval.stats.swerling.closed import (
    DETECTION,
    MISS,
    SATURATED,
    density,
    density_one,
    density_three,
    level_closed,
    miss,
    miss_one,
    miss_three,
)

_BIG = 1e200
_LN_BIG = math.log(_BIG)
_HALF_BIG = 1e100
_LN_HALF_BIG = math.log(_HALF_BIG)
_FROM_PEAK = 400.0  # a mode of the count beyond this: the sum starts there, not at zero


@compiled
def _ln_none(mean, shape):  # type: ignore[no-untyped-def]
    """Log probability that the count is zero."""
    return -mean if math.isinf(shape) else -shape * math.log1p(mean / shape)


@compiled
def _to_u(mean, shape, first, spread):  # type: ignore[no-untyped-def]
    """First and second derivative in ln s from the mean and the variance of the count given the look."""
    if math.isinf(shape):
        return first - mean, spread - mean
    b = 1.0 + mean / shape
    return (first - mean) / b, (spread - mean * (1.0 + first / shape)) / (b * b)


@compiled
def _ratio(mean, shape):  # type: ignore[no-untyped-def]
    """The count's probability of j + 1 over that of j is (least + slope j) / (j + 1)."""
    if math.isinf(shape):
        return mean, 0.0
    slope = (mean / shape) / (1.0 + mean / shape)
    return shape * slope, slope


@compiled
def _peak(least, slope, n):  # type: ignore[no-untyped-def]
    """Where the terms of a sum stop growing: the root of (least + slope j) = (j + 1)(n + j), 0 when there is none."""
    middle = slope - (n + 1.0)
    root = middle * middle + 4.0 * (least - n)
    return max(0.0, 0.5 * (middle + math.sqrt(root))) if root > 0.0 else 0.0


@compiled
def density_terms(z, n, mean, shape):  # type: ignore[no-untyped-def]
    """ln f(z) and its derivatives in ln s; `mean` = n S."""
    least, slope = _ratio(mean, shape)
    least, slope = least * z, slope * z
    peak = _peak(least, slope, n)
    start = math.floor(peak) if peak > _FROM_PEAK else 0.0
    scale = _ln_none(mean, shape) + (n + start - 1.0) * math.log(z) - z - math.lgamma(n + start)
    if start > 0.0:
        scale -= math.lgamma(start + 1.0)
        if math.isinf(shape):
            scale += start * math.log(mean)
        else:
            scale += math.lgamma(shape + start) - math.lgamma(shape) + start * math.log(slope / z)
    total, first, second = 1.0, 0.0, 0.0  # moments of j - start
    term, j = 1.0, start
    while True:
        term *= (least + slope * j) / ((j + 1.0) * (n + j))
        j += 1.0
        d = j - start
        total += term
        first += term * d
        second += term * d * d
        if term > _BIG:
            term, total, first, second = term / _BIG, total / _BIG, first / _BIG, second / _BIG
            scale += _LN_BIG
        if j > peak and term * (1.0 + d * d) < 1e-18 * (total + second):
            break
    term, j = 1.0, start
    while j > 0.0:
        j -= 1.0
        term *= (j + 1.0) * (n + j) / (least + slope * j)
        d = j - start
        total += term
        first += term * d
        second += term * d * d
        if term < 1e-20 * total:
            break
    offset = first / total
    d1, d2 = _to_u(mean, shape, start + offset, second / total - offset * offset)
    return scale + math.log(total), d1, d2


@compiled
def below_terms(t, n, mean, shape):  # type: ignore[no-untyped-def]
    """ln P(z < t), its derivatives in ln s, and E[z | z < t]."""
    scale = _ln_none(mean, shape) + n * math.log(t) - t - math.lgamma(n + 1.0)
    least, slope = _ratio(mean, shape)
    p, c0, c1, c2 = 1.0, 1.0, 0.0, 0.0  # probability of j; sums over j <= m of p, j p, j^2 p
    g = 1.0
    total, first, second, level = 0.0, 0.0, 0.0, 0.0
    m = 0.0
    peak = max(t, _peak(least * t, slope * t, n))
    while True:
        total += g * c0
        first += g * c1
        second += g * c2
        g *= t / (n + m + 1.0)
        level += g * (n * c0 + c1)
        if m > peak and g * (c0 + c2) <= 1e-18 * (total + second):
            break
        p *= (least + slope * m) / (m + 1.0)
        m += 1.0
        c0 += p
        c1 += p * m
        c2 += p * m * m
        if c2 + c0 > _BIG:
            p, c0, c1, c2 = p / _BIG, c0 / _BIG, c1 / _BIG, c2 / _BIG
            total, first, second, level = total / _BIG, first / _BIG, second / _BIG, level / _BIG
            scale += _LN_BIG
        if g > _BIG:
            g, total, first, second, level = g / _BIG, total / _BIG, first / _BIG, second / _BIG, level / _BIG
            scale += _LN_BIG
        elif g < 1.0 / _BIG and total < 1e50:  # all that matters is still to come
            g, total, first, second, level = g * _BIG, total * _BIG, first * _BIG, second * _BIG, level * _BIG
            scale -= _LN_BIG
    count = first / total
    d1, d2 = _to_u(mean, shape, count, second / total - count * count)
    return scale + math.log(total), d1, d2, level / total


@compiled
def _beyond(a, shape, x):  # type: ignore[no-untyped-def]
    """The probability of `a` counts or more over that of `a`: the incomplete beta function's fraction, by Lentz."""
    c, d = 1.0, 1.0 / (1.0 - (a + shape) * x / (a + 1.0))
    h, m = d, 1.0
    while True:
        even = m * (shape - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m))
        d, c = 1.0 / (1.0 + even * d), 1.0 + even / c
        h *= d * c
        odd = -(a + m) * (a + shape + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0))
        d, c = 1.0 / (1.0 + odd * d), 1.0 + odd / c
        h *= d * c
        m += 1.0
        if abs(d * c - 1.0) < 1e-15 or m > 5000.0:
            return h


@compiled
def above(t, n, mean, shape):  # type: ignore[no-untyped-def]
    """P(z >= t), never as a difference from one."""
    g, shift = 1.0, -t  # Poisson probability of i counts of mean t is g exp(shift)
    q = 0.0
    for i in range(n):
        q += g
        g *= t / (i + 1.0)
    least, slope = _ratio(mean, shape)
    scale = _ln_none(mean, shape)
    p, counted, total, j = 1.0, 1.0, q, 0.0
    most = t + 14.0 * math.sqrt(t) + 90.0
    while True:
        if j > most:
            if mean > 0.5 * j:
                break
            if not math.isinf(shape):
                rest = p * (least + slope * j) / (j + 1.0) * _beyond(j + 1.0, shape, slope)
                return (total * math.exp(shift) + rest) * math.exp(scale)
            if p <= 1e-18 * total * math.exp(shift):
                return total * math.exp(scale + shift)
        p *= (least + slope * j) / (j + 1.0)
        j += 1.0
        q += g
        g *= t / (n + j)
        counted += p
        total += p * q
        if counted > _HALF_BIG:
            p, counted, total = p / _HALF_BIG, counted / _HALF_BIG, total / _HALF_BIG
            scale += _LN_HALF_BIG
        if q > _HALF_BIG:
            g, q, total = g / _HALF_BIG, q / _HALF_BIG, total / _HALF_BIG
            shift += _LN_HALF_BIG
    return min(1.0, total * math.exp(scale + shift) + max(0.0, 1.0 - counted * math.exp(scale)))


@compiled
def level_below(t, n, s, shape):  # type: ignore[no-untyped-def]
    """E[z | z < t]; `s`: mean SNR per pulse."""
    if n == 1 and (shape == 1.0 or shape == 2.0):
        return level_closed(t, s, shape)
    return below_terms(t, n, n * s, shape)[3]


@compiled
def _below(t, n, s, shape):  # type: ignore[no-untyped-def]
    if n == 1 and shape == 1.0:
        d1, d2, _ = miss_one(t, s)
        return miss(t, s, shape), d1, d2
    if n == 1 and shape == 2.0:
        d1, d2, _ = miss_three(t, s)
        return miss(t, s, shape), d1, d2
    value, d1, d2, _ = below_terms(t, n, n * s, shape)
    return value, d1, d2


@compiled
def _density(z, n, s, shape):  # type: ignore[no-untyped-def]
    if n == 1 and shape == 1.0:
        d1, d2, _ = density_one(z, s)
        return density(z, s, shape), d1, d2
    if n == 1 and shape == 2.0:
        d1, d2, _ = density_three(z, s)
        return density(z, s, shape), d1, d2
    return density_terms(z, n, n * s, shape)


@compiled
def detection_probability_of(t, n, s, shape):  # type: ignore[no-untyped-def]
    """P(z >= t) at mean SNR `s` per pulse."""
    if n == 1 and shape == 1.0:
        return math.exp(-t / (1.0 + s))
    if n == 1 and shape == 2.0:
        b = 1.0 + 0.5 * s
        x = t / b
        return math.exp(-x) * (1.0 + 0.5 * s / b * x)
    return above(t, n, n * s, shape)


@compiled
def _noise_below(t, n):  # type: ignore[no-untyped-def]
    """ln P(z < t) and ln f(z = t) of noise alone."""
    ln_density = (n - 1.0) * math.log(t) - t - math.lgamma(n)
    if n == 1:
        return math.log(-math.expm1(-t)), ln_density
    value, _d1, _d2, _level = below_terms(t, n, 0.0, math.inf)
    return value, ln_density


@compiled
def look_terms(kind, z, t, n, s, shape, cells):  # type: ignore[no-untyped-def]
    """Log-likelihood of one look and its two derivatives in ln s.

    `kind`: MISS, DETECTION (amplitude `z`), HIT (amplitude not recorded), SATURATED (at least `z`). `s`: mean SNR per
    pulse. `cells`: the amplitude is the strongest of that many cells, all but one holding noise alone (1: its own).
    """
    others = cells - 1.0
    if kind == MISS:
        value, d1, d2 = _below(t, n, s, shape)
        return (value + others * _noise_below(t, n)[0] if others > 0.0 else value), d1, d2
    if kind == DETECTION:
        value, d1, d2 = _density(z, n, s, shape)
        if others == 0.0:
            return value, d1, d2
        ln_below, ln_noise = _noise_below(z, n)
        under, m1, m2 = _below(z, n, s, shape)
        value += others * ln_below
        strange = math.log(others) + under + ln_noise + (others - 1.0) * ln_below
        top = max(value, strange)
        both = top + math.log(math.exp(value - top) + math.exp(strange - top))
        w = math.exp(value - both)
        slope = w * d1 + (1.0 - w) * m1
        return both, slope, w * (d2 + d1 * d1) + (1.0 - w) * (m2 + m1 * m1) - slope * slope
    limit = z if kind == SATURATED else t
    ln_miss, m1, m2 = _below(limit, n, s, shape)
    seen = detection_probability_of(limit, n, s, shape)
    if others > 0.0:
        kept = others * _noise_below(limit, n)[0]
        seen -= math.expm1(kept) * math.exp(ln_miss)
        ln_miss += kept
    odds = math.exp(ln_miss) / seen
    d1 = -odds * m1
    return math.log(seen), d1, -odds * (m2 + m1 * m1) - d1 * d1


@compiled
def series_values(  # type: ignore[no-untyped-def]
    kind, z, threshold, alpha, pulses, shape, cells, firsts, lasts, s, value, slope, bend
):
    """lnL of each window and its two derivatives in ln s, whatever its looks are."""
    for i in range(len(firsts)):
        total, d1, d2 = 0.0, 0.0, 0.0
        for k in range(firsts[i], lasts[i]):
            v0, v1, v2 = look_terms(kind[k], z[k], threshold[k], pulses[k], alpha[k] * s[i], shape[k], cells)
            total += v0
            d1 += v1
            d2 += v2
        value[i], slope[i], bend[i] = total, d1, d2
