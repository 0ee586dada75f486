"""Requirements: was each one met in each bin, at which confidence, and how much data would tell.

Only the tidy table is read, so an archive or `results.json` is judged just like a fresh trial.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rangeeval.errors import SettingsError, did_you_mean
from rangeeval.model import Estimate, Problem, Result
from rangeeval.model.settings import Requirement
from rangeeval.stats.intervals import family_wise_confidence, further_samples, sigma_lower_bound, sigma_upper_bound

# Whether the target manoeuvred is not known, so a requirement on a sigma is met only if it is met by both gain ratios
# (noise only and optimal gains), and broken only if it is broken by both.
_OTHER_RATIO = {f"{name}_sigma": f"{name}_sigma_white" for name in ("range", "y", "z", "elevation", "azimuth")}


@dataclass(frozen=True)
class _Bounds:
    """One-sided bounds of a quantity at a confidence."""

    lower: float
    upper: float

    def verdict(self, limit: float) -> str:
        if self.upper <= limit:
            return "pass"
        return "fail" if self.lower > limit else "inconclusive"


def _bounds(rows: Sequence[Estimate], confidence: float) -> _Bounds:
    """The bounds that hold whichever of the rows is the right one."""
    lower = [float(sigma_lower_bound(r.value, r.extra["nu"], confidence)) for r in rows]
    upper = [float(sigma_upper_bound(r.value, r.extra["nu"], confidence)) for r in rows]
    if any(math.isnan(v) for v in lower + upper):
        return _Bounds(math.nan, math.nan)
    return _Bounds(min(lower), max(upper))


def check(judged: Sequence[tuple[Requirement, Result]]) -> Result:
    """Judge each requirement on the estimates of the samples it speaks of.

    Parameters
    ----------
    judged : each requirement with a result whose rows come from the samples its `when` selects.

    Returns
    -------
    A row a requirement and bin (all samples of the bin together) with further columns: `requirement` (its number),
    `limit`, `confidence`, `verdict`, `bound` (the one-sided bound that decided, or the upper one when none did),
    `more_samples` (how many more would decide if sigma stays as it is; null when decided or never) and
    `family_verdict` (at the confidence that makes all bins of the requirement hold together: Bonferroni).

    Raises
    ------
    SettingsError : a requirement names a quantity that no sigma row has.
    """
    rows: list[Estimate] = []
    problems: list[Problem] = []
    for number, (requirement, result) in enumerate(judged, start=1):
        found = list(_judged(number, requirement, result))
        empty = sum(1 for r in found if r.n == 0)
        if empty:
            reason = f"requirement {number}: {empty} bins hold no sample that it speaks of; they are not judged"
            problems.append(Problem("trial.toml", reason))
        rows += [r for r in found if r.n]
    settings = {
        "requirements": [
            {
                "quantity": r.quantity,
                "limit": r.limit,
                "confidence": r.confidence,
                "when": dict(r.when),
                "name": r.name,
            }
            for r, _ in judged
        ]
    }
    return Result("check", tuple(rows), settings, tuple(problems))


def _judged(number: int, requirement: Requirement, result: Result) -> Iterator[Estimate]:
    pooled = [r for r in result.rows if r.group is None and r.track_id is None and "nu" in r.extra]
    judged = [r for r in pooled if r.quantity == requirement.quantity]
    if not judged:
        known = {r.quantity for r in pooled}
        raise SettingsError(
            f"trial.toml: requirements[{number - 1}].quantity '{requirement.quantity}' cannot be judged; "
            f"{did_you_mean(requirement.quantity, known)}"
        )
    beside = {(r.bin_low, r.bin_high): r for r in pooled if r.quantity == _OTHER_RATIO.get(requirement.quantity, "")}
    counted = sum(1 for r in judged if r.n)
    family = family_wise_confidence(requirement.confidence, max(counted, 1))
    for row in judged:
        rows = [row, *(other for key, other in beside.items() if key == (row.bin_low, row.bin_high))]
        bounds = _bounds(rows, requirement.confidence)
        verdict = bounds.verdict(requirement.limit)
        extra: dict[str, Any] = {
            "requirement": number,
            "limit": requirement.limit,
            "confidence": requirement.confidence,
            "verdict": verdict,
            "bound": bounds.lower if verdict == "fail" else bounds.upper,
            "more_samples": _more_samples(rows, requirement) if verdict == "inconclusive" else 0,
            "family_verdict": _bounds(rows, family).verdict(requirement.limit),
        }
        yield replace(row, extra=extra)


def _more_samples(rows: Sequence[Estimate], requirement: Requirement) -> int | None:
    """How many more samples would decide; None when no number would (no estimate, or the two ratios disagree)."""
    if len({r.value > requirement.limit for r in rows}) > 1:
        return None
    wanted = [further_samples(r.value, r.extra["nu"], r.n, requirement.limit, requirement.confidence) for r in rows]
    return math.ceil(max(wanted)) if all(math.isfinite(w) for w in wanted) else None
