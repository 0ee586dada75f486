"""Plots given to tracks, where whose they are is known."""

import numpy as np
import pytest

from rangeeval.angles import wrapped
from rangeeval.tracking.association import NO_TRACK, Rules, group

SIGMA = (15.0, 1e-3, 1e-3)


def scene(seed, targets, clutter=0, period=4.0, turns=40, rotating=False, detection=1.0, planar=False):
    """Straight flights at 200 m/s: times, polar plots and whose they are (-1 clutter), in order of time."""
    rng = np.random.default_rng(seed)
    rows = []
    start = rng.uniform(-40e3, 40e3, (targets, 2))
    heading = rng.uniform(0, 2 * np.pi, targets)
    for turn in range(turns):
        for j in range(targets):
            azimuth_share = (np.arctan2(start[j, 1], start[j, 0]) / (2 * np.pi)) % 1.0 if rotating else 0.0
            t = (turn + azimuth_share) * period
            if rng.random() > detection:
                continue
            x, y = start[j] + 200 * t * np.array([np.cos(heading[j]), np.sin(heading[j])])
            p = np.array([x, y, 0.0 if planar else 5000.0])
            rows.append((t, *polar(p), j))
        for _ in range(clutter):
            p = np.append(rng.uniform(-60e3, 60e3, 2), 0.0 if planar else rng.uniform(0, 12e3))
            rows.append(((turn + rng.random() * 0.9 * rotating) * period, *polar(p), -1))
    rows.sort(key=lambda r: r[0])
    table = np.array(rows)
    z = table[:, 1:4] + rng.normal(size=(len(table), 3)) * SIGMA
    if planar:
        z[:, 2] = np.nan
    return table[:, 0], z, table[:, 4].astype(int)


def polar(p):
    return np.hypot(np.hypot(*p[:2]), p[2]), np.arctan2(p[1], p[0]), np.arctan2(p[2], np.hypot(*p[:2]))


def agreement(found, whose, targets):
    """Share of true plots in a track of their target, and the tracks per target."""
    right = total = 0
    tracks = []
    for j in range(targets):
        mine = found.track[whose == j]
        total += mine.size
        numbers, counts = np.unique(mine[mine != NO_TRACK], return_counts=True)
        tracks.append(numbers.size)
        right += counts.max(initial=0)
    return right / total, tracks


@pytest.mark.parametrize("method", ["nearest", "global", "pda"])
@pytest.mark.parametrize("rotating", [False, True])
def test_every_target_becomes_one_track(method, rotating):
    """Six targets without clutter, scans marked by nothing: one track each, all plots in it."""
    time, z, whose = scene(1, 6, rotating=rotating)
    found = group(time, z, SIGMA, Rules(method=method))
    share, tracks = agreement(found, whose, 6)
    assert tracks == [1] * 6
    assert found.tracks == 6
    assert share > 0.99
    assert found.revisit_s == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize("method", ["nearest", "global", "pda"])
def test_tracks_outlive_misses_and_shrug_off_clutter(method):
    """Nine in ten detected among ten false plots a scan: every target is held, false tracks are few and short."""
    time, z, whose = scene(2, 4, clutter=10, detection=0.9, turns=60)
    found = group(time, z, SIGMA, Rules(method=method, revisit_s=4.0))
    share, _ = agreement(found, whose, 4)
    assert share > 0.9
    false = found.track[whose == -1]
    assert np.count_nonzero(false != NO_TRACK) < 0.1 * false.size


def test_a_planar_log_is_grouped_in_the_plane():
    """No elevation at all: two dimensions."""
    time, z, whose = scene(3, 5, planar=True)
    share, tracks = agreement(group(time, z, SIGMA), whose, 5)
    assert share > 0.98
    assert max(tracks) == 1


def test_the_assignment_is_the_best_of_all_not_the_first_at_hand():
    """Two targets 120 m apart side by side: together they stay apart where the nearest alone may swap."""
    t = np.repeat(np.arange(30.0), 2)
    side = np.tile([0.0, 120.0], 30)
    p = np.stack([20e3 - 150 * t, side, np.full(60, 1000.0)], -1)
    z = np.array([polar(q) for q in p]) + np.random.default_rng(5).normal(size=(60, 3)) * (10.0, 5e-4, 5e-4)
    found = group(t, z, (10.0, 5e-4, 5e-4), Rules(method="global", revisit_s=1.0))
    share, _ = agreement(found, np.tile([0, 1], 30), 2)
    assert share > 0.9


def test_combined_plots_are_wider_than_one_plot():
    """PDA gives polar positions whose sigma counts the spread of the gate; azimuth through the cut is no jump."""
    time, z, _ = scene(6, 3, clutter=20)
    found = group(time, z, SIGMA, Rules(method="pda", revisit_s=4.0))
    for rows, polar_, sigma in found.shared:
        assert len(rows) == len(polar_) == len(sigma)
        assert np.isfinite(polar_).all()
        assert (sigma >= np.array(SIGMA) * 0.999).all()
        assert np.abs(wrapped(polar_[:, 1] - z[rows, 1])).max() < 0.2


def test_the_same_log_gives_the_same_tracks():
    """No chance in it."""
    time, z, _ = scene(7, 4, clutter=5, rotating=True)
    a, b = (group(time, z, SIGMA, Rules(method="pda")) for _ in range(2))
    assert a.track.tolist() == b.track.tolist()
    assert all(np.array_equal(x[1], y[1]) for x, y in zip(a.shared, b.shared, strict=True))


@pytest.mark.parametrize("n", [0, 1, 2])
def test_too_few_plots_start_no_track(n):
    """Three are needed."""
    found = group(np.arange(n, dtype=float), np.tile([1000.0, 0.0, 0.1], (n, 1)), SIGMA)
    assert found.tracks == 0
    assert (found.track == NO_TRACK).all()


def test_plots_too_far_apart_for_any_target_are_no_track():
    """A kilometre a second is the limit."""
    t = np.arange(10.0)
    found = group(t, np.stack([1e4 + 5e3 * t, 0 * t, 0 * t], -1), SIGMA, Rules(revisit_s=1.0))
    assert found.tracks == 0
