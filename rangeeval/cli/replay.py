"""`rangeeval replay`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rangeeval.cli.options import bin_options, bins_of, opened, paths
from rangeeval.cli.output import progress, show, write


@click.command()
@paths
@click.option(
    "--filter", "name", metavar="NAME", help="alpha-beta, kalman, imm (default), kalman-ca, imm3, imm-paper, ..."
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the residual log with gains to this file (with --smooth the trajectory); results to a .json.",
)
@click.option("--format", "form", type=click.Choice(["table", "json", "csv"]), help="Of the results. Default: table.")
@click.option("--compare", is_flag=True, help="Also run alpha-beta, kalman and imm: paired differences.")
@click.option("--tune", is_flag=True, help="First find the noise and manoeuvre parameters that the plots support.")
@click.option("--smooth", is_flag=True, help="-o writes the smoothed trajectory with its covariance instead.")
@click.option(
    "--associate",
    type=click.Choice(["id", "nearest", "global", "pda"]),
    help="How plots are given to tracks. Default: target_id where the log has it, else global.",
)
@click.option("--per-track", is_flag=True, help="Also rows for each track in each bin.")
@bin_options
def replay(
    trial: tuple[Path, ...], name: str | None, output: Path | None, form: str | None, compare: bool, tune: bool,
    smooth: bool, associate: str | None, per_track: bool, confidence: float, **bins: Any,
) -> None:  # fmt: skip
    """Run recorded plots through a tracking filter: residuals, gains, innovation tests; with truth, errors.

    The results go to standard output. -o FILE writes the residual log with gains, which `rangeeval accuracy` reads; a
    FILE that ends in .json gets the results instead.
    """
    from rangeeval.analyses.replay import replay as analyse
    from rangeeval.analyses.replay import run_replay

    if smooth and output is None:
        raise click.UsageError("--smooth needs -o FILE: where to write the trajectory")
    one = opened(list(trial))
    results = output if output is not None and output.suffix.lower() == ".json" and not smooth else None
    with progress("replay") as advance:
        done = run_replay(one, name, association=associate, tune=tune, confidence=confidence, progress=advance)
        result = analyse(
            one, bins_of(one, **bins), compare=compare, confidence=confidence, per_track=per_track, replayed=done
        )
    if output is not None and results is None:
        write(done.reference_csv() if smooth else done.residuals_csv(), output)
    show(one, result, form, results)
