"""Bins: half-open intervals [low, high) of one variable."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rangeeval.model.settings import BinSettings

OUTSIDE = -1
MAX_BINS = 100_000  # a bin number beyond this is a frame or unit error in the log, not a bin


@dataclass(frozen=True)
class Bins:
    """Half-open bins of one variable in its stored unit.

    Bin i is [start + i width, start + (i + 1) width), or with `ratio` [start ratio^i, start ratio^(i + 1)): bins of
    constant SNR span under the R^-4 law. A value below `start`, missing, or beyond `MAX_BINS` bins is in no bin.
    """

    variable: str = "range"
    width: float = 5000.0
    start: float = 0.0
    min_samples: int = 30
    ratio: float | None = None

    @classmethod
    def of(cls, settings: BinSettings) -> Bins:
        """The bins that `trial.toml` asks for."""
        ratio = None if settings.snr_span_db is None else 10 ** (settings.snr_span_db / 40)
        width = 5000.0 if settings.width is None else settings.width
        return cls(settings.variable, width, settings.start, settings.min_samples, ratio)

    def index(self, values: NDArray[np.float64]) -> NDArray[np.int32]:
        """The bin of each value, `OUTSIDE` for those in none."""
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            if self.ratio is None:
                position = np.floor((values - self.start) / self.width)
            else:
                position = np.floor(np.log(values / self.start) / math.log(self.ratio))
            inside = (position >= 0) & (position < MAX_BINS)
        return np.where(inside, position, OUTSIDE).astype(np.int32)

    def edges(self, i: int) -> tuple[float, float]:
        """Low and high edge of bin i."""
        if self.ratio is None:
            return self.start + i * self.width, self.start + (i + 1) * self.width
        return self.start * self.ratio**i, self.start * self.ratio ** (i + 1)
