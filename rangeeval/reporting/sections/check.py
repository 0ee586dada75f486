"""The chapter on requirements: every verdict with the bound behind it."""

from __future__ import annotations

from rangeeval.model import Result
from rangeeval.reporting.blocks import Paragraph, Section, Table
from rangeeval.reporting.tables import verdict_table
from rangeeval.reporting.wording import in_shown_unit, quantity_name

NAME = "Requirements"
NOTE = "All bins: the verdict at the level that holds for all bins of the requirement together (Bonferroni)."


def short_tables(result: Result, caption: str, *, summary: bool = False) -> list[Table]:
    """What a terminal shows: every verdict."""
    return [verdict_table(result, caption=caption)]


def sections(result: Result) -> list[Section]:
    """What was required, and what the samples demonstrate of it."""
    blocks: list[Paragraph] = []
    for number, r in enumerate(result.settings["requirements"], start=1):
        unit = next((row.unit for row in result.rows if row.extra["requirement"] == number), "")
        when = ", ".join(f"{k} = {v:g}" for k, v in r["when"].items())
        blocks.append(Paragraph(
            f"{number}. {r['name'] or 'Requirement'}: {quantity_name(r['quantity'])} at most "
            f"{in_shown_unit(r['limit'], unit)} "
            f"with {r['confidence'] * 100:g} % confidence{f', where {when}' if when else ''}."
        ))  # fmt: skip
    method = Paragraph(
        "A bin passes when the one-sided upper bound of sigma is within the limit and fails when the lower bound is "
        "beyond "
        "it; anything else is inconclusive: the data do not decide. Whether the target manoeuvred is not known, so a "
        "bin "
        "passes or fails only if it does so both by the noise-only and by the optimal-gain ratio. “All bins” judges "
        "each bin at the level at which all bins of the requirement hold together (Bonferroni). “More samples” is "
        "how many more would decide if sigma stays as it is."
    )
    return [Section(NAME, [*blocks, method, verdict_table(result, caption="Verdicts")], key="requirements")]
