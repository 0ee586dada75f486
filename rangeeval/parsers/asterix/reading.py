"""The records of one sensor as rows of a log, some data blocks at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.model import Problem
from rangeeval.model.table import MAX_SHOWN
from rangeeval.parsers.asterix.framing import Frame
from rangeeval.parsers.asterix.reports import NO_HEIGHT, Report, Rows, is_address, name_of
from rangeeval.parsers.asterix.tables import HEADER_BYTES, Edition, Malformed
from rangeeval.parsers.blocks import Block, Coded
from rangeeval.parsers.clock import Clock
from rangeeval.parsers.columns import Field
from rangeeval.physics.geodesy import latitude_longitude
from rangeeval.units import spellings

Numbers = dict[str, NDArray[np.float64]]
Offsets = NDArray[np.int64]

_BATCH_BYTES = 1 << 20
_NO_SENSOR = -1
_LONGEST_ITEM = 64
_FOOT_M = spellings("height_m", "m")["height_ft"].factor
_TARGET_REPORT = 1  # the message type of CAT010
_DAMAGED = "data blocks that do not fit the tables of their edition: none of their records is read"
_FOREIGN = "records of another sensor inside a data block: not read"
_SERVICE = "service messages (start of a turn, status), no target reports"


def sensor_of(block: bytes) -> int:
    """The sensor of a block's first record, 256 SAC + SIC; -1 where it names none."""
    at, last = HEADER_BYTES, len(block) - 3
    if not block[at] & 0x80:
        return _NO_SENSOR
    while at <= last and block[at] & 1:
        at += 1
    return block[at + 1] << 8 | block[at + 2] if at <= last else _NO_SENSOR


def shown(sensor: int) -> str:
    """A sensor as `SAC/SIC`."""
    return "-" if sensor == _NO_SENSOR else f"{sensor >> 8}/{sensor & 255}"


@dataclass(frozen=True)
class Records:
    """Records found in data blocks: the place of the block of each in the file, the bytes, and where items lie in them.

    `damaged`: the places of blocks that are left out.
    """

    offsets: Offsets
    data: NDArray[np.uint8]
    places: NDArray[np.int64]
    damaged: Offsets


@dataclass(frozen=True)
class Source:
    """A sensor whose records become a log, by which report and edition.

    `shared`: its records stand in one data block with those of other sensors. `origin`: latitude and longitude (rad) of
    the point that x and y count from; positions are made of them.
    """

    report: Report
    edition: Edition
    sensor: int
    shared: bool = False
    origin: tuple[float, float] | None = None

    @property
    def name(self) -> str:
        """Category and sensor: `CAT048 25/11`."""
        return f"CAT{self.report.category:03d} {shown(self.sensor)}"

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of the columns of its rows, with their units."""
        return ("time_s", "target_id", *self.report.columns)

    def fit(self, sample: Sequence[Frame]) -> tuple[int, int]:
        """How many of these data blocks are what the tables say, and how many rows they give."""
        records = _records(self.edition, sample)
        rows = self.report.rows(self.numbers(records))
        return len(sample) - len(records.damaged), int(np.count_nonzero(~_refused(rows)))

    def has_rows(self, sample: Iterable[Frame]) -> bool:
        """Whether some record of these data blocks has a number that the report needs."""
        numbers = self.numbers(_records(self.edition, sample))
        own = _sensors(numbers) == self.sensor
        return any(bool(np.isfinite(numbers[name][own]).any()) for name in self.report.needs)

    def sensors_in(self, sample: Iterable[Frame]) -> set[int]:
        """The sensors whose records stand in these data blocks."""
        return set(map(int, _sensors(self.numbers(_records(self.edition, sample)))))

    def first_time(self, sample: Iterable[Frame]) -> list[tuple[int, float]]:
        """Where the first record of these data blocks is that becomes a row, and its time of day."""
        records = _records(self.edition, sample)
        numbers = self.numbers(records)
        rows = self.report.rows(numbers)
        usable = np.flatnonzero(~_refused(rows) & (_sensors(numbers) == self.sensor))
        return [(int(records.offsets[usable[0]]), float(rows.time_s[usable[0]]))] if len(usable) else []

    def numbers(self, records: Records) -> Numbers:
        """The numbers of records, (n,) each, in the units of their fields; NaN where missing."""
        found = self.edition.numbers(records.data, records.places)
        numbers = {name: found.get(name, np.full(len(records.places), np.nan)) for name in self.report.fields}
        if self.origin is not None and {"x", "latitude"} <= set(numbers):
            made = latitude_longitude(numbers["y"], numbers["x"], (*self.origin, 0.0))
            for name, angle in zip(("latitude", "longitude"), made, strict=True):
                numbers[name] = np.where(np.isnan(numbers[name]), np.degrees(angle), numbers[name])
        return numbers


def _records(edition: Edition, frames: Iterable[Frame]) -> Records:
    """The records of whole data blocks, one after another."""
    blocks: list[bytes] = []
    offsets: list[int] = []
    begins: list[int] = []
    places: list[list[int]] = []
    damaged: list[int] = []
    begin = 0
    for at, block in frames:
        try:
            found = edition.records(block)
        except Malformed:
            damaged.append(at)
            continue
        blocks.append(block)
        offsets += [at] * len(found)
        begins += [begin] * len(found)
        places += found
        begin += len(block)
    inside = np.array(places, np.int64).reshape(len(places), len(edition.slots))
    absolute = np.where(inside >= 0, inside + np.array(begins, np.int64).reshape(-1, 1), -1)
    # What is missing is looked up at -1: the last byte. Some bytes more, so that a field from there on is inside.
    data = np.frombuffer(b"".join([*blocks, bytes(_LONGEST_ITEM)]), np.uint8)
    return Records(np.array(offsets, np.int64), data, absolute, np.array(damaged, np.int64))


def _sensors(numbers: Numbers) -> NDArray[np.float64]:
    """The sensor of each record."""
    return np.where(np.isnan(numbers["sac"]), _NO_SENSOR, 256 * numbers["sac"] + numbers["sic"])


def _refused(rows: Rows) -> NDArray[np.bool_]:
    refused = np.zeros(len(rows.time_s), bool)
    for _, mask in rows.refused:
        refused |= mask
    return refused


@dataclass(frozen=True)
class Reader:
    """Reads a source's rows from a recording.

    `start`: the time of day at which the recording begins; rows count from the midnight before. `several`: other
    sensors of the file give logs of the kind, so names of targets that are one sensor's own say whose they are.
    """

    source: Source
    frames: Callable[[], Iterator[Frame]]
    file: str
    where: str
    start: float | None
    several: bool
    height_m: float | None

    def place(self, row: int) -> str:
        """Where a row's data block begins, for messages."""
        return f"{self.file} byte {row}"

    def blocks(self, fields: Sequence[Field]) -> Iterator[Block]:
        """The rows, in the file's order."""
        clock = Clock()
        if self.start is not None:
            clock.run_on(self.start)
        for frames in self._batches():
            yield self._block(frames, fields, clock)

    def _batches(self) -> Iterator[list[Frame]]:
        """The data blocks in which the source's records can be."""
        category, sensor, shared = self.source.report.category, self.source.sensor, self.source.shared
        batch: list[Frame] = []
        size = 0
        for frame in self.frames():
            block = frame[1]
            if block[0] == category and (shared or sensor_of(block) == sensor):
                batch.append(frame)
                size += len(block)
                if size >= _BATCH_BYTES:
                    yield batch
                    batch, size = [], 0
        if batch:
            yield batch

    def _block(self, frames: Sequence[Frame], fields: Sequence[Field], clock: Clock) -> Block:
        """The rows of some data blocks."""
        records = _records(self.source.edition, frames)
        numbers = self.source.numbers(records)
        chosen, problems = self._chosen(frames, records, numbers)
        offsets = records.offsets[chosen]
        rows = self.source.report.rows({name: column[chosen] for name, column in numbers.items()})
        keep = ~_refused(rows)
        problems += [self._problem(reason, offsets[mask]) for reason, mask in rows.refused if mask.any()]
        columns: dict[str, Any] = {name: column[keep] for name, column in rows.columns.items()}
        for reason, mask in rows.notes:
            if count := int(np.count_nonzero(mask[keep])):
                if reason == NO_HEIGHT and self.height_m is not None:
                    columns["height_ft"] = np.where(mask[keep], self.height_m / _FOOT_M, columns["height_ft"])
                    reason = "positions without any height are at the height_m of trial.toml"
                problems.append(Problem(self.where, reason, count))
        columns["time_s"] = np.array([clock.run_on(time) for time in rows.time_s[keep].tolist()])
        columns["target_id"] = self._names(rows.names[keep])
        found = [columns[self.source.columns[f.position]] for f in fields]
        return Block(found, offsets[keep], tuple(problems))

    def _chosen(
        self, frames: Sequence[Frame], records: Records, numbers: Numbers
    ) -> tuple[NDArray[np.bool_], list[Problem]]:
        """The source's target reports among the records, and what is wrong with others."""
        source = self.source
        problems = []
        damaged = records.damaged
        if len(damaged) and source.shared:  # told once, by the log of the sensor that the block names first
            block = dict(frames)
            damaged = np.array([at for at in damaged.tolist() if sensor_of(block[at]) == source.sensor], np.int64)
        if len(damaged):
            problems.append(self._problem(_DAMAGED, damaged))
        chosen = _sensors(numbers) == source.sensor
        if not source.shared and not chosen.all():
            problems.append(self._problem(_FOREIGN, records.offsets[~chosen]))
        if "message" in numbers:
            service = chosen & (numbers["message"] != _TARGET_REPORT)
            if service.any():
                problems.append(Problem(self.where, _SERVICE, int(service.sum())))
            chosen &= ~service
        return chosen, problems

    def _names(self, numbers: NDArray[np.int64]) -> Coded:
        """The names of targets as labels."""
        own = f"{shown(self.source.sensor)} " if self.several else ""
        known, codes = np.unique(numbers, return_inverse=True)
        shift = int(len(known) > 0 and known[0] < 0)
        plots = self.source.report.kind == "plots"
        labels = [
            f"{own}{name_of(number)}" if plots or not is_address(number) else name_of(number)
            for number in known[shift:].tolist()
        ]
        return Coded(codes.astype(np.int32) - shift, labels)

    def _problem(self, reason: str, offsets: Offsets) -> Problem:
        """Records or data blocks that are left out."""
        places = tuple(self.place(int(at)) for at in offsets[:MAX_SHOWN])
        return Problem(self.where, reason, len(offsets), places, rejected=True)
