"""Units: how the end of a column's name says its unit, and in which unit people like to see a stored number.

Everything is stored and computed in SI. A log may use another unit by another ending of the column's name
(`range_km`, `elevation_mrad`, `upper_x_accel_g`); it is converted once, on reading, and nowhere else. On the way
out `shown` picks the unit of the reader.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Unit:
    """A unit a column's name can end in: stored value = `to_si(written value)`."""

    ending: str
    si: str
    factor: float = 1.0
    transform: Callable[[Array], Array] | None = None

    def to_si(self, values: Array) -> Array:
        """Convert written values to the stored unit (shape kept)."""
        if self.transform is not None:
            return self.transform(values)
        return values if self.factor == 1.0 else values * self.factor


def _from_db(values: Array) -> Array:
    return np.asarray(10.0 ** (values / 10.0))


def _to_db(values: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(10.0 * np.log10(values))


_DEGREE = math.pi / 180.0
STANDARD_GRAVITY = 9.80665

# One row a unit: ending, stored ending, factor. The foot is the international one, the mile the nautical one,
# the mil NATO's (6400 to the circle; a milliradian is `mrad`).
_LINEAR: tuple[tuple[str, str, float], ...] = (
    ("m", "m", 1.0), ("km", "m", 1e3), ("cm", "m", 1e-2), ("mm", "m", 1e-3),
    ("ft", "m", 0.3048), ("kft", "m", 304.8), ("yd", "m", 0.9144), ("nmi", "m", 1852.0),
    ("rad", "rad", 1.0), ("mrad", "rad", 1e-3), ("deg", "rad", _DEGREE), ("arcmin", "rad", _DEGREE / 60),
    ("arcsec", "rad", _DEGREE / 3600), ("mil", "rad", 2 * math.pi / 6400),
    ("s", "s", 1.0), ("ms", "s", 1e-3), ("us", "s", 1e-6), ("ns", "s", 1e-9), ("min", "s", 60.0), ("h", "s", 3600.0),
    ("m_s2", "m_s2", 1.0), ("g", "m_s2", STANDARD_GRAVITY), ("mg", "m_s2", STANDARD_GRAVITY * 1e-3),
    ("ft_s2", "m_s2", 0.3048),
    ("hz", "hz", 1.0), ("khz", "hz", 1e3), ("mhz", "hz", 1e6), ("ghz", "hz", 1e9),
    ("m_s", "m_s", 1.0), ("km_h", "m_s", 1 / 3.6), ("kn", "m_s", 1852 / 3600),
    ("db", "db", 1.0), ("dbm", "dbm", 1.0), ("per_m2", "per_m2", 1.0),
)  # fmt: skip

UNITS: dict[str, tuple[Unit, ...]] = {}
for _ending, _si, _factor in _LINEAR:
    UNITS.setdefault(_si, ())
    UNITS[_si] += (Unit(_ending, _si, _factor),)
UNITS["db"] += (Unit("linear", "db", transform=_to_db),)
# A pure number (a ratio of powers): no ending, or in decibels.
UNITS["1"] = (Unit("", "1"), Unit("linear", "1"), Unit("db", "1", transform=_from_db))
UNITS["per_m2"] += (Unit("per_m2_db", "per_m2", transform=_from_db),)
UNITS["deg"] = (  # geodetic latitude and longitude stay in degrees, as the contract names them
    Unit("deg", "deg"),
    Unit("rad", "deg", 1 / _DEGREE),
)


def spellings(column: str, si: str) -> dict[str, Unit]:
    """Every name a stored column may be written under, and the unit that name declares.

    >>> sorted(spellings("range_m", "m"))[:3]
    ['range_cm', 'range_ft', 'range_kft']
    """
    units = UNITS.get(si)
    if units is None:
        return {column: Unit("", si)}
    stem = column if si == "1" else column.removesuffix(f"_{si}")
    return {f"{stem}_{unit.ending}" if unit.ending else stem: unit for unit in units}


@dataclass(frozen=True)
class Shown:
    """How a stored number is shown: `shown value = scale * stored value` (or its decibels), and the unit's name."""

    unit: str
    scale: float = 1.0
    decibel: bool = False

    def value(self, stored: float) -> float:
        """The number to show for one stored number (NaN stays NaN)."""
        if not self.decibel:
            return stored * self.scale
        return 10.0 * math.log10(stored) if stored > 0 else math.nan


_ARCMIN = Shown("arcmin", 60.0 / _DEGREE)
_DEGREES = Shown("°", 1 / _DEGREE)
_IN_DEGREES = ("bearing", "beam")  # quantities whose angles are read in degrees
_BY_UNIT: dict[str, Shown] = {
    "m": Shown("m"),
    "rad": _ARCMIN,
    "m^2": Shown("dBsm", decibel=True),
    "dB": Shown("dB"),
    "1": Shown(""),
}
_OF_VARIABLE: dict[str, Shown] = {
    "range": Shown("km", 1e-3),
    "azimuth": _DEGREES,
    "elevation": _DEGREES,
    "aspect": _DEGREES,
    "snr": Shown("dB"),
    "time": Shown("s"),
}


def shown(unit: str, quantity: str = "") -> Shown:
    """The unit in which people read a quantity stored in `unit` (arcmin for rad, ° for a bearing, dBsm for m^2)."""
    if unit == "rad" and quantity.startswith(_IN_DEGREES):
        return _DEGREES
    return _BY_UNIT.get(unit, Shown(unit))


def shown_variable(variable: str) -> Shown:
    """The unit in which people read the edges of bins of `variable` (km for range)."""
    return _OF_VARIABLE.get(variable, Shown(""))
