"""Range, azimuth and elevation of a position and their rates, and the way back. North, up, east; radians; metres."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def polar(position_m: ArrayLike) -> Floats:
    """Range (m), azimuth clockwise from north in [0, 2 pi) and elevation (rad), (..., 3), of positions (..., 3)."""
    north, up, east = _parts(position_m)
    across = np.hypot(north, east)
    return np.stack([np.hypot(across, up), np.mod(np.arctan2(east, north), 2 * np.pi), np.arctan2(up, across)], axis=-1)


def polar_rates(position_m: ArrayLike, velocity_m_s: ArrayLike) -> Floats:
    """Rates (..., 3) of range (m/s), azimuth and elevation (rad/s); infinite azimuth rate at the zenith becomes NaN."""
    north, up, east = _parts(position_m)
    vn, vu, ve = _parts(velocity_m_s)
    across2 = north**2 + east**2
    across, distance = np.sqrt(across2), np.sqrt(across2 + up**2)
    outward = north * vn + east * ve
    with np.errstate(divide="ignore", invalid="ignore"):
        rates = np.stack(
            [
                (outward + up * vu) / distance,
                (north * ve - east * vn) / across2,
                (across2 * vu - up * outward) / (across * distance**2),
            ],
            axis=-1,
        )
    return np.where(np.isfinite(rates), rates, np.nan)


def cartesian(range_m: ArrayLike, azimuth_rad: ArrayLike, elevation_rad: ArrayLike) -> Floats:
    """Positions (..., 3) north, up, east in m."""
    distance, az, el = np.broadcast_arrays(
        *(np.asarray(v, dtype=np.float64) for v in (range_m, azimuth_rad, elevation_rad))
    )
    across = distance * np.cos(el)
    return np.stack([across * np.cos(az), distance * np.sin(el), across * np.sin(az)], axis=-1)


def _parts(vector: ArrayLike) -> tuple[Floats, Floats, Floats]:
    v = np.asarray(vector, dtype=np.float64)
    return v[..., 0], v[..., 1], v[..., 2]
