"""Every update of every track in one set of arrays, and the variable it is binned by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.replay.gathering import Track
from rangeeval.errors import SettingsError
from rangeeval.model import Bins
from rangeeval.tracking.measurements import azimuth_to_log
from rangeeval.tracking.runs import Flag, Run

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class Updates:
    """All rows of all runs (n), tracks one after the other; `track` numbers them.

    `whitened` (n, 3): innovation over its own sigma, component by component.
    """

    track: Ints
    time_s: Floats
    innovation: Floats
    sigma: Floats
    nis: Floats
    dof: Ints
    log_likelihood: Floats
    state: Floats
    covariance: Floats
    predicted_state: Floats
    range_m: Floats
    azimuth_rad: Floats
    elevation_rad: Floats
    snr_db: Floats
    flags: Ints

    @property
    def used(self) -> BoolArray:
        """The updates that entered the likelihood."""
        return np.greater(self.dof, 0)

    @property
    def tracked(self) -> BoolArray:
        """The rows at which a track went on: with a prediction, whether or not the plot was used."""
        return np.isfinite(self.predicted_state[:, 0])

    @property
    def whitened(self) -> Floats:
        """Innovations over their own sigma."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.innovation / self.sigma

    def having(self, flag: Flag) -> BoolArray:
        """Rows at which something happened."""
        found: BoolArray = (self.flags & int(flag)) != 0
        return found

    def variable(self, bins: Bins) -> Floats:
        """What rows are binned by. Raises SettingsError for a variable that plots do not have."""
        columns = {
            "range": self.range_m, "azimuth": self.azimuth_rad, "elevation": self.elevation_rad, "time": self.time_s,
            "snr": self.snr_db,
        }  # fmt: skip
        if bins.variable not in columns:
            raise SettingsError(
                f"bins.variable '{bins.variable}' is not known of plots; use range, azimuth, elevation, time or snr"
            )
        return columns[bins.variable]


def pooled(tracks: Sequence[Track], runs: Sequence[Run]) -> Updates:
    """The rows of all runs together."""

    def joined(parts: Sequence[NDArray[Any]], shape: tuple[int, ...] = ()) -> NDArray[Any]:
        return np.concatenate(parts) if parts else np.empty((0, *shape))

    spread = []
    for run in runs:
        diagonal = np.diagonal(run.innovation_covariance, axis1=1, axis2=2)
        with np.errstate(invalid="ignore"):
            spread.append(np.sqrt(diagonal))
    number = [np.full(len(t.plots), i, np.int64) for i, t in enumerate(tracks)]
    z = [r.measurements.z for r in runs]
    return Updates(
        track=joined(number).astype(np.int64),
        time_s=joined([r.measurements.time_s for r in runs]),
        innovation=joined([r.innovation for r in runs], (3,)),
        sigma=joined(spread, (3,)),
        nis=joined([r.nis for r in runs]),
        dof=joined([r.nis_dof for r in runs]).astype(np.int64),
        log_likelihood=joined([r.log_likelihood for r in runs]),
        state=joined([r.state for r in runs], (6,)),
        covariance=joined([r.covariance for r in runs], (6, 6)),
        predicted_state=joined([r.predicted_state for r in runs], (6,)),
        range_m=joined([p[:, 0] for p in z]),
        azimuth_rad=azimuth_to_log(joined([p[:, 1] for p in z])),
        elevation_rad=joined([p[:, 2] for p in z]),
        snr_db=joined([t.plots.snr_db for t in tracks]),
        flags=joined([r.flags for r in runs]).astype(np.int64),
    )
