"""A trial: the logs of one recorded run, with its settings."""

from __future__ import annotations

from dataclasses import dataclass, field

from rangeeval.errors import InputError
from rangeeval.model.settings import TrialSettings
from rangeeval.model.table import Log, Problem


@dataclass(frozen=True)
class Source:
    """A file that was read: its name inside the trial, where it is, what it was recognised as, and its size."""

    name: str
    path: str
    format: str
    kind: str
    size: int


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
