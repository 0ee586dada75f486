"""Small logs of known content, written by each format's own library."""

from __future__ import annotations

import gzip
import io
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rangeeval.model import Table
from rangeeval.parsers import open_trial

COLUMNS: dict[str, Any] = {
    "time_s": np.arange(6) * 0.5 + 100.125,
    "track_id": np.array(["A1", "B2", "A1", "B2", "A1", "B2"]),
    "range_residual_m": np.array([1.5, -2.25, np.nan, 4.0, -5.125, 6.0625]),
    "y_residual_m": np.array([0.1, 0.2, 0.3, -0.4, 0.5, 1e-7]),
    "range_predicted_m": np.array([30e3, 40e3, 31e3, 41e3, 32e3, 42e3]),
    "y_predicted_m": np.array([1e3, 2e3, 1e3, 2e3, 1e3, 2e3]),
}


def csv_text(columns: Mapping[str, Any] = COLUMNS, delimiter: str = ",", decimal: str = ".", end: str = "\n") -> str:
    def cell(value: Any) -> str:
        if isinstance(value, str):
            return value
        return "" if np.isnan(value) else repr(float(value)).replace(".", decimal)

    rows = [delimiter.join(columns)]
    rows += [delimiter.join(cell(v) for v in row) for row in zip(*columns.values(), strict=True)]
    return end.join(rows) + end


def write_text(path: Path) -> None:
    path.write_text(csv_text(), encoding="utf-8")


def write_hdf5(path: Path, columns: Mapping[str, Any] = COLUMNS, **options: Any) -> None:
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            data = values.astype("S") if values.dtype.kind == "U" else values
            file.create_dataset(name, data=data, **options)


def write_parquet(path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table({n: pa.array(v.tolist()) for n, v in COLUMNS.items()}), path)


def write_npz(path: Path) -> None:
    with path.open("wb") as file:
        np.savez(file, **COLUMNS)


def structured() -> np.ndarray:
    dtype = [(n, "S4" if v.dtype.kind == "U" else "f8") for n, v in COLUMNS.items()]
    rows = np.empty(6, dtype)
    for name, values in COLUMNS.items():
        rows[name] = values
    return rows


def write_npy(path: Path) -> None:
    with path.open("wb") as file:
        np.save(file, structured())


def cells(items: Any) -> np.ndarray:
    """A column of MATLAB cells."""
    made = np.empty((len(items), 1), object)
    for i, item in enumerate(items):
        made[i, 0] = item
    return made


def write_matlab(path: Path, columns: Mapping[str, Any] = COLUMNS, **options: Any) -> None:
    import scipy.io

    kept = {n: cells(v.tolist()) if v.dtype.kind == "U" else v for n, v in columns.items()}
    with path.open("wb") as file:
        scipy.io.savemat(file, kept, oned_as="column", **options)


class Matlab73:
    """A MATLAB 7.3 file by hand: columns are rows, text is UTF-16, cells and arrays of structs are references."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.file = h5py.File(path, "w", userblock_size=512)
        self.count = 0

    def __enter__(self) -> Matlab73:
        return self

    def __exit__(self, *_: object) -> None:
        self.file.close()
        with self.path.open("r+b") as stream:
            stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .".ljust(124) + b"\0\2IM")

    def put(self, group: Any, name: str, value: Any, kind: str = "", **options: Any) -> Any:
        """A struct (dict), an array of structs (list of dicts), cells (object array), text, or numbers."""
        if isinstance(value, dict):
            item = group.create_group(name)
            for inner, held in value.items():
                self.put(item, inner, held, **options)
            kind = "struct"
        elif isinstance(value, list):
            item = group.create_group(name)
            for inner in value[0]:
                item[inner] = self.references(cells([one[inner] for one in value]).T)
            kind = "struct"
        elif isinstance(value, str):
            item = group.create_dataset(name, data=np.frombuffer(value.encode("utf-16-le"), "u2")[:, None])
            item.attrs["MATLAB_int_decode"] = np.int32(2)
            kind = "char"
        elif value.dtype == object:
            item = group.create_dataset(name, data=self.references(value.T))
            kind = "cell"
        else:
            value = value[:, None] if value.ndim == 1 else value
            if value.dtype.kind == "c":
                pairs = np.empty(value.shape, [("real", "f8"), ("imag", "f8")])
                pairs["real"], pairs["imag"] = value.real, value.imag
                value = pairs
            item = group.create_dataset(name, data=value.T, **options)
            kind = kind or "double"
        item.attrs["MATLAB_class"] = np.bytes_(kind)
        return item

    def references(self, items: np.ndarray) -> np.ndarray:
        drawer = self.file.require_group("#refs#")
        made = np.empty(items.shape, h5py.ref_dtype)
        for place, item in np.ndenumerate(items):
            self.count += 1
            made[place] = self.put(drawer, f"r{self.count}", item).ref
        return made


def write_matlab73(path: Path, columns: Mapping[str, Any] = COLUMNS, **options: Any) -> None:
    with Matlab73(path) as made:
        for name, values in columns.items():
            made.put(made.file, name, cells(values.tolist()) if values.dtype.kind == "U" else values, **options)


# One small sample of a table for every entry of FORMATS that holds tables: a format without one fails its test.
SAMPLES: dict[str, Callable[[Path], None]] = {
    "hdf5": write_hdf5,
    "matlab": write_matlab,
    "matlab-7.3": write_matlab73,
    "parquet": write_parquet,
    "npz": write_npz,
    "npy": write_npy,
    "text": write_text,
}

# Samples of an array: 40 snapshots of three sensors, complex.
PHASES = np.exp(1j * np.arange(120).reshape(40, 3) ** 1.3)
POSITIONS = [[0.0, 0.0], [0.0, 0.12], [0.5, 0.25]]


def write_hdf5_samples(path: Path, samples: Any = PHASES, **facts: Any) -> None:
    said = {"sensor_position_m": POSITIONS, "frequency_hz": 6250.0, "propagation_speed_m_s": 1500.0} | facts
    with h5py.File(path, "w") as file:
        file["time_s"] = np.arange(len(samples)) * 0.5
        file["samples"] = samples
        for name, value in said.items():
            if value is not None:
                file[name] = value


def write_npz_samples(path: Path) -> None:
    with path.open("wb") as file:
        np.savez(file, time_ms=np.arange(40) * 500.0, snapshots=PHASES, sensor_position_m=POSITIONS,
                 frequency_khz=6.25, propagation_speed_m_s=1500.0)  # fmt: skip


def write_matlab_samples(path: Path) -> None:
    import scipy.io

    said = {"sensor_position_m": POSITIONS, "frequency_khz": 6.25, "propagation_speed_m_s": 1500.0}
    with path.open("wb") as file:
        scipy.io.savemat(file, {"time_s": np.arange(40) * 0.5, "samples": PHASES, **said})


def write_matlab73_samples(path: Path) -> None:
    said = {"sensor_position_m": POSITIONS, "frequency_khz": [[6.25]], "propagation_speed_m_s": [[1500.0]]}
    with Matlab73(path) as made:
        for name, values in ({"time_s": np.arange(40) * 0.5, "samples": PHASES} | said).items():
            made.put(made.file, name, np.array(values))


def sac_bytes(values: Any, station: str, order: str = "<", **header: Any) -> bytes:
    """A SAC file by the words of its manual: floats 0 to 69, integers to 109, then 192 bytes of text."""
    words = {"delta": 0.5, "b": 0.0, "stla": 36.5, "stlo": -112.25, "stel": 1400.0} | header
    floats, whole = np.full(70, -12345.0, f"{order}f4"), np.full(40, -12345, f"{order}i4")
    for place, name in ((0, "delta"), (5, "b"), (31, "stla"), (32, "stlo"), (33, "stel")):
        floats[place] = words[name]
    whole[:6] = header.get("start", (2026, 132, 6, 30, 15, 250))
    whole[[6, 9, 15, 35]] = 6, len(values), header.get("iftype", 1), header.get("leven", 1)
    text = station.ljust(8).encode() + b"-12345  " * 23
    return floats.tobytes() + whole.tobytes() + text + np.asarray(values, f"{order}f4").tobytes()


def write_sac(path: Path) -> None:
    path.write_bytes(sac_bytes(np.arange(400.0) ** 1.1, "AB1"))


SNAPSHOTS: dict[str, Callable[[Path], None]] = {
    "hdf5": write_hdf5_samples,
    "matlab": write_matlab_samples,
    "matlab-7.3": write_matlab73_samples,
    "npz": write_npz_samples,
    "sac": write_sac,
}


def compressed(data: bytes, how: str) -> bytes:
    if how == "gz":
        return gzip.compress(data)
    try:
        from compression import zstd
    except ImportError:
        from backports import zstd
    return bytes(zstd.compress(data))


def read(path: Path, **settings: Any) -> Table:
    """The only log of a file, whole."""
    return open_trial(path, **settings).logs[0].read()


def text_log(folder: Path, text: str | bytes, name: str = "residuals.csv") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8"))
    return path


def same(table: Table, columns: Mapping[str, Any] = COLUMNS) -> None:
    """The table holds exactly these columns and values."""
    assert set(table.columns) == set(columns)
    for name, values in columns.items():
        if values.dtype.kind == "U":
            assert table.texts(name) == values.tolist()
        else:
            np.testing.assert_array_equal(table.floats(name), values)


def npz_bytes(**arrays: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()
