"""What was recognised in each file: kind, columns and units, rows, tracks, time span, gaps, rejected rows, SHA-256."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.model import Log, Problem, Table, Trial, gather
from rangeeval.parsers import open_trial
from rangeeval.parsers.hashing import sha256_of

GAP_INTERVALS = 5.0


@dataclass(frozen=True)
class ColumnFound:
    """One column: its name in the file, the stored name (its ending is the unit), and how many rows lack a value."""

    written: str
    stored: str
    missing: int


@dataclass(frozen=True)
class Inspection:
    """What one log of a trial was recognised as and what is in it.

    A gap is an interval within a track longer than `GAP_INTERVALS` times the track's median interval (its median in the
    piece in which the track begins). Times are NaN where the log has no row.
    """

    source: str
    file: str
    format: str
    kind: str
    stage: str
    size: int
    sha256: str
    columns: tuple[ColumnFound, ...]
    rows: int
    rejected: int
    tracks: int
    first_time_s: float
    last_time_s: float
    gaps: int
    largest_gap_s: float
    problems: tuple[Problem, ...]
    array: dict[str, Any] | None = None

    def as_dict(self) -> dict[str, object]:
        """For JSON: plain values, NaN as None."""
        data = asdict(self)
        data["problems"] = [p.as_dict() for p in self.problems]
        data["columns"] = [asdict(c) for c in self.columns]
        if self.array is None:
            del data["array"]
        return {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in data.items()}


def inspect_trial(paths: str | os.PathLike[str] | Iterable[str | os.PathLike[str]] | Trial) -> list[Inspection]:
    """Read every row of every log of a trial and say what was found, one `Inspection` a log."""
    trial = paths if isinstance(paths, Trial) else open_trial(paths)
    hashes = sha256_of(trial.sources)
    found = []
    seen: set[str] = set()
    for log in trial.logs:
        file = log.source.split(":")[0]
        source = next((s for s in trial.sources if file in {s.name, f"{trial.name}/{s.name}"}), None)
        # What concerns a file as a whole is told with its first log.
        opened = [p for p in trial.problems if p.where == log.source or (p.where == file and file not in seen)]
        seen.add(file)
        found.append(
            _inspect(
                log,
                opened,
                source.name if source else log.source,
                source.format if source else "",
                source.size if source else 0,
                hashes.get(source.name, "") if source else "",
            )
        )
    return found


def _inspect(log: Log, problems: list[Problem], file: str, form: str, size: int, sha256: str) -> Inspection:
    missing = dict.fromkeys(log.columns, 0)
    rows = 0
    first, last = math.nan, math.nan
    gaps = _Gaps()
    labels: tuple[str, ...] = ()
    untracked = False
    width = 0
    for piece in log.pieces(None):
        rows += len(piece)
        problems = [*problems, *piece.problems]
        for name, column in piece.columns.items():
            width = max(width, column.shape[1] if column.ndim == 2 else 0)
            absent = column == -1 if column.dtype.kind == "i" else np.isnan(column)
            absent = absent.any(axis=1) if absent.ndim == 2 else absent
            missing[name] += int(np.count_nonzero(absent))
        if "time_s" in piece and len(piece):
            time = piece.floats("time_s")
            if not np.isnan(time).all():
                first = float(np.fmin(first, np.nanmin(time)))
                last = float(np.fmax(last, np.nanmax(time)))
            by = "track_id" if "track_id" in piece else "target_id"
            labels = piece.labels.get(by, ())
            untracked |= bool((piece.codes(by) == -1).any()) or (by not in piece)
            gaps.add(piece, by)
    found = gather(problems)
    return Inspection(
        log.source,
        file,
        form,
        log.kind,
        log.stage,
        size,
        sha256,
        tuple(ColumnFound(log.written.get(n, n), n, missing[n]) for n in log.columns),
        rows,
        sum(p.count for p in found if p.rejected),
        len(labels) + untracked,
        first,
        last,
        gaps.count,
        gaps.largest,
        found,
        _array_of(log, width),
    )


def _array_of(log: Log, sensors: int) -> dict[str, Any] | None:
    """What is known of the array of a snapshots log: the facts that differ from their defaults."""
    if log.array is None:
        return None
    facts = {f.name: getattr(log.array, f.name) for f in fields(log.array)}
    return {"sensors": sensors} | {f.name: facts[f.name] for f in fields(log.array)
                                   if facts[f.name] != f.default and f.name != "sensors"}  # fmt: skip


class _Gaps:
    """Counts gaps piece after piece, with each track's last time and usual interval."""

    def __init__(self) -> None:
        self.count = 0
        self.largest = 0.0
        self._last: dict[int, float] = {}
        self._usual: dict[int, float] = {}

    def add(self, piece: Table, by: str) -> None:
        """Count the gaps of one more piece."""
        codes = piece.codes(by)
        time = piece.floats("time_s")
        order = np.argsort(codes, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(codes[order])) + 1):
            if len(rows):
                self._track(int(codes[rows[0]]), time[rows])

    def _track(self, code: int, time: NDArray[np.float64]) -> None:
        time = time[~np.isnan(time)]
        if not len(time):
            return
        steps = np.diff(time, prepend=self._last.get(code, math.nan))
        steps = steps[steps > 0]
        self._last[code] = float(time[-1])
        if not len(steps):
            return
        usual = self._usual.get(code)
        if usual is None:
            usual = float(np.median(steps))
            if len(steps) >= 3:
                self._usual[code] = usual
        wide = steps[steps > GAP_INTERVALS * usual]
        self.count += len(wide)
        if len(wide):
            self.largest = max(self.largest, float(wide.max()))


__all__ = ["GAP_INTERVALS", "ColumnFound", "Inspection", "inspect_trial"]
