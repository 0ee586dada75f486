"""Time order: rows out of order, rows logged twice, and runs that follow one another in one file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rangeeval.model import Table


@dataclass(frozen=True)
class Ordered:
    """A piece with its rows in order, and what had to be done for it."""

    table: Table
    disordered: int = 0
    runs: int = 0
    duplicates: int = 0


def in_time_order(table: Table, usual: float) -> Ordered:
    """The rows of a piece in time order within each track, without those logged twice.

    A large step back (more than 20 usual intervals and a second) is another run in one file, not disorder: it is left,
    and the track starts anew there.
    """
    track, time = table.codes("track_id"), table.floats("time_s")
    order = np.argsort(track, kind="stable")
    same = np.diff(track[order]) == 0
    if not (same & (np.diff(time[order]) < 0)).any():
        return Ordered(table)
    # Only where time steps back can a copy stand apart from its original: rows equal in all that identifies an update.
    keys = (table.floats("range_residual_m"), table.floats("range_predicted_m"), time, track)
    by_key = np.lexsort(keys)
    copy = np.zeros(len(table), bool)
    copy[by_key[1:]] = np.all([k[by_key][1:] == k[by_key][:-1] for k in keys], axis=0)
    table, track, time = table.take(~copy), track[~copy], time[~copy]
    order = np.argsort(track, kind="stable")
    step, same = np.diff(time[order]), np.diff(track[order]) == 0
    forward = step[same & (step > 0)]
    back = same & (step < 0)
    large = back & (step < -max(20.0 * (float(np.median(forward)) if len(forward) else usual), 1.0))
    small = int(np.count_nonzero(back & ~large))
    if small:
        # Within a run by time; the runs of one track stay in the order they were logged.
        run = np.empty(len(time), np.int64)
        run[order] = np.concatenate([[0], np.cumsum(large | ~same)])
        table = table.take(np.lexsort((time, run)))
    return Ordered(table, small, int(np.count_nonzero(large)), int(np.count_nonzero(copy)))
