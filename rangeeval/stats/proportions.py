"""Intervals of a proportion from counts: Wilson's (default) and the exact one of Clopper and Pearson."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaincinv, ndtri

Floats = NDArray[np.float64]


def wilson_interval(k: ArrayLike, n: ArrayLike, confidence: float = 0.95) -> tuple[Floats, Floats]:
    """Wilson's interval of k successes in n trials; (0, 1) where n is 0.

    References
    ----------
    Wilson (1927), J. Am. Stat. Assoc. 22; recommended by Brown, Cai and DasGupta (2001), Stat. Sci. 16.
    """
    hits, trials = np.asarray(k, np.float64), np.asarray(n, np.float64)
    z = float(ndtri(0.5 + confidence / 2))
    size = np.maximum(trials, 1.0)
    p = hits / size
    spread = 1.0 + z * z / size
    centre = (p + z * z / (2.0 * size)) / spread
    half = z * np.sqrt(p * (1.0 - p) / size + z * z / (4.0 * size * size)) / spread
    low = np.where(hits <= 0, 0.0, centre - half)
    high = np.where(hits >= trials, 1.0, centre + half)
    return np.where(trials > 0, low, 0.0), np.where(trials > 0, high, 1.0)


def exact_interval(k: ArrayLike, n: ArrayLike, confidence: float = 0.95) -> tuple[Floats, Floats]:
    """The interval of Clopper and Pearson (1934), Biometrika 26: never covers too little; (0, 1) where n is 0."""
    hits, trials = np.asarray(k, np.float64), np.asarray(n, np.float64)
    tail = (1.0 - confidence) / 2.0
    low = np.where(hits > 0, betaincinv(np.maximum(hits, 1.0), trials - hits + 1.0, tail), 0.0)
    high = np.where(hits < trials, betaincinv(hits + 1.0, np.maximum(trials - hits, 1.0), 1.0 - tail), 1.0)
    return low, high
