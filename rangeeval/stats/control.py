"""Is a series of estimates steady: control limits, a slow drift, and steps, when each point has an error of its own.

The model is y_i = mu + u_i + e_i: u_i differs from one trial to the next with variance tau^2 (weather, target, set-up),
e_i is the error that the point's own interval states, with variance v_i. Arrays are (..., k): k points in order.

How large a deviation is surprising depends on k, on the v_i, and on tau^2 having to be estimated from few points. So
the limits are those of simulated steady series with the same v_i, put through the same estimators: of all steady
series, a share `alpha` has a point beyond its limits somewhere. Since tau^2 is not known, they are simulated at its
estimate and at its upper bound, and the wider limit stands.

References
----------
tau^2: the estimating equation of Paule and Mandel (1982), on successive differences as in the individuals chart
(Montgomery, Introduction to Statistical Quality Control), so that a step does not hide itself in tau^2. EWMA: Roberts
(1959). Steps: binary segmentation, Scott and Knott (1974), each split tested against its own simulated maximum.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rangeeval.stats.intervals import FloatArray

LEAST_POINTS = 5  # fewer say nothing about their scatter
SHORTEST = 3  # points on either side of a step; fewer are single points off, which the limits show
SMOOTHING = 0.2  # weight of the newest point in the EWMA
CUT = 2.5  # standard deviations that a point counts at most in levels, steps and the EWMA

# Of a chi-square with one degree of freedom cut off at 1: the mean, and the variance of each term of a sum of those of
# successive differences, which correlate.
_MEAN_OF_CUT = 0.5160
_VARIANCE_OF_CUT = 0.21
_HALVINGS = 26
_UPPER = 1.5  # standard errors to the upper bound at which limits are simulated too

_RUNS = 2_000
_TAIL_RUNS = 20  # at least so many simulated series lie beyond a limit
_MOST_RUNS = 40_000
_AT_ONCE = 4_000_000  # simulated numbers in memory


def between_variance(y: FloatArray, v: FloatArray, breaks: tuple[int, ...] = (), *, sigmas: float = 0.0) -> FloatArray:
    """tau^2 (...,) from successive differences; `breaks`: the points before which the level steps, whose difference to
    the point before is left out. 0 when the points differ no more than their own errors say. With `sigmas`, an upper
    bound so many standard errors of the estimating equation above.

    A squared difference over its variance is chi-square with one degree of freedom. It counts as at most 1, so that a
    trial far out of line, or a step not yet found, moves the estimate little.
    """
    keep = np.ones(y.shape[-1] - 1, bool)
    keep[[b - 1 for b in breaks]] = False
    squared = np.diff(y, axis=-1)[..., keep] ** 2
    own = np.maximum((v[..., 1:] + v[..., :-1])[..., keep], 1e-300)
    pairs = squared.shape[-1]
    wanted = max(pairs * _MEAN_OF_CUT - sigmas * (pairs * _VARIANCE_OF_CUT) ** 0.5, 0.1)
    low, high = np.zeros(squared.shape[:-1]), squared.sum(-1) / (2 * wanted)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        above = np.minimum(squared / (own + 2 * middle[..., None]), 1.0).sum(-1) > wanted
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    steady = np.minimum(squared / own, 1.0).sum(-1) <= wanted
    return np.where(steady, 0.0, high)


def pooled_mean(y: FloatArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The weighted mean (...,) of the points, cut to `CUT` standard deviations about their median, and its variance."""
    total = weight.sum(-1)
    return (weight * _cut(y, weight)).sum(-1) / total, 1 / total


def _cut(y: FloatArray, weight: FloatArray) -> FloatArray:
    """Points far off moved in: one trial out of line neither makes a step nor moves the level of the others much."""
    centre = np.median(y, axis=-1, keepdims=True)
    reach = CUT / np.sqrt(weight)
    cut: FloatArray = centre + np.clip(y - centre, -reach, reach)
    return cut


@dataclass(frozen=True)
class Segment:
    """Points [start, stop) at one level: their weighted mean and its variance."""

    start: int
    stop: int
    mean: float
    variance: float


@dataclass(frozen=True)
class Step:
    """A step of the level before point `at`: its size, variance, and how rarely steady series show one as clear."""

    at: int
    size: float
    variance: float
    p_value: float


@dataclass(frozen=True)
class Chart:
    """A series judged.

    `deviation`: of each point from its level, in standard deviations; beyond `limit` it is out of line. `smoothed`: the
    EWMA of the deviations in its own standard deviations; beyond `smoothed_limit` the level drifts. `sigma`: of each
    point about its level, so that its limits are level -/+ limit sigma.
    """

    tau2: float
    segments: tuple[Segment, ...]
    steps: tuple[Step, ...]
    level: FloatArray
    sigma: FloatArray
    deviation: FloatArray
    limit: float
    smoothed: FloatArray
    smoothed_limit: float


def judge_series(y: FloatArray, v: FloatArray, alpha: float = 0.05, seed: int = 1) -> Chart:
    """Judge k points `y` with error variances `v`, in order. The same numbers give the same chart.

    Each of the three (limits, EWMA, steps) raises a false alarm in a share `alpha` of steady series. Raises ValueError
    for fewer than `LEAST_POINTS` points.
    """
    y, v = np.asarray(y, float), np.asarray(v, float)
    if len(y) < LEAST_POINTS:
        raise ValueError(f"{len(y)} points; {LEAST_POINTS} at least")
    rng = np.random.default_rng(seed)
    found: list[tuple[int, float]] = []
    _split(y, v, 0, len(y), alpha, rng, found)
    breaks = tuple(sorted(at for at, _ in found))
    tau2 = float(between_variance(y, v, breaks))
    level, sigma, deviation, smoothed = (a[0] for a in _deviations(y[None], v, breaks))
    limit, smoothed_limit = _highest(
        lambda simulated: np.stack([np.abs(a).max(-1) for a in _deviations(simulated, v, breaks)[2:]], -1),
        (tau2 + v, float(between_variance(y, v, breaks, sigmas=_UPPER)) + v), alpha, rng,
    )[1]  # fmt: skip
    segments = []
    for start, stop in zip((0, *breaks), (*breaks, len(y)), strict=True):
        mean, variance = pooled_mean(y[start:stop], _weight(tau2, v[start:stop]))
        segments.append(Segment(start, stop, float(mean), float(variance)))
    p_values = dict(found)
    steps = tuple(
        Step(after.start, after.mean - before.mean, after.variance + before.variance, p_values[after.start])
        for before, after in itertools.pairwise(segments)
    )
    return Chart(
        tau2, tuple(segments), steps, level, sigma, deviation, float(limit), smoothed, float(smoothed_limit)
    )  # fmt: skip


def _weight(tau2: FloatArray | float, v: FloatArray) -> FloatArray:
    return 1 / np.maximum(np.asarray(tau2)[..., None] + v, 1e-300)


def _deviations(y: FloatArray, v: FloatArray, breaks: tuple[int, ...]) -> tuple[FloatArray, ...]:
    """Level, sigma of a point about its level, deviation in sigmas, and EWMA in its sigmas: each (runs, k)."""
    weight = _weight(between_variance(y, v, breaks), v)
    level, left = np.empty_like(y), np.empty_like(y)
    edges = (0, *breaks, y.shape[-1])
    for start, stop in itertools.pairwise(edges):
        mean, variance = pooled_mean(y[..., start:stop], weight[..., start:stop])
        level[..., start:stop] = mean[..., None]
        left[..., start:stop] = variance[..., None]
    # A point has pulled its own level towards itself.
    sigma = np.sqrt(np.maximum(1 / weight - left, 0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        deviation = np.where(sigma > 0, (y - level) / sigma, 0.0)
    smoothed = np.empty_like(y)
    last = np.zeros(y.shape[:-1])
    variance_left = 1.0
    for i in range(y.shape[-1]):
        last = (1 - SMOOTHING) * last + SMOOTHING * np.clip(deviation[..., i], -CUT, CUT)
        variance_left *= (1 - SMOOTHING) ** 2
        smoothed[..., i] = last / np.sqrt(SMOOTHING / (2 - SMOOTHING) * (1 - variance_left))
    return level, sigma, deviation, smoothed


def _split(
    y: FloatArray, v: FloatArray, start: int, stop: int, alpha: float, rng: np.random.Generator,
    found: list[tuple[int, float]],
) -> None:  # fmt: skip
    """Look for a step in [start, stop), and in the parts on either side of one that is found."""
    part, own = y[start:stop], v[start:stop]
    if len(part) < max(2 * SHORTEST, LEAST_POINTS):
        return
    tau2 = between_variance(part, own)
    clearest = _clearest(part[None], own)
    statistic = float(clearest.max())
    variances = (tau2 + own, between_variance(part, own, sigmas=_UPPER) + own)
    simulated, (limit,) = _highest(
        lambda series: _clearest(series, own).max(-1)[:, None], variances, alpha, rng
    )  # fmt: skip
    if not statistic > limit:
        return
    at = start + SHORTEST + int(clearest[0].argmax())
    as_clear = (simulated[:, :, 0] >= statistic).sum(-1).max()
    found.append((at, (1 + float(as_clear)) / (1 + simulated.shape[1])))
    _split(y, v, start, at, alpha, rng, found)
    _split(y, v, at, stop, alpha, rng, found)


def _clearest(y: FloatArray, v: FloatArray) -> FloatArray:
    """How clear a step before each point from `SHORTEST` on would be, in its standard deviations: (runs, places)."""
    weight = _weight(between_variance(y, v), v)
    left, left_sum = np.cumsum(weight, -1), np.cumsum(weight * _cut(y, weight), -1)
    total, total_sum = left[..., -1:], left_sum[..., -1:]
    place = slice(SHORTEST - 1, y.shape[-1] - SHORTEST)
    left, left_sum = left[..., place], left_sum[..., place]
    right, right_sum = total - left, total_sum - left_sum
    clear: FloatArray = np.abs(right_sum / right - left_sum / left) / np.sqrt(1 / left + 1 / right)
    return clear


def _highest(
    statistics: Callable[[FloatArray], FloatArray],
    variances: tuple[FloatArray, ...],
    alpha: float,
    rng: np.random.Generator,
) -> tuple[FloatArray, NDArray[np.float64]]:
    """The m statistics (variances, runs, m) of simulated steady series whose points have one set of variances or
    another, and what at most a share `alpha` of the series exceeds under any of them (m,).
    """
    runs = int(min(max(_RUNS, _TAIL_RUNS / alpha), _MOST_RUNS))
    simulated = []
    for variance in variances:
        sigma = np.sqrt(variance)
        found = []
        for first in range(0, runs, step := max(1, _AT_ONCE // len(sigma))):
            found.append(statistics(rng.standard_normal((min(step, runs - first), len(sigma))) * sigma))
        simulated.append(np.concatenate(found))
    every = np.stack(simulated)
    limits: NDArray[np.float64] = np.quantile(every, 1 - alpha, axis=1, method="higher").max(0)
    return every, limits
