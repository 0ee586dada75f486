"""`rangeeval ingest` and `rangeeval verify`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from rangeeval.cli.options import bin_options, bins_of, estimator_option, opened, paths
from rangeeval.cli.output import progress
from rangeeval.errors import RangeevalError, one_line


@click.command()
@paths
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), required=True, help="File to write.")
@bin_options
@estimator_option
def ingest(trial: tuple[Path, ...], output: Path, confidence: float, estimator: str, **bins: Any) -> None:
    """Archive a trial in one HDF5 file: all logs, settings, source hashes, rejected rows, estimates.

    The file is written whole or not at all. It is accepted wherever a TRIAL is.
    """
    from rangeeval import flow

    one = opened(list(trial))
    plan = flow.Plan(bins=bins_of(one, **bins), confidence=confidence, estimator=estimator)
    with progress("archiving") as advance:
        click.echo(flow.ingest(one, output, plan, advance))


@click.command()
@click.argument("archive", nargs=-1, required=True, type=click.Path(path_type=Path, dir_okay=False))
@click.option("--format", "form", type=click.Choice(["table", "json"]), default="table", show_default=True)
def verify(archive: tuple[Path, ...], form: str) -> None:
    """Check archives: every byte against its SHA-256, the structure, every row of every log, the results.

    Exit status 1 when one is not whole; the others are checked all the same.
    """
    import json

    from rangeeval.parsers.archive import verify as checked

    found: list[dict[str, Any]] = []
    for path in archive:
        try:
            found.append(checked(path).as_dict())
        except RangeevalError as error:
            found.append({"path": str(path), "whole": False, "reason": str(error)})
    if form == "json":
        click.echo(json.dumps(found, allow_nan=False, ensure_ascii=False, indent=1))
    for item in found:
        if not item["whole"]:
            click.echo(f"rangeeval: {one_line(item['reason'], 1000)}", err=True)
        elif form == "table":
            held = f"layout {item['layout']}, {item['logs']} logs, {item['rows']:,} rows, {item['sources']} sources"
            click.echo(f"{one_line(item['path'])}: whole ({held}, SHA-256 {item['sha256']})")
    if not all(item["whole"] for item in found):
        sys.exit(1)
