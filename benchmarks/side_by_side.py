"""Scripts measured side by side: each in a fresh process on the same file, best of several, in one run."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

# Merely reading every column of an HDF5 log, piece by piece: what no analysis can undercut.
READ = """
import sys, h5py, numpy as np
with h5py.File(sys.argv[1]) as f:
    n = len(f["time_s"])
    buffers = {name: np.empty(262_144, f[name].dtype) for name in f}
    for start in range(0, n, 262_144):
        stop = min(start + 262_144, n)
        for name, buffer in buffers.items():
            f[name].read_direct(buffer, np.s_[start:stop], np.s_[: stop - start])
print(n)
"""


def run(code: str, path: Path, threads: int | None = None) -> tuple[float, float, bytes]:
    """Seconds, peak MiB and output of a fresh Python process."""
    environment = dict(os.environ)
    if threads is not None:
        environment["RANGEEVAL_THREADS"] = str(threads)
    peak = "str(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    wrapped = code + f"\nimport resource; sys.stderr.write(' ' + {peak})"
    started = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", wrapped, str(path)], capture_output=True, check=True, env=environment)
    return time.perf_counter() - started, int(done.stderr.split()[-1]) / 1024, done.stdout


def digest(output: bytes) -> str:
    """What tells one output from another."""
    return hashlib.sha256(output).hexdigest()


@dataclass(frozen=True)
class Measured:
    """The best seconds and peak MiB of each job, and the digests of what ours printed."""

    best: Mapping[str, tuple[float, float]]
    digests: frozenset[str]

    def as_json(self) -> dict[str, dict[str, float]]:
        """For the line a script can read."""
        return {name: {"seconds": s, "peak_mib": m} for name, (s, m) in self.best.items()}


def measure(jobs: Mapping[str, str], ours: str, path: Path, repeats: int) -> Measured:
    """Run every job `repeats` times in turn and print seconds, ratios and peak memory; `ours` names our own job."""
    run(jobs[ours], path)  # compiles the kernels once and warms the page cache
    best: dict[str, tuple[float, float]] = {}
    digests = set()
    for _ in range(repeats):
        for name, code in jobs.items():
            seconds, memory, output = run(code, path)
            best[name] = min(best.get(name, (float("inf"), 0.0)), (seconds, memory))
            if name == ours:
                digests.add(digest(output))
    for name, (seconds, memory) in best.items():
        print(f"{name:26s} {seconds:7.2f} s  {seconds / best[ours][0]:5.2f} x ours  peak {memory:6.0f} MiB")
    return Measured(best, frozenset(digests))


def same_bits(digests: frozenset[str] | set[str]) -> str:
    """Whether all runs printed the same."""
    return "the same bits" if len(digests) == 1 else f"{len(digests)} DIFFERENT results"
