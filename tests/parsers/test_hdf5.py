"""HDF5: the shapes a log may have, and what a foreign file must never do."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from rangeeval.errors import InputError
from rangeeval.model import settings_from
from rangeeval.parsers import hdf5, open_trial, safe
from tests.parsers.samples import COLUMNS, read, same, structured, write_hdf5


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"compression": "gzip", "compression_opts": 1, "fletcher32": True},
        {"compression": "gzip", "shuffle": True},
        {"compression": "lzf"},
        {"chunks": (4,)},
    ],
)
def test_every_standard_storage_is_read(options: dict[str, Any], tmp_path: Path) -> None:
    """Contiguous, chunked, gzip, shuffle, fletcher32 and lzf give the same table."""
    write_hdf5(tmp_path / "log", **options)
    same(read(tmp_path / "log"))


@pytest.mark.parametrize("options", [{}, {"chunks": True, "compression": "gzip"}])
@pytest.mark.parametrize("across", [False, True])
def test_vectors_of_two_dimensions_are_columns(
    across: bool, options: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MATLAB's h5write stores a vector as one row or one column."""
    monkeypatch.setattr(hdf5, "CHUNK_ROWS", 4)
    columns = {name: values[None, :] if across else values[:, None] for name, values in COLUMNS.items()}
    write_hdf5(tmp_path / "log", columns, **options)
    same(read(tmp_path / "log"))


def test_chunks_that_a_filter_has_skipped_are_read(tmp_path: Path) -> None:
    """lzf leaves a chunk alone that it cannot make smaller; a file open elsewhere in the process is read too."""
    columns = {**COLUMNS, "snr_db": np.random.default_rng(1).normal(size=6)}
    write_hdf5(tmp_path / "log", columns, compression="lzf", shuffle=True, chunks=(4,))
    with h5py.File(tmp_path / "log"):
        same(read(tmp_path / "log"), columns)


def test_an_index_that_lies_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A chunk of no bytes makes HDF5 crash when it is read; the look into the file finds it, large or small."""
    write_hdf5(tmp_path / "log", compression="gzip", fletcher32=True, chunks=(3,))
    with h5py.File(tmp_path / "log") as file:
        chunk = file["time_s"].id.get_chunk_info(1)
    data = (tmp_path / "log").read_bytes()
    entry = chunk.size.to_bytes(4, "little") + bytes(4) + (3).to_bytes(8, "little")
    assert data.count(entry) >= 1
    (tmp_path / "log").write_bytes(data.replace(entry, bytes(8) + entry[8:]))
    for small in (1 << 20, 0):
        monkeypatch.setattr(hdf5, "READ_IN_CHILD", small)
        with pytest.raises(InputError, match=r"log: .* is damaged or cut off: its index does not fit the file"):
            open_trial(tmp_path / "log")


def test_other_shapes_of_a_log(tmp_path: Path) -> None:
    """Columns in groups, a compound dataset and a matrix with named columns; several logs in one file."""
    numbers = {n: v for n, v in COLUMNS.items() if v.dtype.kind == "f"}
    with h5py.File(tmp_path / "log", "w") as file:
        for name, values in COLUMNS.items():
            file[f"run/residuals/{name}"] = values.astype("S") if values.dtype.kind == "U" else values
        file["run/residuals"].attrs["residual_stage"] = "updated"
        file["gains"] = np.array([(1.0, 0.5, 0.1)], [("time_s", "f4"), ("alpha", "f8"), ("beta", "<f8")])
        file["table"] = structured()
        file["matrix"] = np.column_stack(list(numbers.values()))
        file["matrix"].attrs["columns"] = list(numbers)
        file["picture"] = np.zeros((3, 3))
    trial = open_trial(tmp_path / "log")
    assert {log.source: (log.kind, log.stage) for log in trial.logs} == {
        "log:/gains": ("gains", "predicted"),
        "log:/matrix": ("residuals", "predicted"),
        "log:/table": ("residuals", "predicted"),
        "log:/run/residuals": ("residuals", "updated"),
    }
    by_source = {log.source: log.read() for log in trial.logs}
    same(by_source["log:/run/residuals"])
    same(by_source["log:/table"])
    same(by_source["log:/matrix"], numbers)
    assert trial.sources[0].kind == "gains, residuals"
    with pytest.raises(InputError, match="holds 3 logs of kind 'residuals'"):
        trial.log("residuals")


@pytest.mark.parametrize("form", ["fixed", "wide", "vlen", "int", "uint8", "float", "big"])
def test_track_ids_of_any_type_are_the_same_labels(form: str, tmp_path: Path) -> None:
    """Fixed and variable text, whole numbers of any size: the label is the text of the id."""
    ids = [12, 7, 12, 300, 7, 12] if form != "uint8" else [12, 7, 12, 200, 7, 12]
    if form == "big":
        ids = [10**12 * i for i in ids]
    stored: dict[str, Any] = {
        "fixed": np.array([str(i) for i in ids], "S3"),
        "wide": np.array([str(i) for i in ids], "S40"),
        "vlen": [str(i) for i in ids],
        "int": np.array(ids),
        "uint8": np.array(ids).astype(np.uint8),
        "float": np.array(ids, float),
        "big": np.array(ids),
    }
    with h5py.File(tmp_path / "log", "w") as file:
        for name, values in COLUMNS.items():
            file[name] = stored[form] if name == "track_id" else values
    table = read(tmp_path / "log")
    assert table.texts("track_id") == [str(i) for i in ids]
    assert table.codes("track_id").tolist() == [0, 1, 0, 2, 1, 0]


@pytest.mark.parametrize("dtype", ["f4", ">f8", "i4", "u1", "?", "S8"])
def test_numbers_of_any_type(dtype: str, tmp_path: Path) -> None:
    """Any number type becomes float64; text that is a number too."""
    with h5py.File(tmp_path / "log", "w") as file:
        file["time_s"] = np.arange(2.0)
        file["range_residual_m"] = np.array([0, 1]).astype(dtype)
        file["range_predicted_m"] = np.full(2, 3e4)
    assert read(tmp_path / "log").floats("range_residual_m").tolist() == [0.0, 1.0]


def test_bad_rows_are_named_by_their_index(tmp_path: Path) -> None:
    """Infinite numbers and text in number columns are left out, with file and row."""
    with h5py.File(tmp_path / "log", "w") as file:
        file["time_s"] = np.arange(4.0)
        file["range_predicted_m"] = np.array([3e4, 3e4, 3e4, np.inf])
        file["range_residual_m"] = np.array([b"1", b"oops", b"", b"wrong"])
    table = read(tmp_path / "log")
    assert table.floats("time_s").tolist() == [0.0, 2.0]
    assert [(p.count, p.examples) for p in table.problems] == [
        (1, ("log[3]: range_predicted_m is infinite",)),
        (1, ("log[1]: range_residual_m is 'oops', not a number",)),
    ]


def test_columns_of_different_lengths_are_refused(tmp_path: Path) -> None:
    """Datasets that cannot be columns of one table: a line with each length."""
    write_hdf5(tmp_path / "log", {**COLUMNS, "time_s": np.arange(5.0)})
    with pytest.raises(InputError, match=r"columns of different lengths: .*time_s 5"):
        read(tmp_path / "log")


def crafted(name: str, file: Any, folder: Path) -> None:
    data = np.arange(6.0)
    if name == "external link":
        with h5py.File(folder / "other.h5", "w") as other:
            other["secret"] = data
        file["range_residual_m"] = h5py.ExternalLink(str(folder / "other.h5"), "secret")
    elif name == "external storage":
        (folder / "secret.txt").write_bytes(b"x" * 48)
        file.create_dataset("range_residual_m", (6,), "f8", external=[(str(folder / "secret.txt"), 0, 48)])
    elif name == "virtual":
        with h5py.File(folder / "other.h5", "w") as other:
            other["secret"] = data
        layout = h5py.VirtualLayout((6,), "f8")
        layout[:] = h5py.VirtualSource(str(folder / "other.h5"), "secret", (6,))
        file.create_virtual_dataset("range_residual_m", layout)
    elif name == "filter":
        space = h5py.h5s.create_simple((6,))
        plist = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plist.set_chunk((6,))
        plist.set_filter(32015, h5py.h5z.FLAG_OPTIONAL)
        h5py.h5d.create(file.id, b"range_residual_m", h5py.h5t.IEEE_F64LE, space, plist)
    elif name == "huge":
        file.create_dataset("range_residual_m", (10**13,), "f8", chunks=(10**6,))
    elif name == "huge chunk":
        file.create_dataset("range_residual_m", (10**8,), "f8", chunks=(10**8,))


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("external link", "is a link to another file"),
        ("external storage", "keeps its values in another file"),
        ("virtual", "is a virtual dataset, which reads other files"),
        ("filter", "is compressed with filter 32015; only gzip"),
        ("huge", "declares 10000000000000 rows and stores 0 bytes"),
        ("huge chunk", "is stored in chunks of 800000000 bytes"),
    ],
)
def test_what_could_read_other_files_or_run_code_is_refused(name: str, says: str, tmp_path: Path) -> None:
    """Links, external and virtual storage, foreign filters and absurd sizes: one line each, nothing read."""
    with h5py.File(tmp_path / "log", "w") as file:
        crafted(name, file, tmp_path)
        file["time_s"] = np.arange(6.0)
        file["range_predicted_m"] = np.arange(6.0)
    with pytest.raises(InputError, match=f"log: .*{says}"):
        open_trial(tmp_path / "log")


def test_loops_of_links_end(tmp_path: Path) -> None:
    """Soft links are not followed and hard-linked groups are seen once."""
    write_hdf5(tmp_path / "log")
    with h5py.File(tmp_path / "log", "a") as file:
        file["a"] = h5py.SoftLink("/b")
        file["b"] = h5py.SoftLink("/a")
        file.create_group("g")["up"] = file["/"]
    trial = open_trial(tmp_path / "log")
    assert [p.reason for p in trial.problems] == [
        "the soft link '/a' is not followed",
        "the soft link '/b' is not followed",
    ]
    same(trial.logs[0].read())


def test_references_are_not_columns(tmp_path: Path) -> None:
    """Object references are set aside, and said."""
    write_hdf5(tmp_path / "log")
    with h5py.File(tmp_path / "log", "a") as file:
        file.create_dataset("snr_db", (6,), dtype=h5py.ref_dtype)
    trial = open_trial(tmp_path / "log")
    assert "snr_db" not in trial.logs[0]
    assert "neither numbers nor text" in trial.problems[-1].reason


def test_flipped_bits_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A damaged chunk is an error that names the column, in a large log the rows; never other numbers."""
    write_hdf5(tmp_path / "log", compression="gzip", fletcher32=True)
    with h5py.File(tmp_path / "log") as file:
        at = file["range_residual_m"].id.get_chunk_info(0).byte_offset
    data = bytearray((tmp_path / "log").read_bytes())
    data[at + 8] ^= 1
    (tmp_path / "log").write_bytes(data)
    with pytest.raises(InputError, match=r"log: '/range_residual_m' cannot be read, the file is damaged"):
        read(tmp_path / "log")
    monkeypatch.setattr(hdf5, "READ_IN_CHILD", 0)
    with pytest.raises(InputError, match=r"log: rows 0 to 5 cannot be read, the file is damaged"):
        read(tmp_path / "log")


def test_the_stage_of_trial_toml_counts(tmp_path: Path) -> None:
    """An unknown residual_stage is refused; trial.toml may say 'updated'."""
    write_hdf5(tmp_path / "log")
    trial = open_trial(
        tmp_path / "log", settings=settings_from({"logs": [{"file": "log", "residual_stage": "updated"}]})
    )
    assert trial.logs[0].stage == "updated"
    with h5py.File(tmp_path / "log", "a") as file:
        file.attrs["residual_stage"] = "later"
    with pytest.raises(InputError, match="residual_stage is 'later'; known: predicted, updated"):
        open_trial(tmp_path / "log")


def loops(path: str) -> None:
    while True:
        pass


def crashes(path: str) -> None:
    import os

    os.abort()


def raises(path: str) -> None:
    raise ZeroDivisionError("of\nno use")


def eats(path: str) -> int:
    return len(bytearray(1 << 40))


@pytest.mark.parametrize("run", ["_forked", "_spawned"])
@pytest.mark.parametrize(
    ("function", "says"),
    [
        ("loops", "did not end within 3 s"),
        ("crashes", r"its reader crashed on it \(-6\)"),
        ("raises", r"the file is damaged \(ZeroDivisionError: of no use\)"),
        ("eats", "takes more memory than is allowed"),
    ],
)
def test_a_library_that_loops_or_crashes_is_one_line(
    run: str, function: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The look into a file happens in a child: its end, however it comes, is an error that names the file."""
    if run == "_spawned":
        monkeypatch.setattr(safe, "_forked", safe._spawned)
        monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
        pytest.importorskip("tests.parsers.test_hdf5")
    began = time.monotonic()
    seconds = 3.0 if function == "loops" else 20.0
    with pytest.raises(InputError, match=f"file.h5: .*{says}"):
        safe.call("tests.parsers.test_hdf5", function, "x", "file.h5", seconds=seconds)
    assert time.monotonic() - began < 20


def test_a_fresh_interpreter_gives_the_same_answer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the system cannot fork, the child is a fresh interpreter."""
    write_hdf5(tmp_path / "log")
    forked = safe.call(hdf5.__name__, "audit", str(tmp_path / "log"), "log")
    monkeypatch.setattr(safe, "_forked", safe._spawned)
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    assert safe.call(hdf5.__name__, "audit", str(tmp_path / "log"), "log") == forked
