"""`rangeeval attitude`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rangeeval.cli.options import analysis_options, bins_of, opened, paths
from rangeeval.cli.output import progress, show, warn, write


@click.command()
@paths
@analysis_options
@click.option("--correct", is_flag=True, help="Write the plots log with the attitude taken out, as CSV, instead.")
def attitude(
    trial: tuple[Path, ...], form: str | None, output: Path | None, confidence: float, correct: bool, **bins: Any
) -> None:
    """Tilt, dynamic motion, attitude error by method, and what it does to azimuth and elevation.

    With --correct, the plots' angles as they are with the measured attitude, interpolated to each detection; a plot in
    a gap of the tilt log is flagged, not corrected.
    """
    from rangeeval.analyses.attitude import attitude as analyse
    from rangeeval.analyses.attitude import correct_plots

    one = opened(list(trial))
    if correct:
        if form not in (None, "csv"):
            raise click.UsageError("--correct writes CSV")
        with progress("attitude") as advance:
            found = correct_plots(one, progress=advance)
        write(found.to_csv(), output)
        warn((*one.problems, *found.problems))
        click.echo(f"rangeeval: {found.corrected} plots corrected, {found.flagged} flagged", err=True)
        return
    with progress("attitude") as advance:
        result = analyse(one, bins_of(one, **bins), confidence=confidence, progress=advance)
    show(one, result, form, output)
