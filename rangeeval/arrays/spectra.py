"""Estimates from one block of snapshots: beamformer, Capon and MUSIC spectra, MUSIC, root-MUSIC, ESPRIT, smoothing.

A covariance is (M, M), or (bins, M, M) in broad band: each bin is narrow band, and what they say is summed.

References
----------
Schmidt (1986), IEEE Trans. AP 34 (MUSIC); Barabell (1983), ICASSP (root-MUSIC); Roy and Kailath (1989), IEEE Trans.
ASSP 37 (ESPRIT); Pillai and Kwon (1989), IEEE Trans. ASSP 37 (forward-backward smoothing); Capon (1969), Proc. IEEE 57.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.arrays.counting import SourceCount, count_sources
from rangeeval.arrays.geometry import ArrayGeometry
from rangeeval.arrays.manifold import steering

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_REFINEMENTS = 5  # closed-form innovations from the top of the grid
_GRID_RAD = math.radians(0.25)
_LOADING = 1e-9  # of the mean power, so that Capon's inverse exists for few snapshots


def covariance(snapshots: ArrayLike) -> Complex:
    """Sample covariance of a block; snapshots that hold a NaN are left out.

    (K, M) gives (M, M), (K, bins, M) gives (bins, M, M). ValueError when no snapshot is left.
    """
    x = np.asarray(snapshots, dtype=np.complex128)
    if x.ndim not in (2, 3):
        raise ValueError(f"snapshots of shape {x.shape}; give (snapshots, sensors) or (snapshots, bins, sensors)")
    x = x[np.isfinite(x).all(axis=tuple(range(1, x.ndim)))]
    if not len(x):
        raise ValueError("no snapshot of the block is complete")
    found: Complex = np.einsum("k...m,k...n->...mn", x, x.conj()) / len(x)
    return found


def beamformer(geometry: ArrayGeometry, cov: Complex, bearing_rad: ArrayLike) -> Array:
    """Power of the conventional beam at each bearing, per sensor, summed over bins: a^H E a / |a|^4."""
    a, e = _stacked(geometry, cov, bearing_rad)
    norm = (np.abs(a) ** 2).sum(axis=1)
    power = np.einsum("fmb,fmn,fnb->fb", a.conj(), e, a, optimize=True).real
    found: Array = _safe(power, norm**2).sum(axis=0)
    return found


def capon(geometry: ArrayGeometry, cov: Complex, bearing_rad: ArrayLike) -> Array:
    """Minimum-variance power at each bearing, summed over bins: 1 / a^H E^-1 a."""
    a, e = _stacked(geometry, cov, bearing_rad)
    load = _LOADING * np.trace(e, axis1=1, axis2=2).real / geometry.sensors
    inside = np.linalg.solve(e + load[:, None, None] * np.eye(geometry.sensors), a)
    found: Array = _safe(np.ones(a.shape[::2]), (a.conj() * inside).sum(axis=1).real).sum(axis=0)
    return found


def music_spectrum(geometry: ArrayGeometry, cov: Complex, sources: int, bearing_rad: ArrayLike) -> Array:
    """|a|^2 / a^H Pn a at each bearing, Pn the noise projector; over bins the harmonic mean."""
    a, e = _stacked(geometry, cov, bearing_rad)
    return 1.0 / np.maximum(_null(a, signal_subspace(e, sources)), 1e-15)


def music(geometry: ArrayGeometry, cov: Complex, sources: int, *, grid_rad: float = _GRID_RAD) -> Array:
    """Bearings of the highest peaks of the MUSIC spectrum, ascending, refined between the points of the grid.

    There may be fewer peaks than sources: two sources within a beam width often leave one.
    """
    low, high = geometry.sector
    count = max(8, math.ceil((high - low) / grid_rad))
    grid = low + (high - low) * np.arange(count + (not geometry.full_circle)) / count
    a, e = _stacked(geometry, cov, grid)
    basis = signal_subspace(e, sources)
    null = _null(a, basis)
    padded = np.concatenate([null[-1:], null, null[:1]]) if geometry.full_circle else np.pad(null, 1, "edge")
    dips = np.flatnonzero((padded[1:-1] < padded[:-2]) & (padded[1:-1] <= padded[2:]))
    best = dips[np.argsort(null[dips], kind="stable")[:sources]]
    found = _refined(geometry, basis, grid[best], grid[1] - grid[0])
    return np.sort(np.mod(found - low, 2 * math.pi) + low if geometry.full_circle else found)


def _refined(geometry: ArrayGeometry, basis: Complex, start: Array, reach: float) -> Array:
    """Peaks moved to where the closed-form innovation of the subspace is zero, at most `reach` away."""
    bearing = start.copy()
    for _ in range(_REFINEMENTS if bearing.size else 0):
        a, d = (v.reshape(geometry.bins, geometry.sensors, -1) for v in steering(geometry, bearing))
        a, d = (v - basis @ (basis.conj().swapaxes(1, 2) @ v) for v in (a, d))
        bottom = (np.abs(d) ** 2).sum(axis=(0, 1))
        bearing = bearing - _safe((d.conj() * a).real.sum(axis=(0, 1)), bottom)
        bearing = np.clip(bearing, start - reach, start + reach)
    return bearing


def root_music(geometry: ArrayGeometry, cov: Complex, sources: int) -> Array:
    """Bearings by root-MUSIC, ascending. Narrow band, evenly spaced line arrays (ValueError for others)."""
    step = _electrical_spacing(geometry)
    basis = signal_subspace(_narrow(cov), sources)[0]
    projector = np.eye(len(basis)) - basis @ basis.conj().T
    m = len(basis)
    coefficients = np.array([np.trace(projector, offset=offset) for offset in range(m - 1, -m, -1)])
    roots = np.roots(coefficients)
    # Roots come in pairs mirrored in the circle; of each pair the inner one, and of them those nearest to the circle.
    inside = roots[np.argsort(np.abs(roots), kind="stable")][: m - 1]
    nearest = inside[np.argsort(1.0 - np.abs(inside), kind="stable")[:sources]]
    return np.sort(_bearing_of(np.angle(nearest), step))


def esprit(geometry: ArrayGeometry, cov: Complex, sources: int) -> Array:
    """Bearings by total-least-squares ESPRIT, ascending. Narrow band, evenly spaced line arrays (ValueError else)."""
    step = _electrical_spacing(geometry)
    basis = signal_subspace(_narrow(cov), sources)[0]
    both = np.hstack([basis[:-1], basis[1:]])
    right = np.linalg.svd(both, full_matrices=True)[2].conj().T
    upper, lower = right[:sources, sources:], right[sources:, sources:]
    turned = np.linalg.eigvals(-upper @ np.linalg.pinv(lower))
    return np.sort(_bearing_of(np.angle(turned), step))


def smooth(cov: Complex, subarray: int) -> Complex:
    """Forward-backward spatial smoothing of an evenly spaced line: (M, M) to (subarray, subarray).

    Coherent sources (multipath) become separable at the price of aperture.
    """
    e = _narrow(cov)[0]
    if not 2 <= subarray <= len(e):
        raise ValueError(f"a subarray of {subarray} sensors; give 2 to {len(e)}")
    parts = [e[i : i + subarray, i : i + subarray] for i in range(len(e) - subarray + 1)]
    forward = sum(parts) / len(parts)
    smoothed: Complex = 0.5 * (forward + forward[::-1, ::-1].conj())
    return smoothed


def signal_subspace(cov: Complex, sources: int) -> Complex:
    """Eigenvectors of the largest eigenvalues: (bins, M, sources)."""
    e = cov if cov.ndim == 3 else cov[None]
    if not 1 <= sources < e.shape[1]:
        raise ValueError(f"{sources} sources on {e.shape[1]} sensors; give at least one sensor more than sources")
    vectors: Complex = np.linalg.eigh(e)[1][:, :, -sources:]
    return vectors


def _stacked(geometry: ArrayGeometry, cov: Complex, bearing_rad: ArrayLike) -> tuple[Complex, Complex]:
    """Responses (bins, M, bearings) and covariance (bins, M, M)."""
    a = steering(geometry, bearing_rad)[0].reshape(geometry.bins, geometry.sensors, -1)
    e = np.asarray(cov, dtype=np.complex128)
    e = e if e.ndim == 3 else e[None]
    if e.shape != (geometry.bins, geometry.sensors, geometry.sensors):
        raise ValueError(f"a covariance of shape {cov.shape} for {geometry.bins} bins and {geometry.sensors} sensors")
    return a, e


def _null(a: Complex, basis: Complex) -> Array:
    """Share of the response outside the signal subspace, mean over bins: (bearings,)."""
    norm = (np.abs(a) ** 2).sum(axis=1)
    within = (np.abs(basis.conj().swapaxes(1, 2) @ a) ** 2).sum(axis=1)
    share: Array = 1.0 - _safe(within, norm).mean(axis=0)
    return share


def _safe(top: Array, bottom: Array) -> Array:
    """A quotient, 0 where the array hears nothing."""
    found: Array = np.divide(top, bottom, out=np.zeros(np.shape(bottom)), where=bottom > 0)
    return found


def _narrow(cov: Complex) -> Complex:
    if cov.ndim == 3 and len(cov) != 1:
        raise ValueError(f"{len(cov)} bins; this estimator is narrow band, use music")
    return cov if cov.ndim == 3 else cov[None]


def _electrical_spacing(geometry: ArrayGeometry) -> float:
    """Phase step along the line at sin(bearing) = 1."""
    spacing = geometry.spacing_m
    if spacing is None:
        raise ValueError("the sensors are not an evenly spaced line in order; use music")
    if geometry.bins != 1:
        raise ValueError(f"{geometry.bins} bins; this estimator is narrow band, use music")
    return float(geometry.wavenumber_rad_m[0] * spacing)


def _bearing_of(phase: ArrayLike, step: float) -> Array:
    found: Array = np.arcsin(np.clip(np.asarray(phase) / step, -1.0, 1.0))
    return found


__all__ = [
    "SourceCount", "beamformer", "capon", "count_sources", "covariance", "esprit", "music", "music_spectrum",
    "root_music", "signal_subspace", "smooth",
]  # fmt: skip
