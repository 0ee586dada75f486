"""What the columns of a file mean: written names to stored names, the unit each declares, and the kind of log."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from rangeeval.errors import InputError, SettingsError, did_you_mean, one_line
from rangeeval.model import KINDS, LogKind, Problem, recognise
from rangeeval.units import Unit, spellings


@dataclass(frozen=True)
class Field:
    """One column that is read: where it stands in the file, its written and stored names, and its unit."""

    position: int
    written: str
    name: str
    unit: Unit
    text: bool


@dataclass(frozen=True)
class Layout:
    """The columns of a file that belong to its kind of log, and what was set aside."""

    kind: str
    fields: tuple[Field, ...]
    problems: tuple[Problem, ...] = ()


def _spelled(kind: LogKind) -> dict[str, tuple[str, Unit, bool]]:
    known: dict[str, tuple[str, Unit, bool]] = {}
    for column in kind.columns:
        if column.wide:  # an array a row stands in no table of columns
            continue
        names = {column.name: Unit("", "1")} if column.text else spellings(column.name, column.unit)
        for written, unit in names.items():
            known[written] = (column.name, unit, column.text)
    return known


_SPELLED = {name: _spelled(kind) for name, kind in KINDS.items()}
_ALL = {written: meaning for known in _SPELLED.values() for written, meaning in known.items()}


def plain(name: str) -> str:
    """A column's name as it is compared: trimmed, without regard to case."""
    return name.strip().strip("\ufeff").casefold()


def known(names: Iterable[str]) -> int:
    """How many of these written names are columns of some kind of log."""
    return sum(plain(name) in _ALL for name in names)


def _stem_of(name: str, kind: LogKind) -> str | None:
    """The stored column that a name with a wrong or no unit means; None when it is not near any."""
    best: str | None = None
    for column in kind.columns:
        if column.text or column.unit == "1":
            continue
        stem = column.name.removesuffix(f"_{column.unit}")
        ending = name.removeprefix(stem)
        if (name == stem or (name.startswith(f"{stem}_") and "_" not in ending[1:])) and (
            best is None or len(column.name) > len(best)
        ):
            best = column.name
    return best


def _units_of(name: str, kind: LogKind) -> str:
    column = kind.column(name)
    endings = [f"_{unit.ending}" for unit in spellings(column.name, column.unit).values() if unit.ending]
    return ", ".join(sorted(endings))


def _kind_of(names: Sequence[str], hint: str | None) -> LogKind | None:
    if hint is not None:
        return KINDS[hint]
    found = recognise(_ALL[name][0] for name in names if name in _ALL)
    if found is not None:
        return found
    stems = {stem for kind in KINDS.values() for name in names if (stem := _stem_of(name, kind))}
    return recognise(stems)


def no_column(written: str, names: Sequence[str], where: str) -> SettingsError:
    """The error about a column that `trial.toml` names and the file does not have."""
    near = did_you_mean(written, [one_line(name.strip(), 60) for name in names])
    return SettingsError(f"{where}: has no column '{one_line(written, 60)}', which trial.toml names; {near}")


def _renamed(names: Sequence[str], columns: Mapping[str, str], where: str) -> list[str]:
    """The names after `[[logs]] columns`; a name given as '' is left out."""
    renamed = [plain(name) for name in names]
    for written, meant in columns.items():
        places = [i for i, name in enumerate(names) if plain(name) == plain(written)]
        if not places:
            raise no_column(written, names, where)
        if meant and plain(meant) not in _ALL:
            near = difflib.get_close_matches(plain(meant), _ALL, n=1, cutoff=0.5)
            raise SettingsError(
                f"{where}: trial.toml says column '{one_line(written, 60)}' is '{one_line(meant, 60)}', "
                f"which no kind of log has" + (f"; did you mean '{near[0]}'?" if near else "")
            )
        for i in places:
            renamed[i] = plain(meant)
    return renamed


def lay_out(
    names: Sequence[str], where: str, kind: str | None = None, columns: Mapping[str, str] | None = None
) -> Layout | None:
    """Find the kind of log these written names make, and what each column means; None when they make none.

    `kind` and `columns` (written name to known name, '' to leave one out) are what `trial.toml` says. Raises InputError
    for a name given twice, two columns of one meaning, a wrong or missing unit, or a missing column.
    """
    columns = columns or {}
    meant = _renamed(names, columns, where)
    definition = _kind_of(meant, kind)
    if definition is None:
        return None
    left_out = {plain(written) for written, name in columns.items() if not name}
    spelled = _SPELLED[definition.name]
    fields: dict[str, Field] = {}
    seen: dict[str, int] = {}
    strangers: list[tuple[str, str]] = []
    for i, (written, name) in enumerate(zip(names, meant, strict=True)):
        shown = one_line(written.strip(), 60)
        if plain(written) in left_out:
            continue
        if name and name in seen:
            raise InputError(f"{where}: the header names '{shown}' twice (columns {seen[name] + 1} and {i + 1})")
        seen[name] = i
        if name not in spelled:
            strangers.append((name, shown))
            continue
        stored, unit, text = spelled[name]
        if stored in fields:
            raise InputError(
                f"{where}: both '{one_line(fields[stored].written, 60)}' and '{shown}' give {stored}; keep one"
            )
        fields[stored] = Field(i, written.strip(), stored, unit, text)
    for name, shown in strangers:
        stem = _stem_of(name, definition)
        if stem is not None and stem not in fields:
            raise InputError(
                f"{where}: the unit of column '{shown}' is not known; {stem} may end in {_units_of(stem, definition)}"
            )
    if lacking := definition.missing(fields):
        given = ", ".join(one_line(name.strip(), 60) for name in names[:20])
        raise InputError(f"{where}: a {definition.name} log needs the column {lacking[0]}; the file has {given}")
    return Layout(definition.name, tuple(fields.values()), _unknown(strangers, definition, where))


def _unknown(strangers: Sequence[tuple[str, str]], kind: LogKind, where: str) -> tuple[Problem, ...]:
    problems = []
    for name, shown in strangers:
        near = difflib.get_close_matches(name, _SPELLED[kind.name], n=1, cutoff=0.6)
        hint = f"; did you mean '{near[0]}'?" if near else ""
        problems.append(
            Problem(where, f"column '{shown}' is not one of a {kind.name} log and is not read{hint}")
            if shown
            else Problem(where, "a column without a name is not read")
        )
    return tuple(problems)
