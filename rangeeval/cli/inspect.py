"""`rangeeval inspect`."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from rangeeval.cli.options import opened, paths
from rangeeval.cli.output import warn


@click.command()
@paths
@click.option("--format", "form", type=click.Choice(["table", "json"]), default="table", show_default=True)
def inspect(trial: tuple[Path, ...], form: str) -> None:
    """What each file was recognised as: columns, units, rows, span, gaps, rejected rows."""
    import json

    from rangeeval.parsers.inspection import inspect_trial

    one = opened(list(trial))
    logs = inspect_trial(one)
    told = {problem for log in logs for problem in log.problems}
    warn(problem for problem in one.problems if problem not in told)  # files that are no logs, above all
    found = [log.as_dict() for log in logs]
    if form == "json":
        click.echo(json.dumps(found, allow_nan=False, ensure_ascii=False, indent=1))
        return
    from rangeeval.reporting.terminal import inspection_text

    click.echo(inspection_text(found, sys.stdout), nl=False)
