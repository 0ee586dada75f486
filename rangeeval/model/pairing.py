"""Plots beside the truth: which path belongs to which target, and where the target truly was at each plot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import one_line
from rangeeval.model.paths import TruePath, partner
from rangeeval.model.plots import PlotLog, Plots
from rangeeval.model.table import MAX_SHOWN, Problem
from rangeeval.physics.polar import cartesian

Floats = NDArray[np.float64]

DEFAULT_GATE_M = 1000.0  # how near a target without a name in common must be to its path, in the median


@dataclass(frozen=True)
class Pair:
    """The plots of one target and the path it flew."""

    plots: Plots
    path: TruePath


def paired(
    log: PlotLog, paths: Mapping[str, TruePath], gate_m: float | None = None
) -> tuple[list[Pair], tuple[Problem, ...]]:
    """Each target's plots with its true path: by name; where no name fits, by the nearest path.

    A target of another name than any path goes to the path it is nearest to, by the median distance, within `gate_m`
    (1 km by default). Plots without any name, with several paths, go to the nearest path plot by plot.
    """
    gate = DEFAULT_GATE_M if gate_m is None else gate_m
    pairs: list[Pair] = []
    problems: list[Problem] = []
    strangers: list[Plots] = []
    for plots in log.targets:
        name = partner(plots.target, paths)
        if name is not None:
            pairs.append(Pair(plots, paths[name]))
        else:
            strangers.append(plots)
    lost: list[Plots] = []
    matched: list[Pair] = []
    for plots in strangers:
        if not plots.target and len(paths) > 1:
            near = _plot_by_plot(plots, list(paths.values()), gate)
            pairs += near
            left = len(plots) - sum(len(p.plots) for p in near)
            problems.append(Problem(
                plots.source, f"plots that name no target went to the nearest true path within {gate:g} m",
                len(plots) - left,
            ))  # fmt: skip
            if left:
                problems.append(Problem(plots.source, f"plots farther than {gate:g} m from every true path", left))
            continue
        path = _nearest(plots, list(paths.values()), gate)
        if path is None:
            lost.append(plots)
            continue
        matched.append(Pair(plots, path))
    if matched:
        pairs += matched
        shown = tuple(
            f"target '{one_line(p.plots.target, 40)}' with '{one_line(p.path.target, 40)}'" for p in matched[:MAX_SHOWN]
        )
        reason = "targets that have no path of their name: compared with the nearest"
        problems.append(Problem(log.source, reason, sum(len(p.plots) for p in matched), shown))
    if lost:
        shown = tuple(f"target '{one_line(p.target, 40)}'" for p in lost[:MAX_SHOWN])
        problems.append(Problem(log.source, "targets without a true path", sum(map(len, lost)), shown))
    return pairs, tuple(problems)


def measured_positions(plots: Plots, paths_up_m: Floats | None = None) -> Floats:
    """Positions (n, 3) north, up, east of plots; without an elevation that of the height given, else level."""
    elevation = plots.elevation_rad
    if paths_up_m is not None:
        sine = np.clip(np.where(np.isfinite(paths_up_m), paths_up_m, 0.0) / plots.range_m, -1.0, 1.0)
        elevation = np.where(np.isfinite(elevation), elevation, np.arcsin(sine))
    return cartesian(plots.range_m, plots.azimuth_rad, np.where(np.isfinite(elevation), elevation, 0.0))


def _distances(plots: Plots, path: TruePath) -> Floats:
    true, _ = path.at(plots.time_s)
    apart: Floats = np.linalg.norm(measured_positions(plots, true[:, 1]) - true, axis=1)
    return apart


def _nearest(plots: Plots, paths: Sequence[TruePath], gate: float) -> TruePath | None:
    best, found = gate, None
    for path in paths:
        apart = _distances(plots, path)
        there = apart[np.isfinite(apart)]
        if there.size and float(np.median(there)) < best:
            best, found = float(np.median(there)), path
    return found


def _plot_by_plot(plots: Plots, paths: Sequence[TruePath], gate: float) -> list[Pair]:
    apart = np.stack([_distances(plots, path) for path in paths])
    apart = np.where(np.isfinite(apart), apart, np.inf)
    nearest = np.argmin(apart, axis=0)
    within = apart.min(axis=0) < gate
    return [
        Pair(plots.take(rows, path.target), path)
        for k, path in enumerate(paths)
        if (rows := within & (nearest == k)).any()
    ]
