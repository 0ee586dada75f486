"""Accuracy: the random error of an alpha-beta tracker per bin, from its residuals and gains alone, without truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rangeeval.analyses.accuracy.gathering import gather_cells
from rangeeval.analyses.accuracy.numbers import Method, bin_estimates
from rangeeval.analyses.accuracy.series import figure_series
from rangeeval.errors import SettingsError, did_you_mean
from rangeeval.model import Bins, Result, Trial, as_trial

ESTIMATORS = ("recommended", "paper")


def accuracy(
    trial: Trial | Any,
    bins: Bins | None = None,
    *,
    confidence: float = 0.95,
    estimator: str = "recommended",
    per_track: bool = False,
    when: Mapping[str, float] | None = None,
    progress: Callable[[int], None] | None = None,
) -> Result:
    """Random-error sigma of range and array angles in each bin, from residuals and gains alone.

    A constant bias leaves no trace in residuals, so none can be reported.

    Parameters
    ----------
    trial : holds a `residuals` log, with its gains in it or in a `gains` log (SI columns, docs/reference/logs.md); or
        plain tables: a DataFrame of residuals with gains, or `{"residuals": ..., "gains": ...}`.
    bins : bins of the predicted range unless they say otherwise; by default those of the trial's settings.
    confidence : of the two-sided intervals.
    estimator : `recommended` (mean removed, gain ratio per sample, start-up removed, groups, diagnostics) or
        `paper` (the source paper's formulas to the letter: divisor N - 1 without removing the mean, bin-mean
        gains, every usable sample, no groups).
    per_track : also a row per track.
    when : keep only samples with `<column>_min` <= column <= `<column>_max`.
    progress : called with the number of rows read since the last call.

    Raises
    ------
    InputError : no residual log, no gains, or not a single usable sample.
    SettingsError : an impossible argument.

    References
    ----------
    Shin and Kim (2015), eqs 9-13 and 22-32, as corrected in docs/explanation/accuracy.md.
    """
    trial = as_trial(trial)
    bins = bins or Bins.of(trial.settings.bins)
    if estimator not in ESTIMATORS:
        raise SettingsError(f"estimator '{estimator}' is not known; {did_you_mean(estimator, ESTIMATORS)}")
    if not 0.0 < confidence < 1.0:
        raise SettingsError(f"confidence is {confidence:g}, expected more than 0 and less than 1")
    paper = estimator == "paper"
    gathered = gather_cells(
        trial, bins, startup=not paper, groups=not paper, per_track=per_track, when=when or {}, progress=progress
    )
    method = Method(bins, confidence, paper, trial.settings.radar)
    return Result(
        "accuracy",
        tuple(bin_estimates(gathered, method)),
        settings={
            "estimator": estimator,
            "confidence": confidence,
            "variable": bins.variable,
            "bin_width": bins.width,
            "bin_start": bins.start,
            "bin_ratio": bins.ratio,
            "min_samples": bins.min_samples,
            "per_track": per_track,
            "when": dict(when or {}),
            "counts": gathered.counts,
        },
        problems=gathered.problems,
        series=figure_series(gathered, bins),
    )
