"""Comparison: trials side by side, tested bin by bin, from their tidy tables alone."""

from __future__ import annotations

from rangeeval.comparison.comparing import Method, compare

__all__ = ["Method", "compare"]
