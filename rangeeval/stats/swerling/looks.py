"""The nouns: looks at a target, windows of looks, and the Swerling cases."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rangeeval.stats.swerling.closed import DETECTION, MISS

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """A fluctuation model: the summed RCS of n pulses is gamma with this shape (times n if each pulse has its own).

    `free`: the shape was found from the looks themselves, which costs a parameter.
    """

    name: str
    shape: float
    per_pulse: bool = False
    free: bool = False

    def shapes(self, pulses: NDArray[np.int64]) -> Floats:
        """The shape K for each look of so many pulses."""
        return np.asarray(self.shape * (pulses if self.per_pulse else np.ones(len(pulses))), dtype=np.float64)


CASES: dict[str, Case] = {
    "0": Case("0", math.inf),
    "1": Case("1", 1.0),
    "2": Case("2", 1.0, per_pulse=True),
    "3": Case("3", 2.0),
    "4": Case("4", 2.0, per_pulse=True),
}


@dataclass(frozen=True)
class Looks:
    """Looks at one target, all arrays of equal length.

    `kind`: MISS, DETECTION, HIT (no amplitude) or SATURATED; `z`: power over mean noise power of a pulse, summed over
    the `pulses`, signal plus noise (0 where there is none); `threshold` in the same unit; `alpha`: mean SNR per pulse
    of 1 m^2. `cells`: the amplitude is the strongest of that many cells (1: the target's own).
    """

    kind: NDArray[np.int8]
    z: Floats
    threshold: Floats
    alpha: Floats
    pulses: NDArray[np.int64]
    cells: float = 1.0

    @classmethod
    def of(
        cls,
        z: ArrayLike,
        alpha: ArrayLike,
        threshold: ArrayLike,
        *,
        kind: ArrayLike | None = None,
        pulses: ArrayLike = 1,
        cells: float = 1.0,
    ) -> Looks:
        """Looks from plain sequences; a NaN in `z` is a miss unless `kind` says otherwise.

        Raises ValueError that names the first look (from 0) which cannot be: an amplitude below its threshold or
        missing on a detection, a threshold or alpha that is not above zero.
        """
        amplitude = np.atleast_1d(np.asarray(z, dtype=np.float64))
        size = len(amplitude)
        missing = np.isnan(amplitude)
        kinds = np.where(missing, MISS, DETECTION) if kind is None else np.asarray(kind)
        looks = cls(
            np.ascontiguousarray(np.broadcast_to(kinds, size), dtype=np.int8),
            np.where(missing, 0.0, amplitude),
            np.ascontiguousarray(np.broadcast_to(threshold, size), dtype=np.float64),
            np.ascontiguousarray(np.broadcast_to(alpha, size), dtype=np.float64),
            np.ascontiguousarray(np.broadcast_to(pulses, size), dtype=np.int64),
            float(cells),
        )
        detected = looks.kind == DETECTION
        for wrong, reason in (
            (detected & missing, "a detection has no amplitude"),
            (
                detected & ~missing & ~(looks.z >= looks.threshold),
                "the amplitude of a detection is below its threshold",
            ),
            (~(looks.threshold > 0), "the threshold is not above zero"),
            (~(looks.alpha > 0), "alpha is not above zero"),
        ):
            if wrong.any():
                raise ValueError(f"look {int(np.argmax(wrong))}: {reason}")
        return looks

    def __len__(self) -> int:
        return len(self.kind)

    @property
    def plain(self) -> bool:
        """Single pulses, each detected with its amplitude or missed, no false alarms mixed in."""
        return self.cells == 1.0 and bool((self.pulses == 1).all()) and bool((self.kind <= DETECTION).all())

    def take(self, rows: NDArray[np.int64] | NDArray[np.bool_] | slice) -> Looks:
        """The looks chosen by an index, a mask or a slice."""
        names = ("kind", "z", "threshold", "alpha", "pulses")
        kept: dict[str, Any] = {n: np.ascontiguousarray(getattr(self, n)[rows]) for n in names}
        return replace(self, **kept)

    def seen_as(self, z: Floats) -> Looks:
        """The same looks with other amplitudes: what is below the threshold is missed."""
        detected = z >= self.threshold
        kind = np.where(detected, np.where(self.kind == MISS, DETECTION, self.kind), MISS).astype(np.int8)
        return replace(self, kind=kind, z=np.where(detected, z, 0.0))


@dataclass(frozen=True)
class Windows:
    """Windows over looks: look `first[i]` up to but not including `last[i]`."""

    first: NDArray[np.int64]
    last: NDArray[np.int64]

    @classmethod
    def whole(cls, looks: Looks) -> Windows:
        """All looks in one window."""
        return cls(np.zeros(1, np.int64), np.array([len(looks)], np.int64))

    @classmethod
    def groups(cls, counts: ArrayLike) -> Windows:
        """Windows side by side of so many looks."""
        ends = np.cumsum(np.asarray(counts, dtype=np.int64))
        return cls(np.concatenate([[0], ends[:-1]]).astype(np.int64), ends)

    @classmethod
    def sliding(cls, size: int, length: int) -> Windows:
        """The windows of `length` looks that end at each look; none before the first is full."""
        last = np.arange(length, size + 1, dtype=np.int64)
        return cls(last - length, last)

    def __len__(self) -> int:
        return len(self.first)

    def take(self, rows: NDArray[np.int64] | NDArray[np.bool_]) -> Windows:
        """The windows chosen by an index or a mask."""
        return Windows(np.ascontiguousarray(self.first[rows]), np.ascontiguousarray(self.last[rows]))

    def reduce(self, of: np.ufunc, values: Floats) -> Floats:
        """`of` (np.add, np.maximum, ...) over the looks of each window, which may overlap; none is empty."""
        ends = np.stack([self.first, self.last], axis=1).reshape(-1)
        return np.asarray(of.reduceat(np.append(values, 0.0), ends)[::2])
