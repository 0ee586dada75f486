"""ASTERIX: records written byte by byte come back as rows; what is no record is found, counted and stepped over."""

from __future__ import annotations

import random
import struct
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rangeeval.errors import InputError, MissingExtra, SettingsError
from rangeeval.flow import ingest
from rangeeval.model import Table, Trial
from rangeeval.parsers import FORMATS, could_be_log, open_trial
from rangeeval.parsers.asterix import tables
from rangeeval.parsers.asterix.reports import REPORTS
from rangeeval.parsers.inspection import inspect_trial
from rangeeval.physics.geodesy import north_up_east
from rangeeval.reporting.terminal import inspection_text
from tests.parsers.samples import SAMPLES, SNAPSHOTS, compressed, csv_text
from tests.recordings import (
    block,
    datagram,
    datagram6,
    ethernet,
    north_mark,
    pcap,
    pcapng,
    plot,
    position,
    record,
    time,
)

NMI = 1852.0
FOOT = 0.3048
SAMPLE = Path(__file__).resolve().parents[2] / "sample_logs" / "asterix"


def opened(folder: Path, data: bytes, toml: str = "", name: str = "recording") -> Trial:
    (folder / name).write_bytes(data)
    if toml:
        (folder / "trial.toml").write_text(f'[[logs]]\nfile = "{name}"\n{toml}\n', encoding="utf-8")
    return open_trial(folder)


def whole(trial: Trial) -> Table:
    (log,) = trial.logs
    return log.read()


def said(trial: Trial) -> dict[str, int]:
    """Everything that was wrong, by reason, with the counts."""
    problems = [*trial.problems, *(p for log in trial.logs for p in log.read().problems)]
    return {p.reason: p.count for p in problems}


def counted(trial: Trial, text: str) -> int:
    """How often the one reason that holds this text was met."""
    (count,) = (n for reason, n in said(trial).items() if text in reason)
    return count


# --- what the records say --------------------------------------------------------------------------------------------


def test_a_radar_plot_from_the_octets_of_the_category_document(tmp_path: Path) -> None:
    """A CAT048 block typed octet by octet gives its time, range, azimuth, amplitude and address."""
    data = bytes.fromhex(
        "30 0017"  # category 48, 23 octets
        "fb 80"  # items 010, 140, 020, 040, 070, 130; extended: 220
        "19 0b"  # I048/010: SAC 25, SIC 11
        "356d4d"  # I048/140: 3501389 / 128 s
        "a0"  # I048/020: Mode S roll-call
        "c5af f1e0"  # I048/040: 50607 / 256 NM, 61920 * 360 / 65536 deg
        "0200"  # I048/070: Mode 3/A 1000
        "60 02 c3"  # I048/130: two replies (SRR), -61 dBm (SAM)
        "3c660c"  # I048/220
    )
    trial = opened(tmp_path, data)
    assert [(s.format, s.kind) for s in trial.sources] == [("asterix", "plots")]
    table = whole(trial)
    assert table.floats("time_s").tolist() == [3501389 / 128]
    assert table.floats("range_m") == pytest.approx([50607 / 256 * NMI], rel=1e-15)
    assert table.floats("azimuth_rad") == pytest.approx([61920 * 2 * np.pi / 65536], rel=1e-15)
    assert table.floats("amplitude_dbm").tolist() == [-61.0]
    assert table.texts("target_id") == ["3C660C"]


def test_targets_are_named_by_address_then_track_then_code(tmp_path: Path) -> None:
    """3C660C, T17, A7001; a code that is garbled or zero names nothing; what was used is counted."""
    data = block(
        48,
        plot(1, 10, 20, address=0x3C660C, track=16, code=0o1000),
        plot(2, 10, 20, track=17, code=0o1000),
        plot(3, 10, 20, code=0o7001),
        plot(4, 10, 20, code=0o7001 | 0x4000),
        plot(5, 10, 20, code=0),
    )
    trial = opened(tmp_path, data)
    assert whole(trial).texts("target_id") == ["3C660C", "T17", "A7001", "", ""]
    assert counted(trial, "by their track number") == 1
    assert counted(trial, "by their Mode 3/A code") == 1


def test_what_is_no_measurement_is_set_aside(tmp_path: Path) -> None:
    """Predicted positions, simulated and test targets, records without time or position: counted by reason, with bytes."""
    no_time = record("048", {"010": b"\x19\x0b", "020": b"\xa0", "040": bytes(4)})
    no_place = record("048", {"010": b"\x19\x0b", "140": time(7), "020": b"\xa0", "161": b"\0\x05"})
    late = record("048", {"010": b"\x19\x0b", "140": b"\xff\xff\xff", "020": b"\xa0", "040": bytes(4)})
    blocks = [
        block(48, plot(1, 10, 20, track=1)),
        block(48, plot(2, 10, 20, track=1, descriptor=b"\x00")),  # no detection
        block(48, plot(3, 10, 20, track=1, descriptor=b"\xb0")),  # simulated
        block(48, plot(4, 10, 20, track=1, descriptor=b"\xa1\x80")),  # test target, in the first extension
        block(48, plot(5, 10, 20, track=1, descriptor=b"\xa1\x01\x00")),  # two extensions, nothing set
        block(48, no_time, no_place, late),
    ]
    trial = opened(tmp_path, b"".join(blocks))
    table = whole(trial)
    assert table.floats("time_s").tolist() == [1.0, 5.0]
    assert counted(trial, "predicted") == 1
    assert counted(trial, "simulated and test") == 2
    assert counted(trial, "without a time of day") == 2
    assert counted(trial, "without a position") == 1
    (predicted,) = (p for p in table.problems if "predicted" in p.reason)
    assert predicted.rejected
    assert predicted.examples == (f"{tmp_path.name}/recording byte {len(blocks[0])}",)


def test_surface_radar_plots_are_polar_or_cartesian(tmp_path: Path) -> None:
    """CAT010: range and azimuth as they stand (1 m), else from x east and y north; other messages are counted."""
    base = {"010": b"\x00\x07", "000": b"\x01", "020": b"\x60", "161": b"\x00\x2a"}
    polar = record("010", base | {"140": time(10), "040": struct.pack(">HH", 1234, 16384)})
    both = record("010", base | {"140": time(11), "040": struct.pack(">HH", 99, 0), "042": struct.pack(">hh", 5, 5)})
    flat = record("010", base | {"140": time(12), "042": struct.pack(">hh", -300, 400), "220": b"\x34\x25\x92"})
    coasted = record("010", base | {"140": time(13), "040": bytes(4), "170": b"\x10"})
    turn = record("010", {"010": b"\x00\x07", "000": b"\x02", "140": time(14)})
    trial = opened(tmp_path, b"".join(block(10, r) for r in (polar, both, flat, coasted, turn)))
    table = whole(trial)
    assert table.floats("range_m").tolist() == [1234.0, 99.0, 500.0]
    assert np.degrees(table.floats("azimuth_rad")) == pytest.approx([90.0, 0.0, 360 - np.degrees(np.arctan(0.75))])
    assert table.texts("target_id") == ["T42", "T42", "342592"]
    assert counted(trial, "x (east) and y (north)") == 1
    assert counted(trial, "service messages") == 1
    assert counted(trial, "predicted") == 1


def test_surface_positions_are_truth(tmp_path: Path) -> None:
    """CAT010 with I010/041 alone: latitude and longitude in 180 / 2^31 deg, measured height in 6.25 ft."""
    data = block(10, record("010", {
        "010": b"\x00\x6b", "000": b"\x01", "020": b"\x20", "140": time(10), "220": b"\x34\x25\x92",
        "041": struct.pack(">ii", 2**30, -(2**28)), "091": struct.pack(">h", 16),
    }))  # fmt: skip
    table = whole(opened(tmp_path, data))
    assert (table.floats("latitude_deg")[0], table.floats("longitude_deg")[0]) == (90.0, -22.5)
    assert table.floats("height_m") == pytest.approx([100 * FOOT])


def test_x_and_y_are_truth_where_their_origin_is_known(tmp_path: Path) -> None:
    """CAT010 with x and y, and `latitude_deg`, `longitude_deg` of what they count from: positions, back in x and y."""
    base = {"010": b"\x00\x6b", "000": b"\x01", "020": b"\x20", "220": b"\x34\x25\x92"}
    records = [
        record("010", base | {"140": time(10), "042": struct.pack(">hh", -300, 400)}),
        record("010", base | {"140": time(11), "042": struct.pack(">hh", 20_000, -30_000), "090": b"\x01\x90"}),
    ]
    toml = "latitude_deg = 41.297\nlongitude_deg = 2.078\nheight_m = 55.0"
    (log,) = opened(tmp_path, block(10, *records), toml).logs
    assert log.kind == "truth"
    table = log.read()
    assert table.floats("height_m") == pytest.approx([55.0, 10000 * FOOT])
    latitude, longitude = (np.radians(table.floats(n)) for n in ("latitude_deg", "longitude_deg"))
    place = north_up_east(latitude, longitude, 0.0, (np.radians(41.297), np.radians(2.078), 0.0))
    assert place[:, 0] == pytest.approx(
        [400, -30_000], abs=0.6
    )  # the foot of a point 100 m above the ground, 0.6 m off
    assert place[:, 2] == pytest.approx([-300, 20_000], abs=0.6)
    (plots,) = opened(tmp_path, block(10, *records), toml + '\nkind = "plots"').logs
    assert plots.read().floats("range_m")[0] == 500.0


def test_ads_b_positions_are_truth(tmp_path: Path) -> None:
    """CAT021: the fine position, the geometric height, else the flight level, else height_m of trial.toml."""
    data = b"".join([
        block(21, position(100, 36.5, 127.25, address=0x71C001, feet=10000)),
        block(21, position(101, 36.5, -127.25, address=0x71C001, level=100)),
        block(21, position(102, -36.5, 127.25, address=0x71C002)),
        block(21, position(103, 36.5, 127.25, address=0x71C002, descriptor=b"\x01\x20")),  # simulated
    ])  # fmt: skip
    trial = opened(tmp_path, data, "height_m = 110.0")
    table = whole(trial)
    assert table.floats("latitude_deg") == pytest.approx([36.5, 36.5, -36.5], abs=180 / 2**31)
    assert table.floats("longitude_deg") == pytest.approx([127.25, -127.25, 127.25], abs=180 / 2**31)
    assert table.floats("height_m") == pytest.approx([10000 * FOOT, 10000 * FOOT, 110.0])
    assert table.texts("target_id") == ["71C001", "71C001", "71C002"]
    assert counted(trial, "flight level") == 1
    assert counted(trial, "height_m of trial.toml") == 1
    assert counted(trial, "simulated") == 1
    (tmp_path / "trial.toml").unlink()
    assert np.isnan(whole(open_trial(tmp_path)).floats("height_m")[2])


def test_the_time_of_a_position_is_the_one_nearest_to_it(tmp_path: Path) -> None:
    """CAT021: the time of applicability, else of reception, else of transmission."""
    base = {"010": b"\x19\x63", "040": b"\0", "131": bytes(8), "080": b"\x71\xc0\x01", "090": b"\0"}
    times = {"071": time(5), "073": time(6), "077": time(7)}
    records = [record("021", base | dict(list(times.items())[first:])) for first in range(3)]
    trial = opened(tmp_path, b"".join(block(21, r) for r in records))
    assert whole(trial).floats("time_s").tolist() == [5.0, 6.0, 7.0]
    assert counted(trial, "that of reception") == counted(trial, "that of transmission") == 1


def test_system_tracks_are_truth(tmp_path: Path) -> None:
    """CAT062: position in 180 / 2^25 deg; geometric, barometric or measured height; coasting tracks are set aside."""
    base = {"010": b"\x19\x01", "105": struct.pack(">ii", 2**23, -(2**22)), "040": b"\x00\x2a"}
    tracks = [
        {"070": time(1), "080": b"\0", "130": struct.pack(">h", 16), "380": b"\x80\x71\xc0\x01"},
        {"070": time(2), "080": b"\0", "135": struct.pack(">H", 40)},
        {"070": time(3), "080": b"\0", "135": struct.pack(">H", 0x8000 | 0x7FFC)},  # QNH corrected, level -1
        {"070": time(4), "080": b"\0", "136": struct.pack(">h", 8)},
        {"070": time(5), "080": b"\x01\x01\x01\x80", "136": struct.pack(">h", 8)},  # coasting
    ]
    trial = opened(tmp_path, block(62, *(record("062", base | items) for items in tracks)))
    table = whole(trial)
    assert table.floats("latitude_deg").tolist() == [45.0] * 4
    assert table.floats("longitude_deg").tolist() == [-22.5] * 4
    assert table.floats("height_m") == pytest.approx(np.array([100, 1000, -100, 200]) * FOOT)
    assert table.texts("target_id") == ["71C001", "T42", "T42", "T42"]
    assert counted(trial, "predicted") == 1
    assert counted(trial, "flight level") == 3


def test_times_run_on_past_midnight_and_together(tmp_path: Path) -> None:
    """Both logs of a file count from the midnight before its first record, whichever of them begins after the next."""
    data = block(48, plot(86399.5, 10, 20, track=1)) + block(48, plot(0.25, 11, 20, track=1))
    data += block(21, position(0.5, 36.5, 127.25, address=1, feet=100))
    data += block(48, plot(86399.75, 11, 20, track=2))  # a late one of the day before
    plots, truth = sorted(opened(tmp_path, data).logs, key=lambda log: log.kind)
    assert plots.read().floats("time_s").tolist() == [86399.5, 86400.25, 86399.75]
    assert truth.read().floats("time_s").tolist() == [86400.5]


# --- sensors and editions --------------------------------------------------------------------------------------------


def test_every_sensor_is_a_log_of_its_own(tmp_path: Path) -> None:
    """Two radars that see one aircraft: two logs, and each names its targets as its own; `sensor` reads one alone."""
    blocks = [block(48, plot(i, 10 + i, 20, sensor=(25, 11 + i % 2), address=0x3C660C)) for i in range(10)]
    trial = opened(tmp_path, b"".join(blocks))
    where = f"{tmp_path.name}/recording"
    assert [log.source for log in trial.logs] == [f"{where}:CAT048 25/11", f"{where}:CAT048 25/12"]
    first, second = (log.read() for log in trial.logs)
    assert set(first.texts("target_id")) == {"25/11 3C660C"}
    assert second.floats("time_s").tolist() == [1.0, 3.0, 5.0, 7.0, 9.0]
    (tmp_path / "trial.toml").write_text('[[logs]]\nfile = "recording"\nsensor = "25/12"\n', encoding="utf-8")
    (one,) = open_trial(tmp_path).logs
    assert one.source == where
    assert set(one.read().texts("target_id")) == {"3C660C"}


def test_inspect_tells_the_sensors_apart(tmp_path: Path) -> None:
    """Each log under its own title; what concerns the whole file once, with the first of them."""
    blocks = [block(48, plot(i, 10 + i, 20, sensor=(25, 11 + i % 2), address=0x3C660C)) for i in range(10)]
    found = inspect_trial(opened(tmp_path, b"".join([*blocks, north_mark(11)])))
    assert [len([p for p in f.problems if "CAT034" in p.reason]) for f in found] == [1, 0]
    text = inspection_text([f.as_dict() for f in found], None)
    assert "recording:CAT048 25/11" in text
    assert "recording:CAT048 25/12" in text


def test_an_archive_holds_the_same_rows(tmp_path: Path) -> None:
    """Logs of several sensors go into an archive and come back as they were read."""
    blocks = [block(48, plot(i, 10 + i, 20, sensor=(25, 11 + i % 2), address=0x3C660C)) for i in range(40)]
    trial = opened(tmp_path, b"".join(blocks))
    kept = open_trial(ingest(trial, tmp_path / "trial.h5"))
    assert [log.source for log in kept.logs] == [log.source for log in trial.logs]
    for one, other in zip(trial.logs, kept.logs, strict=True):
        before, after = one.read(), other.read()
        assert before.texts("target_id") == after.texts("target_id")
        for name in ("time_s", "range_m", "azimuth_rad"):
            np.testing.assert_array_equal(before.floats(name), after.floats(name))


def test_sensors_may_share_a_data_block(tmp_path: Path) -> None:
    """Records of several sensors in one block each go to their log; where that begins late it is counted."""
    mixed = [block(48, *(plot(i, 10, 20, sensor=(25, sic), track=1) for sic in (11, 12))) for i in range(5)]
    trial = opened(tmp_path, b"".join(mixed))
    assert [log.source[-5:] for log in trial.logs] == ["25/11", "25/12"]
    assert [len(log.read()) for log in trial.logs] == [5, 5]
    own = [block(48, plot(i, 10, 20, sensor=(25, sic), track=1)) for i in range(100) for sic in (11, 12)]
    trial = opened(tmp_path, b"".join(own + mixed))
    assert sum(len(log.read()) for log in trial.logs) == 205
    assert counted(trial, "another sensor inside a data block") == 5


def test_a_damaged_sensor_name_makes_no_log(tmp_path: Path) -> None:
    """One block of a thousand with another sensor is set aside; the others keep their log and their targets' names."""
    blocks = [block(48, plot(i, 10, 20, address=0x3C660C)) for i in range(1000)]
    blocks[500] = block(48, plot(500, 10, 20, sensor=(89, 11), address=0x3C660C))
    trial = opened(tmp_path, b"".join(blocks))
    table = whole(trial)
    assert len(table) == 999
    assert set(table.texts("target_id")) == {"3C660C"}
    assert counted(trial, "CAT048 89/11, a sensor that is named less than once in 500") == 1
    trial = opened(tmp_path, b"".join(blocks), 'sensor = "89/11"')
    assert len(whole(trial)) == 1


def test_the_edition_is_the_newest_that_fits(tmp_path: Path) -> None:
    """Edition 0.23 of CAT021 has other items in other places: it is found, said, and can be asked for."""
    items = {
        "010": b"\x00\x6b", "040": b"\x00\x20", "030": time(20), "080": b"\x34\x25\x92", "090": b"\0\0",
        "130": (2**21).to_bytes(3, "big") + (2**24 - 2**20).to_bytes(3, "big"), "210": b"\x01",
        "145": struct.pack(">h", 400),
    }  # fmt: skip
    data = b"".join(block(21, record("021-0.23", items | {"030": time(20 + i)})) for i in range(10))
    trial = opened(tmp_path, data)
    assert counted(trial, "CAT021 of 0/107 is read by edition 0.23") == 0
    table = whole(trial)
    assert table.floats("latitude_deg").tolist() == [45.0] * 10
    assert table.floats("longitude_deg").tolist() == [-22.5] * 10
    assert table.floats("height_m") == pytest.approx([10000 * FOOT] * 10)
    trial = opened(tmp_path, data, 'editions = { CAT021 = "0.23" }')
    assert not any("edition" in reason for reason in said(trial))
    with pytest.raises(InputError, match="give no log"):
        opened(tmp_path, data, 'editions = { CAT021 = "2.1" }')


@pytest.mark.parametrize(
    ("toml", "says"),
    [
        ('editions = { CAT048 = "9.9" }', r"edition '9.9' of CAT048 is not known; known: 1.32, 1.31"),
        ('editions = { CAT084 = "1.0" }', r"editions in trial.toml names 'CAT084'; did you mean 'CAT048'"),
        ("latitude_deg = 41.0", r"latitude_deg 41.0 and longitude_deg None; expected both"),
        ('sensor = "1/2"', r"asks for sensor '1/2'; the file holds 25/11"),
    ],
)
def test_a_wrong_setting_is_one_line(toml: str, says: str, tmp_path: Path) -> None:
    """An edition, a category or a sensor that there is not: said with what there is."""
    with pytest.raises(SettingsError, match=says):
        opened(tmp_path, block(48, plot(1, 10, 20, track=1)), toml)


def test_other_messages_are_named_and_counted(tmp_path: Path) -> None:
    """Service messages give no log; a recording of nothing else is not recognised as one, and says what it holds."""
    marks = b"".join(north_mark(i) for i in range(3))
    trial = opened(tmp_path, marks + block(48, plot(1, 10, 20, track=1)))
    assert "data blocks that give no log: 3 of CAT034 (monoradar service messages)" in said(trial)
    with pytest.raises(InputError, match=r"ASTERIX messages \(CAT034\) give no log"):
        opened(tmp_path, marks)


def test_without_the_extra_one_line_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No libasterix: which extra to install. Another package of its name: that, and what to do."""
    tables.library.cache_clear()
    monkeypatch.setitem(sys.modules, "asterix", None)
    monkeypatch.setattr(tables, "_installed", lambda: None)
    with pytest.raises(MissingExtra, match=r"rangeeval\[asterix\]"):
        opened(tmp_path, block(48, plot(1, 10, 20, track=1)))
    monkeypatch.undo()
    tables.library.cache_clear()
    for name in ("asterix.base", "asterix.generated"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, "asterix", types.ModuleType("asterix"))
    with pytest.raises(InputError, match="asterix-decoder takes the same name"):
        open_trial(tmp_path)
    tables.library.cache_clear()


# --- damage ----------------------------------------------------------------------------------------------------------

PLOTS = [block(48, plot(i, 10 + i, 20, address=0x3C6600 + i, track=7, dbm=-60)) for i in range(20)]


@pytest.mark.parametrize("garbage", [b"\0" * 7, b"\xff" * 70_000, bytes(range(256)) * 3, b"\x30\x00"])
def test_bytes_between_blocks_are_stepped_over(garbage: bytes, tmp_path: Path) -> None:
    """Whatever lies between two blocks, all others are read; the bytes are counted with their place."""
    trial = opened(tmp_path, b"".join(PLOTS[:9]) + garbage + b"".join(PLOTS[9:]))
    assert whole(trial).floats("time_s").tolist() == list(range(20))
    (problem,) = (p for p in trial.problems if p.rejected)
    assert problem.reason == "bytes between data blocks that belong to none"
    assert problem.examples[0].startswith(f"{tmp_path.name}/recording byte {sum(map(len, PLOTS[:9]))}:")


def test_no_block_is_lost_after_long_noise(tmp_path: Path) -> None:
    """Behind 400 kB of random bytes reading goes on with the first block there, and hardly any noise is taken for one."""
    for seed in range(5):
        noise = random.Random(seed).randbytes(400_000)
        trial = opened(tmp_path, b"".join(PLOTS[:10]) + noise + b"".join(PLOTS[10:]))
        assert whole(trial).floats("time_s").tolist() == list(range(20))


@pytest.mark.parametrize("length", [0, 2, 5, 20, 40, 200, 65_535])
def test_a_wrong_length_costs_that_block_alone(length: int, tmp_path: Path) -> None:
    """Too short, too long, into the next block: the other 19 plots are read, and something is counted."""
    bad = bytearray(PLOTS[9])
    bad[1:3] = struct.pack(">H", length)
    trial = opened(tmp_path, b"".join([*PLOTS[:9], bytes(bad), *PLOTS[10:]]))
    times = whole(trial).floats("time_s").tolist()
    assert set(times) >= set(range(20)) - {9, 10}
    assert len(times) >= 18
    assert sum(p.count for log in trial.logs for p in (*trial.problems, *log.read().problems) if p.rejected)


def test_a_block_that_its_tables_do_not_fit_is_left_out_whole(tmp_path: Path) -> None:
    """A field specification without end, an item beyond the block, one that the edition does not have."""
    broken = [block(48, b"\xff" * 9), block(48, plot(3, 1, 2, track=1)[:-1]), block(48, b"\xff\xff\xff\xff\x80" * 3)]
    broken = [b[:3] + b"\xff" + b[4:] for b in broken[:1]] + broken[1:]
    trial = opened(tmp_path, b"".join([*PLOTS[:10], *broken, *PLOTS[10:]]))
    assert len(whole(trial)) == 20
    rejected = [p for log in trial.logs for p in log.read().problems if p.rejected]
    others = [p for p in trial.problems if p.rejected]
    assert sum(p.count for p in rejected + others) == len(broken)


def test_a_recording_that_is_cut_off_loses_its_last_block(tmp_path: Path) -> None:
    """Cut anywhere in the last block: the others are read, and the loss is said."""
    data = b"".join(PLOTS)
    for lost in range(1, len(PLOTS[-1])):
        trial = opened(tmp_path, data[:-lost])
        assert len(whole(trial)) == 19
        assert sum(p.count for p in trial.problems if p.rejected) == 1


def test_a_block_recorded_twice_is_read_once(tmp_path: Path) -> None:
    """Two networks, a mirrored port: the same bytes again shortly after are counted, not read."""
    trial = opened(tmp_path, b"".join(b * 2 for b in PLOTS))
    assert len(whole(trial)) == 20
    assert counted(trial, "recorded twice") == 20


def test_memory_stays_flat(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks that straddle the pieces in which a file is read are whole."""
    from rangeeval.parsers.asterix import framing

    monkeypatch.setattr(framing, "READ_BYTES", 1000)
    monkeypatch.setattr(framing, "_AHEAD", 300)
    assert len(whole(opened(tmp_path, b"".join(PLOTS)))) == 20
    trial = opened(tmp_path, b"".join(PLOTS[:10]) + b"\0" * 5000 + b"".join(PLOTS[10:]))
    assert len(whole(trial)) == 20


# --- captures --------------------------------------------------------------------------------------------------------

BLOCKS = [PLOTS[i] for i in range(6)]


def frames(link: int, wrap: Any = datagram) -> list[bytes]:
    packets = [wrap(b) for b in BLOCKS]
    if link == 1:
        return [ethernet(p) for p in packets]
    if link == 113:
        kind = 0x86DD if packets[0][0] >> 4 == 6 else 0x0800
        return [bytes(14) + struct.pack(">H", kind) + p for p in packets]
    if link == 276:
        return [struct.pack(">H", 0x0800) + bytes(18) + p for p in packets]
    return packets


CAPTURES = {
    "little": pcap(frames(1)),
    "big": pcap(frames(1), order=">"),
    "nanoseconds": pcap(frames(1), nanoseconds=True),
    "big-nanoseconds": pcap(frames(1), order=">", nanoseconds=True),
    "cooked": pcap(frames(113), link=113),
    "cooked-2": pcap(frames(276), link=276),
    "raw": pcap(frames(101), link=101),
    "loopback": pcap([struct.pack("<I", 2) + f for f in frames(101)], link=0),
    "vlan": pcap([ethernet(datagram(b), vlan=[7]) for b in BLOCKS]),
    "two-vlans": pcap([ethernet(datagram(b), vlan=[7, 8]) for b in BLOCKS]),
    "ipv6": pcap(frames(1, datagram6)),
    "ipv6-hops": pcap([ethernet(datagram6(b, hops=True)) for b in BLOCKS]),
    "ng": pcapng(frames(1)),
    "ng-big": pcapng(frames(1), order=">"),
    "ng-simple": pcapng(frames(1), simple=True),
    "ng-raw": pcapng(frames(101), link=101),
    "joined": pcap([ethernet(datagram(b"".join(BLOCKS)))]),
}


@pytest.mark.parametrize("name", CAPTURES)
@pytest.mark.parametrize("how", ["", "gz"])
def test_every_capture_gives_the_same_plots(name: str, how: str, tmp_path: Path) -> None:
    """Byte orders, resolutions, links, tags and both versions of IP change nothing; padding is no message."""
    data = compressed(CAPTURES[name], how) if how else CAPTURES[name]
    trial = opened(tmp_path, data, name="c.bin")
    assert [s.format for s in trial.sources] == ["pcap"]
    assert whole(trial).floats("time_s").tolist() == list(range(6))
    assert not any(p.rejected for p in trial.problems)


def test_packets_that_cannot_be_used_are_counted(tmp_path: Path) -> None:
    """Fragments, packets cut short by the capture, contradicting lengths: counted; other traffic: counted apart."""
    good = [ethernet(datagram(b)) for b in BLOCKS]
    first, last = ethernet(datagram(PLOTS[10], fragment=0x2000)), ethernet(datagram(PLOTS[11], fragment=20))
    wrong = bytearray(ethernet(datagram(PLOTS[12])))
    wrong[14 + 20 + 4 : 14 + 20 + 6] = struct.pack(">H", 4000)  # the datagram's length
    tcp = bytearray(ethernet(datagram(PLOTS[13])))
    tcp[14 + 9] = 6
    other = ethernet(datagram(b"hello, world"))
    arp = bytes(12) + b"\x08\x06" + bytes(46)
    data = pcap([*good, first, last, bytes(wrong), bytes(tcp), other, arp, b"\x01"])
    short = ethernet(datagram(PLOTS[14]))
    data += struct.pack("<IIII", 0, 0, 40, len(short)) + short[:40]
    trial = opened(tmp_path, data, name="c.bin")
    assert len(whole(trial)) == 6
    found = {p.reason: (p.count, p.rejected) for p in trial.problems}
    assert found["fragments of packets, which are not put together"] == (2, True)
    assert found["packets whose lengths contradict each other"] == (2, True)
    assert found["packets that the capture cut short"] == (1, True)
    assert found["UDP packets that hold no data block"] == (1, False)


@pytest.mark.parametrize("name", ["little", "ng"])
def test_a_capture_cut_off_anywhere_keeps_what_is_whole(name: str, tmp_path: Path) -> None:
    """Every length gives the packets before the cut and a note, or one line."""
    data = CAPTURES[name]
    first = data.index(BLOCKS[0]) + len(BLOCKS[0])
    for keep in [*range(12, first, 5), *range(first + 8, len(data), 7)]:
        if keep < first:
            with pytest.raises(InputError, match=r"c.bin: "):
                opened(tmp_path, data[:keep], name="c.bin")
            continue
        trial = opened(tmp_path, data[:keep], name="c.bin")
        assert 1 <= len(whole(trial)) <= 6


@pytest.mark.parametrize("name", ["big", "ng-big"])
def test_a_damaged_capture_keeps_what_comes_before(name: str, tmp_path: Path) -> None:
    """A packet header that makes no sense ends the reading there, and is said with its place."""
    data = bytearray(CAPTURES[name])
    at = data.index(BLOCKS[3]) - (14 + 28) - (8 if name == "big" else 24)
    data[at : at + 4] = b"\x7f" * 4  # the packet's, or the block's, length
    trial = opened(tmp_path, bytes(data), name="c.bin")
    assert len(whole(trial)) == 3
    assert counted(trial, "cannot be followed") == 1


def test_a_capture_without_asterix_says_so(tmp_path: Path) -> None:
    """Other traffic alone is no log."""
    with pytest.raises(InputError, match="it holds no ASTERIX data block"):
        opened(tmp_path, pcap([ethernet(datagram(b"hello, world"))]), name="c.bin")


# --- recognition -----------------------------------------------------------------------------------------------------


def test_no_other_format_is_taken_for_asterix(tmp_path: Path) -> None:
    """Samples of all formats, and texts that begin with the octets of categories, stay what they are."""
    path = tmp_path / "log"
    recognisers = [FORMATS["asterix"].recognises, FORMATS["pcap"].recognises]
    for write in [*SAMPLES.values(), *SNAPSHOTS.values()]:
        write(path)
        assert not any(recognises(path.read_bytes()[:4096], path) for recognises in recognisers)
    texts = [
        csv_text(),
        '"time_s","alpha"\n' * 5000,
        "0,1\n" * 50_000,
        "0" * 100_000,
        "> comment\n" * 20_000,
        "측정 기록\n" * 20_000,
        "\n" * 30_000,
    ]
    for text in texts:
        for encoding in ("utf-8", "utf-16", "utf-16-le", "cp949"):
            if encoding == "cp949" and not text.isascii():
                continue
            path.write_bytes(text.encode(encoding))
            assert not any(recognises(path.read_bytes()[:4096], path) for recognises in recognisers), text[:20]


def test_no_sample_log_is_taken_for_asterix() -> None:
    """Every other file of the sample trials stays what it is."""
    for path in SAMPLE.parent.rglob("*"):
        if path.is_file() and path.suffix not in {".pcap", ".ast"}:
            assert not FORMATS["asterix"].recognises(path.read_bytes()[:4096], path), path
            assert not FORMATS["pcap"].recognises(path.read_bytes()[:4096], path), path


def test_a_recording_may_begin_inside_a_block(tmp_path: Path) -> None:
    """A piece cut out of a recording is read from its first whole block on, and the bytes before are counted."""
    trial = opened(tmp_path, b"".join(PLOTS)[10:])
    assert len(whole(trial)) == 19
    assert counted(trial, "bytes between data blocks") == 1


def test_noise_is_not_recognised(tmp_path: Path) -> None:
    """Random bytes are no recording."""
    recognises = FORMATS["asterix"].recognises
    for seed in range(40):
        (tmp_path / "noise").write_bytes(random.Random(seed).randbytes(300_000))
        assert not recognises(b"", tmp_path / "noise")


def test_the_sample_is_recognised_by_content() -> None:
    """Neither file needs its ending, and a folder that is searched for trials takes both for logs."""
    for name in ("radar.pcap", "adsb.ast"):
        path = SAMPLE / name
        assert could_be_log(path.read_bytes()[:4096], path)


# --- the tables ------------------------------------------------------------------------------------------------------


def _made_up(definition: Any, source: random.Random) -> bytes:
    """A record's begin that a decoder must take apart: a field specification of known items, then anything."""
    from asterix import base

    known = [i for i, entry in enumerate(definition.cv_record.cv_items_list) if issubclass(entry, base.UapItem)]
    chosen = sorted(source.sample(known, source.randint(1, min(8, len(known)))))
    if source.random() < 0.1:
        chosen.append(len(definition.cv_record.cv_items_list) - 6)
    spec = bytearray(max(chosen) // 7 + 1)
    for i in chosen:
        spec[i // 7] |= 0x80 >> i % 7
    for i in range(len(spec) - 1):
        spec[i] |= 1
    few = source.choice([b"\0\x01\x02\x80", bytes(range(256))])
    return bytes(spec) + bytes(source.choice(few) for _ in range(source.choice([40, 300])))


@pytest.mark.parametrize(
    ("category", "name"), [(c, n) for c in sorted({r.category for r in REPORTS}) for n in tables.editions(c)]
)
def test_records_are_taken_apart_as_libasterix_does(category: int, name: str) -> None:
    """On made-up records of every edition: the same are refused, items begin at the same places, numbers are the same."""
    from asterix.base import Bits, ParsingMode

    definition = tables.editions(category)[name]
    fields = {}
    for report in REPORTS:
        if report.category == category:
            fields |= dict(report.fields)
    edition = tables.Edition(name, definition, fields)
    source = random.Random(f"{category} {name}")
    agreed = 0
    for _ in range(150):
        body = _made_up(definition, source)
        parsed = definition.cv_record.parse(ParsingMode.StrictParsing, Bits.from_bytes(body))
        if isinstance(parsed, ValueError):
            with pytest.raises(tables.Malformed):
                edition.records(block(category, body))
            continue
        one, rest = parsed
        body = body[: len(body) - len(rest) // 8]
        whole_block = block(category, body)
        (places,) = edition.records(whole_block)
        for item, place in edition.slots.items():
            if "/" in item:  # a subfield of a compound item: its number is compared below
                continue
            place = places[place]
            there = one.items_regular.get(item)
            assert (there is None) == (place < 0)
            if there is not None:
                data = there.unparse().to_bytes()
                assert whole_block[place : place + len(data)] == data
        data = np.frombuffer(whole_block + bytes(64), np.uint8)
        for short, numbers in edition.numbers(data, np.array([places])).items():
            expected = _by_libasterix(one, fields[short])
            assert numbers.tolist() == [expected] or (expected is None and np.isnan(numbers[0])), short
        agreed += 1
    assert agreed > 20


def _by_libasterix(parsed: Any, written: str) -> float | None:
    """The same field through libasterix's own objects."""
    from asterix import base

    item, _, name = written.partition("/")
    there = parsed.items_regular.get(item)
    if there is None:
        return None
    variation = there.arg.arg
    if name:
        variation = variation._get_item(name) if hasattr(variation, "_get_item") else None
        if variation is None:
            return None
        while not isinstance(variation, base.Element):
            variation = variation.arg
    content = getattr(variation.cv_rule, "cv_content", None)
    if content is not None and issubclass(content, base.ContentQuantity):
        return float(content(variation.bs)._as_quantity())
    return int(variation.as_uint())


def test_the_numbers_of_zeros_do_not_hang(tmp_path: Path) -> None:
    """Large blocks of empty records, and long runs of repetitions, are refused or read in their length's time."""
    for body in (bytes(65_000), b"\xff" * 65_000, b"\x01" * 65_000, (b"\x01\x01\x40" + b"\xff" * 20) * 2800):
        for category in sorted({r.category for r in REPORTS}):
            data = struct.pack(">BH", category, 3 + len(body)) + body
            assert any(len(log.read()) == 20 for log in opened(tmp_path, b"".join(PLOTS) + data).logs)
