"""A process that evaluates trials one after another and dies alone.

Whoever hands out trials, this process's parent, keeps living when a trial kills it: the trial is known, since it was
the only one at work, and is tried again in a new process, then named. Jobs go in and outcomes come out as lines of
JSON.
"""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from typing import IO, Any

from rangeeval.errors import one_line
from rangeeval.many.work import FAILED, Job, Outcome, perform

ATTEMPTS = 3
_READY = b"ready\n"  # what it says first; a trial's time counts from there
IDLE_SECONDS = 60.0  # after which a process that nobody asks ends by itself


class Child:
    """The parent's side. Not to be used by two threads at a time."""

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        self._environment = {**os.environ, **(environment or {})}
        self._ready = False
        self._process: subprocess.Popen[bytes] | None = None
        self._said: IO[bytes] = tempfile.TemporaryFile("ab+")  # noqa: SIM115  (lives as long as this object)

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def perform(self, job: Job, time_limit: float | None = None) -> Outcome:
        """What comes of a job. A process that dies is replaced, and its trial tried again, `ATTEMPTS` times in all."""
        why = ""
        for _ in range(ATTEMPTS):
            answer, late = self._ask(job.as_json().encode() + b"\n", time_limit)
            if answer.endswith(b"\n"):
                return Outcome.from_json(answer)
            if late:
                self._end()
                return Outcome(job.path, FAILED, why=f"it took longer than {time_limit:g} s and was stopped")
            why = self._end()
        return Outcome(job.path, FAILED, why=f"its process died each of {ATTEMPTS} times: {why}")

    def _ask(self, line: bytes, time_limit: float | None) -> tuple[bytes, bool]:
        """The answer to a line; less than a line when the process died, by the time limit or by itself."""
        if self._process is None or self._process.poll() is not None:
            self._start()
        process = self._process
        assert process is not None
        assert process.stdin is not None
        assert process.stdout is not None
        if not self._ready:
            self._ready = process.stdout.readline() == _READY
        late = threading.Event()

        def stop() -> None:
            late.set()
            process.kill()

        timer = threading.Timer(time_limit, stop) if time_limit else None
        try:
            if timer:
                timer.start()
            process.stdin.write(line)
            process.stdin.flush()
            return process.stdout.readline(), late.is_set()
        except OSError:
            return b"", late.is_set()
        finally:
            if timer:
                timer.cancel()

    def _start(self) -> None:
        self._end()
        self._said.truncate(0)
        self._ready = False
        self._process = subprocess.Popen(
            [sys.executable, "-c", "from rangeeval.many.child import main; main()"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._said, env=self._environment,
        )  # fmt: skip

    def _end(self) -> str:
        """End the process if it lives, and say how it ended."""
        if (process := self._process) is None:
            return ""
        self._process = None
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        try:
            code = process.wait(5.0)
        except subprocess.TimeoutExpired:
            process.kill()
            code = process.wait()
        return f"{_ending(code)}{self._last_words()}"

    def _last_words(self) -> str:
        self._said.seek(max(0, self._said.seek(0, os.SEEK_END) - 2000))
        lines = self._said.read().decode("utf-8", "replace").split("\n")
        words = [line for line in lines if line.strip()]
        return f" ({one_line(words[-1], 200)})" if words else ""

    def close(self) -> None:
        """End the process."""
        self._end()
        self._said.close()


def _ending(code: int) -> str:
    if code >= 0:
        return f"exit status {code}"
    with contextlib.suppress(ValueError):
        return f"signal {-code} ({signal.Signals(-code).name})"
    return f"signal {-code}"


def main() -> None:
    """The child's side: a job a line on standard input, an outcome a line on standard output, till there is no more."""
    answers = os.fdopen(os.dup(1), "wb")
    answers.write(_READY)
    answers.flush()
    os.dup2(2, 1)  # what a library prints is no answer
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent to act on
    asked: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(sys.stdin.buffer, asked), daemon=True).start()
    while True:
        try:
            line = asked.get(timeout=IDLE_SECONDS)
        except queue.Empty:
            return
        answers.write(perform(Job.from_json(line.decode())).as_json().encode() + b"\n")
        answers.flush()


def _listen(stream: Any, asked: queue.SimpleQueue[bytes]) -> None:
    """Pass lines on; end the process when its parent closes the pipe or is gone, in the middle of a trial too."""
    for line in stream:
        asked.put(line)
    os._exit(0)
