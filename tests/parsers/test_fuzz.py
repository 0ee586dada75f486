"""Mutated files of every format: never anything but a table or one clear line."""

from __future__ import annotations

import os
import random
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from rangeeval.errors import RangeevalError
from rangeeval.parsers import hdf5, open_trial
from tests import recordings
from tests.parsers.samples import COLUMNS, SAMPLES, SNAPSHOTS, cells, compressed, csv_text, write_hdf5, write_matlab
from tests.parsers.test_matlab import opaque, save5, save73

SECONDS = float(os.environ.get("RANGEEVAL_FUZZ_SECONDS", "12"))


def gz(path: Path) -> None:
    path.write_bytes(compressed(csv_text().encode(), "gz"))


def zst(path: Path) -> None:
    path.write_bytes(compressed(csv_text().encode(), "zst"))


def hdf5_gzip(path: Path) -> None:
    write_hdf5(path, compression="gzip", chunks=(2,), fletcher32=True)


def hdf5_lzf(path: Path) -> None:
    write_hdf5(path, compression="lzf", chunks=(4,), shuffle=True)


def matlab_nested(path: Path) -> None:
    """Structs, an array of structs, cells and an object, not compressed: all of SciPy's reader has its part."""
    one = {"time_s": np.array([[1.0]]), "alpha": np.array([[0.5]]), "beta": np.array([[0.1]]), "track_id": "A"}
    save5(
        path, {"run": {"gains": [one, one], "log": {**COLUMNS, "track_id": cells(COLUMNS["track_id"].tolist())}}}, False
    )
    path.write_bytes(path.read_bytes() + opaque("T", "table"))


def matlab_packed(path: Path) -> None:
    write_matlab(path, do_compression=True)


def matlab_4(path: Path) -> None:
    with path.open("wb") as file:
        scipy.io.savemat(file, COLUMNS, format="4", oned_as="column")


def matlab_73_nested(path: Path) -> None:
    one = {"time_s": np.array([[1.0]]), "alpha": np.array([[0.5]]), "beta": np.array([[0.1]]), "track_id": "A"}
    save73(path, {"run": {"gains": [one, one], "log": {**COLUMNS, "track_id": cells(COLUMNS["track_id"].tolist())}}})


def asterix(path: Path) -> None:
    """Records of every category that gives a log, several in a block, two sensors, service messages."""
    path.write_bytes(b"".join(recordings.one_of_each()))


def asterix_pcap(path: Path) -> None:
    frames = [recordings.ethernet(recordings.datagram(b), vlan=[5]) for b in recordings.one_of_each()]
    path.write_bytes(recordings.pcap(frames))


def asterix_pcapng(path: Path) -> None:
    frames = [recordings.ethernet(recordings.datagram6(b, hops=True)) for b in recordings.one_of_each()]
    path.write_bytes(recordings.pcapng(frames))


WRITERS: dict[str, Callable[[Path], None]] = {
    **SAMPLES,
    **{f"{name}-snapshots": write for name, write in SNAPSHOTS.items()},
    "matlab-nested": matlab_nested,
    "matlab-packed": matlab_packed,
    "matlab-4": matlab_4,
    "matlab-7.3-nested": matlab_73_nested,
    "asterix": asterix,
    "pcap": asterix_pcap,
    "pcapng": asterix_pcapng,
    "gz": gz,
    "zst": zst,
    "hdf5-gzip": hdf5_gzip,
    "hdf5-lzf": hdf5_lzf,
    # The audit without reading the values, as for logs too large for that.
    "hdf5-gzip-large": hdf5_gzip,
    "hdf5-large": write_hdf5,
}


def mutated(data: bytes, source: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(source.choice([1, 1, 2, 4, 16])):
        at = source.randrange(len(changed))
        match source.randrange(6):
            case 0:
                changed[at] ^= 1 << source.randrange(8)
            case 1:
                changed[at] = source.choice(b'\0\xff\x7f\x80,;"\n\r-.9eE ')
            case 2:
                del changed[at : at + source.choice([1, 2, 8, 64])]
            case 3:
                changed[at:at] = changed[at : at + source.choice([1, 4, 32])]
            case 4:
                changed[at : at + 8] = source.choice([b"\xff" * 8, b"\0" * 8, b"\x7f" + b"\xff" * 7])
            case 5:
                del changed[at:]
        if not changed:
            return b""
    return bytes(changed)


@pytest.mark.slow
@pytest.mark.parametrize("name", WRITERS)
def test_mutated_files_give_a_table_or_one_line(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever bytes are changed: no other exception, no hang, no crash, and every error is one line."""
    path = tmp_path / "log"
    WRITERS[name](path)
    if name.endswith("-large"):
        monkeypatch.setattr(hdf5, "READ_IN_CHILD", 0)
    data = path.read_bytes()
    source = random.Random(os.environ.get("RANGEEVAL_FUZZ_SEED", "") + name)
    deadline = time.monotonic() + SECONDS
    tried = errors = 0
    while time.monotonic() < deadline:
        bad = mutated(data, source)
        path.write_bytes(bad)
        tried += 1
        began = time.monotonic()
        try:
            for log in open_trial(path).logs:
                table = log.read()
                assert all("\n" not in example for p in table.problems for example in p.examples)
        except RangeevalError as error:
            errors += 1
            line = str(error)
        else:
            line = ""
        assert not line or line.isprintable()
        assert time.monotonic() - began < 30
    print(f"{name}: {tried} files, {errors} refused")
