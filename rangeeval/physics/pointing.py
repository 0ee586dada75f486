"""What an attitude error does to azimuth and elevation.

Two errors, of opposite sign to first order: the **designation error** is that of a beam sent to a known earth-fixed
direction; the **report error** is that of a measured direction turned back to the earth frame, which is what tracks and
plots carry. Both by exact rotations; the paper's small-angle forms stand beside them. Azimuth is clockwise from the
forward axis (or north), elevation up, all in radians.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.angles import wrapped
from rangeeval.physics.frames import attitude_matrix, rotation_x, rotation_z, turn, turn_back

FloatArray = NDArray[np.float64]


def direction(azimuth: ArrayLike, elevation: ArrayLike) -> FloatArray:
    """Unit vector (..., 3) of an azimuth and elevation: (cos El cos Az, sin El, cos El sin Az). Kim (2011), eq 18."""
    az, el = np.broadcast_arrays(_float(azimuth), _float(elevation))
    return np.stack([np.cos(el) * np.cos(az), np.sin(el), np.cos(el) * np.sin(az)], axis=-1)


def azimuth_elevation(vector: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Azimuth and elevation (rad) of vectors (..., 3) of any length, in every quadrant."""
    v = _float(vector)
    return np.arctan2(v[..., 2], v[..., 0]), np.arctan2(v[..., 1], np.hypot(v[..., 0], v[..., 2]))


def designation_error(
    azimuth: ArrayLike,
    elevation: ArrayLike,
    heading: ArrayLike,
    true: tuple[ArrayLike, ArrayLike],
    measured: tuple[ArrayLike, ArrayLike],
) -> tuple[FloatArray, FloatArray]:
    """Error (azimuth, elevation) in the radar frame of a beam sent to an earth-fixed direction, exact.

    `true` and `measured` are (alpha_x, alpha_z).

    References
    ----------
    Kim (2011), eqs 10-12.
    """
    earth = direction(azimuth, elevation)
    return _difference(turn(attitude_matrix(heading, *measured), earth), turn(attitude_matrix(heading, *true), earth))


def report_error(
    azimuth: ArrayLike,
    elevation: ArrayLike,
    heading: ArrayLike,
    true: tuple[ArrayLike, ArrayLike],
    measured: tuple[ArrayLike, ArrayLike],
) -> tuple[FloatArray, FloatArray]:
    """Error (azimuth, elevation) in the earth frame of a measured direction turned back with a wrong attitude, exact.

    X_hat = C(measured)^T C(true) X; `azimuth`, `elevation` are the true earth-fixed direction.
    """
    earth = direction(azimuth, elevation)
    reported = turn_back(attitude_matrix(heading, *measured), turn(attitude_matrix(heading, *true), earth))
    return _difference(reported, earth)


def corrected(
    azimuth: ArrayLike,
    elevation: ArrayLike,
    heading: ArrayLike,
    assumed: tuple[ArrayLike, ArrayLike],
    attitude: tuple[ArrayLike, ArrayLike],
) -> tuple[FloatArray, FloatArray]:
    """Earth-fixed azimuth (0 to 2 pi) and elevation as they are with `attitude`, where the radar `assumed` another."""
    antenna = turn(attitude_matrix(heading, *assumed), direction(azimuth, elevation))
    az, el = azimuth_elevation(turn_back(attitude_matrix(heading, *attitude), antenna))
    return np.mod(az, 2 * np.pi), el


def small_angle_designation(
    azimuth: ArrayLike, elevation: ArrayLike, error_x: ArrayLike, error_z: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Designation error (azimuth, elevation) by the paper's small-angle forms; angles in the radar frame.

    Safe in every quadrant. NaN where the elevation's asin has no answer (near the zenith).

    References
    ----------
    Kim (2011), eqs 19 and 20.
    """
    az, el, dx, dz = np.broadcast_arrays(*(_float(v) for v in (azimuth, elevation, error_x, error_z)))
    sine = np.sin(el) + np.cos(el) * (dz * np.cos(az) - dx * np.sin(az))
    with np.errstate(invalid="ignore"):
        pointed_el = np.where(np.abs(sine) <= 1.0, np.arcsin(np.clip(sine, -1.0, 1.0)), np.nan)
    pointed_az = np.arctan2(np.cos(el) * np.sin(az) + np.sin(el) * dx, np.cos(el) * np.cos(az) - np.sin(el) * dz)
    return wrapped(pointed_az - az), (pointed_el - el)[()]


def first_order_designation(
    azimuth: ArrayLike, elevation: ArrayLike, error_x: ArrayLike, error_z: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Designation error (azimuth, elevation), first order: d_El = dz cos Az - dx sin Az, d_Az = tan El (dx cos Az + dz
    sin Az).
    """
    az, el, dx, dz = (_float(v) for v in (azimuth, elevation, error_x, error_z))
    d_az: FloatArray = np.tan(el) * (dx * np.cos(az) + dz * np.sin(az))
    d_el: FloatArray = dz * np.cos(az) - dx * np.sin(az)
    return d_az, d_el


def pointing_sigma(
    azimuth: ArrayLike, elevation: ArrayLike, sigma_x: ArrayLike, sigma_z: ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Sigma of azimuth and elevation from independent attitude sigmas by the small-angle forms.

    Angles in the radar frame, for a level radar. At alpha_x = 3 degrees and 1 degree of elevation the azimuth sigma is
    2.5 times as large: use `report_sensitivity`.
    """
    az, el, sx, sz = (_float(v) for v in (azimuth, elevation, sigma_x, sigma_z))
    across = np.abs(np.tan(el)) * np.hypot(sx * np.cos(az), sz * np.sin(az))
    up = np.hypot(sz * np.cos(az), sx * np.sin(az))
    return across, up


def report_sensitivity(
    azimuth: ArrayLike, elevation: ArrayLike, heading: ArrayLike, attitude: tuple[ArrayLike, ArrayLike]
) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    """Derivatives of the report error by the attitude errors: ((dAz/dax, dAz/daz), (dEl/dax, dEl/daz)), at an attitude.

    Central differences of the exact rotations. A tilted radar turns a pitch error into azimuth, by sin(alpha_x), at
    every elevation: far more than the tan(El) of the small-angle forms leaves for a low target.
    """
    step = 1e-5
    x, z = (_float(v) for v in attitude)
    columns = []
    for dx, dz in ((step, 0.0), (0.0, step)):
        ahead = report_error(azimuth, elevation, heading, (x, z), (x + dx, z + dz))
        behind = report_error(azimuth, elevation, heading, (x, z), (x - dx, z - dz))
        columns.append([(a - b) / (2 * step) for a, b in zip(ahead, behind, strict=True)])
    return (columns[0][0], columns[1][0]), (columns[0][1], columns[1][1])


def misalignment(alpha_x: ArrayLike, error_x: ArrayLike, error_z: ArrayLike) -> FloatArray:
    """Matrix (..., 3, 3) from the true to the believed radar frame, exact: A_x(ax) A_x(dax) A_z(daz) A_x(ax)^T.

    References
    ----------
    Kim (2011), eq 14.
    """
    roll = rotation_x(alpha_x)
    turned: FloatArray = roll @ rotation_x(error_x) @ rotation_z(error_z) @ np.swapaxes(roll, -1, -2)
    return turned


def misalignment_first_order(alpha_x: ArrayLike, error_x: ArrayLike, error_z: ArrayLike) -> FloatArray:
    """`misalignment` to first order in the errors: Kim (2011), eq 15, or with `alpha_x` 0 the paper's eq 16."""
    ax, dx, dz = np.broadcast_arrays(_float(alpha_x), _float(error_x), _float(error_z))
    c, s, i, o = dz * np.cos(ax), dz * np.sin(ax), np.ones_like(dx), np.zeros_like(dx)
    rows = ((i, -c, -s), (c, i, -dx), (s, dx, i + o))
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _difference(pointed: FloatArray, meant: FloatArray) -> tuple[FloatArray, FloatArray]:
    (az, el), (az0, el0) = azimuth_elevation(pointed), azimuth_elevation(meant)
    return wrapped(az - az0), el - el0


def _float(value: ArrayLike) -> FloatArray:
    return np.asarray(value, dtype=np.float64)
