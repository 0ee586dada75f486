"""Campaigns of random kills: nothing that was acknowledged may be lost, nothing may be torn, the guilty are named.

    python -m tests.campaigns archive --kills 200
    python -m tests.campaigns evaluate --trials 1000 --poison 10 --worker-kills 20 --driver-kills 5

Each prints what it counted and ends with status 1 when a promise was broken. The tests run both with small numbers, and
with these under `-m slow`.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

import rangeeval
from rangeeval import flow
from rangeeval.catalog import open_catalog
from rangeeval.many.indexing import content_hash, index
from rangeeval.parsers.archive import verify
from tests.crowd import DIES, KILLS, faulty_package, small_trial

ROOT = Path(__file__).parents[1]


# --- ingest and the catalogue -----------------------------------------------------------------------------------------


def archive_campaign(folder: Path, kills: int, seed: int = 1) -> dict[str, Any]:
    """Kill a writer of archives and of a catalogue `kills` times at random moments.

    The writer archives trials over older archives, then adds them to the catalogue, and acknowledges each step by
    appending its hash to a file. After every kill, each archive is whole and is the one before or the one after; at the
    end, all that was acknowledged is there, and one more run leaves no temporary file.
    """
    rng = random.Random(seed)
    trials = [rangeeval.open_trial(small_trial(folder / "trials" / f"t{i}", i)) for i in range(3)]
    archives, database, acknowledged = folder / "archives", folder / "catalog.sqlite", folder / "acknowledged"
    archives.mkdir()
    acknowledged.touch()
    plans = [flow.Plan(confidence=c) for c in (0.9, 0.95, 0.99)]
    for number, trial in enumerate(trials):  # the longest of some runs tells when to kill
        flow.ingest(trial, archives / f"{number}.h5", plans[0])
    started = time.perf_counter()
    _write_archives(trials, plans[:1], archives, database, acknowledged)
    length = time.perf_counter() - started
    left_behind = torn = lost = 0
    seen: set[str] = set()
    for _ in range(kills):
        child = os.fork()
        if child == 0:
            try:
                _write_archives(trials, plans, archives, database, acknowledged)
            finally:
                os._exit(0)
        time.sleep(rng.random() * length)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        left_behind += sum(1 for _ in archives.glob(".*.tmp"))
        for path in sorted(archives.glob("*.h5")):
            try:
                verify(path)
                seen.add(content_hash(path))
            except rangeeval.errors.RangeevalError:
                torn += 1
        with open_catalog(database) as catalog:
            catalog.check()
            known = {result.sha256: result.estimates for result in catalog.results()}
            for sha256, path in _acknowledged(acknowledged):
                # Replaced by a later content of the same file, or there with all its estimates.
                there = known.get(sha256)
                newer = any(result.path == path for result in catalog.results())
                lost += not (newer if there is None else there)
    _write_archives(trials, plans[:1], archives, database, acknowledged)
    with open_catalog(database) as catalog:
        index(catalog, [archives])
        indexed = {result.sha256 for result in catalog.results()}
    at_the_end = {content_hash(path) for path in archives.glob("*.h5")}
    return {
        "kills": kills,
        "temporary files that kills left": left_behind,
        "archives torn": torn,
        "acknowledged and lost": lost,
        "archives gone": len(trials) - len(list(archives.glob("*.h5"))),
        "not in the catalogue at the end": len(at_the_end - indexed),
        "temporary files at the end": sum(1 for _ in archives.glob(".*")),
        "versions seen": len(seen),
    }


def _write_archives(
    trials: list[Any], plans: list[flow.Plan], archives: Path, database: Path, acknowledged: Path
) -> None:
    for plan in plans:
        for number, trial in enumerate(trials):
            path = flow.ingest(trial, archives / f"{number}.h5", plan)
            with open_catalog(database, create=True) as catalog:
                added = index(catalog, [path])
            assert added[0].status != "failed", added
            with acknowledged.open("ab", buffering=0) as log:
                log.write(f"{content_hash(path)} {path.absolute()}\n".encode())


def _acknowledged(log: Path) -> list[tuple[str, str]]:
    whole = log.read_text(encoding="utf-8").rpartition("\n")[0]
    return [(line[:64], line[65:]) for line in whole.splitlines()]


# --- many trials ------------------------------------------------------------------------------------------------------


def evaluate_campaign(
    folder: Path, trials: int, poison: int, worker_kills: int, driver_kills: int, *, killers: int = 2, seed: int = 1,
    say: Callable[[str], None] = lambda line: None,
) -> dict[str, Any]:  # fmt: skip
    """Evaluate trials of which `poison` kill their process, `killers` of them their worker too, while workers and the
    driver are killed at random moments; each time the driver dies, the same command goes on.
    """
    rng = random.Random(seed)
    environment = faulty_package(folder / "package")
    bad = set(rng.sample(range(trials), poison))
    fatal = set(sorted(bad)[:killers])
    for i in range(trials):
        name = f"{KILLS}-{i}" if i in fatal else f"{DIES}-{i}" if i in bad else f"trial-{i}"
        small_trial(folder / "trials" / f"{i:05d}", i, name=name)
    out = folder / "results"
    moments = sorted(rng.uniform(0.05, 0.9) * (trials - poison) for _ in range(worker_kills))
    deaths = sorted(rng.uniform(0.1, 0.9) * (trials - poison) for _ in range(driver_kills))
    runs = killed = 0
    started = time.perf_counter()
    while True:
        runs += 1
        with (folder / "said").open("wb") as said_to, (folder / "errors").open("wb") as errors_to:
            driver = subprocess.Popen(
                [sys.executable, "-m", "rangeeval", "evaluate", str(folder / "trials"), "-o", str(out), "--jobs", "2",
                 "--format", "json"],
                stdout=said_to, stderr=errors_to, env=environment, cwd=folder,
            )  # fmt: skip
        while driver.poll() is None:
            time.sleep(0.05)
            done = sum(1 for _ in out.glob("*.json")) if out.is_dir() else 0
            if deaths and done >= deaths[0]:
                deaths.pop(0)
                driver.kill()
                driver.wait()
                say(f"driver killed at {done} results")
            elif moments and done >= moments[0] and (worker := _some_worker(driver.pid, rng)):
                moments.pop(0)
                killed += 1
                worker.kill()
                say(f"worker killed at {done} results")
        if driver.returncode != -signal.SIGKILL:
            break
    seconds = time.perf_counter() - started
    errors = (folder / "errors").read_text(encoding="utf-8", errors="replace")
    assert driver.returncode in {0, 1}, errors
    said = json.loads((folder / "said").read_text(encoding="utf-8") or pytest.fail(errors))["trials"]
    failed = {int(Path(one["trial"]).name): one["why"] for one in said if one["status"] == "failed"}
    results = {int(Path(one["trial"]).name): out / one["result"] for one in said if one["status"] == "done"}
    return {
        "trials": trials,
        "runs": runs,
        "workers killed": killed,
        "driver killed": driver_kills - len(deaths),
        "good trials lost": sum(i not in results or not results[i].is_file() for i in range(trials) if i not in bad),
        "poison named": len(bad & set(failed)),
        "others named": len(set(failed) - bad),
        "out of order": [int(Path(one["trial"]).name) for one in said] != list(range(trials)),
        "temporary files": sum(1 for _ in out.glob(".*")),
        "results that differ": _differing(folder, results, environment),
        "status": driver.returncode,
        "seconds": round(seconds, 1),
        "errors": errors[-2000:],
    }


def _some_worker(driver: int, rng: random.Random) -> psutil.Process | None:
    """One of the processes under the driver: a dask worker or the child that evaluates for it."""
    try:
        below = psutil.Process(driver).children(recursive=True)
        lines = [(process, " ".join(process.cmdline())) for process in below]
    except psutil.Error:
        return None
    workers = [p for p, line in lines if "spawn_main" in line or "many.child" in line]
    return rng.choice(workers) if workers else None


def _differing(folder: Path, results: dict[int, Path], environment: dict[str, str]) -> int:
    """How many of some results are not the bytes of a run by one process, undisturbed."""
    some = sorted(results)[:: max(1, len(results) // 10)]
    undisturbed = folder / "undisturbed"
    paths = [str(folder / "trials" / f"{i:05d}") for i in some]
    subprocess.run(
        [sys.executable, "-m", "rangeeval", "evaluate", *paths, "-o", str(undisturbed)],
        check=True, capture_output=True, env=environment, cwd=folder,
    )  # fmt: skip
    return sum((undisturbed / results[i].name).read_bytes() != results[i].read_bytes() for i in some)


def broken(found: dict[str, Any]) -> list[str]:
    """Which promises were not kept."""
    must_be_zero = (
        "archives torn", "acknowledged and lost", "archives gone", "not in the catalogue at the end",
        "temporary files at the end", "good trials lost", "others named", "out of order", "temporary files",
        "results that differ",
    )  # fmt: skip
    return [f"{name}: {found[name]}" for name in must_be_zero if found.get(name)]


def main() -> None:
    """Run a campaign and print what it counted."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign", choices=["archive", "evaluate"])
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--poison", type=int, default=10)
    parser.add_argument("--killers", type=int, default=2, help="of the poison, how many kill their worker too")
    parser.add_argument("--worker-kills", type=int, default=20)
    parser.add_argument("--driver-kills", type=int, default=5)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        if asked.campaign == "archive":
            found = archive_campaign(Path(scratch), asked.kills, asked.seed)
        else:
            found = evaluate_campaign(
                Path(scratch), asked.trials, asked.poison, asked.worker_kills, asked.driver_kills,
                killers=asked.killers, seed=asked.seed, say=lambda line: print(line, flush=True),
            )  # fmt: skip
    for name, value in found.items():
        print(f"{name:34s} {value}")
    if wrong := broken(found):
        sys.exit(f"broken: {'; '.join(wrong)}")


if __name__ == "__main__":
    main()
