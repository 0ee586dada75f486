"""Attitude on records whose motion was chosen: what is found, with which interval, and what is said of a bad record."""

import dataclasses
import math

import numpy as np
import pytest

from rangeeval.analyses.attitude import attitude, correct_plots
from rangeeval.errors import InputError
from rangeeval.model import Bins, Trial, log_of, settings_from
from rangeeval.physics.attitude import noise_amplification
from rangeeval.physics.frames import attitude_matrix, turn, turn_back
from rangeeval.physics.pointing import azimuth_elevation
from rangeeval.scenarios.attitude import figure_3_grid, table_1_attitude, table_1_path

G = 9.80665
NOISE = G * math.radians(0.1)
ALL = Bins("range", 1e6, 0.0, 30)


def readings(time, radii, *, noise=NOISE, seed=1, motion=table_1_attitude):
    """Columns of a tilt log: sensors at `radii` (name to m) on the Table 1 radar."""
    rng = np.random.default_rng(seed)
    x, z, x_dd, z_dd = motion(time)
    columns = {"time_s": time}
    for name, radius in radii.items():
        for axis, clean in (("x", G * np.sin(x) * np.cos(z) + radius * x_dd), ("z", G * np.sin(z) + radius * z_dd)):
            columns[f"{name}_{axis}_accel_m_s2"] = clean + noise * rng.standard_normal(time.size)
    return columns


def made(*tilt, settings=None, bins=None, **logs):
    """A trial of tilt logs and others, with [attitude] settings."""
    own = {"attitude": {"gravity_m_s2": G, "radius_upper_m": 5.0, "radius_lower_m": 1.0} | (settings or {})}
    if bins:
        own["bins"] = bins
    found = [log_of("tilt", t, f"tilt_{i + 1}.csv" if len(tilt) > 1 else "tilt.csv") for i, t in enumerate(tilt)]
    found += [log_of(kind, columns, f"{kind}.csv") for kind, columns in logs.items()]
    return Trial("made", tuple(found), settings_from(own))


def rows(result, **where):
    """Estimates by quantity; those of the whole trial unless a group is asked for."""
    group = where.get("group")
    return {r.quantity: r for r in result.rows if r.group == group}


TIME = np.arange(3301) / 10.0


def path(time):
    return dict(zip(("time_s", "north_m", "up_m", "east_m"), (time, *table_1_path(time).T), strict=True))


def test_the_table_1_radar_comes_back_with_intervals_that_hold_the_truth():
    """Static tilt, amplitude, frequency, the published noise-free peaks 2.583 and 3.873 degrees, and the amplified noise."""
    found = rows(attitude(made(readings(TIME, {"upper": 5.0, "lower": 1.0}, seed=3))))
    truth = {
        "static_x": math.radians(3.0), "static_z": math.radians(2.0),
        "dynamic_amplitude_x": math.radians(0.2), "dynamic_amplitude_z": math.radians(0.3),
        "frequency_x": 0.8, "frequency_z": 0.8,
        "single_error_peak_x": math.radians(2.5832), "single_error_peak_z": math.radians(3.8732),
        "pair_error_sigma_x": math.radians(0.1 * 1.2747549 / math.cos(math.radians(3.0))),
        "pair_error_sigma_z": math.radians(0.1 * 1.2747549 / math.cos(math.radians(2.0))),
        "noise_amplification_x": 1.2747549,
    }  # fmt: skip
    for name, value in truth.items():
        row = found[name]
        assert row.low - 0.25 * (row.high - row.low) < value < row.high + 0.25 * (row.high - row.low), name
        assert row.value == pytest.approx(value, rel=0.06), name
    assert not {f for r in found.values() for f in r.flags} - {"from-tolerance"}


@pytest.mark.parametrize(("radii", "x", "z"), [((5, -5), 0.069, 0.070), ((5, 1), 0.129, 0.128), ((5, 4), 0.656, 0.644)])
def test_the_pair_errs_by_the_published_sigmas(radii, x, z):
    """The pair's error of Table 1 at three pairs of radii, as the scatter against the true attitude and as estimated."""
    columns = readings(TIME, {"upper": radii[0], "lower": radii[1]}, seed=11)
    result = attitude(made(columns, settings={"radius_upper_m": float(radii[0]), "radius_lower_m": float(radii[1])}))
    found = rows(result)
    for axis, printed in (("x", x), ("z", z)):
        assert math.degrees(found[f"pair_error_sigma_{axis}"].value) == pytest.approx(printed, rel=0.06)
    assert found["noise_amplification_x"].value == pytest.approx(noise_amplification(radii))


POINTING = {  # method: radii, noise, El rms, Az rms (deg), as published for the whole path
    ("none", (5, 1)): (0.0, 1.79, 0.56),
    ("single", (5, 1)): (NOISE, 2.58, 0.47),
    ("pair", (5, -5)): (NOISE, 0.070, 0.011),
    ("pair", (5, 1)): (NOISE, 0.128, 0.022),
    ("pair", (5, 4)): (NOISE, 0.64, 0.12),
}


@pytest.mark.parametrize(("case", "expected"), POINTING.items(), ids=str)
def test_report_errors_over_the_path_are_the_published_ones(case, expected):
    """Root mean square elevation and azimuth error of each method, target and accelerometers at the same instants."""
    (method, radii), (noise, elevation, azimuth) = case, expected
    columns = readings(TIME, {"upper": radii[0], "lower": radii[1]}, noise=noise, seed=4)
    settings = {"radius_upper_m": float(radii[0]), "radius_lower_m": float(radii[1])}
    found = rows(attitude(made(columns, settings=settings, truth=path(TIME)), ALL), group=method)
    assert math.degrees(found["elevation_error_rms"].value) == pytest.approx(elevation, rel=0.03)
    # One published record each: the azimuth's mean square hangs on its last few seconds.
    assert math.degrees(found["azimuth_error_rms"].value) == pytest.approx(
        azimuth, rel=0.13 if method == "pair" else 0.03
    )
    if method == "none":
        assert math.degrees(found["elevation_error_peak"].value) == pytest.approx(2.23, abs=0.006)
        assert math.degrees(found["azimuth_error_peak"].value) == pytest.approx(3.04, abs=0.015)


def test_the_noise_of_the_pair_is_taken_off_the_errors_judged_by_it():
    """A pair of six times the noise (5 and 4 m) still gives the errors of no attitude and one accelerometer, not 6 % more."""
    columns = readings(TIME, {"upper": 5.0, "lower": 4.0}, seed=6)
    result = attitude(made(columns, settings={"radius_lower_m": 4.0}, truth=path(TIME)), ALL)
    for method, expected in (("none", 1.79), ("single", 2.58)):
        row = rows(result, group=method)["elevation_error_rms"]
        assert math.degrees(row.value) == pytest.approx(expected, rel=0.025)


def test_a_gap_in_one_of_two_logs_is_a_gap():
    """Where the second log is silent its sensor is missing: no attitude there, and none is drawn across."""
    upper = readings(TIME, {"upper": 5.0}, noise=0.0)
    keep = (TIME < 150) | (TIME > 162)
    lower = {k: v[keep] for k, v in readings(TIME, {"lower": 1.0}, noise=0.0).items()}
    seen = np.arange(0.0, 330.0, 0.47)
    row = rows(attitude(made(upper, lower, truth=path(seen)), ALL), group="none")["elevation_error_rms"]
    assert row.n == np.count_nonzero((seen <= 149.9) | (seen >= 162.1))
    assert "no-attitude" in row.flags


def test_the_grid_of_figure_3_is_what_an_analysis_of_each_cell_finds():
    """A noise-free record of every third cell of the grid gives back the printed peak error."""
    for i, amplitude in enumerate((0.2, 0.6, 1.0)):
        for j, frequency in enumerate((0.2, 0.6, 1.0)):

            def motion(time, amplitude=amplitude, frequency=frequency):
                a, w = math.radians(amplitude), 2 * math.pi * frequency
                swing = a * np.sin(w * time)
                return 0 * time, swing, 0 * time, -(w**2) * swing

            time = np.arange(12_000) / 100.0
            columns = readings(time, {"upper": 5.0, "lower": 1.0}, noise=1e-9, motion=motion)
            peak = rows(attitude(made(columns)))["single_error_peak_z"].value
            assert math.degrees(peak) == pytest.approx(figure_3_grid()[2 * i, 2 * j], rel=2e-4)


def test_pieces_do_not_change_the_result():
    """The log in pieces of 700 rows gives the numbers of one piece, but for the piece from which the segments are sized."""
    columns = readings(TIME, {"upper": 5.0, "lower": 1.0})
    whole = made(columns, truth=path(TIME[::7] + 0.03))
    log = whole.logs[0]

    def pieces(names):
        for table in log.pieces(names):
            for start in range(0, len(table), 700):
                yield table.take(np.arange(start, min(start + 700, len(table))))

    parts = dataclasses.replace(whole, logs=(dataclasses.replace(log, pieces=pieces), *whole.logs[1:]))
    a, b = (attitude(t, ALL) for t in (whole, parts))
    for x, y in zip(a.rows, b.rows, strict=True):
        assert (x.quantity, x.group) == (y.quantity, y.group)
        if not x.quantity.startswith(("pair_error", "sensor_noise", "budget", "coherence")) and x.group != "pair":
            assert y.value == pytest.approx(x.value, rel=2e-3, nan_ok=True), x.quantity


def test_a_long_fast_record_is_held_in_blocks_and_says_the_same():
    """400 000 samples at 1 kHz are reduced to blocks; tilt, amplitude and frequency are found none the worse."""
    time = np.arange(400_000) / 1000.0
    result = attitude(made(readings(time, {"upper": 5.0, "lower": 1.0})))
    slow = np.arange(400_000) / 50.0  # blocks of 0.08 s would take half a percent off the amplitude
    coarse = rows(attitude(made(readings(slow, {"upper": 5.0, "lower": 1.0}))))["single_error_peak_z"]
    assert math.degrees(coarse.value) == pytest.approx(3.873, rel=1e-3)
    found = rows(result)
    assert result.settings["block"] == 4
    assert found["frequency_z"].value == pytest.approx(0.8, abs=2e-6)
    assert math.degrees(found["static_x"].value) == pytest.approx(3.0, abs=0.001)
    assert math.degrees(found["single_error_peak_z"].value) == pytest.approx(3.873, rel=2e-3)
    assert found["pair_error_sigma_z"].value == pytest.approx(math.radians(0.12755), rel=0.02)


def test_three_sensors_are_a_line_and_a_bend_is_seen():
    """A third sensor lowers the noise as the formula says; off the line by the swing it flags a body that is not rigid."""
    radii = {"upper": 5.0, "lower": 1.0, "sensor_3": -3.0}
    settings = {"radius_m": {"sensor_3": -3.0}}
    good = rows(attitude(made(readings(TIME, radii), settings=settings)))
    assert good["noise_amplification_x"].value == pytest.approx(noise_amplification([5.0, 1.0, -3.0]))
    assert good["pair_error_sigma_x"].value == pytest.approx(
        math.radians(0.1 * noise_amplification([5.0, 1.0, -3.0])), rel=0.08
    )
    assert "not-rigid" not in good["static_x"].flags
    bent = readings(TIME, radii | {"upper": 5.5})
    assert "not-rigid" in rows(attitude(made(bent, settings=settings)))["static_x"].flags


def test_sensors_may_stand_in_logs_of_their_own():
    """The lower sensor in a second log, at another rate and start, gives the same attitude on the common time."""
    upper = readings(TIME, {"upper": 5.0}, noise=0.0)
    lower = readings(np.arange(-3.0, 400.0, 0.05), {"lower": 1.0}, noise=0.0)
    found = rows(attitude(made(upper, lower)))
    assert math.degrees(found["static_x"].value) == pytest.approx(3.0, abs=1e-3)
    assert math.degrees(found["single_error_peak_z"].value) == pytest.approx(3.873, rel=1e-3)


def test_radii_come_from_the_motion_when_only_the_spacing_is_known():
    """With spacing_m alone the oscillation shows both radii, their intervals hold the truth, and the rows say so."""
    columns = readings(TIME, {"upper": 5.0, "lower": 1.0})
    trial = Trial(
        "made", (log_of("tilt", columns),), settings_from({"attitude": {"gravity_m_s2": G, "spacing_m": 4.0}})
    )
    result = attitude(trial)
    upper = rows(result, group="upper")["radius_z"]
    assert upper.low < 5.0 < upper.high
    assert upper.high - upper.low < 0.05
    assert "calibrated" in rows(result)["static_z"].flags
    assert math.degrees(rows(result)["single_error_peak_z"].value) == pytest.approx(3.873, rel=0.01)


def test_one_sensor_says_what_it_can():
    """Static tilt and frequency need no pair; without a radius the amplitude is missing, with it a sine is assumed."""
    columns = readings(TIME, {"upper": 5.0})
    without = Trial("made", (log_of("tilt", columns),), settings_from({"attitude": {"gravity_m_s2": G}}))
    found = rows(attitude(without))
    assert math.degrees(found["static_x"].value) == pytest.approx(3.0, abs=0.02)
    assert found["frequency_x"].value == pytest.approx(0.8, abs=1e-3)
    for name in ("dynamic_amplitude_x", "pair_error_sigma_x", "noise_amplification_x", "single_error_peak_x"):
        assert math.isnan(found[name].value)
        assert "one-sensor" in found[name].flags
    known = rows(attitude(made(columns)))
    assert math.degrees(known["dynamic_amplitude_z"].value) == pytest.approx(0.3, rel=0.02)
    assert math.degrees(known["single_error_peak_z"].value) == pytest.approx(3.873, rel=0.02)
    assert "assumes-sine" in known["single_error_peak_z"].flags
    pointing = rows(attitude(made(columns, truth=path(TIME)), ALL), group="none")
    assert math.isnan(pointing["elevation_error_rms"].value)
    assert "one-sensor" in pointing["elevation_error_rms"].flags


def test_a_radar_at_rest_has_a_limit_and_an_allan_deviation():
    """Noise alone shows no oscillation: the amplitude is missing with an upper limit, and the Allan deviation is there."""

    def still(time):
        return 0 * time + 0.01, 0 * time - 0.02, 0 * time, 0 * time

    result = attitude(made(readings(TIME, {"upper": 5.0, "lower": 1.0}, motion=still)))
    row = rows(result)["dynamic_amplitude_x"]
    assert math.isnan(row.value)
    assert 0 < math.degrees(row.high) < 0.05
    assert "no-oscillation" in row.flags
    assert rows(result)["static_x"].low < 0.01 < rows(result)["static_x"].high
    tau, deviation = result.series["x/allan"]["tau_s"], result.series["x/allan"]["deviation"]
    assert deviation[0] == pytest.approx(math.radians(0.12755), rel=0.05)
    assert deviation[10] == pytest.approx(deviation[0] * (tau[0] / tau[10]) ** 0.5, rel=0.15)


def test_the_allan_deviation_is_that_of_the_stretch_at_rest():
    """A radar that rests for 100 s and then rocks: the deviation is of the rest alone, and there is none without a rest."""

    def then_rocks(time):
        x, z, x_dd, z_dd = table_1_attitude(time)
        still = time < 100.0
        return (
            np.where(still, math.radians(3.0), x), np.where(still, math.radians(2.0), z),
            np.where(still, 0.0, x_dd), np.where(still, 0.0, z_dd),
        )  # fmt: skip

    radii = {"upper": 5.0, "lower": 1.0}
    data = attitude(made(readings(TIME, radii, motion=then_rocks))).series["z/allan"]
    assert 90.0 < 9.0 * data["tau_s"][-1] < 101.0
    assert data["deviation"][0] == pytest.approx(math.radians(0.12755), rel=0.06)
    assert data["deviation"][10] == pytest.approx(
        data["deviation"][0] * (data["tau_s"][0] / data["tau_s"][10]) ** 0.5, rel=0.3
    )
    assert "z/allan" not in attitude(made(readings(TIME, radii))).series


def test_an_oscillation_that_grows_is_called_varying_and_judged_where_it_is_largest():
    """Growing linearly, the amplitude is the root mean square and the peak error that of the last segments."""

    def motion(time):
        swing = np.deg2rad(0.4 * time / time[-1]) * np.sin(2 * np.pi * 0.8 * time)
        second = np.gradient(np.gradient(swing, time), time)
        return 0 * time, swing, 0 * time, second

    time = np.arange(33_000) / 100.0
    found = rows(attitude(made(readings(time, {"upper": 5.0, "lower": 1.0}, motion=motion))))
    assert "amplitude-varies" in found["dynamic_amplitude_z"].flags
    assert math.degrees(found["dynamic_amplitude_z"].value) == pytest.approx(0.4 / math.sqrt(3), rel=0.03)
    assert math.degrees(found["single_error_peak_z"].value) == pytest.approx(0.4 * 12.9, rel=0.08)


# --- bad input --------------------------------------------------------------------------------------------------------


def both(**change):
    columns = readings(TIME, {"upper": 5.0, "lower": 1.0})
    return columns | {k: v(columns[k]) for k, v in change.items()}


def said(result, words):
    return [str(p) for p in result.problems if words in str(p)]


def test_equal_radii_are_refused_in_one_line():
    """The line names the file, the value and why."""
    with pytest.raises(InputError, match=r"radii of upper and lower .* are all 3 m"):
        attitude(made(both(), settings={"radius_upper_m": 3.0, "radius_lower_m": 3.0}))


def test_a_missing_channel_leaves_the_other_axis_whole():
    """Without lower_x roll has one sensor and says so; pitch keeps its pair."""
    columns = both()
    del columns["lower_x_accel_m_s2"]
    result = attitude(made(columns))
    assert said(result, "no column lower_x_accel_m_s2")
    assert "one-sensor" in rows(result)["static_x"].flags
    assert math.isfinite(rows(result)["pair_error_sigma_z"].value)


def test_a_stuck_sensor_is_told_from_a_dead_one():
    """Thirty seconds of one value are taken out and flagged; a sensor that never moves is refused."""

    def hold(x):
        return np.where((TIME > 100) & (TIME < 130), x[1000], x)

    result = attitude(made(both(lower_z_accel_m_s2=hold)))
    assert said(result, "lower_z_accel_m_s2 stands still")
    assert "stuck-sensor" in rows(result)["static_z"].flags
    assert math.degrees(rows(result)["dynamic_amplitude_z"].value) == pytest.approx(0.3, rel=0.05)
    with pytest.raises(InputError, match=r"upper_x_accel_m_s2 never changes .* stuck"):
        attitude(made(both(upper_x_accel_m_s2=lambda x: 0 * x + 0.3)))


def test_a_saturated_sensor_is_flagged():
    """Readings that pile up at a ceiling are counted and the axis is flagged."""
    result = attitude(made(both(upper_z_accel_m_s2=lambda x: np.minimum(x, 0.7))))
    assert said(result, "upper_z_accel_m_s2 stands at its highest")
    assert "saturated" in rows(result)["dynamic_amplitude_z"].flags
    assert "saturated" not in rows(result)["dynamic_amplitude_x"].flags


def test_readings_beyond_g_are_missing_and_counted():
    """Three wild samples are counted and flagged; more than one in a thousand make the axis unusable."""

    def wild(count):
        return lambda x: np.where(np.arange(x.size) < count, 30.0 + np.arange(x.size), x)

    few = attitude(made(both(upper_x_accel_m_s2=wild(2))))
    assert said(few, "upper_x_accel_m_s2 is beyond g")
    many = rows(attitude(made(both(lower_x_accel_m_s2=wild(40)))))
    assert {"beyond-g", "unusable"} <= set(many["static_x"].flags)
    assert "unusable" not in many["static_z"].flags


def test_gaps_are_never_bridged():
    """A gap is named with its place; detections in it have no attitude and are counted."""
    columns = both()
    keep = (TIME < 150) | (TIME > 162)
    seen = np.arange(0.0, 330.0, 0.47)
    result = attitude(made({k: v[keep] for k, v in columns.items()}, truth=path(seen)), ALL)
    assert said(result, "1 gap, 12.2 s together")
    assert said(result, f"left out of the bins ({np.count_nonzero((seen > 149.9) & (seen < 162.1))} rows)")
    assert "gaps" in rows(result)["static_x"].flags
    none = rows(result, group="none")["elevation_error_rms"]
    assert "no-attitude" in none.flags
    assert none.n == np.count_nonzero((seen <= 149.9) | (seen >= 162.1))


def test_a_clock_that_was_set_is_noticed():
    """A step back is named; times shown twice have no attitude. A step forward is a gap."""
    columns = both()
    stepped = columns | {"time_s": np.where(TIME > 200, TIME - 20.05, TIME)}
    result = attitude(made(stepped, truth=path(np.arange(0.0, 300.0, 0.47))), ALL)
    assert said(result, "the clock steps back 1 time")
    assert "clock-step" in rows(result)["static_x"].flags
    assert rows(result, group="none")["elevation_error_rms"].n < 640 - 38
    forward = attitude(made(columns | {"time_s": np.where(TIME > 200, TIME + 60.0, TIME)}))
    assert said(forward, "1 gap, 60.1 s together")


def test_two_logs_on_different_clocks_are_refused_or_flagged():
    """No common time is one clear line; a skew of 40 ms is measured and flagged."""
    upper, lower = readings(TIME, {"upper": 5.0}), readings(TIME, {"lower": 1.0}, seed=2)
    with pytest.raises(InputError, match="share no time, so their clocks differ"):
        attitude(made(upper, lower | {"time_s": TIME + 1.7e9}))
    result = attitude(made(upper, lower | {"time_s": TIME + 0.04}))
    skew = rows(result)["time_skew_z"]
    assert skew.low < 0.04 < skew.high
    assert "clocks-differ" in skew.flags
    assert said(result, "their clocks differ, or the body bends")


def test_detections_on_another_clock_are_named():
    """No detection falls on an attitude: said in words, and every bin is missing."""
    result = attitude(made(both(), truth=path(TIME) | {"time_s": TIME + 86400.0}), ALL)
    assert said(result, "are both on one clock?")
    assert math.isnan(rows(result, group="none")["elevation_error_rms"].value)


def test_a_wrong_unit_is_said():
    """With the vertical logged, 1 m/s^2 on the mean is g; without it, readings above g, or suspiciously small ones, are named."""
    vertical = {"upper_y_accel_m_s2": np.full(TIME.size, G)}
    columns = both() | vertical
    attitude(made(columns))
    with pytest.raises(InputError, match=r"mean magnitude .* is 1 m/s\^2.*readings are in g"):
        attitude(made({k: v if k == "time_s" else v / G for k, v in columns.items()}))
    with pytest.raises(InputError, match=r"readings are in m/s\^2"):
        attitude(made({k: v if k == "time_s" else v * G for k, v in columns.items()}))
    with pytest.raises(InputError, match="more than g"):
        attitude(made({k: v if k == "time_s" else v * 100 for k, v in both().items()}))
    small = attitude(made({k: v if k == "time_s" else v / G for k, v in both().items()}))
    assert said(small, "if they are in g, end the column names in _g")
    assert not said(attitude(made(both())), "if they are in g")


def test_two_logs_with_one_sensor_name_are_refused():
    """The line says which column and what to do."""
    with pytest.raises(InputError, match="both hold upper_x_accel_m_s2"):
        attitude(made(readings(TIME, {"upper": 5.0}), readings(TIME, {"upper": 1.0})))


# --- correction -------------------------------------------------------------------------------------------------------


def plots_of(time):
    """Plots of a radar that takes itself for level."""
    x, z, *_ = table_1_attitude(time)
    seen = turn_back(attitude_matrix(0.5), turn(attitude_matrix(0.5, x, z), table_1_path(time)))
    az, el = azimuth_elevation(seen)
    return {"time_s": time, "target_id": ["A, B"] * time.size, "range_m": np.linalg.norm(table_1_path(time), axis=1),
            "azimuth_rad": np.mod(az, 2 * np.pi), "elevation_rad": el}  # fmt: skip


def test_corrected_plots_are_the_truth_and_gaps_are_flagged_not_guessed():
    """Noise-free, angles come back to interpolation error; plots in a gap are missing and flagged, with what was measured beside."""
    time = np.arange(0.0, 329.0, 0.47)
    fine = np.arange(33_001) / 100.0
    columns = readings(fine, {"upper": 5.0, "lower": 1.0}, noise=0.0)
    keep = (fine < 150) | (fine > 162)
    trial = made({k: v[keep] for k, v in columns.items()}, plots=plots_of(time))
    trial = dataclasses.replace(
        trial,
        settings=dataclasses.replace(
            trial.settings, site=dataclasses.replace(trial.settings.site, heading_deg=math.degrees(0.5))
        ),
    )
    found = correct_plots(trial)
    az, el = azimuth_elevation(table_1_path(time))
    inside = (time > 150) & (time < 162)
    new_az, new_el = (np.array(found.columns[n]) for n in ("azimuth_rad", "elevation_rad"))
    assert np.isnan(new_az[inside]).all()
    assert np.isnan(new_el[inside]).all()
    assert [bool(f) for f in found.columns["flags"]] == inside.tolist()
    assert new_az[~inside] == pytest.approx(az[~inside], abs=2e-5)
    assert new_el[~inside] == pytest.approx(el[~inside], abs=2e-5)
    assert (found.corrected, found.flagged) == (np.count_nonzero(~inside), np.count_nonzero(inside))
    text = found.to_csv()
    assert text.splitlines()[1].split(",")[1:3] == ['"A', ' B"']


def test_correcting_needs_a_common_clock():
    """No plot on any attitude is one clear line."""
    plots = plots_of(np.arange(0.0, 100.0, 1.0))
    plots["time_s"] = plots["time_s"] + 1e6
    with pytest.raises(InputError, match="both on one clock"):
        correct_plots(made(both(), plots=plots))


# --- promises ---------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say():
    """Over 400 simulated records each 95 % interval holds the truth 91 to 99 % of the time."""
    held = dict.fromkeys(
        ("static_x", "dynamic_amplitude_z", "frequency_z", "single_error_peak_x", "pair_error_sigma_x", "time_skew_z"),
        0,
    )
    truth = {
        "static_x": math.radians(3.0), "dynamic_amplitude_z": math.radians(0.3), "frequency_z": 0.8,
        "single_error_peak_x": math.radians(2.583236), "time_skew_z": 0.0,
        "pair_error_sigma_x": math.radians(0.1) * 1.2747549 / math.cos(math.radians(3.0)) / math.cos(math.radians(2.0)),
    }  # fmt: skip
    radius_held = 0
    time = TIME[:1500]
    for seed in range(400):
        columns = readings(time, {"upper": 5.0, "lower": 1.0}, seed=seed)
        result = attitude(made(columns, settings={"radius_sigma_m": 0.0}))
        found = rows(result)
        for name in held:
            held[name] += found[name].low <= truth[name] <= found[name].high
        radius = rows(result, group="upper")["radius_from_motion_x"]
        radius_held += radius.low <= 5.0 <= radius.high
    shares = {name: count / 400 for name, count in held.items()} | {"radius": radius_held / 400}
    assert all(0.91 <= share <= 0.99 for share in shares.values()), shares


@pytest.mark.slow
def test_error_intervals_per_bin_hold_the_truth_as_often_as_they_say():
    """Detections at random phases: the 95 % interval of each method's root mean square holds the long-run value."""
    held = {("none", "elevation"): 0, ("single", "elevation"): 0, ("pair", "elevation"): 0}
    time = TIME[:1200]
    spread = math.radians(0.1) * 1.2747549 / math.cos(math.radians(2.0))
    for seed in range(300):
        rng = np.random.default_rng(seed)
        seen = np.sort(rng.choice(time, 100, replace=False))
        target = {"time_s": seen, "north_m": 0 * seen + 5e4, "up_m": 0 * seen + 10.0, "east_m": 0 * seen}
        result = attitude(made(readings(time, {"upper": 5.0, "lower": 1.0}, seed=seed), truth=target), ALL)
        noise = math.radians(0.1) / math.cos(math.radians(2.0))
        truth = {
            "none": math.sqrt(math.radians(2.0) ** 2 + math.radians(0.3) ** 2 / 2),
            "single": math.sqrt((math.radians(0.3) * 12.88217 / math.cos(math.radians(2.0))) ** 2 / 2 + noise**2),
            "pair": spread,
        }
        for method, angle in held:
            row = rows(result, group=method)[f"{angle}_error_rms"]
            held[method, angle] += row.low <= truth[method] <= row.high
    shares = {key: count / 300 for key, count in held.items()}
    assert all(share >= 0.9 for share in shares.values()), shares
