"""Data blocks out of bytes: category, length, records; what lies between blocks is found, counted and stepped over."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator
from typing import IO

from rangeeval.parsers.asterix.tables import HEADER_BYTES

LARGEST = 65_535
READ_BYTES = 1 << 20
_REPEATS = 512
_ENOUGH, _SURELY = 3, 8  # data blocks in a row that are no chance, at the begin of a file and further on
_EVIDENT = 36.0
_AHEAD = (_SURELY + 1) * LARGEST  # so many blocks and the header after them can be judged

# What the categories hold (EUROCONTROL's list); any other number begins no data block.
CATEGORIES = {
    1: "monoradar target reports", 2: "monoradar service messages", 3: "distribution messages",
    4: "safety net messages", 7: "directed interrogation messages", 8: "monoradar weather", 9: "composite weather",
    10: "surface target reports", 11: "surface fusion reports", 15: "INCS target reports",
    16: "INCS configuration", 17: "Mode S surveillance coordination", 18: "Mode S data link",
    19: "multilateration status", 20: "multilateration target reports", 21: "ADS-B target reports",
    23: "ADS-B service messages", 24: "ADS-B picture", 25: "ADS-B system status", 32: "flight plan messages",
    34: "monoradar service messages", 48: "monoradar target reports", 62: "system tracks", 63: "sensor status",
    65: "SDPS service messages", 128: "ACTC", 129: "drone positions", 150: "MADAP", 204: "multistatic radar",
    205: "direction finder reports", 238: "quality control", 239: "quality control", 240: "radar video",
    247: "version numbers", 252: "session control",
}  # fmt: skip
_BEGIN = re.compile(b"[%s]" % re.escape(bytes(CATEGORIES)))

Note = Callable[[str, int, int], None]  # a reason, where, and how many bytes
Frame = tuple[int, bytes]  # where a data block begins, and the block

NO_BLOCK = "UDP packets that hold no data block"
GARBAGE = "bytes between data blocks that belong to none"
CUT_OFF = "a data block that is cut off at the end"
REPEATED = "data blocks that repeat another of shortly before to the last byte (recorded twice): the first is read"


def plausible(data: bytes, at: int) -> int:
    """The length of the data block that begins here, 0 when none can: an unknown category, or shorter than a record."""
    if at + HEADER_BYTES > len(data) or data[at] not in CATEGORIES:
        return 0
    size = data[at + 1] << 8 | data[at + 2]
    return size if size > HEADER_BYTES + 1 else 0


def linked(data: bytes, at: int, ended: bool) -> int:
    """The length of a data block here that another follows, or the end; 0 when neither does."""
    size = plausible(data, at)
    after = at + size
    if not size or after > len(data):
        return 0
    return size if (after == len(data) and ended) or plausible(data, after) else 0


def is_chain(data: bytes, ended: bool) -> bool:
    """Whether the bytes are a chain of data blocks from their first one on, or (cut out of a recording) from a later.

    Blocks count whose first record names its sensor: the first byte of such a record has its highest bit set, which no
    ASCII text has.
    """
    if _follows(data, 0, ended, _ENOUGH):
        return True
    # The length of most blocks begins with a zero byte. Text has none, or (UTF-16) at every other place only.
    even, odd = data[:LARGEST:2].count(0), data[1:LARGEST:2].count(0)
    if 4 * min(even, odd) <= max(even, odd):
        return False
    return any(_follows(data, found.start(), ended, _SURELY) for found in _BEGIN.finditer(data, 1, LARGEST))


def _follows(data: bytes, at: int, ended: bool, most: int) -> bool:
    """Whether so many data blocks follow each other from here, or fewer up to the data's end."""
    begin = at
    for _ in range(most):
        size = plausible(data, at)
        if not size or at + HEADER_BYTES >= len(data) or data[at + HEADER_BYTES] < 0x80:
            return False
        at += size
        if at >= len(data):
            # The last of several may be cut off; a first one may not: any bytes could be the begin of a large block.
            return begin == 0 and at == len(data) and ended
        if len(data) - at <= HEADER_BYTES:
            return begin == 0 and ended
    return True


def in_stream(stream: IO[bytes], note: Note) -> Iterator[Frame]:
    """The data blocks of a file, in memory of bounded size."""
    data, base, ended = b"", 0, False
    while not ended:
        more = stream.read(READ_BYTES)
        ended = not more
        data += more
        at = 0
        while at < len(data) if ended else at + _AHEAD <= len(data):
            size = linked(data, at, ended)
            if size:
                yield base + at, data[at : at + size]
                at += size
                continue
            size = plausible(data, at)
            begin = _next(data, at + 1, ended)
            if size and at + size <= begin:  # whole, and only what follows it is not
                yield base + at, data[at : at + size]
                at += size
                if at == begin:
                    continue
            if begin == len(data) and ended and plausible(data, at) and at + plausible(data, at) > begin:
                note(CUT_OFF, base + at, begin - at)
            else:
                note(GARBAGE, base + at, begin - at)
            at = begin
        base += at
        data = data[at:]


def _next(data: bytes, at: int, ended: bool) -> int:
    """Where data blocks follow each other next; the end of the data when nowhere (short of it, to be read on).

    A header in noise may announce a long block that ends where by chance another begins, and so swallow all between:
    a shorter block inside a longer one, with others behind it, is the likelier.
    """
    last = max(len(data) if ended else len(data) - _AHEAD + 1, at)
    found, size, stop = last, LARGEST + 1, last
    while at < stop:
        candidate = _BEGIN.search(data, at, stop)
        if candidate is None:
            break
        at = candidate.start()
        shorter = plausible(data, at)
        if shorter < size and _resumes(data, at, ended):
            found, size, stop = at, shorter, min(last, at + shorter)
        at += 1
    return found


def _resumes(data: bytes, at: int, ended: bool) -> bool:
    """Whether data blocks follow each other from here that are no chance, or some to the end.

    In noise any number can be a header, but rarely one of a short block: a header of 50 bytes stands at one place in
    20,000, and three that follow each other nowhere. Of long blocks more are asked.
    """
    evidence = 0.0  # bits: 4 for the category and a named sensor, and for the length what it is short of 65,536
    for _ in range(_SURELY):
        size = linked(data, at, ended)
        if not size or data[at + HEADER_BYTES] < 0x80:
            return False
        at += size
        evidence += 20 - math.log2(size)
        if at == len(data) or evidence > _EVIDENT:
            return True
    return True


def in_payload(offset: int, data: bytes, note: Note) -> Iterator[Frame]:
    """The data blocks of one packet, which begin with its first byte."""
    at = 0
    while size := plausible(data, at):
        if at + size > len(data):
            break
        yield offset + at, data[at : at + size]
        at += size
    if at < len(data):
        note(GARBAGE if at else NO_BLOCK, offset + at, len(data) - at)


def distinct(frames: Iterable[Frame], note: Note) -> Iterator[Frame]:
    """The data blocks without those that are recorded twice: two networks, or a mirrored port."""
    recent: dict[bytes, None] = {}
    for at, block in frames:
        if block in recent:
            note(REPEATED, at, len(block))
            continue
        recent[block] = None
        if len(recent) > _REPEATS:
            del recent[next(iter(recent))]
        yield at, block
