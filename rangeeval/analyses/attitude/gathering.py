"""The one pass over the tilt logs: block means, spectra, readings at the times of detections, and what is wrong."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.attitude.setup import AXES, Setup
from rangeeval.errors import InputError
from rangeeval.model import Log, Problem, Table, gather
from rangeeval.physics.attitude import height_weights
from rangeeval.stats.channels import Blocks, ChannelWatch
from rangeeval.stats.spectrum import CrossSpectra, segment_size

Array = NDArray[np.float64]

GAP = 2.5  # intervals; a longer step is a gap
DISORDER = 20.0  # intervals; a smaller step back is rows out of order, a larger one a clock that was set
UNIT_LOW, UNIT_HIGH = 0.8, 1.25  # mean magnitude over g between which the vertical reading is believed


@dataclass(frozen=True)
class Gathered:
    """What the pass found. `time_s`, `forces` (channels x blocks), `stretch`: block means of `block` samples each.

    `at_times` (channels x detections): readings interpolated to the detections, NaN in gaps.
    """

    time_s: Array
    forces: Array
    stretch: NDArray[np.int64]
    block: int
    interval_s: float
    samples: int
    spectra: Mapping[str, CrossSpectra]
    at_times: Array
    noise_left: Array
    beyond: Mapping[str, int]
    beyond_channel: tuple[int, ...]
    usable: tuple[int, ...]
    saturated: tuple[int, ...]
    stuck: tuple[int, ...]
    span_s: tuple[float, float]
    counts: Mapping[str, int]
    problems: tuple[Problem, ...]


@dataclass
class _Follower:
    """A tilt log beside the first one: gives its readings at the first one's times, in step with it."""

    log: Log
    names: list[str]
    problems: list[Problem]
    tables: Iterator[Table] = field(init=False)
    time: Array = field(default_factory=lambda: np.empty(0))
    values: Array = field(init=False)
    interval: float = 0.0
    first: float = np.nan
    last: float = np.nan

    def __post_init__(self) -> None:
        self.tables = self.log.pieces(["time_s", *self.names])
        self.values = np.empty((len(self.names), 0))

    def at(self, time: Array) -> Array:
        """Readings at these times (ascending on the whole), linearly between its samples, NaN in its gaps."""
        end = time.max() if time.size else -np.inf
        while not self.time.size or self.time[-1] < end:
            table = next(self.tables, None)
            if table is None:
                break
            self.problems += table.problems
            t = table.floats("time_s")
            order = np.argsort(t, kind="stable")
            t = t[order]
            use = np.isfinite(t)
            if not self.interval and use.sum() > 2:
                self.interval = float(np.median(np.diff(t[use])))
                self.first = float(t[use][0])
            self.time = np.concatenate([self.time, t[use]])
            self.values = np.concatenate([self.values, [table.floats(n)[order][use] for n in self.names]], axis=1)
            self.last = float(self.time[-1]) if self.time.size else self.last
        found = interpolated(time, self.time, self.values, GAP * self.interval)
        keep = max(int(np.searchsorted(self.time, time.min() if time.size else -np.inf)) - 2, 0)
        self.time, self.values = self.time[keep:], self.values[:, keep:]
        return found

    def to_end(self) -> float:
        """The last time of the log."""
        for table in self.tables:
            t = table.floats("time_s")
            if t.size:
                self.last = float(np.nanmax([self.last, np.nanmax(t)]))
        return self.last


def interpolated(at: Array, time: Array, values: Array, gap: float) -> Array:
    """Values (channels x n) at other times, linear between samples no further apart than `gap`, else NaN."""
    return shares(at, time, values, gap)[0]


def shares(at: Array, time: Array, values: Array, gap: float) -> tuple[Array, Array]:
    """As `interpolated`, and what is left of white noise: the variance of the interpolated over that of a sample."""
    if time.size < 2:
        return np.full((values.shape[0], at.size), np.nan), np.ones(at.size)
    right = np.clip(np.searchsorted(time, at), 1, time.size - 1)
    left = right - 1
    step = time[right] - time[left]
    on_right, on_left = at == time[right], at == time[left]  # a sample is itself, even at the edge of a gap
    inside = (at >= time[0]) & (at <= time[-1]) & (step <= gap) & (step > 0)
    share = np.where(on_right, 1.0, np.where(inside & ~on_left, (at - time[left]) / np.where(step > 0, step, 1.0), 0.0))
    found = values[:, left] * (1 - share) + values[:, right] * share
    found = np.where(on_right, values[:, right], np.where(on_left, values[:, left], found))
    inside |= on_right | on_left
    return np.where(inside, found, np.nan), share**2 + (1 - share) ** 2


def gather_tilt(setup: Setup, times: Array, progress: Callable[[int], None] | None = None) -> Gathered:
    """Read the tilt logs once, piece by piece, in bounded memory.

    `times`: those of the detections, at which readings are wanted.

    Raises
    ------
    InputError : not one usable sample, logs that share no time, readings in another unit than their names say.
    """
    return _Pass(setup, np.sort(times)).run(progress).reordered(np.argsort(times, kind="stable"))


class _Pass:
    """The state of the pass."""

    def __init__(self, setup: Setup, times: Array) -> None:
        self.setup, self.times = setup, times
        self.problems: list[Problem] = list(setup.problems)
        self.columns = [[c.column for c in setup.channels if c.log == i] for i in range(len(setup.logs))]
        self.rows = [[k for k, c in enumerate(setup.channels) if c.log == i] for i in range(len(setup.logs))]
        self.others = [_Follower(log, self.columns[i], self.problems) for i, log in enumerate(setup.logs) if i]
        self.watches = [ChannelWatch() for _ in setup.channels]
        self.blocks = Blocks(len(setup.channels) + 1)
        self.spectra: dict[str, CrossSpectra] = {}
        self.at_times = np.full((len(setup.channels), times.size), np.nan)
        self.noise_left = np.ones(times.size)
        self.centre = {a: height_weights(r).centre for a in AXES if (r := setup.radii_of(a)) and len(r) > 1}
        self.beyond = dict.fromkeys(AXES, 0)
        self.beyond_channel = [0] * len(setup.channels)
        self.usable = [0] * len(setup.channels)
        self.interval, self.previous, self.samples, self.rows_read = 0.0, np.nan, 0, 0
        self.tail: tuple[Array, Array] | None = None
        self.span = [np.inf, -np.inf]
        self.gaps: list[tuple[float, float]] = []
        self.back: list[tuple[float, float]] = []
        self.duplicates = self.disordered = self.untimed = 0

    def run(self, progress: Callable[[int], None] | None) -> _Pass:
        log = self.setup.logs[0]
        vertical = [f"{c}_y_accel_m_s2" for c in dict.fromkeys(c.sensor for c in self.setup.channels)]
        names = ["time_s", *self.columns[0], *(v for v in vertical if v in log)]
        for table in log.pieces(names):
            self.problems += table.problems
            if not len(table):
                continue
            first = self.rows_read == 0
            self.rows_read += len(table)
            time, values = self._piece(table)
            if first:
                self._check_unit(table, values)
            if time.size:
                self._add(time, values)
            if progress is not None:
                progress(len(table))
        if not self.samples or not any(self.usable):
            self._nothing()
        return self

    def _piece(self, table: Table) -> tuple[Array, Array]:
        """Times and readings (channels x n) of one piece, in order, each time once."""
        time = table.floats("time_s")
        keep = np.isfinite(time)
        self.untimed += int(np.count_nonzero(~keep))
        own = np.array([table.floats(n) for n in self.columns[0]]).reshape(len(self.columns[0]), -1)
        if not keep.all():
            time, own = time[keep], own[:, keep]
        if not self.interval and time.size > 2:
            steps = np.diff(time)
            self.interval = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
        time, own = self._in_order(time, own)
        values = np.full((len(self.setup.channels), time.size), np.nan)
        values[self.rows[0]] = own
        for other, rows in zip(self.others, self.rows[1:], strict=True):
            values[rows] = other.at(time)
        return time, values

    def _in_order(self, time: Array, values: Array) -> tuple[Array, Array]:
        step = np.diff(time, prepend=self.previous)
        if time.size and not (step[1:] <= 0).any() and not step[0] <= 0:
            self.previous = float(time[-1])
            return time, values
        large = step < -max(DISORDER * self.interval, 1.0)
        run = np.cumsum(large)
        small = int(np.count_nonzero((step < 0) & ~large))
        if small:
            order = np.lexsort((time, run))
            time, values, run = time[order], values[:, order], run[order]
            self.disordered += small
        again = np.zeros(time.size, bool)
        again[1:] = (np.diff(time) == 0) & (np.diff(run) == 0)
        if again.any():
            self.duplicates += int(again.sum())
            time, values = time[~again], values[:, ~again]
        self.previous = float(time[-1]) if time.size else self.previous
        return time, values

    def _check_unit(self, table: Table, values: Array) -> None:
        """Judge the unit by the mean magnitude: of the vector where the vertical is logged, else of the readings."""
        g, log = self.setup.gravity, self.setup.logs[0]
        with np.errstate(invalid="ignore"):
            for sensor in dict.fromkeys(c.sensor for c in self.setup.channels if c.log == 0):
                if f"{sensor}_y_accel_m_s2" not in table:
                    continue
                parts = [
                    table.floats(f"{sensor}_{a}_accel_m_s2")
                    for a in ("x", "y", "z")
                    if f"{sensor}_{a}_accel_m_s2" in table
                ]
                finite = np.all(np.isfinite(parts), axis=0)
                mean = float(np.mean(np.linalg.norm(np.array(parts)[:, finite], axis=0))) if finite.any() else np.nan
                if not np.isfinite(mean) or UNIT_LOW * g < mean < UNIT_HIGH * g:
                    continue
                hint = ""
                if UNIT_LOW < mean < UNIT_HIGH:
                    hint = (
                        f": that is 1 g, so the readings are in g; end the column names in _g, not {_unit(log, sensor)}"
                    )
                elif UNIT_LOW * g < mean / g < UNIT_HIGH * g:
                    hint = ": that is g squared, so the readings are in m/s^2; end the column names in _m_s2, not _g"
                raise InputError(
                    f"{log.source}: the mean magnitude of the {sensor} accelerometer is {mean:.3g} m/s^2, "
                    "expected about "
                    f"{g:.3g}{hint or '; check its unit'}"
                )
            finite = values[:, np.isfinite(values).any(axis=0)]
            level = float(np.nanmean(np.abs(finite))) if np.isfinite(finite).any() else np.nan
        if level > g:
            raise InputError(
                f"{log.source}: the mean magnitude of the readings is {level:.3g} m/s^2, more than g; no tilt "
                "reads that. "
                f"Are they in m/s^2 under a name that ends in _g, or in mg?"
            )
        written = [log.written.get(n, n) for n in self.columns[0]]
        if level < 0.12 and all(n.endswith("_m_s2") for n in written):
            tilt, in_g = np.rad2deg(level / g), np.rad2deg(np.arcsin(min(level, 1.0)))
            self.problems.append(Problem(
                log.source,
                f"the mean magnitude of the readings is {level:.2g} m/s^2, a tilt of {tilt:.2g} degrees; if "
                "they are in g, "
                f"end the column names in _g, and it is {in_g:.2g} degrees (readings of the horizontal alone "
                "cannot tell)",
            ))  # fmt: skip

    def _add(self, time: Array, values: Array) -> None:
        limit = GAP * self.interval
        if not self.spectra:
            for axis in AXES:
                if rows := self.setup.of_axis(axis):
                    self.spectra[axis] = CrossSpectra(len(rows), segment_size(time.size), self.interval)
        self._watch(values)
        starts = np.flatnonzero(np.diff(time) > limit) + 1
        backs = np.flatnonzero(np.diff(time) < 0) + 1
        edges = np.union1d(starts, backs)
        if self.tail is not None:
            step = time[0] - self.tail[0][-1]
            if step > limit or step <= 0:
                self._note(float(self.tail[0][-1]), float(time[0]))
                self._end()
                self.tail = None
        for edge in edges.tolist():
            self._note(float(time[edge - 1]), float(time[edge]))
        for i, part in enumerate(np.split(np.arange(time.size), edges)):
            if i:
                self._end()
                self.tail = None
            self._stretch(time[part[0] : part[-1] + 1], values[:, part[0] : part[-1] + 1])
        self.samples += time.size
        self.span = [min(self.span[0], float(time.min())), max(self.span[1], float(time.max()))]

    def _note(self, before: float, after: float) -> None:
        (self.gaps if after > before else self.back).append((before, after))

    def _end(self) -> None:
        self.blocks.end()
        for spectra in self.spectra.values():
            spectra.end()

    def _watch(self, values: Array) -> None:
        g = self.setup.gravity
        for k, watch in enumerate(self.watches):
            stuck = watch.look(values[k])
            if stuck.any():
                values[k, stuck] = np.nan
            if watch.highest > g or watch.lowest < -g:
                with np.errstate(invalid="ignore"):
                    self.beyond_channel[k] += int(np.count_nonzero(np.abs(values[k]) > g))
            self.usable[k] = watch.seen - watch.stuck
        for axis, weights in self.centre.items():
            rows = self.setup.of_axis(axis)
            centre = weights @ values[rows[0] : rows[-1] + 1]
            if centre.size and (np.fmax.reduce(centre) > g or np.fmin.reduce(centre) < -g):
                with np.errstate(invalid="ignore"):
                    self.beyond[axis] += int(np.count_nonzero(np.abs(centre) > g))

    def _stretch(self, time: Array, values: Array) -> None:
        self.blocks.add(np.concatenate([time[None], values]))
        for axis, spectra in self.spectra.items():
            spectra.add(values[self.setup.of_axis(axis)])
        if self.times.size:
            with_tail = time if self.tail is None else np.concatenate([self.tail[0], time])
            both = values if self.tail is None else np.concatenate([self.tail[1], values], axis=1)
            a, b = np.searchsorted(self.times, [with_tail[0], with_tail[-1]], "left")
            b = int(np.searchsorted(self.times, with_tail[-1], "right"))
            if b > a:
                found, self.noise_left[a:b] = shares(self.times[a:b], with_tail, both, GAP * self.interval)
                taken = np.isfinite(self.at_times[:, a:b])
                # A time the clock showed twice has two attitudes: none is believed.
                self.at_times[:, a:b] = np.where(
                    taken, np.where(np.isclose(found, self.at_times[:, a:b]), found, np.nan), found
                )
        self.tail = (time[-1:], values[:, -1:])

    def _nothing(self) -> None:
        problems = gather(self.problems)
        if self.others and self.rows_read:
            for i, other in enumerate(self.others, start=1):
                first, last = other.first, other.to_end()
                if first > self.span[1] or last < self.span[0]:
                    self._no_common_time(i, first, last)
        found = "; ".join(f"{p.reason} ({p.count})" for p in problems[:3] if p.count)
        raise InputError(f"{self.setup.source}: not one usable sample" + (f": {found}" if found else ""))

    def _no_common_time(self, i: int, first: float, last: float) -> None:
        a, b = self.setup.logs[0].source, self.setup.logs[i].source
        raise InputError(
            f"{a} runs from {self.span[0]:.6g} to {self.span[1]:.6g} s and {b} from {first:.6g} to {last:.6g} s: they "
            f"share no time, so their clocks differ; bring both to one clock"
        )

    def reordered(self, order: NDArray[np.intp]) -> Gathered:
        for i, other in enumerate(self.others, start=1):
            first, last = other.first, other.to_end()
            if first > self.span[1] or last < self.span[0]:
                self._no_common_time(i, first, last)
        block_values, stretch = self.blocks.finish()
        at_times = np.empty_like(self.at_times)
        at_times[:, order] = self.at_times
        noise_left = np.empty_like(self.noise_left)
        noise_left[order] = self.noise_left
        source = self.setup.source
        self._say(source)
        counts = {
            "samples": self.rows_read,
            "used": self.samples,
            "repeated_times": self.duplicates,
            "gaps": len(self.gaps),
            "clock_steps": len(self.back),
            "stuck": sum(w.stuck for w in self.watches),
            "saturated": sum(w.saturated for w in self.watches),
            "beyond_g": sum(self.beyond_channel),
        }
        return Gathered(
            block_values[0], block_values[1:], stretch, self.blocks.size, self.interval, self.samples, self.spectra,
            at_times, noise_left, self.beyond, tuple(self.beyond_channel), tuple(self.usable),
            tuple(w.saturated for w in self.watches), tuple(w.stuck for w in self.watches),
            (self.span[0], self.span[1]), counts, gather(self.problems),
        )  # fmt: skip

    def _say(self, source: str) -> None:
        say = self.problems.append
        if self.untimed:
            say(Problem(source, "no time: the sample is not used", self.untimed, rejected=True))
        if self.duplicates:
            say(Problem(source, "the same time twice: the first sample is used", self.duplicates, rejected=True))
        if self.disordered:
            say(Problem(source, "time steps back a little: samples put in order", self.disordered))
        if self.gaps:
            total = sum(b - a for a, b in self.gaps)
            shown = tuple(f"{a:.6g} to {b:.6g} s" for a, b in self.gaps[:5])
            say(
                Problem(
                    source,
                    f"{_count(len(self.gaps), 'gap')}, {total:.4g} s together: no attitude is had there",
                    0,
                    shown,
                )
            )
        if self.back:
            shown = tuple(f"from {a:.6g} back to {b:.6g} s" for a, b in self.back[:5])
            text = (
                f"the clock steps back {_count(len(self.back), 'time')}: no attitude is given to the times shown twice"
            )
            say(Problem(source, text, 0, shown))
        for k, (c, watch) in enumerate(zip(self.setup.channels, self.watches, strict=True)):
            if watch.constant and watch.seen > 20:
                raise InputError(f"{source}: {c.column} never changes over {watch.seen} samples: the sensor is stuck")
            if watch.stuck:
                text = f"{c.column} stands still for over {watch.longest} samples: stuck, taken as missing"
                say(Problem(source, text, watch.stuck, rejected=True))
            if watch.saturated:
                text = f"{c.column} stands at its highest or lowest value in runs: saturated, peaks are cut"
                say(Problem(source, text, watch.saturated))
            if self.beyond_channel[k]:
                say(Problem(source, f"{c.column} is beyond g: no tilt reads that (single-sensor tilt missing there)",
                            self.beyond_channel[k]))  # fmt: skip
        for axis, count in self.beyond.items():
            if count:
                text = f"the {axis} reading taken to the rotation centre is beyond g: no tilt there"
                say(Problem(source, text, count, rejected=True))


def _unit(log: Log, sensor: str) -> str:
    written = log.written.get(f"{sensor}_y_accel_m_s2", "_m_s2")
    return "_m_s2" if written.endswith("_m_s2") else written


def _count(n: int, noun: str) -> str:
    return f"{n} {noun}{'' if n == 1 else 's'}"
