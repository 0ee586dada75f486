"""Where the sensors are, what each of them hears, and what such an array can and cannot tell."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.arrays.patterns import OMNIDIRECTIONAL, ElementPattern

Array = NDArray[np.float64]

_STRAIGHT = 1e-6  # sideways spread over length below which the sensors stand in a line
_EVEN = 1e-6  # spread of the spacings over their mean below which they are equal


@dataclass(frozen=True, eq=False)
class ArrayGeometry:
    """The sensors of one array, the frequencies it is used at and the speed of the wave.

    Raises ValueError for shapes, frequencies or speeds that cannot be.

    Parameters
    ----------
    sensor_position_m : (sensors, 2 or 3), in the array's frame, from a phase reference near the array.
    frequency_hz : one frequency, or one a bin for broad band.
    propagation_speed_m_s : of the wave along its path.
    pattern : gain of one element over the angle from its facing.
    facing_rad : (sensors,) bearing each element faces; by default 0 for a line and outwards from the centre for others.
    elevation_rad : of the plane of directions searched, for planar and three-dimensional arrays.
    sector_rad : lowest and highest bearing where sources can be; by default all that the array can tell apart.
    """

    sensor_position_m: Array
    frequency_hz: Array
    propagation_speed_m_s: float
    pattern: ElementPattern = OMNIDIRECTIONAL
    facing_rad: Array | None = None
    elevation_rad: float = 0.0
    sector_rad: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        position = np.array(self.sensor_position_m, dtype=np.float64)
        if position.ndim != 2 or position.shape[1] not in (2, 3) or position.shape[0] < 2:
            raise ValueError(
                f"sensor_position_m has shape {position.shape}; give 2 or more sensors x 2 or 3 coordinates"
            )
        if not np.isfinite(position).all():
            raise ValueError(f"the position of sensor {_first(~np.isfinite(position).all(axis=1))} is not a number")
        if position.shape[1] == 2:
            position = np.column_stack([position, np.zeros(len(position))])
        if not np.ptp(position, axis=0).any():
            raise ValueError("all sensors stand at the same place; bearings need a baseline")
        frequency = np.atleast_1d(np.array(self.frequency_hz, dtype=np.float64))
        if frequency.ndim != 1 or not (np.isfinite(frequency) & (frequency > 0)).all():
            raise ValueError(f"frequency_hz is {self.frequency_hz}; give one positive frequency, or one a bin")
        if not (math.isfinite(self.propagation_speed_m_s) and self.propagation_speed_m_s > 0):
            raise ValueError(f"propagation_speed_m_s is {self.propagation_speed_m_s}; give a positive speed")
        sensors = len(position)
        object.__setattr__(self, "sensor_position_m", position)
        object.__setattr__(self, "frequency_hz", frequency)
        if self.facing_rad is None:
            away = position[:, :2] - position[:, :2].mean(axis=0)
            facing = np.zeros(sensors) if self.linear else np.arctan2(away[:, 1], away[:, 0])
        else:
            facing = np.array(np.broadcast_to(np.asarray(self.facing_rad, dtype=np.float64), (sensors,)))
        object.__setattr__(self, "facing_rad", facing)
        gains = self.pattern.gains
        if gains is not None and gains.shape[0] not in (1, sensors):
            raise ValueError(
                f"the pattern has {gains.shape[0]} tables for {sensors} sensors; give one, or one a sensor"
            )
        low, high = self.sector_rad or ((-math.pi / 2, math.pi / 2) if self.linear else (-math.pi, math.pi))
        if not (math.isfinite(low) and math.isfinite(high) and 0 < high - low <= 2 * math.pi + 1e-12):
            raise ValueError(f"the sector is {low} to {high} rad; give its lower, then its upper end, at most a circle")
        object.__setattr__(self, "sector_rad", (float(low), float(high)))
        for kept in (position, frequency, facing):
            kept.setflags(write=False)

    @property
    def sensors(self) -> int:
        """How many."""
        return len(self.sensor_position_m)

    @property
    def bins(self) -> int:
        """Frequency bins; 1 in narrow band."""
        return len(self.frequency_hz)

    @property
    def wavenumber_rad_m(self) -> Array:
        """2 pi / wavelength of each bin."""
        found: Array = 2 * np.pi * self.frequency_hz / self.propagation_speed_m_s
        return found

    @property
    def wavelength_m(self) -> Array:
        """Of each bin."""
        found: Array = self.propagation_speed_m_s / self.frequency_hz
        return found

    @cached_property
    def _axis(self) -> tuple[Array, float]:
        """Direction of the longest spread, and the spread sideways over it."""
        _, spread, direction = np.linalg.svd(self.sensor_position_m - self.sensor_position_m.mean(axis=0))
        axis = direction[0] * np.sign(direction[0][np.argmax(np.abs(direction[0]))])
        return axis, float(spread[1] / spread[0]) if len(spread) > 1 else 0.0

    @property
    def linear(self) -> bool:
        """Whether all sensors stand in one straight line."""
        return self._axis[1] < _STRAIGHT

    @property
    def full_circle(self) -> bool:
        """Whether the sector is the whole circle, so that bearings wrap."""
        low, high = self.sector
        return high - low > 2 * math.pi - 1e-9

    @property
    def sector(self) -> tuple[float, float]:
        """Lowest and highest bearing where sources can be, rad."""
        assert self.sector_rad is not None
        return self.sector_rad

    @property
    def along_m(self) -> Array:
        """Place of each sensor along a line array from its first sensor; ValueError for another array."""
        if not self.linear:
            raise ValueError("the sensors do not stand in a line")
        along: Array = (self.sensor_position_m - self.sensor_position_m[0]) @ self._axis[0]
        return along

    @property
    def spacing_m(self) -> float | None:
        """Of an evenly spaced line array in the order of its sensors (negative when they run backwards), else None."""
        if not self.linear:
            return None
        steps = np.diff(self.along_m)
        even = np.ptp(steps) <= _EVEN * abs(steps.mean()) and steps.mean() != 0
        return float(steps.mean()) if even else None

    def without(self, sensors: ArrayLike) -> ArrayGeometry:
        """The same array with some sensors left out (their indices, or a mask): dead ones, for instance."""
        keep = np.ones(self.sensors, bool)
        keep[np.asarray(sensors)] = False
        if keep.sum() < 2:
            raise ValueError(f"{int(keep.sum())} sensors are left of {self.sensors}; bearings need 2 or more")
        pattern, gains = self.pattern, self.pattern.gains
        if gains is not None and len(gains) > 1:
            pattern = replace(pattern, gains=gains[keep])
        assert self.facing_rad is not None
        return ArrayGeometry(
            self.sensor_position_m[keep], self.frequency_hz, self.propagation_speed_m_s, pattern,
            self.facing_rad[keep], self.elevation_rad, self.sector_rad,
        )  # fmt: skip

    def centred(self) -> ArrayGeometry:
        """The same array with its phase reference in its middle, for positions given as map coordinates."""
        middle = self.sensor_position_m - self.sensor_position_m.mean(axis=0)
        return replace(self, sensor_position_m=middle)


def line(
    sensors: int,
    spacing_m: float,
    frequency_hz: ArrayLike,
    propagation_speed_m_s: float,
    *,
    pattern: ElementPattern = OMNIDIRECTIONAL,
) -> ArrayGeometry:
    """An evenly spaced line array along y, its first sensor at the origin."""
    along = spacing_m * np.arange(sensors)
    position = np.column_stack([np.zeros(sensors), along])
    return ArrayGeometry(position, np.atleast_1d(frequency_hz), propagation_speed_m_s, pattern)


def cylinder(
    radius_m: float,
    sensor_bearing_rad: ArrayLike,
    frequency_hz: ArrayLike,
    propagation_speed_m_s: float,
    *,
    height_m: ArrayLike = 0.0,
    pattern: ElementPattern = OMNIDIRECTIONAL,
    sector_rad: tuple[float, float] | None = None,
) -> ArrayGeometry:
    """Staves on a cylinder (or an arc of it), each facing outwards at its own bearing."""
    phi = np.asarray(sensor_bearing_rad, dtype=np.float64)
    height = np.broadcast_to(np.asarray(height_m, dtype=np.float64), phi.shape)
    position = np.column_stack([radius_m * np.cos(phi), radius_m * np.sin(phi), height])
    return ArrayGeometry(
        position, np.atleast_1d(frequency_hz), propagation_speed_m_s, pattern, phi, sector_rad=sector_rad
    )


def _first(mask: Any) -> int:
    return int(np.argmax(mask))
