"""Positions on the WGS 84 ellipsoid, and the north-up-east frame of a site."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

SEMI_MAJOR_M = 6378137.0
FLATTENING = 1 / 298.257223563
_ECCENTRICITY_SQUARED = FLATTENING * (2 - FLATTENING)
_SECOND_SQUARED = _ECCENTRICITY_SQUARED / (1 - _ECCENTRICITY_SQUARED)


def earth_fixed(latitude_rad: ArrayLike, longitude_rad: ArrayLike, height_m: ArrayLike) -> FloatArray:
    """Earth-centred, earth-fixed position (..., 3) in m of a geodetic one. NIMA TR8350.2."""
    lat, lon, h = np.broadcast_arrays(
        *(np.asarray(v, dtype=np.float64) for v in (latitude_rad, longitude_rad, height_m))
    )
    normal = SEMI_MAJOR_M / np.sqrt(1 - _ECCENTRICITY_SQUARED * np.sin(lat) ** 2)
    across = (normal + h) * np.cos(lat)
    along = (normal * (1 - _ECCENTRICITY_SQUARED) + h) * np.sin(lat)
    return np.stack([across * np.cos(lon), across * np.sin(lon), along], axis=-1)


def north_up_east(
    latitude_rad: ArrayLike, longitude_rad: ArrayLike, height_m: ArrayLike, site: tuple[float, float, float]
) -> FloatArray:
    """Position (..., 3) in m north, up and east of a site (latitude rad, longitude rad, height m)."""
    lat, lon, _ = site
    away = earth_fixed(latitude_rad, longitude_rad, height_m) - earth_fixed(*site)
    to_site = np.array([
        [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)],
        [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)],
        [-np.sin(lon), np.cos(lon), 0.0],
    ])  # fmt: skip
    turned: FloatArray = away @ to_site.T
    return turned


def latitude_longitude(
    north_m: ArrayLike, east_m: ArrayLike, site: tuple[float, float, float]
) -> tuple[FloatArray, FloatArray]:
    """Geodetic latitude and longitude (rad) of points so far north and east in the horizontal plane of a site.

    Exact to two micrometres within 1000 km; the height above the ellipsoid of such points grows with their distance.
    Bowring, Survey Review 28 (1985), 202-206.
    """
    lat, lon, _ = site
    north, east = np.asarray(north_m, np.float64), np.asarray(east_m, np.float64)
    x, y, z = earth_fixed(*site)
    x = x - north * np.sin(lat) * np.cos(lon) - east * np.sin(lon)
    y = y - north * np.sin(lat) * np.sin(lon) + east * np.cos(lon)
    z = z + north * np.cos(lat)
    semi_minor = SEMI_MAJOR_M * (1 - FLATTENING)
    across = np.hypot(x, y)
    reduced = np.arctan2((1 - FLATTENING) * z * (1 + _SECOND_SQUARED * semi_minor / np.hypot(across, z)), across)
    latitude = np.arctan2(
        z + _SECOND_SQUARED * semi_minor * np.sin(reduced) ** 3,
        across - _ECCENTRICITY_SQUARED * SEMI_MAJOR_M * np.cos(reduced) ** 3,
    )
    return latitude, np.arctan2(y, x)
