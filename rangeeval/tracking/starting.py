"""Starting a track from its first one, two or three plots, as compiled kernels.

References
----------
Divided differences of converted measurements: Jung (1999), eq 17 (position, velocity, acceleration), with the
covariance that follows from the same weights.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.compiled import compiled_borrowing, compiled_inside
from rangeeval.tracking.layout import DENSITY, FILTERED, FILTERED_P, NU, PRODUCT, WIDTH, P, R
from rangeeval.tracking.motion import cross
from rangeeval.tracking.polar import convert

FloatArray = NDArray[np.float64]


@compiled_inside
def start(
    own: FloatArray, count: int, plots: FloatArray, height_sigma: float, quadratic: bool, speed: float, prior: float,
    third: bool,
) -> None:  # fmt: skip
    """Position, velocity, third block and their covariance from `count` plots, into FILTERED.

    `plots` (3, 7), oldest first: time, range, azimuth, elevation and their variances. What they do not show is zero
    with the prior sigmas `speed` and `prior`; the third block is the acceleration that three plots show, or with
    `third` false unknown too. `height_sigma` above 0: elevation is not known, the height has this sigma.
    """
    weights = PRODUCT  # (9): of position, velocity, acceleration (rows) on the plots
    for c in range(9):
        own[weights + c] = 0.0
    for c in range(DENSITY):
        own[FILTERED + c] = 0.0
    own[weights + count - 1] = 1.0
    if count > 1:
        h = plots[count - 1, 0] - plots[count - 2, 0]
        own[weights + 3 + count - 1] = 1.0 / h
        own[weights + 3 + count - 2] = -1.0 / h
        if count > 2:
            g = plots[1, 0] - plots[0, 0]
            bent = (2.0 / (g * (h + g)), -2.0 / (h * g), 2.0 / (h * (h + g)))
            for n in range(3):
                own[weights + 3 + n] += 0.5 * h * bent[n] if quadratic else 0.0
                own[weights + 6 + n] = bent[n] if third else 0.0
    for n in range(count):
        convert(own, plots[n, 1], plots[n, 2], plots[n, 3], plots[n, 4], plots[n, 5], plots[n, 6])
        if height_sigma > 0.0:
            own[R + 8] = height_sigma * height_sigma
        for i in range(3):
            for a in range(3):
                w = own[weights + 3 * i + n]
                own[FILTERED + 3 * i + a] += w * own[NU + a]
                for k in range(3):
                    for b in range(3):
                        p = FILTERED_P + 27 * i + 9 * a + 3 * k + b
                        own[p] += w * own[weights + 3 * k + n] * own[R + 3 * a + b]
    for a in range(3):
        if count < 2:
            own[FILTERED_P + 30 + 10 * a] = speed * speed
        if count < 3 or not third:
            own[FILTERED_P + 60 + 10 * a] = prior * prior


@compiled_inside
def turn_from_acceleration(own: FloatArray, prior: float) -> None:
    """Replace the acceleration in FILTERED by the turn rate v x a / |v|^2, in place.

    The part of the turn rate along the velocity, which no motion shows, gets its `prior` sigma. With no speed the turn
    rate is zero with that prior.
    """
    x, p = FILTERED, FILTERED_P
    cross_v, cross_a, rate = PRODUCT, PRODUCT + 9, PRODUCT + 18
    derivative, times_p = PRODUCT + 21, PRODUCT + 39  # (3, 6) by velocity and acceleration; (3, 9) that times P
    cross(own, cross_v + 0, x + 3)
    cross(own, cross_a + 0, x + 6)
    square = own[x + 3] * own[x + 3] + own[x + 4] * own[x + 4] + own[x + 5] * own[x + 5]
    one = 1.0 / square if square > 0.0 else 0.0
    for i in range(3):
        total = 0.0
        for c in range(3):
            total += own[cross_v + 3 * i + c] * own[x + 6 + c] * one
        for c in range(3):
            bent = own[cross_a + 3 * i + c] + 2.0 * total * own[x + 3 + c]
            own[derivative + 6 * i + c] = -one * bent
            own[derivative + 6 * i + 3 + c] = one * own[cross_v + 3 * i + c]
        own[rate + i] = total
    for i in range(3):
        for c in range(9):
            total = 0.0
            for m in range(6):
                total += own[derivative + 6 * i + m] * own[p + 27 + 9 * m + c]
            own[times_p + 9 * i + c] = total
    for i in range(3):
        own[x + 6 + i] = own[rate + i]
        for k in range(6):
            own[p + 54 + 9 * i + k] = own[times_p + 9 * i + k]
            own[p + 9 * k + 6 + i] = own[times_p + 9 * i + k]
        for k in range(3):
            along = own[x + 3 + i] * own[x + 3 + k] * one if square > 0.0 else (1.0 if i == k else 0.0)
            total = prior * prior * along
            for m in range(6):
                total += own[times_p + 9 * i + 3 + m] * own[derivative + 6 * k + m]
            own[p + 60 + 9 * i + k] = total


@compiled_borrowing
def _started(own: FloatArray, plots: FloatArray, quadratic: bool) -> None:
    start(own, 3, plots, 0.0, quadratic, 0.0, 0.0, True)


def three_point(
    time_s: ArrayLike, polar: ArrayLike, sigma: ArrayLike, *, quadratic: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Position, velocity, acceleration (9,) and covariance (9, 9) at the newest of three plots.

    `time_s` (3,), increasing; `polar` (3, 3) range, azimuth, elevation; `sigma` (3,) or (3, 3).
    """
    plots = np.empty((3, 7))
    plots[:, 0], plots[:, 1:4], plots[:, 4:] = time_s, polar, np.asarray(sigma, dtype=np.float64) ** 2
    own = np.zeros(WIDTH)
    _started(own, plots, quadratic)
    density = own[FILTERED : FILTERED + DENSITY]
    return density[:P], density[P:].reshape(9, 9)
