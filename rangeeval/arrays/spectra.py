"""Estimates from one block of snapshots: beamformer and MUSIC spectra, MUSIC, root-MUSIC, ESPRIT, smoothing, count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rangeeval.arrays.geometry import ArrayGeometry

Array = NDArray[np.float64]
Covariance = NDArray[np.complex128]  # (M, M), or (bins, M, M) in broad band


@dataclass(frozen=True)
class SourceCount:
    """Number of sources by each criterion, with the criteria's values for 0 .. M - 1 sources."""

    aic: int
    mdl: int
    aic_values: Array
    mdl_values: Array


def covariance(snapshots: Covariance) -> Covariance:
    """Sample covariance of a block, snapshots with a NaN left out: (K, M) -> (M, M), (K, bins, M) -> (bins, M, M)."""
    raise NotImplementedError


def beamformer(geometry: ArrayGeometry, cov: Covariance, bearing_rad: Array) -> Array:
    """Conventional spectrum a^H E a / |a|^2 / M at each bearing, summed over bins (the waterfall)."""
    raise NotImplementedError


def capon(geometry: ArrayGeometry, cov: Covariance, bearing_rad: Array) -> Array:
    """Minimum-variance spectrum at each bearing."""
    raise NotImplementedError


def music_spectrum(geometry: ArrayGeometry, cov: Covariance, sources: int, bearing_rad: Array) -> Array:
    """|a|^2 / (a^H Pn a) at each bearing (bins: harmonic sum)."""
    raise NotImplementedError


def music(geometry: ArrayGeometry, cov: Covariance, sources: int, *, grid_rad: float = np.deg2rad(0.25)) -> Array:
    """Bearings (up to `sources`, ascending) of the highest MUSIC peaks, refined by the closed-form innovation."""
    raise NotImplementedError


def root_music(geometry: ArrayGeometry, cov: Covariance, sources: int) -> Array:
    """Bearings by root-MUSIC; evenly spaced line arrays."""
    raise NotImplementedError


def esprit(geometry: ArrayGeometry, cov: Covariance, sources: int) -> Array:
    """Bearings by total-least-squares ESPRIT; evenly spaced line arrays."""
    raise NotImplementedError


def smooth(cov: Covariance, subarray: int) -> Covariance:
    """Forward-backward spatial smoothing of an even line to `subarray` sensors (coherent sources)."""
    raise NotImplementedError


def count_sources(cov: Covariance, snapshots: int) -> SourceCount:
    """Wax and Kailath's AIC and MDL. Caution: moving sources are over-counted; keep rate x block < 0.2 beam."""
    raise NotImplementedError
