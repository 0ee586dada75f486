"""The logs of a recording, what else it holds, and what was lost of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import IO

from rangeeval.errors import InputError
from rangeeval.model import Log, Problem
from rangeeval.model.table import MAX_SHOWN
from rangeeval.parsers.asterix import framing
from rangeeval.parsers.asterix.captures import OTHER_LINK, payloads
from rangeeval.parsers.asterix.framing import Frame, Note
from rangeeval.parsers.asterix.reading import Reader, Source, sensor_of
from rangeeval.parsers.asterix.reports import REPORTS
from rangeeval.parsers.asterix.sources import Finder, Sensor
from rangeeval.parsers.asterix.tables import library
from rangeeval.parsers.blocks import Contents, SourceFile, Written, log_from
from rangeeval.parsers.columns import lay_out
from rangeeval.parsers.streams import damage, opened

_SAMPLE = 100  # data blocks of a sensor by which its edition is chosen
_SAMPLE_BYTES = 1 << 17
_MAX_SENSORS = 1024
_NOT_LOST = {framing.NO_BLOCK, OTHER_LINK}  # other traffic of a network, no rows of a log


@dataclass
class _Notes:
    """What was met that is no data block: how often, and where first."""

    where: str
    counts: Counter[str] = field(default_factory=Counter)
    examples: dict[str, list[str]] = field(default_factory=dict)

    def __call__(self, reason: str, at: int, size: int) -> None:
        self.counts[reason] += 1
        places = self.examples.setdefault(reason, [])
        if len(places) < MAX_SHOWN:
            places.append(f"{self.where} byte {at}: {size} bytes")

    def problems(self) -> list[Problem]:
        return [
            Problem(self.where, reason, count, tuple(self.examples[reason]), rejected=reason not in _NOT_LOST)
            for reason, count in self.counts.items()
        ]


def _ignore(reason: str, at: int, size: int) -> None:
    """What lies between the blocks was told when the file was opened."""


@dataclass(frozen=True)
class Recording:
    """A file of data blocks, or a capture of packets with them."""

    file: SourceFile
    capture: bool

    def frames(self, note: Note = _ignore) -> Iterator[Frame]:
        """The data blocks in the file's order, each once. Raises InputError for a damaged compressed file."""
        try:
            with opened(self.file.path) as stream:
                found = self._captured(stream, note) if self.capture else framing.in_stream(stream, note)
                yield from framing.distinct(found, note)
        except damage() as error:
            raise InputError(f"{self.file.name}: the compressed file is damaged or cut off") from error

    def _captured(self, stream: IO[bytes], note: Note) -> Iterator[Frame]:
        for at, data in payloads(stream, note):
            yield from framing.in_payload(at, data, note)

    def contents(self) -> Contents:
        """A log for every sensor whose records give one.

        Raises MissingExtra without libasterix, and SettingsError for an edition or a sensor of `trial.toml` that is not
        there.
        """
        library()
        notes = _Notes(self.file.name)
        sensors, others = self._survey(notes)
        if not sensors and not others:
            return Contents(unrecognised="it holds no ASTERIX data block")
        finder = Finder(self.file, sensors)
        sources = finder.sources()
        logs = self._logs(sources, _start(finder, sources))
        problems = [*notes.problems(), *finder.problems, *_other_messages(self.file.name, others)]
        if logs:
            return Contents(tuple(logs), tuple(problems))
        held = ", ".join(f"CAT{c:03d}" for c in sorted({c for c, _ in sensors} | set(others)))
        kind = f" of kind '{self.file.kind}'" if self.file.kind else ""
        why = "".join(f"; {p.reason}" for p in finder.problems[:3])
        return Contents(unrecognised=f"its ASTERIX messages ({held}) give no log{kind}{why}")

    def _survey(self, notes: _Notes) -> tuple[dict[tuple[int, int], Sensor], Counter[int]]:
        """The sensors of the categories that give logs, and how many data blocks there are of the others."""
        sensors: dict[tuple[int, int], Sensor] = {}
        others: Counter[int] = Counter()
        known = {report.category for report in REPORTS}
        for frame in self.frames(notes):
            category = frame[1][0]
            if category not in known:
                others[category] += 1
                continue
            sensor = sensors.setdefault((category, sensor_of(frame[1])), Sensor())
            sensor.count += 1
            if len(sensor.sample) < _SAMPLE and sensor.size < _SAMPLE_BYTES:
                sensor.sample.append(frame)
                sensor.size += len(frame[1])
                if len(sensors) > _MAX_SENSORS:
                    raise InputError(f"{self.file.name}: names more than {_MAX_SENSORS} sensors; is it ASTERIX?")
        return sensors, others

    def _logs(self, sources: Sequence[Source], start: float | None) -> list[Log]:
        kinds = Counter(source.report.kind for source in sources)
        height = self.file.settings.height_m if self.file.settings else None
        logs = []
        for source in sources:
            where = self.file.name if len(sources) == 1 else f"{self.file.name}:{source.name}"
            layout = lay_out(source.columns, where, source.report.kind, self.file.columns)
            assert layout is not None
            reader = Reader(source, self.frames, self.file.name, where, start, kinds[source.report.kind] > 1, height)
            written = Written(where, source.columns, reader.blocks, reader.place)
            logs.append(log_from(written, layout, self.file))
        return logs


def _start(finder: Finder, sources: Sequence[Source]) -> float | None:
    """The time of day at which the recording begins: all its logs count from the midnight before."""
    times = [found for source in sources for found in source.first_time(finder.sample(source))]
    return min(times)[1] if times else None


def _other_messages(where: str, others: Counter[int]) -> Iterator[Problem]:
    if others:
        named = ", ".join(f"{n:,} of CAT{c:03d} ({framing.CATEGORIES[c]})" for c, n in sorted(others.items()))
        yield Problem(where, f"data blocks that give no log: {named}")
