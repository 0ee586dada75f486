"""What commands print and write: a result in the form asked for, problems and progress on standard error."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rangeeval.errors import SettingsError, one_line

if TYPE_CHECKING:
    from rangeeval.model import Problem, Result, Trial


def show(trial: Trial | None, result: Result, form: str | None, output: Path | None) -> None:
    """Print or write a result in the form asked for (by default that of the file's ending, else a table).

    `trial`: what it was made from, when that is one trial.
    """
    import dataclasses

    from rangeeval import flow

    form = form or {".json": "json", ".csv": "csv"}.get(output.suffix.lower() if output else "", "table")
    problems = tuple(dict.fromkeys((*(trial.problems if trial else ()), *result.problems)))
    if form == "json":
        origin = result.provenance or (flow.provenance(trial) if trial else {})
        text = dataclasses.replace(result, problems=problems, provenance=origin).to_json() + "\n"
    elif form == "csv":
        text = result.estimates.to_csv(index=False, lineterminator="\n")
    else:
        from rangeeval.reporting.terminal import as_text

        text = as_text(result, None if output else sys.stdout)
    write(text, output)
    warn(problems)


def write(text: str, output: Path | None) -> None:
    """Print text as it is, or write it to a file."""
    if output is None:
        click.echo(text, nl=False)
    else:
        output.write_text(text, encoding="utf-8", newline="")


def export(rows: Iterable[Mapping[str, object]], form: str | None, output: Path | None) -> bool:
    """Print or write rows in the form asked for, by default that of the file's ending. False when that is a table."""
    form = form or {".json": "json", ".csv": "csv", ".parquet": "parquet"}.get(output.suffix.lower() if output else "")
    if form in (None, "table"):
        if output is not None:
            raise SettingsError(f"{output}: give --format json, csv or parquet, or a file name that ends so")
        return False
    from rangeeval.reporting import export as written

    if form == "parquet":
        if output is None:
            raise SettingsError("--format parquet needs -o FILE")
        written.write_parquet(rows, output)
    elif output is None:
        written.write_text(rows, form, sys.stdout)
    else:
        with output.open("w", encoding="utf-8", newline="") as stream:
            written.write_text(rows, form, stream)
    return True


def warn(problems: Iterable[Problem]) -> None:
    """Each problem once on standard error, with the first few rows it concerns."""
    for problem in dict.fromkeys(problems):
        click.echo(f"rangeeval: {one_line(problem)}", err=True)
        for example in problem.examples:
            click.echo(f"  {one_line(example)}", err=True)


@contextlib.contextmanager
def progress(label: str) -> Iterator[Callable[[int], None] | None]:
    """That it is at work, and the rows read so far, on standard error, once it takes over a second.

    Nothing when that is not a terminal. The clock starts it, not a row: a kernel's first use compiles for a while.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    bar = Progress(*columns, console=Console(stderr=True), transient=True)
    task = bar.add_task(label, total=None)
    read = 0

    def advance(rows: int) -> None:
        nonlocal read
        read += rows
        bar.update(task, description=f"{label} {read:,} rows")

    late = threading.Timer(1.0, bar.start)
    late.daemon = True
    late.start()
    try:
        yield advance
    finally:
        late.cancel()
        late.join()
        bar.stop()
