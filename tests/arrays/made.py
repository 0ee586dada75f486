"""Arrays and snapshots whose sources the tests choose, written out with numpy alone."""

from __future__ import annotations

import numpy as np

from rangeeval.arrays.geometry import ArrayGeometry, cylinder, line

WAVELENGTH, SPEED = 0.24, 1500.0
FREQUENCY = SPEED / WAVELENGTH
RNG = np.random.default_rng

LINE = line(15, 0.12, FREQUENCY, SPEED)
ARC = cylinder(1.0, np.deg2rad(np.arange(-84, 85, 12)), FREQUENCY, SPEED, sector_rad=(-np.pi / 2, np.pi / 2))
SCATTERED = ArrayGeometry(
    np.array([[0.0, 0.0, 0.0], [0.09, 0.02, 0.05], [0.01, 0.11, 0.0], [-0.1, 0.02, 0.1], [0.03, -0.11, 0.02],
              [0.16, 0.1, 0.0], [-0.05, 0.17, 0.03]]), np.array([FREQUENCY]), SPEED,
)  # fmt: skip


def response(position_m, bearing_rad, wavelength_m=WAVELENGTH, elevation_rad=0.0):
    """exp(j k p . u) of one plane wave (M,), from the formula."""
    p = np.asarray(position_m, dtype=float)
    up = np.sin(elevation_rad)
    u = np.array([np.cos(elevation_rad) * np.cos(bearing_rad), np.cos(elevation_rad) * np.sin(bearing_rad), up])
    return np.exp(2j * np.pi / wavelength_m * (p @ u[: p.shape[1]]))


def normal(rng, *shape):
    """Circular complex normals of variance 1."""
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


def snapshots(geometry, bearing_rad, snr_db, count, seed, wavelength_m=WAVELENGTH):
    """(count, M): independent sources of power 1 at fixed bearings (N,) or moving ones (count, N), in noise."""
    rng = RNG(seed)
    path = np.broadcast_to(np.atleast_1d(bearing_rad), (count, np.atleast_1d(bearing_rad).shape[-1]))
    a = np.array([[response(geometry.sensor_position_m, b, wavelength_m) for b in row] for row in path])
    s = normal(rng, *path.shape)
    return np.einsum("knm,kn->km", a, s) + 10 ** (-snr_db / 20) * normal(rng, count, geometry.sensors)


def model(geometry, bearing_rad, power, noise):
    """R = A diag(p) A^H + noise I, from the formula."""
    a = np.array([response(geometry.sensor_position_m, b) for b in bearing_rad]).T
    return (a * np.asarray(power)) @ a.conj().T + noise * np.eye(geometry.sensors)
