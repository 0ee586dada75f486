"""`trial.toml` as settings."""

from __future__ import annotations

import tomllib
from pathlib import Path

from rangeeval.errors import SettingsError, one_line
from rangeeval.model import TrialSettings, settings_from

FILE = "trial.toml"
_LARGEST = 1 << 20


def read_settings(path: Path, where: str | None = None) -> TrialSettings:
    """The settings of a `trial.toml`.

    Raises SettingsError in one line: a syntax error with its line number, an unknown key with the nearest known one.
    """
    where = where or path.name
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SettingsError(f"{where}: cannot be read ({error.strerror})") from None
    if len(data) > _LARGEST:
        raise SettingsError(f"{where}: is {len(data)} bytes; settings are text of at most 1 MB")
    try:
        parsed = tomllib.loads(data.decode("utf-8-sig").replace("\r\n", "\n"))
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise SettingsError(f"{where}:{line}: is not UTF-8 text") from None
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise SettingsError(f"{where}: {one_line(error)}") from None
    return settings_from(parsed, where)


def file_of(folder: Path, name: str, where: str) -> Path:
    """The path of a file that `[[logs]]` names. Raises SettingsError when it is missing or not inside the folder."""
    path = folder / name
    if Path(name).is_absolute() or not path.resolve().is_relative_to(folder.resolve()):
        raise SettingsError(f"{where}: [[logs]] file '{one_line(name, 100)}' is outside the trial's folder")
    if not path.is_file():
        raise SettingsError(f"{where}: [[logs]] file '{one_line(name, 100)}' does not exist")
    return path
