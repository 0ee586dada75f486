"""Range, azimuth and elevation: the measurement of a position, its Jacobian, and positions of measurements.

Azimuth counter-clockwise from x, elevation up from the x-y plane. Kernels work in a model's row, see `layout`.

References
----------
Unbiased conversion: Mo, Song, Zhou, Sun and Bar-Shalom (1998), Unbiased converted measurements for tracking; evaluated
at the prediction: Bordonaro, Willett and Bar-Shalom (2014), Decorrelated unbiased converted measurement Kalman filter.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.compiled import compiled_borrowing, compiled_inside
from rangeeval.tracking.layout import AT, NU, PREDICTED, WIDTH, H, R, S

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


@compiled_inside
def measure(own: FloatArray) -> bool:
    """Range, azimuth, elevation of the predicted position into AT, their Jacobian into H.

    False when azimuth and elevation have no derivative (at the zenith, or at the radar): their rows are then zero.
    """
    px, py, pz = own[PREDICTED], own[PREDICTED + 1], own[PREDICTED + 2]
    flat2 = px * px + py * py
    flat = math.sqrt(flat2)
    r = math.sqrt(flat2 + pz * pz)
    own[AT], own[AT + 1], own[AT + 2] = r, math.atan2(py, px), math.atan2(pz, flat)
    if not flat > NEAR_ZENITH * r:
        for k in range(9):
            own[H + k] = 0.0
        own[H + 2] = pz / r if r > 0.0 else 0.0
        return False
    one = 1.0 / r
    along, across = 1.0 / flat2, pz * one * one / flat
    own[H], own[H + 1], own[H + 2] = px * one, py * one, pz * one
    own[H + 3], own[H + 4], own[H + 5] = -py * along, px * along, 0.0
    own[H + 6], own[H + 7], own[H + 8] = -px * across, -py * across, flat * one * one
    return True


@compiled_inside
def convert(own: FloatArray, r: float, az: float, el: float, vr: float, va: float, ve: float) -> None:
    """Position of range, azimuth, elevation into NU; its covariance J R J' into R, from the variances vr, va, ve."""
    ca, sa, ce, se = math.cos(az), math.sin(az), math.cos(el), math.sin(el)
    d, room = NU, S  # columns of J in the room of S
    own[d], own[d + 1], own[d + 2] = r * ce * ca, r * ce * sa, r * se
    own[room], own[room + 1], own[room + 2] = ca * ce, sa * ce, se
    own[room + 3], own[room + 4], own[room + 5] = -r * sa * ce, r * ca * ce, 0.0
    own[room + 6], own[room + 7], own[room + 8] = -r * ca * se, -r * sa * se, r * ce
    for i in range(3):
        for k in range(3):
            own[R + 3 * i + k] = (
                own[room + i] * own[room + k] * vr
                + own[room + 3 + i] * own[room + 3 + k] * va
                + own[room + 6 + i] * own[room + 6 + k] * ve
            )


@compiled_inside
def unbiased_covariance(own: FloatArray, r: float, az: float, el: float, vr: float, va: float, ve: float) -> None:
    """Covariance of an unbiased converted measurement of a target at (r, az, el), into R."""
    la2, le2 = math.exp(-va), math.exp(-ve)
    ca, sa, ce, se = math.cos(az), math.sin(az), math.cos(el), math.sin(el)
    # mean squares and products of the cosines and sines of the noisy angles, from those of twice the angle
    a2, e2 = la2 * la2, le2 * le2
    cos2a, cos2e = a2 * (ca * ca - sa * sa), e2 * (ce * ce - se * se)
    cece, casa, cese = 0.5 * (1.0 + cos2e), a2 * ca * sa, e2 * ce * se
    r2 = r * r + vr
    x, y, z = r * ce * ca, r * ce * sa, r * se
    flat, slant = r2 * cece / (la2 * le2), r2 * cese / le2
    own[R] = flat * 0.5 * (1.0 + cos2a) - x * x
    own[R + 4] = flat * 0.5 * (1.0 - cos2a) - y * y
    own[R + 8] = r2 * 0.5 * (1.0 - cos2e) / le2 - z * z
    own[R + 1] = flat * casa - x * y
    own[R + 2] = slant * ca - x * z
    own[R + 5] = slant * sa - y * z
    own[R + 3], own[R + 6], own[R + 7] = own[R + 1], own[R + 2], own[R + 5]


@compiled_borrowing
def _measured(positions: FloatArray, jacobians: FloatArray, own: FloatArray) -> None:
    for i in range(len(positions)):
        for a in range(3):
            own[PREDICTED + a] = positions[i, a]
        measure(own)
        for k in range(9):
            jacobians[i, k] = own[H + k]


@compiled_borrowing
def _converted(z: FloatArray, variance: FloatArray, unbiased: bool, own: FloatArray) -> None:
    convert(own, z[0], z[1], z[2], variance[0], variance[1], variance[2])
    if unbiased:
        unbiased_covariance(own, z[0], z[1], z[2], variance[0], variance[1], variance[2])


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
    p = np.ascontiguousarray(position_m, dtype=np.float64)
    found = np.empty((*p.shape, 3))
    _measured(p.reshape(-1, 3), found.reshape(-1, 9), np.zeros(WIDTH))
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
    own = np.zeros(WIDTH)
    _converted(np.array(polar, dtype=np.float64), np.array(sigma, dtype=np.float64) ** 2, unbiased, own)
    return own[R : R + 9].reshape(3, 3)
