"""`rangeeval bearing`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

from rangeeval.cli.options import analysis_options, bins_of, opened, paths
from rangeeval.cli.output import progress, show, warn, write


@click.command()
@paths
@analysis_options
@click.option(
    "--method",
    type=click.Choice(["joint-ml", "modified", "ryu", "music", "root-music", "esprit"]),
    default="joint-ml",
    show_default=True,
    help="`joint-ml`: all bearings at once; `ryu` (a line), `modified`: the source papers'; the rest block by block.",
)
@click.option("--targets", metavar="N|auto", help="How many (default: the trial's own number, else found by MDL).")
@click.option("--block", type=click.IntRange(1), metavar="N", help="Snapshots of a step, or of a block.")
@click.option("--acceleration", type=float, metavar="DEG_S2", help="How fast bearings may turn (sigma, deg/s^2).")
@click.option("--lag-compensation", is_flag=True, help="ryu, modified: make up for the lag of the subspace.")
@click.option(
    "--coasting",
    type=click.Choice(["none", "hard", "soft"]),
    default="none",
    show_default=True,
    help="ryu, modified: rely on the prediction next to another target.",
)
@click.option("--from", "start_s", type=float, metavar="S", help="Use snapshots from this time on.")
@click.option("--to", "end_s", type=float, metavar="S", help="Use snapshots up to this time.")
@click.option("--tracks", is_flag=True, help="Write every update of every target as CSV, instead.")
def bearing(
    trial: tuple[Path, ...], form: str | None, output: Path | None, confidence: float, method: str,
    targets: str | None, block: int | None, acceleration: float | None, lag_compensation: bool, coasting: str,
    start_s: float | None, end_s: float | None, tracks: bool, **bins: Any,
) -> None:  # fmt: skip
    """Bearings of several targets from array snapshots, with what spoils them.

    With a truth log of bearings: errors near crossings and far from them, targets held, swapped or lost, and the
    Cramer-Rao bounds beside. With --bins time --bin-width S: each target's bearing every S seconds.
    """
    from rangeeval.analyses.bearing import bearing as analyse
    from rangeeval.analyses.bearing import bearing_tracks

    one = opened(list(trial))
    how: dict[str, Any] = {
        "confidence": confidence,
        "method": method,
        "targets": _number(targets),
        "block": block,
        "acceleration_rad_s2": None if acceleration is None else math.radians(acceleration),
        "lag_compensation": lag_compensation,
        "coasting": coasting,
        "span_s": (-math.inf if start_s is None else start_s, math.inf if end_s is None else end_s),
    }
    if tracks:
        if form not in (None, "csv"):
            raise click.UsageError("--tracks writes CSV")
        with progress("bearing") as advance:
            table, problems = bearing_tracks(one, progress=advance, **how)
        write(table.to_csv(index=False, lineterminator="\n"), output)
        warn((*one.problems, *problems))
        return
    with progress("bearing") as advance:
        result = analyse(one, bins_of(one, **bins), progress=advance, **how)
    show(one, result, form, output)


def _number(targets: str | None) -> int | str | None:
    if targets is None or targets == "auto":
        return targets
    if not targets.isdecimal() or int(targets) < 1:
        raise click.UsageError(f"--targets is '{targets}', expected a number from 1 on, or auto")
    return int(targets)
