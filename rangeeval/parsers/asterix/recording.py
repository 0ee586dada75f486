"""Which logs a recording holds: its sensors, the edition each of them speaks, and what is no log."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import IO

from rangeeval.errors import InputError, SettingsError, did_you_mean, one_line
from rangeeval.model import Log, Problem
from rangeeval.model.settings import LogSettings
from rangeeval.model.table import MAX_SHOWN
from rangeeval.parsers.asterix import framing
from rangeeval.parsers.asterix.captures import OTHER_LINK, payloads
from rangeeval.parsers.asterix.framing import Frame, Note
from rangeeval.parsers.asterix.reading import Reader, Source, sensor_of, shown
from rangeeval.parsers.asterix.reports import REPORTS, Report
from rangeeval.parsers.asterix.tables import Edition, Malformed, editions, library
from rangeeval.parsers.blocks import Contents, SourceFile, Written, log_from
from rangeeval.parsers.columns import lay_out
from rangeeval.parsers.streams import damage, opened

_SAMPLE = 100  # data blocks of a sensor by which its edition is chosen
_MAX_SENSORS = 256
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


@dataclass
class _Sensor:
    """The data blocks of one category from one sensor: how many, and the first of them."""

    count: int = 0
    sample: list[Frame] = field(default_factory=list)


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
        for at, data in payloads(stream, self.file.name, note):
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
        finder = _Finder(self.file, sensors)
        sources = finder.sources()
        logs = self._logs(sources, _start(sources, sensors))
        problems = [*notes.problems(), *finder.problems, *_other_messages(self.file.name, others)]
        if logs:
            return Contents(tuple(logs), tuple(problems))
        held = ", ".join(f"CAT{c:03d}" for c in sorted({c for c, _ in sensors} | set(others)))
        kind = f" of kind '{self.file.kind}'" if self.file.kind else ""
        why = "".join(f"; {p.reason}" for p in finder.problems[:3])
        return Contents(unrecognised=f"its ASTERIX messages ({held}) give no log{kind}{why}")

    def _survey(self, notes: _Notes) -> tuple[dict[tuple[int, int], _Sensor], Counter[int]]:
        """The sensors of the categories that give logs, and how many data blocks there are of the others."""
        sensors: dict[tuple[int, int], _Sensor] = {}
        others: Counter[int] = Counter()
        known = {report.category for report in REPORTS}
        for frame in self.frames(notes):
            category = frame[1][0]
            if category not in known:
                others[category] += 1
                continue
            sensor = sensors.setdefault((category, sensor_of(frame[1])), _Sensor())
            sensor.count += 1
            if len(sensor.sample) < _SAMPLE:
                sensor.sample.append(frame)
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


def _start(sources: Sequence[Source], sensors: Mapping[tuple[int, int], _Sensor]) -> float | None:
    """The time of day at which the recording begins: all its logs count from the midnight before."""
    times = []
    for source in sources:
        times += source.first_time(sensors[source.report.category, source.sensor].sample)
    return min(times)[1] if times else None


def _other_messages(where: str, others: Counter[int]) -> Iterator[Problem]:
    if others:
        named = ", ".join(f"{n:,} of CAT{c:03d} ({framing.CATEGORIES[c]})" for c, n in sorted(others.items()))
        yield Problem(where, f"data blocks that give no log: {named}")


class _Finder:
    """Finds the source of each log: the sensors of a recording with the report and the edition each of them speaks."""

    def __init__(self, file: SourceFile, sensors: dict[tuple[int, int], _Sensor]) -> None:
        self.file = file
        self.settings = file.settings or LogSettings(file.name)
        self.sensors = sensors
        self.problems: list[Problem] = []
        self._compiled: dict[tuple[int, str, str], Edition] = {}
        self._check()

    def _check(self) -> None:
        """Raises SettingsError for an edition that is not known or a sensor that is not in the file."""
        held = sorted({shown(sensor) for _, sensor in self.sensors})
        wanted = self.settings.sensor
        if wanted is not None and self.sensors and wanted not in held:
            raise SettingsError(
                f"{self.file.name}: trial.toml asks for sensor '{one_line(wanted, 20)}'; "
                f"the file holds {', '.join(held)}"
            )
        categories = {f"CAT{report.category:03d}": report.category for report in REPORTS}
        for name, edition in self.settings.editions.items():
            if name not in categories:
                raise SettingsError(
                    f"{self.file.name}: editions in trial.toml names '{one_line(name, 20)}'; "
                    f"{did_you_mean(name, categories)}"
                )
            known = editions(categories[name])
            if edition not in known:
                raise SettingsError(
                    f"{self.file.name}: edition '{one_line(edition, 20)}' of {name} is not known; "
                    f"known: {', '.join(known)}"
                )

    def sources(self) -> list[Source]:
        """One source a log, in order of category and sensor."""
        found = []
        told: dict[tuple[int, tuple[str, ...]], list[str]] = {}
        for (category, sensor), held in sorted(self.sensors.items()):
            if self.settings.sensor not in (None, shown(sensor)):
                continue
            fitting = self._fitting(category, sensor, held)
            source = self._source(category, sensor, held, fitting[0]) if fitting else None
            if source is not None:
                told.setdefault((category, fitting), []).append(shown(sensor))
                found.append(source)
        for (category, fitting), names in told.items():
            if f"CAT{category:03d}" not in self.settings.editions and len(editions(category)) > 1:
                more = f" (so do {', '.join(fitting[1:])})" if fitting[1:] else ""
                text = f"CAT{category:03d} of {', '.join(names)} is read by edition {fitting[0]}, the newest that fits"
                self.problems.append(Problem(self.file.name, text + more))
        return found

    def _edition(self, report: Report, name: str) -> Edition:
        key = (report.category, report.kind, name)
        if key not in self._compiled:
            self._compiled[key] = Edition(name, editions(report.category)[name], report.fields)
        return self._compiled[key]

    def _fitting(self, category: int, sensor: int, held: _Sensor) -> tuple[str, ...]:
        """The edition that `trial.toml` gives, else those that fit the most of the sensor's blocks, newest first."""
        given = self.settings.editions.get(f"CAT{category:03d}")
        if given is not None:
            return (given,)
        report = next(r for r in REPORTS if r.category == category)
        fits = {name: _fits(self._edition(report, name), held.sample) for name in editions(category)}
        best = max(fits.values())
        if best:
            return tuple(name for name, count in fits.items() if count == best)
        reason = (
            f"no edition of CAT{category:03d} that is known ({', '.join(fits)}) fits the data blocks of {shown(sensor)}"
        )
        self.problems.append(Problem(self.file.name, reason, held.count, rejected=True))
        return ()

    def _source(self, category: int, sensor: int, held: _Sensor, name: str) -> Source | None:
        """The source by the first report whose numbers the sensor's records have."""
        for report in REPORTS:
            if report.category == category and self.file.kind in (None, report.kind):
                source = Source(report, self._edition(report, name), sensor)
                if source.has_rows(held.sample):
                    return replace(source, shared=source.is_shared(held.sample))
        return None


def _fits(edition: Edition, sample: Sequence[Frame]) -> int:
    """How many data blocks are what the edition's tables say."""
    count = 0
    for _, block in sample:
        with contextlib.suppress(Malformed):
            edition.records(block)
            count += 1
    return count
