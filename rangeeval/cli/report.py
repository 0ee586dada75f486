"""`rangeeval report`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rangeeval.cli.options import bin_options, bins_of, estimator_option, opened, paths
from rangeeval.cli.output import progress


@click.command()
@paths
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, file_okay=False), required=True, help="Folder to write."
)
@bin_options
@estimator_option
def report(trial: tuple[Path, ...], output: Path, confidence: float, estimator: str, **bins: Any) -> None:
    """Read, analyse all that the logs allow, and write report.html, report.pdf and results.json.

    Given a results.json instead of a trial, the report is rebuilt from it alone. Several trial folders give a
    folder of their own each.
    """
    from rangeeval import flow

    several = len(trial) > 1 and all(path.is_dir() for path in trial)
    for job in ([path] for path in trial) if several else [list(trial)]:
        folder = output / job[0].name if several else output
        if len(job) == 1 and _is_results(job[0]):
            written = flow.write_report(flow.read_results(job[0]), folder)
        else:
            one = opened(job)
            plan = flow.Plan(bins=bins_of(one, **bins), confidence=confidence, estimator=estimator)
            with progress("reading") as advance:
                written = flow.report(one, folder, plan, advance)
        for path in written:
            click.echo(path)


def _is_results(path: Path) -> bool:
    return path.is_file() and path.suffix.lower() == ".json"
