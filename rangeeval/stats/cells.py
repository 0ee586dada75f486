"""Sums over cells: everything the accuracy analysis needs of a log of any length, gathered in one pass.

A *cell* is one group of samples in one bin. Each axis (range, y, z) adds its samples to its own sums, in row order,
so the result has the same bits for any number of threads. Sums of two parts of a log add up (`Cell.merged`), which
is also how the row of all groups together is made. Moments are kept as mean and central sums (Pebay 2008), never as
plain sums of squares; weighted sums are taken about each cell's first sample for the same reason.

The pass keeps, for every cell: four moments; the sums that the per-sample gain ratio needs (noise-only `cv` and
optimal-gain `white`, for the axis itself and for its angle); gains; predictions; lag products up to `LAGS`; a
histogram of logarithmic buckets for medians; and up to `KEPT` samples, evenly thinned, for plots, exact medians and the
spread of the weights.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rangeeval.compiled import compiled
from rangeeval.stats.correlation import LagSums, lag_sums

Array = NDArray[np.float64]

LAGS = 40  # 10 log10 N up to N = 10,000; beyond that more lags change n_eff by less than its own error
KEPT = 4096
(VALUE, TIME, RANGE, SNR, WEIGHT, ANGLE_WEIGHT, TRACK) = range(7)  # rows of the samples kept
_FIELDS = 7
STEP = 0.2  # a gain change of more than this is a jump
_GAP = 4.5  # an interval of more than this many usual ones is a coast of more than a few updates
_PAUSE = 1.5  # usual intervals; samples further apart are not neighbours
_OCTAVES = 48
_PER_OCTAVE = 32
_LOWEST = 1023 - 24  # buckets reach from 2^-24 to 2^24
_BUCKETS = 2 * _OCTAVES * _PER_OCTAVE

# Marks of a row.
RESTART, DROP, SKIP = 1, 2, 4

# Columns of `sums`.
(N, MEAN, M2, M3, M4, SHIFT) = range(6)
(Q0, Q1, Q2, W0, W1, W2, U0, U1, U2, V0, V1, V2) = range(6, 18)
(SUM_ALPHA, MIN_ALPHA, MAX_ALPHA, SUM_BETA, SUM_R, SUM_C) = range(18, 24)
(N_SNR, SUM_SNR, MIN_SNR, MAX_SNR, SUM_NOISE, SUM_FLOOR) = range(24, 30)
(MIN_X, MIN_T, MAX_X, MAX_T, N_STARTUP, N_STRETCH, LONGEST, N_BEYOND) = range(30, 38)
(FULL_SUM, FULL_COUNT) = range(38, 40)
_COLUMNS = 40

# Columns of a track's state on one axis.
(_MEMORY, _STEADY, _ALPHA, _CELL, _LENGTH, _POSITION, _RUN, _EMPTY) = range(8)
_STATE = 8

# Columns of a track's state shared by the axes.
(_SEEN, _TIME, _RANGE, _RESIDUAL, _INTERVAL, _LEG, _EXTREME) = range(7)
_SHARED = 7


@compiled
def _follow(  # type: ignore[no-untyped-def]
    time, track, rng, residual, fixed_interval, state, last_row, extreme_row, previous, mark, leg
):
    """Mark restarts and duplicates and find the leg of each row; `state` carries the tracks across pieces.

    The leg turns when the range has come back from its extreme by more than max(100 m, 0.5 %), which is more than
    a prediction's noise; the rows since the extreme are then relabelled. Returns the number of duplicates.
    """
    duplicates = 0
    last_row[:] = -1
    extreme_row[:] = -1
    for j in range(len(time)):
        t = track[j]
        s = state[t]
        mark[j] = 0
        previous[j] = last_row[t]
        r = rng[j]
        if s[_SEEN] == 0.0:
            mark[j] = RESTART
            s[_SEEN] = 1.0
            s[_INTERVAL] = fixed_interval
            s[_LEG] = 0.0
            s[_EXTREME] = r
            extreme_row[t] = j
        else:
            step = time[j] - s[_TIME]
            if step == 0.0 and r == s[_RANGE] and (residual[j] == s[_RESIDUAL] or residual[j] != residual[j]):
                mark[j] = DROP
                duplicates += 1
                leg[j] = np.int8(s[_LEG])
                last_row[t] = j
                continue
            usual = s[_INTERVAL]
            if step < 0.0:
                mark[j] = RESTART
            elif usual == 0.0:
                s[_INTERVAL] = step
            elif step > _GAP * usual:
                mark[j] = RESTART
            elif fixed_interval == 0.0 and step > 0.0:
                s[_INTERVAL] = step if step * _GAP < usual else usual + 0.1 * (step - usual)
        s[_TIME] = time[j]
        s[_RANGE] = r
        s[_RESIDUAL] = residual[j]
        last_row[t] = j
        way = s[_LEG]
        if r == r:
            extreme = s[_EXTREME]
            if extreme != extreme:
                s[_EXTREME] = r
                extreme_row[t] = j
            else:
                turn = max(100.0, 0.005 * extreme)
                new_way = way
                if way >= 0.0 and r < extreme - turn:
                    new_way = -1.0
                elif way <= 0.0 and r > extreme + turn:
                    new_way = 1.0
                if new_way != way:
                    s[_LEG] = new_way
                    back = previous[j]
                    stop = extreme_row[t]
                    while back >= 0 and back >= stop and (back > stop or way == 0.0):
                        leg[back] = np.int8(new_way)
                        back = previous[back]
                    way = new_way
                    s[_EXTREME] = r
                    extreme_row[t] = j
                elif (way > 0.0 and r > extreme) or (way < 0.0 and r < extreme):
                    s[_EXTREME] = r
                    extreme_row[t] = j
        leg[j] = np.int8(way)
    # A short track may end before it has moved far enough to tell: its net movement decides.
    for t in range(len(last_row)):
        j = last_row[t]
        if j < 0 or state[t, _LEG] != 0.0:
            continue
        extreme = state[t, _EXTREME]
        way = np.sign(state[t, _RANGE] - extreme)
        while j >= 0 and way == way:
            leg[j] = np.int8(way)
            j = previous[j]
    return duplicates


@compiled
def _assign(group, index, table, cell, count):  # type: ignore[no-untyped-def]
    """Number the cells in the order they are met; returns how many there are now."""
    for j in range(len(group)):
        if index[j] < 0:
            cell[j] = -1
            continue
        c = table[group[j], index[j]]
        if c < 0:
            c = count
            table[group[j], index[j]] = c
            count += 1
        cell[j] = c
    return count


@compiled
def _add(  # type: ignore[no-untyped-def]
    x, bits, alpha, beta, rng, cross, snr, time, cell, track, mark,
    angle, with_snr, startup, sums, products, sketch, kept, stride, state, ring, weight,
):  # fmt: skip
    """Add one axis's samples to its cells. One pass, row order, nothing allocated."""
    for j in range(len(x)):
        m = mark[j]
        if m & DROP:
            continue
        t = track[j]
        s = state[t]
        if m & RESTART:
            s[_MEMORY] = 0.0
            s[_STEADY] = 0.0
            s[_ALPHA] = 0.0
            s[_CELL] = -1.0
        a = alpha[j]
        b = beta[j]
        v = x[j]
        c = cell[j]
        usable = a > 0.0 and b > 0.0 and 2.0 * a + b < 4.0 and abs(v) < np.inf and abs(rng[j]) < np.inf
        if angle:
            usable = usable and abs(cross[j]) < np.inf
        if usable:
            if s[_ALPHA] > 0.0 and abs(a - s[_ALPHA]) > STEP * s[_ALPHA]:
                # A jump between steady gains starts a new transient; gains that jump all the time have none.
                if s[_STEADY] >= startup:
                    s[_MEMORY] = 0.0
                    s[_CELL] = -1.0
                s[_STEADY] = 0.0
            else:
                s[_STEADY] += a
            s[_ALPHA] = a
            # The first 11 / alpha updates; where gains vary, those whose alphas add up to 11.
            settling = s[_MEMORY] < startup
            s[_MEMORY] += a
            if settling:
                if c >= 0 and not m & SKIP:
                    sums[c, N_STARTUP] += 1.0
                continue
        if c < 0:
            s[_CELL] = -1.0
            continue
        o = sums[c]
        own = ring[t]
        present = weight[t]
        if not usable or m & SKIP:
            if s[_CELL] == c:  # an empty place keeps the lags right
                p = int(s[_POSITION])
                p = LAGS - 1 if p == 0 else p - 1
                own[p] = own[p + LAGS] = 0.0
                present[p] = present[p + LAGS] = 0.0
                s[_POSITION] = p
                s[_LENGTH] = min(s[_LENGTH] + 1.0, LAGS)
                s[_EMPTY] = LAGS  # samples until the empty place has left the ring
            continue
        n = o[N]
        if n == 0.0:
            o[SHIFT] = v
        d = v - o[SHIFT]
        if s[_CELL] != c:
            s[_CELL] = c
            s[_LENGTH] = 0.0
            s[_POSITION] = 0.0
            s[_RUN] = 0.0
            s[_EMPTY] = 0.0
            o[N_STRETCH] += 1.0
        # lag products: the last LAGS values lie one after another behind the newest
        p = int(s[_POSITION])
        length = int(s[_LENGTH])
        pr = products[c]
        if length == LAGS and s[_EMPTY] == 0.0:
            # The common case, every place taken: what all lags share is counted once and spread out in `Cell`.
            for k in range(LAGS):
                e = own[p + k]
                pr[0, k] += d * e
                pr[2, k] += e
            o[FULL_SUM] += d
            o[FULL_COUNT] += 1.0
        else:
            for k in range(length):
                e = own[p + k]
                w = present[p + k]
                pr[0, k] += d * e
                pr[1, k] += d * w
                pr[2, k] += e
                pr[3, k] += w
            s[_EMPTY] = max(s[_EMPTY] - 1.0, 0.0)
        p = LAGS - 1 if p == 0 else p - 1
        own[p] = own[p + LAGS] = d
        present[p] = present[p + LAGS] = 1.0
        s[_POSITION] = p
        s[_LENGTH] = min(length + 1.0, LAGS)
        s[_RUN] += 1.0
        o[LONGEST] = max(o[LONGEST], s[_RUN])
        # moments
        n1 = n + 1.0
        delta = v - o[MEAN]
        dn = delta / n1
        dn2 = dn * dn
        term = delta * dn * n
        o[MEAN] += dn
        o[M4] += term * dn2 * (n1 * n1 - 3.0 * n1 + 3.0) + 6.0 * dn2 * o[M2] - 4.0 * dn * o[M3]
        o[M3] += term * dn * (n1 - 2.0) - 3.0 * dn * o[M2]
        o[M2] += term
        o[N] = n1
        # gain ratios
        numerator = 2.0 * a * a - 3.0 * a * b + 2.0 * b
        q = numerator / (2.0 * (2.0 * a + b))
        white = a * (1.0 - a)
        o[Q0] += q
        o[Q1] += q * d
        o[Q2] += q * d * d
        o[W0] += white
        o[W1] += white * d
        o[W2] += white * d * d
        r = rng[j]
        o[SUM_R] += r
        on_angle = 0.0
        if angle:
            y = cross[j]
            square = (r - y) * (r + y)
            o[SUM_C] += y
            if square > 0.0:
                on_angle = u = q / square
                o[U0] += u
                o[U1] += u * d
                o[U2] += u * d * d
                u = white / square
                o[V0] += u
                o[V1] += u * d
                o[V2] += u * d * d
            else:
                o[N_BEYOND] += 1.0
        o[SUM_ALPHA] += a
        o[SUM_BETA] += b
        if n == 0.0:
            o[MIN_ALPHA] = o[MAX_ALPHA] = a
            o[MIN_X] = o[MAX_X] = v
            o[MIN_T] = o[MAX_T] = time[j]
        else:
            o[MIN_ALPHA] = min(o[MIN_ALPHA], a)
            o[MAX_ALPHA] = max(o[MAX_ALPHA], a)
            if v < o[MIN_X]:
                o[MIN_X] = v
                o[MIN_T] = time[j]
            if v > o[MAX_X]:
                o[MAX_X] = v
                o[MAX_T] = time[j]
        if with_snr:
            db = snr[j]
            if abs(db) < np.inf:
                linear = 10.0 ** (0.1 * db)
                ratio = numerator / (a * (4.0 - 2.0 * a - b))
                if o[N_SNR] == 0.0:
                    o[MIN_SNR] = o[MAX_SNR] = db
                else:
                    o[MIN_SNR] = min(o[MIN_SNR], db)
                    o[MAX_SNR] = max(o[MAX_SNR], db)
                o[N_SNR] += 1.0
                o[SUM_SNR] += linear
                o[SUM_NOISE] += ratio / (2.0 * linear)
                o[SUM_FLOOR] += ratio
        # medians: the exponent and the first bits of the mantissa name the bucket
        place = (bits[j] >> 47) & 0xFFFF
        place = min(max(place - _LOWEST * _PER_OCTAVE, 0), _OCTAVES * _PER_OCTAVE - 1)
        half = _OCTAVES * _PER_OCTAVE
        sketch[c, half + place if v >= 0.0 else half - 1 - place] += 1
        # a thinned sample
        every = stride[c]
        number = int(n)
        if number % every == 0:
            place = number // every
            if place == KEPT:
                for i in range(KEPT // 2):
                    for f in range(_FIELDS):
                        kept[c, f, i] = kept[c, f, 2 * i]
                stride[c] = 2 * every
                place = KEPT // 2
            if number % stride[c] == 0:
                kept[c, VALUE, place] = v
                kept[c, TIME, place] = time[j]
                kept[c, RANGE, place] = r
                kept[c, SNR, place] = snr[j] if with_snr else 0.0
                kept[c, WEIGHT, place] = q
                kept[c, ANGLE_WEIGHT, place] = on_angle
                kept[c, TRACK, place] = t


def _grown(array: NDArray[np.generic], rows: int) -> NDArray[np.generic]:
    """The array with at least `rows` rows, new ones zero (untouched memory costs nothing)."""
    if len(array) >= rows:
        return array
    larger = np.zeros((max(rows, 2 * len(array)), *array.shape[1:]), array.dtype)
    larger[: len(array)] = array
    return larger


class Follower:
    """Follows every track through a log: restarts after coasts, duplicate rows, and the leg flown."""

    def __init__(self, update_interval_s: float | None = None) -> None:
        self._state = np.zeros((16, _SHARED))
        self._interval = update_interval_s or 0.0

    def follow(
        self, time: Array, track: NDArray[np.int32], rng: Array, residual: Array
    ) -> tuple[NDArray[np.int8], NDArray[np.int8], int]:
        """Marks, legs (-1 inbound, 1 outbound, 0 unknown), and the number of duplicate rows of a piece."""
        tracks = int(track.max(initial=-1)) + 1
        self._state = _grown(self._state, tracks)  # type: ignore[assignment]
        n = len(time)
        mark, leg = np.empty(n, np.int8), np.empty(n, np.int8)
        last, extreme = np.empty(tracks, np.int32), np.empty(tracks, np.int32)
        previous = np.empty(n, np.int32)
        duplicates = _follow(  # type: ignore[no-untyped-call]
            time, track, rng, residual, self._interval, self._state, last, extreme, previous, mark, leg
        )
        return mark, leg, int(duplicates)


class CellNumbers:
    """Numbers the cells (group, bin) in the order they are met."""

    def __init__(self) -> None:
        self._table = np.full((4, 64), -1, np.int32)
        self.count = 0

    def assign(self, group: NDArray[np.int32], index: NDArray[np.int32]) -> NDArray[np.int32]:
        """The cell of each row, -1 where `index` is negative."""
        groups, bins = int(group.max(initial=0)) + 1, int(index.max(initial=0)) + 1
        if groups > self._table.shape[0] or bins > self._table.shape[1]:
            shape = (max(groups, self._table.shape[0]), max(bins + 16, self._table.shape[1]))
            table = np.full(shape, -1, np.int32)
            table[: self._table.shape[0], : self._table.shape[1]] = self._table
            self._table = table
        cell = np.empty(len(group), np.int32)
        self.count = int(_assign(group, index, self._table, cell, self.count))  # type: ignore[no-untyped-call]
        return cell

    def places(self) -> list[tuple[int, int, int]]:
        """(group, bin, cell) of every cell met, in order of group and bin."""
        found = np.argwhere(self._table >= 0)
        return [(int(g), int(b), int(self._table[g, b])) for g, b in found]


class AxisSums:
    """The sums of one axis over all cells."""

    def __init__(self, *, angle: bool, startup: float) -> None:
        self.angle = angle
        self._startup = startup - 1e-9  # a sum of alphas that should be whole may fall short by rounding
        self._sums = np.zeros((0, _COLUMNS))
        self._products = np.zeros((0, 4, LAGS))
        self._sketch = np.zeros((0, _BUCKETS), np.int64)
        self._kept = np.zeros((0, _FIELDS, KEPT))
        self._stride = np.ones(0, np.int64)
        self._state = np.zeros((0, _STATE))
        self._ring = np.zeros((0, 2 * LAGS))
        self._weight = np.zeros((0, 2 * LAGS))

    def add(
        self,
        residual: Array,
        alpha: Array,
        beta: Array,
        rng: Array,
        cross: Array,
        snr: Array | None,
        time: Array,
        cell: NDArray[np.int32],
        track: NDArray[np.int32],
        mark: NDArray[np.int8],
        cells: int,
    ) -> None:
        """Add a piece of the log; all arrays are of one length, `cross` is the predicted y or z (range: ignored)."""
        tracks = int(track.max(initial=-1)) + 1
        if cells > len(self._sums):
            room = max(cells, 2 * len(self._sums))
            used = len(self._sums)
            self._sums, self._products = _grown(self._sums, room), _grown(self._products, room)  # type: ignore[assignment]
            self._sketch = _grown(self._sketch, room)  # type: ignore[assignment]
            kept = np.zeros((room, _FIELDS, KEPT))
            for c in range(used):
                n = min(int(self._sums[c, N]), KEPT)
                kept[c, :, :n] = self._kept[c, :, :n]
            self._kept = kept
            self._stride = np.concatenate([self._stride, np.ones(room - used, np.int64)])
        self._state = _grown(self._state, tracks)  # type: ignore[assignment]
        self._ring, self._weight = _grown(self._ring, tracks), _grown(self._weight, tracks)  # type: ignore[assignment]
        residual = np.ascontiguousarray(residual)
        _add(  # type: ignore[no-untyped-call]
            residual, residual.view(np.int64), alpha, beta, rng, cross, time if snr is None else snr, time, cell, track,
            mark, self.angle, snr is not None, self._startup, self._sums, self._products, self._sketch, self._kept,
            self._stride, self._state, self._ring, self._weight,
        )  # fmt: skip

    def cell(self, number: int) -> Cell:
        """What was gathered in one cell (an empty one when this axis never met it)."""
        if number >= len(self._sums):
            return Cell.empty(angle=self.angle)
        count = int(self._sums[number, N])
        stride = int(self._stride[number])
        held = min(-(-count // stride), KEPT)
        products = self._products[number].copy()
        products[1] += self._sums[number, FULL_SUM]
        products[3] += self._sums[number, FULL_COUNT]
        return Cell(
            sums=self._sums[number].copy(),
            products=products,
            sketch=self._sketch[number].copy(),
            kept=self._kept[number, :, :held].copy(),
            stride=stride,
            angle=self.angle,
        )


@dataclass(frozen=True)
class Cell:
    """Everything gathered on one axis in one cell; cells add up with `merged`."""

    sums: Array
    products: Array
    sketch: NDArray[np.int64]
    kept: Array
    stride: int
    angle: bool

    @classmethod
    def empty(cls, *, angle: bool) -> Cell:
        """A cell without samples."""
        return cls(
            np.zeros(_COLUMNS), np.zeros((4, LAGS)), np.zeros(_BUCKETS, np.int64), np.zeros((_FIELDS, 0)), 1, angle
        )

    @property
    def n(self) -> int:
        """How many samples."""
        return int(self.sums[N])

    @property
    def startup(self) -> int:
        """How many updates were left out because the filter had not settled."""
        return int(self.sums[N_STARTUP])

    @property
    def exact(self) -> bool:
        """Whether `kept` holds every sample, in order."""
        return self.stride == 1

    def mean_of(self, column: int) -> float:
        """The mean of a summed column (NaN without samples)."""
        return float(self.sums[column] / self.sums[N]) if self.n else math.nan

    def centred(self, first: int, mean: float) -> float:
        """sum w (x - mean)^2 of the weights whose sums start at column `first` (Q0, W0, U0 or V0)."""
        d = mean - self.sums[SHIFT]
        s0, s1, s2 = self.sums[first : first + 3]
        return float(s2 - 2.0 * d * s1 + d * d * s0)

    def covariances(self) -> tuple[Array, Array]:
        """Sums of mean-removed products at lags 0..LAGS, and how many pairs each holds."""
        d = self.sums[MEAN] - self.sums[SHIFT]
        p, lead, trail, count = self.products
        lagged = p - d * (lead + trail) + d * d * count
        return np.concatenate([[self.sums[M2]], lagged]), np.concatenate([[self.sums[N]], count])

    def lag_sums(self) -> LagSums:
        """The same as sums of the samples less their mean, for what `correlation` estimates."""
        products, pairs = self.covariances()
        none = np.zeros(LAGS + 1)
        return LagSums(0.0, int(self.sums[LONGEST]), pairs, products, none, none)

    def squares(self, weight: int, mean: float) -> Array:
        """The weighted squares of the samples kept about a mean."""
        parts: Array = self.kept[weight] * (self.kept[VALUE] - mean) ** 2
        return parts

    def weighted_lag_sums(self, weight: int, mean: float) -> LagSums:
        """Lag sums of the samples less a mean, each scaled with the root of its weight (row of `kept`).

        The memory of what is summed where weights are uneven: near the radar, say, where the angle's weights are and
        gains near 1 ring. For a cell that is `exact`. Tracks are kept apart, and so are stretches between gaps.
        """
        order = np.lexsort((self.kept[TIME], self.kept[TRACK]))
        time, track = self.kept[TIME, order], self.kept[TRACK, order]
        values = np.sqrt(self.kept[weight, order]) * (self.kept[VALUE, order] - mean)
        step = np.diff(time)
        usual = float(np.median(step[step > 0.0])) if np.any(step > 0.0) else 0.0
        new = np.concatenate([[True], (np.diff(track) != 0.0) | (step <= 0.0) | (step > _PAUSE * usual)])
        none = np.zeros(LAGS + 1)  # the mean is taken off already
        return replace(lag_sums(values, LAGS, np.cumsum(new)), leading=none, trailing=none)

    def weight_spread(self, weight: int) -> float:
        """Mean square of the weights of the samples kept over the square of their mean: 1 when all are equal."""
        w = self.kept[weight]
        total = float(w.sum())
        return w.size * float(w @ w) / total**2 if total > 0.0 else math.nan

    def weighted_kurtosis(self, weight: int, mean: float) -> float:
        """Kurtosis of the samples kept, each scaled with the root of its weight (row WEIGHT or ANGLE_WEIGHT of `kept`).

        3 for normal samples that all tell as much of the weighted sum of squares; more where a few carry it.
        """
        parts = self.squares(weight, mean)
        total = float(parts.sum())
        return parts.size * float(parts @ parts) / total**2 if total > 0.0 else math.nan

    def median(self) -> float:
        """The median of the samples: exact up to `KEPT` of them, beyond that within about 0.1 % of the spread."""
        if self.n == 0:
            return math.nan
        if self.exact:
            return float(np.median(self.kept[VALUE]))
        return _bucket_median(self.sketch, _EDGES[:-1], _EDGES[1:])

    def median_absolute_deviation(self) -> float:
        """median |x - median|, with the exactness of `median`."""
        if self.n == 0:
            return math.nan
        if self.exact:
            return float(np.median(np.abs(self.kept[VALUE] - np.median(self.kept[VALUE]))))
        centre = self.median()
        far, near = np.abs(_EDGES[:-1] - centre), np.abs(_EDGES[1:] - centre)
        low, high = np.minimum(far, near), np.maximum(far, near)
        low = np.where((centre >= _EDGES[:-1]) & (centre < _EDGES[1:]), 0.0, low)
        return _bucket_median(self.sketch, low, high)

    @staticmethod
    def merged(cells: Sequence[Cell]) -> Cell:
        """All samples of several cells as one (in the order given; the first cell that has samples sets the shift)."""
        full = [c for c in cells if c.n or c.sums[N_STARTUP]]
        if not full:
            return cells[0]
        result = full[0]
        for other in full[1:]:
            result = _merge(result, other)
        return result


def _merge(a: Cell, b: Cell) -> Cell:
    if a.n == 0 or b.n == 0:
        some, none = (a, b) if a.n else (b, a)
        sums = some.sums.copy()
        sums[N_STARTUP] += none.sums[N_STARTUP]
        return Cell(sums, some.products, some.sketch, some.kept, some.stride, some.angle)
    x, y = a.sums, b.sums
    out = x + y  # every plain sum; the others follow
    na, nb = x[N], y[N]
    n = na + nb
    d = y[MEAN] - x[MEAN]
    out[MEAN] = x[MEAN] + d * nb / n
    out[M2] = x[M2] + y[M2] + d * d * na * nb / n
    out[M3] = x[M3] + y[M3] + d**3 * na * nb * (na - nb) / n**2 + 3.0 * d * (na * y[M2] - nb * x[M2]) / n
    out[M4] = (
        x[M4] + y[M4] + d**4 * na * nb * (na * na - na * nb + nb * nb) / n**3
        + 6.0 * d * d * (na * na * y[M2] + nb * nb * x[M2]) / n**2 + 4.0 * d * (na * y[M3] - nb * x[M3]) / n
    )  # fmt: skip
    shift = y[SHIFT] - x[SHIFT]  # b's sums, taken about a's shift
    out[SHIFT] = x[SHIFT]
    for first in (Q0, W0, U0, V0):
        s0, s1, s2 = y[first : first + 3]
        out[first + 1] = x[first + 1] + s1 + shift * s0
        out[first + 2] = x[first + 2] + s2 + 2.0 * shift * s1 + shift * shift * s0
    p, lead, trail, count = b.products
    products = a.products + np.array(
        [p + shift * (lead + trail) + shift * shift * count, lead + shift * count, trail + shift * count, count]
    )
    for low, high in ((MIN_ALPHA, MAX_ALPHA), (MIN_X, MAX_X)):
        out[low], out[high] = min(x[low], y[low]), max(x[high], y[high])
    out[MIN_T] = x[MIN_T] if x[MIN_X] <= y[MIN_X] else y[MIN_T]
    out[MAX_T] = x[MAX_T] if x[MAX_X] >= y[MAX_X] else y[MAX_T]
    if x[N_SNR] and y[N_SNR]:
        out[MIN_SNR], out[MAX_SNR] = min(x[MIN_SNR], y[MIN_SNR]), max(x[MAX_SNR], y[MAX_SNR])
    out[LONGEST] = max(x[LONGEST], y[LONGEST])
    # Thin both to one stride, then to the room there is.
    stride = max(a.stride, b.stride)
    kept = np.concatenate([c.kept[:, :: stride // c.stride] for c in (a, b)], axis=1)
    while kept.shape[1] > 2 * KEPT:
        kept, stride = kept[:, ::2], 2 * stride
    return Cell(out, products, a.sketch + b.sketch, kept, stride, a.angle)


def _edges() -> Array:
    mantissas = 1.0 + np.arange(_PER_OCTAVE) / _PER_OCTAVE
    positive = np.concatenate([mantissas * 2.0**o for o in range(_LOWEST - 1023, _LOWEST - 1023 + _OCTAVES)])
    top = 2.0 ** (_LOWEST - 1023 + _OCTAVES)
    # The lowest bucket reaches down to zero on both sides.
    return np.concatenate([[-top], -positive[:0:-1], [0.0], positive[1:], [top]])


_EDGES = _edges()


def _bucket_median(counts: NDArray[np.int64], low: Array, high: Array) -> float:
    """The value that splits the counts in half, each bucket's count spread evenly over [low, high)."""
    used = np.flatnonzero(counts)
    density = counts[used] / (high[used] - low[used])
    points = np.concatenate([low[used], high[used]])
    change = np.concatenate([density, -density])
    order = np.argsort(points, kind="stable")
    points, slope = points[order], np.cumsum(change[order])
    below = np.concatenate([[0.0], np.cumsum(slope[:-1] * np.diff(points))])
    return float(np.interp(counts.sum() / 2.0, below, points))
