"""A simulated track-while-scan radar with an alpha-beta tracker, whose truth is known at every update.

An aircraft flies in at constant altitude; the radar measures range and the sines of two array angles; the
tracker predicts in the earth-fixed north-up-east frame and updates range, y and z of the array face
separately, each with its own gains. The log it would write, and the truth behind it, come back as plain
arrays.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rangeeval.compiled import compiled

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_SPEED_OF_LIGHT_M_S = 299792458.0


@dataclass(frozen=True)
class Scenario:
    """Flights, radar and tracker to simulate. SI units; angles in radians.

    `acceleration_sigma_m_s2` is the target's own white acceleration on each axis, constant over an interval;
    `design_acceleration_m_s2` the one the gains are made for. Below `switch_range_m` (predicted) the radar
    uses waveform 1 with `bandwidth_near_hz`. `keeps_direction`: the tracker holds the direction, not y and z,
    when its range changes. `snr_log_sigma_db` scatters the logged SNR about the true mean. An outlier is a
    measurement whose errors are `outlier_factor` times as large.
    """

    flights: int = 10
    start_range_m: float = 100_000.0
    end_range_m: float = 10_000.0
    altitude_m: float = 2_000.0
    cross_range_m: float = 5_000.0
    speed_m_s: float = 250.0
    outbound: bool = False
    interval_s: float = 0.5
    acceleration_sigma_m_s2: float = 0.0
    design_acceleration_m_s2: float = 5.0
    reference_snr_db: float = 20.0
    reference_range_m: float = 80_000.0
    snr_log_sigma_db: float = 0.0
    bandwidth_hz: float = 1.5e6
    switch_range_m: float = 0.0
    bandwidth_near_hz: float = 0.5e6
    beamwidth_elevation_rad: float = float(np.deg2rad(1.5))
    beamwidth_azimuth_rad: float = float(np.deg2rad(1.5))
    monopulse_slope: float = 1.6
    range_floor_m: float = 0.0
    angle_floor_rad: float = 0.0
    heading_rad: float = 0.0
    tilt_rad: float = 0.0
    keeps_direction: bool = False
    miss_probability: float = 0.0
    outlier_probability: float = 0.0
    outlier_factor: float = 10.0


@dataclass(frozen=True)
class TrackLog:
    """One row per update of every track in time order within each track, and the truth. All arrays have n
    entries.

    The two measurements that start a track are not updates and have no row. A missed detection is a row
    without residuals (NaN) and with zero gains. `outbound` is 0 on the way in, 1 on the way out (a new
    track). `waveform` is 0 or 1.
    """

    time_s: FloatArray
    track: IntArray
    update: IntArray
    outbound: IntArray
    waveform: IntArray
    range_residual_m: FloatArray
    y_residual_m: FloatArray
    z_residual_m: FloatArray
    range_predicted_m: FloatArray
    y_predicted_m: FloatArray
    z_predicted_m: FloatArray
    alpha_range: FloatArray
    beta_range: FloatArray
    alpha_y: FloatArray
    beta_y: FloatArray
    alpha_z: FloatArray
    beta_z: FloatArray
    snr_db: FloatArray
    snr_true_db: FloatArray
    outlier: NDArray[np.bool_]
    range_true_m: FloatArray
    y_true_m: FloatArray
    z_true_m: FloatArray
    range_filtered_m: FloatArray
    y_filtered_m: FloatArray
    z_filtered_m: FloatArray


def simulate(scenario: Scenario, seed: int) -> TrackLog:
    """Fly a scenario; the same scenario and seed give the same bits.

    A track ends at the end of its leg, or early if its estimate leaves the half-space in front of the array.

    Raises
    ------
    ValueError : the flight does not fit: ends not in front of the start, or the end nearer than the offset
    allows.

    References
    ----------
    Shin and Kim (2015), eqs 4-6 (filter and residual); gains by Kalata (1984).
    """
    s = scenario
    offset = np.hypot(s.altitude_m, s.cross_range_m)
    if not offset < s.end_range_m < s.start_range_m:
        raise ValueError(
            f"flight from {s.start_range_m:g} m to {s.end_range_m:g} m passing at {offset:g} m; "
            "give start_range_m > end_range_m > hypot(altitude_m, cross_range_m)"
        )
    far = float(np.sqrt(s.start_range_m**2 - offset**2))
    near = float(np.sqrt(s.end_range_m**2 - offset**2))
    steps = int((far - near) / (s.speed_m_s * s.interval_s)) + 1
    legs = 2 if s.outbound else 1
    tracks = s.flights * legs
    if steps < 3:
        raise ValueError(f"the flight has {steps} measurements; lengthen it so that a track of 3 or more can form")

    generator = np.random.default_rng(seed)
    # Drawn here and in this order, so that the kernel stays free of random state.
    noise = generator.standard_normal((tracks, steps, 3))
    acceleration = generator.standard_normal((tracks, steps, 3)) * s.acceleration_sigma_m_s2
    missed = generator.random((tracks, steps)) < s.miss_probability
    outlier = generator.random((tracks, steps)) < s.outlier_probability
    logged = generator.standard_normal((tracks, steps)) * s.snr_log_sigma_db

    noise = np.where(outlier[..., None], noise * s.outlier_factor, noise)
    outbound = np.arange(tracks) % legs
    # Flown along the boresight's ground track, offset to its right; the heading turns both into NUE.
    c, sn = np.cos(s.heading_rad), np.sin(s.heading_rad)
    along = np.where(outbound == 1, near, far)
    start = np.stack(
        [along * c - s.cross_range_m * sn, np.full(tracks, s.altitude_m), along * sn + s.cross_range_m * c],
        -1,
    )
    way = np.where(outbound == 1, 1.0, -1.0) * s.speed_m_s
    velocity = np.stack([way * c, np.zeros(tracks), way * sn], -1)
    ct, st = np.cos(s.tilt_rad), np.sin(s.tilt_rad)
    face = np.array([[ct, st, 0.0], [-st, ct, 0.0], [0.0, 0.0, 1.0]]) @ np.array(
        [[c, 0.0, sn], [0.0, 1.0, 0.0], [-sn, 0.0, c]]
    )
    resolution = _SPEED_OF_LIGHT_M_S / 2 / np.array([s.bandwidth_hz, s.bandwidth_near_hz]) / np.sqrt(2)
    beam = np.array([s.beamwidth_elevation_rad, s.beamwidth_azimuth_rad]) / (s.monopulse_slope * np.sqrt(2))

    table, kept = _fly(
        start, velocity, acceleration, noise, missed, face, resolution, beam,
        s.interval_s, s.design_acceleration_m_s2, s.reference_snr_db, s.reference_range_m,
        s.switch_range_m, s.range_floor_m, s.angle_floor_rad, s.keeps_direction,
    )  # fmt: skip
    track, step = np.nonzero(kept)
    row = table[track, step]
    leg_time = steps * s.interval_s
    return TrackLog(
        time_s=(track * leg_time) + step * s.interval_s,
        track=track.astype(np.int64),
        update=step.astype(np.int64) - 2,
        outbound=outbound[track].astype(np.int64),
        waveform=row[:, 20].astype(np.int64),
        range_residual_m=row[:, 0],
        y_residual_m=row[:, 1],
        z_residual_m=row[:, 2],
        range_predicted_m=row[:, 3],
        y_predicted_m=row[:, 4],
        z_predicted_m=row[:, 5],
        alpha_range=row[:, 6],
        beta_range=row[:, 7],
        alpha_y=row[:, 8],
        beta_y=row[:, 9],
        alpha_z=row[:, 10],
        beta_z=row[:, 11],
        snr_db=row[:, 12] + logged[track, step],
        snr_true_db=row[:, 12],
        outlier=outlier[track, step] & ~missed[track, step],
        range_true_m=row[:, 13],
        y_true_m=row[:, 14],
        z_true_m=row[:, 15],
        range_filtered_m=row[:, 16],
        y_filtered_m=row[:, 17],
        z_filtered_m=row[:, 18],
    )


@compiled
def _kalata(index: float) -> tuple[float, float]:
    r = 2.0 * index / (np.sqrt(index * (8.0 + index)) + index)
    return r * (2.0 - r), 2.0 * r * r


@compiled
def _fly(
    start: FloatArray,
    start_velocity: FloatArray,
    acceleration: FloatArray,
    noise: FloatArray,
    missed: NDArray[np.bool_],
    face: FloatArray,
    resolution: FloatArray,
    beam: FloatArray,
    interval: float,
    design: float,
    reference_snr_db: float,
    reference_range: float,
    switch_range: float,
    range_floor: float,
    angle_floor: float,
    keeps_direction: bool,
) -> tuple[FloatArray, NDArray[np.bool_]]:
    tracks, steps = missed.shape
    table = np.full((tracks, steps, 21), np.nan)
    kept = np.zeros((tracks, steps), dtype=np.bool_)
    t = interval
    measured = np.empty(3)
    p = np.empty(3)
    v = np.empty(3)
    estimate = np.empty(3)  # of position and velocity, north-up-east
    rate = np.empty(3)
    first = np.empty(3)
    truth = np.empty(3)
    array_p = np.empty(3)
    array_v = np.empty(3)
    for track in range(tracks):
        for i in range(3):
            p[i] = start[track, i]
            v[i] = start_velocity[track, i]
        waveform = 0
        for k in range(steps):
            if k > 0:
                for i in range(3):
                    p[i] += v[i] * t + 0.5 * acceleration[track, k, i] * t * t
                    v[i] += acceleration[track, k, i] * t
            for i in range(3):
                truth[i] = face[i, 0] * p[0] + face[i, 1] * p[1] + face[i, 2] * p[2]
            true_range = np.sqrt(truth[0] ** 2 + truth[1] ** 2 + truth[2] ** 2)
            snr_db = reference_snr_db + 40.0 * np.log10(reference_range / true_range)
            root_snr = np.sqrt(10.0 ** (snr_db / 10.0))

            if k < 2:  # the two measurements that start the track
                waveform = 1 if true_range < switch_range else 0
            else:
                for i in range(3):
                    estimate[i] += rate[i] * t
                for i in range(3):
                    array_p[i] = face[i, 0] * estimate[0] + face[i, 1] * estimate[1] + face[i, 2] * estimate[2]
                    array_v[i] = face[i, 0] * rate[0] + face[i, 1] * rate[1] + face[i, 2] * rate[2]
                r_bar = np.sqrt(array_p[0] ** 2 + array_p[1] ** 2 + array_p[2] ** 2)
                y_bar = array_p[1]
                z_bar = array_p[2]
                if array_p[0] <= 0.0:
                    break
                waveform = 1 if r_bar < switch_range else 0

            # measurement: range and the sines of the array angles
            sine_e = truth[1] / true_range
            sine_a = truth[2] / true_range
            sigma_r = np.sqrt((resolution[waveform] / root_snr) ** 2 + range_floor**2)
            sigma_e = np.sqrt((beam[0] / root_snr) ** 2 + angle_floor**2)
            sigma_a = np.sqrt((beam[1] / root_snr) ** 2 + angle_floor**2)
            measured[0] = true_range + sigma_r * noise[track, k, 0]
            measured[1] = np.sin(np.arcsin(sine_e) + sigma_e * noise[track, k, 1])
            measured[2] = np.sin(np.arcsin(sine_a) + sigma_a * noise[track, k, 2])

            if k < 2:
                array_p[1] = measured[0] * measured[1]
                array_p[2] = measured[0] * measured[2]
                array_p[0] = np.sqrt(max(0.0, measured[0] ** 2 - array_p[1] ** 2 - array_p[2] ** 2))
                for i in range(3):
                    estimate[i] = face[0, i] * array_p[0] + face[1, i] * array_p[1] + face[2, i] * array_p[2]
                    if k == 0:
                        first[i] = estimate[i]
                    else:
                        rate[i] = (estimate[i] - first[i]) / t
                continue

            row = table[track, k]
            kept[track, k] = True
            row[3] = r_bar
            row[4] = y_bar
            row[5] = z_bar
            row[12] = snr_db
            row[13] = true_range
            row[14] = truth[1]
            row[15] = truth[2]
            row[20] = waveform
            if missed[track, k]:
                for i in range(6, 12):
                    row[i] = 0.0
                row[16] = r_bar
                row[17] = y_bar
                row[18] = z_bar
                continue

            # gains from the tracking index of each axis, at the predicted position
            root_bar = np.sqrt(10.0 ** (reference_snr_db / 10.0)) * (reference_range / r_bar) ** 2
            s_r = np.sqrt((resolution[waveform] / root_bar) ** 2 + range_floor**2)
            s_y = np.sqrt((beam[0] / root_bar) ** 2 + angle_floor**2) * np.sqrt(r_bar**2 - y_bar**2)
            s_z = np.sqrt((beam[1] / root_bar) ** 2 + angle_floor**2) * np.sqrt(r_bar**2 - z_bar**2)
            a_r, b_r = _kalata(design * t * t / s_r)
            a_y, b_y = _kalata(design * t * t / s_y)
            a_z, b_z = _kalata(design * t * t / s_z)

            e_r = measured[0] - r_bar
            e_y = r_bar * (measured[1] - y_bar / r_bar)
            e_z = r_bar * (measured[2] - z_bar / r_bar)
            r_rate = (array_p[0] * array_v[0] + y_bar * array_v[1] + z_bar * array_v[2]) / r_bar
            r_hat = r_bar + a_r * e_r
            r_rate += b_r / t * e_r
            y_hat = y_bar + a_y * e_y
            z_hat = z_bar + a_z * e_z
            if keeps_direction:
                y_hat *= r_hat / r_bar
                z_hat *= r_hat / r_bar
            y_rate = array_v[1] + b_y / t * e_y
            z_rate = array_v[2] + b_z / t * e_z
            row[0] = e_r
            row[1] = e_y
            row[2] = e_z
            row[6] = a_r
            row[7] = b_r
            row[8] = a_y
            row[9] = b_y
            row[10] = a_z
            row[11] = b_z
            row[16] = r_hat
            row[17] = y_hat
            row[18] = z_hat
            square = r_hat**2 - y_hat**2 - z_hat**2
            if square <= 0.0:
                break
            x_hat = np.sqrt(square)
            x_rate = (r_hat * r_rate - y_hat * y_rate - z_hat * z_rate) / x_hat
            for i in range(3):
                estimate[i] = face[0, i] * x_hat + face[1, i] * y_hat + face[2, i] * z_hat
                rate[i] = face[0, i] * x_rate + face[1, i] * y_rate + face[2, i] * z_rate
    return table, kept
