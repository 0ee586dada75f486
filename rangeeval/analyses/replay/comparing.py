"""Filters side by side on the same plots: paired differences with their standard error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.replay.numbers import Place
from rangeeval.analyses.replay.pooled import Updates
from rangeeval.model import Estimate
from rangeeval.stats.mean_square import Interval, mean

Floats = NDArray[np.float64]

MAIN = ("alpha-beta", "kalman", "imm")


def paired_rows(
    chosen: str, others: Mapping[str, Updates], u: Updates, errors: Mapping[str, Floats], confidence: float
) -> list[Estimate]:
    """Each other filter less the chosen one, update by update: log-likelihood, and squared error where truth is known.

    The interval is that of the mean difference, with the memory of the differences counted; one that holds 0 says that
    the log does not tell the two apart. `errors`: (n, 3) position errors by filter.
    """
    rows: list[Estimate] = []
    for name, other in others.items():
        both = u.used & other.used
        place = Place(both, group=f"{name} less {chosen}")
        if not both.any():
            continue
        for quantity, unit, difference in _differences(name, chosen, u, other, errors, both):
            found = mean(difference, confidence, u.track[both])
            rows.append(place.row(quantity, unit, found, _verdict(found, quantity)))
    return rows


def _differences(
    name: str, chosen: str, u: Updates, other: Updates, errors: Mapping[str, Floats], both: NDArray[np.bool_]
) -> Sequence[tuple[str, str, Floats]]:
    found = [("log_likelihood_difference", "1", (other.log_likelihood - u.log_likelihood)[both])]
    if name in errors and chosen in errors:
        square = (errors[name] ** 2).sum(axis=1) - (errors[chosen] ** 2).sum(axis=1)
        if np.isfinite(square[both]).any():
            found.append(("squared_error_difference", "m^2", square[both]))
    return found


def _verdict(found: Interval, quantity: str) -> list[str]:
    """Better or worse than the chosen filter, where the interval says so."""
    if not found.low * found.high > 0:
        return ["not-told-apart"]
    more_is_better = quantity.startswith("log_likelihood")
    return ["better"] if (found.value > 0) == more_is_better else ["worse"]
