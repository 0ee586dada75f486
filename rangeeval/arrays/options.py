"""How each method tracks: frozen settings with the values of the source, and what a track is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Method = Literal["joint-ml", "ryu", "modified"]
METHODS: dict[str, str] = {
    "joint-ml": "maximum likelihood of all bearings at once, block by block; any geometry (the default)",
    "ryu": "PAST subspace, closed-form innovation, a Kalman filter a target, as published; line arrays",
    "modified": "the same for any geometry, as published for cylinders",
}

# Bits of `Track.flags`, one set a sample and target.
MISSING = 1  # no usable snapshot: predicted only
COASTED = 2  # the measurement was left out or weakened next to another target
UNRESOLVED = 4  # nearer than a beam width to another target
UNMODELLED = 8  # the guard says that a source is not modelled
OUTSIDE = 16  # the bearing has left the array's sector
FADED = 32  # the target's power is below the noise in its beam: its bearing is held by its past
FLAG_NAMES: dict[int, str] = {
    MISSING: "missing",
    COASTED: "coasted",
    UNRESOLVED: "unresolved",
    UNMODELLED: "unmodelled-source",
    OUTSIDE: "outside-sector",
    FADED: "faded",
}


@dataclass(frozen=True)
class StartUncertainty:
    """Standard deviations of the bearings and rates the tracker starts from (rad, rad per snapshot)."""

    bearing_rad: float = math.radians(0.5)
    rate_rad: float = 1e-4


@dataclass(frozen=True)
class PastOptions:
    """Settings of `ryu` and `modified`; the defaults reproduce the papers' tables.

    Parameters
    ----------
    forgetting : beta of PAST; its window is on average beta / (1 - beta) snapshots old.
    process_variance : q, of the acceleration, (rad per snapshot^2)^2.
    measurement_variance : r, of the angular innovation, rad^2; only q / r matters to the bearings.
    lag_compensation : take the innovation where the target was at the mean age of the window.
    hard_coasting_rad : leave the innovation out while another target is predicted nearer than this.
    soft_coasting : kappa: the innovation's variance is at least kappa times the Cramer-Rao bound of the window.
    source_power : of every target at a sensor, for soft coasting; None: estimated from the snapshots.
    start : uncertainty of the start.
    """

    forgetting: float = 0.83
    process_variance: float = 1e-10
    measurement_variance: float = 1e-3
    lag_compensation: bool = False
    hard_coasting_rad: float | None = None
    soft_coasting: float | None = None
    source_power: float | None = None
    start: StartUncertainty = StartUncertainty()

    def __post_init__(self) -> None:
        if not 0 < self.forgetting < 1:
            raise ValueError(f"the forgetting factor is {self.forgetting}; give more than 0 and less than 1")
        _positive(self.measurement_variance, "the measurement variance")
        _not_negative(self.process_variance, "the process variance")


@dataclass(frozen=True)
class JointOptions:
    """Settings of `joint-ml`.

    Parameters
    ----------
    block : snapshots a step; block x the fastest rate should stay below a tenth of the beam.
    iterations : Gauss-Newton steps a block.
    process_variance : q, of the acceleration, (rad per snapshot^2)^2.
    largest_step_rad : of one bearing in one iteration.
    limit_together : when a bearing would go farther, shorten the step of the whole state instead of this bearing's.
    memory : snapshots over which powers and noise are smoothed.
    opening : snapshots in which powers and noise are first found, at the bearings of the start; at least a block.
    guard_window, guard_threshold : the alarm of an unmodelled source: largest eigenvalue of the whitened
        covariance of this many snapshots.
    start : uncertainty of the start.
    start_sample : the snapshot at which the start and its uncertainty hold, from 0; it may be between two, or outside.
    """

    block: int = 10
    iterations: int = 2
    process_variance: float = 1e-10
    largest_step_rad: float = math.radians(1.5)
    limit_together: bool = False
    memory: float = 50.0
    opening: int = 10
    guard_window: int = 60
    guard_threshold: float = 5.0
    start: StartUncertainty = StartUncertainty()
    start_sample: float = 0.0

    def __post_init__(self) -> None:
        for name, value in (
            ("block", self.block),
            ("iterations", self.iterations),
            ("opening", self.opening),
            ("guard window", self.guard_window),
        ):
            if value < 1:
                raise ValueError(f"the {name} is {value}; give 1 or more")
        _not_negative(self.process_variance, "the process variance")
        _positive(self.largest_step_rad, "the largest step")
        _positive(self.memory, "the memory of powers and noise")
        if not math.isfinite(self.start_sample):
            raise ValueError(f"the sample of the start is {self.start_sample}; give a number")


@dataclass(frozen=True, eq=False)
class Track:
    """Bearings of N targets at T samples; a leading axis of runs when the snapshots had one.

    Parameters
    ----------
    sample : (T,) the snapshot each row stands for, from 0; fractional (the middle) for a block.
    bearing_rad, bearing_sigma_rad : (T, N); sigma is the filter's own.
    rate_rad, rate_sigma_rad : (T, N), per snapshot.
    innovation_rad : (T, N) the correction of the prediction by this sample's data.
    power : (T, N) of each source at a sensor, mean over bins; NaN where the method has none (`ryu`, `modified`).
    noise : (T,) of a sensor, mean over bins; NaN likewise.
    guard : (T,) largest eigenvalue of the whitened covariance; NaN until the first window is full, or without guard.
    flags : (T, N) bits named in FLAG_NAMES.
    """

    method: str
    sample: Array
    bearing_rad: Array
    bearing_sigma_rad: Array
    rate_rad: Array
    rate_sigma_rad: Array
    innovation_rad: Array
    power: Array
    noise: Array
    guard: Array
    flags: NDArray[np.uint8]

    def at(self, sample: Array) -> Array:
        """Bearings (samples, N) at other snapshots, by each row's own rate: (..., samples, N)."""
        wanted = np.asarray(sample, dtype=np.float64)
        nearest = np.clip(np.searchsorted((self.sample[1:] + self.sample[:-1]) / 2, wanted), 0, self.sample.size - 1)
        ahead = (wanted - self.sample[nearest])[:, None]
        found: Array = self.bearing_rad[..., nearest, :] + ahead * self.rate_rad[..., nearest, :]
        return found


def flag_words(bits: int) -> str:
    """The names of the set bits, comma separated."""
    return ", ".join(name for bit, name in FLAG_NAMES.items() if bits & bit)


def _positive(value: float, name: str) -> None:
    if not value > 0:
        raise ValueError(f"{name} is {value}; give more than 0")


def _not_negative(value: float, name: str) -> None:
    if not value >= 0:
        raise ValueError(f"{name} is {value}; give 0 or more")
