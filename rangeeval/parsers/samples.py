"""Snapshots of an array out of any file: what the file says of the array, and its samples piece by piece.

A format says how many rows and sensors it holds and opens itself for reading; all else is done here, once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import InputError, one_line
from rangeeval.model import Log, Problem, SensorArray, Table, piece_rows
from rangeeval.model.settings import UNKNOWN_ARRAY
from rangeeval.model.table import MAX_SHOWN, real_or_complex
from rangeeval.parsers.blocks import SourceFile
from rangeeval.units import spellings

MAX_SENSORS = 4096
NAMES = ("samples", "snapshots")
PARTS = (("real", "imag"), ("re", "im"), ("r", "i"), ("i", "q"))

# What a file may say of its array: the name in the file (with any unit of its kind), and its stored unit.
_FACTS = {
    "sensor_position_m": "m",
    "frequency_hz": "hz",
    "propagation_speed_m_s": "m_s",
    "sampling_rate_hz": "hz",
    "start_time_s": "s",
    "heading_deg": "deg",
}
FACTS = {written: (name, unit) for name, si in _FACTS.items() for written, unit in spellings(name, si).items()}
TIMES = spellings("time_s", "s")

# The times of some rows (None: from the sampling rate) and their samples, (rows, sensors).
ReadRows = Callable[[int, int], tuple[NDArray[Any] | None, NDArray[Any]]]
Opened = Callable[[], AbstractContextManager[ReadRows]]


@dataclass(frozen=True)
class Recorded:
    """Snapshots as a file holds them.

    `opened()` gives, while open, the reader of rows `start` to `stop`; it is asked in the order of the rows. `time`:
    the name of the times in the file ('' for none), `samples` that of the samples, `said` what the file says of the
    array. `row` words the number of a row for a message.
    """

    where: str
    rows: int
    sensors: int
    opened: Opened
    said: SensorArray = UNKNOWN_ARRAY
    time: str = ""
    samples: str = "samples"


def said_of(values: Mapping[str, Any], where: str) -> SensorArray:
    """What a file says of its array, from its own names and numbers. Raises InputError for what cannot be."""
    found: dict[str, Any] = {}
    for written, value in values.items():
        name, unit = FACTS[written]
        try:
            numbers = unit.to_si(np.asarray(value, dtype=np.float64))
        except (TypeError, ValueError):
            raise InputError(f"{where}: {written} is not made of numbers") from None
        if not np.isfinite(numbers).all():
            raise InputError(f"{where}: {written} holds a number that is missing or infinite")
        if name in found:
            raise InputError(f"{where}: gives {name} twice, also as {written}; keep one")
        if name == "sensor_position_m":
            if numbers.ndim != 2 or numbers.shape[1] not in (2, 3) or len(numbers) > MAX_SENSORS:
                raise InputError(
                    f"{where}: {written} has the shape {numbers.shape}, expected (sensors, 2) or (sensors, 3)"
                )
            found[name] = tuple(map(tuple, numbers.tolist()))
        elif numbers.size != 1:
            raise InputError(f"{where}: {written} has {numbers.size} numbers, expected one")
        else:
            found[name] = float(numbers.reshape(()))
            if name.endswith(("_hz", "_m_s")) and found[name] <= 0:
                raise InputError(f"{where}: {written} is {found[name]:g}, expected more than 0")
    return SensorArray(**found)


def snapshots_log(recorded: Recorded, file: SourceFile) -> Log:
    """The log that reads recorded snapshots; what `trial.toml` says of the array stands over what the file says.

    Raises InputError for an array of another number of sensors, or rows without a time.
    """
    where, sensors = recorded.where, recorded.sensors
    array = file.array.over(recorded.said)
    if not 1 <= sensors <= MAX_SENSORS:
        raise InputError(f"{where}: its samples have {sensors} columns; an array of 1 to {MAX_SENSORS} sensors is read")
    placed = len(array.sensor_position_m)
    if placed and placed != sensors:
        hint = "; are they stored sensors x snapshots?" if placed == recorded.rows else ""
        raise InputError(
            f"{where}: its samples have {sensors} columns and sensor_position_m has {placed} rows, expected one row a "
            f"sensor{hint}"
        )
    if array.sensors and len(array.sensors) != sensors:
        raise InputError(f"{where}: its samples have {sensors} columns and array.sensors names {len(array.sensors)}")
    if not recorded.time and array.sampling_rate_hz is None:
        raise InputError(
            f"{where}: has no time_s; give sampling_rate_hz in it or in [array] of trial.toml (and start_time_s)"
        )

    def pieces(names: Collection[str] | None = None) -> Iterator[Table]:
        wanted = {"time_s", "samples"} if names is None else {"time_s"} | ({"samples"} & set(names))
        size = piece_rows(sensors)
        with recorded.opened() as read:
            for start in range(0, max(recorded.rows, 1), size):
                yield _piece(recorded, array, read, start, min(recorded.rows, start + size), wanted)

    written = {"time_s": recorded.time or "(from sampling_rate_hz)", "samples": recorded.samples}
    return Log("snapshots", where, ("time_s", "samples"), pieces, recorded.rows, written=written, array=array)


def _piece(
    recorded: Recorded, array: SensorArray, read: ReadRows, start: int, stop: int, wanted: Collection[str]
) -> Table:
    time, samples = read(start, stop)
    if time is None:
        assert array.sampling_rate_hz is not None
        time = array.start_time_s + np.arange(start, stop) / array.sampling_rate_hz
    else:
        time = TIMES[recorded.time.casefold()].to_si(np.asarray(time, np.float64))
    columns: dict[str, Any] = {"time_s": time}
    problems: tuple[Problem, ...] = ()
    if "samples" in wanted:
        values = np.array(real_or_complex(samples))
        if array.conjugate:
            np.conjugate(values, out=values)
        problems = _unfinished(recorded, values, start)
        columns["samples"] = values
    return Table(columns, {}, start, problems)


def _unfinished(recorded: Recorded, values: NDArray[Any], start: int) -> tuple[Problem, ...]:
    """Samples that are missing or infinite become NaN; snapshots with such a sample are counted."""
    with np.errstate(invalid="ignore", over="ignore"):
        if math.isfinite(abs(complex(values.sum()))):
            return ()
    bad = ~np.isfinite(values)
    values[bad] = np.nan
    rows = np.flatnonzero(bad.any(axis=1))
    if not len(rows):
        return ()
    examples = tuple(
        f"{recorded.where}[{start + i}]: sensor {int(np.argmax(bad[i])) + 1} has no number"
        for i in rows[:MAX_SHOWN].tolist()
    )
    reason = "snapshots with a sample that is missing or infinite; they are not used"
    return (Problem(recorded.where, reason, len(rows), examples),)


def as_complex(values: NDArray[Any]) -> NDArray[Any]:
    """Rows of a compound of real and imaginary part as complex numbers; others as they are."""
    if values.dtype.names is None:
        return values
    real, imaginary = values.dtype.names
    made = np.empty(values.shape, np.complex128)
    made.real, made.imag = values[real], values[imaginary]
    return made


def joined(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Samples out of one array, or of two of their real and imaginary part."""
    return parts[0] if len(parts) == 1 else parts[0] + 1j * parts[1]


def is_pair(names: tuple[str, ...] | None) -> bool:
    """Whether the fields of a compound are a real and an imaginary part."""
    return names is not None and tuple(n.casefold() for n in names) in PARTS


def split_part(name: str) -> tuple[str, str]:
    """The stem and the ending of a name that may say real or imaginary part: `x_imag` gives ('x', 'imag')."""
    stem, _, ending = name.casefold().rpartition("_")
    return stem, ending


def among(wide: list[dict[str, Any]], path: str) -> dict[str, Any] | None:
    """Which of the described matrices of a group are array samples; None for none. Raises InputError for several.

    Each is described by `name`, `path`, `rows`, `sensors` and whether it is `complex` or `real` (`kind`); what is found
    has `datasets` besides, the paths of the samples or of their real and imaginary part.
    """
    halves: dict[str, dict[str, dict[str, Any]]] = {}
    for item in wide:
        if item["kind"] == "real":
            stem, ending = split_part(item["name"])
            halves.setdefault(stem, {})[ending] = item
    candidates = [{**item, "datasets": [item["path"]]} for item in wide if item["kind"] == "complex"]
    for stem, parts in halves.items():
        pair = next((pair for pair in PARTS if parts.keys() >= set(pair)), None)
        if pair is None:
            continue
        real, imaginary = (parts[ending] for ending in pair)
        if (real["rows"], real["sensors"]) != (imaginary["rows"], imaginary["sensors"]):
            raise InputError(
                f"'{one_line(real['path'], 100)}' and '{one_line(imaginary['path'], 100)}' differ in shape; expected "
                "the real and the imaginary part of the same samples"
            )
        name = stem or f"{real['name']} + {imaginary['name']}"
        candidates.append({**real, "name": name, "kind": "complex", "datasets": [real["path"], imaginary["path"]]})
    if not candidates:
        candidates = [{**item, "datasets": [item["path"]]} for item in wide if item["name"].casefold() in NAMES]
    named = [item for item in candidates if item["name"].casefold() in NAMES]
    if len(candidates) > 1 and len(named) != 1:
        names = ", ".join(one_line(item["name"], 60) for item in candidates[:5])
        raise InputError(f"'{one_line(path, 100)}' holds several complex arrays ({names}); call the samples 'samples'")
    return next(iter(named or candidates), None)


def shown(name: str) -> str:
    """A name of a file's own in a message."""
    return one_line(name, 60)
