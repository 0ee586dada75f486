"""What no estimator can beat: Cramer-Rao bounds of the bearings of one block, and of a track.

References
----------
Stoica and Nehorai (1990), IEEE Trans. ASSP 38 (stochastic bound); Jansson, Goransson and Ottersten (1999), IEEE Trans.
SP 47 (uncorrelated sources); Tichavsky, Muravchik and Nehorai (1998), IEEE Trans. SP 46 (posterior bound).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.arrays.geometry import ArrayGeometry
from rangeeval.arrays.manifold import steering

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def crb(
    geometry: ArrayGeometry, bearing_rad: ArrayLike, power: ArrayLike, noise: ArrayLike, snapshots: int = 1
) -> Array:
    """Stochastic Cramer-Rao bound of the bearings (N, N), rad^2, nothing known about the sources' correlation.

    power : (N,) of uncorrelated sources at a sensor, or their covariance (N, N); (bins, N) in broad band.
    noise : of a sensor; one, or one a bin. Infinite where bearings coincide.
    """
    a, d = _stacked(geometry, bearing_rad)
    n = a.shape[2]
    information = np.zeros((n, n))
    sources, noises = _sources(power, geometry.bins, n), _noises(noise, geometry.bins)
    for f, (s, noise_f) in enumerate(zip(sources, noises, strict=True)):
        r = a[f] @ s @ a[f].conj().T + noise_f * np.eye(geometry.sensors)
        out = d[f] - a[f] @ (np.linalg.pinv(a[f]) @ d[f])
        seen = s @ a[f].conj().T @ np.linalg.solve(r, a[f] @ s)
        information += 2 * snapshots / noise_f * ((d[f].conj().T @ out) * seen.T).real
    return _inverse(information)


def uncorrelated_crb(
    geometry: ArrayGeometry, bearing_rad: ArrayLike, power: ArrayLike, noise: ArrayLike, snapshots: int = 1
) -> Array:
    """Bound (N, N), rad^2, when the sources are known to be uncorrelated; powers and noise are estimated too."""
    a, d = _stacked(geometry, bearing_rad)
    n = a.shape[2]
    information = np.zeros((n, n))
    sources, noises = _sources(power, geometry.bins, n), _noises(noise, geometry.bins)
    for f, (s, noise_f) in enumerate(zip(sources, noises, strict=True)):
        information += snapshots * _without_powers(fisher(a[f], d[f], np.diag(s).real, noise_f), n)
    return _inverse(information)


def fisher(a: Complex, d: Complex, power: Array, noise: float) -> Array:
    """Information of one snapshot on (bearings, powers, noise): (2N + 1, 2N + 1), the trace formula in closed form."""
    n, m = power.size, len(a)
    r = (a * power) @ a.conj().T + noise * np.eye(m)
    inverse = np.linalg.inv(r)
    ra, rd = inverse @ a, inverse @ d
    aa, ad, dd = a.conj().T @ ra, a.conj().T @ rd, d.conj().T @ rd
    found = np.empty((2 * n + 1, 2 * n + 1))
    found[:n, :n] = 2 * np.outer(power, power) * (ad * ad.T + aa * dd.T).real
    found[:n, n:-1] = 2 * power[:, None] * (aa * ad.T).real
    found[n:-1, :n] = found[:n, n:-1].T
    found[n:-1, n:-1] = np.abs(aa) ** 2
    found[:n, -1] = found[-1, :n] = 2 * power * (ra.conj() * rd).sum(axis=0).real
    found[n:-1, -1] = found[-1, n:-1] = (np.abs(ra) ** 2).sum(axis=0)
    found[-1, -1] = (np.abs(inverse) ** 2).sum()
    return found


def posterior_crb(
    geometry: ArrayGeometry,
    bearing_rad: ArrayLike,
    power: ArrayLike,
    noise: ArrayLike,
    *,
    process_variance: float,
    start_bearing_sigma_rad: float,
    start_rate_sigma_rad: float,
    block: int = 5,
) -> Array:
    """Variance (T, N), rad^2, of the best tracker's bearings at every snapshot along the true bearings (T, N).

    The tracker corrects block by block, knows that the sources are uncorrelated, and estimates powers and noise in each
    block. process_variance : q of the acceleration, (rad per snapshot^2)^2; 0 for bearings known to change evenly.
    """
    truth = np.asarray(bearing_rad, dtype=np.float64)
    if truth.ndim != 2 or not np.isfinite(truth).all():
        raise ValueError(f"true bearings of shape {truth.shape}; give (snapshots, targets), none missing")
    count, n = truth.shape
    powers = np.array([np.diag(s).real for s in _sources(power, geometry.bins, n)])
    noises = _noises(noise, geometry.bins)
    one = np.eye(n)
    cov = np.diag(np.repeat([start_bearing_sigma_rad**2, start_rate_sigma_rad**2], n))
    found = np.empty((count, n))
    for first in range(0, count, block):
        t = min(block, count - first)
        a, d = _stacked(geometry, truth[first + t // 2])
        information = np.zeros((n, n))
        for f in range(geometry.bins):
            information += t * _without_powers(fisher(a[f], d[f], powers[f], noises[f]), n)
        ahead = np.block([[one, t * one], [0 * one, one]])
        cross = process_variance * t**2 / 2 * one
        added = np.block([[process_variance * (t**3 / 3 - t / 12) * one, cross], [cross, process_variance * t * one]])
        cov = ahead @ cov @ ahead.T + added
        wide = cov[:, :n]
        cov = cov - wide @ np.linalg.solve(one + information @ cov[:n, :n], information) @ wide.T
        cov = 0.5 * (cov + cov.T)
        found[first : first + t] = np.diag(cov)[:n]
    return found


def _without_powers(information: Array, n: int) -> Array:
    """Information on the bearings that is left when powers and noise must be estimated from the same data."""
    cross = information[:n, n:]
    left: Array = information[:n, :n] - cross @ np.linalg.pinv(information[n:, n:], hermitian=True) @ cross.T
    return left


def beam_width(geometry: ArrayGeometry, bearing_rad: float = 0.0) -> float:
    """Half-power width of the beam steered to a bearing, rad; the sector's width when the beam fills it."""
    low, high = geometry.sector
    off = (high - low) * np.geomspace(1e-4, 1.0, 200)  # steps of 5 %: fine enough for beams of any width
    middle = steering(geometry, [bearing_rad])[0].reshape(geometry.bins, geometry.sensors, 1)
    width = 0.0
    for side in (1.0, -1.0):
        a = steering(geometry, bearing_rad + side * off)[0].reshape(geometry.bins, geometry.sensors, -1)
        response = (np.abs((middle.conj() * a).sum(axis=1)) ** 2).sum(axis=0)
        level = response / ((np.abs(middle) ** 2).sum(axis=1) ** 2).sum()
        below = np.flatnonzero(level < 0.5)
        if not below.size:
            return high - low
        i = below[0]
        before, x0 = (1.0, 0.0) if i == 0 else (level[i - 1], off[i - 1])
        width += x0 + (off[i] - x0) * (before - 0.5) / (before - level[i])
    return float(min(width, high - low))


def _stacked(geometry: ArrayGeometry, bearing_rad: ArrayLike) -> tuple[Complex, Complex]:
    a, d = steering(geometry, bearing_rad)
    shape = (geometry.bins, geometry.sensors, -1)
    return a.reshape(shape), d.reshape(shape)


def _sources(power: ArrayLike, bins: int, n: int) -> Complex:
    """Source covariance of each bin (bins, N, N)."""
    p = np.asarray(power, dtype=np.complex128)
    if p.ndim == 2 and p.shape == (n, n) and not (bins == n and n > 1):
        return np.broadcast_to(p, (bins, n, n))
    spread: Complex = np.broadcast_to(p, (bins, n))[:, :, None] * np.eye(n)
    return spread


def _noises(noise: ArrayLike, bins: int) -> Array:
    return np.array(np.broadcast_to(np.asarray(noise, dtype=np.float64), (bins,)))


def _inverse(information: Array) -> Array:
    try:
        found = np.asarray(np.linalg.inv(information), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.full(information.shape, np.inf)
    return found if (np.diag(found) > 0).all() else np.full(information.shape, np.inf)
