"""Memory in residuals: autocorrelation, the effective number of samples, the variance of a mean.

Residuals often come in several separate stretches (tracks, legs, gaps). `LagSums` holds what all estimates
here need, adds up over stretches and chunks, and never pairs samples of different stretches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

FloatArray = NDArray[np.float64]

LONG_MEMORY = 40  # lags beyond which a longer memory is extrapolated


@dataclass(frozen=True)
class LagSums:
    """Sums over all pairs of samples `lag` apart, for lags 0 to K, of values less `origin`.

    `pairs`, `products`, `leading`, `trailing` (K + 1 each): number of pairs, sum of products, sum of the
    earlier and of the later member. At lag 0 these are n, sum of squares and sum. `longest` is the longest
    stretch.
    """

    origin: float
    longest: int
    pairs: FloatArray
    products: FloatArray
    leading: FloatArray
    trailing: FloatArray

    @property
    def n(self) -> int:
        """Number of samples."""
        return int(self.pairs[0])

    @property
    def mean(self) -> float:
        """Mean of all samples; NaN without samples."""
        return self.origin + float(self.leading[0] / self.pairs[0]) if self.n else float("nan")

    def merge(self, other: LagSums) -> LagSums:
        """Give the sums over the stretches of both.

        Raises
        ------
        ValueError : the two were not made with the same origin and lags.
        """
        if self.origin != other.origin or self.pairs.size != other.pairs.size:
            raise ValueError(
                f"sums with origin {self.origin} and {self.pairs.size - 1} lags cannot be merged with "
                f"origin {other.origin} and {other.pairs.size - 1} lags; make both alike"
            )
        return LagSums(
            self.origin,
            max(self.longest, other.longest),
            self.pairs + other.pairs,
            self.products + other.products,
            self.leading + other.leading,
            self.trailing + other.trailing,
        )

    def autocovariance(self, *, remove_mean: bool = True) -> FloatArray:
        """Give the autocovariance at lags 0 to K, divisor N at every lag; without removing the mean about 0
        if asked.
        """
        m = (self.mean if remove_mean else 0.0) - self.origin
        with np.errstate(divide="ignore", invalid="ignore"):
            total = self.products - m * (self.leading + self.trailing) + self.pairs * m**2
            covariance: FloatArray = total / self.pairs[0]
        return covariance

    def standardised(self) -> LagSums:
        """The same sums of the values less their mean and over their standard deviation, so that bins can be pooled."""
        c = self.autocovariance()
        scaled = c * self.pairs[0] / c[0] if c[0] > 0 else np.zeros_like(c)
        return LagSums(0.0, self.longest, self.pairs, scaled, np.zeros_like(c), np.zeros_like(c))

    def correlation_of_pairs(self) -> FloatArray:
        """Give the correlation of the pairs at each lag, divisor their own number: unbiased where stretches are short.

        NaN where no pairs are so far apart.
        """
        c = self.autocovariance()
        with np.errstate(divide="ignore", invalid="ignore"):
            rho: FloatArray = np.where(self.pairs > 0, c / c[0] * self.pairs[0] / self.pairs, np.nan)
        return rho

    def autocorrelation(self, *, remove_mean: bool = True) -> FloatArray:
        """Give the autocorrelation at lags 0 to K, divisor N at every lag (so a valid correlation); NaN if
        constant.
        """
        c = self.autocovariance(remove_mean=remove_mean)
        with np.errstate(divide="ignore", invalid="ignore"):
            rho: FloatArray = np.where(c[0] > 0, c / c[0], np.nan)
        return rho


def lag_sums(values: ArrayLike, lags: int, stretch: ArrayLike | None = None, *, origin: float = 0.0) -> LagSums:
    """Gather lag sums of `values` (n) in time order; `stretch` (n) numbers the stretch of each, ascending.

    A value that is not finite is a gap: it counts nowhere, but keeps its place. Choose an `origin` near the
    mean when the mean is large against sigma, and the same one for every part to be merged.
    """
    x = np.asarray(values, dtype=np.float64).ravel() - origin
    there = np.isfinite(x)
    x = np.where(there, x, 0.0)
    mark = None if stretch is None else np.asarray(stretch).ravel()
    if mark is not None and mark.size != x.size:
        raise ValueError(f"{x.size} values but {mark.size} stretch numbers; give one stretch number a value")
    sums = np.zeros((4, lags + 1))
    sums[:, 0] = np.count_nonzero(there), x @ x, x.sum(), x.sum()
    whole = bool(there.all()) and mark is None
    for k in range(1, min(lags, x.size - 1) + 1):
        early, late = x[:-k], x[k:]
        count = early.size
        if not whole:
            both = there[k:] & there[:-k]
            if mark is not None:
                both &= mark[k:] == mark[:-k]
            early, late = np.where(both, early, 0.0), np.where(both, late, 0.0)
            count = int(np.count_nonzero(both))
        sums[:, k] = count, early @ late, early.sum(), late.sum()
    return LagSums(origin, _longest(mark, x.size), *sums)


def autocorrelation(values: ArrayLike, lags: int | None = None) -> FloatArray:
    """Give the autocorrelation of one stretch (n) at lags 0 to `lags`, mean removed, divisor N.

    References
    ----------
    Priestley (1981), section 5.3.
    """
    x = np.asarray(values, dtype=np.float64)
    k = default_lags(x.size) if lags is None else lags
    return lag_sums(x, k, origin=_centre(x)).autocorrelation()


def default_lags(n: int, longest: int | None = None) -> int:
    """Give the number of lags to estimate from n samples: floor(min(10 log10 n, n / 4, longest - 1)).

    `longest` is the longest stretch when the samples lie in several: many short ones tell every lag inside them.
    """
    if n < 1:
        return 0
    return max(0, int(min(10 * np.log10(n), n / 4, (n if longest is None else longest) - 1)))


def effective_samples(rho: ArrayLike, n: float, pairs: ArrayLike | None = None) -> float:
    """Number of independent samples that would estimate the variance as well as these n correlated ones.

    `rho`: correlation at lags 0, 1, ...; `pairs`: number of pairs at each lag when there are several
    stretches (n - k by default). N / (1 + 2 sum (pairs_k / N) rho_k^2), for normal samples.

    References
    ----------
    Bartlett (1946); Priestley (1981), section 5.3.
    """
    return float(n / (1 + 2 * np.sum(_pair_weights(rho, n, pairs) * _beyond_zero(rho) ** 2)))


def variance_inflation(rho: ArrayLike, n: float, pairs: ArrayLike | None = None) -> float:
    """Variance of the mean of n correlated samples over that of n independent ones; arguments as
    `effective_samples`.

    Far below 1 for the residuals of a filter whose target does not manoeuvre. Meant for a known (theoretical)
    correlation: summed over all lags of one sample it vanishes identically, so use `newey_west` or
    `batch_means` there.
    """
    return float(1 + 2 * np.sum(_pair_weights(rho, n, pairs) * _beyond_zero(rho)))


def effective_samples_of(values: ArrayLike, stretch: ArrayLike | None = None) -> float:
    """Estimate the effective number of samples for a variance from the samples themselves; NaN when they are
    constant.

    Use the longest homogeneous data at hand (100 samples or more); a 95 % interval then covers 92 to 99 %,
    except when the target manoeuvres far beyond the design.
    """
    x = np.asarray(values, dtype=np.float64).ravel()
    mark = None if stretch is None else np.asarray(stretch).ravel()
    n = int(np.count_nonzero(np.isfinite(x)))
    longest = _longest(mark, x.size)
    lags = max(min(longest - 1, n // 4, LONG_MEMORY), 1 + mean_lags(n, longest), 0)
    return effective_samples_from(lag_sums(x, lags, mark, origin=_centre(x)))


def effective_samples_from(own: LagSums, known: LagSums | None = None) -> float:
    """Estimate the effective number of samples for a variance from lag sums; NaN when the samples are constant.

    `known`: the sums of more samples of the same correlation, where `own` are too few to tell it. The squares of
    estimated correlations are too large on average by their own variance (F / pairs, with F = n / n_eff); that is taken
    off. What is left scatters, and a low estimate of sigma comes with a low one of F, so one standard error of F that
    real correlation causes is put on again. Between 2 and n.

    References
    ----------
    Bartlett (1946) for the variance of an estimated correlation; coverage counted in docs/explanation/accuracy.md.
    """
    source = own if known is None else known
    n, ns = float(own.pairs[0]), float(source.pairs[0])
    rho = source.correlation_of_pairs()
    if n < 2 or not np.isfinite(rho[0]):
        return n if n < 2 else float("nan")
    there = min(rho.size, own.pairs.size, int(np.count_nonzero(np.isfinite(rho)))) - 1
    rho = rho[1 : there + 1] + mean_memory(source).inflation / ns  # what the removed mean takes from every product
    pairs, weights = source.pairs[1 : there + 1], own.pairs[1 : there + 1] / n
    lags = min(default_lags(int(n), own.longest), there)
    squares, noise = _debiased(rho[:lags], pairs[:lags], ns)
    tail = 0.0
    if lags >= 10 and float(squares[-5:].mean()) > 2 * float(noise[-1]):  # the memory is longer than that
        lags = min(there, int(n) // 4, own.longest - 1)
        squares, noise = _debiased(rho[:lags], pairs[:lags], ns)
        tail = _tail(squares, n / max(n - float(own.pairs[1]), 1.0))
    scatter = float(np.sum(weights[:lags] ** 2 * squares * noise))
    f = max(1 + 2 * (float(np.sum(weights[:lags] * squares)) + tail), 1.0) + 4 * np.sqrt(max(scatter, 0.0))
    return float(min(max(n / f, 2.0), n))


def _debiased(rho: FloatArray, pairs: FloatArray, n: float) -> tuple[FloatArray, FloatArray]:
    """Squares of the true correlations, from estimated ones, and the variance of the estimates.

    The variance is F (1 - rho^2)^2 / pairs: Bartlett's F / pairs far out, and about that of AR(1) at the first lags.
    """
    known = (1 - np.clip(rho**2, 0.0, 1.0)) ** 2
    inflation = max((1 + 2 * float(np.sum(pairs * rho**2)) / n) / (1 + 2 * float(known.sum()) / n), 1.0)
    noise = inflation * known / pairs
    return rho**2 - noise, noise


def _tail(squares: FloatArray, length: float) -> float:
    """The sum beyond the last lag, where squares fall on as over the last ten, in stretches of this length."""
    last, before = max(float(squares[-5:].mean()), 0.0), max(float(squares[-10:-5].mean()), 0.0)
    if not last > 0.0:
        return 0.0
    fall = min((last / before) ** 0.2, 1.0) if before > 0.0 else 1.0
    k = np.arange(squares.size + 1, max(int(length), squares.size) + 1)
    return float(np.sum(np.clip(1 - k / length, 0.0, None) * last * fall ** (k - squares.size + 2)))


def mean_lags(n: float, longest: int) -> int:
    """Give the number of lags that the variance of a mean is estimated from: growth after Andrews (1991)."""
    return max(0, min(int(8 * (n / 100) ** (1 / 3)), longest - 2))


@dataclass(frozen=True)
class MeanMemory:
    """Variance of a mean over that of independent samples, and the degrees of freedom of this estimate."""

    inflation: float
    dof: float


def mean_memory(sums: LagSums) -> MeanMemory:
    """Estimate what memory does to the variance of a mean, from lag sums.

    The samples are made nearly white with their lag-one correlation phi first; what is left is summed with triangular
    weights, and the factor of phi is put back, for stretches of the average length. Degrees of freedom: those that the
    scatter of this estimate leaves, no more than n - 1 and at least 1.

    References
    ----------
    Andrews and Monahan (1992), prewhitened kernel estimator; Newey and West (1987), weights; Marriott and Pope (1954),
    bias of phi; Priestley (1981), section 6.2.4, degrees of freedom.
    """
    n = float(sums.pairs[0])
    rho = sums.correlation_of_pairs()
    if n < 3 or not np.isfinite(rho[0]) or rho.size < 2 or not np.isfinite(rho[1]):
        return MeanMemory(1.0, max(n - 1.0, 1.0))
    lags = min(mean_lags(n, sums.longest), int(np.count_nonzero(np.isfinite(rho))) - 2)
    phi = float(np.clip(rho[1] + (1 + 3 * rho[1]) / n, -0.9, 0.97))
    around = np.concatenate(([rho[1]], rho[: lags + 2]))
    white = (1 + phi**2) * around[1:-1] - phi * (around[2:] + around[:-2])
    taper = 1 - np.arange(1, lags + 1) / (lags + 1)
    long_run = max(float(white[0] + 2 * taper @ white[1:]), 0.0) / (1 - phi) ** 2
    long_run /= 1 - min((lags + 1) / n, 0.5)  # what the removed mean takes
    length = max(round(n / max(n - float(sums.pairs[1]), 1.0)), 1)
    ends = 1 - 2 * phi * (1 - phi**length) / (length * (1 - phi**2))
    scatter = 4 / 3 * (lags + 1) / n + 4 * (1 + phi) / ((1 - phi) * n)
    return MeanMemory(max(long_run * ends, 1 / n), float(min(max(2 / scatter, 1.0), n - 1)))


@dataclass(frozen=True)
class LjungBox:
    """Test statistic, degrees of freedom and p value of a test of whiteness."""

    statistic: float
    dof: int
    p_value: float


def ljung_box(rho: ArrayLike, n: float, lags: int = 10, pairs: ArrayLike | None = None) -> LjungBox:
    """Test whether samples are white, from their correlation at lags 0 to `lags` or more.

    Rejection does not mean a bad track: at constant velocity the residual of an alpha-beta filter is
    coloured.

    References
    ----------
    Ljung and Box (1978).
    """
    r = _beyond_zero(rho)[:lags]
    count = n - np.arange(1, r.size + 1) if pairs is None else _float(pairs)[1 : r.size + 1]
    if r.size == 0 or n < 2 or not np.all(count > 0):
        return LjungBox(float("nan"), r.size, float("nan"))
    q = float(n * (n + 2) * np.sum(r**2 / count))
    return LjungBox(q, r.size, float(special.chdtrc(r.size, q)))


def newey_west(values: ArrayLike, bandwidth: int | None = None, stretch: ArrayLike | None = None) -> float:
    """Variance of the mean of correlated samples, from their autocovariance with triangular weights.

    `bandwidth` is the highest lag that counts, floor(4 (n/100)^(2/9)) by default. NaN for fewer than two
    samples.

    References
    ----------
    Newey and West (1987); bandwidth Newey and West (1994).
    """
    x = np.asarray(values, dtype=np.float64).ravel()
    n = int(np.count_nonzero(np.isfinite(x)))
    if n < 2:
        return float("nan")
    k = int(4 * (n / 100) ** (2 / 9)) if bandwidth is None else bandwidth
    return newey_west_from_sums(lag_sums(x, min(k, n - 1), stretch, origin=_centre(x)))


def newey_west_from_sums(sums: LagSums) -> float:
    """Give the same as `newey_west` from gathered lag sums; the bandwidth is their highest lag."""
    c = sums.autocovariance()
    taper = 1 - np.arange(1, c.size) / c.size
    return float(max(0.0, c[0] + 2 * np.sum(taper * c[1:])) / sums.n)


def batch_means(values: ArrayLike, batches: int | None = None) -> tuple[float, int]:
    """Variance of the mean of one long stretch (n) from the scatter of the means of equal batches, and its
    dof.

    floor(sqrt(n)) batches by default; the samples that fill no batch at the end are left out of the scatter.
    NaN for fewer than two batches.

    References
    ----------
    Law and Kelton, Simulation Modeling and Analysis, section 9.5.
    """
    x = np.asarray(values, dtype=np.float64).ravel()
    count = int(np.sqrt(x.size)) if batches is None else batches
    if count < 2 or x.size < count:
        return float("nan"), 0
    size = x.size // count
    means = x[: size * count].reshape(count, size).mean(axis=1)
    return float(means.var(ddof=1) / count), count - 1


def _beyond_zero(rho: ArrayLike) -> FloatArray:
    return _float(rho)[1:]


def _pair_weights(rho: ArrayLike, n: float, pairs: ArrayLike | None) -> FloatArray:
    k = np.arange(1, _float(rho).size)
    weights: FloatArray = np.clip(1 - k / n, 0.0, None) if pairs is None else _float(pairs)[1 : k.size + 1] / n
    return weights


def _longest(mark: NDArray[np.generic] | None, size: int) -> int:
    if size == 0:
        return 0
    if mark is None:
        return size
    edges = np.flatnonzero(np.concatenate(([True], mark[1:] != mark[:-1], [True])))
    return int(np.diff(edges).max())


def _centre(x: FloatArray) -> float:
    there = x[np.isfinite(x)]
    return float(there.mean()) if there.size else 0.0


def _float(value: ArrayLike) -> FloatArray:
    return np.asarray(value, dtype=np.float64)
