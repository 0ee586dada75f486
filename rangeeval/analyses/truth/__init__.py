"""Truth: errors of plots against surveyed positions, bin by bin, and the offset between the two clocks."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.truth.errors import COORDINATES, OVERHEAD, Errors, Offset, errors_of, time_offset
from rangeeval.errors import InputError, SettingsError
from rangeeval.model import Bins, Estimate, Problem, Result, Trial, as_trial, gather
from rangeeval.model.pairing import Pair, paired
from rangeeval.model.paths import true_paths
from rangeeval.model.plots import plots_of
from rangeeval.model.result import Series
from rangeeval.stats.diagnostics import mad_sigma
from rangeeval.stats.mean_square import Interval, mean, rms, sigma
from rangeeval.stats.reduce import thin

Floats = NDArray[np.float64]
UNITS = {"range": "m", "azimuth": "rad", "elevation": "rad"}


def truth(
    trial: Trial | Any,
    bins: Bins | None = None,
    *,
    confidence: float = 0.95,
    per_track: bool = False,
    remove_offset: bool = False,
    progress: Callable[[int], None] | None = None,
) -> Result:
    """Bias, sigma and root mean square of range, azimuth and elevation of plots against truth, in each bin.

    Truth is interpolated to the time of every plot (cubic, nothing in gaps). Errors are those of the plots as they
    stand; with `remove_offset`, or `[truth] time_offset_s`, against the truth so much later.

    Parameters
    ----------
    trial : holds a `plots` and a `truth` log (CONTRACT section 3), or plain tables of them.
    bins : of true range, azimuth or elevation, of time or of SNR; by default those of the trial's settings.
    confidence : of the two-sided intervals, which count the memory of the errors.
    per_track : also rows for each target.
    remove_offset : compare with the truth moved by the time offset that the plots themselves show.
    progress : called with the number of rows read.

    Raises
    ------
    InputError : no plots or no truth, no target in common, no time in common.
    """
    trial = as_trial(trial)
    bins = bins or Bins.of(trial.settings.bins)
    if not 0.0 < confidence < 1.0:
        raise SettingsError(f"confidence is {confidence:g}, expected more than 0 and less than 1")
    own = trial.settings.truth
    log = plots_of(trial, progress)
    trial.log("truth") if not trial.of_kind("truth") else None
    paths, problems = true_paths(trial, own.max_gap_s)
    pairs, more = paired(log, paths, own.gate_m)
    if not pairs:
        raise InputError(
            f"{trial.name}: no target of its plots has a true path (plots: {_names([p.target for p in log.targets])}; "
            f"truth: {_names(list(paths))}); give both the same target_id, or [truth] gate_m to match by distance"
        )
    offset = time_offset(pairs, confidence)
    applied = own.time_offset_s
    if remove_offset and math.isfinite(offset.estimate.value):
        applied = offset.estimate.value
    errors = errors_of(pairs, applied)
    known = np.isfinite(errors.error[:, 0])
    if not known.any():
        a, b = (min(float(p.plots.time_s[0]) for p in pairs), max(float(p.plots.time_s[-1]) for p in pairs))
        c, d = (min(float(p.path.time_s[0]) for p in pairs), max(float(p.path.time_s[-1]) for p in pairs))
        raise InputError(
            f"{trial.name}: no plot falls on a true path: plots from {a:.6g} to {b:.6g} s, truth from {c:.6g} to "
            f"{d:.6g} s; bring both to one clock ([truth] time_offset_s), or allow longer gaps ([truth] max_gap_s)"
        )
    said = [*log.problems, *problems, *more]
    if lost := int(np.count_nonzero(~known)):
        said.append(Problem(log.source, "no truth at these times (gap, or outside the truth log): not compared", lost))
    errors = errors.take(known)
    rows = _rows(errors, bins, confidence, per_track)
    rows += _offset_rows(pairs, offset, confidence, per_track)
    return Result(
        "truth",
        tuple(rows),
        settings={
            "confidence": confidence,
            "variable": bins.variable,
            "bin_width": bins.width,
            "bin_start": bins.start,
            "bin_ratio": bins.ratio,
            "min_samples": bins.min_samples,
            "time_offset_applied": applied,
            "interpolation": "cubic between neighbours, none in gaps",
            "max_gap": {p.target or "only target": p.max_gap_s for p in paths.values()},
            "counts": {**log.counts, "compared": len(errors.time_s), "without_truth": lost},
        },
        problems=gather(said),
        series=_series(errors),
    )


def _names(names: list[str]) -> str:
    from rangeeval.errors import one_line

    return ", ".join(one_line(n, 30) or "unnamed" for n in names[:4]) + (", ..." if len(names) > 4 else "") or "none"


def _variable(errors: Errors, bins: Bins) -> Floats:
    columns = {
        "range": errors.true[:, 0], "azimuth": errors.true[:, 1], "elevation": errors.true[:, 2],
        "time": errors.time_s, "snr": errors.snr_db,
    }  # fmt: skip
    if bins.variable not in columns:
        raise SettingsError(
            f"bins.variable '{bins.variable}' is not known of plots; use range, azimuth, elevation, time or snr"
        )
    return columns[bins.variable]


def _rows(errors: Errors, bins: Bins, confidence: float, per_track: bool) -> list[Estimate]:
    """For each coordinate and bin, the whole trial first: bias, sigma and root mean square."""
    place = bins.index(_variable(errors, bins))
    everything = np.ones(len(place), bool)
    stretch = _stretches(errors)
    rows: list[Estimate] = []
    for k, name in enumerate(COORDINATES):
        if not np.isfinite(errors.error[:, k]).any():
            continue
        for b in (None, *np.unique(place[place >= 0]).tolist()):
            inside = everything if b is None else place == b
            rows += _in_bin(errors, k, name, inside, stretch, bins, b, confidence, None)
            if per_track:
                for number in np.unique(errors.target[inside]).tolist():
                    mine = inside & (errors.target == number)
                    rows += _in_bin(errors, k, name, mine, stretch, bins, b, confidence, errors.names[number] or None)
    return rows


def _stretches(errors: Errors) -> NDArray[np.int64]:
    """Runs of plots of one target without a long gap: correlation is counted inside them."""
    step = np.diff(errors.time_s, prepend=errors.time_s[:1])
    usual = float(np.median(step[step > 0])) if (step > 0).any() else 0.0
    new = (np.diff(errors.target, prepend=errors.target[:1]) != 0) | (step > 10.0 * usual)
    return np.cumsum(new)


def _in_bin(
    errors: Errors, k: int, name: str, inside: NDArray[np.bool_], stretch: NDArray[np.int64], bins: Bins,
    b: int | None, confidence: float, track: str | None,
) -> list[Estimate]:  # fmt: skip
    e, mark = errors.error[inside, k], stretch[inside]
    use = np.isfinite(e)
    e, mark = e[use], mark[use]
    edges = (math.nan, math.nan) if b is None else bins.edges(b)
    flags = []
    if e.size < max(bins.min_samples, 4):
        flags.append("few-samples")
    bias, spread, square = mean(e, confidence, mark), sigma(e, confidence, mark), rms(e, confidence, mark)
    if e.size and bias.low * bias.high > 0:
        flags.append("biased")
    if spread.n_eff < 0.5 * spread.n:
        flags.append("correlated")
    if e.size >= 10 and spread.value > 1.2 * mad_sigma(e):
        flags.append("outliers")
    if k == 1 and e.size and float(np.median(np.abs(errors.true[inside, 2]))) > OVERHEAD:
        flags.append("overhead")
    return [
        Estimate(
            quantity=f"{name}_{what}", unit=UNITS[name], value=found.value, low=found.low, high=found.high, n=found.n,
            n_eff=found.n_eff, variable=None if b is None else bins.variable, bin_low=edges[0], bin_high=edges[1],
            track_id=track, flags=tuple(flags),
        )
        for what, found in (("bias", bias), ("sigma", spread), ("rms", square))
    ]  # fmt: skip


def _offset_rows(pairs: list[Pair], offset: Offset, confidence: float, per_track: bool) -> list[Estimate]:
    found: list[tuple[str | None, Offset]] = [(None, offset)]
    if per_track:
        found += [(pair.plots.target or None, time_offset([pair], confidence)) for pair in pairs]
    return [_offset_row(track, one) for track, one in found]


def _offset_row(track: str | None, offset: Offset) -> Estimate:
    e: Interval = offset.estimate
    return Estimate(
        quantity="time_offset", unit="s", value=e.value, low=e.low, high=e.high, n=e.n, n_eff=e.n_eff, track_id=track,
        flags=offset.flags,
    )  # fmt: skip


def _series(errors: Errors) -> dict[str, Series]:
    """Errors over range and over the rate of the coordinate, thinned to what a plot shows."""
    found: dict[str, Series] = {}
    for k, name in enumerate(COORDINATES):
        e = errors.error[:, k]
        if not np.isfinite(e).any():
            continue
        x, y = thin(errors.true[:, 0], e)
        found[f"errors/{name}"] = {"range_m": x.tolist(), "error": y.tolist()}
    x, y = thin(errors.rate[:, 0], errors.error[:, 0])
    found["range_rate"] = {"rate_m_s": x.tolist(), "error": y.tolist()}
    return found
