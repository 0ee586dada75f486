"""A trial: the logs of one recorded run, with its settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rangeeval.errors import InputError
from rangeeval.model.kinds import KINDS, recognise
from rangeeval.model.settings import TrialSettings
from rangeeval.model.table import Log, Problem, log_of


@dataclass(frozen=True)
class Source:
    """A file that was read: its name inside the trial, where it is, what it was recognised as, and its size.

    `sha256` is empty until someone asks, unless an archive recorded it when the file was at hand.
    """

    name: str
    path: str
    format: str
    kind: str
    size: int
    sha256: str = ""


@dataclass(frozen=True)
class Trial:
    """One recorded run: logs, settings, the files they came from, and what was wrong with them.

    `problems` are those known before a row is read; reading a log piece by piece finds more.
    """

    name: str
    logs: tuple[Log, ...]
    settings: TrialSettings = field(default_factory=TrialSettings)
    sources: tuple[Source, ...] = ()
    problems: tuple[Problem, ...] = ()

    @property
    def title(self) -> str:
        """The name its settings give it, else that of its folder."""
        return self.settings.trial.name or self.name

    def of_kind(self, kind: str) -> tuple[Log, ...]:
        """The logs of one kind."""
        return tuple(log for log in self.logs if log.kind == kind)

    def log(self, kind: str) -> Log:
        """The one log of a kind. Raises InputError when there is none, naming what the trial holds."""
        logs = self.of_kind(kind)
        if not logs:
            held = ", ".join(sorted({log.kind for log in self.logs})) or "no log that was recognised"
            unread = "".join(f" ({p})" for p in self.problems[:3])
            raise InputError(
                f"no log of kind '{kind}' in {self.name}; it holds {held}{unread}. "
                f"'rangeeval inspect {self.name}' shows what was recognised"
            )
        if len(logs) > 1:
            names = ", ".join(log.source for log in logs)
            raise InputError(
                f"{self.name} holds {len(logs)} logs of kind '{kind}' ({names}); put each run in a folder of its own"
            )
        return logs[0]


def as_trial(source: Trial | Mapping[str, Any] | Any, settings: TrialSettings | None = None) -> Trial:
    """A trial as it is, or one made of plain tables: one table of columns, or tables by log kind.

    A table is a pandas DataFrame or a dict of sequences, in stored names and units (`range_residual_m`, ...).
    Raises InputError when it is neither, or when its columns are those of no kind of log.
    """
    if isinstance(source, Trial):
        return source
    if not hasattr(source, "keys"):
        raise InputError(f"expected a Trial or a table of columns, not {type(source).__name__}; open_trial reads files")
    names = list(map(str, source))
    if names and set(names) <= set(KINDS):
        logs = tuple(log_of(kind, source[kind], kind) for kind in names)
    else:
        kind = recognise(names)
        if kind is None:
            raise InputError(f"these columns are of no kind of log: {', '.join(names[:8])}")
        logs = (log_of(kind.name, source, kind.name),)
    return Trial("table", logs, settings or TrialSettings())
