"""Errors against truth where bias, noise and clock offset were chosen."""

import math

import numpy as np
import pytest
from click.testing import CliRunner

import rangeeval
from rangeeval.analyses.truth import truth
from rangeeval.cli import cli
from rangeeval.errors import RangeevalError
from rangeeval.model import Bins, Trial, log_of
from rangeeval.model.settings import settings_from
from rangeeval.physics.geodesy import north_up_east
from rangeeval.physics.polar import polar

BINS = Bins(width=10e3)


def path(t, centre=(20e3, 4e3, 0.0), radius=12e3, w=0.02):
    """A circle at constant height, 240 m/s: range rate and azimuth rate change all the time."""
    return np.stack([
        centre[0] + radius * np.cos(w * t), np.full(np.shape(t), centre[1]), centre[2] + radius * np.sin(w * t)
    ], -1)  # fmt: skip


def made(seed=1, n=600, offset=0.0, bias=(0.0, 0.0, 0.0), sigma=(10.0, 1e-3, 2e-3), ids=("A", "A"), flight=path):
    """Plots each 2 s that show the target `offset` s later, and truth each second."""
    rng = np.random.default_rng(seed)
    t = 5.0 + 2.0 * np.arange(n)
    z = polar(flight(t + offset)) + np.array(bias) + rng.normal(size=(n, 3)) * sigma
    when = np.arange(0.0, t[-1] + 10.0)
    p = flight(when)
    plots = {"time_s": t, "range_m": z[:, 0], "azimuth_rad": np.mod(z[:, 1], 2 * np.pi), "elevation_rad": z[:, 2]}
    true = {"time_s": when, "north_m": p[:, 0], "up_m": p[:, 1], "east_m": p[:, 2]}
    if ids[0] is not None:
        plots["target_id"] = [ids[0]] * n
    if ids[1] is not None:
        true["target_id"] = [ids[1]] * len(when)
    return plots, true


def trial_of(plots, true, settings=None):
    logs = (log_of("plots", plots, "plots"), log_of("truth", true, "truth"))
    return Trial("made-up", logs, settings_from(settings or {}))


def whole(result, quantity, track=None):
    return next(r for r in result.rows if r.quantity == quantity and r.variable is None and r.track_id == track)


def test_chosen_bias_noise_and_offset_are_found():
    """Each lies in its interval; every quantity of the contract is there, with its unit."""
    bias, sigma = (25.0, 2e-3, -1e-3), (10.0, 1e-3, 2e-3)
    result = truth(trial_of(*made(seed=3, bias=bias, sigma=sigma)), BINS)
    for name, b, s in zip(("range", "azimuth", "elevation"), bias, sigma, strict=True):
        for what, value in (("bias", b), ("sigma", s), ("rms", math.hypot(b, s))):
            row = whole(result, f"{name}_{what}")
            assert row.low <= value <= row.high, (name, what)
            assert row.unit == ("m" if name == "range" else "rad")
        assert "biased" in whole(result, f"{name}_bias").flags
    offset = whole(result, "time_offset")
    assert offset.low <= 0.0 <= offset.high
    assert offset.unit == "s"


@pytest.mark.parametrize("late", [0.54, -1.3])
def test_a_clock_offset_is_found_and_taken_out_when_asked(late):
    """The truth's clock is late by `late`; with `remove_offset` the errors are noise again."""
    trial = trial_of(*made(seed=2, offset=late, bias=(15.0, 0.0, 0.0)))
    result = truth(trial, BINS)
    found = whole(result, "time_offset")
    assert found.value == pytest.approx(late, abs=0.02)
    assert found.low <= late <= found.high
    assert whole(result, "range_sigma").value > 2 * 10
    removed = truth(trial, BINS, remove_offset=True)
    assert whole(removed, "range_sigma").value == pytest.approx(10.0, rel=0.1)
    assert whole(removed, "range_bias").value == pytest.approx(15.0, abs=2.0)
    given = truth(trial_of(*made(seed=2, offset=late), {"truth": {"time_offset_s": late}}), BINS)
    assert whole(given, "range_sigma").value == pytest.approx(10.0, rel=0.1)


def test_a_radial_flight_at_one_speed_shows_no_offset():
    """Bias and offset are one and the same there: missing, flagged."""

    def radial(t):
        return np.stack([80e3 - 200 * t, 0 * t, 0 * t], -1)

    row = whole(truth(trial_of(*made(n=150, flight=radial)), BINS), "time_offset")
    assert math.isnan(row.value)
    assert "unobservable" in row.flags


def test_intervals_of_the_bias_hold_it_about_as_often_as_they_say():
    """Errors with a memory of ten plots; of 60 trials at least 51 hold the chosen bias."""
    held = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        plots, true = made(seed, n=400, sigma=(1e-9, 1e-9, 1e-9))
        wander = np.zeros(400)
        for k in range(1, 400):
            wander[k] = 0.9 * wander[k - 1] + rng.normal(0, 4.0)
        plots["range_m"] = plots["range_m"] + 5.0 + wander
        row = whole(truth(trial_of(plots, true), BINS), "range_bias")
        held += row.low <= 5.0 <= row.high
    assert held >= 51


def test_bins_are_of_true_range_and_counts_add_up():
    """Each plot in one bin; the whole trial first."""
    result = truth(trial_of(*made()), BINS)
    rows = [r for r in result.rows if r.quantity == "range_bias"]
    assert rows[0].variable is None
    assert sum(r.n for r in rows[1:]) == rows[0].n == 600
    assert [r.bin_low for r in rows[1:]] == sorted(r.bin_low for r in rows[1:])


def test_latitude_and_longitude_are_read_as_well_as_metres():
    """The same plots against the same path written either way."""
    site = (math.radians(36.42), math.radians(127.39), 110.0)
    t = np.arange(0.0, 300.0)
    latitude, longitude = 36.6 + 1e-3 * t, 127.5 - 5e-4 * t + 1e-6 * t**2
    height = np.full(t.size, 3000.0)
    p = north_up_east(np.radians(latitude), np.radians(longitude), height, site)
    z = polar(p)[5:-5]
    plots = {"time_s": t[5:-5], "range_m": z[:, 0] + 7.0, "azimuth_rad": z[:, 1], "elevation_rad": z[:, 2]}
    true = {"time_s": t, "latitude_deg": latitude, "longitude_deg": longitude, "height_m": height}
    place = {"latitude_deg": 36.42, "longitude_deg": 127.39, "height_m": 110.0}
    result = truth(trial_of(plots, true, {"site": place}), BINS)
    assert whole(result, "range_bias").value == pytest.approx(7.0, abs=1e-6)
    assert whole(result, "azimuth_rms").value < 1e-12
    with pytest.raises(RangeevalError, match=r"\[site\]"):
        truth(trial_of(plots, true), BINS)


@pytest.mark.parametrize("ids", [(None, None), ("A", None), (None, "A"), ("radar track 7", "A")])
def test_targets_are_matched_by_name_or_by_distance(ids):
    """One target needs no name; another name goes to the nearest path, and is said."""
    result = truth(trial_of(*made(ids=ids)), BINS)
    assert whole(result, "range_sigma").value == pytest.approx(10.0, rel=0.1)
    assert any("no path of their name" in p.reason for p in result.problems) == (ids == ("radar track 7", "A"))


def test_unnamed_plots_of_several_targets_go_to_the_nearest_path():
    """Two targets 24 km apart, no names on the plots; rows per target when asked."""
    parts = [made(k, ids=(None, name), flight=lambda t, k=k: path(t + 157 * k)) for k, name in ((0, "A"), (1, "B"))]
    plots = {n: np.concatenate([p[0][n] for p in parts]) for n in parts[0][0]}
    true = {n: np.concatenate([np.asarray(p[1][n]) for p in parts]) for n in parts[0][1]}
    result = truth(trial_of(plots, true), BINS, per_track=True)
    assert whole(result, "range_sigma").value == pytest.approx(10.0, rel=0.1)
    assert {r.track_id for r in result.rows} == {None, "A", "B"}


def test_azimuth_through_north_is_no_error():
    """A target that crosses north: errors of a milliradian, not of a circle."""

    def north(t):
        return np.stack([30e3 + 0 * t, 1000.0 + 0 * t, -20e3 + 60 * t], -1)

    result = truth(trial_of(*made(flight=north)), BINS)
    assert whole(result, "azimuth_rms").value == pytest.approx(1e-3, rel=0.1)


def test_a_jump_of_100_km_is_flagged_and_does_not_move_the_offset():
    """One wild plot: the sigma says so."""
    plots, true = made(offset=0.5)
    plots["range_m"][300] += 100e3
    result = truth(trial_of(plots, true), BINS)
    assert "outliers" in whole(result, "range_sigma").flags
    assert whole(result, "time_offset").value == pytest.approx(0.5, abs=0.02)


def test_a_truth_that_jumps_is_cleaned_and_counted():
    """A survey point 3 km off: left out at 400 m/s, believed at the default of 2000 m/s over 2 s."""
    plots, true = made()
    true = {n: np.asarray(c)[::2] for n, c in true.items()}
    true["north_m"][100] += 3000.0
    row = whole(truth(trial_of(plots, true, {"truth": {"max_speed_m_s": 400.0}}), BINS), "range_sigma")
    assert row.value == pytest.approx(10.0, rel=0.1)
    assert whole(truth(trial_of(plots, true), BINS), "range_sigma").value > 30.0


def test_plots_without_truth_are_counted():
    """A gap of 40 s and the ends of the truth."""
    plots, true = made()
    keep = (true["time_s"] < 100) | (true["time_s"] > 140)
    true = {n: np.asarray(c)[keep] for n, c in true.items()}
    result = truth(trial_of(plots, true), BINS)
    assert result.settings["counts"]["without_truth"] == 20
    assert any("no truth at these times" in p.reason for p in result.problems)


def test_what_cannot_be_compared_is_said_in_one_line():
    """No truth, no plots, no common target, no common time, a variable plots do not have."""
    plots, true = made()
    only = Trial("t", (log_of("plots", plots),))
    with pytest.raises(RangeevalError, match="no log of kind 'truth'"):
        truth(only, BINS)
    with pytest.raises(RangeevalError, match="no log of kind 'plots'"):
        truth(Trial("t", (log_of("truth", true),)), BINS)
    with pytest.raises(RangeevalError, match=r"one clock"):
        truth(trial_of(plots | {"time_s": plots["time_s"] + 1e6}, true), BINS)
    far = {**true, "north_m": true["north_m"] + 1e5, "target_id": ["B"] * len(true["time_s"])}
    with pytest.raises(RangeevalError, match="target_id"):
        truth(trial_of(plots, far), BINS)
    with pytest.raises(RangeevalError, match="aspect"):
        truth(trial_of(plots, true), Bins("aspect", 0.1))


@pytest.mark.parametrize("n", [1, 2, 3])
def test_a_handful_of_plots_gives_flags_not_nonsense(n):
    """Fewer than four: values, no intervals, a flag."""
    plots, true = made(n=n)
    rows = truth(trial_of(plots, true), BINS).rows
    assert all("few-samples" in r.flags or r.quantity == "time_offset" for r in rows)


def test_elevation_may_be_missing():
    """A two-dimensional radar has range and azimuth errors only."""
    plots, true = made()
    del plots["elevation_rad"]
    assert {r.quantity.split("_")[0] for r in truth(trial_of(plots, true), BINS).rows} == {"range", "azimuth", "time"}


def test_the_command_prints_and_writes():
    """Table, JSON and CSV."""
    run = CliRunner()
    table = run.invoke(cli, ["truth", "sample_logs/attitude"])
    assert table.exit_code == 0
    assert "Range bias (m)" in table.output
    for form in ("json", "csv"):
        assert "range_bias" in run.invoke(cli, ["truth", "sample_logs/attitude", "--format", form]).output
    assert run.invoke(cli, ["truth", "sample_logs/inbound"]).exit_code == 1
    assert rangeeval.truth is truth
