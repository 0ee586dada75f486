"""Which plot belongs to which track, when the log does not say: a whole recorded log at once, deterministic.

Plots need not be marked by scan. They are taken in batches so short that no target gives two plots in one; tracks live
and die by time, so a rotating antenna (every target at its own time) and one that looks at all at once are the same.
A track starts from three plots that a target below the speed limit can have given, and ends after some missed revisits.
The little constant-velocity filter in here only makes gates; the tracks it finds are run through the filters proper.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment
from scipy.special import chdtri

from rangeeval.angles import wrapped

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

Method = Literal["nearest", "global", "pda"]
NO_TRACK = -1
PLOTS_TO_START = 3
_FAR = 1e12  # the cost of an impossible pair
_SAMPLE = 400  # plots that the revisit time is judged by


@dataclass(frozen=True)
class Rules:
    """How plots are given to tracks.

    Attributes
    ----------
    method : `nearest` each track in turn the nearest plot, `global` the pairs that are likeliest together, `pda` every
        plot of the gate by its probability (probabilistic data association).
    gate_probability : that a target's own plot falls into its gate.
    max_speed_m_s : of a target, while its track starts.
    process_noise_m_s2 : sigma of the acceleration allowed for in the gate, constant over a revisit.
    revisit_s : usual time between two plots of a target; by default as the plots themselves show.
    misses : missed revisits after which a track ends. `start_misses` : while it has fewer than three plots.
    detection_probability : of `pda`. `clutter_per_m3` : false plots a cubic (planar: square) metre; by default as many
        as the gate holds.
    """

    method: Method = "global"
    gate_probability: float = 0.999
    max_speed_m_s: float = 1000.0
    process_noise_m_s2: float = 20.0
    revisit_s: float | None = None
    misses: int = 3
    start_misses: int = 1
    detection_probability: float = 0.9
    clutter_per_m3: float | None = None


@dataclass(frozen=True)
class Grouping:
    """The tracks found: one number a plot (n,), `NO_TRACK` for plots of none (clutter, or too few to start a track).

    With `pda`, `shared` holds for each track its combined plots instead: rows of the likeliest plot, polar position
    (m, 3) and sigma (m, 3), widened by the spread of the gate's plots and by the chance that none was the target's.
    """

    track: Ints
    tracks: int
    revisit_s: float
    batches: int
    shared: tuple[tuple[Ints, Floats, Floats], ...] = ()


@dataclass
class _Track:
    """A track while it is being built."""

    state: Floats
    covariance: Floats
    time_s: float
    rows: list[int]
    polar: list[Floats] = field(default_factory=list)
    sigma: list[Floats] = field(default_factory=list)

    @property
    def started(self) -> bool:
        return len(self.rows) >= PLOTS_TO_START


def group(time_s: ArrayLike, z: ArrayLike, sigma: ArrayLike, rules: Rules | None = None) -> Grouping:
    """Give plots to tracks.

    Parameters
    ----------
    time_s : (n,), in order.
    z : (n, 3), range (m), azimuth (counter-clockwise from x), elevation (rad); elevation NaN throughout: planar.
    sigma : (3,) or (n, 3), standard deviations.
    rules : see `Rules`.

    References
    ----------
    Blackman and Popoli (1999), Design and Analysis of Modern Tracking Systems, chapter 6; PDA: Bar-Shalom and Li
    (1995), Multitarget-Multisensor Tracking, section 3.4.
    """
    rules = rules or Rules()
    time = np.asarray(time_s, dtype=np.float64)
    polar = np.asarray(z, dtype=np.float64)
    spread = np.broadcast_to(np.asarray(sigma, dtype=np.float64), polar.shape)
    position, covariance = _cartesian(polar, spread)
    revisit = rules.revisit_s or revisit_time(time, position, rules.max_speed_m_s)
    builder = _Builder(rules, revisit, time, polar, spread, position, covariance)
    batches = _batches(time, revisit)
    for rows in batches:
        builder.take(rows)
    return builder.finish(len(batches))


def revisit_time(time_s: Floats, position_m: Floats, max_speed_m_s: float) -> float:
    """The usual time from a plot to the next that the same target can have given; 1 s when there is none.

    A target cannot be farther than its speed allows: of all later plots the first within reach is most often its own.
    """
    n = len(time_s)
    found = []
    chosen = np.unique(np.linspace(0, n - 2, min(_SAMPLE, n - 1)).astype(int)) if n > 1 else np.empty(0, int)
    for i in chosen.tolist():
        later = slice(i + 1, min(i + 2000, n))
        wait = time_s[later] - time_s[i]
        apart = np.linalg.norm(position_m[later] - position_m[i], axis=1)
        within = np.flatnonzero((wait > 1e-3) & (apart <= max_speed_m_s * wait))
        if within.size:
            found.append(float(wait[within[0]]))
    return float(np.median(found)) if found else 1.0


def _batches(time: Floats, revisit: float) -> list[Ints]:
    """Runs of plots shorter than half a revisit, cut where there is a pause."""
    edges, start = [], 0
    for k in range(1, len(time)):
        if time[k] - time[start] > 0.5 * revisit or time[k] - time[k - 1] > 0.3 * revisit:
            edges.append(k)
            start = k
    return [rows for rows in np.split(np.arange(len(time)), edges) if len(rows)]


def _cartesian(polar: Floats, sigma: Floats) -> tuple[Floats, Floats]:
    """Positions (n, d) and their covariances (n, d, d), d = 2 when no plot has an elevation."""
    distance, azimuth, elevation = polar.T
    planar = not bool(np.isfinite(elevation).any())
    el = np.where(np.isfinite(elevation), elevation, 0.0)
    s_el = np.where(np.isfinite(elevation), sigma[:, 2], 0.5)  # unknown: anywhere within a radian or so
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(el), np.sin(el)
    x, y, up = distance * ce * ca, distance * ce * sa, distance * se
    zero = np.zeros_like(x)
    jacobian = np.stack(
        [
            np.stack([ce * ca, -y, -distance * se * ca], -1),
            np.stack([ce * sa, x, -distance * se * sa], -1),
            np.stack([se, zero, distance * ce], -1),
        ],
        axis=-2,
    )
    scaled = jacobian * np.stack([sigma[:, 0], sigma[:, 1], s_el], -1)[:, None, :]
    position, covariance = np.stack([x, y, up], -1), scaled @ scaled.transpose(0, 2, 1)
    d = 2 if planar else 3
    covariance = covariance[:, :d, :d] + np.eye(d) * 1e-6
    return position[:, :d], covariance


class _Builder:
    """Tracks under construction, fed with batches of plots in order of time."""

    def __init__(
        self, rules: Rules, revisit: float, time: Floats, polar: Floats, sigma: Floats, position: Floats,
        covariance: Floats,
    ) -> None:  # fmt: skip
        self.rules = rules
        self.revisit = revisit
        self.time = time
        self.polar = polar
        self.sigma = sigma
        self.position = position
        self.covariance = covariance
        self.d = position.shape[1]
        self.gate = float(chdtri(self.d, 1.0 - rules.gate_probability))
        self.noise = rules.process_noise_m_s2**2 * revisit
        self.live: list[_Track] = []
        self.done: list[_Track] = []

    def take(self, rows: Ints) -> None:
        """Give one batch of plots to the tracks: started ones first, then those with two plots, then with one."""
        now = float(self.time[rows[0]])
        self._retire(now)
        free = rows
        ready = [t for t in self.live if now - t.time_s > 0.4 * self.revisit]
        for level in (PLOTS_TO_START, 2, 1):
            tracks = [t for t in ready if min(len(t.rows), PLOTS_TO_START) == level]
            if tracks and len(free):
                free = self._share(tracks, free) if level == PLOTS_TO_START else self._pair(tracks, free)
        for row in free.tolist():
            self.live.append(self._new(row))

    def finish(self, batches: int) -> Grouping:
        """Number the tracks that started, in order of their first plot."""
        started = sorted((t for t in (*self.done, *self.live) if t.started), key=lambda t: t.rows[0])
        track = np.full(len(self.time), NO_TRACK, np.int64)
        for number, t in enumerate(started):
            track[t.rows] = number
        shared: tuple[tuple[Ints, Floats, Floats], ...] = ()
        if self.rules.method == "pda":
            shared = tuple((np.array(t.rows), np.array(t.polar), np.array(t.sigma)) for t in started)
        return Grouping(track, len(started), self.revisit, batches, shared)

    def _new(self, row: int) -> _Track:
        d = self.d
        state = np.concatenate([self.position[row], np.zeros(d)])
        covariance = np.zeros((2 * d, 2 * d))
        covariance[:d, :d] = self.covariance[row]
        covariance[d:, d:] = np.eye(d) * (self.rules.max_speed_m_s / 3.0) ** 2
        return _Track(state, covariance, float(self.time[row]), [row], [self.polar[row]], [self.sigma[row]])

    def _retire(self, now: float) -> None:
        kept = []
        for t in self.live:
            misses = self.rules.misses if t.started else self.rules.start_misses
            if now - t.time_s > (misses + 1.5) * self.revisit:
                if t.started:
                    self.done.append(t)
            else:
                kept.append(t)
        self.live = kept

    def _predict(self, t: _Track, time: float) -> tuple[Floats, Floats]:
        dt, d = time - t.time_s, self.d
        f = np.eye(2 * d)
        f[:d, d:] = np.eye(d) * dt
        covariance = f @ t.covariance @ f.T
        step = abs(dt)
        for k in range(d):
            covariance[k, k] += self.noise * step**3 / 3
            covariance[k, d + k] += self.noise * step**2 / 2
            covariance[d + k, k] += self.noise * step**2 / 2
            covariance[d + k, d + k] += self.noise * step
        return f @ t.state, covariance

    def _costs(self, tracks: list[_Track], rows: Ints) -> tuple[Floats, Floats]:
        """Squared distance and log determinant (tracks, plots) of every pair, each at the plot's own time."""
        d = self.d
        state = np.stack([t.state for t in tracks])
        p = np.stack([t.covariance for t in tracks])
        dt = self.time[rows][None, :] - np.array([t.time_s for t in tracks])[:, None]
        nu = self.position[rows][None] - state[:, None, :d] - state[:, None, d:] * dt[..., None]
        w = dt[..., None, None]
        cross = p[:, None, :d, d:]
        s = p[:, None, :d, :d] + w * (cross + np.swapaxes(cross, -1, -2)) + w**2 * p[:, None, d:, d:]
        s = s + np.abs(w) ** 3 * (self.noise / 3) * np.eye(d) + self.covariance[rows][None]
        distance = np.einsum("tmi,tmi->tm", nu, np.linalg.solve(s, nu[..., None])[..., 0])
        # A track of one plot has no velocity yet: within reach is all that can be asked.
        return distance, np.linalg.slogdet(s)[1]

    def _pair(self, tracks: list[_Track], rows: Ints) -> Ints:
        """One plot a track at most: the nearest, track by track, or the likeliest pairs together."""
        distance, log_det = self._costs(tracks, rows)
        cost = np.where(distance <= self.gate, distance + log_det, _FAR)
        if self.rules.method == "nearest":
            pairs = _nearest(cost)
        else:
            pairs = [(int(i), int(j)) for i, j in zip(*linear_sum_assignment(cost), strict=True) if cost[i, j] < _FAR]
        for i, j in pairs:
            self._update(tracks[i], int(rows[j]))
        taken = {j for _, j in pairs}
        return np.array([row for j, row in enumerate(rows.tolist()) if j not in taken], np.int64)

    def _update(self, t: _Track, row: int) -> None:
        time = float(self.time[row])
        state, covariance = self._predict(t, time)
        t.state, t.covariance = self._corrected(state, covariance, self.position[row], self.covariance[row])[:2]
        t.time_s = time
        t.rows.append(row)
        t.polar.append(self.polar[row])
        t.sigma.append(self.sigma[row])

    def _corrected(self, x: Floats, p: Floats, y: Floats, c: Floats) -> tuple[Floats, Floats, Floats]:
        d = self.d
        gain = np.asarray(np.linalg.solve(p[:d, :d] + c, p[:d, :]).T, np.float64)
        covariance = p - gain @ p[:d, :]
        return x + gain @ (y - x[:d]), 0.5 * (covariance + covariance.T), gain

    def _share(self, tracks: list[_Track], rows: Ints) -> Ints:
        if self.rules.method != "pda":
            return self._pair(tracks, rows)
        distance, log_det = self._costs(tracks, rows)
        taken = np.zeros(len(rows), bool)
        for t, far, size in zip(tracks, distance, log_det, strict=True):
            inside = np.flatnonzero(far <= self.gate)
            if inside.size:
                self._blend(t, rows[inside], far[inside], size[inside])
                taken[inside] = True
        return rows[~taken]

    def _blend(self, t: _Track, rows: Ints, far: Floats, log_det: Floats) -> None:
        """The probabilistic update: every plot by the probability that it is the target's, none by the rest."""
        rules, d = self.rules, self.d
        unit = {2: np.pi, 3: 4 * np.pi / 3}[d]
        volume = unit * self.gate ** (d / 2) * float(np.exp(0.5 * np.mean(log_det)))
        density = len(rows) / volume if rules.clutter_per_m3 is None else rules.clutter_per_m3
        weight = np.exp(-0.5 * (far + log_det)) / (2 * np.pi) ** (d / 2) * rules.detection_probability
        none = max(density, 1e-300) * (1.0 - rules.detection_probability * rules.gate_probability)
        beta, missed = weight / (weight.sum() + none), none / (weight.sum() + none)
        best = int(rows[int(np.argmax(beta))])
        time = float(self.time[best])
        x, p = self._predict(t, time)
        nu = self.position[rows] - x[:d]
        mean = beta @ nu
        _, corrected, gain = self._corrected(x, p, self.position[best], self.covariance[best])
        scatter = (nu * beta[:, None]).T @ nu - np.outer(mean, mean)
        t.state = x + gain @ mean
        t.covariance = missed * p + (1 - missed) * corrected + gain @ scatter @ gain.T
        t.time_s = time
        t.rows.append(best)
        share = beta / beta.sum()
        away = self.polar[rows] - self.polar[best]
        away[:, 1] = wrapped(away[:, 1])
        centre = share @ away
        seen = np.nan_to_num(away - centre)
        t.polar.append(self.polar[best] + centre)
        t.sigma.append(np.sqrt((self.sigma[best] ** 2 + share @ seen**2) / max(1 - missed, 1e-3)))


def _nearest(cost: Floats) -> list[tuple[int, int]]:
    """Pairs in the order of their cost, each track and plot once."""
    pairs: list[tuple[int, int]] = []
    rows: set[int] = set()
    columns: set[int] = set()
    for index in np.argsort(cost, axis=None, kind="stable").tolist():
        i, j = divmod(index, cost.shape[1])
        if cost[i, j] >= _FAR:
            break
        if i not in rows and j not in columns:
            pairs.append((i, j))
            rows.add(i)
            columns.add(j)
    return pairs
