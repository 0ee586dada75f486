"""Bytes of a text log as whole UTF-8 lines: decompressed, decoded, line ends made alike, in blocks of bounded size."""

from __future__ import annotations

import codecs
import contextlib
import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, cast

import numpy as np

from rangeeval.errors import InputError, MissingExtra

BLOCK_BYTES = 8 << 20
MAX_LINE_BYTES = 1 << 20

_GZIP = b"\x1f\x8b"
_ZSTD = b"\x28\xb5\x2f\xfd"
_BOMS = ((codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"))


def _zstd() -> Any:
    try:
        from compression import zstd  # type: ignore[import-not-found, unused-ignore]
    except ImportError:
        try:
            from backports import zstd
        except ImportError:
            raise MissingExtra("reading .zst logs", "zstd") from None
    return zstd


def compression(head: bytes) -> str:
    """How these first bytes of a file are compressed: gzip, zstd or nothing ('')."""
    return "gzip" if head.startswith(_GZIP) else "zstd" if head.startswith(_ZSTD) else ""


@contextlib.contextmanager
def opened(path: Path) -> Iterator[IO[bytes]]:
    """The file's bytes, decompressed."""
    with path.open("rb") as raw:
        how = compression(raw.read(4))
        raw.seek(0)
        if how == "gzip":
            with gzip.GzipFile(fileobj=raw) as stream:
                yield cast(IO[bytes], stream)
        elif how == "zstd":
            with _zstd().ZstdFile(raw) as stream:
                yield stream
        else:
            yield raw


def damage() -> tuple[type[Exception], ...]:
    """What decompressing a damaged file raises."""
    kinds: tuple[type[Exception], ...] = (EOFError, zlib.error, gzip.BadGzipFile)
    with contextlib.suppress(MissingExtra):
        kinds += (_zstd().ZstdError,)
    return kinds


def head_of(path: Path, size: int) -> bytes:
    """The first bytes of a file, decompressed; as many as a damaged file still gives."""
    parts: list[bytes] = []
    got = 0
    with opened(path) as stream:
        try:
            while got < size and (part := stream.read(min(size - got, 1 << 16))):
                parts.append(part)
                got += len(part)
        except damage():
            pass
    return b"".join(parts)


def encoding_of(head: bytes, configured: str | None) -> tuple[str, int]:
    """The encoding that a byte order mark, else `trial.toml`, else the rule (UTF-8) gives, and the mark's length."""
    for mark, name in _BOMS:
        if head.startswith(mark):
            return name, len(mark)
    return configured or "utf-8", 0


def one_newline(data: bytes) -> bytes:
    """CRLF and CR line ends made LF."""
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in data else data


def lines(path: Path, where: str, encoding: str, mark: int) -> Iterator[tuple[int, int, bytes]]:
    """Blocks of whole lines as UTF-8, each ending in a newline: number of the first line (from 1), how many, and bytes.

    Raises InputError for a damaged or truncated compressed file, bytes that are not of the encoding, and a line longer
    than `MAX_LINE_BYTES`; each names the line.
    """
    line = 1
    rest: list[bytes] = []
    waiting = 0
    decoder = None if encoding == "utf-8" else codecs.getincrementaldecoder(encoding)("strict")
    try:
        with opened(path) as stream:
            stream.read(mark)
            while True:
                data = stream.read(BLOCK_BYTES)
                ended = not data
                if decoder is not None:
                    data = decoder.decode(data, final=ended).encode("utf-8")
                while data.endswith(b"\r") and not ended:  # the other half of a CRLF may come next
                    more = stream.read(1 if decoder is None else 2)
                    if decoder is not None:
                        data += decoder.decode(more, final=not more).encode("utf-8")
                    else:
                        data += more
                    ended = not more
                data = one_newline(data)
                cut = data.rfind(b"\n") + 1
                if cut:
                    block = b"".join([*rest, data[:cut]])
                    count = int(np.count_nonzero(np.frombuffer(block, np.uint8) == 10))  # five times bytes.count
                    yield line, count, block
                    line += count
                    rest, waiting = [], 0
                if data[cut:]:
                    rest.append(data[cut:])
                    waiting += len(rest[-1])
                if waiting > MAX_LINE_BYTES:
                    raise InputError(f"{where}:{line}: this line is longer than 1 MB; is it a text log?")
                if ended:
                    break
    except UnicodeDecodeError as error:
        raise InputError(f"{where}: from line {line} on there are bytes that are not {encoding} text") from error
    except damage() as error:
        raise InputError(f"{where}: the compressed file is damaged or cut off somewhere after line {line}") from error
    if rest:
        yield line, 1, b"".join([*rest, b"\n"])
