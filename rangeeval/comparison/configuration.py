"""What was not alike about the trials: settings, software, waveforms, gains, inputs; and trials that are the same."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any

from rangeeval.model import Problem, Result

GAINS_DIFFER = 0.01  # of the mean gain
_GAINS = tuple(f"{gain}_{axis}" for axis in ("range", "y", "z") for gain in ("alpha", "beta"))
_NO_SAMPLES = {"truth", "gains"}  # the same flight path or the same gains do not make two trials one
_NO_CHOICE = {"counts", "requirements", "case_verdict", "differences"}


def differences(trials: Sequence[Sequence[Result]]) -> list[dict[str, Any]]:
    """Every fact that is not the same in all trials: `what`, and its `values`, one a trial (None: not there)."""
    facts = [_facts(results) for results in trials]
    names = dict.fromkeys(name for of_trial in facts for name in of_trial)
    found = []
    for name in names:
        values = [of_trial.get(name) for of_trial in facts]
        if any(not _alike(value, values[0], name) for value in values[1:]):
            found.append({"what": name, "values": values})
    return found


def _alike(a: Any, b: Any, name: str) -> bool:
    if name.startswith("mean gain") and isinstance(a, float) and isinstance(b, float):
        return math.isclose(a, b, rel_tol=GAINS_DIFFER)
    return bool(a == b)


def _facts(results: Sequence[Result]) -> dict[str, Any]:
    """One flat table of what a trial was: dotted names and plain values."""
    origin = results[0].provenance
    facts = _flat("trial", {k: v for k, v in (origin.get("trial") or {}).items() if k != "name"})
    own = {k: v for k, v in (origin.get("settings") or {}).items() if k not in {"trial", "requirements", "logs"}}
    facts |= _flat("settings", own)
    for result in results:
        if result.analysis != "check":
            facts |= _flat(result.analysis, {k: v for k, v in result.settings.items() if k not in _NO_CHOICE})
    facts |= _flat("versions", origin.get("versions") or {})
    facts |= {f"input {kind}": value for kind, value in _inputs(origin).items()}
    groups = sorted({part for result in results if result.analysis == "accuracy" for row in result.rows if row.group
                     for part in row.group.split(", ") if part.startswith(("waveform ", "attenuation "))})  # fmt: skip
    facts |= {"waveforms and attenuator states": ", ".join(groups)} if groups else {}
    return facts | _mean_gains(results)


def _flat(prefix: str, values: Mapping[str, Any]) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat |= _flat(f"{prefix}.{name}", value)
        elif value not in (None, "", [], ()):
            flat[f"{prefix}.{name}"] = list(value) if isinstance(value, tuple) else value
    return flat


def _inputs(origin: Mapping[str, Any]) -> dict[str, str]:
    """The files of each kind of log, by name and the head of their SHA-256."""
    kinds: dict[str, list[str]] = {}
    for item in origin.get("inputs") or ():
        kinds.setdefault(str(item.get("kind")), []).append(f"{item.get('file')} ({str(item.get('sha256', ''))[:12]})")
    return {kind: ", ".join(sorted(files)) for kind, files in kinds.items()}


def _mean_gains(results: Sequence[Result]) -> dict[str, float]:
    """The mean gain of each axis over all bins."""
    gains: dict[str, float] = {}
    for name in _GAINS:
        pooled = [row for result in results for row in result.rows if row.group is None and row.track_id is None]
        rows = [row for row in pooled if row.quantity == name and math.isfinite(row.value)]
        if n := sum(row.n for row in rows):
            gains[f"mean gain {name}"] = sum(row.value * row.n for row in rows) / n
    return gains


def same_inputs(names: Sequence[str], trials: Sequence[Sequence[Result]]) -> Iterator[Problem]:
    """Trials made from the same files: a test between them means nothing, for their samples are the same ones."""
    hashes = [
        {str(i["sha256"]) for i in results[0].provenance.get("inputs") or ()
         if i.get("sha256") and i.get("kind") not in _NO_SAMPLES} for results in trials
    ]  # fmt: skip
    for i, j in combinations(range(len(trials)), 2):
        if shared := hashes[i] & hashes[j]:
            if hashes[i] == hashes[j]:
                reason = f"the same trial as {names[i]}: every file has the same SHA-256; the tests take them as two"
            else:
                reason = (
                    f"shares {len(shared)} of {len(hashes[j])} files with {names[i]} (same SHA-256); the tests take "
                    "their samples as independent"
                )
            yield Problem(names[j], reason)
        elif not hashes[i] and not hashes[j] and _rows(trials[i]) == _rows(trials[j]):
            yield Problem(names[j], f"the same estimates as {names[i]}, to the last digit: the same trial twice?")


def _rows(results: Sequence[Result]) -> list[str]:
    return [repr(row) for result in results for row in result.rows]
