"""What is looked at while a log is read, and only flagged: time order, repeated rows, likely wrong units."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rangeeval.model import Problem, Table

NEAREST_M = 50.0
FARTHEST_M = 5.0e6
_LOOKED_AT = 10_000


class Checks:
    """The checks of one reading of a log, piece after piece; nothing is changed or left out.

    Time order and repetitions are judged within a track (or target): a row against the row of its track before it, and
    repeated (track, time) pairs within one piece.
    """

    def __init__(self, where: str, kind: str) -> None:
        self.where = where
        self.kind = kind
        self._last = np.empty(0)
        self._latest = -np.inf
        self._first = True

    def look(self, piece: Table) -> tuple[Problem, ...]:
        """The problems of the next piece."""
        found: list[Problem] = []
        if len(piece):
            if "time_s" in piece and self.kind != "snapshots":
                found += self._order(piece)
            if self._first and self.kind == "residuals":
                found += self._plausible(piece)
            self._first = False
        return tuple(found)

    def _order(self, piece: Table) -> list[Problem]:
        time = piece.floats("time_s")
        by = "track_id" if "track_id" in piece else "target_id"
        codes = piece.codes(by)
        tracks = len(piece.labels.get(by, ())) + 2  # one more for rows without a track
        if len(self._last) < tracks:
            # Code -1 (no track) is the last place, so it moves when labels are added.
            grown = np.full(tracks, np.nan)
            if len(self._last):
                grown[: len(self._last) - 1] = self._last[:-1]
                grown[-1] = self._last[-1]
            self._last = grown
        if self._in_order(time, codes):
            backward, largest, repeated = 0, 0.0, 0
        else:
            backward, largest, repeated = self._by_track(time, codes)
        self._latest = float(np.fmax(self._latest, np.fmax.reduce(time)))
        self._last[codes] = time
        found = []
        if backward:
            found.append(
                Problem(
                    self.where,
                    "time goes backwards within a track",
                    backward,
                    (f"largest step {largest:.6g} s",),
                )
            )
        if repeated:
            found.append(Problem(self.where, f"rows repeat the time of another row of the same {by[:-3]}", repeated))
        return found

    def _in_order(self, time: NDArray[np.float64], codes: NDArray[np.int32]) -> bool:
        """Whether cheap passes show that there is neither fault: a log in time order, or one track after another."""
        steps = np.diff(time)
        turns = np.diff(codes)
        smallest = steps.min() if len(steps) else np.inf
        if smallest >= 0 and time[0] >= self._latest:
            # Rows of one time are in order of their tracks (as dwells write them), so no two are of one track.
            if smallest == 0 and not (turns[steps == 0] > 0).all():
                return False
            return time[0] > self._latest or not (self._last[codes[time == time[0]]] == time[0]).any()
        starts = np.concatenate([[0], np.flatnonzero(turns) + 1])
        tracks = codes[starts]
        if len(starts) > len(time) // 8 or len(np.unique(tracks)) < len(tracks):
            return False
        return bool((steps[turns == 0] > 0).all() and not (self._last[tracks] >= time[starts]).any())

    def _by_track(self, time: NDArray[np.float64], codes: NDArray[np.int32]) -> tuple[int, float, int]:
        # Sixteen bits sort in linear time.
        order = np.argsort(codes.astype(np.int16) if len(self._last) < 2**15 else codes, kind="stable")
        t, c = time[order], codes[order]
        same = c[1:] == c[:-1]
        before = np.empty(len(t))
        before[1:] = np.where(same, t[:-1], np.nan)
        starts = np.concatenate([[0], np.flatnonzero(~same) + 1])
        before[starts] = self._last[c[starts]]
        steps = t - before
        with np.errstate(invalid="ignore"):
            back = steps < 0
        repeated = int(np.count_nonzero(steps == 0))
        if back.any():  # not sorted within its track: pairs apart from each other are found by sorting
            by_time = np.lexsort((t, c))
            ts, cs = t[by_time], c[by_time]
            repeated = int(np.count_nonzero((ts[1:] == ts[:-1]) & (cs[1:] == cs[:-1])))
            repeated += int(np.count_nonzero(steps[starts] == 0))
        return int(np.count_nonzero(back)), float(-steps[back].min()) if back.any() else 0.0, repeated

    def _plausible(self, piece: Table) -> list[Problem]:
        found: list[Problem] = []
        every = slice(None, None, max(1, len(piece) // _LOOKED_AT))
        if "range_predicted_m" not in piece:
            return found
        distance = piece.floats("range_predicted_m")[every]
        usable = distance[np.isfinite(distance)]
        if len(usable):
            median = float(np.median(usable))
            if not NEAREST_M <= median <= FARTHEST_M:
                found.append(
                    Problem(
                        self.where,
                        f"the median of range_predicted_m is {median:.6g} m; is its unit the one its name says?",
                    )
                )
        for name in ("y_predicted_m", "z_predicted_m"):
            if name in piece:
                with np.errstate(invalid="ignore"):
                    beyond = np.abs(piece.floats(name)[every]) > distance
                if 2 * np.count_nonzero(beyond) > len(distance):
                    found.append(
                        Problem(
                            self.where,
                            f"{name} exceeds range_predicted_m on most rows; are their units those of their names?",
                        )
                    )
        return found
