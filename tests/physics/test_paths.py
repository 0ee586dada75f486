"""Paths whose motion is known between their points."""

import numpy as np
import pytest

from rangeeval.physics.paths import clean, interpolate


def parabola(t):
    """Constant acceleration in two coordinates."""
    return np.stack([3.0 + 200 * t + 15 * t**2, -40 * t + 0 * t], -1), np.stack([200 + 30 * t, -40 + 0 * t], -1)


def test_constant_acceleration_is_met_exactly_at_uneven_times():
    """Position and velocity between uneven points."""
    time = np.array([0.0, 0.7, 1.9, 2.4, 4.0, 5.1])
    at = np.linspace(0.0, 5.1, 57)
    place, speed = interpolate(time, parabola(time)[0], at, 10.0)
    np.testing.assert_allclose(place, parabola(at)[0], atol=1e-9)
    np.testing.assert_allclose(speed, parabola(at)[1], atol=1e-9)


def test_a_turn_is_followed_far_better_than_by_straight_lines():
    """4 g at 250 m/s, a point a second: below 25 cm, where straight lines are 4.9 m off."""
    w = 4 * 9.81 / 250
    time, at = np.arange(0.0, 20.0), np.linspace(2.0, 17.0, 301)
    circle = [250 / w * np.stack([np.sin(w * t), 1 - np.cos(w * t)], -1) for t in (time, at)]
    place, _ = interpolate(time, circle[0], at, 2.0)
    assert np.abs(place - circle[1]).max() < 0.25
    straight = np.stack([np.interp(at, time, circle[0][:, k]) for k in range(2)], -1)
    assert np.abs(straight - circle[1]).max() > 3.0


def test_nothing_is_guessed_in_a_gap_or_beyond_the_ends():
    """NaN there, and the points beside a gap are not bent by it."""
    time = np.array([0.0, 1.0, 2.0, 10.0, 11.0, 12.0])
    place, _ = interpolate(time, parabola(time)[0], np.array([-0.1, 1.5, 5.0, 10.5, 12.1]), 2.0)
    assert np.isnan(place[:, 0]).tolist() == [True, False, True, False, True]
    np.testing.assert_allclose(place[[1, 3]], parabola(np.array([1.5, 10.5]))[0], atol=1e-9)


@pytest.mark.parametrize("n", [0, 1])
def test_a_path_needs_two_points(n):
    """NaN, not an error."""
    place, speed = interpolate(np.arange(n, dtype=float), np.zeros((n, 3)), [0.0], 1.0)
    assert np.isnan(place).all()
    assert np.isnan(speed).all()


def test_what_cannot_be_interpolated_is_left_out_and_counted():
    """A missing point, a time twice, a stale position, a jump of 100 km."""
    time = np.arange(12.0)
    position = parabola(time)[0]
    position[3] = np.nan
    position[5] = position[4]
    position[8] += 100e3
    time[11] = 10.0
    found = clean(time, position)
    assert (found.missing, found.stale, found.jumps, found.repeated) == (1, 1, 1, 1)
    assert found.time_s.tolist() == [0, 1, 2, 4, 6, 7, 9, 10]


def test_a_target_that_stands_still_is_not_stale():
    """A minute at one place is a place."""
    time = np.arange(100.0)
    position = np.stack([np.clip(time - 80, 0, None) * 10, 0 * time], -1)
    assert clean(time, position).stale == 0


def test_a_receiver_repeats_latitude_and_longitude_while_height_goes_on():
    """What it reported decides what is stale, not the position made of it."""
    time = np.arange(10.0)
    position = np.stack([100.0 * time, 5.0 * time], -1)
    reported = position[:, :1].copy()
    reported[4] = reported[3]
    position[4, 0] = position[3, 0]
    assert clean(time, position).stale == 0
    assert clean(time, position, reported=reported).time_s.tolist() == [0, 1, 2, 3, 5, 6, 7, 8, 9]
