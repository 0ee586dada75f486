"""Many workers: the same bytes in the same order; a cluster on loopback; what kills a worker is named."""

import contextlib
import filecmp
import re
import signal
import socket
import subprocess
import sys
import time

import pytest

from rangeeval.errors import MissingExtra
from rangeeval.many import cluster
from tests.campaigns import archive_campaign, broken, evaluate_campaign
from tests.crowd import small_trial
from tests.many.test_evaluate import ROOT, evaluate

pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def crowd(tmp_path_factory):
    """Five trials, and their results by one process."""
    folder = tmp_path_factory.mktemp("crowd")
    for i in range(5):
        small_trial(folder / "trials" / f"t{i}", i)
    done = evaluate(folder / "trials", "-o", folder / "one")
    assert done.returncode == 0, done.stderr
    return folder


def assert_same(one, other):
    """The same files with the same bytes."""
    compared = filecmp.dircmp(one, other)
    assert not compared.left_only
    assert not compared.right_only
    assert filecmp.cmpfiles(one, other, compared.common_files, shallow=False)[1:] == ([], [])
    assert len(compared.common_files) == 6


def assert_quiet(done):
    """It went well, and nothing stands on standard error but progress, of which a slow machine prints some."""
    assert done.returncode == 0, done.stderr
    assert re.sub(r"rangeeval: \d+ of 5 trials, 0 failed\n", "", done.stderr) == ""


def test_two_workers_give_the_bytes_of_one(crowd):
    """Every result, and the summary with its order. Nothing but our own lines on standard error."""
    done = evaluate(crowd / "trials", "-o", crowd / "two", "--jobs", 2)
    assert_quiet(done)
    assert_same(crowd / "one", crowd / "two")


@contextlib.contextmanager
def started(*arguments, until=None):
    """A dask process; with `until`, the first match of it in what it prints."""
    program = [sys.executable, "-m", "distributed.cli.dask_" + arguments[0], *arguments[1:]]
    process = subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT)
    try:
        found = None
        while until and not found:
            line = process.stdout.readline()
            assert line, "dask ended at once"
            found = re.search(until, line)
        yield process, found and found[0]
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.communicate(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()


def test_a_cluster_gives_the_bytes_of_one(crowd):
    """`dask scheduler`, then `dask worker ADDRESS`, on loopback."""
    quiet = ("--no-dashboard", "--host", "127.0.0.1")
    with started("scheduler", *quiet, "--port", "0", until=r"tcp://127[^\s]*\d") as (_, address):
        with started("worker", address, *quiet, "--nworkers", "1", "--nthreads", "2"):
            done = evaluate(crowd / "trials", "-o", crowd / "three", "--scheduler", address)
        assert_quiet(done)
        assert_same(crowd / "one", crowd / "three")


@pytest.mark.slow
def test_a_scheduler_that_goes_away_is_one_line(tmp_path):
    """In the middle of a run; results so far stay."""
    for i in range(40):
        small_trial(tmp_path / "trials" / f"t{i:02d}", i)
    out = tmp_path / "out"
    quiet = ("--no-dashboard", "--host", "127.0.0.1")
    command = [sys.executable, "-m", "rangeeval", "evaluate", tmp_path / "trials", "-o", out, "--scheduler"]
    with (
        started("scheduler", *quiet, "--port", "0", until=r"tcp://127[^\s]*\d") as (scheduler, address),
        started("worker", address, *quiet, "--nthreads", "1"),
        subprocess.Popen([*command, address], stderr=subprocess.PIPE, text=True, cwd=ROOT) as driver,
    ):
        deadline = time.monotonic() + 120
        while not (out.is_dir() and any(out.glob("t*.json"))):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        scheduler.kill()
        said = driver.communicate(timeout=60)[1]
    lines = [line for line in said.splitlines() if not re.fullmatch(r"rangeeval: \d+ of 40 trials, 0 failed", line)]
    assert driver.returncode == 1
    assert len(lines) == 1
    assert "the same command goes on from there" in lines[0]


def test_a_scheduler_that_is_not_there_is_one_line(crowd, tmp_path):
    """Nobody listens; or what was given is no address."""
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{held.getsockname()[1]}"
        for wrong in (address, "tpc://x:1"):
            code = (
                "import rangeeval.many.cluster as c, sys; c.WAIT_SECONDS = 1.0; from rangeeval.cli import main; "
                "sys.argv = ['rangeeval', *sys.argv[1:]]; main()"
            )
            done = subprocess.run(
                [sys.executable, "-c", code, "evaluate", crowd / "trials", "-o", tmp_path, "--scheduler", wrong],
                capture_output=True, text=True, cwd=ROOT, check=False,
            )  # fmt: skip
            assert done.returncode == 1
            assert done.stderr.startswith(f"rangeeval: no dask scheduler at {wrong}"), done.stderr
            assert done.stderr.count("\n") == 1


def test_without_the_extra_several_workers_say_which(monkeypatch):
    """And one worker needs none."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingExtra, match=r"rangeeval\[cluster\]"), cluster.local_client(2):
        pass


@pytest.mark.slow
def test_kills_lose_no_good_trial_and_name_the_guilty(tmp_path):
    """A trial that kills its process, a worker and the driver killed from outside."""
    found = evaluate_campaign(tmp_path, trials=8, poison=1, worker_kills=1, driver_kills=1, killers=0)
    assert broken(found) == [], found
    assert (found["poison named"], found["driver killed"], found["workers killed"]) == (1, 1, 1), found


@pytest.mark.slow
def test_a_trial_that_kills_its_worker_is_named_and_its_neighbours_are_done(tmp_path):
    """After it was tried again with nothing else running."""
    found = evaluate_campaign(tmp_path, trials=8, poison=2, worker_kills=0, driver_kills=0, killers=2)
    assert broken(found) == [], found
    assert found["poison named"] == 2, found


@pytest.mark.slow
def test_a_thousand_trials_with_poison_and_kills(tmp_path):
    """1,000 trials, 10 that kill their worker, 20 worker kills, 5 driver kills with resume: none lost, all 10 named."""
    found = evaluate_campaign(tmp_path, trials=1000, poison=10, worker_kills=20, driver_kills=5)
    assert broken(found) == [], found
    assert (found["poison named"], found["driver killed"], found["workers killed"]) == (10, 5, 20), found


@pytest.mark.parametrize("kills", [8, pytest.param(200, marks=pytest.mark.slow)])
def test_kills_tear_no_archive_and_lose_nothing_acknowledged(kills, tmp_path):
    """Random kills during ingest and the catalogue's update: whole files, a whole index, no temporary file left."""
    found = archive_campaign(tmp_path, kills)
    assert broken(found) == [], found
    assert found["kills"] == kills
    assert found["versions seen"] > 1 or kills < 20
