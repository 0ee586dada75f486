"""Gravity where the radar stands: the normal gravity of the WGS 84 ellipsoid, and its change with height."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

STANDARD_GRAVITY_M_S2 = 9.80665

_EQUATOR_M_S2 = 9.7803253359
_SOMIGLIANA_K = 0.00193185265241
_ECCENTRICITY_SQUARED = 0.00669437999013
_SEMI_MAJOR_M = 6378137.0
_FLATTENING = 1 / 298.257223563
_CENTRIFUGAL_RATIO = 0.00344978650684


def normal_gravity(latitude_rad: ArrayLike, height_m: ArrayLike = 0.0) -> FloatArray:
    """Gravity (m/s^2) at a geodetic latitude and a height above the ellipsoid; a surveyed local value is better still.

    References
    ----------
    Somigliana's closed formula with the WGS 84 constants, and its second-order change with height: NIMA TR8350.2,
    section 4.
    """
    s2 = np.sin(np.asarray(latitude_rad, dtype=np.float64)) ** 2
    h = np.asarray(height_m, dtype=np.float64)
    surface = _EQUATOR_M_S2 * (1 + _SOMIGLIANA_K * s2) / np.sqrt(1 - _ECCENTRICITY_SQUARED * s2)
    linear = 2 / _SEMI_MAJOR_M * (1 + _FLATTENING + _CENTRIFUGAL_RATIO - 2 * _FLATTENING * s2)
    gravity: FloatArray = surface * (1 - linear * h + 3 * h**2 / _SEMI_MAJOR_M**2)
    return gravity
