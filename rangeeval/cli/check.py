"""`rangeeval check`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from rangeeval.cli.options import analysis_options, bins_of, estimator_option, opened, paths
from rangeeval.cli.output import progress, show

FAILED = 3


@click.command()
@paths
@analysis_options
@estimator_option
def check(
    trial: tuple[Path, ...], form: str | None, output: Path | None, confidence: float, estimator: str, **bins: Any
) -> None:
    """Judge the requirements of trial.toml in every bin: pass, fail or inconclusive. Exit status 3 when one fails."""
    from rangeeval import flow

    one = opened(list(trial))
    plan = flow.Plan(bins=bins_of(one, **bins), confidence=confidence, estimator=estimator)
    with progress("check") as advance:
        result = flow.check(one, plan, progress=advance)
    show(one, result, form, output)
    if any(row.extra["verdict"] == "fail" for row in result.rows):
        sys.exit(FAILED)
