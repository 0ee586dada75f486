"""`rangeeval simulate SCENARIO`: `SCENARIOS` lists the scenarios, each a command with options of its own."""

from __future__ import annotations

import click

from rangeeval.cli.lazy import LazyGroup

SCENARIOS: dict[str, str] = {
    "alpha-beta": "rangeeval.cli.simulate.alpha_beta:alpha_beta",
    "attitude": "rangeeval.cli.simulate.attitude:attitude",
    "bearing": "rangeeval.cli.simulate.bearing:bearing",
    "imm": "rangeeval.cli.simulate.imm:imm",
    "swerling": "rangeeval.cli.simulate.swerling:swerling",
}


@click.group(cls=LazyGroup, table=SCENARIOS, subcommand_metavar="SCENARIO [OPTIONS]")
def simulate() -> None:
    """Make a synthetic trial with known answers: `rangeeval simulate SCENARIO -o DIR --seed N`."""
