"""Facts about an array and its snapshots that spoil bearings: what is wrong and where, for the caller to word."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rangeeval.arrays.geometry import ArrayGeometry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ArrayHealth:
    """What was found. Sensors by index from 0.

    dead : silent, constant or not-finite sensors; weak : power more than 20 dB below the median (not dead);
    clipped : sensors with a share of samples at one extreme value; missing : (K,) snapshots with a NaN in a live sensor.
    """

    dead: tuple[int, ...]
    weak: tuple[int, ...]
    clipped: tuple[int, ...]
    missing: NDArray[np.bool_]


@dataclass(frozen=True)
class Ambiguity:
    """What the geometry cannot tell apart within its sector.

    level_db : highest response (0 dB: the same as the source's own) outside the main beam, over all directions.
    aliased : above -0.5 dB: two bearings look the same. half_wavelengths : widest neighbour spacing over lambda/2.
    tells_mirror : a conjugated recording could be told; mirror_level_db : how well the mirrored manifold fits.
    """

    level_db: float
    aliased: bool
    half_wavelengths: float
    tells_mirror: bool
    mirror_level_db: float


def check_snapshots(snapshots: NDArray[np.complex128]) -> ArrayHealth:
    """(K, M) or (K, bins, M)."""
    raise NotImplementedError


def check_geometry(geometry: ArrayGeometry) -> Ambiguity:
    """Highest ambiguity in the sector, and whether mirrored data would show."""
    raise NotImplementedError


def mirrored(geometry: ArrayGeometry, snapshots: NDArray[np.complex128], sources: int) -> bool | None:
    """Whether the snapshots fit better conjugated; None when this array cannot tell or the data do not say."""
    raise NotImplementedError
