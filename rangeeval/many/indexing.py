"""Archives and results put into a catalogue."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from rangeeval import flow
from rangeeval.catalog import Added, Catalog, Entry, Terms
from rangeeval.catalog.trend import trend
from rangeeval.errors import InputError, RangeevalError, one_line
from rangeeval.model import Result
from rangeeval.parsers import archive

FAILED = "failed"


def find_indexable(paths: Iterable[str | os.PathLike[str]]) -> Iterator[Path]:
    """Archives and results (`.json`) at these paths; folders are searched all the way down, in order of name.

    Raises InputError for a path that does not exist.
    """
    for path in map(Path, paths):
        if not path.exists():
            raise InputError(f"{one_line(path)}: no such file or folder")
        if path.is_dir():
            for folder, names, files in os.walk(path):
                names.sort()
                yield from (
                    file for file in (Path(folder) / name for name in sorted(files))
                    if not file.name.startswith(".") and _could_be_ours(file)
                )  # fmt: skip
        else:
            yield path


def _could_be_ours(path: Path) -> bool:
    if not path.is_file():
        return False
    if path.suffix.lower() != ".json":
        return archive.is_archive(path)
    with path.open("rb") as stream:  # not every JSON file in a folder is results
        return stream.read(64).startswith(b'[{"schema":')


def index(
    catalog: Catalog, paths: Iterable[str | os.PathLike[str]], report: Callable[[Added], None] | None = None
) -> list[Added]:
    """Add the archives and results at these paths. One that cannot be read is `failed`, with the reason in `same`; the
    others go on. What is known costs no more than its hash.
    """
    found = []
    for path in find_indexable(paths):
        added = _indexed(catalog, path)
        found.append(added)
        if report is not None:
            report(added)
    return found


def rebuild(catalog: Catalog, paths: Iterable[str | os.PathLike[str]] = ()) -> tuple[list[Added], list[Added]]:
    """Make the catalogue anew from these paths; without any, from the files it knows. Returns what was added, and what
    could not be read and so is left out.
    """
    failed: list[Added] = []
    given = list(paths)
    known = [Path(result.path) for result in catalog.results()]
    places = list(find_indexable(given)) if given else known

    def entries() -> Iterator[Entry]:
        for path in places:
            try:
                yield entry_of(path)
            except (RangeevalError, OSError) as error:
                failed.append(Added(str(path), FAILED, _reason(error)))

    return catalog.rebuild(entries()), failed


def trend_of(catalog: Catalog, terms: Terms | None = None, *, alpha: float = 0.05) -> Result:
    """The trend (see `catalog.trend`), with the software it was made by."""
    found = trend(catalog, terms, alpha=alpha)
    return replace(found, provenance={**found.provenance, "versions": flow.versions()})


def _indexed(catalog: Catalog, path: Path) -> Added:
    try:
        place = str(path.absolute())
        if (known := catalog.knows(sha256 := content_hash(path))) is not None:
            if known != place and not Path(known).exists():
                catalog.move(sha256, place)
                return Added(str(path), "moved", known)
            return Added(str(path), "known", known)
        return catalog.add(entry_of(path))
    except OSError as error:
        return Added(str(path), FAILED, _reason(error))
    except RangeevalError as error:
        if str(error).startswith(catalog.where):  # the catalogue's fault, not the file's
            raise
        return Added(str(path), FAILED, _reason(error))


def _reason(error: Exception) -> str:
    said = f"cannot be read ({error.strerror or error})" if isinstance(error, OSError) else str(error)
    return one_line(said, 1000)


def content_hash(path: Path) -> str:
    """The SHA-256 that tells one archive or results file from another: the one an archive states, else of all bytes."""
    if archive.is_archive(path):
        return archive.header_of(path).sha256
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def entry_of(path: Path) -> Entry:
    """An archive or a results file, read to be indexed. Raises InputError for what is neither."""
    sha256 = content_hash(path)
    is_archive = archive.is_archive(path)
    results = archive.archived_results(path) if is_archive else flow.read_results(path)
    form = "archive" if is_archive else "results"
    return Entry(sha256, str(path.absolute()), form, path.stat().st_size, tuple(results))
