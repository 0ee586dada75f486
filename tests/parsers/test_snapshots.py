"""Snapshots of an array: read from every format that holds them, kept in archives, refused in one clear line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rangeeval import flow
from rangeeval.errors import InputError, SettingsError
from rangeeval.model import SensorArray, Trial, TrialSettings, log_of, piece_rows, settings_from
from rangeeval.parsers import open_trial
from rangeeval.parsers.archive import verify
from rangeeval.parsers.inspection import inspect_trial
from tests.parsers.samples import PHASES, POSITIONS, sac_bytes, write_hdf5_samples, write_npz_samples

TOML = """
[array]
sensor_position_m = [[0, 0], [0, 0.12], [0.5, 0.25]]
frequency_hz = 6250
propagation_speed_m_s = 1500
sampling_rate_hz = 2
"""


def write(folder: Path, name: str, toml: str = TOML, **arrays: Any) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "trial.toml").write_text(toml)
    np.save(folder / name, arrays["samples"])
    return folder


def same(trial: Trial, samples: Any = PHASES) -> None:
    """The trial's one log holds these samples half a second apart, and the array of the samples module."""
    log = trial.log("snapshots")
    table = log.read()
    assert table.problems == ()
    assert table.floats("time_s").tolist() == (np.arange(len(samples)) * 0.5).tolist()
    np.testing.assert_array_equal(table.wide("samples"), samples)
    assert table.wide("samples").dtype == samples.dtype
    assert log.array is not None
    assert log.array.sensor_position_m == tuple(map(tuple, POSITIONS))
    assert (log.array.frequency_hz, log.array.propagation_speed_m_s) == (6250.0, 1500.0)


def test_every_format_gives_the_same_snapshots(tmp_path: Path) -> None:
    """HDF5, npz and npy with trial.toml; units by the endings of the names."""
    write_hdf5_samples(tmp_path / "a")
    write_npz_samples(tmp_path / "b")
    same(open_trial(tmp_path / "a"))
    same(open_trial(tmp_path / "b"))
    same(open_trial(write(tmp_path / "c", "x.npy", samples=PHASES)))
    same(open_trial(write(tmp_path / "d", "x.npy", samples=np.asfortranarray(PHASES))))


@pytest.mark.parametrize(("real", "imaginary"), [("samples_real", "samples_imag"), ("re", "im"), ("x_i", "x_q")])
def test_real_and_imaginary_part_may_stand_apart(real: str, imaginary: str, tmp_path: Path) -> None:
    """As two datasets, or as the fields of a compound."""
    write_hdf5_samples(tmp_path / "two")
    with h5py.File(tmp_path / "two", "a") as file:
        del file["samples"]
        file[real], file[imaginary] = PHASES.real, PHASES.imag
    same(open_trial(tmp_path / "two"))
    pairs = np.empty(PHASES.shape, [("real", "f8"), ("imag", "f8")])
    pairs["real"], pairs["imag"] = PHASES.real, PHASES.imag
    write_hdf5_samples(tmp_path / "pair", pairs)
    same(open_trial(tmp_path / "pair"))


def test_facts_may_be_attributes_and_trial_toml_has_the_last_word(tmp_path: Path) -> None:
    """A wrong frequency in the file is corrected; samples of the other sign are conjugated."""
    with h5py.File(tmp_path / "log.h5", "w") as file:
        group = file.create_group("hull")
        group["samples"] = PHASES.conj()
        group["time_s"] = np.arange(40) * 0.5
        group.attrs.update({"sensor_position_cm": np.multiply(POSITIONS, 100), "frequency_khz": 5.0})
    (tmp_path / "trial.toml").write_text(
        "[array]\nfrequency_hz = 6250.0\npropagation_speed_m_s = 1500\nconjugate = true\n"
    )
    same(open_trial(tmp_path))


def test_real_samples_stay_real(tmp_path: Path) -> None:
    """A real array is one of samples when it is called so beside positions, or trial.toml describes an array."""
    write_hdf5_samples(tmp_path / "a.h5", PHASES.real)
    same(open_trial(tmp_path / "a.h5"), PHASES.real)
    same(open_trial(write(tmp_path / "c", "x.npy", samples=PHASES.real)), PHASES.real)
    np.save(tmp_path / "picture.npy", PHASES.real)
    with pytest.raises(InputError, match="its array has no named columns"):
        open_trial(tmp_path / "picture.npy")


def test_a_long_log_comes_in_pieces_and_out_of_an_archive(tmp_path: Path) -> None:
    """Pieces hold as many numbers whatever the sensors; an archive gives back every bit, and the array."""
    rng = np.random.default_rng(1)
    rows = 2 * piece_rows(40) + 7
    samples = rng.normal(size=(rows, 40)) + 1j * rng.normal(size=(rows, 40))
    samples[5, 3] = np.nan
    positions = rng.normal(size=(40, 3))
    write_hdf5_samples(tmp_path / "log.h5", samples, sensor_position_m=positions)
    trial = open_trial(tmp_path / "log.h5")
    pieces = list(trial.log("snapshots").pieces(None))
    assert [len(p) for p in pieces] == [piece_rows(40), piece_rows(40), 7]
    assert [p.problems[0].count if p.problems else 0 for p in pieces] == [1, 0, 0]
    again = open_trial(flow.ingest(trial, tmp_path / "trial.h5"))
    assert verify(tmp_path / "trial.h5").layout == 2
    assert again.log("snapshots").array == trial.log("snapshots").array
    for mine, theirs in zip(again.log("snapshots").pieces(None), pieces, strict=True):
        assert mine.wide("samples").tobytes() == theirs.wide("samples").tobytes()
        assert mine.floats("time_s").tobytes() == theirs.floats("time_s").tobytes()
        assert mine.problems == theirs.problems
    settings = TrialSettings(array=SensorArray(frequency_hz=99.0))
    changed = open_trial(tmp_path / "trial.h5", settings=settings).log("snapshots").array
    assert changed is not None
    assert (changed.frequency_hz, changed.propagation_speed_m_s) == (99.0, 1500.0)


def test_a_log_of_snapshots_is_inspected(tmp_path: Path) -> None:
    """Rows, span, missing samples by snapshot, and the array."""
    samples = PHASES.copy()
    samples[3:5, 1] = np.nan
    write_hdf5_samples(tmp_path / "log.h5", samples)
    (found,) = inspect_trial(tmp_path / "log.h5")
    assert (found.kind, found.rows, found.last_time_s) == ("snapshots", 40, 19.5)
    assert [(c.stored, c.missing) for c in found.columns] == [("time_s", 0), ("samples", 2)]
    assert found.array == {
        "sensors": 3, "sensor_position_m": tuple(map(tuple, POSITIONS)), "frequency_hz": 6250.0,
        "propagation_speed_m_s": 1500.0,
    }  # fmt: skip
    assert found.problems[0].examples[0] == "log.h5[3]: sensor 2 has no number"


@pytest.mark.parametrize(
    ("samples", "facts", "said"),
    [
        (PHASES, {"sensor_position_m": POSITIONS[:2]}, "samples have 3 columns and sensor_position_m has 2 rows"),
        (PHASES[:2].T, {"sensor_position_m": [[0, 0]] * 3}, "are they stored sensors x snapshots"),
        (PHASES, {"sensor_position_m": [1.0, 2.0, 3.0]}, r"sensor_position_m has the shape \(3,\), expected \(sensors"),
        (PHASES, {"sensor_position_m": [[0, np.nan]] * 3}, "a number that is missing or infinite"),
        (PHASES, {"frequency_hz": -1.0}, "frequency_hz is -1, expected more than 0"),
        (PHASES, {"frequency_khz": 1.0}, "gives frequency_hz twice"),
        (PHASES, {"time_s": None}, "has no time_s; give sampling_rate_hz"),
        (PHASES, {"other": PHASES}, None),
        (PHASES, {"samples": None, "a": PHASES, "b": PHASES}, "several complex arrays"),
        (PHASES, {"samples": None, "x_re": PHASES.real, "x_im": PHASES.imag[:5]}, "differ in shape"),
    ],
)  # fmt: skip
def test_arrays_that_do_not_fit_are_one_line(
    samples: Any, facts: dict[str, Any], said: str | None, tmp_path: Path
) -> None:
    """Ragged arrays, positions that are none, doubtful facts: where, what was found, what was expected."""
    write_hdf5_samples(tmp_path / "log", samples, **{k: v for k, v in facts.items() if k not in {"time_s", "samples"}})
    with h5py.File(tmp_path / "log", "a") as file:
        for name in {"time_s", "samples"} & {k for k, v in facts.items() if v is None}:
            del file[name]
    if said is None:
        assert open_trial(tmp_path / "log").log("snapshots").written["samples"] == "samples"
        return
    with pytest.raises(InputError, match=said) as caught:
        open_trial(tmp_path / "log").log("snapshots").read()
    assert str(caught.value).startswith("log:")
    assert "\n" not in str(caught.value)


def test_times_of_another_length_are_one_line(tmp_path: Path) -> None:
    """In HDF5 and npz."""
    write_hdf5_samples(tmp_path / "a")
    with h5py.File(tmp_path / "a", "a") as file:
        del file["time_s"]
        file["time_s"] = np.arange(7.0)
    with (tmp_path / "b").open("wb") as file:
        np.savez(file, samples=PHASES, time_s=np.arange(7.0), sensor_position_m=POSITIONS)
    for name in "ab":
        with pytest.raises(InputError, match=f"^{name}: columns of different lengths: time_s 7, samples 40"):
            open_trial(tmp_path / name)


def test_npz_stored_by_column_says_so(tmp_path: Path) -> None:
    """A zip is read in its order, so samples by column cannot be streamed."""
    with (tmp_path / "a").open("wb") as file:
        np.savez(file, samples=np.asfortranarray(PHASES), time_s=np.arange(40.0), sensor_position_m=POSITIONS)
    with pytest.raises(InputError, match=r"save it with np\.ascontiguousarray"):
        open_trial(tmp_path / "a")


@pytest.mark.parametrize("name", ["hdf5", "npz", "npy", "sac"])
@pytest.mark.parametrize("keep", [0.55, 0.95])
def test_files_cut_off_are_one_line(name: str, keep: float, tmp_path: Path) -> None:
    """Wherever the cut is."""
    folder = tmp_path / "t"
    write(folder, "cut.npy", samples=np.tile(PHASES, (50, 1)))
    path = folder / "cut.npy"
    if name == "hdf5":
        write_hdf5_samples(path, np.tile(PHASES, (50, 1)))
    elif name == "npz":
        write_npz_samples(path)
    elif name == "sac":
        path.write_bytes(sac_bytes(np.arange(2000.0), "A"))
        (folder / "trial.toml").unlink()
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * keep)])
    with pytest.raises(InputError, match=r"cut\.npy:") as caught:
        open_trial(folder).log("snapshots").read()
    assert "\n" not in str(caught.value)


def _sac_array(folder: Path, order: str = "<", **last: Any) -> Path:
    folder.mkdir(exist_ok=True)
    values = np.arange(300.0)
    places = [(36.5, -112.25), (36.501, -112.25), (36.5, -112.249)]
    for number, (latitude, longitude) in enumerate(places):
        header = {"stla": latitude, "stlo": longitude, **(last if number == 2 else {})}
        data = sac_bytes(values * (number + 1), f"AB{number}", order, **header)
        (folder / f"ab{number}.sac").write_bytes(data)
    return folder


@pytest.mark.parametrize("order", ["<", ">"])
def test_sac_files_are_one_array(order: str, tmp_path: Path) -> None:
    """A sensor a file, in either byte order, placed north and east of their middle (a degree of latitude: 111 km)."""
    trial = open_trial(_sac_array(tmp_path / "array", order))
    assert [(s.name, s.format, s.kind) for s in trial.sources] == [(f"ab{i}.sac", "sac", "snapshots") for i in range(3)]
    log = trial.log("snapshots")
    table = log.read()
    np.testing.assert_array_equal(table.wide("samples"), np.arange(300.0)[:, None] * [1, 2, 3])
    assert table.floats("time_s")[-1] == 299 * 0.5
    assert log.array is not None
    assert (log.array.sensors, log.array.bearings) == (("AB0", "AB1", "AB2"), "compass")
    assert log.array.time_zero == "2026-05-12T06:30:15.250Z"
    north, east, up = np.array(log.array.sensor_position_m).T
    assert north[1] - north[0] == pytest.approx(110.96, abs=0.5)  # headers hold latitudes to 0.4 m
    assert east[2] - east[0] == pytest.approx(89.6, abs=1.0)
    assert np.abs(up).max() < 0.01


def test_sac_files_are_cut_to_their_common_time(tmp_path: Path) -> None:
    """One began two samples and a bit later, by its header: the others' first samples are not read."""
    trial = open_trial(_sac_array(tmp_path / "array", b=1.1))
    log = trial.log("snapshots")
    table = log.read()
    np.testing.assert_array_equal(table.wide("samples")[0], [2.0, 4.0, 0.0])
    assert len(table) == 298
    assert [p.reason for p in trial.problems] == [
        "the sensors were sampled up to 100 ms apart; not corrected",
        "samples outside the time common to all sensors are not read",
    ]
    assert open_trial(tmp_path / "array" / "ab0.sac").log("snapshots").rows == 300


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"delta": 0.25}, "is sampled at 4 Hz and array/ab0.sac at 2 Hz"),
        ({"start": (2027, 1, 0, 0, 0, 0)}, "no time in common"),
        ({"iftype": 2}, "is not an evenly sampled time series"),
        ({"leven": 0}, "is not an evenly sampled time series"),
        ({"start": (2026, 1, 0, 0, 0, 2**31 - 1)}, None),
        ({"start": (99999, 1, 0, 0, 0, 0)}, "gives no possible time"),
    ],
)
def test_sac_files_that_do_not_go_together_are_one_line(
    changes: dict[str, Any], said: str | None, tmp_path: Path
) -> None:
    """Another rate, another year, another kind of file."""
    with pytest.raises(InputError, match=said or "no time in common"):
        open_trial(_sac_array(tmp_path / "array", **changes))


def test_a_sac_file_without_a_place_can_have_one_from_trial_toml(tmp_path: Path) -> None:
    """The header of one is undefined: no positions, until [array] gives them."""
    folder = _sac_array(tmp_path / "array", stla=-12345.0)
    assert open_trial(folder).log("snapshots").array.sensor_position_m == ()  # type: ignore[union-attr]
    (folder / "trial.toml").write_text("[array]\nsensor_position_m = [[0, 0], [1, 0], [0, 1]]\n")
    assert len(open_trial(folder).log("snapshots").array.sensor_position_m) == 3  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("array", "said"),
    [
        ({"sensor_position_m": [[0, 0], [1]]}, "rows of 1, 2 numbers, expected 2"),
        ({"sensor_position_m": [[0, "x"]]}, r"array.sensor_position_m\[0\]\[1\]: is 'x', expected a number"),
        ({"sensor_position_m": 3}, "expected an array"),
        ({"sensors": ["a"], "sensor_position_m": [[0, 0], [1, 1]]}, "names 1, array.sensor_position_m has 2"),
        ({"targets": 0}, "expected 1 or more"),
        ({"targets": 2, "start_bearing_deg": [1.0]}, "gives 1 bearings for 2 targets"),
        ({"band_hz": [5.0, 1.0]}, "expected \\[low, high\\]"),
        ({"sector_deg": [5.0]}, "expected \\[low, high\\]"),
        ({"frequency_hz": 0}, "expected more than 0"),
        ({"bearings": "compas"}, "did you mean 'compass'"),
        ({"frequency_khz": 1}, "unknown key 'frequency_khz'; did you mean 'frequency_hz'"),
    ],
)
def test_impossible_arrays_are_one_line(array: dict[str, Any], said: str) -> None:
    """In trial.toml: the key, what it is, what was expected."""
    with pytest.raises(SettingsError, match=said):
        settings_from({"array": array})


def test_samples_in_memory(tmp_path: Path) -> None:
    """A plain table with two-dimensional samples is a snapshots log; other shapes are refused."""
    log = log_of("snapshots", {"time_s": np.arange(40), "samples": PHASES}, array=SensorArray(frequency_hz=5.0))
    np.testing.assert_array_equal(log.read().wide("samples"), PHASES)
    with pytest.raises(InputError, match=r"samples has the shape \(3,\)"):
        log_of("snapshots", {"time_s": [1, 2, 3], "samples": [1, 2, 3]})


def test_an_archive_of_layout_2_stays_readable() -> None:
    """The first layout with snapshots, as the release that introduced it wrote it."""
    path = Path(__file__).parent / "data" / "layout-2.h5"
    assert verify(path).layout == 2
    same(open_trial(path))
