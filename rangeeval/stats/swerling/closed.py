"""Single pulses of Swerling 1 and 3 in closed form: one look, and whole windows of detections and misses at once.

Nearly every log is of this sort, so it has kernels of its own, ten times as quick as the series of `terms` that all
other looks go through; the two agree to rounding.

With b = 1 + S/K and x = T/b everything about a miss follows from G = e^x - 1 - x: P(miss) e^x is G + x for Swerling 1
and G + x/b for Swerling 3, and the conditional mean of z needs the next term of the series only. G is summed where
the exponential would cancel, so that no digits are lost at high SNR.

References
----------
Jung and Hong (2017), eqs 1-4 and 14-15; docs/explanation/rcs.md.
"""

from __future__ import annotations

import math

import numpy as np

from rangeeval.compiled import compiled_ieee

MISS, DETECTION, HIT, SATURATED = 0, 1, 2, 3
CONVERGED, GUARD, EMPTY, SPENT = 0, 1, 2, 3

_SMALL, _LARGE = 1e-100, 1e100
_FAR = 450.0  # beyond it a miss is certain to 195 digits, and e^x would overflow in products
_SPREAD = 100.0  # alphas 20 dB apart: within it the likelihood has one maximum


@compiled_ieee
def _rest(x):  # type: ignore[no-untyped-def]
    """e^x - 1 - x - x^2/2 without cancellation."""
    if x > 0.3:
        return math.exp(x) - 1.0 - x - 0.5 * x * x
    y = x * x
    odd = (((y * (1 / 1307674368000) + 1 / 6227020800) * y + 1 / 39916800) * y + 1 / 362880) * y + 1 / 5040
    even = (((y * (1 / 87178291200) + 1 / 479001600) * y + 1 / 3628800) * y + 1 / 40320) * y + 1 / 720
    return x * y * ((odd * y + 1 / 120) * y + 1 / 6 + x * (even * y + 1 / 24))


@compiled_ieee
def miss(t, s, shape):  # type: ignore[no-untyped-def]
    """ln P(miss) at mean SNR `s`."""
    v = 1.0 / (1.0 + s / shape)
    x = min(t * v, _FAR)
    return math.log(_rest(x) + 0.5 * x * x + (x if shape == 1.0 else x * v)) - x


@compiled_ieee
def miss_one(t, s):  # type: ignore[no-untyped-def]
    """Swerling 1: three derivatives of ln P(miss) in ln s."""
    v = 1.0 / (1.0 + s)
    x = min(t * v, _FAR)
    r, h = s * v, x / (_rest(x) + 0.5 * x * x + x)
    g = 1.0 - x - h
    w = 1.0 + g
    d1, bent = -r * h, r * r * h
    d2 = d1 + bent * w
    return d1, d2, d2 + bent * (2.0 * v * w + r * (x + g * (h - w)))


@compiled_ieee
def miss_three(t, s):  # type: ignore[no-untyped-def]
    """Swerling 3: three derivatives of ln P(miss) in ln s."""
    v = 1.0 / (1.0 + 0.5 * s)
    x = min(t * v, _FAR)
    grown = _rest(x) + 0.5 * x * x + x * v
    r = 0.5 * s * v
    rx, rv, turn = r * x, r * v, 1.0 - 2.0 * r
    factor = rx + 2.0 * v
    inverse = 1.0 / (grown * factor)
    d1 = -rx * factor * factor * inverse
    bent = (rx * turn - 2.0 * rv) * grown * inverse  # the derivative of ln factor
    growth = turn + bent + rx - d1
    d2 = d1 * growth
    sway = (turn * (rx * turn - 2.0 * rv) - 2.0 * rx * rv) * grown * inverse - bent * bent
    return d1, d2, d2 * growth + d1 * (sway - 2.0 * rv + rx * turn - d2)


@compiled_ieee
def density(z, s, shape):  # type: ignore[no-untyped-def]
    """ln f(z) at mean SNR `s`."""
    v = 1.0 / (shape + s)
    if shape == 1.0:
        return math.log(v) - z * v
    return math.log(4.0 * (s * (z + 1.0) + 2.0) * v * v * v) - 2.0 * z * v


@compiled_ieee
def density_one(z, s):  # type: ignore[no-untyped-def]
    """Swerling 1: three derivatives of ln f(z) in ln s."""
    v = 1.0 / (1.0 + s)
    r, y = s * v, z * v
    d1, bent = r * (y - 1.0), r * r * (2.0 * y - 1.0)
    d2 = d1 - bent
    return d1, d2, d2 - 2.0 * bent + 2.0 * r * r * r * (3.0 * y - 1.0)


@compiled_ieee
def density_three(z, s):  # type: ignore[no-untyped-def]
    """Swerling 3: three derivatives of ln f(z) in ln s."""
    v, strong = 1.0 / (2.0 + s), s * (z + 1.0)
    a, b, y = strong / (strong + 2.0), s * v, 2.0 * z * v
    one, two, three = a + b * (y - 3.0), a * a + b * b * (2.0 * y - 3.0), a * a * a + 3.0 * b * b * b * (y - 1.0)
    return one, one - two, one - 3.0 * two + 2.0 * three


@compiled_ieee
def level_closed(t, s, shape):  # type: ignore[no-untyped-def]
    """E[z | z < t] for shape 1 or 2, the paper's g2 (eq. 14) without its cancellation."""
    v = 1.0 / (1.0 + s / shape)
    x = min(t * v, _FAR)
    rest = _rest(x)
    grown = rest + 0.5 * x * x
    if shape == 1.0:
        return grown / (v * (grown + x))
    return (s * rest + grown) / (grown + x * v)


@compiled_ieee
def closed_values(kind, z, threshold, alpha, shape, firsts, lasts, s, value, slope, bend):  # type: ignore[no-untyped-def]
    """lnL of each window and its two derivatives in ln s; equal misses side by side are computed once."""
    for i in range(len(firsts)):
        total, d1, d2 = 0.0, 0.0, 0.0
        seen_a, seen_t, m0, m1, m2 = -1.0, -1.0, 0.0, 0.0, 0.0
        for k in range(firsts[i], lasts[i]):
            a = alpha[k]
            if kind[k] == MISS:
                if a != seen_a or threshold[k] != seen_t:
                    seen_a, seen_t = a, threshold[k]
                    m0 = miss(seen_t, a * s[i], shape)
                    m1, m2, _ = miss_one(seen_t, a * s[i]) if shape == 1.0 else miss_three(seen_t, a * s[i])
                v0, v1, v2 = m0, m1, m2
            else:
                v0 = density(z[k], a * s[i], shape)
                v1, v2, _ = density_one(z[k], a * s[i]) if shape == 1.0 else density_three(z[k], a * s[i])
            total += v0
            d1 += v1
            d2 += v2
        value[i], slope[i], bend[i] = total, d1, d2


@compiled_ieee
def closed_moments(kind, z, threshold, alpha, shape, firsts, lasts, s, out):  # type: ignore[no-untyped-def]
    """Eq. 15 for each window: misses filled in with their conditional mean at `s`, then the estimate by moments."""
    for i in range(len(firsts)):
        total = 0.0
        for k in range(firsts[i], lasts[i]):
            y = level_closed(threshold[k], alpha[k] * s[i], shape) if kind[k] == MISS else z[k]
            total += (y - 1.0) / alpha[k]
        out[i] = total / (lasts[i] - firsts[i])


@compiled_ieee
def _slopes(shape, found, z, a, missed, t, b, s):  # type: ignore[no-untyped-def]
    """Three derivatives of lnL in ln s, detections (z, a) and misses (t, b) apart: no branch inside the loops."""
    d1, d2, d3 = 0.0, 0.0, 0.0
    if shape == 1.0:
        for k in range(found):
            p, q, r = density_one(z[k], a[k] * s)
            d1 += p
            d2 += q
            d3 += r
    else:
        for k in range(found):
            p, q, r = density_three(z[k], a[k] * s)
            d1 += p
            d2 += q
            d3 += r
    seen_b, seen_t, m1, m2, m3 = -1.0, -1.0, 0.0, 0.0, 0.0
    for k in range(missed):
        if b[k] != seen_b or t[k] != seen_t:
            seen_b, seen_t = b[k], t[k]
            if shape == 1.0:
                m1, m2, m3 = miss_one(seen_t, seen_b * s)
            else:
                m1, m2, m3 = miss_three(seen_t, seen_b * s)
        d1 += m1
        d2 += m2
        d3 += m3
    return d1, d2, d3


@compiled_ieee
def _filled(shape, missed, t, b, s):  # type: ignore[no-untyped-def]
    """What misses add to the estimate by moments, each filled in with its conditional mean (eq. 15), and their ln L.

    The latter is the second plus the logarithm of the third.
    """
    added, total, product = 0.0, 0.0, 1.0
    seen_b, seen_t, level, x, grown = -1.0, -1.0, 0.0, 0.0, 1.0
    for k in range(missed):
        if b[k] != seen_b or t[k] != seen_t:
            seen_b, seen_t = b[k], t[k]
            v = 1.0 / (1.0 + seen_b * s / shape)
            x = min(seen_t * v, _FAR)
            rest = _rest(x)
            two = rest + 0.5 * x * x
            if shape == 1.0:
                grown = two + x
                level = (two / (v * grown) - 1.0) / seen_b
            else:
                grown = two + x * v
                level = ((seen_b * s * rest + two) / grown - 1.0) / seen_b
        added += level
        total -= x
        product *= grown
        if not _SMALL < product < _LARGE:
            total += math.log(product)
            product = 1.0
    return added, total, product


@compiled_ieee
def _climb(shape, found, z, a, missed, t, b, s):  # type: ignore[no-untyped-def]
    """The maximum of lnL from `s`: Halley's steps in ln s, inside a bracket of the score's sign."""
    u, low, high = 0.0, -math.inf, math.inf
    for _ in range(200):
        d1, d2, d3 = _slopes(shape, found, z, a, missed, t, b, s)
        if d1 > 0.0:
            low = u
        else:
            high = u
        step = 1.0 if d1 > 0.0 else -1.0
        if d2 < 0.0 and abs(d1) < -d2:
            step = -2.0 * d1 * d2 / (2.0 * d2 * d2 - d1 * d3) if abs(d1 * d3) < d2 * d2 else -d1 / d2
            if abs(step) < 4e-5:  # what is left is of its third power
                return s * math.exp(step)
        new = u + step
        if not low < new < high:
            new = 0.5 * (low + high)
            if high - low < 1e-13:
                return s
        s *= math.exp(new - u)
        u = new
    return s


@compiled_ieee
def closed_maxima(kind, z, threshold, alpha, shape, firsts, lasts, near, out):  # type: ignore[no-untyped-def]
    """ln L's maximum over s for each window: 0 with no detection, NaN where it may be at 0 or one of several.

    With `near` above zero: the maximum next to it.
    """
    most = 0
    for i in range(len(firsts)):
        most = max(most, lasts[i] - firsts[i])
    amplitude, a, limit, b = np.empty(most), np.empty(most), np.empty(most), np.empty(most)
    for i in range(len(firsts)):
        found, missed, moments, sure, least, largest = 0, 0, 0.0, 0.0, math.inf, 0.0
        for k in range(firsts[i], lasts[i]):
            strength, t = alpha[k], threshold[k]
            least, largest = min(least, strength), max(largest, strength)
            if kind[k] == DETECTION:
                amplitude[found], a[found] = z[k], strength
                found += 1
                moments += (z[k] - 1.0) / strength
                sure += strength * (z[k] - 1.0)
            else:
                limit[missed], b[missed] = t, strength
                missed += 1
                sure -= strength / (1.0 + t * (0.5 + t / 6.0))  # at most: T / (e^T - 1) is the slope at s = 0
        if found == 0:
            out[i] = 0.0
        elif sure <= 0.0 or (largest > _SPREAD * least and near[i] <= 0.0):
            out[i] = math.nan
        else:
            s = near[i]
            if s <= 0.0:
                s = max(moments / (found + missed), 1e-3 / largest)
                for _ in range(2 if least == largest else 1):
                    s = max((moments + _filled(shape, missed, limit, b, s)[0]) / (found + missed), 1e-3 / largest)
            out[i] = _climb(shape, found, amplitude, a, missed, limit, b, s)


@compiled_ieee
def _seen(shape, found, z, a, s):  # type: ignore[no-untyped-def]
    """ln L of detections, as in `_filled`: the logarithm of a product, taken when it grows out of bounds."""
    total, product = 0.0, 1.0
    for k in range(found):
        strength = a[k] * s
        v = 1.0 / (shape + strength)
        if shape == 1.0:
            total -= z[k] * v
            product *= v
        else:
            total -= 2.0 * z[k] * v
            product *= 4.0 * (strength * (z[k] + 1.0) + 2.0) * v * v * v
        if not _SMALL < product < _LARGE:
            total += math.log(product)
            product = 1.0
    return total, product


@compiled_ieee
def closed_ml_b(kind, z, threshold, alpha, shape, firsts, lasts, start, absolute, relative, spent, out, steps, why):  # type: ignore[no-untyped-def]
    """ML-B: eq. 15 until lnL would fall or the step is small."""
    most = 0
    for i in range(len(firsts)):
        most = max(most, lasts[i] - firsts[i])
    amplitude, a, limit, b = np.empty(most), np.empty(most), np.empty(most), np.empty(most)
    for i in range(len(firsts)):
        found, missed, moments = 0, 0, 0.0
        for k in range(firsts[i], lasts[i]):
            if kind[k] == DETECTION:
                amplitude[found], a[found] = z[k], alpha[k]
                found += 1
                moments += (z[k] - 1.0) / alpha[k]
            else:
                limit[missed], b[missed] = threshold[k], alpha[k]
                missed += 1
        steps[i], why[i], out[i] = 0, EMPTY, 0.0
        if found == 0:
            continue
        looks = found + missed
        s = start[i] if start[i] > 0.0 else max(0.0, moments / looks)
        why[i] = SPENT
        added, total, product = _filled(shape, missed, limit, b, s)
        more, factor = _seen(shape, found, amplitude, a, s)
        known = total + more + math.log(product * factor)
        while steps[i] < spent:
            steps[i] += 1
            new = (moments + added) / looks
            if new <= 0.0:
                s, why[i] = 0.0, CONVERGED
                break
            added, total, product = _filled(shape, missed, limit, b, new)
            more, factor = _seen(shape, found, amplitude, a, new)
            value = total + more + math.log(product * factor)
            if value < known:
                why[i] = GUARD
                break
            known = value
            moved = abs(new - s)
            s = new
            if moved < absolute or moved < relative * s:
                why[i] = CONVERGED
                break
        out[i] = s
