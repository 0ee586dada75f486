"""Trends over indexed trials, in Python and on the command line."""

import csv
import json
import subprocess
import sys

import numpy as np
import pytest

from rangeeval import flow
from rangeeval.catalog import Entry, Terms, open_catalog
from rangeeval.catalog.trend import trend
from rangeeval.errors import InputError
from rangeeval.many.indexing import trend_of
from rangeeval.model import Estimate, Result
from tests.many.test_evaluate import ROOT

TRIALS = 20
STEP = 12  # the first trial with the new software: sigma half as large again
ODD = 5  # out of line


def entry(i, rng):
    """The results of a trial: sigma in two bins with intervals as wide as their samples make them."""
    rows = []
    for low in (0.0, 5000.0):
        n = int(rng.integers(200, 1000))
        truth = (
            3.0 * (1.5 if i >= STEP and low else 1.0) * (2.0 if i == ODD and low else 1.0) * np.exp(rng.normal(0, 0.03))
        )
        value = truth * np.sqrt(rng.chisquare(n) / n)
        half = 1.96 / np.sqrt(2 * n)
        rows.append(
            Estimate(quantity="range_sigma", unit="m", value=value, low=value * np.exp(-half), high=value * np.exp(half), n=n,
                     n_eff=float(n), variable="range", bin_low=low, bin_high=low + 5000)
        )  # fmt: skip
    rows.append(Estimate(quantity="range_sigma", unit="m", value=9.0, variable="range", bin_low=1e4, bin_high=1.5e4))
    about = {"name": f"=Pass {i}", "date": f"2026-{1 + i // 2:02d}-{1 + 14 * (i % 2):02d}", "radar": "MFR-1",
             "software": "2.4" if i >= STEP else "2.3", "handling": "RESTRICTED" if i == 3 else "UNCLASSIFIED"}  # fmt: skip
    inputs = [{"file": "r.csv", "kind": "residuals", "sha256": f"{i:064x}"}]
    provenance = {"trial": about, "settings": {"trial": about}, "inputs": inputs, "versions": {"rangeeval": "0.1.0"}}
    result = Result("accuracy", tuple(rows), {"confidence": 0.95}, provenance=provenance)
    return Entry(f"{i:064x}", f"/archives/{i}.h5", "archive", 1, (result,))


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A catalogue of 20 trials, added in no order of time."""
    path = tmp_path_factory.mktemp("trend") / "c.sqlite"
    rng = np.random.default_rng(3)
    entries = [entry(i, rng) for i in range(TRIALS)]
    with open_catalog(path, create=True) as catalog:
        for i in rng.permutation(TRIALS):
            catalog.add(entries[i])
    return path


def of_kind(result, kind, chart):
    """The rows of a kind in a chart."""
    return [row for row in result.rows if row.extra["kind"] == kind and row.extra["chart"] == chart]


def test_the_step_and_the_trial_out_of_line_are_found(file):
    """In the bin that has them; the other is steady. The size's interval holds the truth."""
    with open_catalog(file) as catalog:
        result = trend(catalog, Terms(quantity="range_sigma"))
    assert [row.extra["date"] for row in of_kind(result, "point", 1)] == sorted(
        row.extra["date"] for row in of_kind(result, "point", 1)
    )
    assert [row.extra["number"] for row in result.rows if row.extra.get("verdict") == "out"] == [ODD + 1]
    assert of_kind(result, "step", 1) == []
    (step,) = of_kind(result, "step", 2)
    assert (step.quantity, step.extra["first"], step.extra["software"]) == ("range_sigma_ratio", f"=Pass {STEP}", "2.4")
    assert step.low < 1.5 < step.high
    before, after = of_kind(result, "level", 2)
    assert before.low < 3.0 < before.high
    assert after.low < 4.5 < after.high
    assert 0.0 <= before.extra["between_sigma"] < 0.1
    assert "20 estimates have no interval" in str(result.problems[0])


def test_the_page_carries_every_handling_mark_and_is_the_same_again(file, tmp_path):
    """HTML, PDF and JSON; rebuilt from the JSON alone; names that try things stay text."""
    with open_catalog(file) as catalog:
        written = flow.write_report([trend_of(catalog, Terms(quantity="range_sigma"))], tmp_path / "a")
    again = flow.write_report(flow.read_results(written[2]), tmp_path / "b")
    assert [p.read_bytes() for p in written] == [p.read_bytes() for p in again]
    assert "RESTRICTED / UNCLASSIFIED" in written[0].read_text()


def test_a_trial_indexed_twice_counts_once(file, tmp_path):
    """The newest of its results; said."""
    with open_catalog(tmp_path / "c.sqlite", create=True) as catalog:
        rng = np.random.default_rng(3)
        for i in range(6):
            catalog.add(entry(i, rng))
        again = catalog.add(Entry("f" * 64, "/elsewhere", "results", 1, entry(2, rng).results))
        assert again.same == "/archives/2.h5"
        result = trend(catalog, Terms(bin=(0, 5000)))
    points = of_kind(result, "point", 1)
    assert len(points) == 6
    assert [row.extra["sha256"] for row in points].count("f" * 64) == 1
    assert any("indexed more than once" in p.reason for p in result.problems)


def test_few_trials_have_no_limits_and_nothing_is_said_to_be_steady(tmp_path):
    """Four: points without a verdict, flagged."""
    with open_catalog(tmp_path / "c.sqlite", create=True) as catalog:
        rng = np.random.default_rng(3)
        for i in range(4):
            catalog.add(entry(i, rng))
        result = trend(catalog)
        with pytest.raises(InputError, match="no estimate in it is what was asked for"):
            trend(catalog, Terms(quantity="rcs"))
    assert {row.extra["verdict"] for row in result.rows} == {None}
    assert all("few-trials" in row.flags for row in result.rows)


def rangeeval(*arguments, cwd=ROOT):
    """Run the command in a process of its own."""
    return subprocess.run([sys.executable, "-m", "rangeeval", "catalog", *map(str, arguments)], capture_output=True, text=True, cwd=cwd, check=False)  # fmt: skip


def test_the_commands(file, tmp_path):
    """Trend as a table; estimates as CSV, where a name is no formula, and as Parquet; one line where there is none."""
    done = rangeeval("trend", "--catalog", file, "--quantity", "range_sigma")
    assert done.returncode == 0, done.stderr
    assert "Trials out of line" in done.stdout
    assert "× 1." in done.stdout
    out = tmp_path / "rows.csv"
    assert rangeeval("show", "--catalog", file, "--bin", "5000:10000", "-o", out).returncode == 0
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert len(rows) == TRIALS
    assert rows[0]["trial"] == "'=Pass 0"
    assert float(rows[0]["value"]) > 0
    done = rangeeval("list", "--catalog", file, "--software", "2.4", "--format", "json")
    assert [one["name"] for one in json.loads(done.stdout)] == [f"=Pass {i}" for i in range(STEP, TRIALS)]
    for arguments, words in (
        (("list", "--catalog", tmp_path / "none"), "'rangeeval catalog add DIR' makes one"),
        (("list", "--catalog", file, "--bin", "5"), "expected LOW:HIGH"),
        (("trend", "--catalog", file, "--false-alarms", "2"), "less than 0.5"),
    ):
        done = rangeeval(*arguments)
        assert (done.returncode, done.stderr.count("\n")) == (1, 1), done.stderr
        assert words in done.stderr


def test_export_to_parquet_keeps_every_digit(file, tmp_path):
    """Numbers as numbers, missing ones as null."""
    parquet = pytest.importorskip("pyarrow.parquet")
    from rangeeval.reporting.export import write_parquet

    with open_catalog(file) as catalog:
        rows = [row.as_row() for row in catalog.estimates()]
    write_parquet(iter(rows), tmp_path / "rows.parquet")
    read = parquet.read_table(tmp_path / "rows.parquet").to_pylist()
    assert [row["value"] for row in read] == [row["value"] for row in rows]
    assert read[2]["low"] is None
    assert read[0]["n"] == rows[0]["n"]


@pytest.mark.slow
def test_false_alarms_of_a_page_are_counted():
    """Of 200 pages of six steady charts over 12 trials at most 5 % (and three standard errors) show any of each kind."""
    rng = np.random.default_rng(11)
    alarms = np.zeros(3)
    for _ in range(200):
        with open_catalog(":memory:", create=True) as catalog:
            for i in range(12):
                rows = []
                for low in range(6):
                    value = 3.0 * np.exp(rng.normal(0, 0.05) + rng.normal(0, 0.05))
                    half = 1.96 * 0.05
                    rows.append(Estimate(quantity="range_sigma", unit="m", value=value, low=value * np.exp(-half),
                                         high=value * np.exp(half), variable="range", bin_low=float(low), bin_high=low + 1.0))  # fmt: skip
                about = {"name": f"{i}", "date": f"2026-{i + 1:02d}-01"}
                provenance = {"trial": about, "settings": {}, "inputs": []}
                result = Result("accuracy", tuple(rows), {"confidence": 0.95}, provenance=provenance)
                catalog.add(Entry(f"{i:064x}", f"/{i}", "results", 1, (result,)))
            result = trend(catalog)
        alarms += [
            any(row.extra.get("verdict") == "out" for row in result.rows),
            any(row.extra.get("drifts") for row in result.rows),
            any(row.extra["kind"] == "step" for row in result.rows),
        ]
    assert (alarms / 200).max() <= 0.05 + 3 * (0.05 * 0.95 / 200) ** 0.5
