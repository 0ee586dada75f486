"""`rangeeval catalog add` and `rangeeval catalog rebuild`."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rangeeval.cli.catalog.options import catalog_option, given_paths
from rangeeval.errors import one_line

if TYPE_CHECKING:
    from rangeeval.catalog import Added


@click.command()
@click.argument("paths", metavar="DIR_OR_FILES...", nargs=-1, required=True, type=click.Path(path_type=Path))
@catalog_option
def add(paths: tuple[Path, ...], file: Path) -> None:
    """Index archives and results (folders are searched for both).

    The same content is indexed once. Exit status 1 when a file cannot be read; the others are indexed all the same.
    """
    from rangeeval.catalog import open_catalog
    from rangeeval.many.indexing import index

    with open_catalog(file, create=True) as catalog:
        found = index(catalog, paths, _say)
    _finish(file, found)


@click.command()
@given_paths
@catalog_option
def rebuild(paths: tuple[Path, ...], file: Path) -> None:
    """Make the index anew: from the files it knows, or from these. Files that are gone are left out, and said."""
    from rangeeval.catalog import open_catalog
    from rangeeval.many.indexing import rebuild as made_anew

    with open_catalog(file, create=True) as catalog:
        found, failed = made_anew(catalog, paths)
    for added in (*found, *failed):
        _say(added)
    _finish(file, [*found, *failed])


def _say(added: Added) -> None:
    """What is not as usual, on standard error."""
    path, other = one_line(added.path), one_line(added.same, 1000)
    words = {
        "failed": other,
        "known": "" if str(Path(path).absolute()) == other else f"the same file as {other}, which is indexed",
        "moved": f"was {other}",
        "replaced": "has changed; what was indexed of it is replaced" + (f"; the same trial as {other}" * bool(other)),
        "added": f"the same trial as {other}" if other else "",
    }[added.status]
    if words:
        click.echo(f"rangeeval: {path}: {words}", err=True)


def _finish(file: Path, found: list[Added]) -> None:
    counts = Counter(added.status for added in found)
    said = ", ".join(f"{counts[status]} {status}" for status in ("added", "replaced", "moved", "known", "failed")
                     if counts[status])  # fmt: skip
    click.echo(f"{file}: {said or 'no archive and no results found'}")
    if counts["failed"]:
        sys.exit(1)
