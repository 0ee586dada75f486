"""What is gathered of sensor channels while a long log streams by: block means, and the marks of a faulty sensor."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rangeeval.compiled import compiled

FloatArray = NDArray[np.float64]

STUCK_RUNS = 12  # a run this many times as long as nine in ten runs of equal neighbours is no chance (about e^-27)
STUCK_SAMPLES = 20

# Places in the state of one channel.
_LAST, _RUN, _HIGH, _N_HIGH, _HIGH_RUN, _LONGEST_HIGH, _LOW, _N_LOW, _LOW_RUN, _LONGEST_LOW, _N = range(11)
_NEXT_HIGH, _N_NEXT_HIGH, _NEXT_LOW, _N_NEXT_LOW, _CHANGES = range(11, 16)
_STATE = 16


@compiled
def _scan(x, state, longest, stuck):  # type: ignore[no-untyped-def]
    """Follow one channel: extremes with their counts and runs, and which samples lie in a run above `longest`."""
    found = 0
    for i in range(x.size):
        v = x[i]
        if not np.isfinite(v):
            continue
        state[_N] += 1
        if v == state[_LAST]:
            state[_RUN] += 1
        else:
            state[_RUN] = 1
            state[_LAST] = v
            state[_CHANGES] += 1
        if state[_RUN] > longest:
            if state[_RUN] == longest + 1:
                back = int(min(longest, i))
                for j in range(i - back, i):
                    stuck[j] = True
                found += back
            stuck[i] = True
            found += 1
        if v > state[_HIGH]:
            state[_NEXT_HIGH], state[_N_NEXT_HIGH] = state[_HIGH], state[_N_HIGH]
            state[_HIGH], state[_N_HIGH], state[_HIGH_RUN], state[_LONGEST_HIGH] = v, 1, 1, 1
        elif v == state[_HIGH]:
            state[_N_HIGH] += 1
            state[_HIGH_RUN] += 1
            state[_LONGEST_HIGH] = max(state[_LONGEST_HIGH], state[_HIGH_RUN])
        else:
            state[_HIGH_RUN] = 0
            if v > state[_NEXT_HIGH]:
                state[_NEXT_HIGH], state[_N_NEXT_HIGH] = v, 1
            elif v == state[_NEXT_HIGH]:
                state[_N_NEXT_HIGH] += 1
        if v < state[_LOW]:
            state[_NEXT_LOW], state[_N_NEXT_LOW] = state[_LOW], state[_N_LOW]
            state[_LOW], state[_N_LOW], state[_LOW_RUN], state[_LONGEST_LOW] = v, 1, 1, 1
        elif v == state[_LOW]:
            state[_N_LOW] += 1
            state[_LOW_RUN] += 1
            state[_LONGEST_LOW] = max(state[_LONGEST_LOW], state[_LOW_RUN])
        else:
            state[_LOW_RUN] = 0
            if v < state[_NEXT_LOW]:
                state[_NEXT_LOW], state[_N_NEXT_LOW] = v, 1
            elif v == state[_NEXT_LOW]:
                state[_N_NEXT_LOW] += 1
    return found


@dataclass
class ChannelWatch:
    """Watches one channel for a value that sticks and for a ceiling that cuts its peaks."""

    state: FloatArray = field(default_factory=lambda: np.zeros(_STATE))
    stuck: int = 0
    longest: int = 0

    def __post_init__(self) -> None:
        self.state[[_LAST, _NEXT_HIGH, _NEXT_LOW]] = np.nan, -np.inf, np.inf
        self.state[[_HIGH, _LOW]] = -np.inf, np.inf

    def look(self, values: FloatArray) -> NDArray[np.bool_]:
        """Which of the next samples lie in a run of equal values too long to be chance.

        Too long: against the usual run of the channel's first samples, so that coarse steps of a resting sensor pass.
        A run that began in an earlier piece is marked from this piece on.
        """
        if not self.longest:
            finite = values[np.isfinite(values)]
            ends = np.flatnonzero(np.diff(finite) != 0)
            runs = np.diff(np.concatenate([[-1], ends, [finite.size - 1]])) if finite.size else np.ones(1)
            usual = float(np.quantile(runs, 0.9)) if len(runs) > 9 else 1.0
            self.longest = max(STUCK_SAMPLES, int(STUCK_RUNS * usual))
        marks = np.zeros(values.size, np.bool_)
        self.stuck += int(_scan(np.ascontiguousarray(values), self.state, self.longest, marks))  # type: ignore[no-untyped-call]
        return marks

    @property
    def seen(self) -> int:
        """How many samples had a value."""
        return int(self.state[_N])

    @property
    def highest(self) -> float:
        """The highest value so far."""
        return float(self.state[_HIGH])

    @property
    def lowest(self) -> float:
        """The lowest value so far."""
        return float(self.state[_LOW])

    @property
    def saturated(self) -> int:
        """How many samples stand at a ceiling or floor: 0 unless its value comes in runs and piles up there."""
        s = self.state
        count = 0
        for n, run, beside in ((_N_HIGH, _LONGEST_HIGH, _N_NEXT_HIGH), (_N_LOW, _LONGEST_LOW, _N_NEXT_LOW)):
            if s[n] >= 10 and s[run] >= 2 and s[n] > 4 * s[beside] and s[n] < 0.9 * s[_N] - 1:
                count += int(s[n])
        return count

    @property
    def constant(self) -> bool:
        """The channel never changed."""
        return bool(self.state[_N] > 1 and self.state[_CHANGES] <= 1)


@dataclass
class Blocks:
    """Means over blocks of samples of several channels, never more than `limit` of them, whatever the log's length.

    A block does not reach across the end of a stretch. When there are too many, neighbours are joined. A block holds
    the mean of the values it has, NaN when more than half are missing.
    """

    channels: int
    limit: int = 131_072
    size: int = 1
    _done: list[FloatArray] = field(default_factory=list)
    _stretch: list[NDArray[np.int64]] = field(default_factory=list)
    _rest: FloatArray = field(init=False)
    _now: int = 0
    _count: int = 0

    def __post_init__(self) -> None:
        self._rest = np.empty((self.channels, 0))

    def add(self, values: FloatArray) -> None:
        """Add samples (channels, n) that follow those before."""
        joined = np.concatenate([self._rest, values], axis=1) if self._rest.size else values
        count = joined.shape[1] // self.size
        self._put(_means(joined[:, : count * self.size], self.size))
        self._rest = np.array(joined[:, count * self.size :])
        while self._count > self.limit:
            self._halve()

    def end(self) -> None:
        """The stretch ends here; a last block that is half full or more is kept."""
        if 2 * self._rest.shape[1] >= self.size and self._rest.shape[1]:
            self._put(_means(self._rest, self._rest.shape[1]))
        self._rest = np.empty((self.channels, 0))
        self._now += 1

    def finish(self) -> tuple[FloatArray, NDArray[np.int64]]:
        """The blocks (channels, count) and the number of the stretch of each."""
        self.end()
        if not self._done:
            return np.empty((self.channels, 0)), np.empty(0, np.int64)
        return np.concatenate(self._done, axis=1), np.concatenate(self._stretch)

    def _put(self, means: FloatArray) -> None:
        if means.shape[1]:
            self._done.append(means)
            self._stretch.append(np.full(means.shape[1], self._now))
            self._count += means.shape[1]

    def _halve(self) -> None:
        values, stretch = np.concatenate(self._done, axis=1), np.concatenate(self._stretch)
        kept, marks = [], []
        edges = np.flatnonzero(np.diff(stretch)) + 1
        carried = np.empty((self.channels, 0))
        for part, mark in zip(np.split(values, edges, axis=1), np.split(stretch, edges), strict=True):
            count = part.shape[1] // 2
            kept.append(_means(part[:, : 2 * count], 2))
            marks.append(mark[:count])
            if part.shape[1] % 2 and mark[0] == self._now:
                carried = np.repeat(part[:, -1:], self.size, axis=1)  # stands for the samples it was made of
        self._rest = np.concatenate([carried, self._rest], axis=1)
        self._done, self._stretch = [np.concatenate(kept, axis=1)], [np.concatenate(marks)]
        self._count = self._done[0].shape[1]
        self.size *= 2


def _means(values: FloatArray, size: int) -> FloatArray:
    if size == 1:
        return np.array(values)
    folded = values.reshape(values.shape[0], -1, size)
    means: FloatArray = folded.mean(axis=2)
    holes = np.isnan(means)
    if holes.any():
        there = np.isfinite(folded)
        n = there.sum(axis=2)
        some = np.where(there, folded, 0.0).sum(axis=2) / np.maximum(n, 1)
        means = np.where(holes, np.where(2 * n >= size, some, np.nan), means)
    return means
