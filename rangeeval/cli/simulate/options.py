"""What every scenario takes and does: a folder, a seed, the names of what was written; or a table printed instead."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

Command = Callable[..., Any]


def scenario_options(command: Command) -> Command:
    """The folder to write and the seed."""
    for option in (
        click.option("--seed", type=int, default=1, show_default=True, help="The same seed gives the same bytes."),
        click.option("-o", "--output", type=click.Path(path_type=Path, file_okay=False), help="Folder to write."),
    ):
        command = option(command)
    return command


def write_trial(write: Callable[..., list[Path]], output: Path | None, *, needed: bool = True, **options: Any) -> None:
    """Write the trial and say which files; without a folder that is wrong usage, unless it is not `needed`."""
    if output is None:
        if needed:
            raise click.UsageError("Missing option '-o' / '--output'.")
        return
    for path in write(output, **options):
        click.echo(path)
