"""`rangeeval accuracy`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rangeeval.cli.options import analysis_options, bins_of, estimator_option, opened, pair, paths
from rangeeval.cli.output import progress, show


@click.command()
@paths
@analysis_options
@estimator_option
@click.option("--per-track", is_flag=True, help="Also a row for each track.")
@click.option("--when", multiple=True, metavar="COLUMN_min|_max=VALUE", help="Keep only such samples (repeatable).")
def accuracy(
    trial: tuple[Path, ...], form: str | None, output: Path | None, confidence: float, estimator: str,
    per_track: bool, when: tuple[str, ...], **bins: Any,
) -> None:  # fmt: skip
    """Random-error sigma per bin from residuals and gains, no truth.

    A constant bias leaves no trace in residuals: it is not in these numbers.
    """
    from rangeeval.analyses.accuracy import accuracy as analyse

    one = opened(list(trial))
    with progress("accuracy") as advance:
        result = analyse(
            one,
            bins_of(one, **bins),
            confidence=confidence,
            estimator=estimator,
            per_track=per_track,
            when=dict(pair(w) for w in when),
            progress=advance,
        )
    show(one, result, form, output)
