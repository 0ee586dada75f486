"""Filters side by side on the same plots: paired differences with their standard error."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

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
        for quantity, unit, both, difference in _differences(name, chosen, u, other, errors):
            place = Place(both, group=f"{name} less {chosen}")
            found = mean(difference[both], confidence, u.track[both])
            if found.n:
                rows.append(place.row(quantity, unit, found, _verdict(found, quantity)))
    return rows


def _differences(
    name: str, chosen: str, u: Updates, other: Updates, errors: Mapping[str, Floats]
) -> Iterator[tuple[str, str, NDArray[np.bool_], Floats]]:
    """Quantity, unit, the rows that both filters have, and the difference at every row."""
    yield "log_likelihood_difference", "1", u.used & other.used, other.log_likelihood - u.log_likelihood
    if name in errors and chosen in errors:
        square = (errors[name] ** 2).sum(axis=1) - (errors[chosen] ** 2).sum(axis=1)
        yield "squared_error_difference", "m^2", u.tracked & other.tracked & np.isfinite(square), square


def _verdict(found: Interval, quantity: str) -> list[str]:
    """Better or worse than the chosen filter, where the interval says so."""
    if not found.low * found.high > 0:
        return ["not-told-apart"]
    more_is_better = quantity.startswith("log_likelihood")
    return ["better"] if (found.value > 0) == more_is_better else ["worse"]
