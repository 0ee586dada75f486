"""Intervals of the mean RCS other than the profile likelihood's: parametric bootstrap and Bayesian, batched too."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rangeeval.stats.swerling.fitness import simulate
from rangeeval.stats.swerling.likelihood import fit, log_likelihood, maximum_likelihood, profile_interval
from rangeeval.stats.swerling.looks import Case, Looks, Windows

Floats = NDArray[np.float64]

_GRID = 2001
_NEGLIGIBLE = 1e-9  # of the posterior, on either side of the grid

# The prior density of s, given 1/s of a mean SNR of one: between flat and flat in ln s; flat; flat in ln s.
PRIORS: dict[str, Callable[[Floats, Floats], Floats]] = {
    "balanced": lambda s, unit: 1.0 / (s + unit),
    "flat": lambda s, unit: np.ones_like(s),
    "log": lambda s, unit: 1.0 / s,
}


def bootstrap_interval(
    looks: Looks, windows: Windows, case: Case, s: Floats, replicates: int, rng: np.random.Generator,
    confidence: float = 0.95,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Quantiles of the estimates from looks simulated at `s` with their own alpha and threshold, and fitted again.

    Windows lie side by side. A replicate without detections counts as 0, one with nothing but hits as inf.
    """
    finite = np.where(np.isfinite(s), s, 0.0)
    again = np.empty((replicates, len(windows)))
    for one in again:
        one[:] = maximum_likelihood(simulate(looks, windows, case, finite, rng), windows, case, near=finite)
    again.sort(axis=0)
    tail = 0.5 * (1.0 - confidence) * (replicates - 1)
    return again[math.floor(tail)], again[math.ceil(replicates - 1 - tail)]


def credible_interval(
    looks: Looks, windows: Windows, case: Case, confidence: float = 0.95, prior: str = "balanced"
) -> tuple[Floats, Floats, Floats]:
    """Low end, median and high end of the posterior of the mean RCS, equal tails, on a grid of ln s.

    `prior`: `balanced` 1 / (s + 1 / mean alpha), `flat` or `log` (1 / s). NaN where the posterior cannot be normalised:
    nothing but hits, or `log` without a detection.
    """
    found = fit(looks, windows, case)
    low, high = profile_interval(looks, windows, case, found, 1.0 - _NEGLIGIBLE)
    size = windows.last - windows.first
    unit = size / windows.reduce(np.add, looks.alpha)
    proper = np.isfinite(high) & ((low > 0) | (prior != "log"))
    first = np.log(np.where(low > 0, low, 1e-7 * unit))
    last = np.log(np.where(np.isfinite(high), high, 1.0))
    u = first[:, None] + (last - first)[:, None] * np.linspace(0.0, 1.0, _GRID)
    s = np.exp(u)
    many = Windows(np.repeat(windows.first, _GRID), np.repeat(windows.last, _GRID))
    value = log_likelihood(looks, many, case, s.reshape(-1))[0].reshape(s.shape)
    density = np.exp(value - value.max(axis=1, keepdims=True)) * PRIORS[prior](s, unit[:, None]) * s
    step = 0.5 * (density[:, 1:] + density[:, :-1])
    below = np.concatenate([np.zeros((len(s), 1)), np.cumsum(step, axis=1)], axis=1)
    tail = 0.5 * (1.0 - confidence)
    ends = np.array([
        np.exp(np.interp(np.array([tail, 0.5, 1.0 - tail]) * row[-1], row, at)) if good else np.full(3, np.nan)
        for row, at, good in zip(below, u, proper, strict=True)
    ]).reshape(-1, 3)  # fmt: skip
    return ends[:, 0], ends[:, 1], ends[:, 2]
