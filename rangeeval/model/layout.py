"""The layout of an archive: the names in the file, and the header before it that says what it is and proves it whole.

An archive is an HDF5 file behind a user block of `HEADER_BYTES`. HDF5 ignores the block; we keep in it, as text, the
version of the layout, the size of the file and the SHA-256 of all that follows.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

from rangeeval.errors import InputError, one_line

VERSION = 2
WITHOUT_ARRAYS = 1  # the layout of a trial without a snapshots log: releases that know no other read it too
HEADER_BYTES = 512
MAGIC = b"rangeeval archive "

LOGS = "logs"
ESTIMATES = "estimates"
PROBLEMS = "problems"
META = "meta_json"
RESULTS = "results_json"

MAX_TEXT_BYTES = 1024  # of one cell of a text column


@dataclass(frozen=True)
class Header:
    """What the first bytes of an archive say."""

    version: int
    size: int
    sha256: str

    def as_bytes(self) -> bytes:
        """The header block: lines of text, the last one the SHA-256 of those before, then zeros."""
        lines = MAGIC + f"{self.version}\nsize {self.size}\nsha256 {self.sha256}\n".encode("ascii")
        lines += f"header {hashlib.sha256(lines).hexdigest()}\n".encode("ascii")
        return lines.ljust(HEADER_BYTES, b"\0")


def read_header(head: bytes, where: str) -> Header:
    """The header in the first bytes of a file. Raises InputError for another version, or a damaged block."""
    if not head.startswith(MAGIC):
        raise InputError(f"{where}: not an archive of rangeeval")
    lines = head[:HEADER_BYTES].rstrip(b"\0").split(b"\n")
    try:
        version = int(lines[0][len(MAGIC) :])
    except ValueError:
        shown = one_line(lines[0].decode("ascii", "replace"), 60)
        raise InputError(f"{where}: the archive is damaged: its header begins '{shown}'") from None
    if not WITHOUT_ARRAYS <= version <= VERSION:
        raise InputError(
            f"{where}: an archive of layout {version}; this version of rangeeval reads layouts 1 to {VERSION}"
        )
    try:
        sha256 = lines[2].removeprefix(b"sha256 ").decode("ascii")
        header = Header(version, int(lines[1].removeprefix(b"size ")), sha256)
    except (ValueError, IndexError):
        raise InputError(f"{where}: the archive is damaged: its header cannot be read") from None
    if header.as_bytes() != head[:HEADER_BYTES]:
        raise InputError(f"{where}: the archive is damaged: its header does not fit its own SHA-256")
    return header
