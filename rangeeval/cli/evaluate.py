"""`rangeeval evaluate`."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rangeeval.cli.options import bin_choice, bin_options, estimator_option
from rangeeval.errors import one_line

if TYPE_CHECKING:
    from rangeeval.many import Outcome, Summary

_SECONDS = 10.0  # between lines of progress where standard error is no terminal


@click.command()
@click.argument("paths", metavar="DIR...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, file_okay=False), default="results", show_default=True,
    help="Folder for the results.",
)  # fmt: skip
@click.option("--jobs", type=click.IntRange(1), default=1, show_default=True, help="Workers on this machine.")
@click.option("--scheduler", metavar="ADDRESS", help="Use the workers of the dask cluster at this address instead.")
@click.option("--time-limit", type=float, metavar="S", help="Stop a trial that takes longer; it is listed as failed.")
@click.option("--format", "form", type=click.Choice(["table", "json", "csv"]), default="table", show_default=True)
@bin_options
@estimator_option
def evaluate(
    paths: tuple[Path, ...], output: Path, jobs: int, scheduler: str | None, time_limit: float | None, form: str,
    confidence: float, estimator: str, **bins: Any,
) -> None:  # fmt: skip
    """Evaluate many trials: every analysis of each, one result file each. Interrupted, it goes on where it was.

    DIR is a trial folder, an archive, or a folder of them. Results are the same whatever the number of workers. A trial
    that cannot be evaluated is listed and the others go on; the exit status is then 1.
    """
    from rangeeval import flow
    from rangeeval.many import evaluate_many

    with _progress() as report:
        summary = evaluate_many(
            paths,
            output,
            flow.Plan(confidence=confidence, estimator=estimator),
            bins=bin_choice(**bins),
            jobs=jobs,
            scheduler=scheduler,
            time_limit=time_limit,
            report=report,
        )
    _print(summary, form)
    for note in summary.notes:
        click.echo(f"rangeeval: {note}", err=True)
    if form != "table":
        for one in summary.failed:
            click.echo(f"rangeeval: {one_line(one.path)}: {one_line(one.why, 1000)}", err=True)
    if summary.failed:
        click.echo(f"rangeeval: {len(summary.failed)} of {len(summary.outcomes)} trials failed", err=True)
        sys.exit(1)


def _print(summary: Summary, form: str) -> None:
    if form == "json":
        import json

        click.echo(json.dumps(summary.as_dict(), allow_nan=False, ensure_ascii=False, indent=1))
    elif form == "csv":
        from rangeeval.reporting.export import write_text

        write_text(summary.as_dict()["trials"], "csv", sys.stdout)
    else:
        from rangeeval.reporting.terminal import outcomes_text

        click.echo(outcomes_text(summary.directory, summary.outcomes, sys.stdout), nl=False)


@contextlib.contextmanager
def _progress() -> Iterator[Callable[[Outcome, int, int], None]]:
    """How many trials are through: a bar on a terminal, else a line now and then."""
    if not sys.stderr.isatty():
        yield _Lines()
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("trials", total=None)
        failed = 0

        def advance(outcome: Outcome, count: int, total: int) -> None:
            nonlocal failed
            failed += outcome.status == "failed"
            words = f"trials, {failed} failed" if failed else "trials"
            bar.update(task, completed=count, total=total, description=words)

        yield advance


class _Lines:
    """A line of progress every `_SECONDS`."""

    def __init__(self) -> None:
        self.next = time.monotonic() + _SECONDS
        self.failed = 0

    def __call__(self, outcome: Outcome, count: int, total: int) -> None:
        self.failed += outcome.status == "failed"
        if time.monotonic() >= self.next:
            self.next = time.monotonic() + _SECONDS
            click.echo(f"rangeeval: {count} of {total} trials, {self.failed} failed", err=True)
