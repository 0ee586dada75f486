"""Detection probability, thresholds from false-alarm probabilities and back, and the Cramer-Rao bound."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq
from scipy.special import gammaincc, gammainccinv

from rangeeval.compiled import compiled
from rangeeval.stats.swerling.closed import DETECTION, MISS
from rangeeval.stats.swerling.likelihood import log_likelihood
from rangeeval.stats.swerling.looks import Case, Looks, Windows
from rangeeval.stats.swerling.terms import detection_probability_of

Floats = NDArray[np.float64]

_NODES, _WEIGHTS = (np.ascontiguousarray(a) for a in np.polynomial.legendre.leggauss(24))
_PANELS = 48
_COLUMNS = ("threshold", "alpha", "pulses")


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
    if case.shape in (1.0, 2.0) and (n == 1).all():
        x = t / (1.0 + s / case.shape)
        return np.exp(-x) * (1.0 if case.shape == 1.0 else 1.0 + 0.5 * s / (1.0 + 0.5 * s) * x)
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
    return float(_information(some, case, some.alpha * s).mean() * len(looks))


def _information(looks: Looks, case: Case, snr: Floats) -> Floats:
    """Fisher information about ln s of each look: the mean square of the score, by quadrature over the detections."""
    n, t, size = looks.pulses, looks.threshold, len(looks)
    mean = n * (1.0 + snr)
    spread = np.sqrt(n * (1.0 + 2.0 * snr) + (n * snr) ** 2 / case.shapes(n))
    top = np.maximum(t, mean) + 45.0 * np.maximum(spread, 1.0)
    # Panels grow with distance from the threshold: the density may be much narrower than its tail.
    edges = t[:, None] + (top - t)[:, None] * (np.arange(_PANELS + 1) / _PANELS) ** 2
    half = 0.5 * np.diff(edges, axis=1)
    z = edges[:, :-1, None] + half[:, :, None] * (_NODES + 1.0)
    each = np.repeat(np.arange(size), z[0].size)
    one = Windows.groups(np.ones(size + len(each), np.int64))
    seen = looks.take(each)
    threshold, alpha, pulses = (np.concatenate([getattr(looks, c), getattr(seen, c)]) for c in _COLUMNS)
    kind = np.repeat(np.array([MISS, DETECTION], np.int8), [size, len(each)])
    both = Looks(kind, np.concatenate([np.zeros(size), z.reshape(-1)]), threshold, alpha, pulses)
    value, slope, _ = log_likelihood(both, one, case, np.concatenate([snr, snr[each]]) / both.alpha)
    weighted = np.exp(value) * slope * slope
    density = weighted[size:].reshape(size, _PANELS, -1)
    return np.asarray(weighted[:size] + (half * (density @ _WEIGHTS)).sum(axis=1))
