"""Long series reduced to what a screen or a page can show, with every extreme kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def decimate(x: ArrayLike, y: ArrayLike, columns: int = 1000) -> tuple[Floats, Floats]:
    """Keep of a line what its picture shows: the first, last, lowest and highest sample of each pixel column.

    Parameters
    ----------
    x, y : samples in drawing order; values of y that are not finite are kept, since they break the line.
    columns : pixel columns across the picture.

    Returns
    -------
    The kept samples in their order: at most about 4 a column, all of them when there are no more than that.
    """
    a, b = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if a.size <= 4 * columns:
        return a, b
    column = _cells(a, columns)
    edge = np.flatnonzero(np.diff(column)) + 1
    starts = np.concatenate(([0], edge))
    keep = np.zeros(a.size, dtype=bool)
    finite = np.isfinite(b)
    keep[starts] = True
    keep[np.concatenate((edge - 1, [a.size - 1]))] = True
    keep &= finite
    run = np.repeat(np.arange(starts.size), np.diff(np.concatenate((starts, [a.size]))))
    for filler, best in ((np.inf, np.minimum), (-np.inf, np.maximum)):
        value = np.where(finite, b, filler)
        extreme = np.flatnonzero((value == best.reduceat(value, starts)[run]) & finite)
        keep[extreme[np.unique(run[extreme], return_index=True)[1]]] = True
    gap = ~finite
    gap[1:] &= finite[:-1]  # one break is enough for a run of them
    keep |= gap
    return a[keep], b[keep]


def thin(x: ArrayLike, y: ArrayLike, columns: int = 800, rows: int = 300) -> tuple[Floats, Floats]:
    """Keep of a cloud of points the first in each pixel, and the lowest and highest of each pixel column.

    Parameters
    ----------
    x, y : coordinates; pairs that are not finite are dropped.
    columns, rows : pixels across and up the picture.
    """
    a, b = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    finite = np.isfinite(a) & np.isfinite(b)
    a, b = a[finite], b[finite]
    if a.size <= columns:
        return a, b
    column = _cells(a, columns)
    first = np.unique(column * rows + _cells(b, rows), return_index=True)[1]
    keep = np.zeros(a.size, dtype=bool)
    keep[first] = True
    order = np.lexsort((b, column))
    new = np.flatnonzero(np.diff(column[order])) + 1
    keep[order[np.concatenate(([0], new))]] = True
    keep[order[np.concatenate((new - 1, [a.size - 1]))]] = True
    return a[keep], b[keep]


def _cells(value: Floats, cells: int) -> NDArray[np.int64]:
    finite = np.isfinite(value)
    if not finite.any():
        return np.zeros(value.size, dtype=np.int64)
    low, high = value[finite].min(), value[finite].max()
    scale = (cells - 1e-6) / (high - low) if high > low else 0.0
    return np.where(finite, (np.where(finite, value, low) - low) * scale, 0).astype(np.int64)
