"""What handing many trials to workers costs on top of the work, and whether the driver's memory grows with their number.

One run measures, on the same archived trials: one process (`--jobs 1`), two local workers (`--jobs 2`), and a dask cluster of
two workers that is there already (`--scheduler`). The work is the sum of the seconds that the trials took; the overhead is
what the workers spent otherwise, from the first result to the last, so that the start of Python, once a run, is not in it.
It prints seconds, overhead per trial, the driver's peak memory for a quarter of the trials and for all, and whether all runs
gave the same bytes.

    python benchmarks/many.py                                     # 60 trials of 20,000 updates
    python benchmarks/many.py --trials 1000 --updates 100000      # the full size: 100 million updates
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from rangeeval.archives import write_archive
from rangeeval.model import Trial, log_of, settings_from

DRIVER = """
import json, resource, sys, time
from rangeeval.many import evaluate_many

if __name__ == "__main__":
    folder, out, how = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
    moments, work = [], []

    def report(outcome, count, total):
        moments.append(time.perf_counter())
        work.append(outcome.seconds)

    started = time.perf_counter()
    summary = evaluate_many([folder], out, report=report, **how)
    assert not summary.failed, summary.failed[0]
    print(json.dumps({
        "seconds": time.perf_counter() - started, "between": moments[-1] - moments[0], "work": work,
        "peak_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, "trials": len(work),
    }))
"""


def make(folder: Path, trials: int, updates: int) -> None:
    """Archives of trials that differ in every number: a target flies in and out between 100 and 10 km."""
    folder.mkdir()
    settings = settings_from({"trial": {"radar": "MFR-1"}})
    for i in range(trials):
        rng = np.random.default_rng(i)
        row = np.arange(updates)
        distance = 10_000.0 + np.abs(90_000.0 - (row * 62.5 + 900.0 * i) % 180_000.0)
        log = log_of("residuals", {
            "time_s": row * 0.5,
            "range_residual_m": np.round(rng.standard_normal(updates) * (2 + distance * 1e-4), 2),
            "y_residual_m": np.round(rng.standard_normal(updates) * distance * 3e-4, 2),
            "z_residual_m": np.round(rng.standard_normal(updates) * distance * 3e-4, 2),
            "range_predicted_m": np.round(distance, 1),
            "y_predicted_m": np.full(updates, 2000.0),
            "z_predicted_m": np.round(distance * 0.1, 1),
            "alpha": np.full(updates, 0.4),
            "beta": np.full(updates, 0.1),
        })  # fmt: skip
        named = replace(settings, trial=replace(settings.trial, name=f"Trial {i}"))
        write_archive(Trial(f"trial-{i}", (log,), named), [], {}, folder / f"{i:05d}.h5")


def drive(folder: Path, out: Path, how: dict[str, object]) -> dict[str, object]:
    """Evaluate a folder in a fresh process."""
    with tempfile.NamedTemporaryFile("w", suffix=".py") as script:
        script.write(DRIVER)
        script.flush()
        done = subprocess.run(
            [sys.executable, script.name, folder, out, json.dumps(how)], capture_output=True, text=True, check=False
        )
    if done.returncode:
        sys.exit(done.stderr)
    found: dict[str, object] = json.loads(done.stdout)
    return found


@contextlib.contextmanager
def cluster(workers: int) -> Iterator[str]:
    """A scheduler and workers on loopback; gives the scheduler's address."""
    quiet = ["--no-dashboard", "--host", "127.0.0.1"]
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", *quiet, "--port", "0"]
    scheduler = subprocess.Popen(dask, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    processes = [scheduler]
    try:
        assert scheduler.stderr is not None
        address = next(m[0] for m in (re.search(r"tcp://127\S*\d", line) for line in scheduler.stderr) if m)
        command = [sys.executable, "-m", "distributed.cli.dask_worker", address, *quiet, "--nthreads", "1"]
        nowhere = subprocess.DEVNULL
        processes += [subprocess.Popen(command, stderr=nowhere, stdout=nowhere, text=True) for _ in range(workers)]
        time.sleep(5)  # all of them are there before the clock starts
        yield address
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait()


def digest(folder: Path) -> str:
    """What tells one set of results from another."""
    total = hashlib.sha256()
    for path in sorted(folder.iterdir()):
        total.update(path.name.encode() + path.read_bytes())
    return total.hexdigest()


def main() -> None:
    """Make the trials, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=60)
    parser.add_argument("--updates", type=int, default=20_000)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        root = Path(scratch)
        make(root / "all", options.trials, options.updates)
        (root / "quarter").mkdir()
        for path in sorted((root / "all").iterdir())[: options.trials // 4]:
            (root / "quarter" / path.name).hardlink_to(path)
        size = sum(path.stat().st_size for path in (root / "all").iterdir())
        print(f"{options.trials:,} trials of {options.updates:,} updates, {size / 2**20:.0f} MiB")
        drive(root / "quarter", root / "warm", {})  # compiles the kernels once and warms the page cache
        small = drive(root / "quarter", root / "out-quarter", {"jobs": 2})
        runs = {"1 process": ({"jobs": 1}, 1), "2 local workers": ({"jobs": 2}, 2)}
        found = {name: (drive(root / "all", root / name, how), workers) for name, (how, workers) in runs.items()}
        with cluster(2) as address:
            found["cluster of 2"] = drive(root / "all", root / "cluster of 2", {"scheduler": address}), 2
        for name, (run, workers) in found.items():
            # The first trial of each worker compiles and loads; the clock runs from the first result on.
            work = sum(sorted(run["work"])[:-workers])  # type: ignore[call-overload]
            spent = workers * float(run["between"])  # type: ignore[arg-type]
            overhead = (spent - work) / (options.trials - workers)
            print(
                f"{name:16s} {run['seconds']:7.1f} s  work {work:7.1f} s  overhead {1e3 * overhead:6.1f} ms a trial, "
                f"{100 * (spent - work) / work:5.1f} % of the work; driver's peak {run['peak_mib']:.0f} MiB"
            )
        peak = float(found["2 local workers"][0]["peak_mib"])  # type: ignore[arg-type]
        print(
            f"driver with 2 workers: {small['peak_mib']:.0f} MiB for {small['trials']} trials, {peak:.0f} MiB for all"
        )
        same = len({digest(root / name) for name in found}) == 1
        print("the same bytes" if same else "DIFFERENT results")


if __name__ == "__main__":
    main()
