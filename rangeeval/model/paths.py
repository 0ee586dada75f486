"""Where targets truly were: the truth logs of a trial as one path a target, north, up and east of the site in m."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import InputError
from rangeeval.model.settings import Site
from rangeeval.model.table import Log, Problem, Table, gather
from rangeeval.model.trial import Trial
from rangeeval.physics.geodesy import north_up_east
from rangeeval.physics.paths import clean, interpolate

Floats = NDArray[np.float64]

TYPICAL_GAP = 5.0  # points of a path farther apart than so many of its usual intervals (and a second) leave a gap
ONLY = ""  # the name of the target of a log that names none


@dataclass(frozen=True)
class TruePath:
    """The surveyed path of one target: times (n), positions (n, 3) north, up, east in m, in order of time."""

    target: str
    time_s: Floats
    position_m: Floats
    max_gap_s: float

    def at(self, time_s: Floats) -> tuple[Floats, Floats]:
        """Position and velocity (m, 3) at times (m); NaN in a gap and outside the path."""
        return interpolate(self.time_s, self.position_m, time_s, self.max_gap_s)


def positions(log: Log, table: Table, site: Site) -> Floats | None:
    """Positions (n, 3) north, up, east of the site in m of a truth log; None when the site's place is missing."""
    if "north_m" in log:
        return np.stack([table.floats(n) for n in ("north_m", "up_m", "east_m")], axis=-1)
    if site.latitude_deg is None or site.longitude_deg is None:
        return None
    lat, lon = np.radians(table.floats("latitude_deg")), np.radians(table.floats("longitude_deg"))
    here = (math.radians(site.latitude_deg), math.radians(site.longitude_deg), site.height_m)
    return north_up_east(lat, lon, table.floats("height_m"), here)


def true_paths(trial: Trial, max_gap_s: float | None = None) -> tuple[dict[str, TruePath], tuple[Problem, ...]]:
    """The path of every target of the trial's truth logs, and what was left out of them.

    `max_gap_s`: points farther apart leave a gap; by default five usual intervals of the path, a second at least.
    Raises InputError when the truth is geodetic and trial.toml does not say where the site is.
    """
    parts: dict[str, list[tuple[Floats, Floats, Floats]]] = {}
    problems: list[Problem] = []
    sources: dict[str, str] = {}
    for log in trial.of_kind("truth"):
        table = log.read()
        problems += table.problems
        position = positions(log, table, trial.settings.site)
        if position is None:
            raise InputError(
                f"{log.source}: its positions are latitude and longitude; say where the radar stood "
                f"([site] latitude_deg, longitude_deg, height_m in trial.toml)"
            )
        time, codes = table.floats("time_s"), table.codes("target_id")
        reported = position
        if "north_m" not in log:
            reported = np.stack([table.floats("latitude_deg"), table.floats("longitude_deg")], axis=-1)
        names = (*table.labels.get("target_id", ()), ONLY)
        for code in np.unique(codes).tolist():
            rows = codes == code
            name = names[code] if "target_id" in log else ONLY
            parts.setdefault(name, []).append((time[rows], position[rows], reported[rows]))
            sources[name] = log.source
    paths: dict[str, TruePath] = {}
    for name, pieces in parts.items():
        when, where, said = (np.concatenate(c) for c in zip(*pieces, strict=True))
        found = clean(when, where, trial.settings.truth.max_speed_m_s, reported=said)
        problems += _told(found, sources[name])
        if len(found.time_s) < 2:
            problems.append(Problem(sources[name], "a target with fewer than two usable positions has no path", 1))
            continue
        usual = float(np.median(np.diff(found.time_s)))
        gap = max(TYPICAL_GAP * usual, 1.0) if max_gap_s is None else max_gap_s
        paths[name] = TruePath(name, found.time_s, found.position_m, gap)
    return paths, gather(problems)


def _told(found: object, source: str) -> Iterable[Problem]:
    for name, reason in (
        ("missing", "a position or time is missing: the row is not used"),
        ("repeated", "the same time twice: the first position is used"),
        ("stale", "a position repeated to the last digit while the target moves: taken as stale, not used"),
        ("jumps", "a position that neither neighbour can be reached from: not used"),
    ):
        if number := getattr(found, name):
            yield Problem(source, reason, number, rejected=True)


def partner(name: str, paths: Mapping[str, TruePath]) -> str | None:
    """The path that belongs to a target's name: its own, or the only one there is when one of the two has no names."""
    if name in paths:
        return name
    if len(paths) == 1 and (name == ONLY or ONLY in paths):
        return next(iter(paths))
    return None
