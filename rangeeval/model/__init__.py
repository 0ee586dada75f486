"""The nouns: log kinds and their columns, tables, trials and their settings, bins, estimates and results."""

from rangeeval.model.bins import BinChoice, Bins
from rangeeval.model.kinds import KINDS, Column, LogKind, recognise
from rangeeval.model.result import Estimate, Result
from rangeeval.model.settings import SensorArray, TrialSettings, settings_from
from rangeeval.model.table import CHUNK_ROWS, Log, Problem, Table, gather, log_of, piece_rows
from rangeeval.model.trial import Source, Trial, as_trial
from rangeeval.model.updates import updates

__all__ = [
    "CHUNK_ROWS",
    "KINDS",
    "BinChoice",
    "Bins",
    "Column",
    "Estimate",
    "Log",
    "LogKind",
    "Problem",
    "Result",
    "SensorArray",
    "Source",
    "Table",
    "Trial",
    "TrialSettings",
    "as_trial",
    "gather",
    "log_of",
    "piece_rows",
    "recognise",
    "settings_from",
    "updates",
]
