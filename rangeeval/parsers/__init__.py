"""Parsers: bytes in, canonical tables out, in SI units, with what could not be read named and counted."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

from rangeeval.errors import InputError, one_line
from rangeeval.model import Log, Problem, SensorArray, Source, Trial, TrialSettings
from rangeeval.model.settings import LogSettings
from rangeeval.parsers import archive, asterix, binary, hdf5, matlab, numpy_files, parquet, sac, text
from rangeeval.parsers.blocks import Contents, SourceFile
from rangeeval.parsers.hashing import sha256_of
from rangeeval.parsers.settings import FILE, file_of, read_settings

HEAD_BYTES = 4096


@dataclass(frozen=True)
class Format:
    """A file format: whether these first bytes are of it (never the name), and how its logs are read.

    `together`: reads all files of the format in a trial as one, where a file holds one channel. `described`: whether
    what `trial.toml` says of a file makes it one of the format, whatever its bytes are.
    """

    recognises: Callable[[bytes, Path], bool]
    read: Callable[[SourceFile], Contents]
    together: Callable[[Sequence[SourceFile]], Contents] | None = None
    described: Callable[[LogSettings], bool] = lambda settings: False


# Asked in this order; text last, since a binary file may begin like text.
FORMATS: dict[str, Format] = {
    "hdf5": Format(hdf5.recognises, hdf5.read),
    "matlab": Format(matlab.recognises, matlab.read),
    "matlab-7.3": Format(matlab.recognises_hdf5, matlab.read),
    "parquet": Format(parquet.recognises, parquet.read),
    "npz": Format(numpy_files.recognises_npz, numpy_files.read_npz),
    "npy": Format(numpy_files.recognises_npy, numpy_files.read_npy),
    "sac": Format(sac.recognises, sac.read, together=sac.read_together),
    "pcap": Format(asterix.recognises_capture, asterix.read_capture),
    "asterix": Format(asterix.recognises, asterix.read),
    "text": Format(text.recognises, text.read),
    "binary": Format(binary.recognises, binary.read, described=binary.described),
}

# What reports and pictures begin with (in lower case): files that stand beside logs and are none.
_NOT_LOGS = (b"%pdf", b"\x89png", b"\xff\xd8\xff", b"gif8", b"<!doctype", b"<html", b"<svg", b"<?xml", b"{", b"[")


def formats() -> Mapping[str, Format]:
    """Every format: the built-in ones, and those of installed packages (entry points `rangeeval.formats`)."""
    from importlib.metadata import entry_points

    added = {point.name: point.load() for point in entry_points(group="rangeeval.formats")}
    return {**added, **FORMATS}


def open_trial(
    paths: str | os.PathLike[str] | Iterable[str | os.PathLike[str]], *, settings: TrialSettings | None = None
) -> Trial:
    """Open a trial: a folder of logs, one or several log files, or an archive. Rows are read later, piece by piece.

    Of a folder, its own files are read and those that `[[logs]]` of its `trial.toml` names; subfolders are not
    searched. `settings` replaces `trial.toml`. Raises InputError or SettingsError for what cannot be used.
    """
    chosen = [Path(paths)] if isinstance(paths, (str, os.PathLike)) else [Path(p) for p in paths]
    if not chosen:
        raise InputError("no trial folder and no log file given")
    for path in chosen:
        if not path.exists():
            raise InputError(f"{one_line(path)}: no such file or folder")
    folders = [path for path in chosen if path.is_dir()]
    if folders and len(chosen) > 1:
        raise InputError(f"give one trial folder or log files, not {one_line(folders[0])} and others together")
    if folders:
        return _folder(folders[0], settings)
    archives = [path for path in chosen if path.is_file() and archive.is_archive(path)]
    if archives and len(chosen) > 1:
        raise InputError(f"{one_line(archives[0])} is the archive of a whole trial; give it alone")
    if archives:
        return archive.open_archive(archives[0], settings)
    named = [path for path in chosen if path.name == FILE]
    if named and settings is None:
        settings = read_settings(named[0])
    files = [SourceFile(path, one_line(path.name)) for path in chosen if path.name != FILE]
    folder = chosen[0].resolve().parent
    name = files[0].path.stem if len(files) == 1 else folder.name
    array = settings.array if settings else SensorArray()
    files = [replace(file, settings=_settings_of(file, folder, settings), array=array) for file in files]
    return _trial(name, files, settings or TrialSettings(), must=True)


def _settings_of(file: SourceFile, folder: Path, settings: TrialSettings | None) -> LogSettings | None:
    for log in settings.logs if settings else ():
        if (folder / log.file).resolve() == file.path.resolve():
            return log
    return None


def _folder(folder: Path, settings: TrialSettings | None) -> Trial:
    name = folder.resolve().name
    where = f"{one_line(name)}/{FILE}"
    if settings is None:
        settings = read_settings(folder / FILE, where) if (folder / FILE).is_file() else TrialSettings()
    described = {file_of(folder, log.file, where).resolve(): log for log in settings.logs}
    files: dict[Path, SourceFile] = {}
    for entry in sorted(folder.iterdir()):
        # Only plain files: opening a pipe or a device could wait for ever.
        if not entry.name.startswith(".") and entry.name != FILE and _is_plain(entry):
            files[entry.resolve()] = SourceFile(
                entry, f"{one_line(name)}/{one_line(entry.name)}", described.get(entry.resolve()), settings.array
            )
    for path, log in described.items():
        if path not in files:
            files[path] = SourceFile(folder / log.file, f"{one_line(name)}/{one_line(log.file)}", log, settings.array)
    return _trial(name, list(files.values()), settings, must=False)


def _is_plain(path: Path) -> bool:
    try:
        return stat.S_ISREG(path.stat().st_mode)
    except OSError:
        return False


def _trial(name: str, files: Sequence[SourceFile], settings: TrialSettings, *, must: bool) -> Trial:
    logs: list[Log] = []
    sources: list[Source] = []
    problems: list[Problem] = []
    known = formats()
    for group, format_name, contents in _contents(files, known):
        if not contents.logs:
            if must or any(file.settings is not None for file in group):
                why = contents.unrecognised or "it is a report, a picture or settings"
                raise InputError(f"{group[0].name}: not recognised as a log: {why}")
            if contents.unrecognised:
                problems.append(Problem(group[0].name, f"not recognised as a log: {contents.unrecognised}"))
            continue
        logs += contents.logs
        problems += contents.problems
        kinds = ", ".join(dict.fromkeys(log.kind for log in contents.logs))
        for file in group:
            inside = file.name.split("/", 1)[-1]
            sources.append(Source(inside, str(file.path), format_name, kinds, file.path.stat().st_size))
    if not logs:
        seen = "; ".join(f"{p.where}: {p.reason}" for p in problems[:3])
        raise InputError(f"{one_line(name)}: no log was recognised in it" + (f" ({seen})" if seen else ""))
    return Trial(name, tuple(logs), settings, tuple(sources), tuple(problems))


def could_be_log(head: bytes, path: Path) -> bool:
    """Whether a file that begins with `head` is worth reading as a log: a known format, no picture, no archive."""
    if not head or _is_no_log(head) or archive.recognises(head):
        return False
    return any(entry.recognises(head, path) for entry in formats().values())


def _is_no_log(head: bytes) -> bool:
    return head.lstrip(b"\xef\xbb\xbf \t\r\n").lower().startswith(_NOT_LOGS)


def _contents(
    files: Sequence[SourceFile], known: Mapping[str, Format]
) -> Iterator[tuple[list[SourceFile], str, Contents]]:
    """What each file holds; of a format that is read together, its files as one, after the others."""
    groups: dict[str, list[SourceFile]] = {}
    for file in files:
        format_name, contents = _read(file, known)
        if contents is None:
            groups.setdefault(format_name, []).append(file)
        else:
            yield [file], format_name, contents
    for format_name, group in groups.items():
        together = known[format_name].together
        assert together is not None
        yield group, format_name, together(group)


def _read(file: SourceFile, known: Mapping[str, Format]) -> tuple[str, Contents | None]:
    """The format of a file and what it holds; None where it is to be read together with others."""
    try:
        with file.path.open("rb") as stream:
            head = stream.read(HEAD_BYTES)
    except OSError as error:
        raise InputError(f"{file.name}: cannot be read ({error.strerror})") from None
    if not head:
        return "", Contents(unrecognised="the file is empty")
    if _is_no_log(head) and file.settings is None:
        return "", Contents()
    if archive.recognises(head):
        return "", Contents(unrecognised="it is the archive of a whole trial, to be read by itself")
    format_name = _format_of(head, file, known)
    if format_name is None:
        hint = "a binary log of fixed records is described by fields under [[logs]] in trial.toml"
        return "", Contents(unrecognised=f"its content is of no known format; {hint}")
    entry = known[format_name]
    return format_name, entry.read(file) if entry.together is None else None


def _format_of(head: bytes, file: SourceFile, known: Mapping[str, Format]) -> str | None:
    """The format that `trial.toml` makes the file one of, else the first that recognises its content."""
    said = file.settings
    described = (name for name, entry in known.items() if said is not None and entry.described(said))
    recognised = (name for name, entry in known.items() if entry.recognises(head, file.path))
    return next(chain(described, recognised), None)


__all__ = ["FORMATS", "HEAD_BYTES", "Format", "could_be_log", "formats", "open_trial", "read_settings", "sha256_of"]
