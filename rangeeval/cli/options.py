"""The arguments and options that commands share, and what they are turned into."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rangeeval.errors import SettingsError, one_line

if TYPE_CHECKING:
    from rangeeval.model import BinChoice, Bins, Trial

Command = Callable[..., Any]

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


def opened(trial: list[Path]) -> Trial:
    """The trial at these paths."""
    from rangeeval.parsers import open_trial

    return open_trial(trial if len(trial) > 1 else trial[0])


def bin_choice(
    *, variable: str | None, bin_width: float | None, bin_start: float | None, snr_span: float | None
) -> BinChoice:
    """What the options ask of the bins of any trial."""
    from rangeeval.model import BinChoice

    return BinChoice(variable, bin_width, bin_start, snr_span)


def bins_of(trial: Trial, **bins: Any) -> Bins:
    """The trial's bins with what the options change."""
    return bin_choice(**bins).of(trial.settings.bins)


def pair(text: str) -> tuple[str, float]:
    """The name and the number of `NAME=NUMBER`."""
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise SettingsError(f"--when '{one_line(text, 60)}': expected COLUMN_min=NUMBER or COLUMN_max=NUMBER") from None
