"""Synthetic trials with known answers, written as a trial folder that every command reads like a real one.

`SCENARIOS` lists them: the function that writes each takes the folder, a `seed`, and options of its own.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

SCENARIOS: dict[str, str] = {
    "alpha-beta": "rangeeval.scenarios.alpha_beta:simulate_alpha_beta",
    "attitude": "rangeeval.scenarios.attitude:simulate_attitude",
    "bearing": "rangeeval.scenarios.bearing:simulate_bearing",
    "imm": "rangeeval.scenarios.imm:simulate_imm",
    "swerling": "rangeeval.scenarios.swerling:simulate_swerling",
}


def scenario(name: str) -> Callable[..., list[Path]]:
    """The function that writes a scenario (KeyError when there is none of that name)."""
    module, function = SCENARIOS[name].split(":")
    found: Callable[..., list[Path]] = getattr(importlib.import_module(module), function)
    return found


def __getattr__(name: str) -> Any:
    for where in SCENARIOS.values():
        module, function = where.split(":")
        if function == name:
            return getattr(importlib.import_module(module), function)
    raise AttributeError(f"module 'rangeeval.scenarios' has no attribute '{name}'")
