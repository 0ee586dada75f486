"""Post-trial analysis of radar test-range logs, with an honest interval on every number.

`open_trial(path)` reads a trial; each analysis is a function of the name of its command that takes a trial and
returns a result with `.estimates`, `.to_json()` and `.plot()`; `report(trial, directory)` writes the report.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from rangeeval.analyses.accuracy import accuracy
    from rangeeval.analyses.attitude import attitude, correct_plots
    from rangeeval.analyses.bearing import bearing, bearing_tracks
    from rangeeval.analyses.rcs import rcs
    from rangeeval.analyses.replay import replay, run_replay
    from rangeeval.analyses.truth import truth
    from rangeeval.flow import check, compare, evaluate, report
    from rangeeval.model import Bins, Result, SensorArray, Trial, log_of
    from rangeeval.parsers import open_trial

# Imported when first asked for: `import rangeeval` costs nothing, and `rangeeval --help` answers at once.
_WHERE = {
    "open_trial": "rangeeval.parsers",
    "accuracy": "rangeeval.analyses.accuracy",
    "rcs": "rangeeval.analyses.rcs",
    "attitude": "rangeeval.analyses.attitude",
    "correct_plots": "rangeeval.analyses.attitude",
    "bearing": "rangeeval.analyses.bearing",
    "bearing_tracks": "rangeeval.analyses.bearing",
    "replay": "rangeeval.analyses.replay",
    "run_replay": "rangeeval.analyses.replay",
    "truth": "rangeeval.analyses.truth",
    "evaluate": "rangeeval.flow",
    "check": "rangeeval.flow",
    "compare": "rangeeval.flow",
    "report": "rangeeval.flow",
    "Bins": "rangeeval.model",
    "Result": "rangeeval.model",
    "SensorArray": "rangeeval.model",
    "Trial": "rangeeval.model",
    "log_of": "rangeeval.model",
}

__all__ = [
    "Bins",
    "Result",
    "SensorArray",
    "Trial",
    "accuracy",
    "attitude",
    "bearing",
    "bearing_tracks",
    "check",
    "compare",
    "correct_plots",
    "evaluate",
    "log_of",
    "open_trial",
    "rcs",
    "replay",
    "report",
    "run_replay",
    "truth",
]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'rangeeval' has no attribute '{name}'")
    return getattr(importlib.import_module(_WHERE[name]), name)
