"""`rangeeval catalog`: an index over many archives or results."""

from __future__ import annotations

import click

from rangeeval.cli.lazy import LazyGroup

COMMANDS: dict[str, str] = {
    "add": "rangeeval.cli.catalog.adding:add",
    "list": "rangeeval.cli.catalog.listing:list_",
    "show": "rangeeval.cli.catalog.listing:show",
    "trend": "rangeeval.cli.catalog.trend:trend",
    "rebuild": "rangeeval.cli.catalog.adding:rebuild",
}


@click.group(cls=LazyGroup, table=COMMANDS)
def catalog() -> None:
    """An index over many archives or results, in one SQLite file that can always be made again from them."""
