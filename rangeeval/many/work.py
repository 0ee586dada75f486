"""The unit of work: one trial and one plan in, one result file out.

Work can be repeated: a job whose result lies there already is `kept`, at the cost of hashing its inputs. So a run
that was cut short is gone on with by doing it again, and it does not matter whether a job was done once or twice, or by
whom.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rangeeval import flow
from rangeeval.analyses import all_analyses
from rangeeval.errors import InputError, RangeevalError, one_line
from rangeeval.files import write_whole
from rangeeval.model import BinChoice, Bins, Trial
from rangeeval.model.identity import hash_of, trial_hash
from rangeeval.model.result import without_nan
from rangeeval.parsers import open_trial
from rangeeval.parsers.hashing import sha256_of

DONE, KEPT, FAILED = "done", "kept", "failed"


@dataclass(frozen=True)
class Job:
    """A trial's path, the folder for its result, the plan, and the versions of whoever asks."""

    path: str
    directory: str
    plan: flow.Plan = field(default_factory=flow.Plan)
    bins: BinChoice = field(default_factory=BinChoice)
    versions: Mapping[str, str] = field(default_factory=flow.versions)

    def as_json(self) -> str:
        """One line."""
        return json.dumps(without_nan(dataclasses.asdict(self)), allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> Job:
        """Back from its line."""
        data = json.loads(text)
        plan: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in data["plan"].items()}
        plan["bins"] = None if plan["bins"] is None else Bins(**plan["bins"])
        return cls(**{**data, "plan": flow.Plan(**plan), "bins": BinChoice(**data["bins"])})


@dataclass(frozen=True)
class Outcome:
    """What came of a job: `done`, `kept` from an earlier run, or `failed` with the reason.

    `result`: the file's name; `sha256` of its bytes; `inputs`: a hash of the trial's logs and settings, the same for
    two copies of a trial under different names. `seconds`: how long it took.
    """

    path: str
    status: str
    result: str = ""
    sha256: str = ""
    inputs: str = ""
    why: str = ""
    seconds: float = 0.0

    def as_json(self) -> str:
        """One line."""
        return json.dumps(dataclasses.asdict(self), allow_nan=False)

    @classmethod
    def from_json(cls, text: str | bytes) -> Outcome:
        """Back from its line."""
        return cls(**json.loads(text))


def perform(job: Job) -> Outcome:
    """Evaluate the trial of a job and write its result, unless it lies there. What goes wrong is an outcome too."""
    started = time.perf_counter()
    try:
        outcome = _performed(job)
    except RangeevalError as error:
        outcome = Outcome(job.path, FAILED, why=str(error))
    except OSError as error:
        outcome = Outcome(job.path, FAILED, why=f"{error.filename or job.path}: {error.strerror or error}")
    except MemoryError:
        outcome = Outcome(job.path, FAILED, why="not enough memory")
    except Exception as error:  # a plugin or a fault of ours: this trial's failure, not the run's
        outcome = Outcome(job.path, FAILED, why=f"internal error, please report it: {type(error).__name__}: {error}")
    return replace(outcome, why=one_line(outcome.why, 1000), seconds=time.perf_counter() - started)


def _performed(job: Job) -> Outcome:
    ours = flow.versions()
    other = [f"{name} {job.versions[name]} there, {ours.get(name)} here" for name in job.versions
             if job.versions[name] != ours.get(name)]  # fmt: skip
    if other:
        raise InputError(f"the worker's software is not that of the run, so results would differ: {'; '.join(other)}")
    trial = open_trial(job.path)
    digests = sha256_of(trial.sources)
    trial = replace(trial, sources=tuple(replace(s, sha256=digests[s.name]) for s in trial.sources))
    plan = job.plan if job.plan.bins else replace(job.plan, bins=job.bins.of(trial.settings.bins))
    path = Path(job.directory) / f"{_file_stem(trial.name)}.{key_of(trial, plan)}.json"
    found = Outcome(job.path, KEPT, path.name, inputs=inputs_of(trial))
    if (content := _whole(path)) is None:
        content = flow.results_json(flow.evaluate(trial, plan)).encode()
        write_whole(path, content)
        found = replace(found, status=DONE)
    return replace(found, sha256=hashlib.sha256(content).hexdigest())


def _whole(path: Path) -> bytes | None:
    """The content of a result that lies there. Written whole or not at all, unless the disk is one that cannot."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return None
    return content if content[:1] == b"[" and content[-1:] == b"]" else None


def key_of(trial: Trial, plan: flow.Plan) -> str:
    """What tells results apart: a hash of the trial's words, settings and files, the plan, and rangeeval's version.

    An archive and the folder it was made from have the same key: their results are the same bytes.
    """
    analyses = plan.analyses or tuple(name for name, one in all_analyses().items() if one.applies_to(trial))
    return hash_of(
        {
            "name": trial.title,
            "inputs": inputs_of(trial),
            "sources": [[s.name, s.format, s.kind, s.size] for s in trial.sources],
            "problems": [p.as_dict() for p in trial.problems],
            "plan": dataclasses.asdict(plan),
            "analyses": analyses,
            "rangeeval": flow.versions()["rangeeval"],
        }
    )[:16]


def inputs_of(trial: Trial) -> str:
    """A hash of what a trial holds, whatever it and its files are called: its logs' SHA-256 and its settings."""
    return trial_hash(dataclasses.asdict(trial.settings), ((s.kind, s.sha256) for s in trial.sources))


def _file_stem(name: str) -> str:
    """A trial's name as the beginning of a file's name."""
    return re.sub(r"[^\w.-]+", "-", name).strip("-.")[:60] or "trial"
