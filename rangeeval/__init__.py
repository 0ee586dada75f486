"""Post-trial analysis of radar test-range logs, with an honest interval on every number."""

from __future__ import annotations

from typing import Any

__version__ = "0.1.0"

# What the package offers by name; each is imported when it is first asked for, so that `import rangeeval` is quick.
_OFFERED = {
    "open_trial": "rangeeval.parsers",
}


def __getattr__(name: str) -> Any:
    if name not in _OFFERED:
        raise AttributeError(f"module 'rangeeval' has no attribute '{name}'")
    from importlib import import_module

    return getattr(import_module(_OFFERED[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_OFFERED])
