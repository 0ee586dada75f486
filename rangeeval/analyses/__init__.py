"""The analyses: each takes a trial's columns, names quantities, and calls the floor below.

`ANALYSES` lists them all; an outside package adds its own through the entry-point group `rangeeval.analyses`.
"""

from __future__ import annotations

import importlib
import importlib.metadata
from collections.abc import Callable
from dataclasses import dataclass

from rangeeval.model import Result, Trial


@dataclass(frozen=True)
class Analysis:
    """An analysis: where its function is, the logs without which it has nothing to say, and its own options.

    The function is called with the trial, bins, `confidence`, `progress` and those attributes of a plan that `takes`
    names. `optional`: where its logs turn out to be of no use, a report goes on without it and says so.
    """

    function: str
    needs: tuple[str, ...]
    takes: tuple[str, ...] = ()
    optional: bool = False

    def load(self) -> Callable[..., Result]:
        """The function itself (imported now, not before it is needed)."""
        module, name = self.function.split(":")
        function: Callable[..., Result] = getattr(importlib.import_module(module), name)
        return function

    def applies_to(self, trial: Trial) -> bool:
        """Whether the trial holds the logs it needs."""
        return all(trial.of_kind(kind) for kind in self.needs)


ANALYSES: dict[str, Analysis] = {
    "accuracy": Analysis(
        "rangeeval.analyses.accuracy:accuracy", needs=("residuals",), takes=("estimator", "per_track")
    ),
    "rcs": Analysis("rangeeval.analyses.rcs:rcs", needs=("detections",), takes=("per_track",)),
    "attitude": Analysis("rangeeval.analyses.attitude:attitude", needs=("tilt",)),
    "bearing": Analysis("rangeeval.analyses.bearing:bearing", needs=("snapshots",)),
    "replay": Analysis(
        "rangeeval.analyses.replay:replay_for_report", needs=("plots",), takes=("per_track",), optional=True
    ),
    "truth": Analysis("rangeeval.analyses.truth:truth", needs=("plots", "truth"), takes=("per_track",), optional=True),
}


def all_analyses() -> dict[str, Analysis]:
    """Ours and those of installed packages: an entry point names a `module:ANALYSIS` holding an `Analysis`."""
    added = importlib.metadata.entry_points(group="rangeeval.analyses")
    return {**ANALYSES, **{point.name: point.load() for point in added}}
