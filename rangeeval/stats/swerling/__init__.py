"""Swerling targets: the distribution of the detection statistic, and the mean RCS by maximum likelihood, in batches."""

from rangeeval.stats.swerling.looks import CASES, Case, Looks, Windows
from rangeeval.stats.swerling.terms import DETECTION, HIT, MISS, SATURATED

__all__ = ["CASES", "DETECTION", "HIT", "MISS", "SATURATED", "Case", "Looks", "Windows"]
