"""A radar that rocks while a target flies in: the tilt paper's Table 1 scenario, and the grid of its Fig. 3."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import SettingsError
from rangeeval.physics.attitude import lever_ratio, reading, single_error_peak
from rangeeval.physics.frames import attitude_matrix, turn, turn_back
from rangeeval.physics.gravity import STANDARD_GRAVITY_M_S2
from rangeeval.physics.pointing import azimuth_elevation
from rangeeval.scenarios.files import column, write_csv

Array = NDArray[np.float64]

DURATION_S = 330.0  # 100 km at 300 m/s, up to 1 km before the closest point
UPDATE_S = 0.47  # between plots: in no simple ratio to the oscillation, so that they meet all its phases

_TRIAL_TOML = """\
# A simulated trial: seed {seed}. A radar rocks at {frequency:g} Hz while a target flies in from 100 km.
# Truth: alpha_x = 3 deg static and 0.2 deg dynamic, alpha_z = 2 deg static and 0.3 deg dynamic, in phase.
# The plots' angles are those of a radar that takes itself for level.
[trial]
name = {name}
date = 2026-05-14
radar = "Simulated ground radar"
handling = "UNCLASSIFIED - SIMULATED DATA"

[site]
latitude_deg = 36.42
longitude_deg = 127.39
height_m = 110.0
heading_deg = 0.0

[attitude]
radius_upper_m = {upper:g}
radius_lower_m = {lower:g}
gravity_m_s2 = {gravity:.5f}

[bins]
variable = "range"
width = 10000.0
start = 0.0
min_samples = 30
"""


def table_1_attitude(time_s: Array, frequency_hz: float = 0.8) -> tuple[Array, Array, Array, Array]:
    """(alpha_x, alpha_z) in rad and their second derivatives: Table 1 of Kim (2011), tilts *towards* each axis."""
    w = 2 * np.pi * frequency_hz
    swing = np.sin(w * time_s)
    x, z = (np.deg2rad(s) + np.deg2rad(d) * swing for s, d in ((3.0, 0.2), (2.0, 0.3)))
    return x, z, -np.deg2rad(0.2) * w**2 * swing, -np.deg2rad(0.3) * w**2 * swing


def table_1_path(time_s: Array, speed_m_s: float = 300.0) -> Array:
    """Target position (n, 3), north, up, east in m: 2 km up, 2 km aside, inbound from 100 km over a flat earth."""
    return np.stack(
        [100_000.0 - speed_m_s * time_s, np.full_like(time_s, 2000.0), np.full_like(time_s, 2000.0)], axis=-1
    )


def simulate_attitude(
    directory: str | os.PathLike[str],
    *,
    seed: int,
    radius_upper: float = 5.0,
    radius_lower: float = 1.0,
    rate: float = 10.0,
    noise_deg: float = 0.1,
    gap: bool = False,
    name: str = "Simulated rocking radar",
) -> list[Path]:
    """Write a trial of the tilt paper's Table 1 scenario: tilt, plots and truth logs, trial.toml.

    The same seed gives the same bytes.

    Parameters
    ----------
    radius_upper, radius_lower : of the accelerometers, m.
    rate : accelerometer samples a second.
    noise_deg : sigma of each accelerometer, as a tilt.
    gap : leave twelve seconds out of the tilt log.

    References
    ----------
    Kim (2011), Table 1 (frequency in Hz, amplitudes in degrees; what it does not give is chosen: g, path, radii).
    """
    if radius_upper == radius_lower:
        raise SettingsError(f"both radii are {radius_upper:g} m; the pair method needs two different ones")
    if not rate > 0:
        raise SettingsError(f"the rate is {rate:g} samples a second, expected more than 0")
    rng = np.random.default_rng(seed)
    g, frequency = STANDARD_GRAVITY_M_S2, 0.8
    time = np.arange(round(DURATION_S * rate) + 1) / rate
    x, z, x_dd, z_dd = table_1_attitude(time, frequency)
    sigma = g * math.radians(noise_deg)
    tilt = {"time_s": column(time, 4)}
    keep = ~((time > 150.0) & (time < 162.0)) if gap else np.ones(time.size, bool)
    tilt["time_s"] = column(time[keep], 4)
    for place, radius in (("upper", radius_upper), ("lower", radius_lower)):
        # Roll reads what pitch leaves of g.
        clean_x = g * np.sin(x) * np.cos(z) + radius * x_dd
        clean_z = reading(z, z_dd, radius, g)
        for axis, clean in (("x", clean_x), ("z", clean_z)):
            tilt[f"{place}_{axis}_accel_m_s2"] = column((clean + sigma * rng.standard_normal(time.size))[keep], 6)
    seen = np.arange(0.0, DURATION_S, UPDATE_S)
    position = table_1_path(seen)
    ax, az, *_ = table_1_attitude(seen, frequency)
    # What the antenna sees, turned back by a radar that takes itself for level.
    reported = turn_back(attitude_matrix(0.0), turn(attitude_matrix(0.0, ax, az), position))
    azimuth, elevation = azimuth_elevation(reported)
    spread = math.radians(0.02)
    plots = {
        "time_s": column(seen, 3),
        "target_id": ["T001"] * seen.size,
        "range_m": column(np.linalg.norm(position, axis=-1) + 10.0 * rng.standard_normal(seen.size), 2),
        "azimuth_deg": column(np.rad2deg(np.mod(azimuth + spread * rng.standard_normal(seen.size), 2 * np.pi)), 5),
        "elevation_deg": column(np.rad2deg(elevation + spread * rng.standard_normal(seen.size)), 5),
    }
    truth = {"time_s": column(seen, 3), "target_id": ["T001"] * seen.size} | {
        f"{axis}_m": column(values, 2) for axis, values in zip(("north", "up", "east"), position.T, strict=True)
    }
    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    written = [
        write_csv(folder / "tilt.csv", tilt),
        write_csv(folder / "plots.csv", plots),
        write_csv(folder / "truth.csv", truth),
    ]
    toml = folder / "trial.toml"
    toml.write_text(
        _TRIAL_TOML.format(
            seed=seed, frequency=frequency, name=json.dumps(name, ensure_ascii=False), upper=radius_upper,
            lower=radius_lower, gravity=g,
        ),
        encoding="utf-8",
    )  # fmt: skip
    return [*written, toml]


GRID_AMPLITUDES_DEG = (0.2, 0.4, 0.6, 0.8, 1.0)
GRID_FREQUENCIES_HZ = (0.2, 0.4, 0.6, 0.8, 1.0)


def figure_3_grid(radius_m: float = 5.0) -> Array:
    """Peak error (deg) of one accelerometer, rows amplitudes and columns frequencies of the paper's Fig. 3, level
    radar.
    """
    kappa = lever_ratio(radius_m, np.array(GRID_FREQUENCIES_HZ), STANDARD_GRAVITY_M_S2)
    grid: Array = np.rad2deg(single_error_peak(0.0, np.deg2rad(GRID_AMPLITUDES_DEG)[:, None], kappa[None, :]))
    return grid


def figure_3_text(radius_m: float = 5.0) -> str:
    """The grid as a table."""
    head = "amplitude (deg)" + "".join(f"{f:>9.1f} Hz" for f in GRID_FREQUENCIES_HZ)
    rows = [
        f"{a:>15.1f}" + "".join(f"{v:>12.3f}" for v in row)
        for a, row in zip(GRID_AMPLITUDES_DEG, figure_3_grid(radius_m), strict=True)
    ]
    title = f"Peak error of one accelerometer {radius_m:g} m from the rotation axis (deg)"
    return "\n".join([title, head, *rows]) + "\n"


__all__ = ["DURATION_S", "figure_3_grid", "figure_3_text", "simulate_attitude", "table_1_attitude", "table_1_path"]
