"""Many trials, one process: what is a trial, what is kept, what is redone, and one bad trial beside good ones."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import rangeeval
from rangeeval import flow
from rangeeval.errors import InputError, SettingsError
from rangeeval.many import evaluate_many, find_trials
from rangeeval.many.child import Child
from rangeeval.many.work import FAILED, Job, Outcome, perform
from rangeeval.model import BinChoice, Bins
from tests.crowd import DIES, HANGS, faulty_package, small_trial

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def crowd(tmp_path_factory):
    """Three trials in a folder, one of them as an archive in a folder below."""
    folder = tmp_path_factory.mktemp("crowd")
    small_trial(folder / "a", 1)
    small_trial(folder / "b", 2)
    (folder / "old").mkdir()
    flow.ingest(rangeeval.open_trial(small_trial(folder / "c", 3)), folder / "old" / "c.h5")
    shutil.rmtree(folder / "c")
    return folder


def perform_all(folder, out, **how):
    """Evaluate in this process."""
    return [perform(Job(path, str(out), **how)) for path in find_trials([folder]).trials]


def names(found, folder):
    """Paths of trials below a folder."""
    return [str(Path(trial).relative_to(folder)) for trial in found.trials]


def test_trials_are_found_wherever_they_are(crowd):
    """Folders and archives, all the way down, in order of name; each once."""
    assert names(find_trials([crowd]), crowd) == ["a", "b", "old/c.h5"]
    found = find_trials([crowd / "b", crowd / "a" / "residuals.csv", crowd, crowd / "old"])
    assert names(found, crowd) == ["b", "a/residuals.csv", "a", "old/c.h5"]
    assert len(found.notes) == 2
    assert all("evaluated once" in note for note in found.notes)


def test_what_is_no_trial_is_passed_over(crowd, tmp_path):
    """Pictures, notes beside folders of trials, a link back up; a folder of logs without trial.toml is a trial."""
    folder = shutil.copytree(crowd, tmp_path / "all")
    (folder / "a" / "trial.toml").unlink()
    (folder / "a" / "photos").mkdir()
    (folder / "pictures").mkdir()
    for place in (folder / "pictures", folder / "a" / "photos"):
        (place / "x.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))
    (folder / "README.md").write_text("Trials of May\n")
    (folder / "old" / "up").symlink_to(folder)
    found = find_trials([folder])
    assert names(found, folder) == ["a", "b", "old/c.h5"]
    assert [note.split(": ")[1] for note in found.notes] == ["neither an archive nor in a trial folder, passed over"]


def test_a_place_without_trials_is_one_line(tmp_path):
    """Nothing there, or nothing that is a trial."""
    with pytest.raises(InputError, match="no such file or folder"):
        find_trials([tmp_path / "nowhere"])
    with pytest.raises(InputError, match="no trial folder and no archive"):
        find_trials([tmp_path])


def test_a_result_is_what_report_writes(crowd, tmp_path):
    """To the byte, from a folder and from an archive; the name holds the trial's and a hash."""
    for outcome in perform_all(crowd, tmp_path):
        trial = rangeeval.open_trial(outcome.path)
        plan = flow.Plan(bins=Bins.of(trial.settings.bins))
        assert outcome.status == "done"
        assert (tmp_path / outcome.result).read_text() == flow.results_json(flow.evaluate(trial, plan))
        assert outcome.result.startswith(f"{trial.name}.")


def test_an_archive_has_the_key_of_its_folder(tmp_path):
    """So what was evaluated before a trial was archived is kept."""
    folder = small_trial(tmp_path / "t", 7)
    archive = flow.ingest(rangeeval.open_trial(folder), tmp_path / "t.h5")
    (tmp_path / "out").mkdir()
    outcomes = [perform(Job(str(path), str(tmp_path / "out"))) for path in (folder, archive)]
    assert [o.status for o in outcomes] == ["done", "kept"]
    assert outcomes[0].result == outcomes[1].result


def test_only_what_changed_is_redone(crowd, tmp_path):
    """A row, a setting, the plan, or the bins asked for; a name or a time of a file is no change. Old results stay."""
    folder = shutil.copytree(crowd, tmp_path / "trials")
    out = tmp_path / "out"
    out.mkdir()

    def statuses(**how):
        return "".join(o.status[0] for o in perform_all(folder, out, **how))

    assert statuses() == "ddd"
    (folder / "a" / "residuals.csv").touch()
    assert statuses() == "kkk"
    text = (folder / "a" / "residuals.csv").read_text()
    (folder / "a" / "residuals.csv").write_text(text.replace("0.4,0.1", "0.4,0.2", 1))
    assert statuses() == "dkk"
    with (folder / "b" / "trial.toml").open("a") as toml:
        toml.write("[bins]\nwidth = 2000.0\n")
    assert statuses() == "kdk"
    assert statuses(plan=flow.Plan(confidence=0.9)) == "ddd"
    assert statuses(bins=BinChoice(width=1000.0)) == "ddd"
    assert statuses() == "kkk"
    assert len(list(out.iterdir())) == 11


def test_a_torn_result_is_redone(crowd, tmp_path):
    """A disk that cannot rename may leave one."""
    first = perform(Job(str(crowd / "a"), str(tmp_path)))
    whole = (tmp_path / first.result).read_bytes()
    (tmp_path / first.result).write_bytes(whole[:-100])
    assert perform(Job(str(crowd / "a"), str(tmp_path))).status == "done"
    assert (tmp_path / first.result).read_bytes() == whole


def test_jobs_and_outcomes_travel_as_text():
    """There and back is the same, whatever is in a name."""
    plan = flow.Plan(analyses=("accuracy",), bins=Bins(width=100.0), confidence=0.9)
    job = Job("a\n\udcff레", "/out", plan, BinChoice("snr", 3.0))
    assert Job.from_json(job.as_json()) == job
    assert "\n" not in job.as_json()
    outcome = Outcome("a\nb", FAILED, why='"\x1b')
    assert Outcome.from_json(outcome.as_json()) == outcome


def test_a_worker_with_other_software_refuses(crowd, tmp_path):
    """Its results might differ in the last bit."""
    versions = {**flow.versions(), "numpy": "1.0"}
    outcome = perform(Job(str(crowd / "a"), str(tmp_path), versions=versions))
    assert outcome.status == FAILED
    assert "numpy 1.0 there" in outcome.why


def bad_trials(folder):
    """One of each kind of bad trial, by name."""
    whole = flow.ingest(rangeeval.open_trial(small_trial(folder / "x", 9)), folder / "whole.h5").read_bytes()
    shutil.rmtree(folder / "x")
    (folder / "whole.h5").unlink()
    (folder / "cut.h5").write_bytes(whole[:-1000])
    (folder / "newer.h5").write_bytes(whole.replace(b"rangeeval archive 1", b"rangeeval archive 7", 1))
    gains = folder / "gains alone"
    gains.mkdir()
    (gains / "g.csv").write_text("time_s,alpha,beta\n0,0.5,0.1\n")
    wrong = small_trial(folder / "wrong setting", 4)
    (wrong / "trial.toml").write_text("[trial]\nnmae = 1\n")
    return {"cut.h5": "cut off", "newer.h5": "layout 7", "gains alone": "no analysis can start",
            "wrong setting": "did you mean 'name'?"}  # fmt: skip


def evaluate(*arguments, **options):
    """Run `rangeeval evaluate` in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "rangeeval", "evaluate", *map(str, arguments)], capture_output=True, text=True,
        encoding="utf-8", cwd=options.pop("cwd", ROOT), check=False, **options,
    )  # fmt: skip


def test_bad_trials_are_listed_and_the_others_go_on(crowd, tmp_path):
    """Damaged, of another version, without an analysis, with a wrong setting, with a fatal fault; the same trial twice.
    Each is one line, and the exit status is 1.
    """
    folder = shutil.copytree(crowd, tmp_path / "trials")
    reasons = bad_trials(folder) | {"dies": "its process died each of 3 times: signal 9 (SIGKILL)"}
    small_trial(folder / "dies", 5, name=f"{DIES} at once")
    shutil.copytree(folder / "a", folder / "z")
    done = evaluate(folder, "-o", tmp_path / "out", env=faulty_package(tmp_path / "package"))
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    assert [line.split() for line in done.stdout.splitlines()[2:4]] == [["done", "4"], ["failed", "5"]]
    assert f"{folder}/z: the same logs and settings as {folder}/a" in done.stderr
    assert "5 of 9 trials failed" in done.stderr
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    said = {Path(one["trial"]).name: one["why"] for one in summary["trials"] if one["status"] == "failed"}
    assert set(said) == set(reasons)
    for name, words in reasons.items():
        assert words in said[name], said[name]
        assert "\n" not in said[name]


def test_a_trial_without_an_end_is_stopped(crowd, tmp_path):
    """By the time limit, which does not count the start of a process; the next trial has a new process."""
    endless = small_trial(tmp_path / "hangs", 6, name=f"{HANGS} for ever")
    with Child(faulty_package(tmp_path / "package")) as child:
        outcome = child.perform(Job(str(endless), str(tmp_path)), time_limit=1.0)
        assert (outcome.status, outcome.why) == (FAILED, "it took longer than 1 s and was stopped")
        assert child.perform(Job(str(crowd / "a"), str(tmp_path))).status == "done"


def test_from_python_with_progress(crowd, tmp_path):
    """The summary is in order; a stale temporary file is swept; wrong arguments are said."""
    out = tmp_path / "out"
    out.mkdir()
    (out / ".b.0123.json.xyz.tmp").write_bytes(b"left by a kill")
    seen = []
    summary = evaluate_many([crowd], out, report=lambda o, count, total: seen.append((o.status, count, total)))
    assert seen == [("done", 1, 3), ("done", 2, 3), ("done", 3, 3)]
    assert [Path(o.path).name for o in summary.outcomes] == ["a", "b", "c.h5"]
    assert sorted(p.name for p in out.iterdir()) == sorted([*(o.result for o in summary.outcomes), "summary.json"])
    for wrong in ({"jobs": 0}, {"jobs": 2, "scheduler": "tcp://x:1"}, {"time_limit": 0.0}):
        with pytest.raises(SettingsError):
            evaluate_many([crowd], out, **wrong)
