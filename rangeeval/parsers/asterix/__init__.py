"""ASTERIX: surveillance messages, as a file of data blocks or inside a network capture (extra `asterix`).

Every sensor of a file gives a log of its own: a radar's plots, or the positions that ADS-B and tracking systems report,
which serve as truth. Data blocks are found by their headers (`framing`, `captures`), walked by libasterix's tables
(`tables`), and become rows (`reports`, `reading`); `recording` says which logs a file holds.
"""

from __future__ import annotations

from pathlib import Path

from rangeeval.parsers.asterix.captures import is_capture
from rangeeval.parsers.asterix.framing import CATEGORIES, is_chain
from rangeeval.parsers.asterix.recording import Recording
from rangeeval.parsers.blocks import Contents, SourceFile
from rangeeval.parsers.streams import compression, head_of

_CHAIN_BYTES = 1 << 18


def recognises(head: bytes, path: Path) -> bool:
    """A chain of data blocks (compressed files are looked into)."""
    if head and head[0] not in CATEGORIES and b"\0" not in head and not compression(head):
        return False  # most texts, without another look
    data = head_of(path, _CHAIN_BYTES)
    return is_chain(data, len(data) < _CHAIN_BYTES)


def recognises_capture(head: bytes, path: Path) -> bool:
    """The signature of a pcap or pcapng capture (compressed files are looked into)."""
    return is_capture(head_of(path, 12) if compression(head) else head)


def read(file: SourceFile) -> Contents:
    """The logs of a file of data blocks."""
    return Recording(file, capture=False).contents()


def read_capture(file: SourceFile) -> Contents:
    """The logs of the data blocks in a capture's UDP packets."""
    return Recording(file, capture=True).contents()
