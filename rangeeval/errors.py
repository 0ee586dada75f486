"""What can go wrong, and how it is worded: where, what was found, what was expected, what to do.

Every error a user can meet is a `RangeevalError` whose text is one line. The command line prints that line and
exits with 1; nothing else in the package prints or exits.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class RangeevalError(Exception):
    """The base of every error that is the input's or the machine's, not the program's. One line of text."""


class InputError(RangeevalError):
    """A log or a file cannot be used as it is."""


class SettingsError(RangeevalError):
    """A setting in `trial.toml` or an argument is unknown or impossible."""


class MissingExtra(RangeevalError):
    """An optional package is not installed."""

    def __init__(self, purpose: str, extra: str) -> None:
        super().__init__(f"{purpose} needs an optional package: pip install 'rangeeval[{extra}]'")
        self.extra = extra


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Say which known name is nearest to an unknown one, or list them when none is near."""
    names = sorted(known)
    near = difflib.get_close_matches(name, names, n=1, cutoff=0.5)
    return f"did you mean '{near[0]}'?" if near else f"known: {', '.join(names)}"


def one_line(text: object, limit: int = 300) -> str:
    """Text of unknown origin made safe for one terminal line: control characters escaped, length cut.

    Log and trial names are never trusted: an escape sequence in one must not reach the terminal.
    """
    shown = "".join(c if c.isprintable() else repr(c)[1:-1] for c in str(text)[: limit + 1])
    return shown if len(shown) <= limit else shown[: limit - 1] + "…"
