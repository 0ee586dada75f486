"""Tracks whose fate we chose are judged by it."""

import numpy as np
import pytest

from rangeeval.arrays.assessment import bearing_errors, outcome, outcomes

TRUTH = np.deg2rad(np.array([-10.0, 10.0]) + np.array([0.1, -0.1]) * np.arange(201)[:, None])


def test_errors_near_and_far_add_up():
    """One degree off near the crossing and two far: each its own square, all together their mean."""
    near = np.abs(TRUTH[:, 0] - TRUTH[:, 1]) < np.deg2rad(5.1)
    off = np.where(near, np.deg2rad(1.0), np.deg2rad(2.0))[:, None]
    found = bearing_errors(TRUTH + off, TRUTH, np.deg2rad(5.1))
    assert np.rad2deg(np.sqrt(found.mse_near)) == pytest.approx(1.0)
    assert np.rad2deg(np.sqrt(found.mse_far)) == pytest.approx(2.0)
    assert found.n == found.n_near + found.n_far == 402
    assert found.n * found.mse == pytest.approx(found.n_near * found.mse_near + found.n_far * found.mse_far)
    gaps = TRUTH.copy()
    gaps[:50] = np.nan
    assert bearing_errors(gaps, TRUTH, 0.1).n == 302


def test_errors_wrap():
    """179 degrees against -179 is two degrees off."""
    found = bearing_errors(np.full((5, 1), np.deg2rad(179.0)), np.full((5, 1), np.deg2rad(-179.0)), 0.1)
    assert np.rad2deg(np.sqrt(found.mse)) == pytest.approx(2.0)


def test_held_swapped_lost():
    """Right; exchanged at the crossing; both at one place; 1.9 degrees off is held and 2.1 lost; a lapse before the tail is none."""
    swapped = np.where(np.arange(201)[:, None] < 100, TRUTH, TRUTH[:, ::-1])
    merged = np.where(np.arange(201)[:, None] < 100, TRUTH, 0.0)
    lapsed = TRUTH.copy()
    lapsed[100:150] += 1.0
    assert [outcome(t, TRUTH) for t in (TRUTH, swapped, merged, lapsed)] == ["held", "swapped", "lost", "held"]
    assert outcome(TRUTH + np.deg2rad(1.9), TRUTH) == "held"
    assert outcome(TRUTH + np.deg2rad(2.1), TRUTH) == "lost"
    assert outcomes(np.array([TRUTH, swapped, merged, TRUTH]), TRUTH) == {"held": 0.5, "swapped": 0.25, "lost": 0.25}
