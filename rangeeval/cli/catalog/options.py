"""The options that the commands of the catalogue share."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rangeeval.errors import SettingsError, one_line

if TYPE_CHECKING:
    from rangeeval.catalog import Catalog, Terms

Command = Callable[..., Any]

catalog_option = click.option(
    "--catalog", "file", type=click.Path(path_type=Path, dir_okay=False), default="rangeeval-catalog.sqlite",
    show_default=True, envvar="RANGEEVAL_CATALOG", show_envvar=True, help="The catalogue's file.",
)  # fmt: skip

given_paths = click.argument("paths", metavar="[DIR_OR_FILES]...", nargs=-1, type=click.Path(path_type=Path))


def term_options(command: Command) -> Command:
    """What to look for."""
    for option in reversed((
        click.option("--radar", metavar="PATTERN", help="Of this radar (* stands for any text)."),
        click.option("--software", metavar="PATTERN", help="With this software under test."),
        click.option("--since", metavar="DATE", help="From this date on, such as 2026-05-14 or 2026-05."),
        click.option("--until", metavar="DATE", help="Up to this date."),
        click.option("--quantity", metavar="PATTERN", help="Such as range_sigma or *_sigma."),
        click.option("--variable", metavar="NAME", help="Bins of this variable."),
        click.option("--bin", "span", metavar="LOW:HIGH", help="Bins inside this span, in SI units."),
        click.option("--group", metavar="PATTERN", help="Rows of this group (leg, waveform, Swerling case)."),
    )):  # fmt: skip
        command = option(command)
    return command


def terms_of(given: Mapping[str, str | None], trials: tuple[str, ...] = ()) -> Terms:
    """The terms that the options say."""
    from rangeeval.catalog import Terms

    words: dict[str, Any] = dict(given)
    span = words.pop("span")
    return Terms(**words, bin=None if span is None else _span(span), trials=trials)


def _span(text: str) -> tuple[float, float]:
    low, _, high = text.partition(":")
    try:
        return float(low), float(high)
    except ValueError:
        raise SettingsError(f"--bin '{one_line(text, 40)}': expected LOW:HIGH, such as 20000:40000") from None


@contextlib.contextmanager
def chosen(file: Path, paths: tuple[Path, ...]) -> Iterator[Catalog]:
    """The catalogue in the file; or, when paths are given, one of just these that is not kept."""
    from rangeeval.catalog import open_catalog

    if not paths:
        with open_catalog(file) as catalog:
            yield catalog
        return
    from rangeeval.many.indexing import FAILED, index

    with open_catalog(":memory:", create=True) as catalog:
        for added in index(catalog, paths):
            if added.status == FAILED:
                click.echo(f"rangeeval: {one_line(added.path)}: {added.same}", err=True)
        yield catalog
