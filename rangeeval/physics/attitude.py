"""Tilt of a rocking radar from accelerometers, and what its errors do.

An accelerometer whose axis lies along the motion reads f = g sin(alpha) + R alpha_dd: tilt and angular acceleration in
one number. R is signed: positive for a sensor *below* the rotation centre, negative above it (the sign of all radii
together only flips alpha_dd). Readings are those of the two rotations: `x` for roll (the sensor looks along +z of the
radar frame), `z` for pitch (along -x). Angles are radians, readings m/s^2, radii m, arrays of any shape that broadcast.
Attitude error means measured minus true.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

# --- one accelerometer ------------------------------------------------------------------------------------------------


def tilt(force: ArrayLike, gravity: ArrayLike, *, clip: bool = False) -> FloatArray:
    """Tilt (rad) that a reading means if nothing moves: asin(f/g). Beyond +-g it is NaN, or with `clip` +-pi/2.

    References
    ----------
    Kim (2011), eq 1.
    """
    u = _float(force) / _float(gravity)
    with np.errstate(invalid="ignore"):
        inside: FloatArray = np.where(np.abs(u) <= 1.0, np.arcsin(np.clip(u, -1.0, 1.0)), np.nan)[()]
        if clip:
            return np.asarray(np.arcsin(np.clip(u, -1.0, 1.0)))[()]
    return inside


def out_of_domain(force: ArrayLike, gravity: ArrayLike) -> BoolArray:
    """Where |f| > g: no tilt reads that, so the model does not hold there (missing readings are not counted)."""
    with np.errstate(invalid="ignore"):
        beyond: BoolArray = np.abs(_float(force) / _float(gravity)) > 1.0
    return beyond


def lever_ratio(radius_m: ArrayLike, frequency_hz: ArrayLike, gravity: ArrayLike) -> FloatArray:
    """How many times its own amplitude an oscillation is misread by one accelerometer: kappa = R w^2 / g."""
    ratio: FloatArray = _float(radius_m) * (2 * np.pi * _float(frequency_hz)) ** 2 / _float(gravity)
    return ratio


def single_error_peak(static: ArrayLike, dynamic: ArrayLike, kappa: ArrayLike) -> FloatArray:
    """Largest error (rad) of one accelerometer on a sinusoidal motion, exactly; NaN where its asin has no answer.

    The larger of |a - asin(sin a - kappa alpha_d u)|, a = alpha_s + alpha_d u, over the two turning points u = +-1.

    References
    ----------
    Kim (2011), eqs 2-5 (angular frequency 2 pi f, amplitude in radians).
    """
    s, d, k = np.broadcast_arrays(_float(static), _float(dynamic), _float(kappa))
    ends = []
    for u in (1.0, -1.0):
        a = s + d * u
        ends.append(np.abs(tilt(np.sin(a) - k * d * u, 1.0) - a))
    peak: FloatArray = np.maximum(*ends)
    return peak


def reading(alpha: ArrayLike, alpha_dd: ArrayLike, radius_m: ArrayLike, gravity: ArrayLike) -> FloatArray:
    """What a sensor at a radius reads under one-axis motion: g sin(alpha) + R alpha_dd.

    References
    ----------
    Kim (2011), eq 4; exact for a rigid body about a fixed centre, with R positive below it.
    """
    force: FloatArray = _float(gravity) * np.sin(_float(alpha)) + _float(radius_m) * _float(alpha_dd)
    return force


# --- two and more accelerometers --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Heights:
    """Weights that take readings at several radii to the rotation centre, and to the angular acceleration.

    f_0 = sum(centre * f): the reading a sensor at the centre would give. alpha_dd = sum(slope * f).
    """

    centre: FloatArray
    slope: FloatArray


def height_weights(radii_m: Sequence[float], noise: Sequence[float] | None = None) -> Heights:
    """Weights of M >= 2 sensors: the least-squares line of readings over radii, weighted by 1/noise^2 where given.

    For two sensors that is the pair method whatever the noise: f_0 = (R_U f_L - R_L f_U)/(R_U - R_L).

    Raises
    ------
    ValueError : fewer than two different radii.

    References
    ----------
    Kim (2011), eqs 8 and 9, carried on to M sensors.
    """
    r = _float(radii_m)
    if r.size < 2 or not np.ptp(r) > 0:
        shown = ", ".join(f"{v:g}" for v in np.atleast_1d(r))
        raise ValueError(f"radii {shown} m: two sensors at different radii are needed to tell tilt from acceleration")
    w = np.ones_like(r) if noise is None else 1 / _float(noise) ** 2
    w = w / w.sum()
    mean = w @ r
    slope: FloatArray = w * (r - mean) / (w @ (r - mean) ** 2)
    return Heights(w - mean * slope, slope)


def pair_tilt(
    upper: ArrayLike, lower: ArrayLike, radius_upper_m: float, radius_lower_m: float, gravity: ArrayLike
) -> FloatArray:
    """Tilt (rad) from a pair at two radii: asin((R_U f_L - R_L f_U) / (g (R_U - R_L))). Holds for any motion.

    Raises
    ------
    ValueError : equal radii.

    References
    ----------
    Kim (2011), eq 9.
    """
    weights = height_weights((radius_upper_m, radius_lower_m)).centre
    return tilt(weights[0] * _float(upper) + weights[1] * _float(lower), gravity)


def pair_acceleration(upper: ArrayLike, lower: ArrayLike, radius_upper_m: float, radius_lower_m: float) -> FloatArray:
    """Angular acceleration (rad/s^2) from a pair: (f_U - f_L)/(R_U - R_L). Kim (2011), eq 8."""
    slope = height_weights((radius_upper_m, radius_lower_m)).slope
    acceleration: FloatArray = slope[0] * _float(upper) + slope[1] * _float(lower)
    return acceleration


def two_axis_tilt(force_x: ArrayLike, force_z: ArrayLike, gravity: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Exact (alpha_x, alpha_z) from both readings at the rotation centre: pitch first, then roll on what is left of g.

    The paper's asin(f_x/g) for roll is off by tan(alpha_x) (1 - cos(alpha_z)).
    """
    alpha_z = tilt(force_z, gravity)
    return tilt(force_x, _float(gravity) * np.cos(alpha_z)), alpha_z


# --- errors of the pair -----------------------------------------------------------------------------------------------


def noise_amplification(radii_m: Sequence[float]) -> float:
    """Noise of the tilt at the centre over that of one sensor: sqrt(R_U^2 + R_L^2)/|R_U - R_L| for a pair.

    0.71 for opposite sides, 1 with the lower sensor at the centre, without limit as the radii meet. With M sensors
    sqrt(sum R^2 / (M sum R^2 - (sum R)^2)).
    """
    return float(np.linalg.norm(height_weights(radii_m).centre))


def tilt_sigma(weights: ArrayLike, noise: ArrayLike, gravity: ArrayLike, alpha: ArrayLike = 0.0) -> FloatArray:
    """Sigma (rad) of the tilt at the centre from independent sensor noises (m/s^2)."""
    spread = np.sqrt(np.sum((_float(weights) * _float(noise)) ** 2))
    sigma: FloatArray = spread / (_float(gravity) * np.cos(_float(alpha)))
    return sigma


def residual_lever(radii_m: ArrayLike, radius_errors_m: ArrayLike) -> float:
    """The lever (m) at which a pair with wrong radii acts like one sensor: (dR_U R_L - dR_L R_U)/(R_U' - R_L').

    A common shift d, a rotation centre that is not where it was surveyed, leaves -d.
    """
    (u, lo), (du, dl) = _float(radii_m), _float(radius_errors_m)
    return float((du * lo - dl * u) / ((u + du) - (lo + dl)))


def lever_error_peak(lever_m: ArrayLike, frequency_hz: ArrayLike, dynamic: ArrayLike, gravity: ArrayLike) -> FloatArray:
    """Peak error (rad) of an oscillation seen at a lever: (w^2/g) R alpha_d."""
    peak: FloatArray = np.abs(lever_ratio(lever_m, frequency_hz, gravity) * _float(dynamic))
    return peak


def bias_error(weights: ArrayLike, biases_m_s2: ArrayLike, gravity: ArrayLike, alpha: ArrayLike = 0.0) -> FloatArray:
    """Tilt error (rad) from sensor biases: (R_U b_L - R_L b_U)/((R_U - R_L) g cos(alpha))."""
    error: FloatArray = np.sum(_float(weights) * _float(biases_m_s2)) / (_float(gravity) * np.cos(_float(alpha)))
    return error


def skew_error_peak(
    radius_upper_m: float, radius_lower_m: float, skew_s: ArrayLike, frequency_hz: float, dynamic: float, gravity: float
) -> FloatArray:
    """Peak tilt error (rad) when the lower sensor's samples are late by `skew_s` against the upper's (first order)."""
    w = 2 * np.pi * frequency_hz
    lower = abs(gravity - radius_lower_m * w**2) * dynamic
    peak: FloatArray = (
        w * np.abs(_float(skew_s)) * lower * abs(radius_upper_m / (radius_upper_m - radius_lower_m)) / gravity
    )
    return peak


def sway_error_peak(sway_m: ArrayLike, frequency_hz: ArrayLike, gravity: ArrayLike) -> FloatArray:
    """Peak tilt error (rad) when the rotation centre itself sways: its acceleration over g, which no pair removes."""
    peak: FloatArray = _float(sway_m) * (2 * np.pi * _float(frequency_hz)) ** 2 / _float(gravity)
    return peak


def gravity_error(alpha: ArrayLike, relative_error: ArrayLike) -> FloatArray:
    """Tilt error (rad) of a wrong g: -tan(alpha) dg/g."""
    error: FloatArray = -np.tan(_float(alpha)) * _float(relative_error)
    return error


def latency_error_peak(latency_s: ArrayLike, frequency_hz: ArrayLike, dynamic: ArrayLike) -> FloatArray:
    """Peak error (rad) of an attitude that comes late: 2 sin(w tau / 2) alpha_d."""
    peak: FloatArray = np.abs(2 * np.sin(np.pi * _float(frequency_hz) * _float(latency_s)) * _float(dynamic))
    return peak


# --- radii from an oscillation ----------------------------------------------------------------------------------------


def radii_from_oscillation(
    amplitudes: ArrayLike, positions_m: ArrayLike, frequency_hz: float, static: float, gravity: float
) -> FloatArray:
    """Radii (m) of M >= 2 sensors from their signed amplitudes in one oscillation and their relative positions.

    Amplitudes are linear in radius, (g cos(alpha_s) - R w^2) alpha_d, and vanish at R = g cos(alpha_s)/w^2: the
    least-squares line through them finds where that is. First order in the amplitude. For two sensors it is
    R_U = g cos(alpha_s)/w^2 - rho d/(1 - rho), with rho = A_U/A_L and d = R_U - R_L.

    Parameters
    ----------
    amplitudes : signed, in phase positive, any common scale.
    positions_m : along the direction in which radii grow, from any common point.

    Raises
    ------
    ValueError : the sensors are at one place, or all have one amplitude (the line has no zero).
    """
    a, p = _float(amplitudes), _float(positions_m)
    line = height_weights(p.tolist())
    slope = float(line.slope @ a)
    if slope == 0 or not np.isfinite(slope):
        raise ValueError("equal amplitudes at all positions: this motion is no rotation, and no radii follow from it")
    zero = -float(line.centre @ a) / slope
    radii: FloatArray = gravity * np.cos(static) / (2 * np.pi * frequency_hz) ** 2 + (p - zero)
    return radii


def radius_from_reference(
    force: ArrayLike, alpha: ArrayLike, alpha_dd: ArrayLike, gravity: float
) -> tuple[float, float]:
    """Radius (m) of one sensor and its standard error, by least squares against a reference attitude.

    `alpha`, `alpha_dd`: from an inclinometer or INS, at the samples of `force`; a constant bias is fitted and dropped.
    """
    f, a, dd = np.broadcast_arrays(_float(force), _float(alpha), _float(alpha_dd))
    use = np.isfinite(f) & np.isfinite(a) & np.isfinite(dd)
    y, x = f[use] - gravity * np.sin(a[use]), dd[use]
    y, x = y - y.mean(), x - x.mean()
    radius = float(x @ y / (x @ x))
    left = y - radius * x
    return radius, float(np.sqrt(left @ left / max(x.size - 2, 1) / (x @ x)))


def _float(value: ArrayLike) -> FloatArray:
    return np.asarray(value, dtype=np.float64)
