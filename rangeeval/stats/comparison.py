"""Two estimates against each other: ratio or difference, its interval, its p value, and what more samples would do.

Each form of comparison is a *contrast*: the estimate of an effect (a ratio, a difference), an interval, and the
p values of the one-sided questions "is the effect below (above) this value?". Everything else follows from those:
the two-sided test, the two one-sided tests of equivalence, and how many times as many samples would decide.
The last functions adjust p values for many tests at once.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from rangeeval.stats.proportions import wilson_interval

FloatArray = NDArray[np.float64]

_MOST = 1e9  # times the samples: more than this is never


class Contrast(Protocol):
    """An effect, estimated."""

    @property
    def effect(self) -> float:
        """The estimate."""

    def interval(self, confidence: float) -> tuple[float, float]:
        """Two-sided interval of the effect."""

    def below(self, value: float) -> float:
        """P value of "the effect is not below `value`": small when it clearly is below."""

    def above(self, value: float) -> float:
        """P value of "the effect is not above `value`": small when it clearly is above."""

    def grown(self, times: float) -> Contrast:
        """The same estimates from `times` as many samples of both."""


@dataclass(frozen=True)
class SigmaRatio:
    """Sigma of B over sigma of A, each with nu s^2 / sigma^2 chi-square on `nu_a`, `nu_b` degrees of freedom: exact.

    References
    ----------
    (s_b / s_a)^2 / (sigma_b / sigma_a)^2 has the F distribution with nu_b and nu_a degrees of freedom (Fisher 1924).
    """

    sigma_a: float
    nu_a: float
    sigma_b: float
    nu_b: float

    @property
    def effect(self) -> float:
        """The ratio of the estimates."""
        return self.sigma_b / self.sigma_a

    def interval(self, confidence: float) -> tuple[float, float]:
        """Two-sided interval of the ratio."""
        tail = (1.0 - confidence) / 2.0
        # Both ends from a lower tail: 1 - tail would lose the digits of a small tail.
        low = self.effect * math.sqrt(float(special.fdtri(self.nu_a, self.nu_b, tail)))
        high = self.effect / math.sqrt(float(special.fdtri(self.nu_b, self.nu_a, tail)))
        return low, high

    def below(self, value: float) -> float:
        """The lower tail of F."""
        return float(special.fdtr(self.nu_b, self.nu_a, (self.effect / value) ** 2))

    def above(self, value: float) -> float:
        """The upper tail of F, as the lower one of its inverse."""
        return float(special.fdtr(self.nu_a, self.nu_b, (value / self.effect) ** 2))

    def grown(self, times: float) -> SigmaRatio:
        """Degrees of freedom in proportion."""
        return replace(self, nu_a=self.nu_a * times, nu_b=self.nu_b * times)


@dataclass(frozen=True)
class Sides:
    """An estimate with the standard errors of its two sides, recovered from its interval.

    `down`, `up`: from the estimate to each end, over the quantile that the interval was made with; `nu`: degrees of
    freedom of that quantile (infinite: the normal one).
    """

    value: float
    down: float
    up: float
    nu: float = math.inf

    @classmethod
    def of(cls, value: float, low: float, high: float, confidence: float, nu: float = math.inf) -> Sides:
        """From an interval at a confidence."""
        quantile = float(special.stdtrit(nu, (1.0 + confidence) / 2.0))
        return cls(value, (value - low) / quantile, (high - value) / quantile, nu)


@dataclass(frozen=True)
class Difference:
    """B less A from the interval of each, which need not be symmetric: each side has a standard error of its own.

    `logarithmic`: the sides are those of the logarithms, and the effect is the ratio.

    References
    ----------
    Zou and Donner (2008), method of variance estimates recovery; degrees of freedom after Welch (1947).
    """

    a: Sides
    b: Sides
    logarithmic: bool = False

    @property
    def effect(self) -> float:
        """The difference, or the ratio."""
        return self._out(self.b.value - self.a.value)

    def interval(self, confidence: float) -> tuple[float, float]:
        """Two-sided interval of the effect."""
        centre, half = self.b.value - self.a.value, (1.0 + confidence) / 2.0
        (down, nu_down), (up, nu_up) = self._side(lower=True), self._side(lower=False)
        return (
            self._out(centre - down * float(special.stdtrit(nu_down, half))),
            self._out(centre + up * float(special.stdtrit(nu_up, half))),
        )

    def below(self, value: float) -> float:
        """The lower tail of Student's t."""
        return self._tail(value, 1.0)

    def above(self, value: float) -> float:
        """The upper tail of Student's t."""
        return self._tail(value, -1.0)

    def grown(self, times: float) -> Difference:
        """Standard errors fall with the root of the number, degrees of freedom grow with it."""

        def more(s: Sides) -> Sides:
            return Sides(s.value, s.down / math.sqrt(times), s.up / math.sqrt(times), s.nu * times)

        return replace(self, a=more(self.a), b=more(self.b))

    def _tail(self, value: float, sign: float) -> float:
        away = self.b.value - self.a.value - self._in(value)
        error, nu = self._side(lower=away > 0)
        if error == 0.0:
            return float(away * sign >= 0.0) if away else 1.0
        return float(special.stdtr(nu, sign * away / error))

    def _side(self, *, lower: bool) -> tuple[float, float]:
        """Standard error of the difference towards one side, and its degrees of freedom."""
        a, b = (self.a.up, self.b.down) if lower else (self.a.down, self.b.up)
        square = a * a + b * b
        spent = a**4 / self.a.nu + b**4 / self.b.nu
        return math.sqrt(square), square * square / spent if 0.0 < spent < math.inf else math.inf

    def _in(self, value: float) -> float:
        return math.log(value) if self.logarithmic else value

    def _out(self, value: float) -> float:
        return math.exp(value) if self.logarithmic else value


@dataclass(frozen=True)
class ShareDifference:
    """Share of B less share of A, from counts: `hits` of `n` (effective numbers need not be whole).

    References
    ----------
    Interval: Newcombe (1998), method 10. Whether the shares differ: Fisher's exact test.
    """

    hits_a: float
    n_a: float
    hits_b: float
    n_b: float

    @property
    def effect(self) -> float:
        """The difference of the shares."""
        return self.hits_b / self.n_b - self.hits_a / self.n_a

    def interval(self, confidence: float) -> tuple[float, float]:
        """Two-sided interval of the difference."""
        return self._sides(confidence).interval(confidence)

    def below(self, value: float) -> float:
        """Fisher's lower tail at no difference; elsewhere from the Wilson intervals."""
        return self._fisher(-1) if value == 0.0 else self._sides(0.95).below(value)

    def above(self, value: float) -> float:
        """Fisher's upper tail at no difference; elsewhere from the Wilson intervals."""
        return self._fisher(1) if value == 0.0 else self._sides(0.95).above(value)

    def grown(self, times: float) -> ShareDifference:
        """Counts in proportion."""
        return ShareDifference(self.hits_a * times, self.n_a * times, self.hits_b * times, self.n_b * times)

    def _sides(self, confidence: float) -> Difference:
        def side(hits: float, n: float) -> Sides:
            low, high = (float(v) for v in wilson_interval(hits, n, confidence))
            return Sides.of(hits / n, low, high, confidence)

        return Difference(side(self.hits_a, self.n_a), side(self.hits_b, self.n_b))

    def _fisher(self, sign: int) -> float:
        """One tail of the hypergeometric distribution of B's hits, all hits given."""
        n_a, n_b = round(self.n_a), round(self.n_b)
        hits_b = round(self.hits_b)
        hits = round(self.hits_a) + hits_b
        x = np.arange(max(0, hits - n_a), min(hits, n_b) + 1)
        logs = _log_choose(n_b, x) + _log_choose(n_a, hits - x) - _log_choose(n_a + n_b, np.asarray(hits))
        return float(min(1.0, np.exp(logs[sign * x >= sign * hits_b]).sum()))


def _log_choose(n: int, k: NDArray[np.integer]) -> FloatArray:
    chosen: FloatArray = special.gammaln(n + 1) - special.gammaln(k + 1) - special.gammaln(n - k + 1)
    return chosen


def p_value(contrast: Contrast, null: float) -> float:
    """Two-sided p value of "the effect is `null`": twice the smaller tail."""
    return min(1.0, 2.0 * min(contrast.below(null), contrast.above(null)))


def p_equivalent(contrast: Contrast, low: float, high: float) -> float:
    """P value of "the effect lies outside `low` to `high`": small when it clearly lies inside.

    References
    ----------
    Schuirmann (1987), two one-sided tests.
    """
    return max(contrast.above(low), contrast.below(high))


def growth_to(contrast: Contrast, decided: Callable[[Contrast], bool]) -> float:
    """How many times as many samples would decide, if the estimates stay as they are; infinite when none would."""
    if decided(contrast):
        return 1.0
    low, high = 1.0, 2.0
    while not decided(contrast.grown(high)):
        low, high = high, high * 2.0
        if high > _MOST:
            return math.inf
    while high / low > 1.0001:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if decided(contrast.grown(middle)) else (middle, high)
    return high


def holm(p: ArrayLike) -> FloatArray:
    """Adjusted p values (m): at most a share alpha of runs holds any false claim among those with p <= alpha.

    NaN is no test and stays NaN.

    References
    ----------
    Holm (1979).
    """
    return _adjusted(p, lambda ranked: np.maximum.accumulate(ranked * np.arange(ranked.size, 0, -1)))


def benjamini_hochberg(p: ArrayLike) -> FloatArray:
    """Adjusted p values (m): of the claims with p <= alpha a share of at most alpha is false, on average.

    NaN is no test and stays NaN.

    References
    ----------
    Benjamini and Hochberg (1995).
    """

    def adjust(ranked: FloatArray) -> FloatArray:
        scaled = ranked * ranked.size / np.arange(1, ranked.size + 1)
        smallest: FloatArray = np.minimum.accumulate(scaled[::-1])[::-1]
        return smallest

    return _adjusted(p, adjust)


def _adjusted(p: ArrayLike, adjust: Callable[[FloatArray], FloatArray]) -> FloatArray:
    values = np.array(p, dtype=np.float64)
    tested = np.flatnonzero(np.isfinite(values))
    order = tested[np.argsort(values[tested], kind="stable")]
    values[order] = np.minimum(adjust(values[order]), 1.0)
    return values
