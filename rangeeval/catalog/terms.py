"""What to look for in a catalogue."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Any

from rangeeval.errors import SettingsError, one_line


@dataclass(frozen=True)
class Terms:
    """What is looked for; what is not given does not matter.

    `radar`, `software`, `quantity` and `group` are patterns: `*` and `?` stand for any text and any character, case
    does not matter. Dates are ISO, ends included; a trial without a date is not in any span. `bin`: bins that lie
    inside [low, high), in the variable's SI unit. `trials`: names, paths, or beginnings of a SHA-256; any of them.
    """

    radar: str | None = None
    software: str | None = None
    since: str | None = None
    until: str | None = None
    quantity: str | None = None
    variable: str | None = None
    bin: tuple[float, float] | None = None
    group: str | None = None
    trials: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("since", "until"):
            value = getattr(self, name)
            if value is not None and not re.fullmatch(r"\d{4}(-\d\d(-\d\d)?)?", value):
                shown = one_line(value, 40)
                raise SettingsError(f"--{name} {shown}: expected a date such as 2026-05-14, or 2026-05, or 2026")
        if self.bin is not None and not self.bin[0] < self.bin[1]:
            raise SettingsError(f"--bin {self.bin[0]:g}:{self.bin[1]:g}: the low end must be below the high end")

    def only(self, sha256: str) -> Terms:
        """The same of one result."""
        return replace(self, trials=(sha256,))

    @property
    def of_result(self) -> tuple[str, list[Any]]:
        """The condition on table `result`, in SQL, and its values."""
        parts: list[str] = []
        values: list[Any] = []
        for column in ("radar", "software"):
            if (pattern := getattr(self, column)) is not None:
                parts.append(f"lower(result.{column}) GLOB ?")
                values.append(_glob(pattern))
        if self.since is not None:
            parts.append("result.date != '' AND substr(result.date, 1, 10) >= ?")
            values.append(self.since)
        if self.until is not None:  # 2026-05 takes in all its days
            parts.append("result.date != '' AND substr(result.date, 1, ?) <= ?")
            values += [len(self.until), self.until]
        if self.trials:
            one = "result.name = ? OR result.path = ? OR (length(?) >= 6 AND substr(result.sha256, 1, length(?)) = ?)"
            parts.append(" OR ".join([one] * len(self.trials)))
            values += [value for trial in self.trials for value in [trial] * 5]
        return _all_of(parts), values

    @property
    def of_what(self) -> tuple[str, list[Any]]:
        """The condition on table `what`, in SQL, and its values."""
        parts: list[str] = []
        values: list[Any] = []
        if self.quantity is not None:
            parts.append("lower(what.quantity) GLOB ?")
            values.append(_glob(self.quantity))
        if self.variable is not None:
            parts.append("what.variable = ?")
            values.append(self.variable)
        if self.bin is not None:
            parts.append("what.bin_low >= ? AND what.bin_high <= ?")
            values += self.bin
        if self.group is not None:
            parts.append("lower(what.grp) GLOB ?")
            values.append(_glob(self.group))
        return _all_of(parts), values


def _glob(pattern: str) -> str:
    """A pattern of SQLite's GLOB, in which only * and ? are special."""
    return pattern.lower().replace("[", "[[]")


def _all_of(parts: list[str]) -> str:
    return " AND ".join(f"({part})" for part in parts) or "1"
