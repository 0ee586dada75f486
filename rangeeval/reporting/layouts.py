"""What each analysis brings of its own to a page or a terminal; everything else is laid out by default.

`LAYOUTS` names the module of each analysis. All a module may hold, and what is done without it:

=================  =================================================  ==========================
name               what it is                                         default
=================  =================================================  ==========================
`NAME`             the analysis as a heading says it                  its name, capitalised
`HEADLINE`         the quantities of the short table                  the first four
`NOTE`             what a terminal says under the table, with the     nothing
                   result's settings put in
`SUMMARY_NOTICE`   what a reader of the summary must know first       nothing
`short_tables`     (result, caption, summary) -> tables               one of bins by quantities
`summary_figure`   result -> figure of the summary                    none
`sections`         result -> sections of the chapter                  the short table
=================  =================================================  ==========================
"""

from __future__ import annotations

import importlib
from typing import Any

LAYOUTS: dict[str, str] = {
    "check": "rangeeval.reporting.sections.check",
    "compare": "rangeeval.reporting.sections.compare",
    "accuracy": "rangeeval.reporting.sections.accuracy",
    "rcs": "rangeeval.reporting.sections.rcs",
    "attitude": "rangeeval.reporting.sections.attitude",
    "trend": "rangeeval.reporting.sections.trend",
    "bearing": "rangeeval.reporting.sections.bearing",
    "replay": "rangeeval.reporting.sections.replay",
    "truth": "rangeeval.reporting.sections.truth",
}


def own(analysis: str, name: str, default: Any = None) -> Any:
    """What the layout of an analysis holds under a name; the default where it holds nothing or there is none."""
    where = LAYOUTS.get(analysis)
    return getattr(importlib.import_module(where), name, default) if where else default


def heading(analysis: str) -> str:
    """An analysis as a heading says it."""
    name: str = own(analysis, "NAME", analysis.capitalize())
    return name
