"""`rangeeval simulate imm`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rangeeval.cli.simulate.options import scenario_options, write_trial


@click.command()
@scenario_options
@click.option("--table", is_flag=True, help="Print the Monte Carlo comparison of filters; no trial is needed.")
@click.option("--runs", type=click.IntRange(2), default=100, show_default=True, help="Runs of --table.")
def imm(output: Path | None, table: bool, runs: int, **options: Any) -> None:
    """A target that turns twice at 400 m/s; with --table, RMS errors and consistency of all the filters."""
    from rangeeval.scenarios.imm import compare_filters, comparison_text, simulate_imm

    write_trial(simulate_imm, output, needed=not table, **options)
    if table:
        click.echo(comparison_text(compare_filters(runs), runs), nl=False)
