"""The main job: a trial in, three files out, the same bytes twice, and again from results.json alone."""

import json
import shutil

import pytest

import rangeeval
from rangeeval import flow
from rangeeval.errors import InputError
from rangeeval.scenarios import simulate_alpha_beta


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    """A small simulated trial with a name that tries things."""
    folder = tmp_path_factory.mktemp("t") / "pass"
    simulate_alpha_beta(folder, seed=4, flights=1, name='레이더 <script>alert("x")</script> $\\foo$ #import')
    return folder


@pytest.fixture(scope="module")
def written(trial, tmp_path_factory):
    """The report on it."""
    out = tmp_path_factory.mktemp("out")
    paths = rangeeval.report(rangeeval.open_trial(trial), out)
    assert [p.name for p in paths] == ["report.html", "report.pdf", "results.json"]
    return out


def test_the_same_trial_gives_the_same_bytes(trial, written, tmp_path):
    """Every file, twice."""
    rangeeval.report(rangeeval.open_trial(trial), tmp_path)
    for name in ("report.html", "report.pdf", "results.json"):
        assert (tmp_path / name).read_bytes() == (written / name).read_bytes(), name


def test_a_report_is_rebuilt_from_results_alone(written, tmp_path):
    """Without the raw logs, the same bytes."""
    alone = tmp_path / "results.json"
    shutil.copy(written / "results.json", alone)
    flow.write_report(flow.read_results(alone), tmp_path / "again")
    for name in ("report.html", "report.pdf", "results.json"):
        assert (tmp_path / "again" / name).read_bytes() == (written / name).read_bytes(), name


def test_nothing_of_a_name_becomes_markup(written):
    """The trial's name stands in the page as text, and no script is there but our own."""
    html = (written / "report.html").read_text(encoding="utf-8")
    assert '<script>alert("x")' not in html
    assert "레이더 &lt;script&gt;" in html
    assert (written / "report.pdf").read_bytes().startswith(b"%PDF")


def test_results_are_a_list_of_the_contracts_objects(written):
    """Accuracy and check, each with series, strict JSON."""
    data = json.loads((written / "results.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    assert [d["analysis"] for d in data] == ["accuracy", "check"]
    assert all({"schema", "settings", "estimates", "problems", "provenance", "series"} <= set(d) for d in data)
    assert {r["verdict"] for r in data[1]["estimates"]} <= {"pass", "fail", "inconclusive"}


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '[{"schema": 9}]', "[" * 5000])
def test_what_is_not_results_json_is_one_line(text, tmp_path):
    """Damaged, empty or of another schema."""
    path = tmp_path / "results.json"
    path.write_text(text)
    with pytest.raises(InputError):
        flow.read_results(path)


def test_writing_leaves_the_old_file_or_the_new_one(tmp_path, monkeypatch):
    """A write that fails leaves the old file whole and nothing beside it."""
    target = tmp_path / "report.html"
    target.write_bytes(b"old")
    monkeypatch.setattr(flow.os, "replace", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        flow._write(target, b"new")
    assert target.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]


def test_a_result_draws_itself(trial):
    """`plot` gives a figure with a point a bin."""
    result = rangeeval.accuracy(rangeeval.open_trial(trial))
    figure = result.plot("azimuth_sigma")
    assert "arcmin" in figure.axes[0].get_ylabel()
    with pytest.raises(InputError, match="did you mean 'range_sigma'"):
        result.plot("range_sgma")


def test_a_trial_without_an_analysis_is_one_line(tmp_path):
    """Gains alone are no accuracy."""
    (tmp_path / "g.csv").write_text("time_s,alpha,beta\n0,0.5,0.1\n")
    with pytest.raises(InputError, match="no analysis can start"):
        rangeeval.report(rangeeval.open_trial(tmp_path), tmp_path / "out")
