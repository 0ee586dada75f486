"""Which trials there are at some paths: archives, trial folders, single logs, and folders of all of these."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from rangeeval.errors import InputError, RangeevalError, one_line
from rangeeval.parsers import HEAD_BYTES, archive, could_be_log, open_trial
from rangeeval.parsers.settings import FILE


@dataclass(frozen=True)
class Found:
    """The paths of trials, each once, in the order given (those of a folder by name), and remarks on what is none."""

    trials: tuple[str, ...]
    notes: tuple[str, ...] = ()


def find_trials(paths: Iterable[str | os.PathLike[str]]) -> Found:
    """The trials at these paths.

    A file is a trial: an archive or a log. A folder with a `trial.toml`, or with a log in it, is a trial; its
    subfolders are not searched. Any other folder is searched for archives and for folders that are trials, all the way
    down; what looks like none of these is passed over. Raises InputError for a path that does not exist, and when there
    is no trial at all.
    """
    trials: dict[tuple[int, int], str] = {}
    notes: list[str] = []
    given = [Path(path) for path in paths]
    for path in given:
        if not path.exists():
            raise InputError(f"{one_line(path)}: no such file or folder")
        for trial in _under(path, notes, given=True, seen=set()):
            mark = _mark(trial)
            if mark in trials:
                notes.append(f"{one_line(trial)}: the same place as {one_line(trials[mark])}, evaluated once")
            else:
                trials[mark] = str(trial)
    if not trials:
        raise InputError(f"{', '.join(one_line(p) for p in given) or 'nothing'}: no trial folder and no archive in it")
    return Found(tuple(trials.values()), tuple(notes))


def _mark(path: Path) -> tuple[int, int]:
    about = path.stat()
    return about.st_dev, about.st_ino


def _under(path: Path, notes: list[str], *, given: bool, seen: set[tuple[int, int]]) -> Iterator[Path]:
    if not path.is_dir():
        yield path
        return
    if (path / FILE).is_file():
        yield path
        return
    if (mark := _mark(path)) in seen:  # a link back up
        return
    seen.add(mark)
    try:
        entries = sorted(entry for entry in path.iterdir() if not entry.name.startswith("."))
    except OSError as error:
        notes.append(f"{one_line(path)}: cannot be searched ({error.strerror})")
        return
    folders = [entry for entry in entries if entry.is_dir()]
    files = [entry for entry in entries if _is_plain(entry)]
    archives = [file for file in files if archive.is_archive(file)]
    loose = [file for file in files if file not in archives and could_be_log(_head(file), file)]
    if loose and (_is_trial(path) if folders or archives else True):
        yield path
        return
    if given or loose:
        notes += [f"{one_line(file)}: neither an archive nor in a trial folder, passed over" for file in loose]
    for entry in sorted([*archives, *folders]):
        yield from _under(entry, notes, given=False, seen=seen)


def _is_plain(path: Path) -> bool:
    try:
        return stat.S_ISREG(path.stat().st_mode)
    except OSError:
        return False


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return stream.read(HEAD_BYTES)
    except OSError:
        return b""


def _is_trial(folder: Path) -> bool:
    """Whether a folder that holds other things as well holds a log itself."""
    try:
        return bool(open_trial(folder).logs)
    except RangeevalError:
        return False
