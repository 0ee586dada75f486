"""`rangeeval compare` as a user meets it: output, files, exit status, and one clear line for every bad input."""

import csv
import json
import shutil

import h5py
import pytest
from click.testing import CliRunner

from rangeeval.cli import cli
from rangeeval.errors import RangeevalError
from rangeeval.scenarios import simulate_alpha_beta


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Two small trials, and one whose range residuals are twice as large as the first one's kind."""
    root = tmp_path_factory.mktemp("compare")
    for name, seed in (("old", 1), ("new", 2), ("bad", 3)):
        simulate_alpha_beta(root / name, seed=seed, flights=1, no_truth=True, name=name)
        toml = root / name / "trial.toml"
        toml.write_text(toml.read_text().split("[[requirements]]")[0])
    path = root / "bad" / "residuals.csv"
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    for row in rows:
        row["range_residual_m"] = f"{2 * float(row['range_residual_m']):.4f}"
    with path.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    return root


def run(*arguments):
    """Exit status, output and errors of the command in this process; an error of ours is its one line."""
    done = CliRunner().invoke(cli, ["compare", *map(str, arguments)])
    if isinstance(done.exception, RangeevalError):
        assert "\n" not in str(done.exception)
        return 1, "", str(done.exception)
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.stdout, done.stderr


def test_a_change_is_found_and_equal_trials_are_not_told_apart(folders):
    """Twice the residuals: worse in range, exit status 3 when asked; nothing of the kind between equal trials."""
    status, out, _ = run(
        folders / "old", folders / "bad", "--fail-on-difference", "--format", "json", "--bin-width", 30000,
        "--quantity", "range_sigma",
    )  # fmt: skip
    rows = json.loads(out)["estimates"]
    assert status == 3
    assert {r["verdict"] for r in rows} == {"worse"}
    assert all(1.6 < r["value"] < 2.5 for r in rows)
    status, out, _ = run(folders / "old", folders / "new", "--fail-on-difference", "--format", "csv")
    rows = list(csv.DictReader(out.splitlines()))
    assert status == 0
    assert {r["verdict"] for r in rows} == {"inconclusive"}
    assert {r["measure"] for r in rows} == {"ratio", "difference"}


def test_output_is_a_report_folder_or_a_file(folders, tmp_path):
    """A folder gets report.html, report.pdf and results.json, the same again from results.json; a .csv the table."""
    status, out, _ = run(
        folders / "old", folders / "new", folders / "bad", "-o", tmp_path / "out", "--quantity", "*_sigma"
    )
    assert status == 0
    assert [line.rsplit("/", 1)[1] for line in out.split()] == ["report.html", "report.pdf", "results.json"]
    html = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    for words in ("new and bad against old", "What was not alike", "Every test of Range σ", "✗ worse"):
        assert words in html
    again = CliRunner().invoke(cli, ["report", str(tmp_path / "out" / "results.json"), "-o", str(tmp_path / "again")])
    assert again.exit_code == 0
    for name in ("report.html", "report.pdf", "results.json"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "out" / name).read_bytes()
    status, out, _ = run(folders / "old", folders / "new", "-o", tmp_path / "t.csv", "--quantity", "range_sigma")
    assert (status, out) == (0, "")
    assert (tmp_path / "t.csv").read_text().startswith("track_id,group,variable,bin_low,bin_high,quantity")


def test_the_table_says_what_is_compared_and_how(folders):
    """Both estimates, the effect, the verdict; the adjustment below."""
    _, out, err = run(folders / "old", folders / "new", "--quantity", "range_sigma", "--adjust", "bh", "--margin", 0.5)
    assert "Ratio × or difference Δ" in out
    assert "Each trial against old; p adjusted over" in out
    assert "(bh); ratios within 50% count as equivalent" in out
    assert "input residuals" in out
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--margin", "x"], "expected NUMBER or QUANTITY=NUMBER"),
        (["--margin", "-1"], "margin is -1, expected more than 0"),
        (["--confidence", "1.5"], "confidence is 1.5"),
        (["--quantity", "range_sgma"], "did you mean 'range_sigma'"),
        (["--bins", "snr"], "needs --bin-width"),
    ],
)
def test_impossible_options_are_one_line(folders, options, words):
    """What was found and what was expected."""
    status, _, err = run(folders / "old", folders / "new", *options)
    assert status == 1
    assert words in err


def test_one_trial_is_no_comparison(folders):
    """Said in one line."""
    assert run(folders / "old")[::2] == (1, "1 trial given; a comparison needs two or more")


def test_the_same_trial_twice_is_said(folders):
    """On standard error; the comparison is made all the same."""
    status, _, err = run(folders / "old", folders / "old", "--quantity", "range_sigma")
    assert status == 0
    assert "the same trial as old [1]: every file has the same SHA-256" in err


def test_bins_that_do_not_match_are_named(folders, tmp_path):
    """Of two archives binned differently; evaluated anew with one width they compare."""
    for name, width in (("old", 5000), ("new", 5500)):
        done = CliRunner().invoke(
            cli, ["ingest", str(folders / name), "-o", str(tmp_path / f"{name}.h5"), "--bin-width", str(width)]
        )
        assert done.exit_code == 0
    status, _, err = run(tmp_path / "old.h5", tmp_path / "new.h5")
    assert status == 1 or "bins that new does not have" in err
    assert "range 10000 to 15000" in err
    assert run(tmp_path / "old.h5", tmp_path / "new.h5", "--bin-width", 10000, "--quantity", "range_sigma")[0] == 0


def _cut(path):
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])


def _foreign(path):
    with h5py.File(path, "w") as file:
        file["x"] = [1.0]


@pytest.mark.parametrize(("spoil", "words"), [(_cut, "cut off"), (_foreign, "")], ids=["truncated", "not ours"])
def test_a_bad_archive_is_one_line_and_stays_as_it_is(folders, tmp_path, spoil, words):
    """Truncated, or not ours: where and what; nothing is written over."""
    path = tmp_path / "old.h5"
    assert CliRunner().invoke(cli, ["ingest", str(folders / "old"), "-o", str(path)]).exit_code == 0
    spoil(path)
    before = path.read_bytes()
    status, out, err = run(path, folders / "new")
    assert (status, out) == (1, "")
    assert words in err
    assert "old.h5" in err or "holds" in err
    assert path.read_bytes() == before


def test_an_archive_of_another_version_is_one_line(folders, tmp_path):
    """The layout it is of and those this version reads."""
    from rangeeval.model import layout

    path = shutil.copy(_archive(folders, tmp_path), tmp_path / "next.h5")
    head = path.read_bytes()
    header = layout.read_header(head[: layout.HEADER_BYTES], "next.h5")
    later = layout.Header(99, header.size, header.sha256).as_bytes()
    path.write_bytes(later.ljust(layout.HEADER_BYTES, b"\0")[: layout.HEADER_BYTES] + head[layout.HEADER_BYTES :])
    status, _, err = run(path, folders / "new")
    assert status == 1
    assert "99" in err


def _archive(folders, tmp_path):
    path = tmp_path / "old.h5"
    assert CliRunner().invoke(cli, ["ingest", str(folders / "old"), "-o", str(path)]).exit_code == 0
    return path


@pytest.mark.parametrize("text", ["", "{}", '[{"schema": 9}]', "[1]"])
def test_what_is_not_results_json_is_one_line(folders, tmp_path, text):
    """Empty, of another schema, or something else."""
    path = tmp_path / "results.json"
    path.write_text(text)
    status, _, err = run(folders / "old", path)
    assert status == 1
    assert "results.json" in err
