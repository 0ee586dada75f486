"""Bins: half-open intervals [low, high) of one variable."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import SettingsError
from rangeeval.model.settings import VARIABLES, BinSettings, settings_from

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


@dataclass(frozen=True)
class BinChoice:
    """What a user asks of the bins, whichever trial it is; None leaves the trial's own setting."""

    variable: str | None = None
    width: float | None = None
    start: float | None = None
    snr_span_db: float | None = None

    def of(self, settings: BinSettings) -> Bins:
        """The trial's bins with what is asked. Raises SettingsError for what does not go together."""
        own = {k: v for k, v in dataclasses.asdict(settings).items() if v is not None}
        if self.variable in VARIABLES and self.variable != own["variable"]:
            # The trial's own width and start are of another unit.
            if self.width is None and self.snr_span_db is None:
                raise SettingsError(
                    f"--bins {self.variable} needs --bin-width: the trial's own is for {own['variable']}"
                )
            own = {"min_samples": own["min_samples"]}
        asked = {k: v for k, v in dataclasses.asdict(self).items() if v is not None}
        return Bins.of(settings_from({"bins": {**own, **asked}}, "options").bins)
