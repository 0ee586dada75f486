"""`rangeeval simulate swerling`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rangeeval.cli.simulate.options import scenario_options, write_trial


@click.command()
@scenario_options
@click.option("--swerling", type=click.Choice(["0", "1", "2", "3", "4"]), default="3", show_default=True, help="Case.")
@click.option("--rcs", "rcs_m2", type=float, metavar="M2", default=2.0, show_default=True, help="Mean RCS.")
@click.option("--broadside", "broadside_db", type=float, metavar="DB", default=0.0, help="Larger from the side by.")
@click.option("--table", is_flag=True, help="Print the paper's Monte Carlo table; no trial is needed.")
@click.option("--runs", type=click.IntRange(2), default=10_000, show_default=True, help="Runs of --table.")
def swerling(output: Path | None, table: bool, runs: int, **options: Any) -> None:
    """Looks at one target of known mean RCS; with --table, RMS errors of all five RCS methods."""
    from rangeeval.scenarios.swerling import compare_methods, comparison_text, simulate_swerling

    write_trial(simulate_swerling, output, needed=not table, **options)
    if table:
        click.echo(comparison_text(compare_methods(runs, options["seed"])), nl=False)
