"""Swerling targets: the distribution of the detection statistic, and the mean RCS by maximum likelihood, in batches."""

from rangeeval.stats.swerling.closed import DETECTION, HIT, MISS, SATURATED
from rangeeval.stats.swerling.looks import CASES, Case, Looks, Windows

__all__ = ["CASES", "DETECTION", "HIT", "MISS", "SATURATED", "Case", "Looks", "Windows"]
