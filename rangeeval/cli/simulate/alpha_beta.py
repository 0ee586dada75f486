"""`rangeeval simulate alpha-beta`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rangeeval.cli.simulate.options import scenario_options, write_trial


@click.command("alpha-beta")
@scenario_options
@click.option("--flights", type=click.IntRange(1), default=4, show_default=True, help="How many.")
@click.option("--manoeuvre", type=float, metavar="M_S2", default=0.0, help="Sigma of the target's acceleration.")
@click.option("--outbound", is_flag=True, help="Each flight also flies back out.")
@click.option("--no-truth", is_flag=True, help="Leave out the truth log.")
def alpha_beta(output: Path | None, **options: Any) -> None:
    """A radar whose alpha-beta tracker follows targets inbound from 100 km."""
    from rangeeval.scenarios import simulate_alpha_beta

    write_trial(simulate_alpha_beta, output, **options)
