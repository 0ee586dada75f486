"""Allan deviation: how the mean of a steady sensor wanders with the averaging time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

BIAS_INSTABILITY = 0.664  # the flat minimum of the Allan deviation over the bias instability, sqrt(2 ln 2 / pi)


def allan_deviation(values: ArrayLike, averaging: Sequence[int] | NDArray[np.integer]) -> FloatArray:
    """Overlapping Allan deviation of evenly spaced samples (n), for averages over `averaging` samples each.

    sigma^2(m) = mean of (ybar_{j+m} - ybar_j)^2 / 2 over running means of m samples. White noise falls as m^-1/2.
    Meant for steady stretches: an oscillation makes a hump. NaN where there are not two averages.

    References
    ----------
    IEEE 952, annex C, in the overlapping form.
    """
    x = np.asarray(values, dtype=np.float64)
    total = np.concatenate([[0.0], np.cumsum(x - x.mean() if x.size else x)])
    found = []
    for m in averaging:
        if m < 1 or 2 * m > x.size:
            found.append(np.nan)
            continue
        d = total[2 * m :] - 2 * total[m:-m] + total[: -2 * m]
        found.append(float(np.sqrt(np.mean(d * d) / 2) / m))
    return np.array(found)


def averaging_lengths(n: int, points: int = 40) -> NDArray[np.int64]:
    """Averaging lengths from one sample to a ninth of n (beyond: too few averages), evenly in the logarithm."""
    if n < 9:
        return np.empty(0, np.int64)
    return np.unique(np.geomspace(1, n // 9, points).astype(np.int64))


def allan_interval_freedom(n: int, m: int) -> float:
    """Equivalent degrees of freedom of the overlapping Allan variance under white noise.

    References
    ----------
    Howe, Allan and Barnes (1981), Properties of oscillator signals and measurement methods, table for white
    (frequency) noise: (3(n-1)/(2m) - 2(n-2)/n) 4 m^2/(4 m^2 + 5), n counting the samples of the integrated series.
    """
    phases = n + 1
    return float((3 * (phases - 1) / (2 * m) - 2 * (phases - 2) / phases) * 4 * m**2 / (4 * m**2 + 5))


def steady_stretch(values: ArrayLike, sigma: float, window: int, tolerance: float = 1.5) -> slice:
    """The longest stretch of evenly spaced samples (n) that hold no more than noise of `sigma`.

    The samples are looked at in windows of `window`; a window is steady when all its samples are there and their
    standard deviation is at most `tolerance` times `sigma`. An empty slice when no window is.
    """
    x = np.asarray(values, dtype=np.float64)
    count = x.size // window
    parts = x[: count * window].reshape(count, window)
    steady = parts.std(axis=1) <= tolerance * sigma  # NaN is not
    edges = np.flatnonzero(np.diff(np.concatenate([[False], steady, [False]]).astype(np.int8)))
    starts, stops = edges[::2], edges[1::2]
    if not starts.size:
        return slice(0, 0)
    best = int(np.argmax(stops - starts))
    return slice(int(starts[best]) * window, int(stops[best]) * window)
