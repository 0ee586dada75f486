"""The estimates: each target's track, the array and its sources, and with truth the errors with their bounds."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from rangeeval.analyses.bearing.blocks import Counts
from rangeeval.analyses.bearing.frame import Frame
from rangeeval.analyses.bearing.recording import Recording
from rangeeval.analyses.bearing.tracking import Tracked
from rangeeval.analyses.bearing.truth import Judged
from rangeeval.arrays import options as arrays
from rangeeval.arrays.bounds import beam_width
from rangeeval.arrays.health import Ambiguity
from rangeeval.model import Bins, Estimate
from rangeeval.model.bins import OUTSIDE
from rangeeval.stats.correlation import effective_samples_of
from rangeeval.stats.intervals import sigma_interval

Floats = NDArray[np.float64]

_OFTEN = 0.05  # share of a target's updates from which a flag of the tracker is one of the target


@dataclass(frozen=True)
class Writer:
    """The rows of one analysis: the recording, the tracks with their names, the frame bearings are shown in."""

    recording: Recording
    tracked: Tracked
    names: tuple[str, ...]
    frame: Frame
    confidence: float
    flags: tuple[str, ...]

    @property
    def z(self) -> float:
        """Standard deviations of a normal interval."""
        return float(ndtri(0.5 + self.confidence / 2))

    def target_flags(self, n: int) -> tuple[str, ...]:
        """What the tracker said of a target, where often."""
        bits = self.tracked.bits[:, n]
        mine = [name for bit, name in arrays.FLAG_NAMES.items() if np.mean((bits & bit) > 0) > _OFTEN]
        return tuple(dict.fromkeys((*self.flags, *self.tracked.flags, *mine)))

    def tracks(self) -> Iterator[Estimate]:
        """Of each target: its first and last bearing, mean sigma, updates, SNR, and the share of time it was seen."""
        for n, name in enumerate(self.names):
            t = self.tracked
            seen = np.flatnonzero(np.isfinite(t.bearing_rad[:, n]))
            flags = self.target_flags(n)
            missing = (t.bits[:, n] & (arrays.MISSING | arrays.FADED)) > 0
            for quantity, places in (("bearing_first", seen[:1]), ("bearing_last", seen[-1:])):
                yield self._bearing(quantity, name, n, int(places[0]) if len(places) else None, flags)
            sigma = t.sigma_rad[seen, n]
            rms = float(np.sqrt(np.nanmean(sigma**2))) if np.isfinite(sigma).any() else math.nan
            yield Estimate(quantity="bearing_sigma", unit="rad", value=rms, n=len(seen), track_id=name, flags=flags)
            yield Estimate(
                quantity="updates", unit="1", value=float(np.count_nonzero(~missing)), n=len(missing), track_id=name
            )
            yield Estimate(quantity="coverage", unit="1", value=float(np.mean(~missing)), n=len(missing), track_id=name)
            power = t.power[:, n] / t.noise
            if np.isfinite(power).any():
                mean = float(np.nanmean(power))
                db = 10 * math.log10(mean) if mean > 0 else math.nan
                yield Estimate(quantity="snr", unit="dB", value=db, n=len(seen), track_id=name, flags=flags)

    def _bearing(
        self, quantity: str, name: str, n: int, at: int | None, flags: tuple[str, ...], **place: float | str
    ) -> Estimate:
        if at is None:
            return Estimate(quantity=quantity, unit="rad", value=math.nan, track_id=name, flags=flags, **place)  # type: ignore[arg-type]
        value = float(self.frame.shown(self.tracked.bearing_rad[at, n]))
        half = self.z * float(self.tracked.sigma_rad[at, n])
        return Estimate(
            quantity=quantity, unit="rad", value=value, low=value - half, high=value + half, n=1, track_id=name,
            flags=flags, **place,  # type: ignore[arg-type]
        )  # fmt: skip

    def over_time(self, bins: Bins) -> Iterator[Estimate]:
        """Of each target in each bin of time: the bearing at the update nearest to its middle."""
        time = np.interp(self.tracked.sample, np.arange(len(self.recording.time_s)), self.recording.time_s)
        index = bins.index(time)
        for i in np.unique(index[index != OUTSIDE]).tolist():
            low, high = bins.edges(i)
            for n, name in enumerate(self.names):
                mine = np.flatnonzero((index == i) & np.isfinite(self.tracked.bearing_rad[:, n]))
                if not len(mine):
                    continue
                at = int(mine[np.argmin(np.abs(time[mine] - 0.5 * (low + high)))])
                bits = int(self.tracked.bits[at, n])
                flags = (*self.flags, *self.tracked.flags, *(w for b, w in arrays.FLAG_NAMES.items() if bits & b))
                yield self._bearing("bearing", name, n, at, flags, variable="time", bin_low=low, bin_high=high)

    def judged(self, judged: Judged) -> Iterator[Estimate]:
        """Errors against truth: pooled first, then near crossings and far from them, then of each target."""
        everywhere = np.ones(judged.near.shape, bool)
        for group, chosen in ((None, everywhere), ("near", judged.near), ("far", ~judged.near)):
            yield from self._errors(judged, chosen, group, None)
        for state in ("held", "swapped", "lost"):
            count = sum(e == state for e in judged.each)
            yield Estimate(quantity=f"targets_{state}", unit="1", value=float(count), n=len(judged.each))
        for n, name in enumerate(judged.names):
            mine = np.zeros(judged.near.shape, bool)
            mine[:, n] = True
            flags = () if judged.each[n] == "held" else (judged.each[n],)
            yield from self._errors(judged, mine, None, name, flags)

    def _errors(
        self, judged: Judged, chosen: NDArray[np.bool_], group: str | None, name: str | None,
        flags: tuple[str, ...] = (),
    ) -> Iterator[Estimate]:  # fmt: skip
        error = np.where(chosen, judged.error_rad, np.nan)
        there = np.isfinite(error)
        n = int(np.count_nonzero(there))
        mark = {"group": group, "track_id": name}
        if not n:
            return
        rms = float(np.sqrt(np.nanmean(error**2)))
        # Errors of one target last as long as its filter remembers; those of different targets are their own.
        each = [effective_samples_of(column) for column in error.T if np.count_nonzero(np.isfinite(column)) > 3]
        n_eff = float(np.nansum(each)) if each else math.nan
        low, high = (float(v) for v in sigma_interval(rms, n_eff, self.confidence))
        flags = (*self.flags, *flags)
        yield Estimate(
            quantity="bearing_rms", unit="rad", value=rms, low=low, high=high, n=n, n_eff=n_eff, flags=flags,
            group=group, track_id=name,
        )  # fmt: skip
        bias = float(np.nanmean(error))
        spread = float(np.nanstd(error)) / math.sqrt(max(n_eff, 1.0)) if math.isfinite(n_eff) else math.nan
        yield Estimate(
            quantity="bearing_bias", unit="rad", value=bias, low=bias - self.z * spread, high=bias + self.z * spread,
            n=n, n_eff=n_eff, group=group, track_id=name,
        )  # fmt: skip
        for quantity, bound in (
            ("bearing_bound", judged.bound_rad), ("bearing_bound_straight", judged.straight_bound_rad),
        ):  # fmt: skip
            both = there & np.isfinite(bound)
            if both.any():
                value = float(np.sqrt(np.mean(bound[both] ** 2)))
                yield Estimate(quantity=quantity, unit="rad", value=value, n=int(both.sum()), **mark)  # type: ignore[arg-type]

    def whole(self, counted: Counts, ambiguity: Ambiguity) -> Iterator[Estimate]:
        """Of the array and all that it heard."""
        t = self.tracked
        yield from array_rows(self.recording, counted, ambiguity, self.flags)
        alarms = t.guard > t.guard_threshold
        if np.isfinite(t.guard).any():
            usable = int(np.count_nonzero(np.isfinite(t.guard)))
            flags = ("unmodelled-source",) if alarms.any() else ()
            yield Estimate(
                quantity="guard_alarms", unit="1", value=float(np.count_nonzero(alarms)), n=usable, flags=flags
            )
        if np.isfinite(t.coherence).any():
            yield Estimate(
                quantity="coherence", unit="1", value=float(np.nanmedian(t.coherence)),
                n=int(np.count_nonzero(np.isfinite(t.coherence))),
            )  # fmt: skip


def array_rows(
    recording: Recording, counted: Counts, ambiguity: Ambiguity, flags: tuple[str, ...]
) -> Iterator[Estimate]:
    """Beam width, the worst ambiguity, the number of sources by each criterion, and the share of usable snapshots."""
    usable = recording.usable
    yield Estimate(quantity="beam_width", unit="rad", value=beam_width(recording.geometry), flags=flags)
    yield Estimate(
        quantity="ambiguity_level", unit="dB", value=ambiguity.level_db,
        flags=("aliased",) if ambiguity.aliased else (),
    )  # fmt: skip
    for name, values in (("sources_mdl", counted.mdl), ("sources_aic", counted.aic)):
        if len(values):
            low, middle, high = np.quantile(values, (0.025, 0.5, 0.975), method="nearest").tolist()
            yield Estimate(
                quantity=name, unit="1", value=float(middle), low=float(low), high=float(high), n=len(values)
            )
    yield Estimate(quantity="snapshots_usable", unit="1", value=float(np.mean(usable)), n=len(usable))


__all__ = ["Writer", "array_rows"]
