"""Many trials: every analysis of each, one result file each, by one process or by many workers.

What comes out is the same, to the last bit and in the same order, whatever the number of workers, and however often the
run was interrupted.
"""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rangeeval import flow
from rangeeval.errors import SettingsError, one_line
from rangeeval.files import sweep_folder, write_whole
from rangeeval.many.child import Child
from rangeeval.many.finding import find_trials
from rangeeval.many.work import DONE, FAILED, KEPT, Job, Outcome
from rangeeval.model import BinChoice

SUMMARY = "summary.json"

Report = Callable[[Outcome, int, int], None]
"""Called with each outcome as it comes in, how many there are so far, and how many there will be."""


@dataclass(frozen=True)
class Summary:
    """What came of every trial, in the order the trials were given, and remarks on what is no trial."""

    directory: str
    outcomes: tuple[Outcome, ...]
    notes: tuple[str, ...] = ()

    @property
    def failed(self) -> tuple[Outcome, ...]:
        """The trials that have no result."""
        return tuple(one for one in self.outcomes if one.status == FAILED)

    def as_dict(self) -> dict[str, Any]:
        """For JSON: nothing that depends on when, where or by how many workers it was done."""
        return {
            "schema": 1,
            "trials": [
                {
                    "trial": one.path,
                    "status": FAILED if one.status == FAILED else DONE,
                    "result": one.result or None,
                    "sha256": one.sha256 or None,
                    "inputs": one.inputs or None,
                    "why": one.why or None,
                }
                for one in self.outcomes
            ],
            "notes": list(self.notes),
        }


def evaluate_many(
    paths: Iterable[str | os.PathLike[str]],
    directory: str | os.PathLike[str],
    plan: flow.Plan | None = None,
    *,
    bins: BinChoice | None = None,
    jobs: int = 1,
    scheduler: str | None = None,
    time_limit: float | None = None,
    report: Report | None = None,
) -> Summary:
    """Evaluate every trial at these paths; each result lands in `directory` as a file like `results.json`.

    A result is named by its trial and a hash of inputs and plan. One that lies there is kept, so a run that was
    interrupted goes on where it was; a changed input or plan makes a new file, and the old one stays. `summary.json`
    lists trials in order. One process at a time does the work with `jobs` = 1, else so many dask workers on this
    machine, or those of the cluster at `scheduler`, which must see the same files.

    Parameters
    ----------
    paths : trial folders, archives, logs, or folders of them (see `find_trials`).
    plan : what to do with each; `bins` changes each trial's own bins.
    time_limit : seconds after which a trial is stopped and listed as failed.

    Raises
    ------
    InputError : a path does not exist, or there is no trial at any.
    SettingsError : fewer than one job, or jobs and a scheduler together.
    MissingExtra : several workers without the extra `cluster`.
    ClusterLost : the scheduler can't be reached, or went away; results so far are safe.
    """
    if jobs < 1:
        raise SettingsError(f"--jobs {jobs}: give 1 or more")
    if scheduler is not None and jobs != 1:
        raise SettingsError("--jobs is for workers on this machine; the cluster at --scheduler has its own")
    if time_limit is not None and time_limit <= 0:
        raise SettingsError(f"--time-limit {time_limit:g}: give more than 0 seconds")
    found = find_trials(paths)
    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    sweep_folder(folder)
    # Workers need not be where we are: they get absolute paths.
    target = str(folder.absolute())
    asked = {os.path.abspath(trial): number for number, trial in enumerate(found.trials)}
    work = (
        Job(path, target, plan or flow.Plan(), bins or BinChoice()) for path in asked
    )  # made one at a time: a run may have any number
    outcomes: list[Outcome | None] = [None] * len(asked)
    for count, outcome in enumerate(_outcomes(work, jobs, scheduler, time_limit), start=1):
        number = asked[outcome.path]
        outcome = dataclasses.replace(_seen_here(outcome, folder), path=found.trials[number])
        outcomes[number] = outcome
        if report is not None:
            report(outcome, count, len(asked))
    every = tuple(one for one in outcomes if one is not None)
    summary = Summary(str(directory), every, (*found.notes, *_twice(every)))
    write_whole(folder / SUMMARY, json.dumps(summary.as_dict(), ensure_ascii=False, indent=1).encode())
    return summary


def _outcomes(work: Iterable[Job], jobs: int, scheduler: str | None, time_limit: float | None) -> Iterator[Outcome]:
    if jobs == 1 and scheduler is None:
        with Child() as child:
            yield from (child.perform(job, time_limit) for job in work)
        return
    from rangeeval.many.cluster import cluster_client, local_client, perform_on

    with local_client(jobs) if scheduler is None else cluster_client(scheduler) as client:
        yield from perform_on(client, work, time_limit)


def _seen_here(outcome: Outcome, folder: Path) -> Outcome:
    """The outcome, or a failure when its file does not lie in the folder: a worker wrote it somewhere else."""
    if outcome.status == FAILED or (folder / outcome.result).is_file():
        return outcome
    why = f"its worker wrote {outcome.result}, which is not to be seen here: all workers must share {one_line(folder)}"
    return dataclasses.replace(outcome, status=FAILED, why=why, result="", sha256="")


def _twice(outcomes: Iterable[Outcome]) -> Iterator[str]:
    """A remark on each trial that holds the same as one before it."""
    first: dict[str, str] = {}
    for one in outcomes:
        if one.inputs and first.setdefault(one.inputs, one.path) != one.path:
            yield f"{one_line(one.path)}: the same logs and settings as {one_line(first[one.inputs])}"


__all__ = ["DONE", "FAILED", "KEPT", "SUMMARY", "BinChoice", "Outcome", "Summary", "evaluate_many", "find_trials"]
