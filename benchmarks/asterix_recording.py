"""Reading an ASTERIX recording against taking every record apart with libasterix, and its memory.

`python benchmarks/asterix_recording.py [--records N]` writes a recording of N CAT048 plots of 54 bytes each (200,000 by default)
and prints records a second and the peak memory of reading. About half a minute.
"""

from __future__ import annotations

import argparse
import random
import resource
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from rangeeval.parsers import open_trial
from rangeeval.parsers.asterix import framing, tables
from tests.recordings import block, plot

LIBRARY_RECORDS = 10_000  # as many as libasterix takes apart in some seconds


def write(path: Path, records: int) -> None:
    """A recording of one radar: 200 aircraft, Mode S registers, amplitudes."""
    source = random.Random(1)
    with path.open("wb") as file:
        for i in range(records):
            file.write(block(48, plot(
                i * 0.004, source.uniform(5, 100), source.uniform(0, 360), address=0x3C0000 + i % 200, track=i % 200,
                code=0o1000, dbm=-60, _090=b"\0\x40", _240=bytes(6), _250=b"\x02" + source.randbytes(16),
                _200=bytes(4), _170=b"\x40",
            )))  # fmt: skip


def library_rate(path: Path) -> float:
    """Records a second through libasterix's own parse, block by block."""
    from asterix.base import Bits

    definition = next(iter(tables.editions(48).values()))
    with path.open("rb") as stream:
        blocks = [
            b for _, b in zip(range(LIBRARY_RECORDS), (b for _, b in framing.in_stream(stream, print)), strict=False)
        ]
    began = time.perf_counter()
    for one in blocks:
        assert len(definition.cv_uap.parse(Bits.from_bytes(one[3:]))) == 1
    return len(blocks) / (time.perf_counter() - began)


def peak_mib() -> float:
    """The most memory this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--records", type=int, default=200_000)
    records = parser.parse_args().records
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "radar.ast"
        write(path, records)
        tables.library()
        before = peak_mib()
        began = time.perf_counter()
        trial = open_trial(path)
        opened = time.perf_counter() - began
        began = time.perf_counter()
        rows = sum(len(piece) for piece in trial.log("plots").pieces(None))
        ours = rows / (time.perf_counter() - began)
        peak = peak_mib()
        theirs = library_rate(path)
    assert rows == records
    print(f"open (find blocks, sensors, editions)  {records / opened:10,.0f} records/s")
    print(f"read all columns                       {ours:10,.0f} records/s")
    print(f"libasterix, parse alone                {theirs:10,.0f} records/s   ({ours / theirs:.1f} times slower)")
    print(f"memory beyond the tables               {peak - before:10,.0f} MiB for {54 * records / 2**20:,.0f} MiB")


if __name__ == "__main__":
    main()
