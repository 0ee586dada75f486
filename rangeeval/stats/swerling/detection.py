"""Detection probability, thresholds from false-alarm probabilities and back, and the Cramer-Rao bound."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.special import gammaincc, gammainccinv

from rangeeval.compiled import compiled
from rangeeval.stats.swerling.looks import Case, Looks
from rangeeval.stats.swerling.terms import DETECTION, MISS, detection_probability_of, look_terms

Floats = NDArray[np.float64]

_NODES, _WEIGHTS = (np.ascontiguousarray(a) for a in np.polynomial.legendre.leggauss(24))
_PANELS = 48


def threshold_of(false_alarm: ArrayLike, pulses: ArrayLike = 1) -> Floats:
    """The threshold on z that noise alone passes with this probability: P_F = Q(n, T), for one pulse T = -ln P_F."""
    return np.asarray(gammainccinv(np.asarray(pulses, np.float64), np.asarray(false_alarm, np.float64)))


def false_alarm_of(threshold: ArrayLike, pulses: ArrayLike = 1) -> Floats:
    """The probability that noise alone passes the threshold."""
    return np.asarray(gammaincc(np.asarray(pulses, np.float64), np.asarray(threshold, np.float64)))


@compiled
def _probabilities(threshold, pulses, snr, shape, out):  # type: ignore[no-untyped-def]
    for k in range(len(out)):
        out[k] = detection_probability_of(threshold[k], pulses[k], snr[k], shape[k])


def detection_probability(snr: ArrayLike, threshold: ArrayLike, case: Case, pulses: ArrayLike = 1) -> Floats:
    """P(z >= T) at mean SNR per pulse; arrays broadcast. At SNR 0 it is the false-alarm probability.

    References
    ----------
    Swerling (1960); DiFranco and Rubin (1968), Radar Detection, ch. 11; the sums of docs/explanation/rcs.md.
    """
    s, t, n = np.broadcast_arrays(
        np.asarray(snr, np.float64), np.asarray(threshold, np.float64), np.asarray(pulses, np.int64)
    )
    out = np.empty(s.size)
    flat = (np.ascontiguousarray(a.reshape(-1)) for a in (t, n, s))
    thresholds, counts, levels = flat
    _probabilities(thresholds, counts, levels, case.shapes(counts), out)
    return out.reshape(s.shape)


def snr_for(probability: float, threshold: float, case: Case, pulses: int = 1) -> float:
    """The mean SNR per pulse that gives a detection probability; 0 where the false-alarm probability is enough."""

    def short(u: float) -> float:
        return float(detection_probability(np.exp(u), threshold, case, pulses)) - probability

    if short(-40.0) >= 0:
        return 0.0
    return float(np.exp(brentq(short, -40.0, 40.0, xtol=1e-12)))


@compiled
def _information(threshold, pulses, snr, shape, out):  # type: ignore[no-untyped-def]
    """Fisher information of one look about ln s."""
    for k in range(len(out)):
        n, t, s, shape_k = pulses[k], threshold[k], snr[k], shape[k]
        ln_miss, slope, _ = look_terms(MISS, 0.0, t, n, s, shape_k, 1.0)
        total = np.exp(ln_miss) * slope * slope
        mean = n * (1.0 + s)
        spread = np.sqrt(n * (1.0 + 2.0 * s) + (n * s) ** 2 / shape_k)
        top = max(t, mean) + 45.0 * max(spread, 1.0)
        # Panels grow with distance from the threshold: the density may be much narrower than its tail.
        a = t
        for i in range(_PANELS):
            b = t + (top - t) * ((i + 1.0) / _PANELS) ** 2
            half = 0.5 * (b - a)
            for j in range(len(_NODES)):
                z = a + half * (_NODES[j] + 1.0)
                ln_f, d1, _ = look_terms(DETECTION, z, t, n, s, shape_k, 1.0)
                total += half * _WEIGHTS[j] * np.exp(ln_f) * d1 * d1
            a = b
        out[k] = total


def information(looks: Looks, case: Case, s: float, most: int = 64) -> float:
    """Fisher information of looks about ln s at mean RCS `s`, misses counted; of at most about `most` looks, scaled.

    The Cramer-Rao bound on the standard deviation of an unbiased estimate of s is s / sqrt(information).
    """
    order = np.argsort(looks.alpha, kind="stable")
    different = len(np.unique(np.column_stack([looks.alpha, looks.threshold, looks.pulses]), axis=0))
    if different == 1:
        order = order[:1]
    elif len(order) > most:
        order = order[np.linspace(0, len(order) - 1, most).round().astype(int)]
    some = looks.take(np.asarray(order, np.int64))
    out = np.empty(len(some))
    _information(some.threshold, some.pulses, some.alpha * s, case.shapes(some.pulses), out)
    return float(out.mean() * len(looks))
