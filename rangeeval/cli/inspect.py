"""`rangeeval inspect`."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from rangeeval.cli.options import paths


@click.command()
@paths
@click.option("--format", "form", type=click.Choice(["table", "json"]), default="table", show_default=True)
def inspect(trial: tuple[Path, ...], form: str) -> None:
    """What each file was recognised as: columns, units, rows, span, gaps, rejected rows."""
    import json

    from rangeeval.parsers.inspection import inspect_trial

    found = [item.as_dict() for item in inspect_trial(list(trial) if len(trial) > 1 else trial[0])]
    if form == "json":
        click.echo(json.dumps(found, allow_nan=False, ensure_ascii=False, indent=1))
        return
    from rangeeval.reporting.terminal import inspection_text

    click.echo(inspection_text(found, sys.stdout), nl=False)
