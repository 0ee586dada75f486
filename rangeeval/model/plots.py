"""The plots of a trial, target by target, in order of time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import InputError
from rangeeval.model.table import Problem, Table, gather
from rangeeval.model.trial import Trial

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Plots:
    """Measured positions of one target (or of all, when the log names none), (n,) each, in order of time.

    `azimuth_rad` clockwise from north, in [0, 2 pi); `elevation_rad` and `snr_db` NaN where not measured.
    """

    target: str
    time_s: Floats
    range_m: Floats
    azimuth_rad: Floats
    elevation_rad: Floats
    snr_db: Floats
    source: str = ""

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def planar(self) -> bool:
        """Whether no plot has an elevation."""
        return not bool(np.isfinite(self.elevation_rad).any())

    def take(self, rows: NDArray[np.intp] | NDArray[np.bool_], target: str | None = None) -> Plots:
        """The plots chosen by an index or a mask, perhaps under another name."""
        return Plots(
            self.target if target is None else target, self.time_s[rows], self.range_m[rows], self.azimuth_rad[rows],
            self.elevation_rad[rows], self.snr_db[rows], self.source,
        )  # fmt: skip


@dataclass(frozen=True)
class PlotLog:
    """All plots of a trial: one entry a target, by name ('' when the log names none), and what was set aside."""

    targets: tuple[Plots, ...]
    named: bool
    source: str
    counts: dict[str, int]
    problems: tuple[Problem, ...]


_COLUMNS = ("time_s", "target_id", "range_m", "azimuth_rad", "elevation_rad", "snr_db")


def plots_of(trial: Trial, progress: Callable[[int], None] | None = None) -> PlotLog:
    """The plots of the trial's plots logs. Raises InputError when it has none, or none that can be used."""
    logs = trial.of_kind("plots") or (trial.log("plots"),)
    problems: list[Problem] = []
    parts: dict[str, list[Table]] = {}
    rows = used = 0
    named = any("target_id" in log for log in logs)
    for log in logs:
        table = log.read(_COLUMNS)
        problems += table.problems
        rows += len(table)
        if progress is not None:
            progress(len(table))
        table, found = _usable(table, log.source)
        problems += found
        used += len(table)
        names = (*table.labels.get("target_id", ()), "")
        codes = table.codes("target_id") if "target_id" in log else np.full(len(table), -1, np.int32)
        order = np.lexsort((table.floats("time_s"), codes))
        edges = np.flatnonzero(np.diff(codes[order])) + 1
        for chosen in np.split(order, edges):
            if len(chosen):
                parts.setdefault(names[codes[chosen[0]]], []).append(table.take(chosen))
    source = ", ".join(log.source for log in logs)
    if not used:
        why = "; ".join(f"{p.reason} ({p.count})" for p in problems[:3]) or "it is empty"
        raise InputError(f"{source}: not one usable plot: {why}")
    if len(logs) > 1:
        problems.append(Problem(source, f"{len(logs)} plots logs, taken together as those of one radar"))
    if named and "" in parts:
        problems.append(Problem(source, "plots that name no target", sum(map(len, parts[""]))))
    targets = tuple(_joined(name, parts[name], source) for name in sorted(parts))
    return PlotLog(targets, named, source, {"plots": rows, "used": used, "targets": len(targets)}, gather(problems))


def _usable(table: Table, source: str) -> tuple[Table, list[Problem]]:
    """The rows with a time, a positive range and an azimuth; impossible elevations become missing."""
    time, distance, azimuth = (table.floats(n) for n in ("time_s", "range_m", "azimuth_rad"))
    good = np.isfinite(time) & np.isfinite(azimuth) & (distance > 0)
    problems = []
    if lost := int(np.count_nonzero(~good)):
        reason = "a plot without time, azimuth or a range above 0: not used"
        problems.append(Problem(source, reason, lost, rejected=True))
    columns = {n: c[good] for n, c in table.columns.items()}
    if "elevation_rad" in columns:
        steep = np.abs(columns["elevation_rad"]) > math.pi / 2 + 1e-9
        if wrong := int(np.count_nonzero(steep)):
            columns["elevation_rad"] = np.where(steep, np.nan, columns["elevation_rad"])
            problems.append(Problem(source, "an elevation beyond 90 degrees: taken as missing", wrong))
    return Table(columns, table.labels, table.first_row), problems


def _joined(name: str, parts: list[Table], source: str) -> Plots:
    columns = {n: np.concatenate([p.floats(n) for p in parts]) for n in _COLUMNS if n != "target_id"}
    order = np.argsort(columns["time_s"], kind="stable")
    time, distance, azimuth, elevation, snr = (c[order] for c in columns.values())
    return Plots(name, time, distance, np.mod(azimuth, 2 * np.pi), elevation, snr, source)
