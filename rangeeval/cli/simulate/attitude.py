"""`rangeeval simulate attitude`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rangeeval.cli.simulate.options import scenario_options, write_trial


@click.command()
@scenario_options
@click.option("--radius-upper", type=float, metavar="M", default=5.0, show_default=True, help="Upper accelerometer.")
@click.option("--radius-lower", type=float, metavar="M", default=1.0, show_default=True, help="Lower accelerometer.")
@click.option("--rate", type=float, metavar="HZ", default=10.0, show_default=True, help="Samples a second.")
@click.option("--gap", is_flag=True, help="Leave 12 seconds out of the tilt log.")
@click.option("--grid", is_flag=True, help="Print the peak errors of Fig. 3; no trial is needed.")
def attitude(output: Path | None, grid: bool, **options: Any) -> None:
    """A radar that rocks at 0.8 Hz, with a pair of accelerometers, while a target flies in."""
    from rangeeval.scenarios.attitude import figure_3_text, simulate_attitude

    write_trial(simulate_attitude, output, needed=not grid, **options)
    if grid:
        click.echo(figure_3_text(options["radius_upper"]), nl=False)
