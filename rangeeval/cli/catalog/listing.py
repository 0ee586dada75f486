"""`rangeeval catalog list` and `rangeeval catalog show`."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from rangeeval.cli.catalog.options import catalog_option, chosen, given_paths, term_options, terms_of
from rangeeval.cli.output import export

_form = click.option("--format", "form", type=click.Choice(["table", "json", "csv", "parquet"]), help="Default: table.")
_output = click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help="Write to this file.")


@click.command("list")
@given_paths
@catalog_option
@term_options
@_form
@_output
def list_(paths: tuple[Path, ...], file: Path, form: str | None, output: Path | None, **terms: str | None) -> None:
    """The trials in the catalogue, by date; with --quantity, --bin and so on those that hold such estimates.

    DIR_OR_FILES: look at these archives and results instead of the catalogue.
    """
    with chosen(file, paths) as catalog:
        found = catalog.results(terms_of(terms))
    if not export((result.as_row() for result in found), form, output):
        from rangeeval.reporting.terminal import catalog_text

        click.echo(catalog_text([result.as_row() for result in found], sys.stdout), nl=False)


@click.command()
@click.argument("trial", nargs=-1)
@catalog_option
@term_options
@_form
@_output
def show(trial: tuple[str, ...], file: Path, form: str | None, output: Path | None, **terms: str | None) -> None:
    """The estimates of trials, or of all that the options leave.

    TRIAL is a trial's name, the path of its archive or results, or the beginning of its SHA-256. A file or folder is
    looked at whether the catalogue knows it or not.
    """
    given = tuple(Path(name) for name in trial if Path(name).exists())
    names = tuple(name for name in trial if not Path(name).exists())
    with chosen(file, () if names else given) as catalog:
        wanted = terms_of(terms, names and (*names, *(str(p.absolute()) for p in given)))
        if not export((row.as_row() for row in catalog.estimates(wanted)), form, output):
            from rangeeval.reporting.terminal import estimates_text

            for result in catalog.results(wanted):
                rows = ((row.analysis, row.estimate) for row in catalog.estimates(wanted.only(result.sha256)))
                click.echo(estimates_text(result.name, rows, sys.stdout), nl=False)
