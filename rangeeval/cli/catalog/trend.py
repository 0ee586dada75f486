"""`rangeeval catalog trend`."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from rangeeval.cli.catalog.options import catalog_option, chosen, given_paths, term_options, terms_of
from rangeeval.cli.output import warn
from rangeeval.errors import SettingsError


@click.command()
@given_paths
@catalog_option
@term_options
@click.option("--false-alarms", type=float, default=0.05, show_default=True, help="Share of steady pages that alarm.")
@click.option("--format", "form", type=click.Choice(["table", "json", "csv"]), help="Default: table.")
@click.option("-o", "--output", type=click.Path(path_type=Path, file_okay=False), help="Folder for the page.")
def trend(
    paths: tuple[Path, ...], file: Path, false_alarms: float, form: str | None, output: Path | None, **terms: str | None
) -> None:
    """Is a quantity steady from trial to trial: control limits, trials out of line, steps of the level.

    DIR_OR_FILES: look at these archives and results instead of the catalogue. With -o, report.html, report.pdf and
    results.json are written.
    """
    from rangeeval import flow
    from rangeeval.many.indexing import trend_of

    if not 0 < false_alarms < 0.5:
        raise SettingsError(f"--false-alarms {false_alarms:g}: expected more than 0 and less than 0.5")
    with chosen(file, paths) as catalog:
        result = trend_of(catalog, terms_of(terms), alpha=false_alarms)
    if output is not None:
        for path in flow.write_report([result], output):
            click.echo(path)
    if form == "json":
        click.echo(result.to_json())
    elif form == "csv":
        from rangeeval.reporting.export import write_text

        write_text((row.as_row() | {"flags": " ".join(row.flags)} for row in result.rows), "csv", sys.stdout)
    elif output is None or form == "table":
        from rangeeval.reporting.terminal import as_text

        click.echo(as_text(result, sys.stdout), nl=False)
    warn(result.problems)
