"""Time series to snapshots of frequency bins, each narrow band."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class BinSnapshots:
    """Complex snapshots (K, bins, M), the sample at the middle of each, and the bins' frequencies."""

    snapshots: NDArray[np.complex128]
    centre_sample: NDArray[np.float64]
    frequency_hz: NDArray[np.float64]


def bin_snapshots(
    signals: NDArray[np.float64], sample_rate_hz: float, length: int, *, band_hz: tuple[float, float],
    overlap: float = 0.5,
) -> BinSnapshots:  # fmt: skip
    """Windowed Fourier transforms of (samples, M) real signals: a bin's phase convention is this room's (ahead = +)."""
    raise NotImplementedError
