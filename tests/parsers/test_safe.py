"""Rows streamed out of a child process: they come as they are made, and however the child ends is one line."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from rangeeval.errors import InputError
from rangeeval.parsers import safe

HERE = "tests.parsers.test_safe"


def counts(path: str, how: str, times: int) -> Iterator[bytes]:
    for i in range(times):
        yield bytes([i]) * (1 << 20)
    if how == "refuses":
        raise InputError("row 3 is none")
    if how == "fails":
        raise ZeroDivisionError
    if how == "crashes":
        os.abort()
    while how == "loops":
        pass
    if how == "floods":
        yield bytes(safe.LARGEST_BUFFER + 1)
    if how == "works":  # longer in all than one answer may take
        end = time.process_time() + 1.5
        while time.process_time() < end:
            pass
        yield b""


@pytest.fixture(params=["_forked", "_spawned"])
def child(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    if request.param == "_spawned":
        monkeypatch.setattr(safe, "_forked", safe._spawned)
        monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    return str(request.param)


@pytest.mark.parametrize("times", [0, 3])
def test_buffers_come_in_order(times: int, child: str) -> None:
    """None, or several larger than a pipe holds."""
    found = list(safe.stream(HERE, "counts", "x", "file", "ends", times))
    assert [(len(buffer), buffer[0]) for buffer in found] == [(1 << 20, i) for i in range(times)]


@pytest.mark.parametrize(
    ("how", "says"),
    [
        ("refuses", "file: row 3 is none"),
        ("fails", r"file: the file is damaged \(ZeroDivisionError"),
        ("crashes", r"file: the file is damaged: its reader crashed on it \(-6\)"),
        ("loops", "file: the file is damaged: looking into it did not end within 3 s"),
        ("floods", "file: the file is damaged: its reader gave 268435457 bytes at once"),
    ],
)
def test_however_the_child_ends_is_one_line(how: str, says: str, child: str) -> None:
    """After what it gave before; where the child can fork, before it ends."""
    came: list[int] = []
    with pytest.raises(InputError, match=says):
        came.extend(buffer[0] for buffer in safe.stream(HERE, "counts", "x", "file", how, 2, seconds=3.0))
    assert came == [0, 1] or child == "_spawned"  # which gives all at once, or nothing


def test_the_limits_hold_for_each_buffer_anew() -> None:
    """A long log may take longer than one answer may; a consumer may take its time."""
    buffers = safe.stream(HERE, "counts", "x", "file", "works", 2, seconds=3.0)
    first = next(buffers)
    time.sleep(0.5)
    assert [len(first), *map(len, buffers)] == [1 << 20, 1 << 20, 0]


def test_a_child_that_is_not_read_to_its_end_is_ended() -> None:
    """No process is left behind."""
    buffers = safe.stream(HERE, "counts", "x", "file", "loops", 3)
    next(buffers)
    buffers.close()
    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)
