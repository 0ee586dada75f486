"""The command line: options in, one library call, exit status. Nothing here that a Python user would miss.

Heavy packages are imported by the command that needs them, so that `--help` answers at once.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rangeeval import __version__
from rangeeval.errors import RangeevalError, SettingsError, one_line
from rangeeval.scenarios import SCENARIOS

if TYPE_CHECKING:
    from rangeeval.model import Bins, Problem, Result, Trial

FAILED = 3

Command = Callable[..., Any]


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="rangeeval")
def cli() -> None:
    """Post-trial analysis of radar test-range logs: how accurate the radar was, bin by bin, and how sure that is.

    TRIAL is a folder of log files (with or without a trial.toml), single log files, or an archive. Logs are
    recognised by their content. `rangeeval report TRIAL -o DIR` does the whole job.
    """


paths = click.argument("trial", nargs=-1, required=True, type=click.Path(path_type=Path))


def analysis_options(command: Command) -> Command:
    """Options that every analysis takes: the form of its result, and how it is binned."""
    for option in (
        click.option("--format", "form", type=click.Choice(["table", "json", "csv"]), help="Default: table."),
        click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), help="Write to this file."),
    ):
        command = option(command)
    return bin_options(command)


def bin_options(command: Command) -> Command:
    """Confidence and bins; what is not given is the trial's own."""
    for option in (
        click.option("--confidence", type=float, default=0.95, show_default=True, help="Of the two-sided intervals."),
        click.option("--bin-width", type=float, help="Width of the bins, in the variable's SI unit (m, rad, dB, s)."),
        click.option("--bin-start", type=float, help="Where the first bin starts."),
        click.option("--bins", "variable", help="Bin by range, azimuth, elevation, snr, aspect or time."),
        click.option("--snr-span", type=float, metavar="DB", help="Range bins of this constant SNR span instead."),
    ):
        command = option(command)
    return command


def estimator_option(command: Command) -> Command:
    """Which formulas."""
    return click.option(
        "--estimator",
        type=click.Choice(["recommended", "paper"]),
        default="recommended",
        show_default=True,
        help="`paper`: the source paper's formulas to the letter.",
    )(command)


@cli.command()
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


@cli.command()
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
            when=dict(_pair(w) for w in when),
            progress=advance,
        )
    show(one, result, form, output)


@cli.command()
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
    type=click.Choice(["0", "1", "2", "3", "4", "auto"]),
    default="auto",
    show_default=True,
    help="Fluctuation of the target; `auto` compares the cases over the whole trial.",
)
@click.option(
    "--window", type=click.IntRange(1), metavar="N", help="Also the sliding estimate over N looks (csv, json)."
)
@click.option("--per-track", is_flag=True, help="Also rows for each target.")
def rcs(
    trial: tuple[Path, ...], form: str | None, output: Path | None, confidence: float, method: str, swerling: str,
    window: int | None, per_track: bool, **bins: Any,
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
            per_track=per_track,
            progress=advance,
        )
    show(one, result, form, output)


@cli.command()
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
        _write(found.to_csv(), output)
        _warn((*one.problems, *found.problems))
        click.echo(f"rangeeval: {found.corrected} plots corrected, {found.flagged} flagged", err=True)
        return
    with progress("attitude") as advance:
        result = analyse(one, bins_of(one, **bins), confidence=confidence, progress=advance)
    show(one, result, form, output)


@cli.command()
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


@cli.command()
@paths
@click.option("-o", "--output", type=click.Path(path_type=Path, dir_okay=False), required=True, help="File to write.")
@bin_options
@estimator_option
def ingest(trial: tuple[Path, ...], output: Path, confidence: float, estimator: str, **bins: Any) -> None:
    """Archive a trial in one HDF5 file: all logs, settings, source hashes, rejected rows, estimates.

    The file is written whole or not at all. It is accepted wherever a TRIAL is.
    """
    from rangeeval import flow

    one = opened(list(trial))
    plan = flow.Plan(bins=bins_of(one, **bins), confidence=confidence, estimator=estimator)
    with progress("archiving") as advance:
        click.echo(flow.ingest(one, output, plan, advance))


@cli.command()
@click.argument("archive", nargs=-1, required=True, type=click.Path(path_type=Path, dir_okay=False))
@click.option("--format", "form", type=click.Choice(["table", "json"]), default="table", show_default=True)
def verify(archive: tuple[Path, ...], form: str) -> None:
    """Check archives: every byte against its SHA-256, the structure, every row of every log, the results.

    Exit status 1 when one is not whole; the others are checked all the same.
    """
    import json

    from rangeeval.parsers.archive import verify as checked

    found: list[dict[str, Any]] = []
    for path in archive:
        try:
            found.append(checked(path).as_dict())
        except RangeevalError as error:
            found.append({"path": str(path), "whole": False, "reason": str(error)})
    if form == "json":
        click.echo(json.dumps(found, allow_nan=False, ensure_ascii=False, indent=1))
    for item in found:
        if not item["whole"]:
            click.echo(f"rangeeval: {one_line(item['reason'], 1000)}", err=True)
        elif form == "table":
            held = f"layout {item['layout']}, {item['logs']} logs, {item['rows']:,} rows, {item['sources']} sources"
            click.echo(f"{one_line(item['path'])}: whole ({held}, SHA-256 {item['sha256']})")
    if not all(item["whole"] for item in found):
        sys.exit(1)


@cli.command()
@paths
@click.option("--format", "form", type=click.Choice(["table", "json"]), default="table", show_default=True)
def inspect(trial: tuple[Path, ...], form: str) -> None:
    """What each file was recognised as: columns, units, rows, span, gaps, rejected rows."""
    import json

    from rangeeval.parsers.inspection import inspect_trial

    found = [item.as_dict() for item in inspect_trial(list(trial) if len(trial) > 1 else trial[0])]
    if form == "json":
        click.echo(json.dumps(found, allow_nan=False, ensure_ascii=False, indent=1))
        return
    from rangeeval.reporting.terminal import inspection_text

    click.echo(inspection_text(found, sys.stdout), nl=False)


@cli.command()
@click.argument("scenario", type=click.Choice(list(SCENARIOS)))
@click.option("-o", "--output", type=click.Path(path_type=Path, file_okay=False), help="Folder to write.")
@click.option("--seed", type=int, default=1, show_default=True)
@click.option("--flights", type=click.IntRange(1), help="alpha-beta: how many (default 4).")
@click.option("--manoeuvre", type=float, metavar="M_S2", help="alpha-beta: target acceleration sigma (default 0).")
@click.option("--outbound", is_flag=True, default=None, help="alpha-beta: each flight also flies back out.")
@click.option("--no-truth", is_flag=True, default=None, help="alpha-beta: leave out the truth log.")
@click.option("--radius-upper", type=float, metavar="M", help="attitude: of the upper accelerometer (default 5).")
@click.option("--radius-lower", type=float, metavar="M", help="attitude: of the lower accelerometer (default 1).")
@click.option("--rate", type=float, metavar="HZ", help="attitude: accelerometer samples a second (default 10).")
@click.option("--gap", is_flag=True, default=None, help="attitude: leave 12 seconds out of the tilt log.")
@click.option("--grid", is_flag=True, help="attitude: print the peak errors of Fig. 3; no trial is needed.")
@click.option(
    "--swerling", type=click.Choice(["0", "1", "2", "3", "4"]), help="swerling: the target's case (default 3)."
)
@click.option("--rcs", "rcs_m2", type=float, metavar="M2", help="swerling: mean RCS (default 2).")
@click.option("--broadside", "broadside_db", type=float, metavar="DB", help="swerling: how much larger from the side.")
@click.option("--table", is_flag=True, help="swerling: print the paper's Monte Carlo table; no trial is needed.")
@click.option("--runs", type=click.IntRange(2), default=10_000, show_default=True, help="swerling: runs of --table.")
def simulate(scenario: str, output: Path | None, seed: int, grid: bool, table: bool, runs: int, **options: Any) -> None:
    """Make a synthetic trial with known answers.

    alpha-beta: a radar whose alpha-beta tracker follows targets inbound from 100 km.
    attitude: a radar that rocks at 0.8 Hz, with a pair of accelerometers, while a target flies in.
    swerling: looks at one target of known mean RCS; with --table, RMS errors of all five RCS methods.
    """
    import inspect as signatures

    from rangeeval.scenarios import scenario as load

    write = load(scenario)
    known = signatures.signature(write).parameters
    given = {name: value for name, value in options.items() if value is not None}
    strange = [name for name in given if name not in known]
    strange += ["grid"] if grid and scenario != "attitude" else []
    strange += ["table"] if table and scenario != "swerling" else []
    if strange:
        raise click.UsageError(f"--{strange[0].replace('_', '-')} does not go with the scenario '{scenario}'")
    if output is None and not (grid or table):
        raise click.UsageError("Missing option '-o' / '--output'.")
    for path in write(output, seed=seed, **given) if output is not None else []:
        click.echo(path)
    if grid:
        from rangeeval.scenarios.attitude import figure_3_text

        click.echo(figure_3_text(given.get("radius_upper", 5.0)), nl=False)
    if table:
        from rangeeval.scenarios.swerling import compare_methods, comparison_text

        click.echo(comparison_text(compare_methods(runs, seed)), nl=False)


def opened(trial: list[Path]) -> Trial:
    """The trial at these paths."""
    from rangeeval.parsers import open_trial

    return open_trial(trial if len(trial) > 1 else trial[0])


def bins_of(
    trial: Trial, *, variable: str | None, bin_width: float | None, bin_start: float | None, snr_span: float | None
) -> Bins:
    """The trial's bins with what the options change."""
    import dataclasses

    from rangeeval.model import Bins
    from rangeeval.model.settings import VARIABLES, settings_from

    asked = {"variable": variable, "width": bin_width, "start": bin_start, "snr_span_db": snr_span}
    own = {k: v for k, v in dataclasses.asdict(trial.settings.bins).items() if v is not None}
    if variable in VARIABLES and variable != own["variable"]:  # the trial's own width and start are of another unit
        if bin_width is None and snr_span is None:
            raise SettingsError(f"--bins {variable} needs --bin-width: the trial's own is for {own['variable']}")
        own = {"min_samples": own["min_samples"]}
    merged = {**own, **{k: v for k, v in asked.items() if v is not None}}
    return Bins.of(settings_from({"bins": merged}, "options").bins)


def show(trial: Trial, result: Result, form: str | None, output: Path | None) -> None:
    """Print or write a result in the form asked for (by default that of the file's ending, else a table)."""
    import dataclasses

    from rangeeval import flow

    form = form or {".json": "json", ".csv": "csv"}.get(output.suffix.lower() if output else "", "table")
    problems = tuple(dict.fromkeys((*trial.problems, *result.problems)))
    if form == "json":
        origin = result.provenance or flow.provenance(trial)
        text = dataclasses.replace(result, problems=problems, provenance=origin).to_json() + "\n"
    elif form == "csv":
        text = result.estimates.to_csv(index=False, lineterminator="\n")
    else:
        from rangeeval.reporting.terminal import as_text

        text = as_text(result, None if output else sys.stdout)
    _write(text, output)
    _warn(problems)


def _write(text: str, output: Path | None) -> None:
    if output is None:
        click.echo(text, nl=False)
    else:
        output.write_text(text, encoding="utf-8", newline="")


def _warn(problems: Iterable[Problem]) -> None:
    for problem in dict.fromkeys(problems):
        click.echo(f"rangeeval: {one_line(problem)}", err=True)
        for example in problem.examples:
            click.echo(f"  {one_line(example)}", err=True)


@contextlib.contextmanager
def progress(label: str) -> Iterator[Callable[[int], None] | None]:
    """Rows read so far on standard error, once it takes over a second; nothing when that is not a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description} {task.completed:,.0f} rows"), TimeElapsedColumn())
    bar = Progress(*columns, console=Console(stderr=True), transient=True)
    task = bar.add_task(label, total=None)
    started = time.monotonic()
    live = False

    def advance(rows: int) -> None:
        nonlocal live
        if not live and time.monotonic() - started > 1.0:
            bar.start()
            live = True
        bar.advance(task, rows)

    try:
        yield advance
    finally:
        if live:
            bar.stop()


def _is_results(path: Path) -> bool:
    return path.is_file() and path.suffix.lower() == ".json"


def _pair(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise SettingsError(f"--when '{one_line(text, 60)}': expected COLUMN_min=NUMBER or COLUMN_max=NUMBER") from None


def main() -> None:
    """The entry point: one clear line and exit status 1 for whatever the input or the machine made impossible."""
    try:
        cli(standalone_mode=True)
    except RangeevalError as error:
        _fail(str(error))
    except BrokenPipeError:  # the reader (`| head`) has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except OSError as error:
        _fail(f"{error.filename or 'file'}: {error.strerror or error}")
    except MemoryError:
        _fail("not enough memory")
    except Exception as error:
        if os.environ.get("RANGEEVAL_DEBUG"):
            raise
        _fail(f"internal error, please report it: {type(error).__name__}: {error} (RANGEEVAL_DEBUG=1 shows where)")


def _fail(line: str) -> None:
    click.echo(f"rangeeval: {one_line(line, 1000)}", err=True)
    sys.exit(1)


if __name__ == "__main__":
    main()
