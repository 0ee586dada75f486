"""Range, azimuth and elevation: the measurement of a position, its Jacobian, and positions of measurements.

Azimuth counter-clockwise from x, elevation up from the x-y plane. Kernels write 3 x 3 blocks.

References
----------
Unbiased conversion: Mo, Song, Zhou, Sun and Bar-Shalom (1998), Unbiased converted measurements for tracking; evaluated
at the prediction: Bordonaro, Willett and Bar-Shalom (2014), Decorrelated unbiased converted measurement Kalman filter.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.compiled import compiled_ieee, compiled_inside

FloatArray = NDArray[np.float64]

EKF, CONVERTED, UNBIASED, DECORRELATED = 0, 1, 2, 3
UPDATES = {"ekf": EKF, "converted": CONVERTED, "unbiased": UNBIASED, "decorrelated": DECORRELATED}
NEAR_ZENITH = 1e-6  # horizontal distance over range below which azimuth has no meaning


@compiled_inside
def wrap(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    if -math.pi <= angle < math.pi:
        return angle
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@compiled_ieee
def measure(x: FloatArray, row: int, v: FloatArray, at: int, m: FloatArray, h: int) -> bool:
    """Range, azimuth, elevation of the position in `row` of `x` into row `at` of `v` (n, 3), Jacobian into `h` of `m`
    (n, 9).

    False when azimuth and elevation have no derivative (at the zenith, or at the radar): their rows are then zero.
    """
    px, py, pz = x[row, 0], x[row, 1], x[row, 2]
    flat2 = px * px + py * py
    flat = math.sqrt(flat2)
    r = math.sqrt(flat2 + pz * pz)
    v[at, 0] = r
    v[at, 1] = math.atan2(py, px)
    v[at, 2] = math.atan2(pz, flat)
    if not flat > NEAR_ZENITH * r:
        for k in range(9):
            m[h, k] = 0.0
        if r > 0.0:
            m[h, 2] = pz / r
        return False
    one = 1.0 / r
    across = pz * one * one / flat
    m[h, 0], m[h, 1], m[h, 2] = px * one, py * one, pz * one
    m[h, 3], m[h, 4], m[h, 5] = -py / flat2, px / flat2, 0.0
    m[h, 6], m[h, 7], m[h, 8] = -px * across, -py * across, flat * one * one
    return True


@compiled_inside
def convert(r: float, az: float, el: float, v: FloatArray, row: int) -> None:
    """Position of range, azimuth, elevation into `row` of `v` (n, 3)."""
    flat = r * math.cos(el)
    v[row, 0] = flat * math.cos(az)
    v[row, 1] = flat * math.sin(az)
    v[row, 2] = r * math.sin(el)


@compiled_ieee
def conventional_covariance(
    r: float, az: float, el: float, vr: float, va: float, ve: float, c: FloatArray, row: int
) -> None:
    """Covariance J R J' of a converted measurement with variances vr, va, ve, into `row` of `c` (n, 9)."""
    ca, sa, ce, se = math.cos(az), math.sin(az), math.cos(el), math.sin(el)
    d0 = (ca * ce, sa * ce, se)
    d1 = (-r * sa * ce, r * ca * ce, 0.0)
    d2 = (-r * ca * se, -r * sa * se, r * ce)
    for i in range(3):
        for k in range(3):
            c[row, 3 * i + k] = d0[i] * d0[k] * vr + d1[i] * d1[k] * va + d2[i] * d2[k] * ve


@compiled_ieee
def unbiased_covariance(
    r: float, az: float, el: float, vr: float, va: float, ve: float, c: FloatArray, row: int
) -> None:
    """Covariance of an unbiased converted measurement of a target at (r, az, el), into `row` of `c` (n, 9)."""
    la2, le2 = math.exp(-va), math.exp(-ve)
    ca, sa, ce, se = math.cos(az), math.sin(az), math.cos(el), math.sin(el)
    # mean squares of the cosines and sines of the noisy angles
    a2, e2 = math.exp(-2.0 * va), math.exp(-2.0 * ve)
    caca, sasa = 0.5 * (1.0 + a2 * math.cos(2.0 * az)), 0.5 * (1.0 - a2 * math.cos(2.0 * az))
    cece, sese = 0.5 * (1.0 + e2 * math.cos(2.0 * el)), 0.5 * (1.0 - e2 * math.cos(2.0 * el))
    casa, cese = 0.5 * a2 * math.sin(2.0 * az), 0.5 * e2 * math.sin(2.0 * el)
    r2 = r * r + vr
    x, y, z = r * ce * ca, r * ce * sa, r * se
    c[row, 0] = r2 * cece * caca / (la2 * le2) - x * x
    c[row, 4] = r2 * cece * sasa / (la2 * le2) - y * y
    c[row, 8] = r2 * sese / le2 - z * z
    c[row, 1] = r2 * cece * casa / (la2 * le2) - x * y
    c[row, 2] = r2 * cese * ca / le2 - x * z
    c[row, 5] = r2 * cese * sa / le2 - y * z
    c[row, 3], c[row, 6], c[row, 7] = c[row, 1], c[row, 2], c[row, 5]


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
    found = np.empty((*p.shape, 3))
    each, rows, h = p.reshape(-1, 3), found.reshape(-1, 9), np.empty((1, 3))
    for i in range(len(each)):
        measure(each, i, h, 0, rows, i)
    return found


def unbiased_position(polar: ArrayLike, sigma: ArrayLike) -> FloatArray:
    """Positions (..., 3) whose mean over the measurement noise is the true one; `sigma` of range, azimuth,
    elevation.
    """
    s = np.asarray(sigma, dtype=np.float64)
    la, le = np.exp(-0.5 * s[..., 1] ** 2), np.exp(-0.5 * s[..., 2] ** 2)
    position: FloatArray = to_position(polar) / np.stack([la * le, la * le, le], -1)
    return position


def converted_covariance(polar: ArrayLike, sigma: ArrayLike, *, unbiased: bool = False) -> FloatArray:
    """Covariance (3, 3) of one converted measurement at range, azimuth, elevation (3,)."""
    r, az, el = np.asarray(polar, dtype=np.float64)
    vr, va, ve = np.asarray(sigma, dtype=np.float64) ** 2
    c = np.empty((1, 9))
    (unbiased_covariance if unbiased else conventional_covariance)(r, az, el, vr, va, ve, c, 0)
    return c.reshape(3, 3)
