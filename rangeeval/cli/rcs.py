"""`rangeeval rcs`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rangeeval.cli.options import analysis_options, bins_of, opened, paths
from rangeeval.cli.output import progress, show


@click.command()
@paths
@analysis_options
@click.option(
    "--method",
    type=click.Choice(["ml-a", "em-a", "ml-b", "em-b", "med"]),
    default="ml-a",
    show_default=True,
    help="`ml-a`: exact maximum likelihood; the others are the source paper's, for comparison.",
)
@click.option(
    "--swerling",
    type=click.Choice(["0", "1", "2", "3", "4", "free", "auto"]),
    default="auto",
    show_default=True,
    help="Fluctuation of the target; `auto` compares the cases over the whole trial, `free` fits a shape to it.",
)
@click.option(
    "--interval",
    type=click.Choice(["profile", "bootstrap", "credible"]),
    default="profile",
    show_default=True,
    help="Interval of the RCS: profile likelihood, parametric bootstrap, or Bayesian.",
)
@click.option(
    "--window", type=click.IntRange(1), metavar="N", help="Also the sliding estimate over N looks (csv, json)."
)
@click.option("--per-track", is_flag=True, help="Also rows for each target.")
def rcs(
    trial: tuple[Path, ...], form: str | None, output: Path | None, confidence: float, method: str, swerling: str,
    interval: str, window: int | None, per_track: bool, **bins: Any,
) -> None:  # fmt: skip
    """Detection probability and mean RCS per bin, with missed detections counted.

    An error in the radar equation (snr_per_m2) goes straight into the RCS and is in no interval here.
    """
    from rangeeval.analyses.rcs import rcs as analyse

    one = opened(list(trial))
    with progress("rcs") as advance:
        result = analyse(
            one,
            bins_of(one, **bins),
            confidence=confidence,
            method=method,
            swerling=swerling,
            window=window,
            interval=interval,
            per_track=per_track,
            progress=advance,
        )
    show(one, result, form, output)
