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


# One small sample for every entry of FORMATS: a format without one fails its test.
SAMPLES: dict[str, Callable[[Path], None]] = {
    "hdf5": write_hdf5,
    "parquet": write_parquet,
    "npz": write_npz,
    "npy": write_npy,
    "text": write_text,
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
