"""Run the reading of a foreign binary file in a child process: a crash or an endless loop becomes one clear line.

The child has limits on time, processor and memory, and answers in JSON and plain bytes (never pickle). Where the system
can fork, the child is a fork (a few milliseconds); elsewhere a fresh interpreter.
"""

from __future__ import annotations

import faulthandler
import importlib
import json
import os
import select
import signal
import struct
import subprocess
import sys
import time
import warnings
from collections.abc import Generator, Iterator
from typing import Any

from rangeeval.errors import InputError, RangeevalError

SECONDS = 20.0
MEMORY_BYTES = 4 << 30
_LARGEST_REPLY = 64 << 20
LARGEST_BUFFER = 256 << 20
# A message: what it is, how long, and its bytes.
_HEAD = struct.Struct("<cQ")
_ANSWER, _BUFFER = b"{", b"="


def call(module: str, function: str, path: str, where: str, *arguments: Any, seconds: float = SECONDS) -> Any:
    """What `module.function(path, *arguments)` returns (plain JSON values, both ways), computed in a child process.

    Raises InputError when the child says so, crashes, runs out of time (half as much of the processor) or of memory;
    `where` begins the message.
    """
    for kind, body in _messages(module, function, path, where, arguments, seconds):
        if kind == _ANSWER:
            return _found(body, where)
    raise _no_answer(where)


def stream(
    module: str, function: str, path: str, where: str, *arguments: Any, seconds: float = SECONDS
) -> Generator[bytes, None, None]:
    """The buffers of bytes that the generator `module.function(path, *arguments)` yields in a child process, in turn.

    The limits on time hold for each of them anew. Raises InputError as `call` does. The child ends with this iterator.
    """
    for kind, body in _messages(module, function, path, where, arguments, seconds):
        if kind == _ANSWER:
            _found(body, where)
            return
        yield body
    raise _no_answer(where)


def _found(reply: bytes, where: str) -> Any:
    try:
        answer = json.loads(reply)
    except ValueError:
        raise _no_answer(where) from None
    if "refused" in answer:
        raise InputError(f"{where}: {answer['refused']}")
    return answer["found"]


def _no_answer(where: str) -> InputError:
    return InputError(f"{where}: the file could not be looked into (its reader gave no answer)")


def _messages(
    module: str, function: str, path: str, where: str, arguments: tuple[Any, ...], seconds: float
) -> Iterator[tuple[bytes, bytes]]:
    """The child's messages as they come: buffers, then one answer."""
    if hasattr(os, "fork") and sys.platform != "darwin":  # macOS system libraries are not safe after a fork
        importlib.import_module(module)
        parts = _forked(module, function, path, arguments, seconds)
    else:
        parts = _spawned(module, function, path, arguments, seconds)
    held = bytearray()
    try:
        for part in parts:
            held += part
            while len(held) >= _HEAD.size:
                kind, size = _HEAD.unpack_from(held)
                if size > (_LARGEST_REPLY if kind == _ANSWER else LARGEST_BUFFER):
                    raise InputError(f"{where}: the file is damaged: its reader gave {size} bytes at once")
                end = _HEAD.size + size
                if len(held) < end:
                    break
                body = bytes(memoryview(held)[_HEAD.size : end])
                del held[:end]
                yield kind, body
    except _Fault as fault:
        raise InputError(f"{where}: {fault}") from None


class _Fault(Exception):
    """How the child ended, where it was not as it should."""


# --- in the child ----------------------------------------------------------------------------------------------------


def _write(pipe: Any, module: str, function: str, path: str, arguments: tuple[Any, ...], seconds: float) -> None:
    """Answer into the pipe: buffers as they are made, then what was found, or why nothing was."""
    try:
        found = getattr(importlib.import_module(module), function)(path, *arguments)
        if isinstance(found, Iterator):
            for buffer in found:
                _send(pipe, _BUFFER, buffer)
                _limit_processor(seconds)
            found = None
        answer = {"found": found}
    except RangeevalError as error:
        answer = {"refused": str(error)}
    except MemoryError:
        answer = {"refused": "looking into the file takes more memory than is allowed"}
    except BrokenPipeError:
        return
    except Exception as error:  # a foreign file may raise anything; the child's one task is to say so
        text = f"{type(error).__name__}: {error}".replace("\n", " ")
        answer = {"refused": f"the file is damaged ({text[:200]})"}
    _send(pipe, _ANSWER, json.dumps(answer).encode("ascii"))


def _send(pipe: Any, kind: bytes, body: bytes) -> None:
    pipe.write(_HEAD.pack(kind, len(body)))
    pipe.write(body)
    pipe.flush()


def _limit(seconds: float) -> None:
    import resource

    in_use = 0
    try:
        with open("/proc/self/statm", encoding="ascii") as pages:
            in_use = int(pages.read().split()[0]) * resource.getpagesize()
    except OSError:
        pass
    for name, amount in (("RLIMIT_AS", in_use + MEMORY_BYTES), ("RLIMIT_CORE", 0), ("RLIMIT_FSIZE", 0)):
        _set_limit(name, amount)
    _limit_processor(seconds)


def _limit_processor(seconds: float) -> None:
    """Half of `seconds` from now on, in whole seconds as the system counts them."""
    if sys.platform != "win32":
        _set_limit("RLIMIT_CPU", int(time.process_time() + seconds / 2) + 1)


def _set_limit(name: str, amount: int) -> None:
    import resource

    try:
        kind = getattr(resource, name)
        _, hard = resource.getrlimit(kind)
        resource.setrlimit(kind, (amount if hard == resource.RLIM_INFINITY else min(amount, hard), hard))
    except (AttributeError, ValueError, OSError):
        pass


def main() -> None:
    """The child's side where it is a fresh interpreter."""
    module, function, path, arguments, seconds = sys.argv[1:6]
    if sys.platform != "win32":
        _limit(float(seconds))
    _write(sys.stdout.buffer, module, function, path, tuple(json.loads(arguments)), float(seconds))


# --- its parent ------------------------------------------------------------------------------------------------------


def _forked(
    module: str, function: str, path: str, arguments: tuple[Any, ...], seconds: float
) -> Iterator[bytes | bytearray]:
    """What the child writes, as it comes. Raises _Fault when it ends otherwise than by itself, or is silent."""
    read_end, write_end = os.pipe()
    with warnings.catch_warnings():
        # Python warns of forking with threads about. The child runs HDF5 alone (h5py holds its lock over the fork),
        # never returns to the caller, and a child that hangs ends at the time limit.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        try:
            os.close(read_end)
            faulthandler.disable()
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # what a dying library prints is not for the terminal
            _limit(seconds)
            with open(write_end, "wb") as pipe:
                _write(pipe, module, function, path, arguments, seconds)
        finally:
            os._exit(0)
    os.close(write_end)
    ended = late = False
    try:
        while not ended and not late:
            if not select.select([read_end], [], [], seconds)[0]:
                late = True
            elif part := os.read(read_end, 1 << 20):
                yield part
            else:
                ended = True
    finally:
        os.close(read_end)
        if not ended:
            os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
    if late or status != 0:
        raise _fault(late, os.waitstatus_to_exitcode(status), seconds)


def _spawned(
    module: str, function: str, path: str, arguments: tuple[Any, ...], seconds: float
) -> Iterator[bytes | bytearray]:
    """The same from a fresh interpreter, all at once."""
    start = "from rangeeval.parsers import safe; safe.main()"
    command = [sys.executable, "-c", start, module, function, path, json.dumps(arguments), str(seconds)]
    try:
        done = subprocess.run(command, capture_output=True, timeout=seconds, check=False)
    except subprocess.TimeoutExpired:
        raise _fault(True, 0, seconds) from None
    yield done.stdout
    if done.returncode != 0:
        raise _fault(False, done.returncode, seconds)


def _fault(late: bool, code: int, seconds: float) -> _Fault:
    if late or code == -getattr(signal, "SIGXCPU", 0):
        return _Fault(f"the file is damaged: looking into it did not end within {seconds:g} s")
    return _Fault(f"the file is damaged: its reader crashed on it ({code})")
