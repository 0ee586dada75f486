"""Inspection: what was recognised in each file, and what is in it."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from rangeeval.parsers.inspection import inspect_trial
from tests.parsers.samples import text_log


def test_a_trial_is_inspected(tmp_path: Path) -> None:
    """Kind, format, columns as written and stored, rows, span, gaps, tracks, rejected rows, hash; as JSON too."""
    rows = [f"{t},A,1,30000" for t in (0, 1, 2, 3, 20, 21)] + ["22,B,oops,30000", "23,B,,30000"]
    path = text_log(tmp_path, "time_s,track_id,Range_residual_FT,range_predicted_m\n" + "\n".join(rows) + "\n")
    (found,) = inspect_trial(tmp_path)
    assert (found.file, found.format, found.kind) == ("residuals.csv", "text", "residuals")
    assert [(c.written, c.stored, c.missing) for c in found.columns][2] == ("Range_residual_FT", "range_residual_m", 1)
    assert (found.rows, found.rejected, found.tracks) == (7, 1, 2)
    assert (found.first_time_s, found.last_time_s) == (0.0, 23.0)
    assert (found.gaps, found.largest_gap_s) == (1, 17.0)
    assert found.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert found.problems[0].examples == (
        f"{tmp_path.name}/residuals.csv:8: Range_residual_FT is 'oops', not a number",
    )
    json.dumps(found.as_dict(), allow_nan=False)


def test_an_empty_log_is_inspected(tmp_path: Path) -> None:
    """No rows: no times, no tracks."""
    (found,) = inspect_trial(text_log(tmp_path, "time_s,alpha,beta\n"))
    assert (found.rows, found.kind) == (0, "gains")
    data = found.as_dict()
    assert data["first_time_s"] is None


@pytest.mark.parametrize("ids", [["A"], []])
def test_tracks_are_counted(ids: list[str], tmp_path: Path) -> None:
    """Without track ids all rows are one track."""
    name = "track_id," if ids else ""
    text = f"{name}time_s,alpha,beta\n" + "".join(f"{''.join(f'{i},' for i in ids)}{t},0.5,0.1\n" for t in range(4))
    (found,) = inspect_trial(text_log(tmp_path, text))
    assert found.tracks == 1
