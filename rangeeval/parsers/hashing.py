"""SHA-256 of the files a trial was read from."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

from rangeeval.model import Source


def sha256_of(sources: Iterable[Source]) -> dict[str, str]:
    """The SHA-256 of every source file, by its name inside the trial: as archived, or of the file read in pieces."""
    found: dict[str, str] = {}
    for source in sources:
        if source.sha256:
            found[source.name] = source.sha256
            continue
        with open(source.path, "rb") as stream:
            found[source.name] = hashlib.file_digest(stream, "sha256").hexdigest()
    return found
