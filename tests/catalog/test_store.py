"""The catalogue: an index that knows contents, is whole after anything, and tells its own file from others."""

import json
import shutil
import sqlite3
import subprocess
import sys
import threading

import pytest

import rangeeval
from rangeeval import flow
from rangeeval.catalog import Terms, open_catalog
from rangeeval.errors import InputError, SettingsError
from rangeeval.many.indexing import index, rebuild
from rangeeval.many.work import Job, perform
from tests.crowd import small_trial
from tests.many.test_evaluate import ROOT


@pytest.fixture(scope="module")
def crowd(tmp_path_factory):
    """Two archives and two results, of four trials."""
    folder = tmp_path_factory.mktemp("crowd")
    (folder / "all").mkdir()
    for i, (date, software) in enumerate(
        [("2026-01-10", "2.3"), ("2026-02-10", "2.3"), ("2026-02-20", "2.4"), ("", "")]
    ):
        trial = small_trial(folder / "trials" / f"t{i}", i, name=f"Pass {i}", date=date, software=software)
        if i % 2:
            perform(Job(str(trial), str(folder / "all")))
        else:
            flow.ingest(rangeeval.open_trial(trial), folder / "all" / f"t{i}.h5")
    (folder / "all" / "notes.json").write_text('{"not": "ours"}')
    (folder / "all" / "summary.json").write_text('{"schema": 1, "trials": []}')
    return folder


@pytest.fixture
def place(crowd, tmp_path):
    """A copy to move and spoil."""
    return shutil.copytree(crowd / "all", tmp_path / "all")


@pytest.fixture
def catalog(place, tmp_path):
    """A catalogue of all."""
    with open_catalog(tmp_path / "c.sqlite", create=True) as made:
        assert statuses(index(made, [place])) == "aaaa"
        yield made


def statuses(found):
    """The first letter of each."""
    return "".join(added.status[0] for added in found)


def named(found):
    """The trials' numbers."""
    return [int(result.name.split()[1]) for result in found]


def test_what_was_indexed_is_given_back(catalog, place):
    """Every estimate of an archive, in order, with all digits, flags and further columns; trials by date."""
    assert named(catalog.results()) == [0, 1, 2, 3]
    from rangeeval.parsers.archive import archived_results

    results = archived_results(place / "t0.h5")
    rows = list(catalog.estimates(Terms(trials=("Pass 0",))))
    assert [repr(row.estimate) for row in rows] == [repr(row) for result in results for row in result.rows]
    assert {row.analysis for row in rows} == {"accuracy"}
    assert {row.confidence for row in rows} == {0.95}


@pytest.mark.parametrize(
    ("terms", "left"),
    [
        ({}, [0, 1, 2, 3]),
        ({"radar": "mfr-*"}, [0, 1, 2, 3]),
        ({"radar": "MFR"}, []),
        ({"software": "2.3"}, [0, 1]),
        ({"software": "2.?"}, [0, 1, 2]),
        ({"software": "[2]*"}, []),
        ({"since": "2026-02-10"}, [1, 2]),
        ({"since": "2026-02", "until": "2026-02"}, [1, 2]),
        ({"until": "2026-02-19"}, [0, 1]),
        ({"quantity": "range_sigma"}, [0, 1, 2, 3]),
        ({"quantity": "rcs"}, []),
        ({"quantity": "*_sigma", "bin": (75e3, 80e3)}, [0, 1, 2, 3]),
        ({"bin": (80e3, 90e3)}, []),
        ({"variable": "snr"}, []),
        ({"trials": ("Pass 1", "Pass 3")}, [1, 3]),
        ({"trials": ("Pass",)}, []),
    ],
)
def test_filters(catalog, terms, left):
    """By radar, software, date, quantity, bin, name."""
    assert named(catalog.results(Terms(**terms))) == left
    estimates = list(catalog.estimates(Terms(**terms)))
    assert sorted({int(row.result.name[-1]) for row in estimates}) == left
    low, high = terms.get("bin", (0, 1e9))
    assert all(low <= row.estimate.bin_low and row.estimate.bin_high <= high for row in estimates)


def test_wrong_terms_are_one_line():
    """A date that is none, a span upside down."""
    for wrong in ({"since": "May"}, {"until": "2026-5-1"}, {"bin": (2.0, 1.0)}):
        with pytest.raises(SettingsError):
            Terms(**wrong)


def test_the_same_content_is_indexed_once(catalog, place, tmp_path):
    """Again: known. A copy: known, and where. Moved: the new place. Changed: replaced. The same trial: said."""
    assert statuses(index(catalog, [place])) == "kkkk"
    shutil.copy(place / "t0.h5", tmp_path / "copy.h5")
    (added,) = index(catalog, [tmp_path / "copy.h5"])
    assert (added.status, added.same) == ("known", str(place / "t0.h5"))
    (place / "t0.h5").rename(tmp_path / "moved.h5")
    (added,) = index(catalog, [tmp_path / "moved.h5"])
    assert (added.status, added.same) == ("moved", str(place / "t0.h5"))
    again = flow.ingest(rangeeval.open_trial(tmp_path / "moved.h5"), tmp_path / "moved.h5", flow.Plan(confidence=0.9))
    (added,) = index(catalog, [again])
    assert added.status == "replaced"
    rangeeval.report(rangeeval.open_trial(again), tmp_path / "report")
    (added,) = index(catalog, [tmp_path / "report" / "results.json"])
    assert (added.status, added.same) == ("added", str(tmp_path / "moved.h5"))
    assert named(catalog.results()) == [0, 0, 1, 2, 3]
    catalog.check()


def test_bad_files_are_named_and_the_others_go_on(catalog, place, tmp_path):
    """Cut off, of another version, not ours, results of another schema, an object instead of a number."""
    spoilt = tmp_path / "spoilt"
    spoilt.mkdir()
    whole = (place / "t0.h5").read_bytes()
    (spoilt / "a-cut.h5").write_bytes(whole[:-1])
    (spoilt / "b-newer.h5").write_bytes(whole.replace(b"rangeeval archive 1", b"rangeeval archive 9", 1))
    results = json.loads(next(place.glob("*1.*.json")).read_text())
    results[0]["schema"] = 2
    (spoilt / "c-schema.json").write_text(json.dumps(results))
    results[0]["schema"] = 1
    results[0]["estimates"][0]["value"] = {"not": "a number"}
    (spoilt / "d-value.json").write_text(json.dumps(results))
    shutil.copy(place / "t2.h5", spoilt / "e-good.h5")
    found = index(catalog, [spoilt, place / "notes.json"])
    assert statuses(found) == "ffffkf"
    for added, words in zip(
        found, ("cut off", "layout 9", "schema 2", "not a rangeeval result", "", "not a list"), strict=True
    ):
        assert words in added.same
        assert "\n" not in added.same
    with pytest.raises(InputError, match="no such file"):
        index(catalog, [tmp_path / "nowhere"])


def test_the_index_is_made_again_from_the_files(catalog, place):
    """The same rows; what is gone is left out and named."""
    before = [row.as_row() for row in catalog.estimates()]
    added, failed = rebuild(catalog)
    assert (statuses(added), failed) == ("aaaa", [])
    assert [row.as_row() for row in catalog.estimates()] == before
    (place / "t0.h5").unlink()
    added, failed = rebuild(catalog)
    assert statuses(added) == "aaa"
    assert [one.path for one in failed] == [str(place / "t0.h5")]
    assert statuses(rebuild(catalog, [place / "t2.h5"])[0]) == "a"
    assert named(catalog.results()) == [2]
    catalog.check()


def test_a_file_that_is_no_catalogue_is_one_line_and_stays_as_it_is(tmp_path, place):
    """Text, another database, a catalogue of a newer layout, a damaged one, a folder, a file that is not there."""
    (tmp_path / "text").write_text("x" * 5000)
    other = sqlite3.connect(tmp_path / "other")
    other.execute("CREATE TABLE result (x)")
    other.close()
    with open_catalog(tmp_path / "newer", create=True):
        pass
    connection = sqlite3.connect(tmp_path / "newer")
    connection.execute("PRAGMA user_version = 2")
    connection.close()
    (tmp_path / "folder").mkdir()
    for name, words in (
        ("text", "not a catalogue"), ("other", "but not a catalogue of rangeeval"), ("newer", "layout 2"), ("folder", "cannot be used"),
    ):  # fmt: skip
        path = tmp_path / name
        before = path.read_bytes() if path.is_file() else b""
        with pytest.raises(InputError, match=words) as caught, open_catalog(path, create=True) as opened:
            index(opened, [place])
        assert "\n" not in str(caught.value)
        assert (path.read_bytes() if path.is_file() else b"") == before
    with pytest.raises(InputError, match="'rangeeval catalog add DIR' makes one"), open_catalog(tmp_path / "none"):
        pass
    assert not (tmp_path / "none").exists()


def test_a_damaged_catalogue_is_one_line(tmp_path, place):
    """Wherever a page is overwritten: said, or not noticed by what does not read that page; never a traceback."""
    path = tmp_path / "d.sqlite"
    with open_catalog(path, create=True) as made:
        index(made, [place])
    whole = path.read_bytes()
    said = 0
    for page in range(0, len(whole), 4096):
        path.write_bytes(whole[:page] + bytes([0xA5]) * 4096 + whole[page + 4096 :])
        for left in tmp_path.glob("d.sqlite-*"):
            left.unlink()
        with pytest.raises(InputError) as caught, open_catalog(path) as opened:  # noqa: PT012
            list(opened.estimates())
            opened.check()
        assert "\n" not in str(caught.value)
        said += 1
    assert said == len(whole) // 4096


def test_several_processes_may_write_at_once(tmp_path, crowd):
    """None waits in vain, none writes twice."""
    command = [sys.executable, "-m", "rangeeval", "catalog", "add", crowd / "all", "--catalog", tmp_path / "c.sqlite"]
    done = []
    threads = [
        threading.Thread(
            target=lambda: done.append(subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False))
        )
        for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [one.returncode for one in done] == [0, 0, 0], [one.stderr for one in done]
    with open_catalog(tmp_path / "c.sqlite") as made:
        assert named(made.results()) == [0, 1, 2, 3]
        made.check()


def test_any_sqlite_tool_reads_the_estimates(catalog, tmp_path):
    """By the view `estimates`."""
    connection = sqlite3.connect(tmp_path / "c.sqlite")
    rows = connection.execute("SELECT trial, value FROM estimates WHERE quantity = 'range_sigma'").fetchall()
    connection.close()
    assert len(rows) == 4
    assert all(value > 0 for _, value in rows)
