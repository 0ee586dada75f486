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
    "optimistic": "the mean NIS (NEES) is above what chance allows: the filter believes itself better than it is.",
    "pessimistic": "the mean NIS (NEES) is below what chance allows: the filter allows for more noise than there is.",
    "gated": "over one plot in twenty fell outside the gate and was not used: the numbers are those of the rest. The "
    "measurement noise or the motion model is far off.",
    "inconsistent": "updates beyond any chance: the filter's assumptions do not fit there.",
    "restarted": "a track was started anew, after a long gap or too many plots outside the gate in a row.",
    "overhead": "so near to the zenith that azimuth says little.",
    "repeated-times": "plots with the time of the one before.",
    "broken": "the filter's numbers broke down in places; the track started anew there.",
    "planar": "no elevation: range and azimuth only, in the slant plane; height is not estimated.",
    "partial": "some plots have no elevation; the others carry the height.",
    "assumed-noise": "the measurement noise is an assumption: it was not given, and the plots are too few to show it.",
    "from-scatter": "estimated from the plots' own scatter about parabolas through their neighbours.",
    "tuned": "found by maximising the likelihood of the plots.",
    "at-floor": "the tuned value stands at the floor set for it: the plots ask for still less.",
    "given": "given in trial.toml.",
    "never-held": "no track was ever on this target.",
    "unlike-snr": "SNR is not alike in the two trials (by more than 1 dB and the intervals): it changes σ by itself.",
    "unlike-gains": "the mean gains differ by over 10 %: the filter smooths differently, whatever the radar measures.",
    "unlike-path": "the ranges flown in the bin, or the angles off boresight, differ: a metre across is another angle "
    "(by over 10 %).",
    "better": "the first filter is better; the interval of the difference does not hold 0.",
    "worse": "the first filter is worse; the interval of the difference does not hold 0.",
    "not-told-apart": "the log does not tell the two filters apart.",
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
    "nominal-sigma": "σ follows from the filter's settings alone, not from the data.",
    "bound-sigma": "σ is the Cramér-Rao bound of a block at the power found, not a measured error.",
    "unmodelled-source": "the guard says that a source is heard that is not tracked; more targets may be there.",
    "unresolved": "for a while nearer than a beam width to another target: which is which may be wrong after it.",
    "coasted": "for a while carried by its prediction next to another target.",
    "faded": "for a while not heard above the noise; carried by its prediction, or left out.",
    "missing": "some snapshots had missing samples; the bearing was carried by its prediction there.",
    "outside-sector": "the bearing left the sector the array can see.",
    "mirrored": "the samples fit the array better with the other sign of phase: these bearings are mirrored.",
    "aliased": "the sensors stand so far apart that two bearings look the same.",
    "dead-sensor": "a sensor was silent or constant and is left out.",
    "weak-sensor": "a sensor is more than 20 dB weaker than the others.",
    "clipped": "samples of a sensor stand at one extreme value; bearings may be biased.",
    "moving": "sources move within the blocks in which they were counted; their number is uncertain.",
    "fewer-found": "the first snapshots showed fewer targets than were asked for.",
    "none-found": "no source stood out of the noise.",
    "swapped": "the track ended on another target's truth.",
    "lost": "the track ended farther than 2° from every truth of its own.",
    "extra": "there is no truth for this track.",
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
    "bearing_rms": "Bearing RMS",
    "bearing_bias": "Bearing bias",
    "nis_mean": "Mean NIS",
    "nis_ratio": "NIS ratio",
    "nees_mean": "Mean NEES",
    "range_rms": "Range RMS",
    "azimuth_rms": "Azimuth RMS",
    "elevation_rms": "Elevation RMS",
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
    value, low, high = _converted(estimate, shown(estimate.unit, estimate.quantity))
    if not math.isfinite(value):
        return MISSING
    decimals = decimals_for(low, high)
    return plain_number(value, 3) if decimals is None else f"{value:.{decimals}f}"


def interval_text(estimate: Estimate) -> str:
    """The interval alone, such as 3.51 to 4.21; a dash where there is none."""
    _, low, high = _converted(estimate, shown(estimate.unit, estimate.quantity))
    decimals = decimals_for(low, high)
    return MISSING if decimals is None else span_text(f"{low:.{decimals}f}", f"{high:.{decimals}f}")


def estimate_text(estimate: Estimate) -> str:
    """The estimate with its interval, such as 3.82 [3.51, 4.21] (no unit)."""
    _, low, high = _converted(estimate, shown(estimate.unit, estimate.quantity))
    decimals = decimals_for(low, high)
    text = value_text(estimate)
    if text == MISSING and "upper-limit" in estimate.flags and math.isfinite(high):
        return f"<{NBSP}{plain_number(high, 3)}"
    if text == MISSING and "lower-limit" in estimate.flags and math.isfinite(low):
        return f">{NBSP}{plain_number(low, 3)}"
    if decimals is None or text == MISSING:
        return text
    return f"{text}{NBSP}[{low:.{decimals}f},{NBSP}{high:.{decimals}f}]"


def unit_name(unit: str, quantity: str = "") -> str:
    """The unit in which a stored unit is shown."""
    return shown(unit, quantity).unit


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
