"""Which sensors of a recording give logs, and by which edition of its category each of them is read."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field

from rangeeval.errors import SettingsError, did_you_mean, one_line
from rangeeval.model import Problem
from rangeeval.model.settings import LogSettings
from rangeeval.parsers.asterix.framing import Frame
from rangeeval.parsers.asterix.reading import Source, shown
from rangeeval.parsers.asterix.reports import REPORTS, Report
from rangeeval.parsers.asterix.tables import Edition, editions
from rangeeval.parsers.blocks import SourceFile

_STRAY = 500


@dataclass
class Sensor:
    """The data blocks of one category that one sensor begins: how many, and the first of them with their bytes."""

    count: int = 0
    size: int = 0
    sample: list[Frame] = field(default_factory=list)


class Finder:
    """Finds the source of each log among the sensors of a recording, by category and number.

    Raises SettingsError for an edition or a sensor of `trial.toml` that there is not.
    """

    def __init__(self, file: SourceFile, sensors: dict[tuple[int, int], Sensor]) -> None:
        self.file = file
        self.settings = file.settings or LogSettings(file.name)
        self.sensors = dict(sensors)
        self.origin = self._origin()
        self.problems: list[Problem] = []
        self._compiled: dict[tuple[int, str, str], Edition] = {}
        self._check_editions()
        self._leave_out_strays()

    def _check_editions(self) -> None:
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

    def _origin(self) -> tuple[float, float] | None:
        """The point (rad) that x and y count from, where `trial.toml` gives it."""
        latitude, longitude = self.settings.latitude_deg, self.settings.longitude_deg
        if latitude is None and longitude is None:
            return None
        if latitude is None or longitude is None or abs(latitude) > 90 or abs(longitude) > 180:
            raise SettingsError(
                f"{self.file.name}: [[logs]] in trial.toml has latitude_deg {latitude} and longitude_deg {longitude}; "
                f"expected both, at most 90 and 180"
            )
        return math.radians(latitude), math.radians(longitude)

    def _leave_out_strays(self) -> None:
        """A sensor that hardly ever begins a data block is a damaged name of another: it makes no log of its own."""
        blocks = Counter[int]()
        for (category, _), held in self.sensors.items():
            blocks[category] += held.count
        for key, held in list(self.sensors.items()):
            if _STRAY * held.count < blocks[key[0]] and self.settings.sensor != shown(key[1]):
                reason = (
                    f"data blocks of CAT{key[0]:03d} {shown(key[1])}, a sensor that is named less than once in {_STRAY}"
                )
                self.problems.append(Problem(self.file.name, reason, held.count, rejected=True))
                del self.sensors[key]

    def sources(self) -> list[Source]:
        """One source a log, in order of category and sensor."""
        fitting = {key: names for key, held in self.sensors.items() if (names := self._fitting(*key, held))}
        shared = self._look_inside(fitting)
        self._check_sensor()
        found = []
        told: dict[tuple[int, tuple[str, ...]], list[str]] = {}
        for key in sorted(fitting):
            category, sensor = key
            if self.settings.sensor not in (None, shown(sensor)):
                continue
            source = self._source(category, sensor, fitting[key][0], category in shared)
            if source is not None:
                told.setdefault((category, fitting[key]), []).append(shown(sensor))
                found.append(source)
        for (category, names), sensors in told.items():
            if f"CAT{category:03d}" not in self.settings.editions and len(editions(category)) > 1:
                more = f" (so do {', '.join(names[1:])})" if names[1:] else ""
                text = f"CAT{category:03d} of {', '.join(sensors)} is read by edition {names[0]}, the newest that fits"
                self.problems.append(Problem(self.file.name, text + more))
        return found

    def sample(self, source: Source) -> list[Frame]:
        """The first data blocks of a source."""
        return self.sensors[source.report.category, source.sensor].sample

    def _fitting(self, category: int, sensor: int, held: Sensor) -> tuple[str, ...]:
        """The edition that `trial.toml` gives, else those that fit best, newest first.

        An edition fits best when the most data blocks are what its tables say; among such, when the most records give
        rows: tables of another edition may fit by chance and give no position.
        """
        given = self.settings.editions.get(f"CAT{category:03d}")
        if given is not None:
            return (given,)
        fits = {
            name: max(
                Source(report, self._edition(report, name), sensor).fit(held.sample)
                for report in REPORTS
                if report.category == category
            )
            for name in editions(category)
        }
        best = max(fits.values())
        if best[0]:
            return tuple(name for name, fit in fits.items() if fit == best)
        which = f"CAT{category:03d} of {shown(sensor)}"
        reason = f"data blocks of {which} that no known edition fits ({', '.join(fits)})"
        self.problems.append(Problem(self.file.name, reason, held.count, rejected=True))
        return ()

    def _look_inside(self, fitting: dict[tuple[int, int], tuple[str, ...]]) -> set[int]:
        """The categories whose sensors share data blocks; those that never begin one join the others."""
        shared = set()
        for (category, sensor), names in list(fitting.items()):
            report = next(r for r in REPORTS if r.category == category)
            sample = self.sensors[category, sensor].sample
            for other in Source(report, self._edition(report, names[0]), sensor).sensors_in(sample) - {sensor}:
                shared.add(category)
                self.sensors.setdefault((category, other), Sensor(sample=sample))
                fitting.setdefault((category, other), names)
        return shared

    def _check_sensor(self) -> None:
        held = sorted({shown(sensor) for _, sensor in self.sensors})
        wanted = self.settings.sensor
        if wanted is not None and wanted not in held:
            raise SettingsError(
                f"{self.file.name}: trial.toml asks for sensor '{one_line(wanted, 20)}'; "
                f"the file holds {', '.join(held) or 'none'}"
            )

    def _source(self, category: int, sensor: int, name: str, shared: bool) -> Source | None:
        """The source by the first report whose numbers the sensor's records have."""
        reports = [r for r in REPORTS if r.category == category and self.file.kind in (None, r.kind)]
        if self.origin is not None:
            reports.sort(key=lambda r: r.kind != "truth")
        for report in reports:
            source = Source(report, self._edition(report, name), sensor, shared, self.origin)
            if source.has_rows(self.sample(source)):
                return source
        return None

    def _edition(self, report: Report, name: str) -> Edition:
        key = (report.category, report.kind, name)
        if key not in self._compiled:
            self._compiled[key] = Edition(name, editions(report.category)[name], report.fields)
        return self._compiled[key]
