"""The rows of an rcs result: detection probability, mean RCS of every case, and whether the model holds."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rangeeval.model import Bins, Estimate
from rangeeval.stats.proportions import exact_interval, wilson_interval
from rangeeval.stats.swerling import MISS, Case, Looks, Windows
from rangeeval.stats.swerling.detection import detection_probability, information, snr_for
from rangeeval.stats.swerling.fitness import Choice, Measures, PValues, lag_one
from rangeeval.stats.swerling.intervals import bootstrap_interval, credible_interval
from rangeeval.stats.swerling.likelihood import Fit, fit, log_likelihood, profile_interval
from rangeeval.stats.swerling.paper import METHODS, iterate, median_rule

Floats = NDArray[np.float64]

FEW_DETECTIONS = 3
TEST_LEVEL = 0.01
PERCENTS = (50, 80, 90)


@dataclass(frozen=True)
class Method:
    """How to estimate: the method, the cases, the confidence, and what intervals are (with replicates and seed)."""

    name: str
    cases: tuple[Case, ...]
    confidence: float
    interval: str = "profile"
    replicates: int = 0
    seed: int = 1


@dataclass(frozen=True)
class CaseFit:
    """One case over all windows: the estimate of the method, and the likelihood's own maximum and interval."""

    s: Floats
    value: Floats
    low: Floats
    high: Floats
    own: Fit


def fit_case(looks: Looks, windows: Windows, case: Case, method: Method) -> CaseFit:
    """Estimate and interval of every window for one case."""
    best = fit(looks, windows, case)
    if method.name == "med":
        s = median_rule(looks, windows)[windows.last - 1]
        value, _, _ = log_likelihood(looks, windows, case, s)
        return CaseFit(s, value, np.full(len(s), np.nan), np.full(len(s), np.nan), best)
    low, high = _interval(looks, windows, case, best, method)
    if method.name in METHODS:
        s, _, _ = iterate(looks, windows, case, method.name)
        inside = (s > 0) & np.isfinite(s)
        value, _, _ = log_likelihood(looks, windows, case, np.where(inside, s, 1.0))
        return CaseFit(s, np.where(inside, value, best.value), low, high, best)
    return CaseFit(best.s, best.value, low, high, best)


def _interval(looks: Looks, windows: Windows, case: Case, best: Fit, method: Method) -> tuple[Floats, Floats]:
    """The interval asked for where there is an estimate; else the exact limit."""
    low, high = profile_interval(looks, windows, case, best, method.confidence)
    if method.interval == "profile":
        return low, high
    if method.interval == "credible":
        ends = credible_interval(looks, windows, case, method.confidence)[::2]
    else:
        rng = np.random.default_rng(method.seed)
        ends = bootstrap_interval(looks, windows, case, best.s, method.replicates, rng, method.confidence)
    inside = (best.s > 0) & np.isfinite(best.s)
    return np.where(inside, ends[0], low), np.where(inside, ends[1], high)


@dataclass(frozen=True)
class Place:
    """Where the looks of a window stand."""

    variable: str | None = None
    low: float = math.nan
    high: float = math.nan
    track: str | None = None


@dataclass(frozen=True)
class Window:
    """One window's looks and all that was found in them."""

    place: Place
    looks: Looks
    fits: Mapping[str, tuple[float, float, float, float]]  # of each case: s, low, high, lnL
    flags: tuple[str, ...] = ()
    tests: Mapping[str, float] = field(default_factory=dict)
    correlation: tuple[float, int] = (math.nan, 0)

    def row(self, quantity: str, unit: str, value: float, ends: tuple[float, float] = (math.nan, math.nan), *,
            group: str | None = None, flags: tuple[str, ...] | None = None) -> Estimate:  # fmt: skip
        """One estimate here."""
        p = self.place
        n = len(self.looks)
        return Estimate(
            quantity=quantity, unit=unit, value=value, low=ends[0], high=ends[1], n=n, n_eff=self.n_eff,
            variable=p.variable, bin_low=p.low, bin_high=p.high, track_id=p.track, group=group,
            flags=self.flags if flags is None else flags, extra={"detections": self.hits},
        )  # fmt: skip

    @property
    def hits(self) -> int:
        """How many looks saw the target."""
        return int(np.count_nonzero(self.looks.kind != MISS))

    @property
    def n_eff(self) -> float:
        """Looks less what their correlation takes (first order, only when it is significant)."""
        rho, pairs = self.correlation
        if pairs and rho > 2.58 / math.sqrt(pairs):
            return len(self.looks) * (1.0 - rho) / (1.0 + rho)
        return float(len(self.looks))


def limit_flags(s: float) -> tuple[str, ...]:
    """What is known when there is no finite estimate."""
    return ("upper-limit",) if s == 0.0 else ("lower-limit",) if math.isinf(s) else ()


def rcs_row(window: Window, s: float, ends: tuple[float, float], group: str | None, more: tuple[str, ...]) -> Estimate:
    """The mean RCS; where nothing was detected, or nothing but hits, no value but a limit."""
    limits = limit_flags(s)
    return window.row(
        "rcs", "m^2", math.nan if limits else s, ends, group=group,
        flags=tuple(dict.fromkeys((*limits, *window.flags, *more))),
    )  # fmt: skip


def window_rows(
    window: Window, method: Method, chosen: Case, among: tuple[str, ...], model_s: Floats
) -> Iterator[Estimate]:
    """All rows of one window: pooled first, then each case. `model_s`: the trial's mean RCS with its ends."""
    n, k = len(window.looks), window.hits
    fitted = 2 if chosen.free else 1
    few = ("few-samples",) if "few-samples" in window.flags else ()
    share = k / n if n else math.nan
    low, high = (float(v) for v in wilson_interval(k, n, method.confidence))
    yield window.row("detection_probability", "1", share, (low, high), flags=few)
    low, high = (float(v) for v in exact_interval(k, n, method.confidence))
    yield window.row("detection_probability_exact", "1", share, (low, high), flags=few)
    model = [mean_detection(window.looks, chosen, float(s)) for s in model_s]
    yield window.row("detection_probability_model", "1", model[0], (model[1], model[2]), flags=())
    s, low, high, value = window.fits[chosen.name]
    more: tuple[str, ...] = ()
    if len(among) > 1:  # the interval holds those of all cases that the looks do not tell apart
        more = ("case-not-distinguishable",)
        low = min(window.fits[c][1] for c in among)
        high = max(window.fits[c][2] for c in among)
    yield rcs_row(window, s, (low, high), None, more)
    if 0 < s < math.inf:
        told = information(window.looks, chosen, s)
        yield window.row("rcs_cramer_rao_sigma", "m^2", s / math.sqrt(told) if told > 0 else math.nan, flags=())
    yield window.row("log_likelihood", "1", value, flags=())
    yield window.row("aic", "1", 2.0 * fitted - 2.0 * value, flags=())
    for name, p in window.tests.items():
        yield window.row(name, "1", p, flags=())
    rho, pairs = window.correlation
    if pairs:
        half = 1.96 / math.sqrt(pairs)
        yield window.row("amplitude_correlation", "1", rho, (max(-1.0, rho - half), min(1.0, rho + half)), flags=())
    for case in method.cases:
        s, low, high, value = window.fits[case.name]
        yield rcs_row(window, s, (low, high), case.name, ())
        yield window.row("log_likelihood", "1", value, group=case.name, flags=())
        yield window.row("aic", "1", 2.0 * fitted - 2.0 * value, group=case.name, flags=())


def window_flags(looks: Looks, bins: Bins, p: Mapping[str, float], correlation: tuple[float, int]) -> tuple[str, ...]:
    """What a reader must know of a window."""
    hits = int(np.count_nonzero(looks.kind != MISS))
    flags = []
    if len(looks) < bins.min_samples:
        flags.append("few-samples")
    if 0 < hits < FEW_DETECTIONS:
        flags.append("few-detections")
    if any(v < TEST_LEVEL for v in p.values()):
        flags.append("poor-fit")
    rho, pairs = correlation
    if pairs and rho > 2.58 / math.sqrt(pairs):
        flags.append("slow-fading")
    return tuple(flags)


def mean_detection(looks: Looks, case: Case, s: float) -> float:
    """The model's detection probability averaged over the looks at mean RCS `s`; NaN where s is missing."""
    if not s >= 0:
        return math.nan
    if math.isinf(s):
        return 1.0
    return float(detection_probability(looks.alpha * s, looks.threshold, case, looks.pulses).mean())


@dataclass(frozen=True)
class RangeLaw:
    """How alpha falls with range: ln alpha = intercept + slope ln R, and the scatter of the looks about it."""

    intercept: float
    slope: float
    scatter: Floats
    nearest: float
    farthest: float
    threshold: float
    pulses: int

    @classmethod
    def of(cls, looks: Looks, range_m: Floats) -> RangeLaw | None:
        """Fitted to the looks; None where ranges are missing or all alike."""
        good = np.isfinite(range_m) & (range_m > 0)
        if good.sum() < 3 or np.ptp(range_m[good]) < 0.05 * np.max(range_m[good]):
            return None
        x, y = np.log(range_m[good]), np.log(looks.alpha[good])
        slope, intercept = np.polyfit(x, y, 1)
        if slope >= -1.0:  # alpha that does not fall with range: managed energy; no range can be inverted
            return None
        rest = y - intercept - slope * x
        scatter = np.quantile(rest, (np.arange(15) + 0.5) / 15) if np.std(rest) > 1e-3 else np.zeros(1)
        return cls(
            float(intercept), float(slope), scatter, float(range_m[good].min()), float(range_m[good].max()),
            float(np.median(looks.threshold)), int(np.median(looks.pulses)),
        )  # fmt: skip

    def probability(self, range_m: Floats, case: Case, s: float) -> Floats:
        """The model's detection probability at these ranges."""
        if not s >= 0:
            return np.full(len(range_m), np.nan)
        s = min(s, 1e12)
        level = np.exp(self.intercept + self.slope * np.log(range_m)[:, None] + self.scatter[None, :])
        return np.asarray(detection_probability(level * s, self.threshold, case, self.pulses).mean(axis=1))

    def range_for(self, probability: float, case: Case, s: float) -> float:
        """The range at which the detection probability falls to this value."""
        if not 0 < s < math.inf:
            return math.nan
        needed = snr_for(probability, self.threshold, case, self.pulses) / s
        if needed <= 0:
            return math.nan
        low, high = (
            math.exp((math.log(needed) - self.intercept - r) / self.slope)
            for r in (float(self.scatter.min()), float(self.scatter.max()))
        )
        for _ in range(80):
            middle = math.sqrt(low * high)
            if float(self.probability(np.array([middle]), case, s)[0]) > probability:
                low = middle
            else:
                high = middle
        return math.sqrt(low * high)


def test_values(p: PValues, i: int) -> dict[str, float]:
    """The bootstrap p-values of one window, by quantity."""
    return {"amplitude_ks_p": float(p.ks[i]), "amplitude_ad_p": float(p.ad[i]), "detections_p": float(p.count[i])}


def correlations(m: Measures, windows: Windows, order: NDArray[np.intp], time_s: Floats) -> list[tuple[float, int]]:
    """Lag-one correlation of consecutive looks of each window, in time order."""
    found = []
    for a, b in zip(windows.first.tolist(), windows.last.tolist(), strict=True):
        by_time = np.argsort(time_s[order[a:b]], kind="stable")
        found.append(lag_one(m.u[a:b][by_time]))
    return found


__all__ = ["CaseFit", "Choice", "Method", "Place", "RangeLaw", "Window", "fit_case", "window_rows"]
