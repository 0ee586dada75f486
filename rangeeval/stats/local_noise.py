"""The noise of a smooth signal from its own scatter: each sample against a parabola through its neighbours."""

from __future__ import annotations

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from rangeeval.stats.intervals import sigma_interval
from rangeeval.stats.mean_square import Interval

Floats = NDArray[np.float64]

WINDOW = 7
EFFICIENCY = 0.37  # of the median absolute deviation against the standard deviation, for normal samples
MEMORY = 1.5  # how many times wider than for white samples: neighbours share most of their window (simulated)


def leave_one_out(time: ArrayLike, values: ArrayLike, window: int = WINDOW, max_gap: float = math.inf) -> Floats:
    """Each sample (n) less the parabola through its neighbours, scaled so that its sigma is the noise's; NaN at ends.

    Of `window` (odd) consecutive samples the middle one is left out, a parabola is fitted to the others by least
    squares and the difference divided by sqrt(1 + leverage). Steady acceleration leaves no trace, noise all of it.
    A window with a missing value or a gap longer than `max_gap` gives NaN.
    """
    t, x = np.asarray(time, dtype=np.float64), np.asarray(values, dtype=np.float64)
    found = np.full(len(x), np.nan)
    if len(x) < window:
        return found
    half = window // 2
    times, samples = sliding_window_view(t, window), sliding_window_view(x, window)
    span = times[:, -1] - times[:, 0]
    good = np.isfinite(samples).all(axis=1) & (span > 0) & (np.diff(times, axis=1) <= max_gap).all(axis=1)
    good &= (np.diff(times, axis=1) > 0).all(axis=1)
    times, samples, span = times[good], samples[good], span[good]
    others = np.delete(np.arange(window), half)
    u = (times[:, others] - times[:, half : half + 1]) / span[:, None]
    a = np.stack([np.ones_like(u), u, u**2], axis=-1)
    inverse = np.linalg.inv(a.transpose(0, 2, 1) @ a)
    y = samples[:, others] - samples[:, half : half + 1]
    # The parabola at the middle is its constant term; the leverage there is the first element of the inverse.
    constant = np.einsum("ni,nji,nj->n", inverse[:, 0, :], a, y)
    found[np.flatnonzero(good) + half] = -constant / np.sqrt(1.0 + inverse[:, 0, 0])
    return found


def noise_of(residuals: ArrayLike, confidence: float = 0.95) -> Interval:
    """The noise's sigma, robust against manoeuvres and outliers, from leave-one-out residuals; missing below 8."""
    r = np.asarray(residuals, dtype=np.float64)
    r = r[np.isfinite(r)]
    n = r.size
    s = float(1.482602218505602 * np.median(np.abs(r))) if n else math.nan
    if n < 8:
        return Interval(math.nan, math.nan, math.nan, n, float(n))
    n_eff = n * EFFICIENCY / MEMORY
    low, high = sigma_interval(s, max(n_eff - 1.0, 1.0), confidence)
    return Interval(s, float(low), float(high), n, n_eff)
