"""Results: the tidy table of estimates that every analysis ends in, with what is needed to draw and to trust it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rangeeval.errors import InputError
from rangeeval.model.table import Problem

if TYPE_CHECKING:
    import pandas as pd

SCHEMA = 1


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """One quantity in one bin, with its two-sided interval; NaN where it can't be had, with a flag that says why."""

    quantity: str
    unit: str
    value: float
    low: float = math.nan
    high: float = math.nan
    n: int = 0
    n_eff: float = math.nan
    variable: str | None = None
    bin_low: float = math.nan
    bin_high: float = math.nan
    track_id: str | None = None
    group: str | None = None
    flags: tuple[str, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict)

    def as_row(self) -> dict[str, Any]:
        """The columns of the contract, in its order; further columns (`verdict`, ...) last."""
        return {
            "track_id": self.track_id,
            "group": self.group,
            "variable": self.variable,
            "bin_low": self.bin_low,
            "bin_high": self.bin_high,
            "quantity": self.quantity,
            "unit": self.unit,
            "n": self.n,
            "n_eff": self.n_eff,
            "value": self.value,
            "low": self.low,
            "high": self.high,
            "flags": list(self.flags),
            **self.extra,
        }


COLUMNS = tuple(Estimate(quantity="", unit="", value=0.0).as_row())

Series = Mapping[str, Sequence[float] | Sequence[str]]


def without_nan(value: Any) -> Any:
    """The same value as JSON may hold it: NaN and infinities become null, numpy numbers plain ones."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(k): without_nan(v) for k, v in value.items()}
    if isinstance(value, str) or value is None or isinstance(value, (int, bool)):
        return value
    if hasattr(value, "tolist"):
        return without_nan(value.tolist())
    if isinstance(value, Iterable):
        return [without_nan(v) for v in value]
    raise TypeError(f"cannot store {type(value).__name__} in JSON")


@dataclass(frozen=True)
class Result:
    """What an analysis found: the estimates, and all that is needed to draw, explain and repeat them.

    `series`: small named tables already reduced for plotting. `settings`: every choice made, defaults included.
    `provenance`: versions and inputs.
    """

    analysis: str
    rows: tuple[Estimate, ...]
    settings: Mapping[str, Any] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()
    series: Mapping[str, Series] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def estimates(self) -> pd.DataFrame:
        """The tidy table as a pandas DataFrame; `flags` holds words separated by spaces."""
        import pandas as pd

        records = [r.as_row() | {"flags": " ".join(r.flags)} for r in self.rows]
        return pd.DataFrame.from_records(records, columns=None if records else list(COLUMNS))

    def as_dict(self, *, series: bool = False) -> dict[str, Any]:
        """The contract's JSON object as plain Python values; with `series`, also what the figures need."""
        return {
            "schema": SCHEMA,
            "analysis": self.analysis,
            "settings": without_nan(self.settings),
            "estimates": [without_nan(r.as_row()) for r in self.rows],
            "problems": [p.as_dict() for p in self.problems],
            "provenance": without_nan(self.provenance),
        } | ({"series": without_nan(self.series)} if series else {})

    def to_json(self, *, series: bool = False) -> str:
        """The result as JSON text: NaN is null, numbers keep full precision."""
        return json.dumps(self.as_dict(series=series), allow_nan=False, ensure_ascii=False, indent=1)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], where: str = "results.json") -> Result:
        """A result back from its JSON object. Raises InputError when it is of another schema or not a result."""
        try:
            if data["schema"] != SCHEMA:
                raise InputError(f"{where}: results of schema {data['schema']}, this version reads {SCHEMA}")
            rows = tuple(_estimate(r) for r in data["estimates"])
            problems = tuple(
                Problem(p["where"], p["reason"], p["count"], tuple(p["examples"]), p["rejected"])
                for p in data["problems"]
            )
            return cls(data["analysis"], rows, data["settings"], problems, data.get("series", {}), data["provenance"])
        except (KeyError, TypeError, AttributeError) as error:
            raise InputError(f"{where}: not a rangeeval result ({error})") from error

    def plot(self, quantity: str | None = None) -> Any:
        """Draw one quantity (by default the first) against its bins with its intervals: a matplotlib Figure."""
        # The one upward import: drawing is the report's work, and users ask a result for its picture.
        from rangeeval.reporting.quick import plot_result

        return plot_result(self, quantity)


_FLOATS = ("n_eff", "value", "low", "high", "bin_low", "bin_high")


def _estimate(row: Mapping[str, Any]) -> Estimate:
    known = {k: row[k] for k in COLUMNS}
    for name in _FLOATS:
        known[name] = math.nan if known[name] is None else float(known[name])
    known["flags"] = tuple(known["flags"])
    return Estimate(**known, extra={k: v for k, v in row.items() if k not in COLUMNS})
