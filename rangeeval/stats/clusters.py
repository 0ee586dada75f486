"""Samples in clusters (tracks, flights): does their total scatter more between clusters than within them explains?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special


@dataclass(frozen=True)
class Excess:
    """The variance of a total, seen between clusters, over the variance expected; 1 when chance explains it.

    `dof`: degrees of freedom that the clusters leave (infinite when chance explains it).
    """

    ratio: float = 1.0
    dof: float = np.inf

    @property
    def allowance(self) -> float:
        """The ratio, and the square by which a 95 % interval of so few clusters is wider than one of many."""
        return self.ratio * float(special.stdtrit(self.dof, 0.975) / special.ndtri(0.975)) ** 2


def cluster_excess(values: ArrayLike, cluster: ArrayLike, variance: float, level: float = 0.05) -> Excess:
    """Compare the scatter of cluster totals with the `variance` expected of the total of all `values` (n).

    `cluster` (n): a number for each value's cluster. Two clusters or more are needed to see anything. `level`: of the
    test that decides whether the clusters differ; 1 takes their scatter for what there is, but for no less variance
    than expected.

    References
    ----------
    Liang and Zeger (1986), variance of a total from independent clusters, times G / (G - 1) for G of them.
    """
    x, marks = np.asarray(values, np.float64), np.asarray(cluster)
    _, code, sizes = np.unique(marks, return_inverse=True, return_counts=True)
    groups = sizes.size
    if groups < 2 or not variance > 0.0:
        return Excess()
    deviations: NDArray[np.float64] = np.bincount(code, x) - sizes * x.mean()
    seen = groups / (groups - 1) * float(deviations @ deviations)
    if level < 1.0 and special.chdtrc(groups - 1, (groups - 1) * seen / variance) >= level:
        return Excess()
    return Excess(max(seen / variance, 1.0), groups - 1.0)
