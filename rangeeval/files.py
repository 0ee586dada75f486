"""Files written whole or not at all: a kill at any moment leaves the old file or the new one, never a torn one."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows: temporary files that a crash left are not swept there
    fcntl = None  # type: ignore[assignment]

_ENDING = ".tmp"


@contextlib.contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path beside `path` to write to, which takes its place when the block ends without an error.

    The bytes are on the disk before the name is, and the name before this returns. What an earlier run left when it was
    killed is removed; what another process is writing at the moment is not: it holds a lock.
    """
    target = Path(path)
    sweep(target)
    held, name = _locked(target)
    temporary = Path(name)
    try:
        yield temporary
        with temporary.open("rb") as written:
            os.fsync(written.fileno())
        temporary.chmod(0o644)
        os.replace(temporary, target)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    finally:
        os.close(held)
    _fsync_folder(target.parent)


def write_whole(path: Path, content: bytes) -> Path:
    """Write a file whole or not at all. Returns its path."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)
    return path


def sweep(target: Path) -> int:
    """Remove what writers of `target` left when they were killed. Returns how many files."""
    return _swept(target.parent, f".{_escaped(target.name)}.*{_ENDING}")


def sweep_folder(folder: Path) -> int:
    """Remove what writers of any file of a folder left when they were killed. Returns how many files."""
    return _swept(folder, f".*.*{_ENDING}")


def _swept(folder: Path, pattern: str) -> int:
    if fcntl is None:
        return 0
    swept = 0
    for left in folder.glob(pattern):
        with contextlib.suppress(OSError):
            handle = os.open(left, os.O_RDWR | os.O_NOFOLLOW)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)  # refused while its writer lives
                left.unlink()
                swept += 1
            finally:
                os.close(handle)
    return swept


def _escaped(name: str) -> str:
    return "".join(f"[{c}]" if c in "*?[" else c for c in name)


def _locked(target: Path) -> tuple[int, str]:
    """A new file beside the target, locked for as long as its handle is open."""
    while True:
        handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.", suffix=_ENDING)
        if fcntl is None:
            return handle, name
        with contextlib.suppress(OSError):  # a share without locks: nothing is swept there either
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if Path(name).exists():
            return handle, name
        os.close(handle)  # swept between its birth and its lock


def _fsync_folder(folder: Path) -> None:
    with contextlib.suppress(OSError):  # Windows and some shares cannot
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
