"""The chapters on replay and truth: from fresh results and from results read back, with hostile names, with hardly any data."""

import json

import numpy as np
import pytest

from rangeeval.flow import Plan, evaluate
from rangeeval.model import Result, Trial, log_of
from rangeeval.model.settings import settings_from
from rangeeval.physics.polar import polar
from rangeeval.reporting import render
from rangeeval.reporting.blocks import Figure, Notice, Table
from rangeeval.reporting.sections import compose

HOSTILE = "a/b<script>\x1b[31m$\\foo$"


def trial(n=120, name=HOSTILE, planar=False, truth=True, gap=False):
    """One target that passes the radar."""
    rng = np.random.default_rng(2)
    t = np.arange(n) * 1.0
    t[n // 2 :] += 400.0 * gap
    p = np.stack([20e3 - 180 * t, 3000 + 0 * t, 5e3 + 10 * t], -1)
    z = polar(p) + rng.normal(size=(n, 3)) * (10.0, 1e-3, 1e-3)
    plots = {"time_s": t, "target_id": [name] * n, "range_m": z[:, 0], "azimuth_rad": z[:, 1] % (2 * np.pi)}
    if not planar:
        plots["elevation_rad"] = z[:, 2]
    true = {"time_s": t, "target_id": [name] * n, "north_m": p[:, 0], "up_m": p[:, 1], "east_m": p[:, 2]}
    logs = [log_of("plots", plots, "plots"), *([log_of("truth", true, "truth")] if truth else [])]
    return Trial("t", tuple(logs), settings_from({"truth": {"max_gap_s": 5.0}}))


def blocks(results, kind):
    return [b for s in compose(results).sections for b in s.blocks if isinstance(b, kind)]


def read_back(results):
    return [Result.from_dict(json.loads(r.to_json(series=True))) for r in results]


@pytest.mark.parametrize("case", [{}, {"planar": True}, {"truth": False}, {"gap": True}, {"n": 1}, {"n": 3}, {"n": 6}])
def test_the_same_blocks_come_from_results_read_back(case):
    """Every case is laid out, and nothing in the chapter needs more than the results file holds."""
    results = evaluate(trial(**case))
    no_path = case.get("truth") is False or case.get("n") == 1  # one position is no path: truth is left out, and said
    assert [r.analysis for r in results] == ["replay"] + ["truth"] * (not no_path)
    assert repr(compose(results)) == repr(compose(read_back(results)))


def test_the_chapter_has_what_it_promises():
    """Trajectory, innovations with bounds, modes over time, filters compared, errors by axis, the blind spot in words."""
    results = evaluate(trial())
    captions = " ".join(b.caption for b in blocks(results, (Figure, Table)))
    for words in ("trajectory", "Innovations of track", "motion model", "filters on the same plots", "Paired differences",
                  "axis by axis", "Sets of tracks", "Bias and σ"):  # fmt: skip
        assert words in captions, words
    notices = " ".join(b.text for b in blocks(results, Notice))
    assert "cannot show a constant bias" in notices


def test_a_gap_breaks_lines_and_bounds():
    """No line across 400 s without a plot."""
    figure = next(b for b in blocks(evaluate(trial(gap=True)), Figure) if "Innovations" in b.caption)
    bands = [m for m in figure.panels[0][0].marks if m.kind == "band"]
    assert len(bands) == 2
    assert max(bands[0].x) < 100 < 400 < min(bands[1].x)


def test_a_planar_track_has_no_height():
    """One panel from above, no elevation column."""
    results = evaluate(trial(planar=True), Plan(analyses=("replay",)))
    figure = next(b for b in blocks(results, Figure) if "trajectory" in b.caption)
    assert len(figure.panels[0]) == 1
    assert not any("Elevation" in head for b in blocks(results, Table) for head in b.head)


def test_hostile_names_are_only_text():
    """The page is made, and the name is no markup."""
    page = render(compose(evaluate(trial(n=40)))).html
    assert "<script>\x1b" not in page
    assert "a/b&lt;script&gt;" in page
