"""Range, azimuth and elevation: the measurement of a position, its Jacobian, and positions of measurements.

Azimuth counter-clockwise from x, elevation up from the x-y plane. Kernels write 3 x 3 blocks.

References
----------
Unbiased conversion: Mo, Song, Zhou, Sun and Bar-Shalom (1998), Unbiased converted measurements for tracking; evaluated at
the prediction: Bordonaro, Willett and Bar-Shalom (2014), Decorrelated unbiased converted measurement Kalman filter.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.compiled import compiled

FloatArray = NDArray[np.float64]

EKF, CONVERTED, UNBIASED, DECORRELATED = 0, 1, 2, 3
UPDATES = {"ekf": EKF, "converted": CONVERTED, "unbiased": UNBIASED, "decorrelated": DECORRELATED}
NEAR_ZENITH = 1e-6  # horizontal distance over range below which azimuth has no meaning


@compiled
def wrap(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    if -math.pi <= angle < math.pi:
        return angle
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@compiled
def measure(position: FloatArray, h: FloatArray, jacobian: FloatArray) -> bool:
    """Range, azimuth, elevation of a position into `h` (3), their Jacobian into (3, 3).

    False when azimuth and elevation have no derivative (at the zenith, or at the radar): their rows are then zero.
    """
    x, y, z = position[0], position[1], position[2]
    flat2 = x * x + y * y
    flat = math.sqrt(flat2)
    r = math.sqrt(flat2 + z * z)
    h[0] = r
    h[1] = math.atan2(y, x)
    h[2] = math.atan2(z, flat)
    for i in range(3):
        for k in range(3):
            jacobian[i, k] = 0.0
    if r <= 0.0:
        return False
    jacobian[0, 0] = x / r
    jacobian[0, 1] = y / r
    jacobian[0, 2] = z / r
    if flat <= NEAR_ZENITH * r:
        return False
    jacobian[1, 0] = -y / flat2
    jacobian[1, 1] = x / flat2
    across = z / (r * r * flat)
    jacobian[2, 0] = -x * across
    jacobian[2, 1] = -y * across
    jacobian[2, 2] = flat / (r * r)
    return True


@compiled
def convert(r: float, az: float, el: float, y: FloatArray) -> None:
    """Position of range, azimuth, elevation into `y` (3)."""
    flat = r * math.cos(el)
    y[0] = flat * math.cos(az)
    y[1] = flat * math.sin(az)
    y[2] = r * math.sin(el)


@compiled
def conventional_covariance(r: float, az: float, el: float, vr: float, va: float, ve: float, c: FloatArray) -> None:
    """Covariance J R J' of a converted measurement with variances vr, va, ve, into `c` (3, 3)."""
    ca, sa, ce, se = math.cos(az), math.sin(az), math.cos(el), math.sin(el)
    d0 = (ca * ce, sa * ce, se)
    d1 = (-r * sa * ce, r * ca * ce, 0.0)
    d2 = (-r * ca * se, -r * sa * se, r * ce)
    for i in range(3):
        for k in range(3):
            c[i, k] = d0[i] * d0[k] * vr + d1[i] * d1[k] * va + d2[i] * d2[k] * ve


@compiled
def unbiased_covariance(r: float, az: float, el: float, vr: float, va: float, ve: float, c: FloatArray) -> None:
    """Covariance of an unbiased converted measurement of a target at (r, az, el), into `c` (3, 3)."""
    la2, le2 = math.exp(-va), math.exp(-ve)
    ca, sa, ce, se = math.cos(az), math.sin(az), math.cos(el), math.sin(el)
    # mean squares of the cosines and sines of the noisy angles
    a2, e2 = math.exp(-2.0 * va), math.exp(-2.0 * ve)
    caca, sasa, casa = 0.5 * (1 + a2 * math.cos(2 * az)), 0.5 * (1 - a2 * math.cos(2 * az)), 0.5 * a2 * math.sin(2 * az)
    cece, sese, cese = 0.5 * (1 + e2 * math.cos(2 * el)), 0.5 * (1 - e2 * math.cos(2 * el)), 0.5 * e2 * math.sin(2 * el)
    r2 = r * r + vr
    x, y, z = r * ce * ca, r * ce * sa, r * se
    c[0, 0] = r2 * cece * caca / (la2 * le2) - x * x
    c[1, 1] = r2 * cece * sasa / (la2 * le2) - y * y
    c[0, 1] = r2 * cece * casa / (la2 * le2) - x * y
    c[0, 2] = r2 * cese * ca / le2 - x * z
    c[1, 2] = r2 * cese * sa / le2 - y * z
    c[2, 2] = r2 * sese / le2 - z * z
    c[1, 0] = c[0, 1]
    c[2, 0] = c[0, 2]
    c[2, 1] = c[1, 2]


def of_position(position_m: ArrayLike) -> FloatArray:
    """Range, azimuth, elevation (..., 3) of positions (..., 3)."""
    p = np.asarray(position_m, dtype=np.float64)
    flat = np.hypot(p[..., 0], p[..., 1])
    return np.stack([np.hypot(flat, p[..., 2]), np.arctan2(p[..., 1], p[..., 0]), np.arctan2(p[..., 2], flat)], -1)


def to_position(polar: ArrayLike) -> FloatArray:
    """Positions (..., 3) of range, azimuth, elevation (..., 3)."""
    z = np.asarray(polar, dtype=np.float64)
    flat = z[..., 0] * np.cos(z[..., 2])
    return np.stack([flat * np.cos(z[..., 1]), flat * np.sin(z[..., 1]), z[..., 0] * np.sin(z[..., 2])], -1)


def jacobian(position_m: ArrayLike) -> FloatArray:
    """Jacobian (..., 3, 3) of range, azimuth, elevation at positions (..., 3); rows of zeros where it has none."""
    p = np.asarray(position_m, dtype=np.float64)
    found = np.zeros((*p.shape, 3))
    h = np.empty(3)
    for index in np.ndindex(p.shape[:-1]):
        measure(p[index], h, found[index])
    return found


def unbiased_position(polar: ArrayLike, sigma: ArrayLike) -> FloatArray:
    """Positions (..., 3) whose mean over the measurement noise is the true one; `sigma` of range, azimuth, elevation."""
    s = np.asarray(sigma, dtype=np.float64)
    la, le = np.exp(-0.5 * s[..., 1] ** 2), np.exp(-0.5 * s[..., 2] ** 2)
    return to_position(polar) / np.stack([la * le, la * le, le], -1)


def converted_covariance(polar: ArrayLike, sigma: ArrayLike, *, unbiased: bool = False) -> FloatArray:
    """Covariance (3, 3) of one converted measurement at range, azimuth, elevation (3,)."""
    r, az, el = np.asarray(polar, dtype=np.float64)
    vr, va, ve = np.asarray(sigma, dtype=np.float64) ** 2
    c = np.empty((3, 3))
    (unbiased_covariance if unbiased else conventional_covariance)(r, az, el, vr, va, ve, c)
    return c
