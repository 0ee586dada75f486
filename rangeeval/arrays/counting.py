"""How many sources a block of snapshots holds.

Caution: a source that moves during the block spreads over two eigenvalues and is counted twice. Keep its motion in
one block below about a fifth of the beam width.

References
----------
Wax and Kailath (1985), IEEE Trans. ASSP 33.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_NOTHING = 1e-14  # of the largest eigenvalue: below lies rounding


@dataclass(frozen=True, eq=False)
class SourceCount:
    """Number of sources by each criterion, with the criteria's values for 0, 1, 2 ... sources."""

    aic: int
    mdl: int
    aic_values: Array
    mdl_values: Array


def count_sources(cov: ArrayLike, snapshots: int) -> SourceCount:
    """Akaike's criterion and the minimum description length of a covariance of that many snapshots.

    cov : (M, M), or (bins, M, M), whose bins must agree on the number.
    """
    e = np.asarray(cov, dtype=np.complex128)
    e = e if e.ndim == 3 else e[None]
    if snapshots < 2:
        raise ValueError(f"{snapshots} snapshots; counting sources needs 2 or more")
    values = np.linalg.eigvalsh(e)[:, ::-1]
    if not values[:, 0].min() > 0:
        raise ValueError("the covariance is zero; there is nothing to count")
    # With fewer snapshots than sensors only as many eigenvalues carry anything.
    dimension = min(e.shape[1], snapshots)
    logs = np.log(np.maximum(values[:, :dimension], _NOTHING * values[:, :1]))
    left = dimension - np.arange(dimension)
    mean_log = np.cumsum(logs[:, ::-1], axis=1)[:, ::-1] / left
    log_mean = np.log(np.cumsum(np.exp(logs)[:, ::-1], axis=1)[:, ::-1] / left)
    misfit = snapshots * (left * (log_mean - mean_log)).sum(axis=0)
    k = np.arange(dimension)
    free = len(e) * k * (2 * dimension - k)
    aic, mdl = 2 * misfit + 2 * free, misfit + 0.5 * free * np.log(snapshots)
    return SourceCount(int(np.argmin(aic)), int(np.argmin(mdl)), aic, mdl)
