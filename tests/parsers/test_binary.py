"""Binary logs of fixed records: described in trial.toml, read piece by piece, named where they do not fit."""

from __future__ import annotations

import random
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rangeeval
from rangeeval import flow
from rangeeval.errors import InputError, RangeevalError, SettingsError
from rangeeval.model import settings_from
from rangeeval.parsers import binary as parser
from rangeeval.parsers import blocks, open_trial
from rangeeval.parsers.inspection import inspect_trial
from tests.parsers.samples import COLUMNS, same, structured

FIELDS = [{name: "S4" if values.dtype.kind == "U" else "<f8"} for name, values in COLUMNS.items()]


def trial(folder: Path, data: bytes, **log: Any) -> Path:
    """A trial with one binary log."""
    folder.mkdir(exist_ok=True)
    (folder / "track.dat").write_bytes(data)
    lines = [f"{key} = {_toml(value)}" for key, value in {"file": "track.dat", **log}.items()]
    (folder / "trial.toml").write_text("[[logs]]\n" + "\n".join(lines) + "\n", encoding="utf-8")
    return folder


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f'"{k}" = {_toml(v)}' for k, v in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return f'"{value}"' if isinstance(value, str) else str(value)


@pytest.mark.parametrize(
    "fields",
    [
        FIELDS,
        {name: dtype for field in FIELDS for name, dtype in field.items()},
        [f"{name} = {dtype}" for field in FIELDS for name, dtype in field.items()],
        [f"{name}='{dtype}'" for field in FIELDS for name, dtype in field.items()],
        [{"name": name, "dtype": dtype} for field in FIELDS for name, dtype in field.items()],
    ],
    ids=["tables", "table", "text", "quoted", "long"],
)
def test_every_way_to_list_the_fields_gives_the_same_table(fields: Any, tmp_path: Path) -> None:
    """A list of one-key tables (the contract's form), a table, lines, tables of name and dtype."""
    opened = open_trial(trial(tmp_path / "t", structured().tobytes(), fields=fields))
    assert [(s.format, s.kind) for s in opened.sources] == [("binary", "residuals")]
    assert opened.problems == ()
    same(opened.logs[0].read())


def test_a_table_of_its_own_in_trial_toml() -> None:
    """[logs.fields], and [[logs.fields]] with name and dtype."""
    short = tomllib.loads('[[logs]]\nfile = "a"\n[logs.fields]\ntime_s = "<f8"\nx = "i2"\n')
    long = tomllib.loads(
        '[[logs]]\nfile = "a"\n[[logs.fields]]\nname = "time_s"\ndtype = "<f8"\n[[logs.fields]]\nname = "x"\ndtype = "i2"\n'
    )
    assert settings_from(short) == settings_from(long)
    assert [f.name for f in settings_from(short).logs[0].fields] == ["time_s", "x"]


def test_header_padding_scale_and_a_last_record_cut_off(tmp_path: Path) -> None:
    """A big-endian recorder: a header, whole numbers of centimetres, bytes passed over, records of 40 bytes."""
    n = 1000
    names, formats = ["t", "r", "y", "p", "id", "ok"], ["<u4", ">i2", "<f4", ">f8", "S6", "?"]
    layout = {"names": names, "formats": formats, "offsets": [0, 4, 8, 12, 20, 26], "itemsize": 40}
    records = np.zeros(n, np.dtype(layout))
    rng = np.random.default_rng(1)
    records["t"], records["r"], records["y"] = np.arange(n) * 500, rng.integers(-900, 900, n), rng.normal(size=n)
    records["p"], records["id"] = 5e4, np.array(["표적".encode(), b"T-2"])[rng.integers(0, 2, n)]
    fields = [{"time_ms": "<u4"}, {"ES_R": ">i2"}, {"_": "V2"}, {"y_residual_m": "float32"}, {"range_predicted_m": ">d"},
              {"track_id": "S6"}, {"_": "u1"}]  # fmt: skip
    folder = trial(
        tmp_path / "t", b"RREC1.0\0" + records.tobytes() + b"12345", fields=fields, header_bytes=8, record_bytes=40,
        columns={"ES_R": "range_residual_cm"},
    )  # fmt: skip
    log = open_trial(folder).log("residuals")
    table = log.read()
    assert log.rows == len(table) == n
    np.testing.assert_array_equal(table.floats("time_s"), np.arange(n) * 0.5)
    np.testing.assert_allclose(table.floats("range_residual_m"), records["r"] / 100)
    np.testing.assert_array_equal(table.floats("y_residual_m"), records["y"].astype(float))
    assert table.texts("track_id") == [i.decode() for i in records["id"].tolist()]
    assert [(p.reason, p.count, p.rejected, p.examples) for p in table.problems] == [
        ("the last record is cut off", 1, True, ("t/track.dat[1000]: has 5 of the 40 bytes of a record",))
    ]
    (found,) = inspect_trial(folder)
    assert (found.rows, found.rejected, found.format) == (n, 1, "binary")


def test_any_byte_but_0_is_true_and_a_nan_that_signals_is_missing(tmp_path: Path) -> None:
    """Recorders write 255 for true, and whatever bits for no number."""
    data = np.zeros(3, [("t", "<f8"), ("d", "u1"), ("a", "<u4")])
    data["t"], data["d"], data["a"] = [1, 2, 3], [0, 1, 255], [0x3F800000, 0x7FA00000, 0x7F800000]
    fields = [{"time_s": "f8"}, {"detected": "?"}, {"amplitude": "f4"}]
    table = open_trial(trial(tmp_path / "t", data.tobytes(), fields=fields)).logs[0].read()
    assert table.floats("detected").tolist() == [0.0, 1.0]
    np.testing.assert_array_equal(table.floats("amplitude"), [1.0, np.nan])
    assert table.problems[0].examples == ("t/track.dat[2]: amplitude is infinite",)


def test_rows_come_in_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pieces of any size are the same rows, and the last one says what is cut off."""
    for module in (blocks, parser):
        monkeypatch.setattr(module, "CHUNK_ROWS", 64)
    data = np.zeros(200, [("t", "<f8"), ("a", "<f4"), ("b", "<f4")])
    data["t"] = np.arange(200)
    fields = [{"time_s": "f8"}, {"alpha": "f4"}, {"beta": "f4"}]
    log = open_trial(trial(tmp_path / "t", data.tobytes() + b"1", fields=fields)).logs[0]
    pieces = list(log.pieces(["time_s"]))
    assert [(len(p), len(p.problems)) for p in pieces] == [(64, 0), (64, 0), (64, 0), (8, 1)]
    assert np.concatenate([p.floats("time_s") for p in pieces]).tolist() == list(range(200))
    (tmp_path / "t" / "track.dat").write_bytes(data.tobytes()[:1000])
    with pytest.raises(InputError, match=r"track.dat: was cut off while it was read"):
        log.read()


def test_less_than_a_record_is_a_log_without_rows(tmp_path: Path) -> None:
    """The bytes are counted as a row set aside."""
    (found,) = inspect_trial(trial(tmp_path / "t", b"123", fields=[{"time_s": "f8"}, {"alpha": "f8"}, {"beta": "f8"}]))
    assert (found.rows, found.rejected) == (0, 1)


@pytest.mark.parametrize(
    ("log", "says"),
    [
        ({"fields": [{"time_s": "<f9"}]}, r"trial.toml: logs\[0\].fields: time_s is '<f9', .*; did you mean '<f"),
        ({"fields": [{"time_s": "flaot64"}]}, "did you mean 'float64'"),
        ({"fields": [{"time_s": "O"}]}, "time_s is 'O', not the type of one number or of a text; known: numbers such as"),
        ({"fields": [{"time_s": "M8[s]"}]}, r"time_s is 'M8\[s\]', not the type of one number"),
        ({"fields": [{"time_s": "(3,)f4"}]}, r"time_s is '\(3,\)f4', not the type of one number"),
        ({"fields": [{"time_s": "f4,f4"}]}, "time_s is 'f4,f4', not the type of one number"),
        ({"fields": [{"time_s": "V8"}]}, "bytes without a meaning; begin the name with '_' to pass over them"),
        ({"fields": [{"time_s": "f8"}, {"TIME_S": "f4"}]}, "names 'TIME_S' twice"),
        ({"fields": [{"time_s": 8}]}, r"logs\[0\].fields\[0\]: is {'time_s': 8}, expected a name and its type"),
        ({"fields": "time_s = f8"}, "expected a list such as"),
        ({"fields": ["time_s"]}, "expected a name and its type"),
        ({"fields": [{"_": "f8"}]}, "no field to read"),
        ({"fields": [{"": "f8"}]}, "has no name"),
        ({"field": FIELDS}, "unknown key 'field'; did you mean 'fields'"),
        ({"fields": FIELDS, "header_bytes": -1}, "header_bytes is -1, expected 0 or more"),
        ({"fields": FIELDS, "record_bytes": 43}, "record_bytes is 43, expected 44 .what the fields take. to 1048576"),
        ({"fields": FIELDS, "skip_rows": 3}, "skip_rows is for a text log, .*; header_bytes is what stands before"),
        ({"fields": FIELDS, "delimiter": ";"}, "delimiter is for a text log, and fields make it a binary one"),
        ({"header_bytes": 3}, "header_bytes goes with fields, the list of what a binary record holds"),
        ({"record_bytes": 44}, "record_bytes goes with fields"),
    ],
    ids=range(20),
)  # fmt: skip
def test_a_wrong_description_is_one_line(log: dict[str, Any], says: str, tmp_path: Path) -> None:
    """File, key, what is there, and the nearest that is known."""
    with pytest.raises(SettingsError, match=says) as caught:
        open_trial(trial(tmp_path / "t", structured().tobytes(), **log))
    assert str(caught.value).startswith("t/trial.toml: logs[0]")
    assert str(caught.value).isprintable()


def test_a_description_that_does_not_fit_the_file_is_one_line(tmp_path: Path) -> None:
    """Names that no log has, a header longer than the file, a file that nothing describes."""
    data = structured().tobytes()
    with pytest.raises(InputError, match=r"its fields in trial.toml name no column of a known kind of log"):
        open_trial(trial(tmp_path / "t", data, fields=[{"x": "f8"}]))
    with pytest.raises(InputError, match=r"track.dat: has 264 bytes, and trial.toml says header_bytes = 999"):
        open_trial(trial(tmp_path / "t", data, fields=FIELDS, header_bytes=999))
    with pytest.raises(SettingsError, match=r"has no column 'ES', which trial.toml names"):
        open_trial(trial(tmp_path / "t", data, fields=FIELDS, columns={"ES": "range_residual_m"}))
    with pytest.raises(InputError, match="no known format; a binary log of fixed records is described by fields under"):
        open_trial(trial(tmp_path / "t", data))


def test_a_trial_with_a_binary_log_goes_all_the_way(tmp_path: Path) -> None:
    """Inspected, archived with its description, and reported: the same numbers as from the archive."""
    n = 2000
    rng = np.random.default_rng(2)
    names = ["time_s", "range_residual_m", "y_residual_m", "z_residual_m", "range_predicted_m", "y_predicted_m",
             "z_predicted_m", "alpha", "beta"]  # fmt: skip
    records = np.zeros(n, [(name, "<f4") for name in names])
    records["time_s"], records["range_predicted_m"] = np.arange(n) / 2, np.linspace(9e4, 1e4, n)
    records["alpha"], records["beta"] = 0.5, 0.1
    for name in names[1:4]:
        records[name] = rng.normal(size=n)
    folder = trial(tmp_path / "t", records.tobytes() + b"12", fields=dict.fromkeys(names, "f4"))
    opened = open_trial(folder)
    archive = open_trial(flow.ingest(opened, tmp_path / "t.h5"))
    assert archive.settings == opened.settings
    rows = [rangeeval.accuracy(t).to_json().split('"provenance"')[0] for t in (opened, archive)]
    assert rows[0] == rows[1]
    rangeeval.report(opened, tmp_path / "out")
    assert "the last record is cut off" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
@settings(max_examples=400, deadline=None)
@given(
    data=st.binary(max_size=300),
    fields=st.lists(
        st.tuples(
            st.sampled_from(
                ["time_s", "range_m", "azimuth_deg", "target_id", "snr_db", "_", "other", "elevation_mrad"]
            ),
            st.sampled_from(["f4", ">f8", "<i2", "u1", "?", "S3", "V2", "i8", "float16", "u8", "f16", "S"]),
        ),
        max_size=7,
    ),
    header=st.integers(0, 20),
    stride=st.none() | st.integers(0, 64),
)
def test_any_bytes_and_any_description_give_a_table_or_one_line(
    data: bytes,
    fields: list[tuple[str, str]],
    header: int,
    stride: int | None,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Rows, whole or rejected, are as many as the bytes hold; all else is one line."""
    folder = tmp_path_factory.getbasetemp() / f"binary{random.randrange(10**9)}"
    log: dict[str, Any] = {"fields": [{name: dtype} for name, dtype in fields], "header_bytes": header}
    if stride is not None:
        log["record_bytes"] = stride
    try:
        opened = open_trial(trial(folder, data, **log))
        table = opened.logs[0].read()
    except RangeevalError as error:
        line = str(error)
    else:
        line = ""
    assert not line or line.isprintable()
    if line:
        return
    sizes = {"f4": 4, ">f8": 8, "<i2": 2, "u1": 1, "?": 1, "S3": 3, "V2": 2, "i8": 8, "float16": 2, "u8": 8}
    size = stride or sum(sizes[dtype] for _, dtype in fields)
    assert len(table) + sum(p.count for p in table.problems if p.rejected) == -(-(len(data) - header) // size)
