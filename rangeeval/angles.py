"""Angles on the circle."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def wrapped(angle_rad: ArrayLike) -> NDArray[np.float64]:
    """The same angle in [-pi, pi)."""
    inside: NDArray[np.float64] = np.mod(np.asarray(angle_rad, dtype=np.float64) + np.pi, 2 * np.pi) - np.pi
    return inside
