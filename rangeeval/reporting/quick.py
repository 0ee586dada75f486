"""One quantity of a result as a matplotlib figure: what `Result.plot()` draws, for notebooks and quick looks."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rangeeval.errors import InputError, did_you_mean
from rangeeval.model import Result
from rangeeval.reporting.tables import headline_quantities, pooled
from rangeeval.reporting.wording import quantity_name
from rangeeval.units import shown, shown_variable

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_result(result: Result, quantity: str | None = None) -> Figure:
    """Draw one quantity (by default the result's first headline) against its bins, with intervals.

    Raises InputError, naming the nearest one, when the result has no such quantity in any bin.
    """
    from matplotlib.figure import Figure

    binned = [r for r in pooled(result) if math.isfinite(r.bin_low)]
    known = {r.quantity for r in binned}
    wanted = quantity or next((q for q in headline_quantities(result) if q in known), "")
    rows = [r for r in binned if r.quantity == wanted and math.isfinite(r.value)]
    if not rows:
        raise InputError(
            f"nothing to plot of '{wanted}'; {did_you_mean(wanted, known)}" if known else "nothing to plot"
        )
    unit, across = shown(rows[0].unit, wanted), shown_variable(rows[0].variable or "")
    centre = [0.5 * (r.bin_low + r.bin_high) * across.scale for r in rows]
    value = [unit.value(r.value) for r in rows]
    below = [max(v - unit.value(r.low), 0.0) if math.isfinite(r.low) else 0.0 for v, r in zip(value, rows, strict=True)]
    above = [
        max(unit.value(r.high) - v, 0.0) if math.isfinite(r.high) else 0.0 for v, r in zip(value, rows, strict=True)
    ]
    figure = Figure(figsize=(8, 4.5), layout="constrained")
    axes = figure.subplots()
    axes.errorbar(centre, value, yerr=[below, above], fmt="o", capsize=2)
    axes.set_xlabel(f"{rows[0].variable} ({across.unit})".removesuffix(" ()"), parse_math=False)
    axes.set_ylabel(f"{quantity_name(wanted)} ({unit.unit})".removesuffix(" ()"), parse_math=False)
    axes.set_ylim(bottom=min(0.0, *value))
    axes.grid(alpha=0.3)
    return figure
