"""Does the model hold: goodness of fit, number of detections, equal RCS over bins, independence, and which case.

The mean RCS is estimated from the same looks, so tabled p-values of Kolmogorov-Smirnov or Anderson-Darling would be
far too large; all p-values of fit come from a parametric bootstrap.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar
from scipy.special import chdtrc, chdtri, ndtri

from rangeeval.stats.swerling.closed import DETECTION
from rangeeval.stats.swerling.detection import detection_probability
from rangeeval.stats.swerling.likelihood import Fit, detections, fit, log_likelihood, maximum_likelihood
from rangeeval.stats.swerling.looks import Case, Looks, Windows

Floats = NDArray[np.float64]

FEW_LOOKS = 60  # below it, the right case wins too seldom (66 % for one pulse at SNR 64 and 10 looks) for a verdict
CLEAR_AIC = 2.0
SHAPES = (0.2, 200.0)


def simulate(looks: Looks, windows: Windows, case: Case, s: Floats, rng: np.random.Generator) -> Looks:
    """The same looks, seen once more: amplitudes drawn at mean RCS `s` of each window, misses below the threshold."""
    mean = np.repeat(s, windows.last - windows.first) * looks.alpha * looks.pulses
    size = len(looks)
    single = bool((looks.pulses == 1).all())
    if single and case.shape == 1.0:
        z = (1.0 + mean) * rng.standard_exponential(size)
    elif single and case.shape == 2.0:
        b = 1.0 + 0.5 * mean
        z = rng.standard_exponential(size)
        z += np.where(rng.random(size) < 1.0 - 1.0 / b, rng.standard_exponential(size), 0.0)
        z *= b
    else:
        shape = case.shapes(looks.pulses)
        level = mean if math.isinf(case.shape) else mean * rng.standard_gamma(shape) / shape
        z = rng.standard_gamma(looks.pulses + rng.poisson(level))
    if looks.cells > 1.0:
        others = looks.cells - 1.0
        strongest = -np.log(-np.expm1(np.log(rng.random(size)) / others))  # of single-pulse noise cells
        z = np.maximum(z, np.where(looks.pulses == 1, strongest, 0.0))
    return looks.seen_as(z)


@dataclass(frozen=True)
class Measures:
    """How far each window's detections are from the model: Kolmogorov-Smirnov, Anderson-Darling, expected detections.

    `u`: for each look the model's probability of a weaker detection (uniform under the model), NaN on a miss.
    """

    ks: Floats
    ad: Floats
    expected: Floats
    u: Floats


def measures(looks: Looks, windows: Windows, case: Case, s: Floats) -> Measures:
    """The distances from the model at mean RCS `s`; windows side by side."""
    size = windows.last - windows.first
    level = np.repeat(s, size) * looks.alpha
    expected = detection_probability(level, looks.threshold, case, looks.pulses)
    seen = looks.kind == DETECTION
    u = np.full(len(looks), np.nan)
    beyond = detection_probability(level[seen], looks.z[seen], case, looks.pulses[seen])
    u[seen] = 1.0 - beyond / expected[seen]
    ks, ad = _distances(u[seen], np.repeat(np.arange(len(windows)), size)[seen], len(windows))
    return Measures(ks, ad, windows.reduce(np.add, expected), u)


def _distances(u: Floats, window: NDArray[np.int64], count: int) -> tuple[Floats, Floats]:
    """Kolmogorov-Smirnov's and Anderson-Darling's distance of each window's u from uniform; NaN without any."""
    v = np.clip(u[np.lexsort((u, window))], 1e-15, 1.0 - 1e-15)
    held = np.bincount(window, minlength=count)
    ends = np.cumsum(held)
    n = np.repeat(held, held)
    first = np.repeat(ends - held, held)
    rank = np.arange(len(v)) - first
    largest = np.maximum((rank + 1.0) / n - v, v - rank / n)
    weighted = (2.0 * rank + 1.0) * (np.log(v) + np.log1p(-v[first + n - 1 - rank]))
    some = held > 0
    ks, ad = np.full(count, np.nan), np.full(count, np.nan)
    begin = (ends - held)[some]
    if len(begin):
        ks[some] = np.maximum.reduceat(largest, begin)
        ad[some] = -held[some] - np.add.reduceat(weighted, begin) / held[some]
    return ks, ad


@dataclass(frozen=True)
class PValues:
    """Bootstrap p-values of each window: of the amplitudes (two tests) and of the number of detections."""

    ks: Floats
    ad: Floats
    count: Floats
    replicates: int


def bootstrap(
    looks: Looks, windows: Windows, case: Case, s: Floats, replicates: int, rng: np.random.Generator
) -> PValues:
    """p-values of fit from looks simulated at `s` and fitted again (parametric bootstrap); NaN without detections.

    Windows must lie side by side. Each replicate is simulated at the estimate with every look's own alpha and
    threshold, so that having estimated s is accounted for. The smallest p-value is 1 / (replicates + 1).
    """
    s = np.where(np.isfinite(s), s, 0.0)
    seen = measures(looks, windows, case, s)
    counted = np.abs(detections(looks, windows) - seen.expected)
    worse = np.zeros((3, len(windows)))
    for _ in range(replicates):
        again = simulate(looks, windows, case, s, rng)
        refit = maximum_likelihood(again, windows, case, near=s)
        refit = np.where(np.isfinite(refit), refit, 0.0)
        m = measures(again, windows, case, refit)
        with np.errstate(invalid="ignore"):
            worse[0] += ~(m.ks < seen.ks)
            worse[1] += ~(m.ad < seen.ad)
        worse[2] += np.abs(detections(again, windows) - m.expected) >= counted - 1e-9
    p = (worse + 1.0) / (replicates + 1.0)
    none = np.isnan(seen.ks)
    return PValues(np.where(none, np.nan, p[0]), np.where(none, np.nan, p[1]), np.where(none, np.nan, p[2]), replicates)


@dataclass(frozen=True)
class Homogeneity:
    """Is one RCS enough for all windows: twice the likelihood lost, its degrees of freedom, and the p-value."""

    statistic: float
    degrees: int
    p_value: float


def homogeneity(looks: Looks, windows: Windows, case: Case, each: Fit) -> Homogeneity:
    """Likelihood-ratio test of one mean RCS for all windows (side by side) against one for each."""
    finite = np.isfinite(each.s)
    together = fit(looks, Windows.whole(looks), case)
    statistic = max(0.0, 2.0 * float(each.value[finite].sum() - together.value[0]))
    degrees = int(finite.sum()) - 1
    p = float(chdtrc(degrees, statistic)) if degrees > 0 else math.nan
    return Homogeneity(statistic, degrees, p)


def lag_one(u: Floats) -> tuple[float, int]:
    """Correlation of the normal scores of consecutive detected looks, and the number of pairs; NaN below 10 pairs.

    Swerling 1 and 3 take looks as independent; where they are not, intervals are too short.
    """
    score = ndtri(np.clip(u, 1e-12, 1 - 1e-12))
    pairs = np.isfinite(score[1:]) & np.isfinite(score[:-1])
    n = int(pairs.sum())
    if n < 10:
        return math.nan, n
    a, b = score[:-1][pairs], score[1:][pairs]
    spread = float(np.std(a) * np.std(b))
    return (float(np.mean((a - a.mean()) * (b - b.mean()))) / spread if spread > 0 else math.nan), n


@dataclass(frozen=True)
class Choice:
    """Which case the looks speak for.

    `aic`: of each case, one mean RCS a window. `best`: the smallest. `among`: the cases within 2 of it. `decided` says
    whether the best stands alone and there were looks enough.
    """

    aic: Mapping[str, float]
    best: str
    among: tuple[str, ...]
    decided: bool
    looks: int

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        if self.decided:
            return f"Swerling {self.best} fits best: every other case's AIC is at least {CLEAR_AIC:g} larger."
        if self.looks < FEW_LOOKS:
            return f"{self.looks} looks are too few to tell the Swerling cases apart ({FEW_LOOKS} or more are needed)."
        names = " and ".join(self.among)
        return f"Swerling {names} are not distinguishable: their AIC differ by less than {CLEAR_AIC:g}."


def choose(looks: Looks, windows: Windows, cases: Sequence[Case]) -> Choice:
    """Compare cases by AIC, each with its own mean RCS in every window."""
    aic = {}
    for case in cases:
        found = fit(looks, windows, case)
        aic[case.name] = 2.0 * (len(windows) + case.free) - 2.0 * float(found.value.sum())
    best = min(aic, key=lambda name: aic[name])
    among = tuple(name for name, value in aic.items() if value - aic[best] < CLEAR_AIC)
    enough = len(looks) >= FEW_LOOKS
    return Choice(aic, best, among if enough else tuple(aic), len(among) == 1 and enough, len(looks))


@dataclass(frozen=True)
class Shape:
    """The shape K of the fluctuation that fits best, one for all windows, with its profile-likelihood interval.

    An end at 0 or inf says that nothing bounds K there within `SHAPES`; K at the upper bound is a steady target.
    """

    k: float
    low: float
    high: float
    value: float
    windows: int

    @property
    def aic(self) -> float:
        """Akaike's criterion: a mean RCS for each window and K."""
        return 2.0 * (self.windows + 1) - 2.0 * self.value

    @property
    def case(self) -> Case:
        """The fluctuation model of this shape."""
        return Case("free", self.k, free=True)


def free_shape(looks: Looks, windows: Windows, confidence: float = 0.95) -> Shape:
    """The shape K between 0.2 and 200 at which the looks are most likely, each window with its own mean RCS.

    References
    ----------
    Weinstock (1964) for shapes between and beyond Swerling's; docs/explanation/rcs.md for how many looks it takes.
    """
    near = np.zeros(len(windows))

    def value(ln_k: float) -> float:
        case = Case("free", math.exp(ln_k))
        s = maximum_likelihood(looks, windows, case, near=near)
        good = (s > 0) & np.isfinite(s)
        near[good] = s[good]
        alpha = windows.reduce(np.maximum, looks.alpha)
        at = np.where(good, s, np.where(s > 0, 1e12, 1e-12) / alpha)
        return float(log_likelihood(looks, windows, case, at)[0].sum())

    least, most = math.log(SHAPES[0]), math.log(SHAPES[1])
    found = minimize_scalar(lambda u: -value(u), bounds=(least, most), method="bounded", options={"xatol": 1e-6})
    best, top = float(found.x), -float(found.fun)
    ends = []
    for bound, beyond in ((least, 0.0), (most, math.inf)):
        at_bound = value(bound)
        if at_bound > top:
            best, top = bound, at_bound
        target = top - 0.5 * float(chdtri(1, 1.0 - confidence))
        open_ = at_bound >= target
        ends.append(beyond if open_ else math.exp(brentq(lambda u, t=target: value(u) - t, bound, best, xtol=1e-4)))
    return Shape(math.exp(best), ends[0], ends[1], top, len(windows))
