"""Frames of a ground radar and its array face.

- **NUE**: earth-fixed Cartesian at the radar, x north, y up, z east (right-handed).
- **ACS**: Cartesian of the array face, x boresight, y up along the face, z right.
- **array angles**: sin(theta_e) = y/R, sin(theta_a) = z/R in the ACS. theta_e is the elevation above the
face's horizontal plane; theta_a is *not* an azimuth: sin(theta_a) = cos(el) sin(az).
- **beam coordinates**: (R, y, z), in which the track filter updates; x = +sqrt(R^2 - y^2 - z^2).

The rotation matrices are passive: they turn coordinates, not vectors. Signs: heading > 0 turns the forward
axis from north to east; alpha_z > 0 puts the front *down* (pitch, opposite to the aerospace sign); alpha_x >
0 raises the right side (roll, opposite to the aerospace sign). Positions are arrays (..., 3); angles are
radians.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def rotation_x(angle: ArrayLike) -> FloatArray:
    """Passive rotation (..., 3, 3) about the forward axis: positive raises the right side.

    References
    ----------
    W. K. Kim (2011), JKSAS 39(8) 766, eq 11: A_x = [1 0 0; 0 c -s; 0 s c].
    """
    c, s, o, i = _parts(angle)
    return _matrix((i, o, o), (o, c, -s), (o, s, c))


def rotation_z(angle: ArrayLike) -> FloatArray:
    """Passive rotation (..., 3, 3) about the right axis: positive lowers the front. A_z = [c -s 0; s c 0; 0 0
    1].
    """
    c, s, o, i = _parts(angle)
    return _matrix((c, -s, o), (s, c, o), (o, o, i))


def rotation_heading(angle: ArrayLike) -> FloatArray:
    """Passive rotation (..., 3, 3) about the up axis: positive turns north to east. A_h = [c 0 s; 0 1 0; -s 0
    c].
    """
    c, s, o, i = _parts(angle)
    return _matrix((c, o, s), (o, i, o), (-s, o, c))


def attitude_matrix(heading: ArrayLike, alpha_x: ArrayLike = 0.0, alpha_z: ArrayLike = 0.0) -> FloatArray:
    """Matrix (..., 3, 3) that turns NUE coordinates into those of the radar: C = A_x A_z A_h.

    References
    ----------
    W. K. Kim (2011), eqs 10 and 11.
    """
    c: FloatArray = rotation_x(alpha_x) @ rotation_z(alpha_z) @ rotation_heading(heading)
    return c


def face_matrix(heading: ArrayLike, tilt: ArrayLike = 0.0) -> FloatArray:
    """Matrix (..., 3, 3) that turns NUE coordinates into those of an array face tilted back by `tilt` (up
    positive).
    """
    return attitude_matrix(heading, 0.0, -_float(tilt))


def turn(matrix: ArrayLike, vectors: ArrayLike) -> FloatArray:
    """Apply a rotation (..., 3, 3) to vectors (..., 3), for example NUE to ACS."""
    turned: FloatArray = np.einsum("...ij,...j->...i", _float(matrix), _float(vectors))
    return turned


def turn_back(matrix: ArrayLike, vectors: ArrayLike) -> FloatArray:
    """Apply the inverse of a rotation (..., 3, 3) to vectors (..., 3), for example ACS to NUE."""
    turned: FloatArray = np.einsum("...ji,...j->...i", _float(matrix), _float(vectors))
    return turned


def array_coordinates(position_m: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Range (m) and the sines of theta_e and theta_a of an ACS position (..., 3).

    References
    ----------
    Shin and Kim (2015), eqs 1-3.
    """
    p = _float(position_m)
    r: FloatArray = np.sqrt(np.sum(p**2, axis=-1))
    with np.errstate(divide="ignore", invalid="ignore"):
        return r, p[..., 1] / r, p[..., 2] / r


def beam_to_cartesian(range_m: ArrayLike, y_m: ArrayLike, z_m: ArrayLike) -> FloatArray:
    """ACS position (..., 3) from beam coordinates (m); NaN where y and z are longer than the range."""
    r, y, z = np.broadcast_arrays(_float(range_m), _float(y_m), _float(z_m))
    with np.errstate(invalid="ignore"):
        x = np.sqrt(r**2 - y**2 - z**2)
    return np.stack([x, y + 0 * x, z + 0 * x], axis=-1)


def array_angles_to_azimuth_elevation(theta_e: ArrayLike, theta_a: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Azimuth (from boresight, towards the right) and elevation in the ACS from the array angles, all in rad.

    NaN where no direction in front of the array has these angles.
    """
    s_e, s_a = np.sin(_float(theta_e)), np.sin(_float(theta_a))
    with np.errstate(invalid="ignore"):
        x = np.sqrt(1 - s_e**2 - s_a**2)
    return np.arctan2(s_a, x), np.where(np.isnan(x), np.nan, _float(theta_e))[()]


def azimuth_elevation_to_array_angles(azimuth: ArrayLike, elevation: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Array angles (theta_e, theta_a) from azimuth and elevation in the ACS, all in rad."""
    az, el = np.broadcast_arrays(_float(azimuth), _float(elevation))
    return el[()], np.arcsin(np.cos(el) * np.sin(az))


def azimuth_error(
    azimuth: ArrayLike, elevation: ArrayLike, theta_e_error: ArrayLike, theta_a_error: ArrayLike
) -> FloatArray:
    """Small azimuth error from small errors of the array angles, first order, all in rad.

    d_az = (cos(theta_a) d_theta_a + sin(el) sin(az) d_el) / (cos(el) cos(az)).
    """
    az, el = _float(azimuth), _float(elevation)
    cos_theta_a = np.sqrt(1 - (np.cos(el) * np.sin(az)) ** 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        error: FloatArray = (cos_theta_a * _float(theta_a_error) + np.sin(el) * np.sin(az) * _float(theta_e_error)) / (
            np.cos(el) * np.cos(az)
        )
    return error


def theta_a_error(
    azimuth: ArrayLike, elevation: ArrayLike, azimuth_error: ArrayLike, elevation_error: ArrayLike
) -> FloatArray:
    """Small error of theta_a from small errors of azimuth and elevation, first order, all in rad."""
    az, el = _float(azimuth), _float(elevation)
    cos_theta_a = np.sqrt(1 - (np.cos(el) * np.sin(az)) ** 2)
    error: FloatArray = (
        np.cos(el) * np.cos(az) * _float(azimuth_error) - np.sin(el) * np.sin(az) * _float(elevation_error)
    ) / cos_theta_a
    return error


def _parts(angle: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    a = _float(angle)
    return np.cos(a), np.sin(a), np.zeros_like(a), np.ones_like(a)


def _matrix(*rows: tuple[FloatArray, FloatArray, FloatArray]) -> FloatArray:
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _float(value: ArrayLike) -> FloatArray:
    return np.asarray(value, dtype=np.float64)
