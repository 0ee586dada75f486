"""The one pass over the log: every update into its cell, on each axis."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.accuracy.choosing import Groups, Limit, bin_variable, limits_of
from rangeeval.analyses.accuracy.ordering import in_time_order
from rangeeval.errors import InputError, SettingsError
from rangeeval.model import Bins, Problem, Table, Trial, gather
from rangeeval.model.updates import updates
from rangeeval.stats.cells import DROP, RESTART, SKIP, AxisSums, Cell, CellNumbers, Follower

Array = NDArray[np.float64]

STARTUP = 11.0  # updates times alpha until fixed gains are within 1-10 % of steady state after a two-point start


@dataclass(frozen=True)
class Axis:
    """One axis of the tracker's filter, and the array angle that its cross-range residuals give."""

    name: str
    residual: str
    cross: str | None = None
    angle: str | None = None


AXES = (
    Axis("range", "range_residual_m"),
    Axis("y", "y_residual_m", "y_predicted_m", "elevation"),
    Axis("z", "z_residual_m", "z_predicted_m", "azimuth"),
)


@dataclass(frozen=True, order=True)
class Place:
    """Where a set of samples stands: its bin, and its track or group (both empty: all together)."""

    bin: int
    track: str = ""
    group: str = ""


@dataclass(frozen=True)
class Gathered:
    """The cells of every axis, by place; counts of what was read, used and set aside; the axes the log holds."""

    cells: Mapping[str, Mapping[Place, Cell]]
    counts: Mapping[str, int]
    problems: tuple[Problem, ...]
    axes: tuple[Axis, ...] = AXES
    bins: tuple[int, ...] = ()


def threads() -> int:
    """How many threads add axes: `RANGEEVAL_THREADS`, else one an axis. The result does not depend on it."""
    asked = os.environ.get("RANGEEVAL_THREADS", "")
    return max(1, int(asked)) if asked.isdigit() else len(AXES)


def gather_cells(
    trial: Trial,
    bins: Bins,
    *,
    startup: bool,
    groups: bool,
    per_track: bool,
    when: Mapping[str, float],
    progress: Callable[[int], None] | None = None,
) -> Gathered:
    """Read the residual log piece by piece with its gains, and add every update to its cell on each axis.

    The axes are added by a thread each, in row order, while the next piece is read: the result has the same bits for
    any number of threads.
    """
    if bins.variable == "aspect":
        raise SettingsError("bins.variable 'aspect' needs a detections log; a residuals log has none")
    limits = limits_of(when)
    gathering = Gathering(trial, bins, limits, startup=startup, groups=Groups(groups, per_track))
    with ThreadPoolExecutor(threads()) as pool:
        running: list[Future[None]] = []
        for table in updates(trial, _columns(limits)):
            jobs = gathering.place(table)
            for future in running:
                future.result()
            running = [pool.submit(job) for job in jobs]
            if progress is not None:
                progress(len(table))
        for future in running:
            future.result()
    return gathering.finish()


def _columns(limits: Sequence[Limit]) -> set[str]:
    """The columns the analysis reads, where a log has them."""
    shared = ("time_s", "track_id", "range_predicted_m", "snr_db", "waveform", "attenuation_db")
    gains = (f"{gain}_{axis.name}" for axis in AXES for gain in ("alpha", "beta"))
    own = (column for axis in AXES for column in (axis.residual, axis.cross) if column)
    return {*shared, *gains, *own, *(limit.column for limit in limits)}


class Gathering:
    """The pass itself: pieces of the log in, the cells of every place out."""

    def __init__(self, trial: Trial, bins: Bins, limits: Sequence[Limit], *, startup: bool, groups: Groups) -> None:
        self._bins = bins
        self._limits = limits
        self._groups = groups
        self._interval = trial.settings.radar.update_interval_s
        self._follower = Follower(self._interval)
        self._numbers = CellNumbers()
        self._sums = {a.name: AxisSums(angle=a.angle is not None, startup=STARTUP if startup else 0.0) for a in AXES}
        names = ("updates", "tracks", "restarts", "duplicates", "in_no_bin", "left_out_by_when")
        self._counts = dict.fromkeys(names, 0)
        self._problems: list[Problem] = []
        self._present: set[str] = set()
        self._source = trial.log("residuals").source

    def place(self, table: Table) -> list[Callable[[], None]]:
        """Put a piece's rows in order and find the cell of each; what is left is a job for each axis."""
        if self._bins.variable == "snr" and "snr_db" not in table:
            raise InputError(f"{self._source}: bins of snr need a column snr_db, and there is none")
        self._counts["updates"] += len(table)
        self._present.update(table.columns)
        self._problems.extend(table.problems)
        table = self._ordered(table)
        rows = self._rows(table)
        return [partial(_add_axis, self._sums[a.name], a, table, rows) for a in AXES if a.residual in table]

    def _ordered(self, table: Table) -> Table:
        found = in_time_order(table, self._interval or 1.0)
        self._counts["duplicates"] += found.duplicates
        if found.disordered:
            self._say("time steps back within a track: rows put in order", found.disordered)
        if found.runs:
            self._say("time jumps back within a track: taken as another run", found.runs)
        return found.table

    def _rows(self, table: Table) -> _Rows:
        counts = self._counts
        time, rng = table.floats("time_s"), table.floats("range_predicted_m")
        track = table.codes("track_id") + np.int32(1)  # 0: the rows whose track is missing
        counts["tracks"] = max(counts["tracks"], int(track.max(initial=0)))
        mark, leg, duplicates = self._follower.follow(time, track, rng, table.floats(AXES[0].residual))
        counts["duplicates"] += duplicates
        counts["restarts"] += int(np.count_nonzero(mark == RESTART))
        index = self._bins.index(bin_variable(table, self._bins))
        counts["in_no_bin"] += int(np.count_nonzero(index < 0))
        for limit in self._limits:
            outside = ~limit.holds(table) & (mark & (DROP | SKIP) == 0)
            mark[outside] |= SKIP
            counts["left_out_by_when"] += int(np.count_nonzero(outside))
        cell = self._numbers.assign(self._groups.number(table, leg), index)
        return _Rows(time, rng, track, mark, cell, self._numbers.count)

    def _say(self, reason: str, count: int = 0, *, rejected: bool = False) -> None:
        self._problems.append(Problem(self._source, reason, count, rejected=rejected))

    def finish(self) -> Gathered:
        """The cells by place. Raises InputError when not one sample could be used."""
        counts = self._counts
        if counts["duplicates"]:
            reason = "the same update twice (track, time, range residual, predicted range): counted once"
            self._say(reason, counts["duplicates"], rejected=True)
        if counts["in_no_bin"]:
            reason = f"predicted {self._bins.variable} missing or below the first bin: in no bin"
            self._say(reason, counts["in_no_bin"], rejected=True)
        for axis in AXES:
            if axis.residual not in self._present:
                self._say(f"no column {axis.residual}: nothing can be said of the {axis.name} axis")
        axes = tuple(a for a in AXES if a.residual in self._present)
        members = self._members()
        cells = {
            axis.name: {
                place: Cell.merged([self._sums[axis.name].cell(number) for number in numbers])
                for place, numbers in members.items()
            }
            for axis in axes
        }
        self._count_left_out(cells)
        if not any(c.n for of_axis in cells.values() for c in of_axis.values()):
            found = "; ".join(f"{p.reason} ({p.count})" for p in gather(self._problems)[:3] if p.count)
            raise InputError(f"{self._source}: not one usable update in any bin" + (f": {found}" if found else ""))
        return Gathered(cells, counts, gather(self._problems), axes, tuple(sorted({p.bin for p in members})))

    def _members(self) -> dict[Place, list[int]]:
        """The numbers of the cells that make up each place: all together, every group, every track."""
        keys, names = self._groups.keys, self._groups.names()
        members: dict[Place, list[int]] = {}
        for group, bin_number, cell in self._numbers.places():
            places = [Place(bin_number)]
            places += [Place(bin_number, group=names[group])] if names[group] else []
            places += [Place(bin_number, track=keys[group].track)] if keys[group].track else []
            for place in places:
                members.setdefault(place, []).append(cell)
        return dict(sorted(members.items()))

    def _count_left_out(self, cells: Mapping[str, Mapping[Place, Cell]]) -> None:
        """Count, for each axis, what was used, what settled, and what could not be used; say the last two."""
        counts = self._counts
        offered = counts["updates"] - counts["duplicates"] - counts["in_no_bin"] - counts["left_out_by_when"]
        settling, unusable = {}, {}
        for axis, of_place in cells.items():
            together = [cell for place, cell in of_place.items() if place == Place(place.bin)]
            used, settling[axis] = sum(c.n for c in together), sum(c.startup for c in together)
            unusable[axis] = max(offered - used - settling[axis], 0)
            counts[f"{axis}_used"], counts[f"{axis}_startup"] = used, settling[axis]
        for reason, left_out in (
            ("start-up after a track begins, restarts or changes its gains (first 11/alpha) left out", settling),
            ("residual, prediction or gains missing, or gains outside the stability triangle", unusable),
        ):
            if any(left_out.values()):
                by_axis = ", ".join(f"{name} {n}" for name, n in left_out.items())
                self._say(f"{reason}, by axis: {by_axis}", max(left_out.values()), rejected=True)


@dataclass(frozen=True)
class _Rows:
    """What the axes share of a piece: a value a row, and how many cells there are by now."""

    time: Array
    rng: Array
    track: NDArray[np.int32]
    mark: NDArray[np.int8]
    cell: NDArray[np.int32]
    cells: int


def _add_axis(sums: AxisSums, axis: Axis, table: Table, rows: _Rows) -> None:
    sums.add(
        table.floats(axis.residual),
        table.floats(f"alpha_{axis.name}"),
        table.floats(f"beta_{axis.name}"),
        rows.rng,
        table.floats(axis.cross) if axis.cross else rows.rng,
        table.floats("snr_db") if "snr_db" in table else None,
        rows.time,
        rows.cell,
        rows.track,
        rows.mark,
        rows.cells,
    )
