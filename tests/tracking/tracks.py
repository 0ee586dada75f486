"""Tracks for the tests: a manoeuvring target, measured with noise."""

import numpy as np

from rangeeval.tracking import polar
from rangeeval.tracking.measurements import Measurements
from rangeeval.tracking.motion import transition

SIGMA = np.array([30.0, 0.003, 0.003])


def flight(steps=60, dt=1.0):
    """Times and true states (steps, 6): straight, a turn of 0.15 rad/s in a tilted plane, straight."""
    times = dt * np.arange(steps)
    state = np.concatenate([[21e3, 14e3, 3000.0, -8.0, -400.0, 0.0], np.zeros(3)])
    states = np.empty((steps, 6))
    for k in range(steps):
        states[k] = state[:6]
        state = state.copy()
        state[6:] = np.array([0.03, 0.01, -0.15]) * (steps // 3 <= k < 2 * steps // 3)
        state = transition("ct", state, dt)[0]
    return times, states


def track(seed=0, steps=60, dt=1.0, sigma=SIGMA, turned=0.0):
    """Measurements of the flight, turned about the vertical."""
    times, states = flight(steps, dt)
    z = polar.of_position(states[:, :3]) + np.random.default_rng(seed).standard_normal((steps, 3)) * sigma
    z[:, 1] = np.mod(z[:, 1] + turned + np.pi, 2 * np.pi) - np.pi
    return Measurements.of(times, z, sigma)
