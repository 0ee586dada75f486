"""What a report says and in which order: from results to a document of blocks."""

from __future__ import annotations

import datetime
from collections.abc import Sequence

from rangeeval.model import Result
from rangeeval.reporting.blocks import Document
from rangeeval.reporting.layouts import own
from rangeeval.reporting.sections.common import inputs_section, plain_section, software_section, summary_section

_EPOCH = datetime.datetime(1980, 1, 1, tzinfo=datetime.UTC)  # stamps files of a trial that gives no date


def compose(results: Sequence[Result]) -> Document:
    """The report on a trial: summary with verdicts, a chapter an analysis, what was read, how it was made."""
    about = results[0].provenance.get("trial", {})
    verdicts_first = sorted(results, key=lambda r: r.analysis != "check")
    chapters = [
        section for result in verdicts_first for section in own(result.analysis, "sections", plain_section)(result)
    ]
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
            summary_section(results),
            *chapters,
            inputs_section(results),
            software_section(results),
        ],
    )


def _date(text: str) -> datetime.datetime:
    try:
        return datetime.datetime.fromisoformat(text[:10]).replace(tzinfo=datetime.UTC)
    except ValueError:
        return _EPOCH
