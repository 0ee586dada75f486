"""What no estimator can beat: Cramer-Rao bounds of one block and of a track."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.arrays.geometry import ArrayGeometry

Array = NDArray[np.float64]


def crb(geometry: ArrayGeometry, bearing_rad: ArrayLike, power: ArrayLike, noise: float, snapshots: int) -> Array:
    """Stochastic Cramer-Rao bound (N, N), rad^2, unstructured source covariance (`power` (N,) or (N, N))."""
    raise NotImplementedError


def uncorrelated_crb(
    geometry: ArrayGeometry, bearing_rad: ArrayLike, power: ArrayLike, noise: float, snapshots: int
) -> Array:
    """Bound (N, N), rad^2, when the sources are known to be uncorrelated; finite at crossings in the centroid only."""
    raise NotImplementedError


def posterior_crb(
    geometry: ArrayGeometry,
    bearing_rad: ArrayLike,  # (T, N) at every snapshot
    power: ArrayLike,
    noise: float,
    *,
    process_variance: float,
    start_bearing_sigma_rad: float,
    start_rate_sigma_rad: float,
) -> Array:
    """Variance (T, N), rad^2, of the best tracker's bearings at every snapshot."""
    raise NotImplementedError


def beam_width(geometry: ArrayGeometry, bearing_rad: float = 0.0) -> float:
    """Half-power width of the beam steered to a bearing, rad."""
    raise NotImplementedError
