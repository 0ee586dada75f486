"""`rangeeval simulate bearing`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rangeeval.cli.simulate.options import scenario_options, write_trial


@click.command()
@scenario_options
@click.option(
    "--array", type=click.Choice(["cylinder", "line"]), default="cylinder", show_default=True, help="Sensors."
)
@click.option("--snr", "snr_db", type=float, metavar="DB", default=5.0, show_default=True, help="At one sensor.")
@click.option("--steps", type=click.IntRange(20), default=1000, show_default=True, help="Snapshots, 0.1 s apart.")
@click.option("--table", is_flag=True, help="Print the Monte Carlo table of every method; no trial is needed.")
@click.option("--crossings", is_flag=True, help="Print what becomes of two targets that cross, or meet and part.")
@click.option("--runs", type=click.IntRange(2), default=100, show_default=True, help="Runs of --table, --crossings.")
def bearing(output: Path | None, table: bool, crossings: bool, runs: int, **options: Any) -> None:
    """Five targets cross before 15 sensors on a line or a cylinder: snapshots and true bearings."""
    from rangeeval.scenarios.bearing import bearing_table, crossing_text, simulate_bearing, table_text

    write_trial(simulate_bearing, output, needed=not (table or crossings), **options)

    def progress(what: str) -> None:
        click.echo(what, err=True)

    if table:
        click.echo(table_text(bearing_table(runs, options["seed"], progress=progress), runs), nl=False)
    if crossings:
        click.echo(crossing_text(runs, options["seed"], progress=progress), nl=False)
