"""Facts about an array and its snapshots that spoil bearings: what is wrong and where, for the caller to word."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rangeeval.arrays.bounds import beam_width
from rangeeval.arrays.geometry import ArrayGeometry
from rangeeval.arrays.manifold import steering
from rangeeval.arrays.spectra import covariance, signal_subspace

Complex = NDArray[np.complex128]

_WEAK = 0.01  # of the median power: 20 dB down
_SAME = 0.995  # of |a|^2: two bearings that look the same, -0.04 dB
_TOLD = 0.9  # of |a|^2: the mirrored manifold fits no better than this, so that a mirrored recording shows
_STUCK = 0.01  # share of samples at one extreme value that noise does not explain
_BETTER = 0.5  # misfit of the mirrored data over that of the data as recorded: below, they are mirrored
_PER_BEAM, _LEAST, _MOST = 15, 181, 2881  # bearings searched: fine enough that a peak between them is above _SAME
_ENDFIRE = math.radians(80.0)


@dataclass(frozen=True, eq=False)
class ArrayHealth:
    """What was found, sensors by their index from 0.

    dead : silent, constant or never a number; weak : more than 20 dB below the median power; clipped : many samples at
    one extreme value; missing : (K,) snapshots that hold a NaN in a sensor that is not dead.
    """

    dead: tuple[int, ...]
    weak: tuple[int, ...]
    clipped: tuple[int, ...]
    missing: NDArray[np.bool_]


@dataclass(frozen=True)
class Ambiguity:
    """What the geometry cannot tell apart within its sector.

    level_db : highest response to a source outside the main beam, 0 dB being the source's own. aliased : two bearings
    look the same. half_wavelengths : widest spacing of neighbours over half the shortest wavelength; above 1 a line
    array can alias. mirror_level_db : how well the best bearing fits a conjugated recording. tells_mirror : no bearing
    fits it, so that it shows.
    """

    level_db: float
    aliased: bool
    half_wavelengths: float
    tells_mirror: bool
    mirror_level_db: float


def check_snapshots(snapshots: Complex) -> ArrayHealth:
    """Look at every sensor of snapshots (K, M) or (K, bins, M)."""
    x = np.asarray(snapshots, dtype=np.complex128)
    if x.ndim not in (2, 3) or not x.size:
        raise ValueError(f"snapshots of shape {x.shape}; give (snapshots, sensors) or (snapshots, bins, sensors)")
    x = x.reshape(len(x), -1, x.shape[-1])
    finite = np.isfinite(x)
    clean = np.where(finite, x, 0.0)
    count = np.maximum(finite.sum(axis=(0, 1)), 1)
    power = (np.abs(clean) ** 2).sum(axis=(0, 1)) / count
    mean = clean.sum(axis=0) / np.maximum(finite.sum(axis=0), 1)
    spread = (np.abs(np.where(finite, x - mean, 0.0)) ** 2).sum(axis=(0, 1)) / count
    dead = ~finite.any(axis=(0, 1)) | (spread <= 1e-24 * np.maximum(power, power.max()))
    level = np.median(power[~dead]) if (~dead).any() else 0.0
    weak = ~dead & (power < _WEAK * level)
    clipped = np.array([not dead[m] and _is_clipped(x[:, :, m]) for m in range(x.shape[2])])
    missing = np.asarray(~finite[:, :, ~dead].all(axis=(1, 2)))
    return ArrayHealth(_indices(dead), _indices(weak), _indices(clipped), missing)


def check_geometry(geometry: ArrayGeometry) -> Ambiguity:
    """Search the sector for bearings the array confuses, and for mirror images of its responses."""
    low, high = geometry.sector
    if geometry.linear:  # nearer to endfire the two ends of any half-wavelength line look alike
        low, high = max(low, -_ENDFIRE), min(high, _ENDFIRE)
    grid = _grid(geometry, low, high)
    a = steering(geometry, grid)[0].reshape(geometry.bins, geometry.sensors, -1)
    norm = (np.abs(a) ** 2).sum(axis=1)
    heard = norm.mean(axis=0) > 1e-6 * norm.mean(axis=0).max()
    a, grid, norm = a[:, :, heard], grid[heard], norm[:, heard]
    match = _match(a, norm, a)
    apart = np.abs(grid[:, None] - grid[None, :])
    if geometry.full_circle:
        apart = np.minimum(apart, 2 * math.pi - apart)
    widths = np.array([beam_width(geometry, b) for b in grid[:: max(1, grid.size // 16)]])
    reach = 1.5 * np.interp(grid, grid[:: max(1, grid.size // 16)], widths)
    outside = np.where(apart > np.maximum(reach[:, None], reach[None, :]), match, 0.0)
    level = float(outside.max(initial=0.0))
    mirror = float(np.median(_match(a, norm, a.conj()).max(axis=0)))
    return Ambiguity(_db(level), level > _SAME, _half_wavelengths(geometry), mirror < _TOLD, _db(mirror))


def mirrored(geometry: ArrayGeometry, snapshots: Complex, sources: int) -> bool | None:
    """Whether the snapshots fit the array better conjugated: the recorder's sign of the phase was the other one.

    None when this array cannot tell (a line; any array without element patterns over the whole circle), or when the
    data fit both ways alike.
    """
    if not check_geometry(geometry).tells_mirror:
        return None
    e = covariance(snapshots)
    e = e if e.ndim == 3 else e[None]
    a = steering(geometry, _grid(geometry, *geometry.sector))[0].reshape(geometry.bins, geometry.sensors, -1)
    as_is, turned = _misfit(a, e, sources), _misfit(a, e.conj(), sources)
    if turned < _BETTER * as_is:
        return True
    return False if as_is < _BETTER * turned else None


def _grid(geometry: ArrayGeometry, low: float, high: float) -> NDArray[np.float64]:
    """Bearings between two, close enough for the array's beam."""
    count = _PER_BEAM * (high - low) / beam_width(geometry, 0.5 * (low + high))
    return np.linspace(low, high, int(min(max(count, _LEAST), _MOST)), endpoint=not geometry.full_circle)


def _misfit(a: Complex, e: Complex, sources: int) -> float:
    """Sum of the deepest dips of the MUSIC null spectrum, one a source: 0 when all sources lie on the manifold."""
    basis = signal_subspace(e, sources)
    norm = np.maximum((np.abs(a) ** 2).sum(axis=1), 1e-300)
    null = 1.0 - ((np.abs(basis.conj().swapaxes(1, 2) @ a) ** 2).sum(axis=1) / norm).mean(axis=0)
    inner = np.pad(null, 1, "edge")
    dips = np.sort(null[(null <= inner[:-2]) & (null <= inner[2:])])
    # A source without a dip of its own counts as one that fits nowhere.
    return float(dips[:sources].sum() + max(0, sources - dips.size))


def _match(a: Complex, norm: NDArray[np.float64], other: Complex) -> NDArray[np.float64]:
    """|a^H b|^2 / |a|^2 |b|^2, mean over bins: (bearings, bearings)."""
    product = np.abs(a.conj().swapaxes(1, 2) @ other) ** 2
    found: NDArray[np.float64] = (product / (norm[:, :, None] * norm[:, None, :])).mean(axis=0)
    return found


def _half_wavelengths(geometry: ArrayGeometry) -> float:
    place = geometry.sensor_position_m
    apart = np.linalg.norm(place[:, None] - place[None, :], axis=2)
    np.fill_diagonal(apart, np.inf)
    return float(apart.min(axis=1).max() / (geometry.wavelength_m.min() / 2))


def _is_clipped(x: Complex) -> bool:
    """Whether real or imaginary parts stand at their own extremes more often than once in a while."""
    for part in (x.real, x.imag):
        values = part[np.isfinite(part)]
        if values.size < 20:
            continue
        top = np.abs(values).max()
        if top > 0 and (np.abs(values) >= top * (1 - 1e-9)).sum() > max(2, _STUCK * values.size):
            return True
    return False


def _indices(mask: NDArray[np.bool_]) -> tuple[int, ...]:
    return tuple(int(i) for i in np.flatnonzero(mask))


def _db(level: float) -> float:
    return 10.0 * math.log10(level) if level > 0 else -math.inf
