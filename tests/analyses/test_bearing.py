"""Bearings from arrays whose sources we chose: what is found, how well, and what is said when something spoils it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import rangeeval
from rangeeval import SensorArray
from rangeeval.analyses.bearing.frame import Frame, wrapped
from rangeeval.errors import InputError, SettingsError
from rangeeval.model import Bins, Trial, TrialSettings, log_of

WAVELENGTH, SPEED = 0.24, 1500.0
LINE = [(0.0, 0.12 * m) for m in range(15)]
ARC = [(math.cos(a), math.sin(a)) for a in np.deg2rad(np.arange(-84, 85, 12))]
CROSS = [(0.0, 0.0), (0.09, 0.0), (0.0, 0.09), (-0.1, 0.02), (0.03, -0.11), (0.16, 0.1)]


def responses(positions: Any, bearing_deg: Any, wavelength: float = WAVELENGTH) -> Any:
    """Phases (K, M, N) of plane waves from bearings (K, N): a sensor nearer to the source is ahead."""
    theta = np.deg2rad(np.atleast_2d(bearing_deg))
    towards = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    return np.exp(2j * np.pi / wavelength * np.einsum("md,knd->kmn", np.array(positions)[:, :2], towards))


def received(
    positions: Any, bearing_deg: Any, snr_db: float = 10.0, seed: int = 1, wavelength: float = WAVELENGTH
) -> Any:
    """Snapshots (K, M) of unit noise and independent Gaussian sources."""
    rng = np.random.default_rng(seed)
    a = responses(positions, bearing_deg, wavelength)
    k, m, n = a.shape

    def noise(*shape: int) -> Any:
        return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / math.sqrt(2)

    return np.einsum("kmn,kn->km", a, noise(k, n) * 10 ** (snr_db / 20)) + noise(k, m)


def trial_of(samples: Any, positions: Any, truth_deg: Any = None, **facts: Any) -> Trial:
    """A trial in memory, a tenth of a second between snapshots."""
    known = {"frequency_hz": SPEED / WAVELENGTH, "propagation_speed_m_s": SPEED} | facts
    array = SensorArray(sensor_position_m=tuple(map(tuple, positions)), **known)
    time = np.arange(len(samples)) * 0.1
    logs = [log_of("snapshots", {"time_s": time, "samples": samples}, "array.h5", array)]
    if truth_deg is not None:
        count = truth_deg.shape[1]
        logs.append(log_of("truth", {
            "time_s": np.repeat(time, count),
            "target_id": np.tile([f"T{n}" for n in range(count)], len(time)),
            "bearing_rad": np.deg2rad(truth_deg).reshape(-1),
        }))  # fmt: skip
    return Trial("made", tuple(logs), TrialSettings())


def paths(snapshots: int = 600) -> Any:
    """Two targets that cross at 5 degrees, and one apart."""
    s = np.linspace(0, 1, snapshots)[:, None]
    return np.hstack([-20 + 50 * s, 30 - 50 * s, 50 + 5 * s])


def rates(snapshots: int = 600) -> Any:
    """Of those, in degrees a second."""
    return tuple(np.array([50.0, -50.0, 5.0]) / (snapshots - 1) / 0.1)


def value(result: Any, quantity: str, track: str | None = None, group: str | None = None) -> Any:
    return next(r for r in result.rows if (r.quantity, r.track_id, r.group) == (quantity, track, group))


@pytest.fixture(scope="module")
def crossing() -> Any:
    """Three targets on a line array, with truth, tracked by the default method."""
    truth = paths()
    trial = trial_of(
        received(LINE, truth), LINE, truth, start_bearing_deg=tuple(truth[0] + 0.3), start_rate_deg_s=rates()
    )
    return rangeeval.bearing(trial)


def test_crossing_targets_are_held(crossing: Any) -> None:
    """Names last through the crossing; the error lies between the bounds and little above them; near and far add up."""
    assert crossing.settings["outcome"] == "held"
    assert value(crossing, "targets_held").value == 3
    rms, near, far = (value(crossing, "bearing_rms", group=g) for g in (None, "near", "far"))
    assert rms.low < rms.value < rms.high
    assert near.n + far.n == rms.n == 1800
    assert near.n * near.value**2 + far.n * far.value**2 == pytest.approx(rms.n * rms.value**2)
    assert value(crossing, "bearing_bound_straight").value < rms.value < 1.2 * value(crossing, "bearing_bound").value
    bias = value(crossing, "bearing_bias")
    assert bias.low < 0.0 < bias.high
    assert {r.track_id for r in crossing.rows if r.track_id} == {"T0", "T1", "T2"}


def test_each_target_has_its_numbers(crossing: Any) -> None:
    """First and last bearing within their intervals of the truth, SNR, updates; crossers are flagged unresolved."""
    truth = paths()
    for n, name in enumerate(("T0", "T1", "T2")):
        for quantity, true in (("bearing_first", truth[4, n]), ("bearing_last", truth[-5, n])):
            row = value(crossing, quantity, name)
            assert row.low - 0.01 < math.radians(true) < row.high + 0.01
        assert value(crossing, "snr", name).value == pytest.approx(10.0, abs=0.7)
        assert value(crossing, "updates", name).value == 60
        assert value(crossing, "coverage", name).value == 1.0
    assert "unresolved" in value(crossing, "bearing_first", "T0").flags
    assert "unresolved" not in value(crossing, "bearing_first", "T2").flags


def test_rows_follow_the_contract(crossing: Any) -> None:
    """Pooled rows come before groups and targets; units are SI; JSON and the table have them all."""
    for quantity in ("bearing_rms", "bearing_bias"):
        places = [(r.group, r.track_id) for r in crossing.rows if r.quantity == quantity]
        assert places == [(None, None), ("near", None), ("far", None), *((None, f"T{n}") for n in range(3))]
    assert {r.unit for r in crossing.rows if r.quantity.startswith("bearing")} == {"rad"}
    assert len(crossing.estimates) == len(crossing.rows)
    assert '"analysis": "bearing"' in crossing.to_json(series=True)


def test_the_figures_have_their_series(crossing: Any) -> None:
    """A track a target with its interval and the truth, the waterfall of a page's size, spectra, counts and guard."""
    track = crossing.series["bearing/T1"]
    assert {"time_s", "bearing_rad", "low_rad", "high_rad", "truth_rad", "heard"} == set(track)
    assert np.abs(np.subtract(track["bearing_rad"], track["truth_rad"])).max() < math.radians(2)
    water = crossing.series["waterfall"]
    columns, rows = len(water["time_edge_s"]) - 1, len(water["bearing_edge_rad"]) - 1
    assert len(water["level_db"]) == columns * rows
    level = np.array(water["level_db"]).reshape(rows, columns)
    middles = 0.5 * (np.array(water["bearing_edge_rad"])[1:] + np.array(water["bearing_edge_rad"])[:-1])
    strongest = np.rad2deg(middles[level.argmax(axis=0)])
    apart = np.abs(strongest[:, None] - paths(columns)).min(axis=1)
    assert np.median(apart) < 2.0
    assert {"spectrum/0", "sources", "guard"} <= set(crossing.series)


@pytest.mark.parametrize("method", ["joint-ml", "modified", "ryu", "music", "root-music", "esprit"])
def test_every_method_finds_a_target_on_a_line(method: str) -> None:
    """Within a degree of a source that stands, whatever the method; the sigma of a subspace tracker is called nominal."""
    truth = np.full((300, 1), 17.0)
    result = rangeeval.bearing(trial_of(received(LINE, truth), LINE, truth), method=method, targets=1)
    assert value(result, "bearing_rms").value < math.radians(1.0)
    assert ("nominal-sigma" in value(result, "bearing_sigma", "T0").flags) == (method in ("ryu", "modified"))
    per_block = method in ("music", "root-music", "esprit")
    assert ("bound-sigma" in value(result, "bearing_sigma", "T0").flags) == per_block


def test_targets_are_counted_when_not_given() -> None:
    """MDL finds two sources on an arc; their bearings follow without any start."""
    truth = np.full((400, 2), [-25.0, 35.0])
    result = rangeeval.bearing(trial_of(received(ARC, truth), ARC, truth))
    assert (result.settings["targets"], result.settings["targets_given"]) == (2, False)
    assert value(result, "bearing_rms").value < math.radians(0.5)
    assert value(result, "sources_mdl").value == 2
    told = trial_of(received(ARC, truth), ARC, truth, start_bearing_deg=(-25.0, 0.0, 35.0))
    assert rangeeval.bearing(told).settings["targets"] == 3
    assert rangeeval.bearing(told, targets="auto").settings["targets"] == 2


@pytest.mark.slow
def test_the_interval_holds_the_truth() -> None:
    """Over 200 records of one source, the 95 % interval of the last bearing holds it about as often as promised."""
    truth = np.full((200, 1), 12.0)
    held = 0
    for seed in range(200):
        trial = trial_of(received(LINE, truth, 0.0, seed), LINE, start_bearing_deg=(12.3,))
        last = rangeeval.bearing_tracks(trial)[0].iloc[-1]
        held += abs(last.bearing_deg - 12.0) < 1.96 * last.sigma_deg
    print(f"held {held} of 200")
    assert 183 <= held <= 198  # outside once in 50 at 95 %


def test_bins_of_time_give_bearings() -> None:
    """One row a target and bin, at the update nearest to its middle."""
    truth = paths(400)[:, :1]
    result = rangeeval.bearing(
        trial_of(received(LINE, truth), LINE, start_bearing_deg=(-20.0,)), Bins("time", 10.0, 0.0)
    )
    rows = [r for r in result.rows if r.quantity == "bearing"]
    assert [(r.bin_low, r.bin_high) for r in rows] == [(0.0, 10.0), (10.0, 20.0), (20.0, 30.0), (30.0, 40.0)]
    for row in rows:
        middle = math.radians(-20 + 50 * 0.5 * (row.bin_low + row.bin_high) / 39.9)
        assert row.value == pytest.approx(middle, abs=math.radians(1.0))
        assert row.low < row.value < row.high


def test_tracks_come_as_a_table() -> None:
    """Every update of every target, in degrees."""
    truth = np.full((200, 2), [-25.0, 35.0])
    trial = trial_of(received(LINE, truth), LINE, truth, start_bearing_deg=(-25.0, 35.0))
    table, problems = rangeeval.bearing_tracks(trial)
    assert problems == ()
    assert list(table.columns) == [
        "time_s", "target_id", "bearing_deg", "sigma_deg", "rate_deg_s", "power_db", "flags",
    ]  # fmt: skip
    assert len(table) == 40
    assert table.groupby("target_id").bearing_deg.mean().round(0).tolist() == [-25.0, 35.0]


def test_plain_tables_will_do() -> None:
    """Samples and times as arrays, and what is known of the array beside them."""
    truth = np.full((200, 1), 17.0)
    array = SensorArray(tuple(LINE), SPEED / WAVELENGTH, SPEED, targets=1)
    table = {"time_s": np.arange(200) * 0.1, "samples": received(LINE, truth)}
    tracks, _ = rangeeval.bearing_tracks(table, array=array)
    assert tracks.bearing_deg.iloc[-1] == pytest.approx(17.0, abs=0.5)


def test_compass_bearings() -> None:
    """x points 30 degrees east of north: y to the right adds, y to the left subtracts; zero to 360 degrees."""
    truth = np.full((200, 1), -50.0)
    samples = received(ARC, truth)
    for y_axis, wanted in (("right", 340.0), ("left", 80.0)):
        trial = trial_of(samples, ARC, heading_deg=30.0, y_axis=y_axis, bearings="compass", targets=1)
        result = rangeeval.bearing(trial)
        assert math.degrees(value(result, "bearing_last", "1").value) == pytest.approx(wanted, abs=1.0)
        edges = result.series["waterfall"]["bearing_edge_rad"]
        assert edges[-1] - edges[0] == pytest.approx(2 * math.pi)
        level = np.array(result.series["waterfall"]["level_db"]).reshape(len(edges) - 1, -1).mean(axis=1)
        assert math.degrees(edges[int(level.argmax())]) == pytest.approx(wanted, abs=4.0)
        table, _ = rangeeval.bearing_tracks(trial)
        assert table.compass_deg.iloc[-1] == pytest.approx(wanted, abs=1.0)


def test_a_frame_turns_both_ways() -> None:
    """Of compass and shown undo each other."""
    angles = np.deg2rad([-170.0, -10.0, 0.0, 95.0])
    for frame in (Frame(True, 0.7, 1.0), Frame(True, 5.0, -1.0)):
        np.testing.assert_allclose(frame.of_compass(frame.shown(angles)), angles, atol=1e-12)
        assert ((frame.shown(angles) >= 0) & (frame.shown(angles) < 2 * np.pi)).all()
    np.testing.assert_allclose(Frame(False).shown(angles + 2 * np.pi), angles, atol=1e-12)
    assert wrapped(np.pi) == -np.pi


def test_truth_may_be_positions() -> None:
    """North and east of the array, with the x axis 20 degrees east of north."""
    truth = np.full((200, 1), 25.0)
    trial = trial_of(received(ARC, truth), ARC, heading_deg=20.0, targets=1)
    ends = {"time_s": [0.0, 19.9], "north_m": [1e4 * math.cos(math.radians(45.0))] * 2,
            "east_m": [1e4 * math.sin(math.radians(45.0))] * 2}  # fmt: skip
    both = Trial("made", (*trial.logs, log_of("truth", ends)), trial.settings)
    assert abs(value(rangeeval.bearing(both), "bearing_bias").value) < math.radians(0.3)


def broad_band(
    positions: Any, bearing_deg: float, seconds: float = 30.0, rate: float = 50.0, speed: float = 340.0
) -> Any:
    """A wave of noise between 1 and 6 Hz over an array in metres, delayed sample by sample in the frequency domain."""
    rng = np.random.default_rng(4)
    count = int(seconds * rate)
    spectrum = np.fft.rfft(rng.normal(size=count))
    frequency = np.fft.rfftfreq(count, 1 / rate)
    spectrum[(frequency < 1) | (frequency > 6)] = 0
    towards = np.array([math.cos(math.radians(bearing_deg)), math.sin(math.radians(bearing_deg))])
    ahead = np.array(positions) @ towards / speed
    wave = np.fft.irfft(spectrum * np.exp(2j * np.pi * frequency * ahead[:, None]), count)
    return (wave + 0.05 * rng.normal(size=wave.shape)).T


WIDE = [(0.0, 0.0), (40.0, 10.0), (-20.0, 45.0), (-30.0, -35.0)]


@pytest.mark.parametrize("method", ["joint-ml", "modified", "music"])
def test_broad_band_samples_are_taken_apart(method: str) -> None:
    """A time series of an infrasound array: real samples, bins of a band, one bearing."""
    array = {"frequency_hz": None, "propagation_speed_m_s": 340.0, "band_hz": (1.0, 6.0), "sampling_rate_hz": 50.0}
    samples = broad_band(WIDE, 140.0)
    time = np.arange(len(samples)) / 50.0
    log = log_of("snapshots", {"time_s": time, "samples": samples}, "array.npy",
                 SensorArray(sensor_position_m=tuple(WIDE), **array))  # fmt: skip
    result = rangeeval.bearing(Trial("made", (log,)), method=method, targets=1)
    assert result.settings["bins"] > 4
    assert math.degrees(value(result, "bearing_last", "1").value) == pytest.approx(140.0, abs=1.5)


# --- what spoils bearings --------------------------------------------------------------------------------------------


def test_too_few_sensors_is_one_line() -> None:
    """Targets plus one sensors are needed."""
    truth = np.full((100, 3), [-30.0, 0.0, 30.0])
    trial = trial_of(received(LINE[:3], truth), LINE[:3], start_bearing_deg=(-30.0, 0.0, 30.0))
    with pytest.raises(InputError, match=r"^array.h5: 3 targets need 4 sensors, and 3 gave a signal$"):
        rangeeval.bearing(trial)
    with pytest.raises(InputError, match="3 targets need 4 sensors"):
        rangeeval.bearing(trial_of(received(LINE[:3], truth), LINE[:3]), targets=3, method="music")


def test_a_dead_sensor_is_left_out() -> None:
    """Silent or constant: named, flagged, and the bearing as good as without it."""
    truth = np.full((300, 1), 10.0)
    samples = received(LINE, truth)
    samples[:, 4] = 0.0
    samples[:, 9] = 0.7
    result = rangeeval.bearing(trial_of(samples, LINE, truth, targets=1))
    assert "dead-sensor" in value(result, "bearing_rms").flags
    assert any("left out: 5, 10" in p.reason for p in result.problems)
    assert value(result, "bearing_rms").value < math.radians(0.5)
    assert result.settings["sensors"] == 13
    with pytest.raises(InputError, match="0 of its 15 sensors gave a signal"):
        rangeeval.bearing(trial_of(samples * 0, LINE))


def test_a_clipped_sensor_is_flagged() -> None:
    """Samples that stand at one extreme value."""
    truth = np.full((300, 1), 10.0)
    samples = received(LINE, truth)
    part = samples[:, 2]
    samples[:, 2] = np.clip(part.real, -1, 1) + 1j * np.clip(part.imag, -1, 1)
    result = rangeeval.bearing(trial_of(samples, LINE, truth, targets=1))
    assert "clipped" in value(result, "bearing_rms").flags
    assert any(p.reason.startswith("clipped sensors") and p.reason.endswith(": 3") for p in result.problems)


@pytest.mark.parametrize("method", ["joint-ml", "modified", "music"])
def test_missing_snapshots_are_coasted_over(method: str) -> None:
    """NaN in some: not used, counted; a stretch without any is flagged; nothing turns to NaN."""
    truth = np.full((300, 1), 10.0)
    samples = received(LINE, truth)
    samples[40:100, 3] = np.nan
    samples[150, 0] = np.inf
    result = rangeeval.bearing(trial_of(samples, LINE, truth, targets=1), method=method)
    usable = value(result, "snapshots_usable")
    assert usable.value == pytest.approx(239 / 300)
    row = value(result, "bearing_last", "T0")
    assert row.value == pytest.approx(math.radians(10.0), abs=math.radians(1.0))
    assert "missing" in row.flags
    assert math.isfinite(value(result, "bearing_rms").value)


@pytest.mark.parametrize("method", ["joint-ml", "modified", "music", "root-music"])
@pytest.mark.parametrize("what", [0.0, np.nan])
def test_a_recorder_that_drops_out_is_lived_through(method: str, what: float) -> None:
    """Zeros or nothing from all sensors for a third of the record, at its start too: bearings where there are samples."""
    truth = np.full((600, 1), 10.0)
    samples = received(LINE, truth)
    samples[:60] = what
    samples[250:400] = what
    trial = trial_of(samples, LINE, truth, start_bearing_deg=(10.2,))
    result = rangeeval.bearing(trial, method=method)
    assert value(result, "bearing_last", "T0").value == pytest.approx(math.radians(10.0), abs=math.radians(1.0))
    numbers = [v for c in result.series["bearing/T0"].values() for v in c]
    assert method in ("music", "root-music") or all(math.isfinite(v) for v in numbers)
    rangeeval.bearing(trial_of(samples, LINE), targets="auto")


def test_gaps_in_time_are_missing_snapshots() -> None:
    """Rows left out of the log are steps without a measurement, so rates stay right."""
    truth = paths(500)[:, :1]
    samples, time = received(LINE, truth), np.arange(500) * 0.1
    keep = np.ones(500, bool)
    keep[200:240] = False
    array = SensorArray(sensor_position_m=tuple(LINE), frequency_hz=SPEED / WAVELENGTH, propagation_speed_m_s=SPEED,
                        start_bearing_deg=(-20.0,))  # fmt: skip
    log = log_of("snapshots", {"time_s": time[keep], "samples": samples[keep]}, "array.h5", array)
    result = rangeeval.bearing(Trial("made", (log,)))
    assert result.settings["snapshots"] == 500
    assert any(p.reason == "snapshots missing in gaps" and p.count == 40 for p in result.problems)
    assert math.degrees(value(result, "bearing_last", "1").value) == pytest.approx(truth[-5, 0], abs=1.0)


def test_times_out_of_order_and_repeated() -> None:
    """Put in order, doubles left out, both said; all of one time is one line."""
    truth = np.full((200, 1), 10.0)
    trial = trial_of(received(LINE, truth), LINE, targets=1)
    table = trial.log("snapshots").read()
    time = table.floats("time_s").copy()
    time[[50, 60]] = time[[60, 50]]
    time[100] = time[101]
    array = trial.log("snapshots").array
    log = log_of("snapshots", {"time_s": time, "samples": table.wide("samples")}, "array.h5", array)
    result = rangeeval.bearing(Trial("made", (log,)))
    reasons = [p.reason for p in result.problems]
    assert "time goes backwards; the snapshots are put in order" in reasons
    assert "snapshots that repeat the time of another are not used" in reasons
    assert math.degrees(value(result, "bearing_last", "1").value) == pytest.approx(10.0, abs=1.0)
    same = log_of("snapshots", {"time_s": np.zeros(200), "samples": table.wide("samples")}, "array.h5", array)
    with pytest.raises(InputError, match="all its snapshots are of one time"):
        rangeeval.bearing(Trial("made", (same,)))


def test_a_mirrored_recording_is_told_where_the_array_can() -> None:
    """An arc that hears one half sees conjugated samples come from behind; `conjugate` mends them; a line cannot tell."""
    truth = np.full((400, 1), 40.0)
    samples = received(ARC, truth).conj()
    half = {"sector_deg": (-90.0, 90.0), "targets": 1}
    result = rangeeval.bearing(trial_of(samples, ARC, **half))
    assert "mirrored" in value(result, "beam_width").flags
    assert any("conjugate" in p.reason for p in result.problems)
    right = rangeeval.bearing(trial_of(samples.conj(), ARC, **half))
    assert "mirrored" not in value(right, "beam_width").flags
    assert math.degrees(value(right, "bearing_last", "1").value) == pytest.approx(40.0, abs=1.0)
    line = rangeeval.bearing(trial_of(received(LINE, truth).conj(), LINE, targets=1))
    assert "mirrored" not in value(line, "beam_width").flags
    assert line.settings["tells_mirror"] is False


@pytest.mark.parametrize(
    ("gone", "said"),
    [
        ("frequency_hz", r"^array.h5: has no frequency_hz, the frequency of its snapshots; give it in the file or in"),
        ("propagation_speed_m_s", "has no propagation_speed_m_s, how fast the wave travels"),
        ("sensor_position_m", "has no sensor_position_m, where the sensors stand"),
    ],
)
def test_what_is_not_known_of_the_array_is_one_line(gone: str, said: str) -> None:
    """No frequency, no speed, no positions: said with where it can be given."""
    log = trial_of(received(LINE, np.zeros((50, 1))), LINE).log("snapshots")
    facts = {"sensor_position_m": tuple(LINE), "frequency_hz": 6250.0, "propagation_speed_m_s": SPEED}
    del facts[gone]
    trial = Trial("made", (log_of("snapshots", log.read().columns, "array.h5", SensorArray(**facts)),))  # type: ignore[arg-type]
    with pytest.raises(InputError, match=said) as caught:
        rangeeval.bearing(trial)
    assert "\n" not in str(caught.value)


def test_spacing_that_aliases_is_flagged() -> None:
    """A line of 1.5 wavelengths spacing: two bearings look the same, and the report says so."""
    positions = [(0.0, 0.36 * m) for m in range(8)]
    truth = np.full((200, 1), 10.0)
    result = rangeeval.bearing(trial_of(received(positions, truth), positions, truth, start_bearing_deg=(10.0,)))
    assert "aliased" in value(result, "ambiguity_level").flags
    assert any("two bearings look the same" in p.reason for p in result.problems)
    narrow = rangeeval.bearing(
        trial_of(received(positions, truth), positions, start_bearing_deg=(10.0,), sector_deg=(-15.0, 15.0))
    )
    assert "aliased" not in value(narrow, "ambiguity_level").flags


def test_ragged_arrays_are_one_line() -> None:
    """Positions for another number of sensors."""
    with pytest.raises(InputError, match="samples have 15 columns and sensor_position_m has 14 rows"):
        rangeeval.bearing(trial_of(received(LINE, np.zeros((50, 1))), LINE[:14]))


def test_real_samples_of_a_narrow_band_are_one_line() -> None:
    """The real part alone is no snapshot: said, with what a time series would need."""
    samples = received(LINE, np.zeros((100, 1))).real
    with pytest.raises(InputError, match=r"its samples are real, 10 a second; narrow-band snapshots at 6250 Hz are"):
        rangeeval.bearing(trial_of(samples, LINE))


def test_a_source_that_is_not_modelled_alarms() -> None:
    """Two sources, one tracked: the guard says so in flags and problems."""
    truth = np.full((400, 2), [-25.0, 35.0])
    result = rangeeval.bearing(trial_of(received(LINE, truth), LINE, start_bearing_deg=(-25.0,)))
    assert "unmodelled-source" in value(result, "guard_alarms").flags
    assert value(result, "guard_alarms").value > 0
    assert any("a source that is not modelled" in p.reason for p in result.problems)


def test_noise_alone_is_no_target() -> None:
    """Nothing is tracked, and that is said; the waterfall is there."""
    rng = np.random.default_rng(3)
    noise = rng.normal(size=(300, 15)) + 1j * rng.normal(size=(300, 15))
    result = rangeeval.bearing(trial_of(noise, LINE))
    assert result.settings["targets"] == 0
    assert "none-found" in value(result, "beam_width").flags
    assert any("no source stands out" in p.reason for p in result.problems)
    assert "waterfall" in result.series
    assert rangeeval.bearing_tracks(trial_of(noise, LINE))[0].empty


def test_a_span_without_snapshots_is_one_line() -> None:
    """Beyond the record."""
    trial = trial_of(received(LINE, np.zeros((100, 1))), LINE)
    with pytest.raises(InputError, match="has 0 snapshots from 50 to 60 s"):
        rangeeval.bearing(trial, span_s=(50.0, 60.0))
    inside = rangeeval.bearing(trial, span_s=(2.0, 8.0), targets=1)
    assert (inside.settings["first_time_s"], inside.settings["last_time_s"]) == (2.0, 8.0)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"method": "muzic"}, "did you mean 'music'"),
        ({"coasting": "firm"}, "coasting 'firm' is not known"),
        ({"targets": 0}, "targets is 0"),
        ({"targets": "some"}, "targets is some"),
        ({"block": 0}, "block is 0"),
        ({"confidence": 1.0}, "confidence is 1"),
        ({"acceleration_rad_s2": -1.0}, "expected 0 or more"),
        ({"coasting": "soft"}, "belong to the methods ryu and modified"),
    ],
)
def test_impossible_arguments_are_one_line(arguments: dict[str, Any], said: str) -> None:
    """Before anything is read."""
    with pytest.raises(SettingsError, match=said):
        rangeeval.bearing(trial_of(received(LINE, np.zeros((50, 1))), LINE), **arguments)


def test_ryu_needs_a_line() -> None:
    """Said by name."""
    with pytest.raises(InputError, match=r"^array.h5: .*line"):
        rangeeval.bearing(trial_of(received(ARC, np.zeros((100, 1))), ARC, targets=1), method="ryu")
