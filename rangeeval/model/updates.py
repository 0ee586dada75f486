"""The updates of a trial: its residual log piece by piece, the gains of each update beside it.

The two logs are joined on (track, time). Where they have the same rows in the same order, as one recorder writes them,
nothing is copied; else each update takes the gains of its track within `TOLERANCE_S` of its time.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import InputError, one_line
from rangeeval.model.table import CHUNK_ROWS, MAX_SHOWN, ColumnArray, Log, Problem, Table
from rangeeval.model.trial import Trial

TOLERANCE_S = 1e-6

AXES = ("range", "y", "z")
AXIS_GAINS = tuple(f"{gain}_{axis}" for axis in AXES for gain in ("alpha", "beta"))
# y and z of a log that holds direction sines: the sine times the predicted range.
FROM_SINES = {
    "y_residual_m": "sin_elevation_residual",
    "z_residual_m": "sin_azimuth_residual",
    "y_predicted_m": "sin_elevation_predicted",
    "z_predicted_m": "sin_azimuth_predicted",
}
_RESIDUALS = {"range_residual_m": "alpha_range", "y_residual_m": "alpha_y", "z_residual_m": "alpha_z"}

Floats = NDArray[np.float64]
Columns = dict[str, ColumnArray]


def updates(trial: Trial, names: Collection[str] | None = None) -> Iterator[Table]:
    """The residual log piece by piece with the gains of each update: all columns, or those named (if the log has them).

    The gains are `alpha_range`, `beta_range`, ... of each axis; a log with one `alpha` and `beta` gives them for all
    three. An update without gains has NaN. Direction sines are given as `y_residual_m` and so on; residuals after the
    update are converted to those before it, residual / (1 - alpha). Raises InputError when gains are asked for and no
    log has them.
    """
    log = trial.log("residuals")
    plan = _plan(trial, log, names)
    pieces = log.pieces(plan.read)
    if plan.gains is not None:
        pieces = _joined(log, plan, pieces)
    return (_finished(piece, log, plan) for piece in pieces)


@dataclass(frozen=True)
class _Plan:
    """Which columns to read, where each gain comes from, and what to give back."""

    read: tuple[str, ...]
    give: tuple[str, ...]
    own: Mapping[str, str]  # gain of an axis: column of the residual log
    gains: Log | None = None
    joined: Mapping[str, str] | None = None  # gain of an axis: column of the gain log
    by_track: bool = True
    problems: tuple[Problem, ...] = ()


def _source_of(gain: str, log: Log) -> str | None:
    if gain in log:
        return gain
    common = gain.split("_")[0]
    return common if common in log else None


def _plan(trial: Trial, log: Log, names: Collection[str] | None) -> _Plan:
    held = [c for c in log.columns if c not in AXIS_GAINS and c not in {"alpha", "beta"}]
    derived = [n for n, sine in FROM_SINES.items() if n not in log and sine in log]
    give = [c for c in (*held, *derived) if names is None or c in names]
    gains = [g for g in AXIS_GAINS if names is None or g in names]
    needed = list(gains)
    if log.stage == "updated":
        needed += [a for r, a in _RESIDUALS.items() if r in give and a not in gains]
    own = {g: source for g in needed if (source := _source_of(g, log)) is not None}
    missing = [g for g in needed if g not in own]
    gain_log: Log | None = None
    joined: dict[str, str] = {}
    problems: tuple[Problem, ...] = ()
    if missing:
        logs = trial.of_kind("gains")
        if not logs and not own:
            raise InputError(
                f"no gains in {trial.name}: the columns alpha and beta, or alpha_range, beta_range, alpha_y, ..., are "
                f"needed in {log.source} or in a gain log with time_s"
                + (" to convert residuals after the update" if log.stage == "updated" else "")
            )
        if logs:
            gain_log = trial.log("gains")
            joined = {g: source for g in missing if (source := _source_of(g, gain_log)) is not None}
            if not joined:
                gain_log = None
    elif needed and (logs := trial.of_kind("gains")):
        problems = (Problem(logs[0].source, f"not used: {log.source} holds the gains of its updates itself"),)
    by_track = gain_log is not None and "track_id" in log and "track_id" in gain_log
    read = dict.fromkeys(
        [FROM_SINES.get(n, n) if n in derived else n for n in give]
        + (["range_predicted_m"] if any(n in derived for n in give) else [])
        + list(own.values())
        + (["time_s"] if gain_log is not None else [])
        + (["track_id"] if by_track else [])
    )
    return _Plan(tuple(read), (*give, *gains), own, gain_log, joined, by_track, problems)


def _finished(piece: Table, log: Log, plan: _Plan) -> Table:
    """The piece with the columns asked for, under their names."""
    columns: Columns = dict(piece.columns)
    problems = list(piece.problems + plan.problems)
    for gain, source in plan.own.items():
        columns[gain] = piece.columns[source]
    for name, sine in FROM_SINES.items():
        if name not in columns and sine in columns and name in plan.give:
            columns[name] = piece.floats(sine) * piece.floats("range_predicted_m")
    if log.stage == "updated":
        for name, gain in _RESIDUALS.items():
            if name in columns and gain in columns:
                values, alpha = (np.asarray(columns[c], np.float64) for c in (name, gain))
                columns[name], found = _before_update(values, alpha, name, gain, log, piece)
                problems += found
            elif name in columns and name in plan.give:
                raise InputError(
                    f"{log.source}: {name} is of after the update, and {gain} is needed to convert it to before"
                )
    chosen = {n: columns[n] for n in plan.give if n in columns}
    labels = {n: t for n, t in piece.labels.items() if n in chosen}
    return Table(chosen, labels, piece.first_row, tuple(problems))


def _before_update(
    values: Floats,
    alpha: Floats,
    name: str,
    gain: str,
    log: Log,
    piece: Table,
) -> tuple[Floats, list[Problem]]:
    """Residuals before the update from those after it: r = r_updated / (1 - alpha)."""
    impossible = alpha >= 1
    with np.errstate(divide="ignore", invalid="ignore"):
        before = np.where(impossible, np.nan, values / (1.0 - alpha))
    if not impossible.any():
        return before, []
    first = np.flatnonzero(impossible)[:MAX_SHOWN].tolist()
    examples = tuple(f"{log.source}: {gain} is {alpha[i]:.6g} in row {piece.first_row + i}" for i in first)
    reason = f"{name} after the update cannot be converted where {gain} is 1 or more; taken as missing"
    return before, [Problem(log.source, reason, int(np.count_nonzero(impossible)), examples, rejected=True)]


# --- the join --------------------------------------------------------------------------------------------------------


def _joined(log: Log, plan: _Plan, pieces: Iterator[Table]) -> Iterator[Table]:
    assert plan.gains is not None
    assert plan.joined is not None
    wanted = tuple(dict.fromkeys([*plan.joined.values(), "time_s", *(["track_id"] if plan.by_track else [])]))
    gain_pieces = plan.gains.pieces(wanted)
    aligned = 0
    join: _Join | None = None
    piece: Table | None = None
    for piece in pieces:
        if join is None:
            beside = next(gain_pieces, None)
            if beside is not None and _aligned(piece, beside, plan.by_track):
                aligned += len(piece)
                problems = piece.problems + beside.problems
                last = len(piece) < CHUNK_ROWS
                if last and len(beside) > len(piece):
                    unused = len(beside) - len(piece) + sum(len(rest) for rest in gain_pieces)
                    problems += (_unused(log, plan.gains, unused),)
                yield _beside(piece, {g: beside.floats(s)[: len(piece)] for g, s in plan.joined.items()}, problems)
                if last:
                    return
                continue
            # The rows differ from here on: take all gains into memory and look each update up.
            close = getattr(gain_pieces, "close", None)
            if close is not None:
                close()
            table = plan.gains.read(wanted)
            join = _Join(log, plan, table, aligned)
            piece = replace(piece, problems=piece.problems + table.problems)
        found = join.look_up(piece)
        last = len(piece) < CHUNK_ROWS
        yield replace(found, problems=found.problems + join.left_over()) if last else found
        if last:
            return
    # The log ended with a full piece: what is left to say goes with an empty one.
    if piece is None:
        return
    rest = join.left_over() if join is not None else ()
    if join is None and (unused := sum(len(beside) for beside in gain_pieces)):
        rest = (_unused(log, plan.gains, unused),)
    if rest:
        empty = piece.take(np.zeros(len(piece), bool))
        yield _beside(replace(empty, problems=()), {g: np.empty(0) for g in plan.joined}, rest)


def _beside(piece: Table, gains: Mapping[str, Floats], problems: tuple[Problem, ...]) -> Table:
    return Table({**piece.columns, **gains}, piece.labels, piece.first_row, problems)


def _unused(log: Log, gains: Log, rows: int) -> Problem:
    return Problem(gains.source, f"gains that belong to no update of {log.source}", rows)


def _aligned(piece: Table, beside: Table, by_track: bool) -> bool:
    """Whether the rows of the gain log are those of the residual log, in the same order."""
    n = len(piece)
    if len(beside) < n or (len(beside) > n == CHUNK_ROWS):
        return False
    time, other = piece.floats("time_s"), beside.floats("time_s")[:n]
    if not np.array_equal(time, other):
        with np.errstate(invalid="ignore"):
            near = np.abs(time - other) <= TOLERANCE_S
        if not bool((near | (np.isnan(time) & np.isnan(other))).all()):
            return False
    if not by_track:
        return True
    codes, others = piece.codes("track_id"), beside.codes("track_id")[:n]
    mine, theirs = piece.labels["track_id"], beside.labels["track_id"]
    if mine != theirs:
        others = _translation(theirs, mine)[others]
    return bool(np.array_equal(codes, others))


def _translation(source: Sequence[str], target: Sequence[str]) -> NDArray[np.int32]:
    """A table from the codes of one set of labels to those of another: -1 missing (last place), -2 not there."""
    codes = {label: code for code, label in enumerate(target)}
    return np.array([*(codes.get(label, -2) for label in source), -1], np.int32)


class _Join:
    """All gains in memory, ordered by track and time, to look updates up in; counts what finds no partner.

    64 bytes a row: logs that are not aligned row by row need that much memory for their gains.
    """

    def __init__(self, log: Log, plan: _Plan, gains: Table, aligned: int) -> None:
        assert plan.gains is not None
        assert plan.joined is not None
        self.log = log
        self.gain_log = plan.gains
        self.by_track = plan.by_track
        self.columns = {gain: gains.floats(source) for gain, source in plan.joined.items()}
        self.labels = gains.labels.get("track_id", ())
        self.seen: tuple[str, ...] = ()
        time = gains.floats("time_s")
        codes = gains.codes("track_id") if self.by_track else np.zeros(len(gains), np.int32)
        order = np.lexsort((time, codes))
        self.row = order
        self.time = time[order]
        codes = codes[order]
        edges = np.flatnonzero(np.diff(codes)) + 1
        starts = np.concatenate([[0], edges]).tolist() if len(codes) else []
        stops = [*starts[1:], len(codes)]
        self.segments = {int(codes[a]): (a, b) for a, b in zip(starts, stops, strict=True)}
        self.used = np.zeros(len(gains), bool)
        self.used[:aligned] = True

    def look_up(self, piece: Table) -> Table:
        """The piece with the gains of its rows."""
        time = piece.floats("time_s")
        if self.by_track:
            self.seen = piece.labels["track_id"]
            codes = _translation(self.seen, self.labels)[piece.codes("track_id")]
        else:
            codes = np.zeros(len(piece), np.int32)
        order = np.lexsort((time, codes))
        sorted_codes = codes[order]
        edges = np.flatnonzero(np.diff(sorted_codes)) + 1
        partner = np.full(len(piece), -1, np.intp)
        for rows in np.split(order, edges):
            segment = self.segments.get(int(codes[rows[0]])) if len(rows) else None
            if segment is not None:
                partner[rows] = self._partners(time[rows], *segment)
        matched = partner >= 0
        self.used[partner[matched]] = True
        gains = {}
        for name, values in self.columns.items():
            gains[name] = np.where(matched, values[np.maximum(partner, 0)] if len(values) else np.nan, np.nan)
        problems = piece.problems
        if not matched.all():
            lost = np.flatnonzero(~matched)
            texts = piece.texts("track_id") if self.by_track else None
            examples = tuple(
                f"time_s {time[i]:.9g}" + (f", track '{one_line(texts[i], 40)}'" if texts else "")
                for i in lost[:MAX_SHOWN].tolist()
            )
            reason = f"updates without gains: {self.gain_log.source} has no row of their track and time"
            problems += (Problem(self.log.source, reason, len(lost), examples),)
        return _beside(piece, gains, problems)

    def _partners(self, time: Floats, start: int, stop: int) -> NDArray[np.intp]:
        """The gain row of each time (sorted, one track): the k-th of equal times takes the k-th of equal gains."""
        known = self.time[start:stop]
        left = np.searchsorted(known, time - TOLERANCE_S, "left")
        right = np.searchsorted(known, time + TOLERANCE_S, "right")
        nth = np.arange(len(time)) - np.searchsorted(time, time - TOLERANCE_S, "left")
        found = (right > left) & ~np.isnan(time)
        place = left + np.minimum(nth, np.maximum(right - left - 1, 0))
        return np.where(found, self.row[start + np.minimum(place, len(known) - 1)], -1)

    def left_over(self) -> tuple[Problem, ...]:
        """What can be said at the end: gains of no update, and tracks that only one log has."""
        problems: tuple[Problem, ...] = ()
        if unused := len(self.used) - int(np.count_nonzero(self.used)):
            problems += (_unused(self.log, self.gain_log, unused),)
        if self.by_track:
            for log, other, only in (
                (self.log, self.gain_log, [t for t in self.seen if t not in set(self.labels)]),
                (self.gain_log, self.log, [t for t in self.labels if t not in set(self.seen)]),
            ):
                if only:
                    shown = ", ".join(one_line(t, 40) for t in only[:MAX_SHOWN])
                    more = f" and {len(only) - MAX_SHOWN} more" if len(only) > MAX_SHOWN else ""
                    problems += (Problem(log.source, f"tracks that {other.source} does not have: {shown}{more}"),)
        return problems


__all__ = ["AXES", "AXIS_GAINS", "FROM_SINES", "TOLERANCE_S", "updates"]
