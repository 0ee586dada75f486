"""Post-trial analysis of radar test-range logs, with an honest interval on every number."""

__version__ = "0.1.0"
