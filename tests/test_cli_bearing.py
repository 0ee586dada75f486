"""`rangeeval bearing` as a user meets it, from the sample and from files spoilt in one place."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

import rangeeval as package
from rangeeval import flow
from rangeeval.cli import cli
from rangeeval.errors import RangeevalError
from rangeeval.reporting.sections import compose
from tests.pages import ROOT
from tests.test_cli import one_line_error, rangeeval
from tests.test_docs import _rows as documented

SAMPLE = ROOT / "sample_logs" / "bearing"


@pytest.fixture
def trial(tmp_path: Path) -> Path:
    """A copy of the sample to spoil."""
    return Path(shutil.copytree(SAMPLE, tmp_path / "trial"))


@pytest.fixture(scope="module")
def result() -> Any:
    """What bearing finds in the sample."""
    return package.bearing(package.open_trial(SAMPLE))


def run(*words: Any) -> Any:
    """The command in this process: its output, and what it raised."""
    return CliRunner().invoke(cli, ["bearing", *map(str, words)])


def test_the_command_prints_a_table() -> None:
    """Degrees with intervals, what became of the targets, bounds beside, and the guard; nothing to complain of."""
    done = rangeeval("bearing", SAMPLE)
    assert done.returncode == 0, done.stderr
    for words in ("Bearings against truth: every target held to the end", "T005", "Bound (°)", "Guard alarms"):
        assert words in done.stdout
    assert done.stderr == ""


def test_rows_are_the_contracts(result: Any) -> None:
    """bearing_rms for all, near and far, and each target, with intervals."""
    rows = [r for r in json.loads(result.to_json())["estimates"] if r["quantity"] == "bearing_rms"]
    assert [(r["group"], r["track_id"]) for r in rows][:4] == [
        (None, None), ("near", None), ("far", None), (None, "T001"),
    ]  # fmt: skip
    assert all(r["low"] < r["value"] < r["high"] for r in rows)


def test_tracks_and_bins_of_time(tmp_path: Path) -> None:
    """--tracks has every update; --bins time one bearing a bin and target."""
    assert run(SAMPLE, "--tracks", "-o", tmp_path / "tracks.csv").exit_code == 0
    rows = list(csv.DictReader((tmp_path / "tracks.csv").read_text().splitlines()))
    assert len(rows) == 500
    assert {r["target_id"] for r in rows} == {f"T00{n}" for n in range(1, 6)}
    done = run(SAMPLE, "--bins", "time", "--bin-width", 25, "-o", tmp_path / "bins.csv")
    assert done.exit_code == 0
    rows = list(csv.DictReader((tmp_path / "bins.csv").read_text().splitlines()))
    assert sum(r["quantity"] == "bearing" for r in rows) == 20
    assert run(SAMPLE, "--tracks", "--format", "json").exit_code == 2


@pytest.mark.parametrize("method", ["modified", "music"])
def test_options_reach_the_method(method: str, tmp_path: Path) -> None:
    """Targets by number; coasting and lag compensation; a block; a part of the time."""
    more = ["--coasting", "soft", "--lag-compensation"] if method == "modified" else ["--block", "20"]
    to = tmp_path / "found.json"
    done = run(SAMPLE, "--method", method, "--targets", "5", "--to", "60", "-o", to, *more)
    assert done.exit_code == 0, done.exception
    found = json.loads(to.read_text())
    assert (found["settings"]["method"], found["settings"]["last_time_s"]) == (method, 60.0)
    assert next(r for r in found["estimates"] if r["quantity"] == "bearing_rms")["value"] < np.deg2rad(0.6)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--targets", "none"], "expected a number from 1 on, or auto"),
        (["--targets", "15"], "15 targets need 16 sensors, and 15 gave a signal"),
        (["--method", "ryu"], "do not stand in a line"),
        (["--coasting", "hard"], "belong to the methods ryu and modified"),
        (["--from", "500"], "has 0 snapshots from 500 to inf s"),
    ],
)
def test_what_cannot_be_is_one_line(arguments: list[str], words: str) -> None:
    """Wrong usage or an impossible wish."""
    done = run(SAMPLE, *arguments)
    assert done.exit_code in (1, 2)
    assert words in done.output + str(done.exception)
    assert done.exit_code == 2 or isinstance(done.exception, RangeevalError)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("frequency_hz", None, "has no frequency_hz"),
        ("sensor_position_m", None, "has no sensor_position_m"),
        ("sensor_position_m", np.zeros((15, 2)), "all sensors stand at the same place"),
        ("sensor_position_m", np.zeros((4, 2)), "sensor_position_m has 4 rows"),
        ("time_s", np.arange(7.0), "columns of different lengths"),
        ("samples", np.full((1000, 15), np.nan, np.complex64), "0 of its 15 sensors gave a signal"),
    ],
)
def test_a_spoilt_file_is_one_line(trial: Path, name: str, value: Any, words: str) -> None:
    """A fact that is missing or cannot be, in the file itself."""
    with h5py.File(trial / "snapshots.h5", "a") as file:
        del file[name]
        if value is not None:
            file[name] = value
    done = run(trial)
    assert isinstance(done.exception, RangeevalError)
    assert words in str(done.exception)
    assert str(done.exception).startswith("trial/snapshots.h5: ")
    assert "\n" not in str(done.exception)


def test_a_spoilt_file_exits_with_one_line(trial: Path) -> None:
    """As a user meets it."""
    (trial / "snapshots.h5").write_bytes((SAMPLE / "snapshots.h5").read_bytes()[:9999])
    one_line_error(rangeeval("bearing", trial), "snapshots.h5", "truncated")


def test_the_report_has_the_chapter(result: Any) -> None:
    """Tracks, waterfall, spectra and the method; every flag that occurs is explained."""
    document = compose([result])
    titles = [section.title for section in document.sections]
    assert {"Bearings", "What the array heard", "How bearings were found"} <= set(titles)
    kinds = [
        mark.kind
        for section in document.sections
        for block in section.blocks
        for row in getattr(block, "panels", ())
        for panel in row
        for mark in panel.marks
    ]
    assert {"heat", "line", "band", "rule", "step"} <= set(kinds)


def test_an_archive_gives_the_same_bearings(result: Any, tmp_path: Path) -> None:
    """To the last bit, and the report is rebuilt from it."""
    archive = flow.ingest(package.open_trial(SAMPLE), tmp_path / "trial.h5")
    again = package.bearing(package.open_trial(archive))
    assert [r.as_row() for r in again.rows] == [r.as_row() for r in result.rows]


def test_no_target_makes_a_report_too(trial: Path) -> None:
    """Noise alone: no track, and the page says so."""
    rng = np.random.default_rng(2)
    with h5py.File(trial / "snapshots.h5", "a") as file:
        file["samples"][...] = rng.normal(size=(1000, 15)) + 1j * rng.normal(size=(1000, 15))
    (trial / "trial.toml").write_text("[trial]\nname = 'Noise'\n", encoding="utf-8")
    found = package.bearing(package.open_trial(trial))
    text = str(compose([found]))
    assert "No source stood out of the noise" in text


def test_quantities_are_documented(result: Any) -> None:
    """Every quantity of the sample stands in the reference with its unit; the rest needs bins or block methods."""
    given = {row.quantity: row.unit for row in result.rows}
    written = {row[0]: row[1] for row in documented("quantities.md", "bearing")}
    assert {q: u for q, u in written.items() if q not in {"bearing", "coherence"}} == given
