"""In which frame a bearing is shown: that of the array, or clockwise from north."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.angles import wrapped
from rangeeval.model import SensorArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Frame:
    """From bearings of the array (x towards y) to those shown, and back.

    A compass bearing is that of the x axis (`heading_rad`) plus, where y lies to the right of x, or minus, where it
    lies to the left, the bearing of the array.
    """

    compass: bool
    heading_rad: float = 0.0
    sense: float = 1.0

    @classmethod
    def of(cls, array: SensorArray) -> Frame:
        """The frame that `[array]` asks for."""
        return cls(
            array.bearings == "compass", math.radians(array.heading_deg), 1.0 if array.y_axis == "right" else -1.0
        )

    def shown(self, bearing_rad: ArrayLike) -> Floats:
        """Bearings as shown: 0 to 2 pi by the compass, -pi to pi of the array."""
        bearing = np.asarray(bearing_rad, dtype=np.float64)
        if not self.compass:
            return wrapped(bearing)
        return np.asarray(np.mod(self.heading_rad + self.sense * bearing, 2 * math.pi))

    def of_compass(self, compass_rad: ArrayLike) -> Floats:
        """Bearings of the array from those clockwise from north."""
        return wrapped(self.sense * (np.asarray(compass_rad, dtype=np.float64) - self.heading_rad))
