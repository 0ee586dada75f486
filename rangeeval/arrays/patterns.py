"""What one element of an array hears over the angle from where it faces."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

Kind = Literal["omnidirectional", "cosine", "baffle", "table"]
KINDS: tuple[Kind, ...] = ("omnidirectional", "cosine", "baffle", "table")


@dataclass(frozen=True, eq=False)
class ElementPattern:
    """Gain of one element at an angle from its facing; make one with the functions below.

    Parameters
    ----------
    kind : the formula, or a table.
    exponent, back : see `cosine` and `baffle`.
    gains : (1 or sensors, angles) complex, evenly over a circle from the facing on, for a table.
    """

    kind: Kind = "omnidirectional"
    exponent: float = 1.0
    back: float = 0.0
    gains: NDArray[np.complex128] | None = None

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"the element pattern is {self.kind!r}; known: {', '.join(KINDS)}")
        if not self.exponent >= 1:
            raise ValueError(f"the exponent of the element pattern is {self.exponent}; give 1 or more")
        if not 0 <= self.back < 1:
            raise ValueError(f"the gain behind the element is {self.back}; give 0 or more and less than 1")
        if (self.kind == "table") != (self.gains is not None):
            raise ValueError("a table of gains goes with the pattern 'table', and only with it")


OMNIDIRECTIONAL = ElementPattern()


def cosine(exponent: float = 1.0) -> ElementPattern:
    """A face that hears cos^exponent in front of it and nothing behind."""
    return ElementPattern("cosine", exponent)


def baffle(back: float = 0.1, exponent: float = 1.0) -> ElementPattern:
    """A smooth lobe ((1 + cos) / 2)^exponent over a floor: gain 1 in front and `back` behind."""
    return ElementPattern("baffle", exponent, back)


def cardioid() -> ElementPattern:
    """(1 + cos) / 2: gain 1 in front, none behind."""
    return baffle(0.0)


def table(gains: ArrayLike) -> ElementPattern:
    """Measured complex gains evenly over a full circle from the facing on, (angles,) or (sensors, angles).

    Between the angles a cubic that keeps value and slope continuous.
    """
    values = np.atleast_2d(np.array(gains, dtype=np.complex128))
    if values.ndim != 2 or values.shape[1] < 8 or not np.isfinite(values).all():
        raise ValueError(f"the table of gains has shape {values.shape}; give 8 or more finite gains over the circle")
    values.setflags(write=False)
    return ElementPattern("table", gains=values)
