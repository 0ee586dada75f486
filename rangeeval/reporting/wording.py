"""How numbers, bins and flags are worded: digits follow the interval, units are those of the reader."""

from __future__ import annotations

import math
from collections.abc import Iterable

from rangeeval.model import Estimate
from rangeeval.units import Shown, shown, shown_variable

MISSING = "–"
NBSP = "\u00a0"  # holds a number together with its interval and unit

FLAGS = {
    "few-samples": "fewer samples than the trial asks for; the interval is wide and the tests are weak.",
    "correlated": "the residuals are not white. No fault in itself: an alpha-beta filter colours pure noise. The "
    "interval counts only the effective number of samples.",
    "manoeuvre": "consecutive residuals are alike: manoeuvre beyond the gains' design, or lag. Rely on the bracket.",
    "biased": "the mean residual is not zero: a lag that also sits in the track. It is removed from σ.",
    "not-normal": "the residuals are not normal; the interval is widened for heavy tails.",
    "outliers": "ordinary and robust σ differ by more than 20 %: a few large residuals carry the number.",
    "gains-vary": "gains change so much that bin-mean gains would be off by over 2 %; each sample has its own.",
    "snr-varies": "the residuals' size changes with SNR inside the bin: one σ is an average.",
    "range-varies": "the residuals' size changes with range inside the bin: one σ is an average.",
    "grazing": "so far off boresight (cosine below 0.1) that angle and cross-range no longer correspond.",
    "range-leak": "range noise enters this angle if range and cross-range are updated apart; see the leak bound.",
    "steady-state": "most updates of the bin were left out while the filter settled; few remain.",
    "unobservable": "the predicted cross-range reaches the predicted range; no angle. Check frame and units.",
    "one-sensor": "one accelerometer reads this rotation: what it reads of an oscillation is mostly its own "
    "acceleration, and the true attitude is not known.",
    "no-radii": "the sensors' radii are not known, so tilt and angular acceleration cannot be told apart.",
    "one-axis": "one of the two rotations is not measured and is taken as zero.",
    "no-oscillation": "no oscillation stands out of the noise; the amplitude is an upper limit.",
    "amplitude-varies": "the oscillation grows and fades by more than noise: the amplitude is a root mean square over "
    "segments, the peak error that of the segment that moved most.",
    "assumes-sine": "follows from one accelerometer by its radius, if the motion is a sine about a fixed centre.",
    "calibrated": "the radii come from the oscillation and the sensors' spacing, not from a survey.",
    "radius-disagrees": "the radius used and the one the oscillation shows differ by more than four sigma.",
    "clocks-differ": "the sensors of this axis do not swing in phase: their clocks differ, or the body bends.",
    "not-rigid": "three sensors or more are off a straight line over their heights: the body bends, or a "
    "radius is wrong.",
    "saturated": "a sensor stood at its highest or lowest value: peaks are cut, amplitudes are lower bounds.",
    "stuck-sensor": "a sensor stood still for a while; those samples are taken as missing.",
    "beyond-g": "some readings exceed g, which no tilt explains; there the tilt is missing.",
    "unusable": "more than one reading in a thousand exceeds g: vibration beyond what tilt sensing bears.",
    "gaps": "the tilt log has gaps; nothing is guessed in them.",
    "clock-step": "the clock was set back during the record; times it showed twice have no attitude.",
    "no-attitude": "some detections fall where no attitude is known; they are left out.",
    "noise-limited": "the error is no larger than the noise of the attitude it is judged by; the high end is "
    "its limit.",
    "propagated": "propagated from the attitude's noise, not seen in the samples of the bin.",
    "from-tolerance": "follows from a tolerance in trial.toml (or its default), not from the data.",
    "extrapolated": "outside the data the model was fitted to.",
    "few-detections": "Fewer than 3 detections: not enough for a number that means much; read the interval.",
    "upper-limit": "Nothing was detected: no estimate, only the one-sided upper limit of the RCS.",
    "lower-limit": "Nothing bounds the RCS from above (only hits without amplitude): no estimate, only a lower limit.",
    "poor-fit": "Amplitudes or number of detections do not fit the fluctuation model (bootstrap p below 0.01).",
    "case-not-distinguishable": (
        "The looks do not tell the Swerling cases apart: the interval holds those of every case within 2 of the best "
        "AIC."
    ),
    "slow-fading": "Consecutive amplitudes are alike: the target fades more slowly than looks follow each other. The "
    "interval takes them as independent and is too narrow.",
    "rcs-varies": "One mean RCS does not fit all bins: RCS changes with aspect, or the loss model is wrong.",
}

QUANTITIES = {
    "range_sigma": "Range σ",
    "y_sigma": "y σ",
    "z_sigma": "z σ",
    "elevation_sigma": "Elevation σ",
    "azimuth_sigma": "Azimuth σ",
    "detection_probability": "Pd",
    "detection_probability_model": "Model Pd",
    "rcs": "RCS",
    "snr": "SNR",
}


def quantity_name(quantity: str) -> str:
    """A quantity as a heading says it."""
    return QUANTITIES.get(quantity, quantity.replace("_", " "))


def decimals_for(low: float, high: float) -> int | None:
    """How many decimals an interval supports: two significant digits of its half width. None without an interval."""
    half = abs(high - low) / 2.0
    if not math.isfinite(half) or half <= 0.0:
        return None
    return max(0, min(12, 1 - math.floor(math.log10(half))))


def plain_number(value: float, digits: int = 4) -> str:
    """A number to a few significant digits; a dash where it is missing."""
    if not math.isfinite(value):
        return MISSING
    if value == 0.0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if -4 <= size < 7:
        return f"{value:.{max(0, digits - 1 - size)}f}"
    return f"{value:.{digits - 1}e}"


def _converted(estimate: Estimate, unit: Shown) -> tuple[float, float, float]:
    return unit.value(estimate.value), unit.value(estimate.low), unit.value(estimate.high)


def value_text(estimate: Estimate) -> str:
    """The estimate alone, with the digits its interval supports (no unit)."""
    value, low, high = _converted(estimate, shown(estimate.unit))
    if not math.isfinite(value):
        return MISSING
    decimals = decimals_for(low, high)
    return plain_number(value, 3) if decimals is None else f"{value:.{decimals}f}"


def interval_text(estimate: Estimate) -> str:
    """The interval alone, such as 3.51 to 4.21; a dash where there is none."""
    _, low, high = _converted(estimate, shown(estimate.unit))
    decimals = decimals_for(low, high)
    return MISSING if decimals is None else span_text(f"{low:.{decimals}f}", f"{high:.{decimals}f}")


def estimate_text(estimate: Estimate) -> str:
    """The estimate with its interval, such as 3.82 [3.51, 4.21] (no unit)."""
    _, low, high = _converted(estimate, shown(estimate.unit))
    decimals = decimals_for(low, high)
    text = value_text(estimate)
    if text == MISSING and "upper-limit" in estimate.flags and math.isfinite(high):
        return f"<{NBSP}{plain_number(high, 3)}"
    if text == MISSING and "lower-limit" in estimate.flags and math.isfinite(low):
        return f">{NBSP}{plain_number(low, 3)}"
    if decimals is None or text == MISSING:
        return text
    return f"{text}{NBSP}[{low:.{decimals}f},{NBSP}{high:.{decimals}f}]"


def unit_name(unit: str) -> str:
    """The unit in which a stored unit is shown."""
    return shown(unit).unit


def in_shown_unit(value: float, unit: str) -> str:
    """A stored number in the reader's unit, with its name: 20 m, 3 arcmin."""
    display = shown(unit)
    return f"{plain_number(display.value(value), 4)} {display.unit}".strip()


def bin_text(estimate: Estimate) -> str:
    """The bin, such as 10 to 15 km."""
    return edges_text(estimate.variable or "", estimate.bin_low, estimate.bin_high)


def edges_text(variable: str, low: float, high: float) -> str:
    """A bin by its edges."""
    if not math.isfinite(low):
        return "whole trial"
    unit = shown_variable(variable)
    edges = [f"{unit.value(v):.6g}" for v in (low, high)]
    space = "" if unit.unit == "°" else NBSP
    return f"{span_text(*edges)}{space}{unit.unit}".strip()


def span_text(low: str, high: str) -> str:
    """From one number to another, on one line."""
    return MISSING if low == high == MISSING else f"{low}{NBSP}to{NBSP}{high}"


def flags_text(flags: Iterable[str]) -> str:
    """Flags in one cell."""
    return ", ".join(flags)
