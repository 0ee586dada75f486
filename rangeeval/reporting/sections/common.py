"""The chapters every report has: the summary, what was read and set aside, and what it was made with."""

from __future__ import annotations

from collections.abc import Sequence

from rangeeval.model import Problem, Result, gather
from rangeeval.reporting.blocks import Block, Cell, Notice, Paragraph, Section, Table
from rangeeval.reporting.layouts import heading, own
from rangeeval.reporting.tables import pooled, short_tables, verdict_table
from rangeeval.reporting.wording import FLAGS


def summary_section(results: Sequence[Result]) -> Section:
    """Verdicts first, then of every analysis its notice, its headline numbers and its figure, where it has them."""
    blocks: list[Block] = []
    for result in results:
        if result.analysis == "check":
            blocks += [*verdict_notices(result)]
    for result in results:
        if result.analysis == "check":
            continue
        notice, figure = (own(result.analysis, name) for name in ("SUMMARY_NOTICE", "summary_figure"))
        blocks += [notice] if notice else []
        blocks += short_tables(result, _headline_caption(result), summary=True)
        drawn = figure(result) if figure else None
        blocks += [drawn] if drawn else []
    rejected = sum(p.count for p in _problems(results) if p.rejected)
    if rejected:
        blocks.append(Paragraph("Rows that were set aside are counted, with reasons, in the chapter on what was read."))
    return Section("Summary", blocks, level=1, key="summary")


def _headline_caption(result: Result) -> str:
    confidence = result.settings.get("confidence")
    interval = f", each with its {confidence * 100:g} % interval" if confidence else ""
    place = " per bin" if any(r.variable for r in pooled(result)) else ""
    return f"{heading(result.analysis)}{place}{interval}; digits follow the interval"


def verdict_notices(result: Result) -> list[Block]:
    """One line a requirement: the verdict over all its bins."""
    notices: list[Block] = []
    for number, requirement in enumerate(result.settings["requirements"], start=1):
        rows = [r for r in result.rows if r.extra["requirement"] == number]
        count = {word: sum(r.extra["verdict"] == word for r in rows) for word in ("pass", "fail", "inconclusive")}
        together = {r.extra["family_verdict"] for r in rows}
        name = requirement["name"] or requirement["quantity"]
        tally = f"{count['pass']} bins pass, {count['fail']} fail, {count['inconclusive']} are inconclusive"
        all_bins = "; held for all bins together as well" if together == {"pass"} else ""
        level = "bad" if count["fail"] else "caution" if count["inconclusive"] or not rows else "good"
        text = f"At {requirement['confidence'] * 100:g} % confidence a bin, {tally}{all_bins}."
        notices.append(Notice(text if rows else "No bin holds a sample it speaks of.", level, name))  # type: ignore[arg-type]
    return notices


def plain_section(result: Result) -> list[Section]:
    """The chapter of an analysis that has no layout of its own."""
    tables = short_tables(result, _headline_caption(result))
    return [Section(heading(result.analysis), [*tables, *flag_notices(result)], key=result.analysis)]


def flag_notices(result: Result) -> list[Block]:
    """What each flag that occurs means, in words."""
    used = dict.fromkeys(flag for row in result.rows for flag in row.flags)
    if not used:
        return []
    rows = [[flag, FLAGS.get(flag, "")] for flag in used]
    return [Table("What the flags mean", ["Flag", "Meaning"], rows, "ll")]


def _problems(results: Sequence[Result]) -> tuple[Problem, ...]:
    return gather(list(dict.fromkeys(p for r in results for p in r.problems)))


def inputs_section(results: Sequence[Result]) -> Section:
    """Every file that was read, and every row that was not used, with the reason and the first few cases."""
    inputs = results[0].provenance.get("inputs", [])
    files = [[i["file"], i["kind"], i["format"], f"{i['bytes']:,}", i["sha256"]] for i in inputs]
    blocks: list[Block] = [
        Table("Files read", ["File", "Log", "Format", "Bytes", "SHA-256"], files, "lllrl"),
    ]
    counts = results[0].settings.get("counts") or {}
    if counts:
        words = [[name.replace("_", " "), f"{int(value):,}"] for name, value in counts.items()]
        blocks.append(Table("Rows counted", ["What", "Rows"], words, "lr"))
    problems = _problems(results)
    if problems:
        rows: list[list[str | Cell]] = [
            [p.where, p.reason, f"{p.count:,}" if p.count else "", "; ".join(p.examples)] for p in problems
        ]
        blocks.append(Table("What was found and set aside", ["Where", "What", "Rows", "First cases"], rows, "llrl"))
    else:
        blocks.append(Paragraph("Every row of every file was used."))
    return Section("What was read", blocks, key="inputs")


def software_section(results: Sequence[Result]) -> Section:
    """Versions and settings, so that the numbers can be made again."""
    versions = results[0].provenance.get("versions", {})
    blocks: list[Block] = [
        Paragraph("The same inputs, settings and versions give this report again, byte for byte."),
        Table("Software", ["Package", "Version"], [[n, v] for n, v in versions.items()], "ll"),
    ]
    for result in results:
        settings = {k: v for k, v in result.settings.items() if k not in {"counts", "requirements", "differences"}}
        if settings:
            rows = [[name.replace("_", " "), _setting(value)] for name, value in settings.items()]
            blocks.append(Table(f"Settings of {result.analysis}", ["Setting", "Value"], rows, "ll"))
    return Section("How it was made", blocks, key="software")


def _setting(value: object) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, dict):
        return ", ".join(f"{k} = {v}" for k, v in value.items()) or "none"
    return "none" if value is None else str(value)


__all__ = ["flag_notices", "inputs_section", "plain_section", "software_section", "summary_section", "verdict_table"]
