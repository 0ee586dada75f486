"""`rangeeval truth`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rangeeval.cli.options import analysis_options, bins_of, opened, paths
from rangeeval.cli.output import progress, show


@click.command()
@paths
@analysis_options
@click.option("--per-track", is_flag=True, help="Also rows for each target.")
@click.option("--remove-offset", is_flag=True, help="Take the time offset that the plots show out of the truth first.")
def truth(
    trial: tuple[Path, ...], form: str | None, output: Path | None, confidence: float, per_track: bool,
    remove_offset: bool, **bins: Any,
) -> None:  # fmt: skip
    """Errors of plots against truth per bin: bias, sigma and RMS of range, azimuth, elevation; time offset.

    A positive time offset says that the truth's times are late: a plot shows where the target was so much later by the
    truth's clock.
    """
    from rangeeval.analyses.truth import truth as analyse

    one = opened(list(trial))
    with progress("truth") as advance:
        result = analyse(
            one,
            bins_of(one, **bins),
            confidence=confidence,
            per_track=per_track,
            remove_offset=remove_offset,
            progress=advance,
        )
    show(one, result, form, output)
