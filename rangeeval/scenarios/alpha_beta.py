"""Inbound flights seen by an alpha-beta tracker."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np

from rangeeval.physics.frames import beam_to_cartesian, face_matrix, turn_back
from rangeeval.scenarios.files import column, write_csv
from rangeeval.tracking.simulation import Scenario, TrackLog, simulate

_TRIAL_TOML = """\
# A simulated trial: seed {seed}. {about}
[trial]
name = {name}
date = 2026-05-14
radar = "Simulated phased array"
handling = "UNCLASSIFIED - SIMULATED DATA"

[site]
latitude_deg = 36.42
longitude_deg = 127.39
height_m = 110.0
heading_deg = {heading:.1f}
tilt_deg = {tilt:.1f}

[radar]
bandwidth_hz = {bandwidth:.6g}
beamwidth_elevation_deg = {elevation:.4g}
beamwidth_azimuth_deg = {azimuth:.4g}
monopulse_slope = {slope:.3g}
update_interval_s = {interval:g}

[bins]
variable = "range"
width = 5000.0
start = 0.0
min_samples = 30

[[requirements]]
name = "Range accuracy at 20 dB and better"
quantity = "range_sigma"
limit = 2.5
confidence = 0.95
when = {{ snr_db_min = 20.0 }}

[[requirements]]
name = "Elevation accuracy at 20 dB and better"
quantity = "elevation_sigma"
limit = 4.0e-4
confidence = 0.95
when = {{ snr_db_min = 20.0 }}
"""


def simulate_alpha_beta(
    directory: str | os.PathLike[str],
    *,
    seed: int,
    flights: int = 4,
    manoeuvre: float = 0.0,
    outbound: bool = False,
    no_truth: bool = False,
    scenario: Scenario | None = None,
    name: str = "Simulated inbound passes",
) -> list[Path]:
    """Write a trial of simulated flights inbound from 100 km at constant altitude: residuals, gains, truth, trial.toml.

    SNR falls with the fourth power of range, gains follow from the tracking index, and below 35 km a waveform of
    smaller bandwidth is used. The same seed gives the same bytes.

    Parameters
    ----------
    manoeuvre : sigma of the target's own white acceleration, m/s^2 (0: constant velocity).
    scenario : all of the simulation's parameters, instead of the above.

    References
    ----------
    The tracker of Shin and Kim (2015), eqs 1-6, with gains after Kalata (1984).
    """
    scenario = scenario or Scenario(
        flights=flights,
        outbound=outbound,
        acceleration_sigma_m_s2=manoeuvre,
        bandwidth_hz=2.0e6,
        switch_range_m=35_000.0,
        bandwidth_near_hz=1.0e6,
    )
    log = simulate(scenario, seed)
    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    tracks = [f"T{t + 1:03d}" for t in log.track.tolist()]
    key = {"time_s": column(log.time_s, 3), "track_id": tracks}
    residuals = {
        **key,
        **{f"{a}_residual_m": column(getattr(log, f"{a}_residual_m"), 4) for a in ("range", "y", "z")},
        **{f"{a}_predicted_m": column(getattr(log, f"{a}_predicted_m"), 3) for a in ("range", "y", "z")},
        "snr_db": column(log.snr_db, 2),
    }
    if scenario.switch_range_m:
        residuals["waveform"] = [("LONG", "SHORT")[w] for w in log.waveform.tolist()]
    gains = key | {
        f"{gain}_{a}": column(getattr(log, f"{gain}_{a}"), 6) for a in ("range", "y", "z") for gain in ("alpha", "beta")
    }
    written = [write_csv(folder / "residuals.csv", residuals), write_csv(folder / "gains.csv", gains)]
    if not no_truth:
        written.append(write_csv(folder / "truth.csv", _truth(scenario, log, key)))
    settings = _TRIAL_TOML.format(
        seed=seed,
        about="Constant-velocity targets." if not manoeuvre else f"Targets accelerate with sigma {manoeuvre:g} m/s^2.",
        name=json.dumps(name, ensure_ascii=False),
        heading=np.rad2deg(scenario.heading_rad),
        tilt=np.rad2deg(scenario.tilt_rad),
        bandwidth=scenario.bandwidth_hz,
        elevation=np.rad2deg(scenario.beamwidth_elevation_rad),
        azimuth=np.rad2deg(scenario.beamwidth_azimuth_rad),
        slope=scenario.monopulse_slope,
        interval=scenario.interval_s,
    )
    toml = folder / "trial.toml"
    toml.write_text(settings, encoding="utf-8")
    return [*written, toml]


def _truth(scenario: Scenario, log: TrackLog, key: dict[str, list[str]]) -> dict[str, list[str]]:
    """The true positions in north, up, east from the site."""
    position = beam_to_cartesian(log.range_true_m, log.y_true_m, log.z_true_m)
    north, up, east = turn_back(face_matrix(scenario.heading_rad, scenario.tilt_rad), position).T
    return {
        "time_s": key["time_s"],
        "target_id": key["track_id"],
        "north_m": column(north, 3),
        "up_m": column(up, 3),
        "east_m": column(east, 3),
    }
