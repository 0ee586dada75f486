"""What a report says and in which order: from results to a document of blocks.

`SECTIONS` lists, for each analysis, the function that lays out its chapter. An analysis without one gets its
headline table and its flags.
"""

from __future__ import annotations

import datetime
import importlib
from collections.abc import Callable, Sequence
from typing import Any

from rangeeval.model import Result
from rangeeval.reporting.blocks import Document, Figure, Notice, Section
from rangeeval.reporting.sections.common import inputs_section, plain_section, software_section, summary_section

SECTIONS: dict[str, str] = {
    "check": "rangeeval.reporting.sections.check:sections",
    "compare": "rangeeval.reporting.sections.compare:sections",
    "accuracy": "rangeeval.reporting.sections.accuracy:sections",
    "rcs": "rangeeval.reporting.sections.rcs:sections",
    "attitude": "rangeeval.reporting.sections.attitude:sections",
}

_EPOCH = datetime.datetime(1980, 1, 1, tzinfo=datetime.UTC)  # stamps files of a trial that gives no date


def compose(results: Sequence[Result]) -> Document:
    """The report on a trial: summary with verdicts, a chapter an analysis, what was read, how it was made."""
    about = results[0].provenance.get("trial", {})
    verdicts_first = sorted(results, key=lambda r: r.analysis != "check")
    chapters = [section for result in verdicts_first for section in _chapter(result)]
    words = (
        ("Radar", "radar"),
        ("Date of trial", "date"),
        ("Software under test", "software"),
        ("Notes", "description"),
    )
    meta = [(word, about.get(key, "")) for word, key in words]
    return Document(
        title=about.get("name") or "Trial",
        date=_date(about.get("date", "")),
        subtitle="Post-trial analysis",
        handling=about.get("handling", ""),
        meta=[(word, text) for word, text in meta if text],
        sections=[
            summary_section(results, _notice, _figure),
            *chapters,
            inputs_section(results),
            software_section(results),
        ],
    )


def _chapter(result: Result) -> list[Section]:
    where = SECTIONS.get(result.analysis)
    if where is None:
        return plain_section(result)
    module, name = where.split(":")
    layout: Callable[[Result], list[Section]] = getattr(importlib.import_module(module), name)
    return layout(result)


def _own(result: Result, name: str) -> Any:
    """What the section module of an analysis has under a name; None where it has nothing, or there is no module."""
    where = SECTIONS.get(result.analysis)
    return getattr(importlib.import_module(where.split(":")[0]), name, None) if where else None


def _notice(result: Result) -> Notice | None:
    """What a reader of the summary must know first of an analysis: `SUMMARY_NOTICE` of its section module, if any."""
    notice: Notice | None = _own(result, "SUMMARY_NOTICE")
    return notice


def _figure(result: Result) -> Figure | None:
    """The figure of an analysis that belongs on the summary: `summary_figure` of its section module, if any."""
    draw = _own(result, "summary_figure")
    return draw(result) if draw else None


def _date(text: str) -> datetime.datetime:
    try:
        return datetime.datetime.fromisoformat(text[:10]).replace(tzinfo=datetime.UTC)
    except ValueError:
        return _EPOCH
