"""`rangeeval attitude` and `simulate attitude` as a user meets them."""

import csv
import json
import shutil

import numpy as np
import pytest

from rangeeval.scenarios import simulate_attitude
from tests.test_cli import edit, one_line_error, rangeeval


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """A simulated trial with a gap in its tilt log."""
    folder = tmp_path_factory.mktemp("trials") / "rocking"
    simulate_attitude(folder, seed=2, gap=True)
    return folder


@pytest.fixture
def trial(original, tmp_path):
    """A copy to spoil."""
    return shutil.copytree(original, tmp_path / "trial")


def test_the_table_shows_motion_and_pointing(original):
    """Degrees, with intervals, by axis; errors by method and bin; the gap on standard error."""
    done = rangeeval("attitude", original)
    assert done.returncode == 0
    assert "Static tilt (°)" in done.stdout
    assert "Azimuth error by method" in done.stdout
    assert "1 gap" in done.stderr


def test_json_holds_the_contracts_quantities(original):
    """The names of the contract, with groups none, single and pair per bin."""
    found = json.loads(rangeeval("attitude", original, "--format", "json").stdout)
    rows = found["estimates"]
    whole = {r["quantity"] for r in rows if r["variable"] is None}
    for name in (
        "static",
        "dynamic_amplitude",
        "frequency",
        "single_error_peak",
        "pair_error_sigma",
        "noise_amplification",
    ):
        assert {f"{name}_x", f"{name}_z"} <= whole
    for name in ("azimuth_error_rms", "elevation_error_rms"):
        assert {r["group"] for r in rows if r["quantity"] == name} == {"none", "single", "pair"}


def test_corrected_plots_come_back_as_a_plots_log(original, tmp_path):
    """--correct brings plots closer to the truth tenfold, flags those in the gap, and the file reads as plots."""
    out = tmp_path / "corrected.csv"
    done = rangeeval("attitude", original, "--correct", "-o", out)
    assert done.returncode == 0, done.stderr
    rows = list(csv.DictReader(out.read_text().splitlines()))
    truth = list(csv.DictReader((original / "truth.csv").read_text().splitlines()))
    lost = [r for r in rows if r["flags"]]
    assert {r["flags"] for r in lost} == {"no-attitude"}
    assert all(r["elevation_rad"] == "" and 149 < float(r["time_s"]) < 163 for r in lost)
    assert f"{len(lost)} flagged" in done.stderr

    def error(column):
        away = []
        for r, t in zip(rows, truth, strict=True):
            if not r["flags"]:
                north, up, east = (float(t[f"{a}_m"]) for a in ("north", "up", "east"))
                away.append(float(r[column]) - np.arctan2(up, np.hypot(north, east)))
        return np.sqrt(np.mean(np.square(away)))

    assert error("elevation_rad") < 0.1 * error("measured_elevation_rad")
    assert "log      plots" in rangeeval("inspect", out).stdout


def test_a_report_has_the_chapter(original, tmp_path):
    """The report draws the motion and the pointing error, and can be made again from results.json alone."""
    assert rangeeval("report", original, "-o", tmp_path / "a").returncode == 0
    assert rangeeval("report", tmp_path / "a" / "results.json", "-o", tmp_path / "b").returncode == 0
    page = (tmp_path / "a" / "report.html").read_text(encoding="utf-8")
    assert page == (tmp_path / "b" / "report.html").read_text(encoding="utf-8")
    assert "Pointing error from attitude" in page
    assert "Error budget" in page


def test_equal_radii_are_one_line(trial):
    """Exit status 1, the value, and why."""
    edit(
        trial / "trial.toml",
        lambda lines: lines.insert(lines.index("radius_lower_m = 1"), "radius_m = { lower = 5.0 }"),
    )
    one_line_error(rangeeval("attitude", trial), "5 m", "different radii")


def test_readings_in_m_s2_under_a_name_in_g_are_one_line(trial):
    """Ten times g on the mean is no tilt, and the line says which unit to look at."""

    def change(lines):
        lines[0] = lines[0].replace("_m_s2", "_g")
        for i, line in enumerate(lines[1:], start=1):
            time, *values = line.split(",")
            lines[i] = ",".join([time, *(f"{float(v) + 9.0:.5f}" for v in values)])

    edit(trial / "tilt.csv", change)
    one_line_error(rangeeval("attitude", trial), "more than g", "_g")


def test_no_tilt_log_is_one_line(trial):
    """The line says what the trial holds."""
    (trial / "tilt.csv").unlink()
    one_line_error(rangeeval("attitude", trial), "no log of kind 'tilt'", "plots")


def test_options_of_another_scenario_are_wrong_usage(tmp_path):
    """Exit status 2 and the option's name."""
    done = rangeeval("simulate", "attitude", "-o", tmp_path, "--flights", "2")
    assert done.returncode == 2
    assert "No such option '--flights'" in done.stderr


def test_the_grid_of_figure_3_is_printed(tmp_path):
    """Twenty-five peak errors, the last 20.503 degrees."""
    done = rangeeval("simulate", "attitude", "-o", tmp_path, "--grid", "--seed", "1")
    assert done.stdout.splitlines()[-1].split() == ["1.0", "0.805", "3.221", "7.259", "12.969", "20.503"]
