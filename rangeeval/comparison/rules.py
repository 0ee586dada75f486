"""How each quantity is compared: as a ratio or a difference, which direction is better, and by which theory.

`RULES` is read from the top; the first pattern that fits a quantity's name holds. A quantity that none names is
compared by the last line, so a new analysis is compared without a word here.
"""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Literal

Measure = Literal["ratio", "difference"]
Better = Literal["smaller", "larger", "nearer zero", ""]


@dataclass(frozen=True)
class Rule:
    """`names`: patterns. `main`: compared unless other quantities are asked for. `share`: a number of hits in n."""

    names: tuple[str, ...]
    measure: Measure
    better: Better = ""
    main: bool = False
    share: bool = False


RULES = (
    # What is no property of the radar under trial: it grows with the log, or is itself a p value.
    Rule(("log_likelihood*", "squared_error_difference", "aic*", "*_p", "updates", "rcs_sliding"), "difference"),
    # Parts and rivals of a headline number.
    Rule(("*_designation_error_rms", "*_small_angle_error_rms", "plot_rms", "ospa_*", "gospa_*"), "ratio", "smaller"),
    Rule(("budget_*", "sensor_noise*", "bearing_bound*"), "ratio", "smaller"),
    Rule(("nis_ratio", "coherence*"), "ratio"),
    # The headline numbers. y and z are elevation and azimuth again, in metres: not tested twice.
    Rule(("range_sigma", "elevation_sigma", "azimuth_sigma", "pair_error_sigma_?"), "ratio", "smaller", main=True),
    Rule(("*_rms", "ospa", "gospa", "single_error_peak_?", "noise_amplification_?"), "ratio", "smaller", main=True),
    Rule(("*_residual_mean", "*_bias", "time_offset"), "difference", "nearer zero", main=True),
    Rule(("detection_probability",), "difference", "larger", main=True, share=True),
    Rule(("rcs", "dynamic_amplitude_?", "frequency_?", "nis_mean"), "ratio", main=True),
    Rule(("static_?",), "difference", main=True),
    # The same numbers by other formulas, and what describes the trial rather than the radar.
    Rule(("detection_probability_*",), "difference", "larger"),
    Rule(("detection_range_*",), "ratio", "larger"),
    Rule(("predicted_*", "*_variance_ratio", "*_kurtosis", "alpha_*", "beta_*", "radius_*"), "ratio"),
    Rule(("*_sigma", "*_sigma_*", "*_rms_with_lag"), "ratio", "smaller"),
    Rule(("snr", "snr_*", "loop_gain", "*_correlation*", "*_skewness", "*_mean", "*_min", "*_max"), "difference"),
    Rule(("time_skew*", "height_misfit*"), "difference"),
    Rule(("*",), "ratio", main=True),
)


def rule_of(quantity: str, unit: str) -> Rule:
    """The rule of a quantity; a level (dB) that no rule names has differences, not ratios."""
    found = next(rule for rule in RULES if any(fnmatchcase(quantity, name) for name in rule.names))
    return Rule(found.names, "difference", main=True) if found is RULES[-1] and unit == "dB" else found


def compared(quantity: str) -> bool:
    """Whether a comparison of the quantity means anything."""
    return not any(fnmatchcase(quantity, name) for name in RULES[0].names)
