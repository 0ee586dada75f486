"""What a tracking filter is given: the plots of one track, in the filters' own frame.

The filters work in **ENU** (x east, y north, z up, metres from the radar) and measure azimuth counter-clockwise from
x, as mathematics does. Logs measure azimuth clockwise from north. `Measurements.of_log` and the two functions
`azimuth_from_log` and `azimuth_to_log` are the only places where one becomes the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.angles import wrapped

FloatArray = NDArray[np.float64]


def azimuth_from_log(azimuth_rad: ArrayLike) -> FloatArray:
    """Azimuth counter-clockwise from east, in [-pi, pi), of one clockwise from north."""
    return wrapped(np.pi / 2 - np.asarray(azimuth_rad, dtype=np.float64))


def azimuth_to_log(azimuth_rad: ArrayLike) -> FloatArray:
    """Azimuth clockwise from north, in [0, 2 pi), of one counter-clockwise from east."""
    turned: FloatArray = np.mod(np.pi / 2 - np.asarray(azimuth_rad, dtype=np.float64), 2 * np.pi)
    return turned


@dataclass(frozen=True)
class Measurements:
    """The plots of one track, in order of time.

    Attributes
    ----------
    time_s : (n,).
    z : (n, 3), range (m), azimuth (rad, counter-clockwise from x east), elevation (rad, up). NaN is a component that
        was not measured; a row of three NaN is a missed detection: the filter predicts to its time.
    sigma : (n, 3), standard deviation of each component: m, rad, rad.
    """

    time_s: FloatArray
    z: FloatArray
    sigma: FloatArray

    def __post_init__(self) -> None:
        n = self.time_s.shape[0]
        if self.time_s.shape != (n,) or self.z.shape != (n, 3) or self.sigma.shape != (n, 3):
            raise ValueError(
                f"time has shape {self.time_s.shape}, z {self.z.shape} and sigma {self.sigma.shape}; "
                "give (n,), (n, 3), (n, 3)"
            )
        measured = np.isfinite(self.z)
        if not np.all(self.sigma[measured] > 0):
            raise ValueError("sigma of a measured component is zero, negative or missing; give a positive one")

    def __len__(self) -> int:
        return int(self.time_s.shape[0])

    @classmethod
    def of(cls, time_s: ArrayLike, z: ArrayLike, sigma: ArrayLike) -> Measurements:
        """Measurements in the filters' frame; `sigma` (3,) or (n, 3) is spread over all rows."""
        time = np.ascontiguousarray(time_s, dtype=np.float64)
        polar = np.ascontiguousarray(z, dtype=np.float64)
        spread = np.broadcast_to(np.asarray(sigma, dtype=np.float64), polar.shape)
        return cls(time, polar, np.ascontiguousarray(spread))

    @classmethod
    def of_log(
        cls,
        time_s: ArrayLike,
        range_m: ArrayLike,
        azimuth_rad: ArrayLike,
        elevation_rad: ArrayLike | None = None,
        *,
        sigma: ArrayLike,
    ) -> Measurements:
        """Measurements of a log's columns, whose azimuth is clockwise from north; without elevation they are planar."""
        distance = np.asarray(range_m, dtype=np.float64)
        up = np.full(distance.shape, np.nan) if elevation_rad is None else np.asarray(elevation_rad, dtype=np.float64)
        return cls.of(time_s, np.stack([distance, azimuth_from_log(azimuth_rad), up], -1), sigma)

    @property
    def planar(self) -> bool:
        """No plot has an elevation: the track lives in the slant plane, its height is not estimated.

        The filters then keep height, climb rate and the horizontal parts of the turn rate at exactly zero with their
        prior variance. Range and azimuth have no derivative with respect to them there, so the horizontal filter is the
        exact two-dimensional one; a weak pseudo-measurement of height would bias it instead.
        """
        return not bool(np.any(np.isfinite(self.z[:, 2])))
