"""Errors of plots against the truth, plot by plot, and how late one clock is against the other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from rangeeval.angles import wrapped
from rangeeval.model.pairing import Pair
from rangeeval.physics.polar import polar, polar_rates
from rangeeval.stats.correlation import newey_west
from rangeeval.stats.diagnostics import mad_sigma
from rangeeval.stats.mean_square import Interval

Floats = NDArray[np.float64]

COORDINATES = ("range", "azimuth", "elevation")
FAR = 6.0  # robust sigmas beyond which a plot has no say in the time offset
OVERHEAD = math.radians(80.0)  # elevation from which azimuth says little
ROUNDS = 6
MIN_SHARE = 1e-4  # of the speed's scatter that must be left once biases are taken out


@dataclass(frozen=True)
class Errors:
    """Measured less true: (n, 3) of range (m), azimuth, elevation (rad), NaN where there is none, ordered by target.

    `true`: the true polar position (n, 3), `rate` its rates, `speed_m_s` the target's. `target` numbers the pairs.
    """

    error: Floats
    true: Floats
    rate: Floats
    speed_m_s: Floats
    time_s: Floats
    snr_db: Floats
    target: NDArray[np.int64]
    names: tuple[str, ...]

    def take(self, rows: NDArray[np.bool_]) -> Errors:
        """The rows of a mask."""
        return Errors(
            self.error[rows], self.true[rows], self.rate[rows], self.speed_m_s[rows], self.time_s[rows],
            self.snr_db[rows], self.target[rows], self.names,
        )  # fmt: skip


def errors_of(pairs: Sequence[Pair], offset_s: float = 0.0) -> Errors:
    """The error of every plot against the true path `offset_s` later than the plot's own time."""
    parts: list[tuple[Floats, ...]] = []
    for number, pair in enumerate(pairs):
        plots = pair.plots
        position, velocity = pair.path.at(plots.time_s + offset_s)
        true = polar(position)
        measured = np.stack([plots.range_m, plots.azimuth_rad, plots.elevation_rad], axis=-1)
        error = measured - true
        error[:, 1] = wrapped(error[:, 1])
        speed = np.linalg.norm(velocity, axis=-1)
        parts.append((error, true, polar_rates(position, velocity), speed, plots.time_s, plots.snr_db,
                      np.full(len(plots), number)))  # fmt: skip
    names = tuple(pair.plots.target for pair in pairs)
    if not parts:
        none, nothing = np.empty((0, 3)), np.empty(0)
        return Errors(none, none, none, nothing, nothing, nothing, np.empty(0, np.int64), names)
    error, true, rate, velocity, time, snr, target = (np.concatenate(c) for c in zip(*parts, strict=True))
    return Errors(error, true, rate, velocity, time, snr, target.astype(np.int64), names)


@dataclass(frozen=True)
class Offset:
    """How much later than its stated time a plot was measured, by the truth's clock, with its interval; flags."""

    estimate: Interval
    flags: tuple[str, ...] = ()


def time_offset(pairs: Sequence[Pair], confidence: float) -> Offset:
    """The time by which the truth must be taken later to fit the plots: residual against speed, all coordinates.

    A plot with the stated time t that shows where the target truly was at t + tau has the residual tau times the rate
    of its coordinate. Least squares of tau with a constant bias in each coordinate, each weighted by its robust sigma,
    repeated with the truth moved by tau until it stands. Positive: the truth's times are late (or the plots' early).
    `unobservable` when the rates hardly vary, so that tau and the biases cannot be told apart.
    """
    tau, found = 0.0, Offset(Interval(math.nan, math.nan, math.nan, 0, math.nan), ("unobservable",))
    for _ in range(ROUNDS):
        step = _step(errors_of(pairs, tau), confidence)
        if step is None:
            return found
        e = step.estimate
        found = Offset(Interval(tau + e.value, tau + e.low, tau + e.high, e.n, e.n_eff), step.flags)
        tau += e.value
        if abs(e.value) < 1e-6 or not math.isfinite(e.value):
            break
    return found


def _step(errors: Errors, confidence: float) -> Offset | None:
    """One least-squares step: tau from the residuals as they stand."""
    score = np.zeros(len(errors.time_s))
    weight = power = total = 0.0
    kept: list[tuple[Floats, Floats, NDArray[np.bool_]]] = []
    for k in range(3):
        e, rate = errors.error[:, k], errors.rate[:, k]
        use = np.isfinite(e) & np.isfinite(rate)
        if k == 1:
            use &= np.abs(errors.true[:, 2]) < OVERHEAD
        # The spread about the trend, not the trend itself, says which plots are wild.
        if use.sum() < 10:
            continue
        slope = _theil(rate[use], e[use])
        rest = e - slope * rate
        centre, spread = float(np.median(rest[use])), mad_sigma(rest[use])
        if spread == 0.0:
            spread = float(np.std(rest[use]))
        use &= np.abs(rest - centre) <= FAR * max(spread, 1e-300)
        if use.sum() < 10 or spread == 0.0:
            continue
        x = np.where(use, rate - rate[use].mean(), 0.0) / spread
        y = np.where(use, e - e[use].mean(), 0.0) / spread
        weight += float(x @ x)
        total += float(np.sum((rate[use] / spread) ** 2))
        power += float(x @ y)
        kept.append((x, y, use))
    if not kept or weight <= MIN_SHARE * total:
        return None
    tau = power / weight
    n = 0
    used = np.zeros(len(score), bool)
    for x, y, use in kept:
        score += x * (y - tau * x)
        used |= use
    n = int(np.count_nonzero(used))
    s, mark = score[used], errors.target[used]
    white = float(np.mean(s**2))
    long_run = max(n * newey_west(s, int(math.sqrt(n)), mark), white)
    n_eff = n * white / long_run if long_run > 0 else float(n)
    half = float(stdtrit(max(n_eff - 1.0 - len(kept), 1.0), 0.5 + confidence / 2)) * math.sqrt(n * long_run) / weight
    flags = ("correlated",) if n_eff < 0.5 * n else ()
    return Offset(Interval(tau, tau - half, tau + half, n, n_eff), flags)


def _theil(x: Floats, y: Floats) -> float:
    """A robust slope: the median of slopes between points half the sample apart in x (Theil, Sen)."""
    order = np.argsort(x, kind="stable")
    half = len(x) // 2
    a, b = order[:half], order[len(x) - half :]
    run = x[b] - x[a]
    good = run > 0
    return float(np.median((y[b] - y[a])[good] / run[good])) if good.any() else 0.0
