"""Archives: what goes in comes out, to the last bit; what is not whole, not ours or not safe is one clear line."""

import contextlib
import json
import random
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

import rangeeval
from rangeeval import archives, flow
from rangeeval.errors import InputError
from rangeeval.files import sweep
from rangeeval.model import CHUNK_ROWS, Trial, log_of
from rangeeval.parsers.archive import archived_results, open_archive, verify
from rangeeval.scenarios import simulate_alpha_beta

LAYOUT_1 = Path(__file__).parent / "parsers" / "data" / "layout-1.h5"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A trial with awkward names, a row that is set aside and a file that is no log."""
    folder = tmp_path_factory.mktemp("trials") / "pass 3"
    simulate_alpha_beta(folder, seed=5, flights=1, name='레이더 "3" <b>')
    lines = (folder / "residuals.csv").read_text().splitlines()
    lines[5] = lines[5].replace(lines[5].split(",")[2], "oops")
    (folder / "residuals.csv").write_text("\n".join(lines).replace("T001", "항적 1") + "\n", encoding="utf-8")
    gains = (folder / "gains.csv").read_text().replace("T001", "항적 1")
    (folder / "gains.csv").write_text(gains, encoding="utf-8")
    (folder / "notes.bin").write_bytes(bytes(range(256)))
    return folder


@pytest.fixture(scope="module")
def archive(folder, tmp_path_factory):
    """Its archive."""
    return flow.ingest(rangeeval.open_trial(folder), tmp_path_factory.mktemp("archives") / "trial.h5")


@pytest.fixture
def copy(archive, tmp_path):
    """A copy to spoil."""
    path = tmp_path / "trial.h5"
    path.write_bytes(archive.read_bytes())
    return path


def test_an_archive_gives_back_every_row_and_word(folder, archive):
    """Logs bit for bit, labels, problems where they were met, settings, sources with their SHA-256."""
    original, read = rangeeval.open_trial(folder), rangeeval.open_trial(archive)
    assert read.settings == original.settings
    assert read.title == original.title
    assert read.problems == original.problems
    assert [(s.name, s.format, s.kind, s.size) for s in read.sources] == [
        (s.name, s.format, s.kind, s.size) for s in original.sources
    ]
    for ours, theirs in zip(read.logs, original.logs, strict=True):
        assert (ours.kind, ours.source, ours.columns, ours.stage) == (
            theirs.kind,
            theirs.source,
            theirs.columns,
            theirs.stage,
        )
        assert dict(ours.written) == dict(theirs.written)
        mine, other = ours.read(), theirs.read()
        assert mine.problems == other.problems
        assert ours.rows == len(other)
        for name in other.columns:
            if name in other.labels:
                assert mine.texts(name) == other.texts(name)
            else:
                assert mine.floats(name).tobytes() == other.floats(name).tobytes()


def test_results_of_an_archive_are_those_of_its_folder(folder, archive, tmp_path):
    """Fresh from the archived logs, or as stored: the bytes of results.json."""
    written = [flow.results_json(flow.evaluate(rangeeval.open_trial(path))) for path in (folder, archive)]
    assert written[0] == written[1]
    assert flow.results_json(archived_results(archive)) == written[0]


def test_the_same_trial_gives_the_same_bytes_again_and_from_its_archive(folder, archive, tmp_path):
    """No clock and no path is in an archive."""
    again = flow.ingest(rangeeval.open_trial(folder), tmp_path / "a.h5")
    twice = flow.ingest(rangeeval.open_trial(archive), tmp_path / "b.h5")
    assert again.read_bytes() == archive.read_bytes() == twice.read_bytes()


def test_any_hdf5_tool_reads_the_columns(archive):
    """Numbers as float64, text as fixed-length UTF-8, with units, compressed and checksummed."""
    with h5py.File(archive) as file:
        log = next(g for g in file["logs"].values() if g.attrs["kind"] == "residuals")
        assert log["track_id"][0].decode() == "항적 1"
        assert log["range_residual_m"].attrs["unit"] == "m"
        for dataset in (*log.values(), *file["estimates"].values(), file["results_json"]):
            assert dataset.fletcher32
            assert dataset.compression == "gzip"
        assert set(file["estimates/quantity"].asstr()[:]) > {"range_sigma"}
        assert list(file["problems/rejected"][:]).count(1.0) == 1


def test_an_archive_streams_in_the_pieces_it_was_made_from(tmp_path):
    """Two pieces and a bit; texts that grow longer on the way."""
    n = 2 * CHUNK_ROWS + 7
    track = np.where(np.arange(n) < CHUNK_ROWS, "A", "a track of a very long name, longer than sixteen bytes")
    log = log_of("residuals", {"time_s": np.arange(n) * 0.1, "track_id": track, "range_residual_m": np.sin(np.arange(n)),
                               "range_predicted_m": np.full(n, 3e4)})  # fmt: skip
    path = archives.write_archive(Trial("t", (log,)), [], {}, tmp_path / "t.h5")
    read = open_archive(path).log("residuals")
    assert [len(p) for p in read.pieces(["time_s"])] == [CHUNK_ROWS, CHUNK_ROWS, 7]
    assert read.read().texts("track_id") == list(track)
    assert verify(path).rows == n
    assert path.stat().st_size < 24 * n


def test_a_text_longer_than_an_archive_holds_is_one_line(tmp_path):
    """Said with the column; nothing is left behind."""
    log = log_of(
        "residuals", {"time_s": [0.0], "track_id": ["x" * 2000], "range_residual_m": [1.0], "range_predicted_m": [1e4]}
    )
    with pytest.raises(InputError, match="track_id has 2000 bytes"):
        archives.write_archive(Trial("t", (log,)), [], {}, tmp_path / "t.h5")
    assert list(tmp_path.iterdir()) == []


def test_an_archive_of_layout_1_stays_readable():
    """A file written by the first version: logs, settings, results."""
    assert verify(LAYOUT_1).rows == 60
    assert open_archive(LAYOUT_1).settings.trial.radar == "MFR-1"
    assert rangeeval.open_trial(LAYOUT_1).log("residuals").read().texts("track_id")[:2] == ["A", "B"]
    assert [r.analysis for r in archived_results(LAYOUT_1)] == ["accuracy"]


@pytest.mark.parametrize("count", [1000, pytest.param(10_000, marks=pytest.mark.slow)])
def test_every_flipped_bit_is_found(count, tmp_path):
    """Random single bits, anywhere in the file; the header's padding too."""
    data = bytearray(LAYOUT_1.read_bytes())
    path = tmp_path / "flipped.h5"
    rng = random.Random(1)
    places = [rng.randrange(len(data) * 8) for _ in range(count - 300)] + [rng.randrange(512 * 8) for _ in range(300)]
    missed = 0
    for bit in places:
        data[bit // 8] ^= 1 << bit % 8
        path.write_bytes(data)
        data[bit // 8] ^= 1 << bit % 8
        with contextlib.suppress(InputError):
            verify(path)
            missed += 1
    assert missed == 0


def test_every_truncation_is_found(copy):
    """At whichever byte it was cut off, opening it is one line that says so."""
    data = copy.read_bytes()
    for length in [*range(0, 600, 37), *range(600, len(data), len(data) // 40), len(data) - 1]:
        copy.write_bytes(data[:length])
        with pytest.raises(InputError, match=r"^trial.h5:") as caught:
            rangeeval.open_trial(copy).logs[0].read()
        assert "\n" not in str(caught.value)
    copy.write_bytes(data + b"x")
    with pytest.raises(InputError, match="damaged"):
        rangeeval.open_trial(copy)


def spoilt(path, change):
    """Change an archive with an HDF5 tool and put a header of the right SHA-256 before it."""
    with h5py.File(path, "r+") as file:
        change(file)
    archives._seal(path)


def _replace(file, name, **how):
    del file[name]
    file.create_dataset(name, **how)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: f.__setitem__("logs/000/x", h5py.ExternalLink("/etc/passwd", "/")), "link to another file"),
        (lambda f: f.__setitem__("logs/000/x", h5py.SoftLink("/logs")), "not one that rangeeval wrote"),
        (lambda f: f["logs/000"].create_dataset("x", (4,), "u1", external=[("/etc/passwd", 0, 4)]), "another file"),
        (lambda f: f["logs/000"].create_virtual_dataset("x", h5py.VirtualLayout((4,), "f8")), "virtual"),
        (lambda f: f["logs/000"].create_dataset("pickled", (1,), h5py.vlen_dtype(np.uint8)), "neither numbers nor text"),
        (lambda f: f["logs/000"].create_dataset("r", (1,), h5py.ref_dtype), "neither numbers nor text"),
        (lambda f: _replace(f, "logs/000/time_s", data=np.arange(3.0)), "should hold"),
        (lambda f: _replace(f, "logs/000/time_s", data=np.array([b"x"] * 999)), "should hold"),
        (lambda f: f.__delitem__("meta_json"), "no meta_json"),
        (lambda f: f.__delitem__("logs"), "should hold"),
        (lambda f: _replace(f, "meta_json", data=np.frombuffer(b"{}", np.uint8)), "description cannot be read"),
        (lambda f: _replace(f, "meta_json", data=np.frombuffer(b"[" * 9999, np.uint8)), "description cannot be read"),
        (lambda f: _replace(f, "meta_json", data=np.frombuffer(b"\xff\xfe", np.uint8)), "cannot be read"),
        (lambda f: _replace(f, "results_json", data=np.frombuffer(b"[{}]", np.uint8)), "not a rangeeval result"),
        (lambda f: _replace(f, "results_json", data=np.frombuffer(b"{", np.uint8)), "results cannot be read"),
    ],
)  # fmt: skip
def test_what_is_not_ours_or_not_safe_is_refused(change, words, copy):
    """Links, storage elsewhere, objects that only a pickle could read, a structure that does not fit."""
    spoilt(copy, change)
    with pytest.raises(InputError, match=words) as caught:
        verify(copy)
    assert str(caught.value).startswith("trial.h5")
    assert "\n" not in str(caught.value)


def test_an_archive_of_another_version_says_which(copy):
    """A newer layout is not guessed at."""
    copy.write_bytes(copy.read_bytes().replace(b"rangeeval archive 1", b"rangeeval archive 7", 1))
    with pytest.raises(InputError, match="layout 7; this version of rangeeval reads layouts 1 to 2"):
        rangeeval.open_trial(copy)


def test_what_is_no_archive_is_said(tmp_path, folder):
    """Text, another HDF5 file, nothing."""
    for name, write in (
        ("a.h5", lambda p: p.write_text("hello")),
        ("b.h5", lambda p: h5py.File(p, "w").close()),
        ("c.h5", lambda p: p.touch()),
    ):
        write(tmp_path / name)
        with pytest.raises(InputError, match="not an archive"):
            verify(tmp_path / name)
    with pytest.raises(InputError, match="cannot be read"):
        verify(tmp_path / "nowhere.h5")


def test_an_archive_goes_alone(archive, folder):
    """With logs beside it, it is said; in a folder, it is listed and not read twice."""
    with pytest.raises(InputError, match="give it alone"):
        rangeeval.open_trial([archive, folder / "gains.csv"])
    inside = folder / "inside.h5"
    inside.write_bytes(archive.read_bytes())
    try:
        problems = rangeeval.open_trial(folder).problems
    finally:
        inside.unlink()
    assert any("archive of a whole trial" in p.reason for p in problems)


def command(*arguments, **options):
    """Run rangeeval in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "rangeeval", *map(str, arguments)], capture_output=True, text=True, encoding="utf-8",
        cwd=Path(__file__).parents[1], **options,
    )  # fmt: skip


FULL = """
import pathlib, resource, sys, rangeeval
from rangeeval import archives
from rangeeval.parsers.archive import archived_results
archive, target = map(pathlib.Path, sys.argv[1:])
trial, results, size = rangeeval.open_trial(archive), archived_results(archive), archive.stat().st_size
for limit in (0, 600, size // 20, size // 3, 9 * size // 10, size - 100, size - 1):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    try:
        archives.write_archive(trial, results, {s.name: s.sha256 for s in trial.sources}, target)
    except OSError as error:
        assert error.filename == str(target), error
    else:
        raise AssertionError(limit)
    assert target.read_bytes() == b"old" and [p.name for p in target.parent.iterdir()] == [target.name], limit
print("whole")
"""


def test_a_full_disk_leaves_the_old_archive(archive, tmp_path):
    """Wherever the disk fills up, the old file stays, nothing lies beside it, HDF5 does not crash, and it is said."""
    (tmp_path / "trial.h5").write_bytes(b"old")
    done = subprocess.run([sys.executable, "-c", FULL, archive, tmp_path / "trial.h5"], capture_output=True, text=True,
                          cwd=Path(__file__).parents[1], check=False)  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "whole\n", "")


def test_what_a_killed_writer_left_is_swept_and_a_living_one_is_not_disturbed(tmp_path):
    """A lock tells them apart."""
    from rangeeval.files import replacing

    (tmp_path / ".t.h5.abc.tmp").write_bytes(b"left by a kill")
    (tmp_path / ".other.h5.abc.tmp").write_bytes(b"another's")
    with replacing(tmp_path / "t.h5") as first:
        assert not (tmp_path / ".t.h5.abc.tmp").exists()
        assert sweep(tmp_path / "t.h5") == 0
        first.write_bytes(b"new")
    assert (tmp_path / "t.h5").read_bytes() == b"new"
    assert sorted(p.name for p in tmp_path.iterdir()) == [".other.h5.abc.tmp", "t.h5"]


def test_a_link_at_the_output_is_replaced_not_followed(folder, tmp_path):
    """What it points to stays as it is."""
    (tmp_path / "precious").write_text("keep")
    (tmp_path / "t.h5").symlink_to(tmp_path / "precious")
    flow.ingest(rangeeval.open_trial(folder), tmp_path / "t.h5")
    assert (tmp_path / "precious").read_text() == "keep"
    assert not (tmp_path / "t.h5").is_symlink()


def test_a_trial_that_no_analysis_starts_from_is_archived_all_the_same(tmp_path):
    """Gains alone: an archive without results."""
    (tmp_path / "g.csv").write_text("time_s,alpha,beta\n0,0.5,0.1\n")
    path = flow.ingest(rangeeval.open_trial(tmp_path / "g.csv"), tmp_path / "g.h5")
    assert verify(path).results == ()


def test_ingest_and_verify_on_the_command_line(folder, tmp_path):
    """The path on standard output; verify says whole, or why not with status 1, and goes on to the others."""
    path = tmp_path / "trial.h5"
    done = command("ingest", folder, "-o", path)
    assert (done.returncode, done.stdout) == (0, f"{path}\n"), done.stderr
    bad = tmp_path / "bad.h5"
    bad.write_bytes(path.read_bytes()[:-1])
    done = command("verify", bad, path, "--format", "json")
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert [item["whole"] for item in json.loads(done.stdout)] == [False, True]
    assert "whole (layout 1, 3 logs" in command("verify", path).stdout
