"""Mean, scatter and root mean square of errors that have memory, each with an interval that counts it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from rangeeval.stats.correlation import effective_samples_of, newey_west
from rangeeval.stats.intervals import degrees_of_freedom, sigma_interval

Array = NDArray[np.float64]

ENOUGH = 20  # samples from which their own correlation is estimated
MOST_LAGS = 40  # of the long-run variance; beyond that only time is spent


@dataclass(frozen=True)
class Interval:
    """An estimate with its two-sided interval and the effective number of samples behind it; NaN where none is had."""

    value: float
    low: float
    high: float
    n: int
    n_eff: float

    def from_zero(self) -> Interval:
        """The same for what cannot be negative."""
        return replace(self, low=max(self.low, 0.0)) if math.isfinite(self.low) else self


def root_mean_square(error: Array, noise: float, confidence: float) -> tuple[float, float, float, float, bool]:
    """Root mean square less known noise, its interval (low, high), effective samples, and whether noise hides it.

    The interval is that of the mean of the squares, whose scatter counts their correlation (Newey and West).
    """
    square = error[np.isfinite(error)] ** 2
    n = square.size
    if not n:
        return math.nan, math.nan, math.nan, math.nan, False
    mean = float(np.mean(square)) - noise
    if n < 4:
        return (math.sqrt(mean) if mean > 0 else math.nan), math.nan, math.nan, float(n), mean <= 0
    white = float(np.var(square, ddof=1))
    long_run = max(n * newey_west(square), white)
    spread = math.sqrt(long_run / n)
    n_eff = n * white / long_run if long_run > 0 else float(n)
    half = float(stdtrit(max(n_eff - 1, 1.0), 0.5 + confidence / 2)) * spread
    high = math.sqrt(max(mean + half, 0.0))
    if mean <= 0:
        return math.nan, 0.0, high, n_eff, True
    return math.sqrt(mean), math.sqrt(max(mean - half, 0.0)), high, n_eff, False


def rms(error: ArrayLike, confidence: float = 0.95, stretch: ArrayLike | None = None) -> Interval:
    """Root mean square of errors (n) with memory; `stretch` numbers runs of consecutive samples, ascending."""
    x, mark = _finite(error, stretch)
    squared = mean(x**2, confidence, mark)
    low, high = (math.sqrt(max(v, 0.0)) if math.isfinite(v) else v for v in (squared.low, squared.high))
    value = math.sqrt(squared.value) if x.size else math.nan
    return Interval(value, low, high, squared.n, squared.n_eff)


def mean(values: ArrayLike, confidence: float = 0.95, stretch: ArrayLike | None = None) -> Interval:
    """Mean of samples (n) with memory; its interval is missing for fewer than 4.

    The long-run variance (Newey and West, square root of n lags, 40 at most) is never taken to be less than that of
    white samples: a filter's residuals may well alternate, but nothing is gained by believing in it.
    """
    x, mark = _finite(values, stretch)
    n = x.size
    if n < 4:
        return Interval(float(x.mean()) if n else math.nan, math.nan, math.nan, n, float(n))
    white = float(np.var(x, ddof=1))
    long_run = max(n * newey_west(x, min(int(math.sqrt(n)), MOST_LAGS), mark), white)
    n_eff = n * white / long_run if long_run > 0 else float(n)
    half = float(stdtrit(max(n_eff - 1, 1.0), 0.5 + confidence / 2)) * math.sqrt(long_run / n)
    centre = float(x.mean())
    return Interval(centre, centre - half, centre + half, n, n_eff)


def sigma(values: ArrayLike, confidence: float = 0.95, stretch: ArrayLike | None = None) -> Interval:
    """Standard deviation about the mean of samples (n) with memory, perhaps heavy-tailed; missing below 2."""
    x, mark = _finite(values, stretch)
    n = x.size
    if n < 2:
        return Interval(math.nan, math.nan, math.nan, n, float(n))
    s = float(x.std(ddof=1))
    n_eff = float(n) if n < ENOUGH else effective_samples_of(x, mark)
    if not math.isfinite(n_eff) or s == 0.0:
        return Interval(s, math.nan, math.nan, n, float(n))
    kurtosis = max(3.0, float(np.mean((x - x.mean()) ** 4)) / float(x.var()) ** 2)
    low, high = sigma_interval(s, degrees_of_freedom(n_eff, kurtosis=kurtosis), confidence)
    return Interval(s, float(low), float(high), n, n_eff)


def _finite(values: ArrayLike, stretch: ArrayLike | None) -> tuple[Array, NDArray[np.generic] | None]:
    x = np.asarray(values, dtype=np.float64).ravel()
    use = np.isfinite(x)
    if stretch is None:
        return x[use], None
    mark = np.asarray(stretch).ravel()[use]
    return x[use], mark if mark.size and mark[0] != mark[-1] else None  # ascending: one stretch needs no marks
