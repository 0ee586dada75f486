"""The main flow: read, analyse, judge, compose, write."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import os
import platform
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import rangeeval
from rangeeval.analyses import all_analyses
from rangeeval.errors import InputError, RangeevalError
from rangeeval.files import write_whole as _write
from rangeeval.model import Bins, Problem, Result, Trial
from rangeeval.model.result import without_nan
from rangeeval.model.settings import Requirement
from rangeeval.requirements import check as judge

Progress = Callable[[int], None]
TrialLike = str | os.PathLike[str] | Trial | Sequence[Result]

_VERSIONS = ("numpy", "scipy", "pandas", "h5py", "numba", "bokeh", "typst", "matplotlib")


@dataclass(frozen=True)
class Plan:
    """What to do with a trial: which analyses (all that its logs allow by default) and with which settings."""

    analyses: tuple[str, ...] | None = None
    bins: Bins | None = None
    confidence: float = 0.95
    estimator: str = "recommended"
    per_track: bool = False


def evaluate(trial: Trial, plan: Plan | None = None, progress: Progress | None = None) -> list[Result]:
    """Every analysis that the trial's logs allow, and the verdicts on its requirements.

    Raises InputError when the logs allow none.
    """
    plan = plan or Plan()
    known = all_analyses()
    chosen = plan.analyses or tuple(name for name, analysis in known.items() if analysis.applies_to(trial))
    if not chosen:
        held = ", ".join(sorted({log.kind for log in trial.logs})) or "no log"
        raise InputError(f"{trial.name} holds {held}; no analysis can start from that")
    origin = provenance(trial)
    results = []
    left_out: list[Problem] = []
    for name in chosen:
        own = {option: getattr(plan, option) for option in known[name].takes}
        try:
            found = known[name].load()(trial, plan.bins, confidence=plan.confidence, progress=progress, **own)
        except RangeevalError as error:
            if plan.analyses or not known[name].optional or len(chosen) == 1:
                raise
            left_out.append(Problem(trial.name, f"{name} was left out: {error}"))
            continue
        results.append(replace(found, problems=(*trial.problems, *found.problems), provenance=origin))
    if not results:
        raise InputError("; ".join(p.reason for p in left_out))
    results[0] = replace(results[0], problems=(*results[0].problems, *left_out))
    if trial.settings.requirements:
        verdicts = _verdicts(trial, plan, {r.analysis: r for r in results}, progress)
        results.append(replace(verdicts, provenance=origin))
    return results


def check(trial: Trial, plan: Plan | None = None, progress: Progress | None = None) -> Result:
    """The verdict on every requirement of the trial's settings, in every bin."""
    return replace(_verdicts(trial, plan or Plan(), {}, progress), provenance=provenance(trial))


def _verdicts(trial: Trial, plan: Plan, done: Mapping[str, Result], progress: Progress | None) -> Result:
    """The verdicts; `done`: results already at hand. A requirement with a `when` needs its own pass over the log."""
    requirements = trial.settings.requirements
    if not requirements:
        raise InputError(f"{trial.name}: no [[requirements]] in its trial.toml, so there is nothing to check")
    accuracy = all_analyses()["accuracy"].load()
    passes: dict[tuple[tuple[str, float], ...], Result] = {}
    if "accuracy" in done:
        passes[()] = done["accuracy"]
    judged: list[tuple[Requirement, Result]] = []
    for requirement in requirements:
        key = tuple(sorted(requirement.when.items()))
        if key not in passes:
            passes[key] = accuracy(
                trial,
                plan.bins,
                confidence=plan.confidence,
                estimator=plan.estimator,
                when=requirement.when,
                progress=progress,
            )
        judged.append((requirement, passes[key]))
    return judge(judged)


def provenance(trial: Trial) -> dict[str, Any]:
    """What the result was made from and with: the trial's own words, its files with their SHA-256, versions."""
    from rangeeval.parsers.hashing import sha256_of

    digests = sha256_of(trial.sources)
    return {
        "trial": {**dataclasses.asdict(trial.settings.trial), "name": trial.title},
        "settings": without_nan(dataclasses.asdict(trial.settings)),
        "inputs": [{"file": s.name, "format": s.format, "kind": s.kind, "bytes": s.size, "sha256": digests[s.name]}
                   for s in trial.sources],
        "versions": versions(),
    }  # fmt: skip


def versions() -> dict[str, str]:
    """The software that makes results: rangeeval, Python and the packages below it."""
    return {
        "rangeeval": rangeeval.__version__,
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in _VERSIONS},
    }


def write_report(results: Sequence[Result], directory: str | os.PathLike[str]) -> list[Path]:
    """Write `report.html`, `report.pdf` and `results.json` for results, fresh or read back. Returns their paths."""
    from rangeeval.reporting import render
    from rangeeval.reporting.sections import compose

    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    rendered = render(compose(results))
    files = {
        "report.html": rendered.html.encode(),
        "report.pdf": rendered.pdf,
        "results.json": results_json(results).encode(),
    }
    return [_write(folder / name, content) for name, content in files.items()]


def report(
    trial: Trial, directory: str | os.PathLike[str], plan: Plan | None = None, progress: Progress | None = None
) -> list[Path]:
    """The main job: analyse all that the trial's logs allow, and write the report."""
    return write_report(evaluate(trial, plan, progress), directory)


def ingest(
    trial: Trial, path: str | os.PathLike[str], plan: Plan | None = None, progress: Progress | None = None
) -> Path:
    """Archive a trial: all its logs, settings, source hashes, and the results of every analysis they allow."""
    from rangeeval.archives import write_archive
    from rangeeval.parsers.hashing import sha256_of

    digests = sha256_of(trial.sources)
    trial = replace(trial, sources=tuple(replace(s, sha256=digests[s.name]) for s in trial.sources))
    allowed = any(analysis.applies_to(trial) for analysis in all_analyses().values())
    return write_archive(trial, evaluate(trial, plan, progress) if allowed else [], digests, path, progress)


def compare(
    *trials: TrialLike,
    plan_of: Callable[[Trial], Plan] | None = None,
    progress: Progress | None = None,
    **choices: Any,
) -> Result:
    """Trials side by side, each against the first, in whatever form each is at hand.

    `plan_of`, `progress`: as of `results_of`. `choices`: those of `comparison.Method` (`confidence`, `margin`,
    `adjust`, `quantities`, ...). Raises what `results_of` and `comparison.compare` raise.
    """
    from rangeeval.comparison import Method
    from rangeeval.comparison import compare as against_the_first

    return against_the_first([results_of(trial, plan_of, progress) for trial in trials], Method(**choices))


def results_of(
    source: TrialLike, plan_of: Callable[[Trial], Plan] | None = None, progress: Progress | None = None
) -> list[Result]:
    """The results of a trial in whatever form it is at hand: a Trial, its folder or log file, an archive, a
    `results.json`, or results themselves.

    `plan_of` gives the plan of each trial, by which it is evaluated anew, an archive too; without it what an archive
    holds is taken as it is. Raises InputError for a `results.json` that should be evaluated anew: it has no logs.
    """
    from rangeeval.parsers import open_trial
    from rangeeval.parsers.archive import archived_results, is_archive

    if not isinstance(source, (str, os.PathLike, Trial)):
        return list(source)
    if not isinstance(source, Trial):
        path = Path(source)
        if path.is_file() and path.suffix.lower() == ".json":
            if plan_of is not None:
                raise InputError(
                    f"{path}: holds results, not logs, so it cannot be evaluated with other bins or options"
                )
            return read_results(path)
        if plan_of is None and path.is_file() and is_archive(path):
            return archived_results(path)
        source = open_trial(path)
    return evaluate(source, plan_of(source) if plan_of else None, progress)


def results_json(results: Iterable[Result]) -> str:
    """Results as `results.json` holds them: a list, with the series of their figures."""
    return json.dumps([r.as_dict(series=True) for r in results], allow_nan=False, ensure_ascii=False)


def read_results(path: str | os.PathLike[str]) -> list[Result]:
    """Results back from a `results.json`. Raises InputError when it is not one."""
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not JSON ({error})") from error
    if not isinstance(data, list) or not data:
        raise InputError(f"{path}: not a list of rangeeval results")
    return [Result.from_dict(item, f"{path}[{i}]") for i, item in enumerate(data)]
