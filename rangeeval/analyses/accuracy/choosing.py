"""Which samples count and where: limits on columns, the bin of a row, and its group."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import SettingsError, did_you_mean
from rangeeval.model import Bins, Table
from rangeeval.model.kinds import RESIDUALS
from rangeeval.units import spellings

Array = NDArray[np.float64]

_VARIABLE_COLUMN = {"range": "range_predicted_m", "snr": "snr_db", "time": "time_s"}
_LEGS = ("inbound", "leg unknown", "outbound")


@dataclass(frozen=True)
class Limit:
    """Samples count only where a column lies within [low, high], in stored units."""

    column: str
    low: float
    high: float

    def holds(self, table: Table) -> NDArray[np.bool_]:
        """Whether each row is within it; a missing value is not."""
        values = table.floats(self.column)
        return np.asarray((values >= self.low) & (values <= self.high))


def limits_of(when: Mapping[str, float]) -> list[Limit]:
    """The limits that `when` sets, any unit its column may be written in converted.

    Raises SettingsError for a column a residual log cannot have.
    """
    known = {
        spelling: (column.name, unit)
        for column in RESIDUALS.columns
        if not column.text
        for spelling, unit in spellings(column.name, column.unit).items()
    }
    limits = []
    for key, value in when.items():
        name, _, end = key.rpartition("_")
        if end not in {"min", "max"}:
            raise SettingsError(f"when: '{key}' ends neither in _min nor in _max")
        if name not in known:
            raise SettingsError(f"when: no column '{name}'; {did_you_mean(name, known)}")
        column, unit = known[name]
        stored = float(unit.to_si(np.array([float(value)]))[0])
        limits.append(Limit(column, stored, math.inf) if end == "min" else Limit(column, -math.inf, stored))
    return limits


def bin_variable(table: Table, bins: Bins) -> Array:
    """The values that decide the bin of each row, from the predictions."""
    if bins.variable in _VARIABLE_COLUMN:
        return table.floats(_VARIABLE_COLUMN[bins.variable])
    cross = "y_predicted_m" if bins.variable == "elevation" else "z_predicted_m"
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.arcsin(table.floats(cross) / table.floats("range_predicted_m")))


@dataclass(frozen=True)
class _Factor:
    """One thing that tells groups apart: a code for each row, and the text of each code."""

    codes: NDArray[np.int64]
    texts: tuple[str, ...]


@dataclass(frozen=True)
class Key:
    """What a group's samples have in common; empty where that does not tell groups apart."""

    track: str = ""
    leg: str = ""
    waveform: str = ""
    attenuation: str = ""


@dataclass
class Groups:
    """Numbers the groups in the order they are met: by leg, waveform and attenuator state, and by track when asked."""

    grouped: bool
    per_track: bool
    _numbers: dict[Key, int] = field(default_factory=dict)

    @property
    def keys(self) -> list[Key]:
        """The key of each group, by its number."""
        return list(self._numbers)

    def number(self, table: Table, leg: NDArray[np.int8]) -> NDArray[np.int32]:
        """The group of each row."""
        factors = self._factors(table, leg)
        if not factors or not len(table):
            return np.full(len(table), self._numbers.setdefault(Key(), len(self._numbers)), np.int32)
        sizes = [len(f.texts) for f in factors.values()]
        code = np.ravel_multi_index([f.codes for f in factors.values()], sizes)
        of_code = np.zeros(math.prod(sizes), np.int32)
        for present in np.flatnonzero(np.bincount(code)):
            places = np.unravel_index(present, sizes)
            key = Key(**{n: f.texts[int(i)] for (n, f), i in zip(factors.items(), places, strict=True)})
            of_code[present] = self._numbers.setdefault(key, len(self._numbers))
        return of_code[code]

    def _factors(self, table: Table, leg: NDArray[np.int8]) -> dict[str, _Factor]:
        factors: dict[str, _Factor] = {}
        if self.per_track and "track_id" in table:
            factors["track"] = _text_factor(table, "track_id")
        if not self.grouped:
            return factors
        factors["leg"] = _Factor(leg.astype(np.int64) + 1, _LEGS)
        if "waveform" in table:
            factors["waveform"] = _text_factor(table, "waveform")
        if "attenuation_db" in table:
            values, codes = np.unique(table.floats("attenuation_db"), return_inverse=True)
            texts = tuple(f"{v:g} dB" if math.isfinite(v) else "missing" for v in values)
            factors["attenuation"] = _Factor(codes.astype(np.int64), texts)
        return factors

    def names(self) -> list[str]:
        """A name for each group, made of what tells it from others: `inbound, waveform LONG, attenuation 10 dB`."""
        keys = self.keys
        legs, waveforms, states = ({getattr(k, n) for k in keys} for n in ("leg", "waveform", "attenuation"))
        names = []
        for k in keys:
            parts = [k.leg] if len(legs) > 1 else []
            parts += [f"waveform {k.waveform}"] if len(waveforms) > 1 else []
            parts += [f"attenuation {k.attenuation}"] if len(states) > 1 else []
            names.append(", ".join(parts))
        return names


def _text_factor(table: Table, name: str) -> _Factor:
    return _Factor(table.codes(name).astype(np.int64) + 1, ("missing", *table.labels.get(name, ())))
