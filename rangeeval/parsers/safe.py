"""Run a look into a foreign binary file in a child process: a crash or an endless loop becomes one clear line.

The child has limits on time, processor and memory, and answers in JSON (never pickle). Where the system can fork, the
child is a fork (a few milliseconds); elsewhere a fresh interpreter.
"""

from __future__ import annotations

import faulthandler
import importlib
import json
import os
import select
import signal
import subprocess
import sys
import time
import warnings
from typing import Any

from rangeeval.errors import InputError, RangeevalError

SECONDS = 20.0
CPU_SECONDS = 10
MEMORY_BYTES = 4 << 30
_LARGEST_REPLY = 64 << 20


def call(module: str, function: str, path: str, where: str, *, seconds: float = SECONDS) -> Any:
    """What `module.function(path)` returns (plain JSON values), computed in a child process.

    Raises InputError when the child says so, crashes, runs out of time or of memory; `where` begins the message.
    """
    if hasattr(os, "fork") and sys.platform != "darwin":  # macOS system libraries are not safe after a fork
        importlib.import_module(module)
        reply, fault = _forked(module, function, path, seconds)
    else:
        reply, fault = _spawned(module, function, path, seconds)
    if fault:
        raise InputError(f"{where}: {fault}")
    try:
        answer = json.loads(reply)
    except ValueError:
        raise InputError(f"{where}: the file could not be looked into (its reader gave no answer)") from None
    if "refused" in answer:
        raise InputError(f"{where}: {answer['refused']}")
    return answer["found"]


def _answer(module: str, function: str, path: str) -> bytes:
    try:
        answer = {"found": getattr(importlib.import_module(module), function)(path)}
    except RangeevalError as error:
        answer = {"refused": str(error)}
    except MemoryError:
        answer = {"refused": "looking into the file takes more memory than is allowed"}
    except Exception as error:  # a foreign file may raise anything; the child's one task is to say so
        text = f"{type(error).__name__}: {error}".replace("\n", " ")
        answer = {"refused": f"the file is damaged ({text[:200]})"}
    return json.dumps(answer).encode("ascii")


def _limit() -> None:
    import resource

    in_use = 0
    try:
        with open("/proc/self/statm", encoding="ascii") as pages:
            in_use = int(pages.read().split()[0]) * resource.getpagesize()
    except OSError:
        pass
    for name, amount in (
        ("RLIMIT_AS", in_use + MEMORY_BYTES),
        ("RLIMIT_CPU", CPU_SECONDS),
        ("RLIMIT_CORE", 0),
        ("RLIMIT_FSIZE", 0),
    ):
        try:
            kind = getattr(resource, name)
            _, hard = resource.getrlimit(kind)
            soft = amount if hard == resource.RLIM_INFINITY else min(amount, hard)
            resource.setrlimit(kind, (soft, hard))
        except (AttributeError, ValueError, OSError):
            pass


def _forked(module: str, function: str, path: str, seconds: float) -> tuple[bytes, str]:
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
            _limit()
            with open(write_end, "wb") as pipe:
                pipe.write(_answer(module, function, path))
        finally:
            os._exit(0)
    os.close(write_end)
    parts: list[bytes] = []
    size = 0
    deadline = time.monotonic() + seconds
    ended = late = False
    try:
        while not ended and not late:
            left = deadline - time.monotonic()
            ready = left > 0 and select.select([read_end], [], [], left)[0]
            if not ready:
                late = True
            elif part := os.read(read_end, 1 << 16):
                parts.append(part)
                size += len(part)
                late = size > _LARGEST_REPLY
            else:
                ended = True
    finally:
        os.close(read_end)
        if not ended:
            os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
    return b"".join(parts), "" if ended and status == 0 else _fault(late, os.waitstatus_to_exitcode(status), seconds)


def _spawned(module: str, function: str, path: str, seconds: float) -> tuple[bytes, str]:
    command = [sys.executable, "-c", "from rangeeval.parsers import safe; safe.main()", module, function, path]
    try:
        done = subprocess.run(command, capture_output=True, timeout=seconds, check=False)
    except subprocess.TimeoutExpired:
        return b"", _fault(True, 0, seconds)
    return done.stdout, "" if done.returncode == 0 else _fault(False, done.returncode, seconds)


def _fault(late: bool, code: int, seconds: float) -> str:
    if late or code == -getattr(signal, "SIGXCPU", 0):
        return f"the file is damaged: looking into it did not end within {seconds:g} s"
    return f"the file is damaged: its reader crashed on it ({code})"


def main() -> None:
    """The child's side where it is a fresh interpreter."""
    module, function, path = sys.argv[1:4]
    if sys.platform != "win32":
        _limit()
    sys.stdout.buffer.write(_answer(module, function, path))
