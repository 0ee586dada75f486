"""The catalogue: an index over the results of many trials, in one SQLite file that can always be made again."""

from rangeeval.catalog.store import Added, Catalog, Entry, open_catalog
from rangeeval.catalog.terms import Terms

__all__ = ["Added", "Catalog", "Entry", "Terms", "open_catalog"]
