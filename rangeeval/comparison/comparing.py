"""Trials against a reference: every common bin and quantity tested, and a verdict each."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Any, Literal

import numpy as np

from rangeeval.comparison.circumstances import Place, by_place, place_of, unlike
from rangeeval.comparison.configuration import differences, same_inputs
from rangeeval.comparison.rules import Rule, compared, rule_of
from rangeeval.errors import InputError, SettingsError, did_you_mean, one_line
from rangeeval.model import Estimate, Problem, Result, gather
from rangeeval.stats.comparison import (
    Contrast,
    Difference,
    ShareDifference,
    Sides,
    SigmaRatio,
    benjamini_hochberg,
    growth_to,
    holm,
    p_equivalent,
    p_value,
)

ADJUSTMENTS = {"holm": holm, "bh": benjamini_hochberg}
EVERYTHING = "all"

Key = tuple[str, Place]
"""Quantity and place."""


@dataclass(frozen=True)
class Method:
    """How to compare.

    `margin`: ratios from 1 / (1 + margin) to 1 + margin are equivalent, and so are differences of shares up to `margin`
    and of levels up to the same ratio; `margins`: of single quantities, in their unit where they are differences.
    `quantities`: patterns of names; none: the main ones of `rules.RULES`; `all`: every one with an interval.
    """

    confidence: float = 0.95
    margin: float = 0.1
    margins: Mapping[str, float] = field(default_factory=dict)
    adjust: Literal["holm", "bh"] = "holm"
    quantities: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 < self.confidence < 1.0:
            raise SettingsError(f"confidence is {self.confidence:g}, expected more than 0 and less than 1")
        if self.adjust not in ADJUSTMENTS:
            raise SettingsError(f"adjustment '{self.adjust}' is not known; {did_you_mean(self.adjust, ADJUSTMENTS)}")
        for name, margin in {"": self.margin, **self.margins}.items():
            if not (margin > 0.0 and math.isfinite(margin)):
                raise SettingsError(f"margin{f' of {name}' if name else ''} is {margin:g}, expected more than 0")

    def chooses(self, quantity: str, unit: str) -> bool:
        """Whether a quantity is compared."""
        if not self.quantities:
            return compared(quantity) and rule_of(quantity, unit).main
        if EVERYTHING in self.quantities:
            return compared(quantity)
        return any(fnmatchcase(quantity, name) for name in self.quantities)

    def equivalent_within(self, quantity: str, unit: str, rule: Rule) -> tuple[float, float] | None:
        """The effects that count as equal; None where no margin is stated for a difference in its own unit."""
        own = self.margins.get(quantity)
        if rule.measure == "ratio":
            top = 1.0 + (self.margin if own is None else own)
            return 1.0 / top, top
        if own is None:
            own = self.margin if rule.share else 10.0 * math.log10(1.0 + self.margin) if unit == "dB" else None
        return None if own is None else (-own, own)


@dataclass(frozen=True)
class _Tested:
    """One quantity in one bin of two trials, before the p values are adjusted."""

    key: Key
    rule: Rule
    reference: Estimate
    other: Estimate
    trial: str
    contrast: Contrast | None
    within: tuple[float, float] | None
    unlike: tuple[str, ...] = ()

    @property
    def null(self) -> float:
        return 1.0 if self.rule.measure == "ratio" else 0.0

    @property
    def p(self) -> float:
        return p_value(self.contrast, self.null) if self.contrast else math.nan

    @property
    def p_equivalent(self) -> float:
        return p_equivalent(self.contrast, *self.within) if self.contrast and self.within else math.nan


def compare(trials: Sequence[Sequence[Result]], method: Method | None = None) -> Result:
    """Every common bin and quantity of trials against the first one, the reference.

    Parameters
    ----------
    trials : the results of each trial, fresh, archived or from a `results.json`.

    Returns
    -------
    A row a quantity, bin and trial. `value`, `low`, `high` are the `ratio` or the `difference` (column `measure`)
    to the reference; the further columns are those of docs/reference/quantities.md#compare.

    Raises
    ------
    InputError : fewer than two trials, a trial without results, or nothing that all have in common.
    """
    method = method or Method()
    if len(trials) < 2:
        raise InputError(f"{len(trials)} trial given; a comparison needs two or more")
    names = _names(trials)
    for name, results in zip(names, trials, strict=True):
        if not any(result.rows for result in results):
            raise InputError(f"{name}: holds no estimates, so there is nothing to compare")
    tables = [_table(results, method) for results in trials]
    places = [by_place(results) for results in trials]
    _check_names(method, trials)
    problems = list(same_inputs(names, trials))
    tests: list[_Tested] = []
    for name, results, table, rows in zip(names[1:], trials[1:], tables[1:], places[1:], strict=True):
        problems += _unmatched(names[0], tables[0], name, table)
        confidences = _confidences(trials[0]), _confidences(results)
        found, said = _tests(tables[0], table, name, method, confidences)
        tests += [replace(test, unlike=_unlike(test.key, places[0], rows)) for test in found]
        problems += said
    if not tests:
        raise InputError(_nothing_common(names, tables, problems))
    order = {key: i for i, key in enumerate(tables[0])}
    place = {name: i for i, name in enumerate(names)}
    tests.sort(key=lambda t: (order[t.key], place[t.trial]))
    judged = tuple(_judged(tests, method, names[0]))
    settings = {
        "confidence": method.confidence,
        "adjust": method.adjust,
        "margin": method.margin,
        "margins": dict(method.margins),
        "quantities": list(method.quantities),
        "trials": names,
        "reference": names[0],
        "tests": sum(1 for t in tests if t.contrast),
        "differences": differences(trials),
    }
    every = (*problems, *(p for results in trials for result in results for p in result.problems))
    return Result("compare", judged, settings, gather(list(dict.fromkeys(every))), provenance=_origin(names, trials))


def _names(trials: Sequence[Sequence[Result]]) -> list[str]:
    """A name for each trial: its own words, numbered where two are the same."""
    own = [str((results[0].provenance.get("trial") or {}).get("name") or "trial") if results else "trial"
           for results in trials]  # fmt: skip
    return [name if own.count(name) == 1 else f"{name} [{i}]" for i, name in enumerate(own, start=1)]


def _table(results: Sequence[Result], method: Method) -> dict[Key, Estimate]:
    """The rows that can be compared: of all samples together, and of groups where a quantity has no such row."""
    found: dict[Key, Estimate] = {}
    for result in results:
        if result.analysis in {"check", "compare"}:
            continue
        units = {row.quantity: row.unit for row in result.rows}
        chosen = {quantity for quantity, unit in units.items() if method.chooses(quantity, unit)}
        pooled = {row.quantity for row in result.rows if row.group is None and row.track_id is None}
        for row in result.rows:
            together = row.group is None or row.quantity not in pooled
            if row.quantity in chosen and together and row.track_id is None:
                found[row.quantity, place_of(result.analysis, row)] = row
    return found


def _check_names(method: Method, trials: Sequence[Sequence[Result]]) -> None:
    """A quantity asked for must be there."""
    known = {row.quantity for results in trials for result in results for row in result.rows}
    for name in (*method.quantities, *method.margins):
        if name != EVERYTHING and not any(fnmatchcase(quantity, name) for quantity in known):
            raise SettingsError(f"no trial has a quantity '{one_line(name, 60)}'; {did_you_mean(name, known)}")


def _confidences(results: Sequence[Result]) -> dict[str, float]:
    return {result.analysis: float(result.settings.get("confidence") or 0.95) for result in results}


def _tests(
    reference: Mapping[Key, Estimate], other: Mapping[Key, Estimate], trial: str, method: Method,
    confidences: tuple[Mapping[str, float], Mapping[str, float]],
) -> tuple[list[_Tested], list[Problem]]:  # fmt: skip
    """Each row that both trials have, and what stood in the way of the others."""
    tests: list[_Tested] = []
    units: dict[str, str] = {}
    rules = {a.quantity: rule_of(a.quantity, a.unit) for a in reference.values()}
    for key, a in reference.items():
        b = other.get(key)
        if b is None:
            continue
        if a.unit != b.unit:
            units[a.quantity] = f"{a.quantity} is in '{b.unit}' here and in '{a.unit}' in the reference; not compared"
            continue
        rule = rules[a.quantity]
        contrast = _contrast(a, b, rule, *(c.get(_analysis(key), 0.95) for c in confidences))
        asked = method.quantities and EVERYTHING not in method.quantities
        if contrast is None and not asked and not _interval(a, b):
            continue
        within = method.equivalent_within(a.quantity, a.unit, rule)
        tests.append(_Tested(key, rule, a, b, trial, contrast, within))
    return tests, [Problem(trial, reason) for reason in units.values()]


def _unlike(
    key: Key, reference: Mapping[Place, Mapping[str, Estimate]], other: Mapping[Place, Mapping[str, Estimate]]
) -> tuple[str, ...]:
    """What else was not alike there."""
    quantity, place = key
    return tuple(dict.fromkeys(unlike(quantity, reference[place], other[place])))


def _interval(*rows: Estimate) -> bool:
    return any(math.isfinite(row.low) or math.isfinite(row.high) for row in rows)


def _contrast(a: Estimate, b: Estimate, rule: Rule, confidence_a: float, confidence_b: float) -> Contrast | None:
    """By the quantity's own theory where it has one, else from the intervals; None where an estimate is missing."""
    if rule.share and a.n and b.n and "detections" in a.extra and "detections" in b.extra:
        counts = []
        for row in (a, b):
            n = row.n_eff if 0 < row.n_eff < row.n else float(row.n)
            counts += [row.value * n, n]
        return ShareDifference(*counts)
    nu = [_number(row.extra.get("nu")) for row in (a, b)]
    if rule.measure == "ratio" and not (a.value > 0 and b.value > 0):
        return None
    if rule.measure == "ratio" and all(v > 0 for v in nu):
        return SigmaRatio(a.value, nu[0], b.value, nu[1])
    if not all(math.isfinite(v) for row in (a, b) for v in (row.value, row.low, row.high)):
        return None
    logarithmic = rule.measure == "ratio"
    sides = [
        _sides(row, confidence, freedom, logarithmic=logarithmic)
        for row, confidence, freedom in ((a, confidence_a, nu[0]), (b, confidence_b, nu[1]))
    ]
    return Difference(sides[0], sides[1], logarithmic)


def _sides(row: Estimate, confidence: float, nu: float, *, logarithmic: bool) -> Sides:
    value, low, high = row.value, row.low, row.high
    if logarithmic:
        value, low, high = (math.log(v) if v > 0 else -math.inf for v in (value, low, high))
    freedom = nu if nu > 0 else row.n_eff - 1.0
    return Sides.of(value, low, high, confidence, max(freedom, 1.0) if math.isfinite(freedom) else math.inf)


def _number(value: Any) -> float:
    return float(value) if isinstance(value, (int, float)) else math.nan


def _judged(tests: Sequence[_Tested], method: Method, reference: str) -> Iterator[Estimate]:
    """The rows with their p values adjusted over all of them, and their verdicts."""
    level = 1.0 - method.confidence
    adjust = ADJUSTMENTS[method.adjust]
    p = np.array([t.p for t in tests])
    equal = np.array([t.p_equivalent for t in tests])
    adjusted, equal = adjust(p), adjust(equal)
    count = int(np.count_nonzero(np.isfinite(p)))
    for test, raw, of_all, same in zip(tests, p.tolist(), adjusted.tolist(), equal.tolist(), strict=True):
        differs = of_all <= level
        verdict = "equivalent" if same <= level else _direction(test, of_all, raw, level) if differs else "inconclusive"
        yield _row(test, method, reference, {
            "p_value": raw, "p_adjusted": of_all, "p_equivalent": same, "differs": differs, "verdict": verdict,
            "more_samples": _more(test, level / max(count, 1)) if verdict == "inconclusive" and not differs else 0,
        })  # fmt: skip


def _direction(test: _Tested, adjusted: float, raw: float, level: float) -> str:
    """Which way a difference goes; one of a quantity that has no good side is no verdict."""
    a, b = test.reference.value, test.other.value
    if test.rule.better == "smaller":
        return "better" if b < a else "worse"
    if test.rule.better == "larger":
        return "better" if b > a else "worse"
    if test.rule.better == "nearer zero" and isinstance(test.contrast, Difference):
        # |b| < |a| when b - a and b + a have opposite signs, so both must be told from zero.
        total = Difference(_turned(test.contrast.a), test.contrast.b)
        if p_value(total, 0.0) * max(adjusted / raw if raw > 0 else 1.0, 1.0) <= level:
            return "better" if abs(b) < abs(a) else "worse"
    return "inconclusive"


def _turned(sides: Sides) -> Sides:
    return replace(sides, value=-sides.value, down=sides.up, up=sides.down)


def _more(test: _Tested, level: float) -> int | None:
    """How many more samples each trial needs until the test decides, if the estimates stay; None: no number does."""
    contrast, within = test.contrast, test.within
    if contrast is None:
        return None

    def decided(c: Contrast) -> bool:
        return p_value(c, test.null) <= level or (within is not None and p_equivalent(c, *within) <= level)

    times = growth_to(contrast, decided)
    most = max(test.reference.n, test.other.n)
    return math.ceil((times - 1.0) * most) if math.isfinite(times) and most else None


def _row(test: _Tested, method: Method, reference: str, extra: Mapping[str, Any]) -> Estimate:
    a, b, contrast = test.reference, test.other, test.contrast
    effect, low, high = math.nan, math.nan, math.nan
    if contrast is not None:
        effect, (low, high) = contrast.effect, contrast.interval(method.confidence)
    elif test.rule.measure == "difference":
        effect = b.value - a.value
    elif a.value:
        effect = b.value / a.value
    return Estimate(
        quantity=a.quantity,
        unit="1" if test.rule.measure == "ratio" else a.unit,
        value=effect,
        low=low,
        high=high,
        n=a.n + b.n,
        n_eff=a.n_eff + b.n_eff,
        variable=a.variable,
        bin_low=a.bin_low,
        bin_high=a.bin_high,
        track_id=a.track_id,
        group=a.group,
        flags=tuple(dict.fromkeys((*test.unlike, *a.flags, *b.flags))),
        extra={
            "analysis": _analysis(test.key),
            "measure": test.rule.measure,
            "trial": test.trial,
            "reference": reference,
            **extra,
            "of_unit": a.unit,
            **{f"{which}_{name}": getattr(row, name) for which, row in (("reference", a), ("trial", b))
               for name in ("value", "low", "high", "n", "n_eff")},
        },
    )  # fmt: skip


# --- what could not be compared ---------------------------------------------------------------------------------------


def _analysis(key: Key) -> str:
    return key[1][0]


def _place(key: Key) -> str:
    """A bin in words, in stored units."""
    _, (_, variable, low, high, group, _) = key
    words = "the whole trial" if variable is None or math.isinf(low) else f"{variable} {low:g} to {high:g}"
    return f"{words} ({group})" if group else words


def _unmatched(
    reference: str, of_reference: Mapping[Key, Estimate], trial: str, of_trial: Mapping[Key, Estimate]
) -> Iterator[Problem]:
    """Bins that only one of two trials has."""
    for name, own, others in ((reference, of_reference, of_trial), (trial, of_trial, of_reference)):
        other = trial if name == reference else reference
        places: dict[str, list[str]] = {}
        there = {(_analysis(key), _place(key)) for key in others}
        for key in own:
            analysis = _analysis(key)
            if (analysis, _place(key)) not in there and _place(key) not in places.setdefault(analysis, []):
                places[analysis].append(_place(key))
        for analysis, found in places.items():
            if found:
                shown = ", ".join(found[:8]) + (f" and {len(found) - 8} more" if len(found) > 8 else "")
                yield Problem(name, f"{analysis}: bins that {other} does not have: {shown}; not compared")


def _nothing_common(names: Sequence[str], tables: Sequence[Mapping[Key, Estimate]], problems: Sequence[Problem]) -> str:
    held = [sorted({_analysis(key) for key in table}) for table in tables]
    if not set(held[0]).intersection(*held[1:]):
        each = "; ".join(
            f"{name} has {', '.join(h) or 'nothing to compare'}" for name, h in zip(names, held, strict=True)
        )
        return f"the trials have no analysis in common: {each}"
    said = "; ".join(str(p) for p in problems[:3])
    return f"the trials have nothing in common that can be compared{f': {said}' if said else ''}"


def _origin(names: Sequence[str], trials: Sequence[Sequence[Result]]) -> dict[str, Any]:
    """Where the numbers come from: the trials' inputs together, the strictest handling that any names, versions."""
    origins = [results[0].provenance for results in trials]
    about = [origin.get("trial") or {} for origin in origins]
    return {
        "trial": {
            "name": f"{' and '.join(names[1:])} against {names[0]}",
            "date": max((str(a.get("date") or "") for a in about), default=""),
            "handling": " / ".join(dict.fromkeys(str(a["handling"]) for a in about if a.get("handling"))),
        },
        "inputs": [
            {**item, "file": f"{name}: {item.get('file', '')}"}
            for name, origin in zip(names, origins, strict=True) for item in origin.get("inputs", ())
        ],
        "versions": origins[0].get("versions", {}),
    }  # fmt: skip
