"""The command line as a user meets it: what it prints, its exit status, and one clear line for every bad input."""

import csv
import io
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from rangeeval.scenarios import simulate_alpha_beta


def rangeeval(*arguments, **environment):
    """Run the command in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "rangeeval", *map(str, arguments)],
        capture_output=True, text=True, encoding="utf-8", env={**os.environ, **environment}, cwd=Path(__file__).parents[1],
    )  # fmt: skip


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """A small simulated trial."""
    folder = tmp_path_factory.mktemp("trials") / "pass"
    simulate_alpha_beta(folder, seed=2, flights=1, no_truth=True)
    return folder


@pytest.fixture
def trial(original, tmp_path):
    """A copy to spoil."""
    return shutil.copytree(original, tmp_path / "trial")


def edit(path, change):
    """Change the lines of a file."""
    lines = path.read_text().splitlines()
    change(lines)
    path.write_text("\n".join(lines) + "\n")


def field(lines, line, column, text):
    """Set one field (line as an editor numbers it)."""
    fields = lines[line - 1].split(",")
    fields[lines[0].split(",").index(column)] = text
    lines[line - 1] = ",".join(fields)


def one_line_error(done, *words):
    """The command failed with exit status 1 and one line holding these words; no traceback."""
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.count("\n") == 1, done.stderr
    for word in words:
        assert word in done.stderr


def test_help_is_quick_because_it_imports_nothing_heavy():
    """`rangeeval --help` leaves numpy, pandas, scipy and numba out."""
    code = "import sys, rangeeval.cli; print([m for m in ('numpy','pandas','scipy','numba','matplotlib') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_json_is_the_contracts_object(original):
    """Schema, settings, estimates with all columns, problems, provenance with the SHA-256 of every input."""
    done = rangeeval("accuracy", original, "--format", "json")
    assert done.returncode == 0, done.stderr
    data = json.loads(done.stdout)
    assert data["schema"] == 1
    assert data["analysis"] == "accuracy"
    assert data["settings"]["confidence"] == 0.95
    assert {"range_sigma", "elevation_sigma", "azimuth_sigma"} <= {r["quantity"] for r in data["estimates"]}
    assert all(len(i["sha256"]) == 64 for i in data["provenance"]["inputs"])


def test_csv_holds_the_same_rows(original, tmp_path):
    """CSV and JSON agree in every value; -o writes the file and nothing to standard output."""
    data = json.loads(rangeeval("accuracy", original, "--format", "json").stdout)
    done = rangeeval("accuracy", original, "-o", tmp_path / "out.csv")
    assert done.stdout == ""
    rows = list(csv.DictReader(io.StringIO((tmp_path / "out.csv").read_text())))
    assert len(rows) == len(data["estimates"])
    for row, estimate in zip(rows, data["estimates"], strict=True):
        assert row["quantity"] == estimate["quantity"]
        assert (float(row["value"]) if row["value"] else None) == estimate["value"]


def test_the_table_shows_units_people_use(original):
    """Kilometres, metres and arc minutes, and what residuals cannot show."""
    done = rangeeval("accuracy", original)
    assert "Elevation σ (arcmin)" in done.stdout
    assert "50 to 55 km" in done.stdout
    assert "constant bias leaves no trace" in done.stdout


@pytest.mark.parametrize(("limit", "status"), [(100.0, 0), (1e-6, 3)])
def test_check_exits_with_3_when_a_requirement_fails(trial, limit, status):
    """Pass and inconclusive are 0, fail is 3."""
    text = (trial / "trial.toml").read_text()
    head = text[: text.index("[[requirements]]")]
    (trial / "trial.toml").write_text(f'{head}[[requirements]]\nquantity = "range_sigma"\nlimit = {limit}\n')
    done = rangeeval("check", trial, "--format", "json")
    assert done.returncode == status, done.stderr
    assert {r["verdict"] for r in json.loads(done.stdout)["estimates"]} == {"pass" if status == 0 else "fail"}


def test_inspect_says_what_was_recognised(original):
    """Kind, rows, columns."""
    found = json.loads(rangeeval("inspect", original, "--format", "json").stdout)
    assert sorted(item["kind"] for item in found) == ["gains", "residuals"]
    assert "residuals" in rangeeval("inspect", original).stdout


def test_inspect_names_files_that_are_no_logs(trial):
    """On standard error, with what they hold instead."""
    import scipy.io

    scipy.io.savemat(trial / "scan.mat", {"list": {"measurement": [1.0, 2.0], "sensor": 3}})
    done = rangeeval("inspect", trial, "--format", "json")
    assert json.loads(done.stdout)
    assert (
        "scan.mat: not recognised as a log: none of its variables is a column of a log: list (struct with"
        in done.stderr
    )


def test_single_files_make_a_trial(original):
    """Two log files given by name are as good as their folder."""
    one = rangeeval("accuracy", original / "residuals.csv", original / "gains.csv", "--format", "csv")
    other = rangeeval("accuracy", original, "--format", "csv")
    by_key = [{r.split(",")[5]: r for r in x.stdout.splitlines()} for x in (one, other)]
    assert by_key[0]["range_sigma"] == by_key[1]["range_sigma"]


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda f: edit(f / "residuals.csv", lambda t: t.__setitem__(0, t[0].replace("range_predicted_m", "r"))),
         ["residuals.csv", "range_predicted_m"]),
        (lambda f: edit(f / "residuals.csv", lambda t: t.__setitem__(0, t[0].replace("time_s", "t"))), ["residuals.csv", "time_s"]),
        (lambda f: edit(f / "residuals.csv", lambda t: t.__setitem__(0, t[0].replace("range_residual_m", "range_residual_furlong"))),
         ["residuals.csv", "range_residual_furlong", "unit"]),
        (lambda f: (f / "residuals.csv").write_bytes(b""), ["residuals.csv", "empty"]),
        (lambda f: edit(f / "residuals.csv", lambda t: t.__delitem__(slice(1, None))), ["not one usable update"]),
        (lambda f: (f / "gains.csv").unlink(), ["no gains", "alpha"]),
        (lambda f: edit(f / "trial.toml", lambda t: t.append("[bins")), ["trial.toml", "line"]),
        (lambda f: edit(f / "trial.toml", lambda t: t.insert(0, "[trail]")), ["trial.toml", "trail", "did you mean 'trial'"]),
    ],
)  # fmt: skip
def test_an_impossible_input_is_one_clear_line(trial, spoil, words):
    """Missing column, wrong unit, empty file, header only, no gains, broken or unknown settings."""
    spoil(trial)
    one_line_error(rangeeval("accuracy", trial), *words)


def test_a_truncated_hdf5_file_is_one_clear_line(tmp_path):
    """Cut short, it says so."""
    path = tmp_path / "log.h5"
    with h5py.File(path, "w") as file:
        for name in ("time_s", "range_residual_m", "range_predicted_m", "alpha", "beta"):
            file[name] = np.arange(1000.0)
    path.write_bytes(path.read_bytes()[:3000])
    one_line_error(rangeeval("accuracy", path), "log.h5", "truncated")


def test_no_such_file_and_no_log_in_a_folder(tmp_path):
    """Both are one line."""
    one_line_error(rangeeval("accuracy", tmp_path / "nowhere"), "nowhere")
    one_line_error(rangeeval("accuracy", tmp_path), "no log was recognised")


def test_text_in_a_number_column_names_file_row_and_column(trial):
    """The row is set aside with its line, the rest is used."""
    edit(trial / "residuals.csv", lambda t: field(t, 5, "range_residual_m", "oops"))
    done = rangeeval("accuracy", trial, "--format", "json")
    assert done.returncode == 0
    assert "residuals.csv:5: range_residual_m is 'oops', not a number" in done.stderr
    assert any(p["rejected"] and p["count"] == 1 for p in json.loads(done.stdout)["problems"])


def test_nan_is_missing_and_infinity_is_set_aside(trial):
    """NaN counts as missing, infinities and 1e400 are named."""

    def spoil(lines):
        for line, text in ((6, "inf"), (7, "1e400"), (8, "NaN"), (9, "")):
            field(lines, line, "range_residual_m", text)

    edit(trial / "residuals.csv", spoil)
    done = rangeeval("accuracy", trial)
    assert done.returncode == 0
    assert "residuals.csv:6" in done.stderr
    assert "residuals.csv:7" in done.stderr


def test_time_going_backwards_and_duplicated_rows_are_said_and_change_nothing(trial, original):
    """A log upside down and partly repeated gives the numbers of the clean one, and says what it met."""
    edit(trial / "residuals.csv", lambda t: t.__setitem__(slice(1, None), t[:0:-1]))
    edit(trial / "residuals.csv", lambda t: t.extend(t[1:50]))
    messy, clean = (rangeeval("accuracy", f, "--format", "json") for f in (trial, original))
    assert "backwards" in messy.stderr
    assert "twice" in messy.stderr
    value = [
        [r["value"] for r in json.loads(done.stdout)["estimates"] if r["quantity"] == "range_sigma"]
        for done in (messy, clean)
    ]
    assert value[0] == pytest.approx(value[1])


def test_gains_outside_the_stability_triangle_are_counted(trial):
    """Such an update is not used and is said."""
    edit(trial / "gains.csv", lambda t: field(t, 200, "alpha_range", "2.5"))
    done = rangeeval("accuracy", trial)
    assert done.returncode == 0
    assert "stability triangle" in done.stderr


def test_a_cross_range_beyond_the_range_is_flagged(trial):
    """No angle, a flag, no crash."""
    edit(trial / "residuals.csv", lambda t: [field(t, i, "y_predicted_m", "2e5") for i in range(2, len(t) + 1)])
    done = rangeeval("accuracy", trial, "--format", "json")
    assert done.returncode == 0
    rows = [r for r in json.loads(done.stdout)["estimates"] if r["quantity"] == "elevation_sigma" and r["n"] > 1]
    assert rows
    assert all(r["value"] is None and "unobservable" in r["flags"] for r in rows)


def test_names_cannot_write_to_the_terminal(trial):
    """An escape sequence in a log is printed as text."""
    edit(trial / "residuals.csv", lambda t: field(t, 5, "range_residual_m", "\x1b[2Jx"))
    done = rangeeval("accuracy", trial)
    assert "\x1b" not in done.stdout + done.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ["accuracy"],
        ["acuracy", "x"],
        ["accuracy", "x", "--format", "xml"],
        ["report", "x"],
        ["simulate", "x", "-o", "y"],
    ],
)
def test_wrong_usage_is_status_2(arguments):
    """As every command does."""
    assert rangeeval(*arguments).returncode == 2


def test_a_wrong_when_is_named(original):
    """With the nearest column."""
    one_line_error(rangeeval("accuracy", original, "--when", "snr_bd_min=20"), "did you mean 'snr_db'")
    one_line_error(rangeeval("accuracy", original, "--when", "snr_db_min"), "NUMBER")


def test_bins_of_another_variable_need_a_width(original):
    """A width in metres says nothing of angles, SNR or time."""
    one_line_error(rangeeval("accuracy", original, "--bins", "azimuth"), "--bins azimuth needs --bin-width")
    assert rangeeval("accuracy", original, "--bins", "snr", "--bin-width", "5").returncode == 0


def test_standard_error_is_quiet_about_progress_when_no_terminal(original):
    """Only problems are written there."""
    assert "rows" in rangeeval("accuracy", original).stderr
    assert "\r" not in rangeeval("accuracy", original).stderr


def test_output_folder_that_cannot_be_made_is_one_line(original, tmp_path):
    """A file in the way."""
    (tmp_path / "out").write_text("here first")
    one_line_error(rangeeval("report", original, "-o", tmp_path / "out" / "x"), "out")
