"""The one pass over the log: every update into its cell, on each axis."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import InputError, SettingsError, did_you_mean
from rangeeval.model import Bins, Problem, Table, Trial, gather
from rangeeval.model.kinds import RESIDUALS, LogKind
from rangeeval.model.updates import updates
from rangeeval.stats.cells import DROP, RESTART, SKIP, AxisSums, Cell, CellNumbers, Follower
from rangeeval.units import Unit, spellings

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

_VARIABLE_COLUMN = {"range": "range_predicted_m", "snr": "snr_db", "time": "time_s"}
_LEGS = {-1: "inbound", 0: "leg unknown", 1: "outbound"}


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


@dataclass(frozen=True)
class _Limit:
    column: str
    unit: Unit
    low: float
    high: float


def limits_of(when: Mapping[str, float], kind: LogKind = RESIDUALS) -> list[_Limit]:
    """The columns that `when` limits, in stored units. Raises SettingsError for a column a log cannot have."""
    known = {
        spelling: (column.name, unit)
        for column in kind.columns
        if not column.text
        for spelling, unit in spellings(column.name, column.unit).items()
    }
    limits = []
    for key, value in when.items():
        stem, _, end = key.rpartition("_")
        if end not in {"min", "max"} or stem not in known:
            raise SettingsError(
                f"when: no column '{stem if end in {'min', 'max'} else key}'; {did_you_mean(stem, known)}"
            )
        column, unit = known[stem]
        stored = float(unit.to_si(np.array([float(value)]))[0])
        limits.append(_Limit(column, unit, stored, np.inf) if end == "min" else _Limit(column, unit, -np.inf, stored))
    return limits


@dataclass
class _Groups:
    """Numbers the groups: leg, waveform and attenuator state, and the track when rows per track are wanted."""

    per_track: bool
    grouped: bool
    labels: list[tuple[str, str, str, str]] = field(default_factory=list)
    _numbers: dict[tuple[int, ...], int] = field(default_factory=dict)

    def number(self, table: Table, track: NDArray[np.int32], leg: NDArray[np.int8]) -> NDArray[np.int32]:
        """The group of each row."""
        parts: list[NDArray[np.int64]] = []
        names: list[Callable[[int], str]] = []
        if self.per_track:
            tracks = table.labels.get("track_id", ("",))
            parts.append(track.astype(np.int64))
            names.append(lambda i: tracks[i] if i < len(tracks) else "")
        if self.grouped:
            parts.append(leg.astype(np.int64) + 1)
            names.append(lambda i: _LEGS[i - 1])
            if "waveform" in table:
                waveforms = table.labels["waveform"]
                parts.append(table.codes("waveform").astype(np.int64) + 1)
                names.append(lambda i: waveforms[i - 1] if i else "")
            if "attenuation_db" in table:
                values, codes = np.unique(table.floats("attenuation_db"), return_inverse=True)
                parts.append(codes.astype(np.int64))
                names.append(lambda i: f"{values[i]:g}" if np.isfinite(values[i]) else "")
        if not parts:
            if not self.labels:
                self.labels.append(("", "", "", ""))
            return np.zeros(len(track), np.int32)
        code = np.zeros(len(track), np.int64)
        for part in parts:
            code = code * (int(part.max(initial=0)) + 1) + part
        present = np.flatnonzero(np.bincount(code))
        lookup = np.zeros(int(present[-1]) + 1 if len(present) else 1, np.int32)
        for c in present:
            rest, key = int(c), []
            for part in reversed(parts):
                size = int(part.max(initial=0)) + 1
                key.append(rest % size)
                rest //= size
            shown = [name(i) for name, i in zip(names, reversed(key), strict=True)]
            lookup[c] = self._number(shown, table)
        return lookup[code]

    def _number(self, shown: list[str], table: Table) -> int:
        it = iter(shown)
        label = (
            next(it) if self.per_track else "",
            next(it) if self.grouped else "",
            next(it) if self.grouped and "waveform" in table else "",
            next(it) if self.grouped and "attenuation_db" in table else "",
        )
        if label not in self.labels:
            self.labels.append(label)
        return self.labels.index(label)


def _variable(table: Table, bins: Bins) -> Array:
    """The values that decide the bin, from the predictions."""
    if bins.variable in _VARIABLE_COLUMN:
        return table.floats(_VARIABLE_COLUMN[bins.variable])
    cross = "y_predicted_m" if bins.variable == "elevation" else "z_predicted_m"
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.arcsin(table.floats(cross) / table.floats("range_predicted_m")))


@dataclass(frozen=True)
class _Ordered:
    """A piece with its rows in order, and what had to be done for it."""

    table: Table
    disordered: int = 0
    runs: int = 0
    duplicates: int = 0


def _in_time_order(table: Table, usual: float) -> _Ordered:
    """The rows of a piece in time order within each track, without those logged twice.

    A large step back (more than 20 usual intervals and a second) is another run in one file, not disorder: it is left,
    and the track starts anew there.
    """
    track, time = np.maximum(table.codes("track_id"), 0), table.floats("time_s")
    order = np.argsort(track, kind="stable")
    same = np.diff(track[order]) == 0
    if not (same & (np.diff(time[order]) < 0)).any():
        return _Ordered(table)
    # Only where time steps back can a copy stand apart from its original: rows equal in all that identifies an update.
    keys = (table.floats(AXES[0].residual), table.floats("range_predicted_m"), time, track)
    by_key = np.lexsort(keys)
    copy = np.zeros(len(table), bool)
    copy[by_key[1:]] = np.all([k[by_key][1:] == k[by_key][:-1] for k in keys], axis=0)
    table, track, time = table.take(~copy), track[~copy], time[~copy]
    order = np.argsort(track, kind="stable")
    step, same = np.diff(time[order]), np.diff(track[order]) == 0
    forward = step[same & (step > 0)]
    back = same & (step < 0)
    large = back & (step < -max(20.0 * (float(np.median(forward)) if len(forward) else usual), 1.0))
    small = int(np.count_nonzero(back & ~large))
    if small:
        # Within a run by time; the runs of one track stay in the order they were logged.
        run = np.empty(len(time), np.int64)
        run[order] = np.concatenate([[0], np.cumsum(large | ~same)])
        table = table.take(np.lexsort((time, run)))
    return _Ordered(table, small, int(np.count_nonzero(large)), int(np.count_nonzero(copy)))


def threads() -> int:
    """How many threads add axes: `RANGEEVAL_THREADS`, else one an axis. The result does not depend on it."""
    asked = os.environ.get("RANGEEVAL_THREADS", "")
    return max(1, int(asked)) if asked.isdigit() else len(AXES)


_NEEDED = ("time_s", "track_id", "range_predicted_m", "snr_db", "waveform", "attenuation_db")


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
    follower = Follower(trial.settings.radar.update_interval_s)
    numbers = CellNumbers()
    grouping = _Groups(per_track, groups)
    sums = {a.name: AxisSums(angle=a.angle is not None, startup=STARTUP if startup else 0.0) for a in AXES}
    counts = dict.fromkeys(("updates", "duplicates", "restarts", "in_no_bin", "left_out_by_when"), 0)
    problems: list[Problem] = []
    present: set[str] = set()
    source = trial.log("residuals").source
    tracks = 0
    gains = (f"{gain}_{a.name}" for a in AXES for gain in ("alpha", "beta"))
    names = {
        *_NEEDED,
        *gains,
        *(a.residual for a in AXES),
        *(a.cross for a in AXES if a.cross),
        *(x.column for x in limits),
    }
    with ThreadPoolExecutor(threads()) as pool:
        running: list[Future[None]] = []
        for table in updates(trial, names):
            problems.extend(table.problems)
            present.update(table.columns)
            if bins.variable == "snr" and "snr_db" not in table:
                raise InputError(f"{source}: bins of snr need a column snr_db, and there is none")
            found = _in_time_order(table, trial.settings.radar.update_interval_s or 1.0)
            counts["updates"] += len(table)
            counts["duplicates"] += found.duplicates
            table = found.table
            track = np.maximum(table.codes("track_id"), 0)
            tracks = max(tracks, int(track.max(initial=-1)) + 1)
            if found.disordered:
                problems.append(Problem(source, "time steps back within a track: rows put in order", found.disordered))
            if found.runs:
                problems.append(Problem(source, "time jumps back within a track: taken as another run", found.runs))
            rng, time = table.floats("range_predicted_m"), table.floats("time_s")
            mark, leg, duplicates, _late = follower.follow(time, track, rng, table.floats(AXES[0].residual))
            index = bins.index(_variable(table, bins))
            counts["duplicates"] += duplicates
            counts["restarts"] += int(np.count_nonzero(mark == RESTART))
            counts["in_no_bin"] += int(np.count_nonzero(index < 0))
            if limits:
                inside = np.ones(len(table), bool)
                for limit in limits:
                    values = table.floats(limit.column)
                    inside &= (values >= limit.low) & (values <= limit.high)
                mark[~inside] |= SKIP
                counts["left_out_by_when"] += int(np.count_nonzero(~inside & (mark & DROP == 0)))
            cell = numbers.assign(grouping.number(table, track, leg), index)
            for future in running:
                future.result()
            running = [
                pool.submit(_add_axis, sums[a.name], a, table, rng, time, cell, track, mark, numbers.count)
                for a in AXES
            ]
            if progress is not None:
                progress(len(table))
        for future in running:
            future.result()
    if counts["duplicates"]:
        reason = "the same update twice (track, time, range residual, predicted range): counted once"
        problems.append(Problem(source, reason, counts["duplicates"], rejected=True))
    if counts["in_no_bin"]:
        problems.append(Problem(source, f"predicted {bins.variable} missing or below the first bin: in no bin",
                                counts["in_no_bin"], rejected=True))  # fmt: skip
    problems.extend(
        Problem(source, f"no column {axis.residual}: nothing can be said of the {axis.name} axis")
        for axis in AXES
        if axis.residual not in present
    )
    counts["tracks"] = tracks
    return _sorted_out(grouping, numbers, sums, counts, problems, source, present)


def _add_axis(
    sums: AxisSums,
    axis: Axis,
    table: Table,
    rng: Array,
    time: Array,
    cell: NDArray[np.int32],
    track: NDArray[np.int32],
    mark: NDArray[np.int8],
    cells: int,
) -> None:
    if axis.residual not in table:
        return
    sums.add(
        table.floats(axis.residual),
        table.floats(f"alpha_{axis.name}"),
        table.floats(f"beta_{axis.name}"),
        rng,
        table.floats(axis.cross) if axis.cross else rng,
        table.floats("snr_db") if "snr_db" in table else None,
        time,
        cell,
        track,
        mark,
        cells,
    )


_LEFT_OUT = {
    "startup": "start-up after a track begins, restarts or changes its gains (first 11/alpha) left out, by axis",
    "unusable": "residual, prediction or gains missing, or gains outside the stability triangle, by axis",
}


def _sorted_out(
    grouping: _Groups,
    numbers: CellNumbers,
    sums: Mapping[str, AxisSums],
    counts: dict[str, int],
    problems: list[Problem],
    source: str,
    present: set[str],
) -> Gathered:
    """The cells by place: those of all together, of every group (when there is more than one), of every track."""
    named = _group_names(grouping.labels)
    members: dict[Place, list[int]] = {}
    for group, bin_number, cell in numbers.places():
        track = grouping.labels[group][0]
        members.setdefault(Place(bin_number), []).append(cell)
        if named[group]:
            members.setdefault(Place(bin_number, group=named[group]), []).append(cell)
        if grouping.per_track and track:
            members.setdefault(Place(bin_number, track=track), []).append(cell)
    axes = tuple(a for a in AXES if a.residual in present)
    cells: dict[str, dict[Place, Cell]] = {}
    left_out: dict[str, dict[str, int]] = {"startup": {}, "unusable": {}}
    offered = counts["updates"] - counts["duplicates"] - counts["in_no_bin"] - counts["left_out_by_when"]
    for axis in axes:
        of_axis = sums[axis.name]
        cells[axis.name] = {
            place: Cell.merged([of_axis.cell(c) for c in cells_here]) for place, cells_here in sorted(members.items())
        }
        together = [c for p, c in cells[axis.name].items() if p == Place(p.bin)]
        used, in_startup = sum(c.n for c in together), sum(c.startup for c in together)
        counts[f"{axis.name}_used"], counts[f"{axis.name}_startup"] = used, in_startup
        left_out["startup"][axis.name] = in_startup
        left_out["unusable"][axis.name] = max(offered - used - in_startup, 0)
    for which, why in _LEFT_OUT.items():
        if any(left_out[which].values()):
            each = ", ".join(f"{name} {n}" for name, n in left_out[which].items())
            problems.append(Problem(source, f"{why}: {each}", max(left_out[which].values()), rejected=True))
    if not any(c.n for of_axis in cells.values() for c in of_axis.values()):
        found = "; ".join(f"{p.reason} ({p.count})" for p in gather(problems)[:3] if p.count)
        raise InputError(f"{source}: not one usable update in any bin" + (f": {found}" if found else ""))
    bins = tuple(sorted({p.bin for p in members}))
    return Gathered(cells, counts, gather(problems), axes, bins)


def _group_names(labels: list[tuple[str, str, str, str]]) -> list[str]:
    """A name for each group, made of the factors that vary in the trial."""
    varying = [len({label[i] for label in labels}) > 1 for i in range(4)]
    shown = ("", "", "waveform ", "attenuation ")
    units = ("", "", "", " dB")
    names = []
    for label in labels:
        parts = [
            f"{shown[i]}{label[i]}{units[i]}" if label[i] else f"{shown[i]}missing" for i in (1, 2, 3) if varying[i]
        ]
        names.append(", ".join(parts))
    return names
