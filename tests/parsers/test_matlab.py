"""MATLAB files of every version: the shapes a log may have, what is named as not read, and what a file must never do."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse

import rangeeval
from rangeeval import flow
from rangeeval.errors import InputError, SettingsError
from rangeeval.model import settings_from
from rangeeval.parsers import matlab, open_trial, safe
from rangeeval.parsers.inspection import inspect_trial
from rangeeval.parsers.matlab.version import version
from tests.parsers.samples import (
    COLUMNS,
    PHASES,
    POSITIONS,
    Matlab73,
    cells,
    read,
    same,
    write_matlab,
    write_matlab73,
)

NUMBERS = {name: values for name, values in COLUMNS.items() if values.dtype.kind == "f"}
IDS = COLUMNS["track_id"].tolist()


def save5(path: Path, variables: Mapping[str, Any], packed: bool = True) -> None:
    with path.open("wb") as file:
        scipy.io.savemat(
            file, {n: _for_scipy(v) for n, v in variables.items()}, oned_as="column", do_compression=packed
        )


def _for_scipy(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _for_scipy(held) for name, held in value.items()}
    if isinstance(value, list):
        made = np.empty((1, len(value)), [(name, object) for name in value[0]])
        for i, one in enumerate(value):
            made[0, i] = tuple(_for_scipy(held) for held in one.values())
        return made
    return value


def save73(path: Path, variables: Mapping[str, Any]) -> None:
    with Matlab73(path) as made:
        for name, value in variables.items():
            made.put(made.file, name, value)


both = pytest.mark.parametrize("save", [save5, save73], ids=["5", "7.3"])
Save = Callable[[Path, Mapping[str, Any]], None]


# --- what is read ----------------------------------------------------------------------------------------------------


@both
@pytest.mark.parametrize("form", ["columns", "rows", "struct", "inside", "elements", "cells", "singles"])
def test_every_shape_of_a_log_gives_the_same_table(form: str, save: Save, tmp_path: Path) -> None:
    """Vectors up or across, fields of a struct, an element a row, a cell a row: one log, whichever it is."""
    columns = {name: cells(IDS) if name == "track_id" else values[:, None] for name, values in COLUMNS.items()}
    across = {name: values.T for name, values in columns.items()}
    each = [
        {name: str(v) if name == "track_id" else np.array([[v]]) for name, v in zip(COLUMNS, row, strict=True)}
        for row in zip(*COLUMNS.values(), strict=True)
    ]
    made: dict[str, Any] = {
        "columns": columns,
        "rows": across,
        "struct": {"log": columns},
        "inside": {"run": {"number": np.array([[7.0]]), "pass3": {"log": across}}},
        "elements": {"log": each},
        "cells": {"log": {name: cells([one[name] for one in each]) for name in COLUMNS}},
        "singles": {"log": columns | {"waveform": "LFM", "alpha": np.array([[0.5]]), "beta": np.array([[0.1]])}},
    }
    save(tmp_path / "log", made[form])
    trial = open_trial(tmp_path / "log")
    place = {"columns": "log", "rows": "log", "inside": "log:run.pass3.log"}.get(form, "log:log")
    assert [log.source for log in trial.logs] == [place]
    assert trial.problems == ()
    table = trial.logs[0].read()
    if form == "singles":
        assert table.texts("waveform") == ["LFM"] * 6
        assert table.floats("alpha").tolist() == [0.5] * 6
        table = trial.logs[0].read(list(COLUMNS))
    same(table)


@both
def test_one_log_a_struct(save: Save, tmp_path: Path) -> None:
    """Structs in one file are logs of their own; a text residual_stage in one is its stage."""
    gains = {"time_s": np.arange(3.0)[:, None], "alpha": np.full((3, 1), 0.5), "beta": np.full((3, 1), 0.1)}
    numbers = {name: values[:, None] for name, values in NUMBERS.items()}
    save(tmp_path / "log", {"res": {**numbers, "residual_stage": "updated"}, "gains": gains, "note": "windy"})
    trial = open_trial(tmp_path / "log")
    assert {log.source: (log.kind, log.stage) for log in trial.logs} == {
        "log:res": ("residuals", "updated"),
        "log:gains": ("gains", "predicted"),
    }
    same(trial.log("residuals").read(), NUMBERS)


@both
def test_an_array_of_structs_is_one_log_of_its_tracks(save: Save, tmp_path: Path) -> None:
    """An element a track: its vectors follow each other, and what stands once in it holds for all its rows."""
    tracks = []
    for name, rows in (("A1", slice(0, 4)), ("B2", slice(4, 6))):
        track: dict[str, Any] = {n: values[rows][:, None] for n, values in NUMBERS.items()}
        track["y_residual_m"] = track["y_residual_m"].T  # one of them across
        tracks.append({**track, "track_id": name, "snr_db": np.array([[20.0]]), "covariance": np.eye(3)})
    save(tmp_path / "log", {"tracks": tracks})
    trial = open_trial(tmp_path / "log")
    table = trial.log("residuals").read()
    same(trial.log("residuals").read(list(NUMBERS)), NUMBERS)
    assert table.texts("track_id") == ["A1"] * 4 + ["B2"] * 2
    assert table.floats("snr_db").tolist() == [20.0] * 6
    assert [p.reason for p in trial.problems] == [
        "columns that are neither numbers nor text, or of another length, are not read: covariance"
    ]


@both
def test_numbers_of_any_type_and_empty_cells(save: Save, tmp_path: Path) -> None:
    """Whole numbers, logicals and single precision are numbers; an empty cell is missing, a number in a cell is one."""
    n = 4
    save(tmp_path / "log", {
        "time_s": np.arange(n, dtype=np.int32)[:, None],
        "range_m": np.full((n, 1), 1e4, np.float32),
        "azimuth_deg": np.arange(n, dtype=np.uint8)[:, None],
        "target_id": cells(["A", "", np.array([[12.0]]), "A"]),
        "snr_db": cells([np.array([[1.0]]), np.empty((0, 0)), np.array([[3]]), np.array([[4.5]])]),
    })  # fmt: skip
    if save is save73:  # MATLAB keeps the size of what is empty in its place
        with h5py.File(tmp_path / "log", "a") as file:
            references = file["snr_db"][0]
            empty = file["#refs#"].create_dataset("a", data=np.zeros(2, np.uint64))
            empty.attrs.update({"MATLAB_class": np.bytes_("double"), "MATLAB_empty": np.uint8(1)})
            references[1] = empty.ref
            file["snr_db"][0] = references
    table = read(tmp_path / "log")
    assert table.floats("range_m").tolist() == [1e4] * n
    np.testing.assert_allclose(table.floats("azimuth_rad"), np.deg2rad(np.arange(n)))
    assert table.texts("target_id") == ["A", "", "12", "A"]
    np.testing.assert_array_equal(table.floats("snr_db"), [1.0, np.nan, 3.0, 4.5])


def test_text_as_a_matrix_of_characters(tmp_path: Path) -> None:
    """Rows padded with blanks are texts without them; Korean ones too, and in version 7.3 beyond 16 bits."""
    ids = ["표적1", "표적22"]
    numbers = {"time_s": np.arange(2.0), "range_m": np.arange(2.0), "azimuth_rad": np.arange(2.0)}
    save5(tmp_path / "5", {**numbers, "target_id": np.array(ids)})
    with Matlab73(tmp_path / "7") as made:
        for name, value in numbers.items():
            made.put(made.file, name, value)
        units = np.array([np.frombuffer(i.ljust(4).encode("utf-16-le"), "u2") for i in ids])
        made.put(made.file, "target_id", units, kind="char")
    assert read(tmp_path / "5").texts("target_id") == ids
    assert read(tmp_path / "7").texts("target_id") == ids


@both
def test_letters_laid_across_are_no_single_text(save: Save, tmp_path: Path) -> None:
    """Ids run together into one text, as some writers do: columns of different lengths, not one id for all rows."""
    save(tmp_path / "log", {**{name: values[:, None] for name, values in NUMBERS.items()}, "track_id": "A1B2A1B2A1B2"})
    with pytest.raises(InputError, match=r"columns of different lengths: .*track_id 1"):
        open_trial(tmp_path / "log")


def test_version_4(tmp_path: Path) -> None:
    """Numbers and character matrices, recognised without a signature."""
    with (tmp_path / "log").open("wb") as file:
        scipy.io.savemat(file, {**NUMBERS, "track_id": COLUMNS["track_id"]}, format="4", oned_as="column")
    same(read(tmp_path / "log"))


def element(kind: int, data: bytes, order: str = "<") -> bytes:
    return struct.pack(f"{order}II", kind, len(data)) + data + bytes(-len(data) % 8)


def matrix(name: str, values: Any, order: str = "<", shape: tuple[int, int] | None = None) -> bytes:
    """One variable of version 5 by the words of its manual: flags, size, name, and a vector of doubles."""
    body = np.asarray(values, f"{order}f8").tobytes()
    size = struct.pack(f"{order}2i", *(shape or (len(values), 1)))
    head = element(6, struct.pack(f"{order}II", 6, 0), order) + element(5, size, order)
    return element(14, head + element(1, name.encode(), order) + element(9, body, order), order)


def mat5(*elements: bytes, order: str = "<", mark: bytes | None = None) -> bytes:
    mark = mark or (b"\0\1IM" if order == "<" else b"\1\0MI")
    return b"MATLAB 5.0 MAT-file, by hand".ljust(124) + mark + b"".join(elements)


def opaque(name: str, kind: str) -> bytes:
    """An object as MATLAB writes one: name, what keeps it, its class, and where it is kept."""
    texts = b"".join(element(1, text.encode()) for text in (name, "MCOS", kind))
    return element(14, element(6, struct.pack("<II", 17, 0)) + texts + matrix("", [3707764736.0, 2, 1]))


@pytest.mark.parametrize("order", ["<", ">"])
def test_either_byte_order(order: str, tmp_path: Path) -> None:
    """A file from a big-endian recorder is the same log."""
    data = mat5(*(matrix(name, values, order) for name, values in NUMBERS.items()), order=order)
    (tmp_path / "log").write_bytes(data)
    same(read(tmp_path / "log"), NUMBERS)


@both
def test_columns_of_a_matrix_are_named_by_their_place(save: Save, tmp_path: Path) -> None:
    """trial.toml gives `data(:,2)` a meaning and a unit; a matrix that it does not name is none of a log."""
    data = np.column_stack([COLUMNS["time_s"], COLUMNS["range_predicted_m"] / 1e3, COLUMNS["range_residual_m"]])
    save(tmp_path / "log", {"data": data, "other": np.ones((6, 2))})
    with pytest.raises(InputError, match=r"log: not recognised as a log: .*: data \(6x3\); other .* 'data\(:,1\)'"):
        open_trial(tmp_path / "log")
    columns = {"data(:,1)": "time_s", "data(:,2)": "range_predicted_km", "data(:,3)": "range_residual_m"}
    settings = settings_from({"logs": [{"file": "log", "columns": columns}]})
    table = read(tmp_path / "log", settings=settings)
    same(table, {name: COLUMNS[name] for name in ("time_s", "range_predicted_m", "range_residual_m")})
    settings = settings_from({"logs": [{"file": "log", "columns": {"data(:,4)": "time_s"}}]})
    with pytest.raises(SettingsError, match=r"log: has no column 'data\(:,4\)', which trial.toml names"):
        open_trial(tmp_path / "log", settings=settings)


@both
def test_rows_of_numbers_in_an_array_of_structs(save: Save, tmp_path: Path) -> None:
    """Positions of a target, a row of numbers in each element, are a matrix whose columns trial.toml names."""
    flat = [
        {"id": name, "t": np.array([[2.0 * i]]), "position": np.array([[1.0 * i, -1.0 * i]])}
        for i in range(3)
        for name in "AB"
    ]
    save(tmp_path / "log", {"truth": flat, "own": [{"speed": np.eye(2)}, {"speed": np.eye(2)}]})
    columns = {"t": "time_s", "id": "target_id", "position(:,1)": "north_km", "position(:,2)": "east_m"}
    settings = settings_from({"logs": [{"file": "log", "columns": columns}]})
    table = read(tmp_path / "log", settings=settings)
    assert table.floats("north_m").tolist() == [0, 0, 1000, 1000, 2000, 2000]
    assert table.floats("east_m").tolist() == [0, 0, -1, -1, -2, -2]
    assert table.texts("target_id") == ["A", "B"] * 3


def test_a_cell_array_of_structs(tmp_path: Path) -> None:
    """Structs, or arrays of them, in cells: all of the same fields."""
    scan = [{"time_s": np.array([[1.0]]), "range_m": np.array([[5.0]]), "azimuth_rad": np.array([[0.5]])}] * 2
    scans = np.empty((1, 3), object)
    scans[0, :] = [_for_scipy(scan), _for_scipy(scan[:1]), np.empty((0, 0))]
    save5(tmp_path / "log", {"scans": scans})
    assert read(tmp_path / "log").floats("range_m").tolist() == [5.0] * 3


@both
def test_snapshots_in_a_struct_and_other_complex_numbers(save: Save, tmp_path: Path) -> None:
    """Complex samples beside their times are snapshots; a complex matrix of the workspace is none."""
    said = {"sensor_position_m": np.array(POSITIONS), "frequency_hz": np.array([[6250.0]])}
    hull = {"time_ms": np.arange(40.0)[:, None] * 500, "x_re": PHASES.real, "x_im": PHASES.imag, **said}
    save(tmp_path / "log", {"hull": hull, "filter": np.ones((4, 4)) * 1j, "gain": np.array([[1j]])})
    trial = open_trial(tmp_path / "log")
    (log,) = trial.logs
    assert (log.source, log.kind) == ("log:hull", "snapshots")
    np.testing.assert_array_equal(log.read().wide("samples"), PHASES)
    assert log.array is not None
    assert log.array.sensor_position_m == tuple(map(tuple, POSITIONS))


# --- what is named ---------------------------------------------------------------------------------------------------


def test_what_only_matlab_can_read_is_named_with_what_to_save_instead(tmp_path: Path) -> None:
    """Tables, strings and times as objects, sparse matrices and functions: beside a log, and instead of one."""
    log = [matrix(name, values) for name, values in NUMBERS.items()]
    (tmp_path / "log").write_bytes(mat5(opaque("when", "datetime"), *log))
    trial = open_trial(tmp_path / "log")
    same(trial.logs[0].read(), NUMBERS)
    assert "when is a datetime object, which is not read; save posixtime(when)" in [p.reason for p in trial.problems]
    (tmp_path / "T").write_bytes(mat5(opaque("T", "table")))
    with pytest.raises(
        InputError, match=r"T \(table object, which is not read; save table2struct\(T, 'ToScalar', true"
    ):
        open_trial(tmp_path / "T")
    (tmp_path / "times").write_bytes(mat5(opaque("time_s", "datetime"), *log[1:]))
    with pytest.raises(
        InputError, match=r"needs the column time_s; the file has .*; time_s is a datetime object, .* posix"
    ):
        open_trial(tmp_path / "times")
    save5(tmp_path / "5", {"S": scipy.sparse.csc_array(np.eye(3)), **NUMBERS})
    assert open_trial(tmp_path / "5").problems[0].reason == "S is a sparse matrix, which is not read; save full(S)"
    save73(tmp_path / "7", {"s": np.arange(6.0), "S": {"ir": np.arange(3.0)}, "f": np.arange(2.0), **NUMBERS})
    with h5py.File(tmp_path / "7", "a") as file:
        file["s"].attrs.update({"MATLAB_class": np.bytes_("string"), "MATLAB_object_decode": np.int32(3)})
        file["S"].attrs.update({"MATLAB_class": np.bytes_("double"), "MATLAB_sparse": np.uint64(3)})
        file["f"].attrs["MATLAB_class"] = np.bytes_("function_handle")
    reasons = [p.reason for p in open_trial(tmp_path / "7").problems]
    assert "s is a string object, which is not read; save cellstr(s)" in reasons
    assert "S is a sparse matrix, which is not read; save full(S)" in reasons
    assert "columns that are neither numbers nor text, or of another length, are not read: S, f, s" in reasons


@both
def test_a_workspace_full_of_other_things(save: Save, tmp_path: Path) -> None:
    """Variables of other lengths are named in one line, those as long as the log one by one."""
    other = {
        "N": np.ones((6, 1)),
        "n": np.ones((6, 1)),
        "i": np.array([[3.0]]),
        "weights": np.arange(99.0)[:, None],
        "fs": np.array([[2e6]]),
        "wind_m_s": np.ones((6, 1)),
    }
    save(tmp_path / "log", {**{name: values[:, None] for name, values in NUMBERS.items()}, **other})
    trial = open_trial(tmp_path / "log")
    same(trial.logs[0].read(), NUMBERS)
    assert sorted(p.reason for p in trial.problems) == [
        "column 'wind_m_s' is not one of a residuals log and is not read",
        "columns that are neither numbers nor text, or of another length, are not read: N, fs, i, n, weights",
    ]


@both
def test_columns_of_different_lengths_are_one_line(save: Save, tmp_path: Path) -> None:
    """A vector that lost its last number is no column of the others."""
    save(tmp_path / "log", {"log": {**{n: v[:, None] for n, v in NUMBERS.items()}, "time_s": np.arange(5.0)[:, None]}})
    with pytest.raises(InputError, match=r"^log:log: columns of different lengths: .*time_s 5") as caught:
        open_trial(tmp_path / "log")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (mat5(mark=b"\0\1XX"), "header of 128 bytes does not end as MATLAB's do"),
        (b"MATLAB 5.0 MAT-file", "is cut off or damaged"),
        (mat5(matrix("time_s", np.arange(9.0)))[:200], "the MATLAB file is damaged or cut off"),
        (mat5(matrix("time_s", np.arange(9.0), ">")), "damaged"),
        (mat5(matrix("time_s", np.arange(9.0), shape=(2**31 - 1, 1))), "damaged"),
        (mat5(element(15, b"no zlib stream")), "damaged"),
        (mat5(element(15, zlib.compress(matrix("time_s", np.arange(9.0)))[:-6])), "damaged"),
        (b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n", "damaged or not HDF5"),
        (b"MATLAB 7.3 MAT-file", "damaged or not HDF5"),
        (mat5(), "none of its variables is a column of a log: there are none"),
    ],
    ids=range(10),
)  # fmt: skip
def test_damaged_files_are_one_line(data: bytes, says: str, tmp_path: Path) -> None:
    """A wrong byte order, sizes that cannot be, streams that end early: where and what."""
    (tmp_path / "log").write_bytes(data)
    with pytest.raises(InputError, match=says) as caught:
        open_trial(tmp_path / "log").logs[0].read()
    assert str(caught.value).startswith("log: ")
    assert str(caught.value).isprintable()


def test_a_bomb_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Zeros that unpack to more than the child may hold: one line, and the parent holds none of it."""
    packer = zlib.compressobj(1)
    blocks = 300
    size = blocks << 20
    head = element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<2i", size // 8, 1)) + element(1, b"time_s")
    parts = [packer.compress(struct.pack("<II", 14, len(head) + 8 + size) + head + struct.pack("<II", 9, size))]
    parts += [packer.compress(bytes(1 << 20)) for _ in range(blocks)]
    (tmp_path / "log").write_bytes(mat5(element(15, b"".join([*parts, packer.flush()]))))
    assert (tmp_path / "log").stat().st_size < 2 << 20
    monkeypatch.setattr(safe, "MEMORY_BYTES", 128 << 20)
    with pytest.raises(InputError, match="log: looking into the file takes more memory than is allowed"):
        open_trial(tmp_path / "log")


@both
def test_structs_without_end_are_refused(save: Save, tmp_path: Path) -> None:
    """Nested deeper than anyone means."""
    value: Any = {"time_s": np.arange(3.0)[:, None]}
    for _ in range(40):
        value = {"s": value}
    if save is save5:  # SciPy writes no more than 31 levels
        inner = matrix("", np.arange(3.0))
        for _ in range(40):
            fields = element(5, struct.pack("<i", 8)) + element(1, b"s".ljust(8, b"\0"))
            size = element(5, struct.pack("<2i", 1, 1)) + element(1, b"x")
            inner = element(14, element(6, struct.pack("<II", 2, 0)) + size + fields + inner)
        (tmp_path / "log").write_bytes(mat5(inner))
    else:
        save(tmp_path / "log", value)
    with pytest.raises(InputError, match=r"log: (structs and cells|groups) are nested deeper than 32"):
        open_trial(tmp_path / "log")


def test_references_lead_nowhere_but_into_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cells that hold themselves, empty references, too many of them, and cells whose values lie in another file."""

    def made(name: str) -> Path:
        write_matlab73(tmp_path / name)
        return tmp_path / name

    with h5py.File(made("a"), "a") as file:
        file["track_id"][0] = [file["track_id"].ref] * 6
    with pytest.raises(InputError, match=r"a: structs and cells are nested deeper than 32|a: it holds more than"):
        open_trial(tmp_path / "a")
    with h5py.File(made("b"), "a") as file:
        file["track_id"][0] = [h5py.Reference()] * 6
    assert "track_id" not in open_trial(tmp_path / "b").logs[0]
    (tmp_path / "secret").write_bytes(b"x" * 48)
    with h5py.File(made("c"), "a") as file:
        hidden = file["#refs#"].create_dataset("x", (6,), "f8", external=[(str(tmp_path / "secret"), 0, 48)])
        file["track_id"][0] = [hidden.ref] * 6
    with pytest.raises(InputError, match="c: '/track_id' keeps its values in another file; such files are not read"):
        open_trial(tmp_path / "c")
    with h5py.File(made("d"), "a") as file:
        file["range_m"] = h5py.ExternalLink(str(made("b")), "time_s")
    with pytest.raises(InputError, match="d: '/range_m' is a link to another file"):
        open_trial(tmp_path / "d")
    monkeypatch.setattr("rangeeval.parsers.matlab.hdf5_files.MAX_OBJECTS", 5)
    with pytest.raises(InputError, match="e: it holds more than 5 cells or structs; save each column as one vector"):
        open_trial(made("e"))


# --- how it is read --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("write", [write_matlab, write_matlab73])
def test_rows_come_in_pieces_and_the_child_ends_with_them(
    write: Callable[..., None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pieces of any size are the same rows; a reader who stops early leaves no process behind."""
    from rangeeval.parsers import blocks

    n = 1000
    columns = {
        "time_s": np.arange(n) / 8,
        "range_residual_m": np.sin(np.arange(n)),
        "range_predicted_m": np.full(n, 1e4),
    }
    columns["range_residual_m"][77] = np.inf
    write(tmp_path / "log", {**columns, "track_id": np.array([f"T{i // 99}" for i in range(n)])})
    whole = read(tmp_path / "log")
    for module in (blocks, matlab):
        monkeypatch.setattr(module, "CHUNK_ROWS", 64)
    log = open_trial(tmp_path / "log").logs[0]
    pieces = list(log.pieces(None))
    assert [len(p) for p in pieces] == [64] * 15 + [39]
    for name in columns:
        np.testing.assert_array_equal(np.concatenate([p.floats(name) for p in pieces]), whole.floats(name))
    assert [text for p in pieces for text in p.texts("track_id")] == whole.texts("track_id")
    assert [p.examples for piece in pieces for p in piece.problems] == [("log[77]: range_residual_m is infinite",)]
    reading = log.pieces(["time_s"])
    next(reading)
    reading.close()  # type: ignore[attr-defined]
    del reading
    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)


@pytest.mark.parametrize("write", [write_matlab, write_matlab73])
def test_a_fresh_interpreter_reads_the_same(
    write: Callable[..., None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the system cannot fork."""
    write(tmp_path / "log")
    monkeypatch.setattr(safe, "_forked", safe._spawned)
    same(read(tmp_path / "log"))


def test_a_file_that_changes_while_it_is_read_is_one_line(tmp_path: Path) -> None:
    """Cut off between the look and the reading."""
    write_matlab(tmp_path / "log")
    log = open_trial(tmp_path / "log").logs[0]
    data = (tmp_path / "log").read_bytes()
    (tmp_path / "log").write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=r"log: (the MATLAB file is damaged|the file changed)"):
        log.read()


def test_recognised_by_content() -> None:
    """Text, HDF5 with another user block, and zeros are no MATLAB files."""
    assert version(b"MATLAB results of today\n1,2\n") is None
    assert version(b"MATLAB results".ljust(512) + b"\x89HDF\r\n\x1a\n") == "7.3"
    assert version(bytes(4096)) is None
    assert version(b"Octave's own header".ljust(124) + b"\0\1IM") == "5"


def test_version_73_as_others_write_it(tmp_path: Path) -> None:
    """Vectors of one dimension and no word of MATLAB's classes."""
    with Matlab73(tmp_path / "log") as made:
        for name, values in COLUMNS.items():
            made.file[name] = values.astype("S") if name == "track_id" else values
        made.file["complex"] = PHASES
        made.file["waveform"] = ["LFM"] * 6
    table = read(tmp_path / "log")
    assert table.texts("waveform") == ["LFM"] * 6
    same(table, {**COLUMNS, "waveform": np.array(["LFM"] * 6)})


SCIPY = Path(scipy.io.matlab.__file__).parent / "tests" / "data"


@pytest.mark.skipif(not SCIPY.is_dir(), reason="SciPy was installed without its tests")
def test_files_that_matlab_wrote_give_one_line(tmp_path: Path) -> None:
    """SciPy's own collection, MATLAB 4.2 to 8 on three machines, holds no log: each is said in words, none crashes."""
    lines = {}
    for path in sorted(SCIPY.glob("*.mat")):
        with pytest.raises(InputError) as caught:
            open_trial(path)
        lines[path.name] = str(caught.value)
        assert lines[path.name].isprintable()
    assert "teststructarr (2 structs with one, two)" in lines["teststructarr_7.4_GLNX86.mat"]
    assert "teststringarray (text)" in lines["teststringarray_4.2c_SOL2.mat"]
    assert "testfunc (function handle)" in lines["testfunc_7.4_GLNX86.mat"]
    assert "testhdf5" in lines["testhdf5_7.4_GLNX86.mat"]


def test_a_trial_of_matlab_logs_goes_all_the_way(tmp_path: Path) -> None:
    """Residuals in a file of version 5 and gains in one of 7.3: inspected, archived, and reported."""
    folder = tmp_path / "trial"
    folder.mkdir()
    for log in open_trial(Path(__file__).parents[2] / "sample_logs" / "inbound").logs:
        table = log.read()
        columns: dict[str, Any] = {n: table.floats(n)[:, None] for n in log.columns if n not in table.labels}
        columns |= {n: cells(table.texts(n)) for n in table.labels}
        (save73 if log.kind == "gains" else save5)(folder / f"{log.kind}.mat", {log.kind: columns})
    trial = open_trial(folder)
    assert {f.kind: f.format for f in inspect_trial(trial)} == {
        "residuals": "matlab", "gains": "matlab-7.3", "truth": "matlab"
    }  # fmt: skip
    archive = flow.ingest(trial, tmp_path / "trial.h5")
    rows = [rangeeval.accuracy(t).to_json().split('"provenance"')[0] for t in (trial, open_trial(archive))]
    assert rows[0] == rows[1]
    rangeeval.report(trial, tmp_path / "out")
    assert b"residuals.mat" in (tmp_path / "out" / "report.html").read_bytes()
