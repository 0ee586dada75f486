"""How good a set of tracks is against the truth: distances between sets, and who followed whom for how long.

Set distances (OSPA, GOSPA) take the matrix of distances between every track and every truth at one time. The measures
of continuity take an `Association`: one row for every track at every time, saying which truth it was on. Ratios per bin
are sums of numerators over sums of denominators, never means of ratios.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NOBODY = -1  # the truth of a track that is on none


def distances(tracks: ArrayLike, truths: ArrayLike) -> Floats:
    """Euclidean distances (m, n) between positions (m, d) and (n, d); rows with a missing coordinate are left out."""
    a, b = _present(tracks), _present(truths)
    if not a.size or not b.size:
        return np.empty((len(a), len(b)))
    apart: Floats = np.linalg.norm(a[:, None, :] - b[None, :, :], axis=-1)
    return apart


@dataclass(frozen=True)
class Ospa:
    """The OSPA distance in m, with the part of position and that of number (their p-th powers add up)."""

    total: float
    localisation: float
    cardinality: float


@dataclass(frozen=True)
class Gospa:
    """The GOSPA distance in m, and its three parts as p-th powers that add up: position, missed, false."""

    distance: float
    localisation: float
    missed: float
    false: float


def ospa(distance: ArrayLike, cutoff: float, order: float = 2.0) -> Ospa:
    """Distance between a set of tracks and a set of truths: (m, n) distances in m, both may be empty.

    The best pairing of the smaller set with the larger one, each pair costing at most `cutoff`; what has no partner
    costs `cutoff`; the mean of order `order` over the larger set.

    References
    ----------
    Schuhmacher, Vo and Vo (2008), A consistent metric for performance evaluation of multi-object filters, eq 3.
    """
    d = _matrix(distance, cutoff, order)
    larger = max(d.shape)
    if larger == 0:
        return Ospa(0.0, 0.0, 0.0)
    cost = np.minimum(d, cutoff) ** order
    place = float(cost[linear_sum_assignment(cost)].sum()) / larger
    number = cutoff**order * abs(d.shape[0] - d.shape[1]) / larger
    return Ospa((place + number) ** (1 / order), place ** (1 / order), number ** (1 / order))


def gospa(distance: ArrayLike, cutoff: float, order: float = 2.0) -> Gospa:
    """Distance that charges every missed truth and every false track alike (alpha = 2): (m, n) distances in m.

    A pair farther apart than `cutoff` is no pair: a miss and a false track, each cutoff^order / 2.

    References
    ----------
    Rahmathullah, Garcia-Fernandez and Svensson (2017), Generalized optimal sub-pattern assignment metric, eq 1.
    """
    d = _matrix(distance, cutoff, order)
    cost = np.minimum(d, cutoff) ** order
    rows, columns = linear_sum_assignment(cost)
    paired = d[rows, columns] < cutoff
    place = float(cost[rows, columns][paired].sum())
    pairs = int(np.count_nonzero(paired))
    half = cutoff**order / 2
    missed, false = half * (d.shape[1] - pairs), half * (d.shape[0] - pairs)
    return Gospa((place + missed + false) ** (1 / order), place, missed, false)


@dataclass(frozen=True)
class Association:
    """Which truth every track was on: one row for each track at each of its times.

    `step`, `track` and `truth` (n each, in order of step within a track): number of the time, the track, and the truth
    (`NOBODY` for none). `present` (steps, truths): whether a truth could have been held then.
    """

    step: Ints
    track: Ints
    truth: Ints
    present: NDArray[np.bool_]

    @property
    def held(self) -> NDArray[np.bool_]:
        """Whether at least one track was on each truth (steps, truths)."""
        found = np.zeros_like(self.present)
        on = self.truth != NOBODY
        found[self.step[on], self.truth[on]] = True
        return found & self.present


@dataclass(frozen=True)
class Counts:
    """What completeness, ambiguity and spuriousness are made of; counts of bins, tracks and trials add up."""

    present: int = 0
    held: int = 0
    assigned: int = 0
    tracks: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    @property
    def completeness(self) -> float:
        """Share of the truths that were held."""
        return _ratio(self.held, self.present)

    @property
    def ambiguity(self) -> float:
        """Tracks on each truth that was held: 1 is right."""
        return _ratio(self.assigned, self.held)

    @property
    def spuriousness(self) -> float:
        """Share of the tracks that were on no truth."""
        return _ratio(self.tracks - self.assigned, self.tracks)


def count(
    association: Association, truth_bin: ArrayLike | None = None, track_bin: ArrayLike | None = None
) -> dict[int, Counts]:
    """The counts of each bin; one bin 0 when none are given.

    `truth_bin` (steps, truths) and `track_bin` (rows): the bin of every truth and of every track then, negative for
    none. A track on a truth counts in the truth's bin, one on none in its own.
    """
    a = association
    truths = np.zeros(a.present.shape, np.int64) if truth_bin is None else np.asarray(truth_bin, np.int64)
    own = np.zeros(a.track.shape, np.int64) if track_bin is None else np.asarray(track_bin, np.int64)
    on = a.truth != NOBODY
    if a.present.shape[1]:
        on &= a.present[a.step, np.maximum(a.truth, 0)]
        own = np.where(on, truths[a.step, np.maximum(a.truth, 0)], own)
    size = int(max(truths.max(initial=-1), own.max(initial=-1))) + 1
    columns = [
        np.bincount(chosen[chosen >= 0], minlength=size) for chosen in (truths[a.present], truths[a.held], own[on], own)
    ]
    return {b: c for b in range(size) if (c := Counts(*(int(column[b]) for column in columns))) != Counts()}


@dataclass(frozen=True)
class Continuity:
    """How one truth was followed: times it was lost and found again, changes of track, and the wait until first held.

    `latency_s` is NaN when it never was held.
    """

    breaks: int
    identity_changes: int
    latency_s: float


def continuity(association: Association, time_s: ArrayLike) -> list[Continuity]:
    """How each truth was followed over the times (steps) in s.

    A truth is followed by one track as long as that one stays on it, whoever joins; when it leaves, by the lowest
    number of those there. Steps at which the truth could not be held are no break.
    """
    t, a = np.asarray(time_s, dtype=np.float64), association
    held = a.held
    found = []
    for j in range(a.present.shape[1]):
        steps = np.flatnonzero(a.present[:, j])
        on = held[steps, j]
        first = np.flatnonzero(on)
        breaks = int(np.count_nonzero(np.diff(on.astype(np.int8)) == 1)) - (int(not on[0]) if first.size else 0)
        latency = float(t[steps[first[0]]] - t[steps[0]]) if first.size else float("nan")
        found.append(Continuity(breaks, _changes(a, j), latency))
    return found


def _changes(a: Association, truth: int) -> int:
    rows = np.flatnonzero((a.truth == truth) & a.present[a.step, truth])
    followed, changes = -1, 0
    for there in np.split(a.track[rows[np.lexsort((a.track[rows], a.step[rows]))]], _edges(a.step[rows])):
        if there.size and followed not in there:
            changes += followed != -1
            followed = int(there[0])
    return changes


def _edges(step: Ints) -> NDArray[np.intp]:
    return np.flatnonzero(np.diff(np.sort(step))) + 1


def purity(association: Association) -> dict[int, float]:
    """Of each track that ever was on a truth, the share of that time it was on the truth it was on most."""
    a = association
    on = a.truth != NOBODY
    found = {}
    for track in np.unique(a.track[on]).tolist():
        counts = np.bincount(a.truth[on & (a.track == track)])
        found[track] = float(counts.max() / counts.sum())
    return found


def assign(track: ArrayLike, distance: ArrayLike, enter: float = 4.0, leave: float = 6.0) -> Ints:
    """The truth each track was on at each of its times: the nearest within `enter`, kept until farther than `leave`.

    Parameters
    ----------
    track : (n,) number of the track; rows of one track in order of time.
    distance : (n, truths) Mahalanobis distance (square root of d'S^-1 d) to every truth; NaN where there is none then.
    enter, leave : gates in sigma, `leave` the wider, so that a track on the edge of a gate does not come and go.

    Raises
    ------
    ValueError : `leave` is less than `enter`.
    """
    if leave < enter:
        raise ValueError(f"a track enters at {enter:g} sigma and leaves at {leave:g}; leave at no less than enter")
    tracks, d = np.asarray(track), np.asarray(distance, dtype=np.float64)
    d = np.where(np.isnan(d), np.inf, d)
    found = np.full(len(tracks), NOBODY, np.int64)
    if not d.size:
        return found
    nearest = np.argmin(d, axis=1)
    on: dict[int, int] = {}
    for row, number in enumerate(tracks.tolist()):
        now = on.get(number, NOBODY)
        if now == NOBODY or d[row, now] > leave:
            now = int(nearest[row])
            if d[row, now] > enter:
                now = NOBODY
        on[number] = found[row] = now
    return found


def _present(positions: ArrayLike) -> Floats:
    p = np.asarray(positions, dtype=np.float64)
    return p[np.isfinite(p).all(axis=-1)] if p.size else p.reshape(0, p.shape[-1] if p.ndim > 1 else 0)


def _matrix(distance: ArrayLike, cutoff: float, order: float) -> Floats:
    d = np.asarray(distance, dtype=np.float64)
    if d.ndim != 2 or np.isnan(d).any():
        raise ValueError("distances between tracks and truths are a matrix without missing values")
    if not (cutoff > 0 and order >= 1):
        raise ValueError(f"cutoff {cutoff:g} and order {order:g}: expected more than 0, and 1 or more")
    return d


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else float("nan")
