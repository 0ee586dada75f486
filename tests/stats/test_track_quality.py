"""Set distances against every pairing tried in turn; continuity against a story told by hand."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rangeeval.stats.track_quality import (
    NOBODY,
    Association,
    Counts,
    assign,
    continuity,
    count,
    distances,
    gospa,
    ospa,
    purity,
)

points = st.lists(st.tuples(*[st.floats(-50, 50)] * 2), max_size=4)


def pairings(m, n):
    """Every way to pair some of m with some of n."""
    for k in range(min(m, n) + 1):
        for rows in itertools.combinations(range(m), k):
            for columns in itertools.permutations(range(n), k):
                yield list(zip(rows, columns, strict=True))


@settings(deadline=None)  # a busy machine is no failure
@given(points, points, st.sampled_from([(10.0, 1.0), (25.0, 2.0), (3.0, 3.0)]))
def test_ospa_is_the_best_of_all_pairings(tracks, truths, how):
    """By enumeration: every pairing of the smaller set, the rest at the cutoff."""
    c, p = how
    d = np.array([[math.dist(a, b) for b in truths] for a in tracks]).reshape(len(tracks), len(truths))
    found = ospa(d, c, p)
    larger = max(len(tracks), len(truths))
    if larger == 0:
        assert found.total == 0
        return
    full = [q for q in pairings(*d.shape) if len(q) == min(d.shape)]
    place = min(sum(min(d[i, j], c) ** p for i, j in q) for q in full)
    number = c**p * abs(len(tracks) - len(truths))
    assert found.total == pytest.approx(((place + number) / larger) ** (1 / p))
    assert found.localisation**p + found.cardinality**p == pytest.approx(found.total**p)


@settings(deadline=None)  # a busy machine is no failure
@given(points, points, st.sampled_from([(10.0, 1.0), (25.0, 2.0)]))
def test_gospa_is_the_best_of_all_partial_pairings(tracks, truths, how):
    """By enumeration: any subset of pairs, whatever is left costs half the cutoff's power."""
    c, p = how
    d = np.array([[math.dist(a, b) for b in truths] for a in tracks]).reshape(len(tracks), len(truths))
    best = min(
        sum(d[i, j] ** p for i, j in q) + c**p / 2 * (len(tracks) + len(truths) - 2 * len(q))
        for q in pairings(*d.shape)
    )
    found = gospa(d, c, p)
    assert found.distance == pytest.approx(best ** (1 / p))
    assert found.localisation + found.missed + found.false == pytest.approx(best)


def test_positions_with_a_missing_coordinate_are_nobody():
    """Rows of NaN pad the sets of a scan."""
    assert distances([[0.0, 0.0], [np.nan, np.nan]], [[3.0, 4.0]]).tolist() == [[5.0]]
    assert distances(np.full((2, 3), np.nan), np.zeros((1, 3))).shape == (0, 1)


@pytest.mark.parametrize("bad", [[[np.nan]], [1.0]])
def test_a_matrix_with_holes_is_refused(bad):
    """NaN would spread into every number."""
    with pytest.raises(ValueError, match="matrix without missing"):
        ospa(bad, 10.0)


def story():
    """Two targets over six scans: A held, lost, found by another track; B not visible at first; a false track 9."""
    rows = [
        (0, 1, 0), (1, 1, 0), (3, 2, 0), (4, 2, 0), (5, 2, 0),
        (2, 3, 1), (3, 3, 1), (3, 4, 1), (4, 4, 1), (5, 4, 1),
        (2, 9, NOBODY), (3, 9, NOBODY),
    ]  # fmt: skip
    step, track, truth = (np.array(c) for c in zip(*rows, strict=True))
    present = np.ones((6, 2), bool)
    present[0, 1] = False
    return Association(step, track, truth, present)


def test_continuity_tells_the_story():
    """Breaks, changes and waiting times of the story, counted by hand."""
    a, b = continuity(story(), np.arange(6) * 4.0)
    assert (a.breaks, a.identity_changes, a.latency_s) == (1, 1, 0.0)
    assert (b.breaks, b.identity_changes, b.latency_s) == (0, 1, 4.0)
    assert purity(story()) == {1: 1.0, 2: 1.0, 3: 1.0, 4: 1.0}


def test_a_truth_never_held_has_no_latency():
    """NaN, no breaks."""
    nothing = np.array([], int)
    (one,) = continuity(Association(nothing, nothing, nothing, np.ones((3, 1), bool)), [0, 1, 2])
    assert math.isnan(one.latency_s)
    assert one.breaks == one.identity_changes == 0


def test_ratios_of_the_whole_follow_from_sums_over_bins():
    """Counts add up over bins; 11 present, 9 held, 10 of 12 tracks on a truth."""
    a = story()
    whole = count(a)[0]
    assert (whole.present, whole.held, whole.assigned, whole.tracks) == (11, 9, 10, 12)
    assert whole.completeness == pytest.approx(9 / 11)
    assert whole.ambiguity == pytest.approx(10 / 9)
    assert whole.spuriousness == pytest.approx(2 / 12)
    truth_bin = np.array([[0, 0], [0, 0], [1, 0], [1, 1], [2, 1], [2, 2]])
    parts = count(a, truth_bin, np.full(12, 1))
    assert sum(parts.values(), Counts()) == whole
    assert parts[1].tracks - parts[1].assigned == 2


def test_no_truth_leaves_ratios_missing():
    """Nothing present: no ratio, not zero."""
    assert math.isnan(Counts().completeness)
    assert count(Association(*[np.array([], int)] * 3, np.ones((0, 0), bool))) == {}


def test_a_track_stays_on_its_truth_until_it_leaves_the_wider_gate():
    """Hysteresis: at 5 sigma it stays where it was, but does not enter; beyond 6 it goes to the other."""
    d = np.array([[5.0, 9.0], [3.0, 9.0], [5.0, 1.0], [6.5, 1.0], [np.nan, 5.0], [np.nan, np.nan]])
    assert assign(np.zeros(6, int), d, 4.0, 6.0).tolist() == [NOBODY, 0, 0, 1, 1, NOBODY]


def test_gates_in_the_wrong_order_are_refused():
    """Leaving before entering would flicker."""
    with pytest.raises(ValueError, match="leave"):
        assign([0], [[1.0]], 4.0, 2.0)
