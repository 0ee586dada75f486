"""Small tables for the figures: samples over time, histogram, Q-Q and autocorrelation of every bin."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from rangeeval.analyses.accuracy.gathering import Gathered, Place
from rangeeval.model import Bins
from rangeeval.stats import cells as c
from rangeeval.stats.cells import LAGS, Cell

Array = NDArray[np.float64]
Columns = Mapping[str, list[float]]

SAMPLES = 600  # points a small plot can show
QUANTILES = 200
OVERVIEW = 3000


def figure_series(gathered: Gathered, bins: Bins) -> dict[str, Columns]:
    """Series by name: `bins` numbers them; `<axis>/<number>/samples|histogram|qq|autocorrelation`, `<axis>/all`."""
    series: dict[str, Columns] = {
        "bins": {
            "number": [float(i) for i in range(len(gathered.bins))],
            "low": [bins.edges(b)[0] for b in gathered.bins],
            "high": [bins.edges(b)[1] for b in gathered.bins],
        }
    }
    for axis, cells in gathered.cells.items():
        everything = []
        for number, b in enumerate(gathered.bins):
            cell = cells.get(Place(b))
            if cell is None or cell.n == 0:
                continue
            here = f"{axis}/{number}"
            series[f"{here}/samples"] = _samples(cell, SAMPLES)
            everything.append(_samples(cell, max(OVERVIEW // len(gathered.bins), 20)))
            if cell.n > 1 and cell.sums[c.M2] > 0:
                series[f"{here}/histogram"] = _histogram(cell)
                series[f"{here}/qq"] = _qq(cell)
                series[f"{here}/autocorrelation"] = _autocorrelation(cell)
        if everything:
            series[f"{axis}/all"] = {name: [v for part in everything for v in part[name]] for name in everything[0]}
    return series


def _samples(cell: Cell, limit: int) -> Columns:
    """At most about `limit` samples in time order, the smallest and the largest of all always among them."""
    values, times, ranges = cell.kept[c.VALUE], cell.kept[c.TIME], cell.kept[c.RANGE]
    step = max(1, math.ceil(values.size / limit))
    chosen = np.arange(0, values.size, step)
    kept = set(chosen.tolist())
    extra = [int(i) for i in (np.argmin(values), np.argmax(values)) if int(i) not in kept]
    order = np.sort(np.concatenate([chosen, np.array(sorted(set(extra)), dtype=np.intp)]))
    t, x, r = times[order], values[order], ranges[order]
    for at, value in ((cell.sums[c.MIN_T], cell.sums[c.MIN_X]), (cell.sums[c.MAX_T], cell.sums[c.MAX_X])):
        if value < x.min() or value > x.max():  # the extreme was thinned away: put it back, at its bin's mean range
            t, x, r = np.append(t, at), np.append(x, value), np.append(r, cell.mean_of(c.SUM_R))
    by_time = np.argsort(t, kind="stable")
    return {"time_s": t[by_time].tolist(), "residual": x[by_time].tolist(), "range_m": r[by_time].tolist()}


def _histogram(cell: Cell) -> Columns:
    """Counts in equal steps (Freedman and Diaconis 1981), of the samples kept, scaled to all."""
    values = cell.kept[c.VALUE]
    q1, q3 = np.quantile(values, [0.25, 0.75])
    width = 2.0 * (q3 - q1) / max(values.size, 1) ** (1 / 3)
    span = float(np.ptp(values))
    count = int(np.clip(math.ceil(span / width) if width > 0 else 10, 5, 60))
    counts, edges = np.histogram(values, bins=count)
    scale = cell.n / values.size
    return {"low": edges[:-1].tolist(), "high": edges[1:].tolist(), "count": (counts * scale).tolist()}


def _qq(cell: Cell) -> Columns:
    """Sample quantiles against those of a normal distribution, the outermost always among them."""
    values = np.sort(cell.kept[c.VALUE])
    p = (np.arange(values.size) + 0.5) / values.size
    if values.size > QUANTILES:
        edge = 20
        middle = np.linspace(edge, values.size - 1 - edge, QUANTILES - 2 * edge).astype(int)
        chosen = np.unique(np.concatenate([np.arange(edge), middle, np.arange(values.size - edge, values.size)]))
        values, p = values[chosen], p[chosen]
    return {"normal": ndtri(p).tolist(), "residual": values.tolist()}


def _autocorrelation(cell: Cell) -> Columns:
    covariances, pairs = cell.covariances()
    lags = min(20, LAGS, int(np.count_nonzero(pairs > 1)) - 1)
    rho = covariances[1 : lags + 1] / covariances[0]
    return {"lag": [float(k) for k in range(1, lags + 1)], "correlation": rho.tolist()}
