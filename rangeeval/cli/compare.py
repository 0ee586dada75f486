"""`rangeeval compare`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rangeeval.cli.options import bin_options, bins_of
from rangeeval.cli.output import progress, show
from rangeeval.errors import SettingsError, one_line

if TYPE_CHECKING:
    from rangeeval.flow import Plan
    from rangeeval.model import Trial

DIFFERENT = 3


@click.command()
@click.argument("trials", nargs=-1, required=True, metavar="REFERENCE TRIAL...", type=click.Path(path_type=Path))
@click.option("--format", "form", type=click.Choice(["table", "json", "csv"]), help="Default: table.")
@click.option(
    "-o", "--output", type=click.Path(path_type=Path),
    help="A folder: write report.html, report.pdf and results.json there. A file (.json, .csv, .txt or with --format): "
    "write the table to it.",
)  # fmt: skip
@click.option(
    "--margin", multiple=True, metavar="[QUANTITY=]VALUE", help="What counts as equal. Default: 0.1, a tenth."
)
@click.option("--quantity", multiple=True, metavar="NAME", help="Only these (`*` fits any text); `all`: every one.")
@click.option(
    "--adjust", type=click.Choice(["holm", "bh"]), default="holm", show_default=True,
    help="p values for many tests: no false claim at all (holm), or a small share of false claims (bh).",
)  # fmt: skip
@click.option("--estimator", type=click.Choice(["recommended", "paper"]), help="Evaluate the logs anew with this one.")
@click.option("--fail-on-difference", is_flag=True, help="Exit with status 3 when any quantity differs in any bin.")
@bin_options
def compare(
    trials: tuple[Path, ...], form: str | None, output: Path | None, margin: tuple[str, ...], quantity: tuple[str, ...],
    adjust: str, estimator: str | None, fail_on_difference: bool, confidence: float, **bins: Any,
) -> None:  # fmt: skip
    """Trials side by side: what got better or worse, bin by bin, and how sure that is.

    Each TRIAL is compared with the REFERENCE. Both are trial folders, archives or results.json. An archive's own
    estimates are compared, unless options on bins or estimator ask for others.
    """
    from rangeeval import flow

    def plan_of(trial: Trial) -> Plan:
        return flow.Plan(bins=bins_of(trial, **bins), confidence=confidence, estimator=estimator or "recommended")

    anew = estimator is not None or any(value is not None for value in bins.values())
    overall, margins = _margins(margin)
    with progress("comparing") as advance:
        result = flow.compare(
            *trials, plan_of=plan_of if anew else None, progress=advance, confidence=confidence, adjust=adjust,
            margins=margins, quantities=quantity, **overall,
        )  # fmt: skip
    if output is None or form or output.suffix.lower() in {".json", ".csv", ".txt"}:
        show(None, result, form, output)
    else:
        for path in flow.write_report([result], output):
            click.echo(path)
    if fail_on_difference and any(row.extra["differs"] for row in result.rows):
        sys.exit(DIFFERENT)


def _margins(given: tuple[str, ...]) -> tuple[dict[str, float], dict[str, float]]:
    """The margin of all quantities, if given, and those of single ones."""
    overall: dict[str, float] = {}
    single: dict[str, float] = {}
    for text in given:
        name, equals, value = text.rpartition("=")
        try:
            (single if equals else overall)[name or "margin"] = float(value)
        except ValueError:
            raise SettingsError(f"--margin '{one_line(text, 60)}': expected NUMBER or QUANTITY=NUMBER") from None
    return overall, single
