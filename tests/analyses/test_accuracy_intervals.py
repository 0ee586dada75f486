"""Intervals of the accuracy analysis where samples do not count alike: close angles, changing noise, tracks that differ."""

import numpy as np
import pytest

from rangeeval.analyses.accuracy import accuracy
from rangeeval.model import Bins
from rangeeval.tracking.alpha_beta import beta_from_alpha, q_cv

ALPHA = 0.5
BETA = float(beta_from_alpha(ALPHA))
SETTLING = 22


def log(rng, ranges, sigma=3.0, track=None):
    """White residuals of `sigma` (m, one number or one a sample) on every axis of a log at these predicted ranges."""
    n = len(ranges)
    data = {"time_s": np.arange(n) * 0.5, "range_predicted_m": ranges, "y_predicted_m": np.full(n, 50.0),
            "z_predicted_m": np.full(n, -80.0)}  # fmt: skip
    for axis in ("range", "y", "z"):
        data[f"{axis}_residual_m"] = rng.standard_normal(n) * sigma
        data[f"alpha_{axis}"], data[f"beta_{axis}"] = np.full(n, ALPHA), np.full(n, BETA)
    return data | ({} if track is None else {"track_id": [f"T{t}" for t in track]})


def one(result, quantity):
    """The pooled row of a quantity in a log of one bin."""
    (row,) = [r for r in result.rows if r.quantity == quantity and r.group is None and r.track_id is None]
    return row


def inbound(n=150):
    """Predicted ranges of a flight from 4.5 to 0.5 km, after updates far out in which the filter settles."""
    return np.concatenate([np.full(SETTLING, 4500.0), np.linspace(4500.0, 500.0, n)])


def true_angle_sigma(ranges, sigma=3.0):
    """sqrt of the mean of q sigma^2 / (R^2 - z^2) over the samples that count."""
    r = ranges[SETTLING:]
    return float(np.sqrt(np.mean(q_cv(ALPHA, BETA) * sigma**2 / (r**2 - 80.0**2))))


def test_angles_of_a_close_target_count_their_weights():
    """From 4.5 to 0.5 km the nearest samples carry the angle: a third to a fifth of the degrees of freedom are left."""
    result = accuracy(log(np.random.default_rng(0), inbound(400)), Bins())
    close, plain = one(result, "azimuth_sigma"), one(result, "z_sigma")
    assert plain.extra["nu"] > 350
    assert 0.15 < close.extra["nu"] / plain.extra["nu"] < 0.4
    r = inbound(400)[SETTLING:]
    w = 1 / (r**2 - 80.0**2)
    assert close.extra["nu"] / plain.extra["nu"] == pytest.approx(w.sum() ** 2 / (w @ w) / 400, rel=0.5)


def test_noise_that_changes_inside_a_bin_leaves_fewer_degrees_of_freedom():
    """Sigma from 1 to 4 m over a bin: sum of variances squared over sum of squared variances, not n (within 25 %)."""
    ranges = np.linspace(54_900.0, 50_000.0, 600 + SETTLING)
    sigma = np.linspace(1.0, 4.0, 600 + SETTLING)
    row = one(accuracy(log(np.random.default_rng(1), ranges, sigma), Bins()), "range_sigma")
    v = sigma[SETTLING:] ** 2
    assert "range-varies" in row.flags
    assert row.extra["nu"] == pytest.approx(v.sum() ** 2 / (v @ v), rel=0.25)


def test_tracks_that_differ_count_as_the_samples():
    """Eight tracks of 100 updates whose sigmas differ threefold tell less than 800 equal samples; alike ones as much."""
    rng = np.random.default_rng(2)
    track = np.repeat(np.arange(8), 100 + SETTLING)
    ranges = np.full(track.size, 52_000.0)
    alike = one(accuracy(log(rng, ranges, 3.0, track), Bins()), "range_sigma")
    scale = np.array([1.0, 3.0, 1.5, 2.5, 1.0, 2.0, 3.0, 1.2])[track]
    unlike = one(accuracy(log(rng, ranges, scale, track), Bins()), "range_sigma")
    assert alike.extra["nu"] > 600
    assert unlike.extra["nu"] < 25


def test_where_a_track_is_hardly_more_than_one_sample_the_tracks_count():
    """Four tracks that ring all along: fewer degrees of freedom than the tracks' number, whatever their samples say."""
    rng = np.random.default_rng(4)
    each = 60 + SETTLING
    track = np.repeat(np.arange(4), each)
    ringing = np.repeat(rng.standard_normal(4), each) * np.where(np.arange(4 * each) % 2, 1.0, -1.0)
    data = log(rng, np.full(4 * each, 52_000.0), 0.3, track)
    data["range_residual_m"] += 3.0 * ringing
    row = one(accuracy(data, Bins()), "range_sigma")
    assert row.n == 240
    assert row.extra["nu"] < 4.0


def test_lasting_memory_is_believed_of_tracks_that_happen_to_be_alike():
    """Four tracks that ring with one strength scatter no more than chance: the allowance for four is made all the same."""
    rng = np.random.default_rng(6)
    each = 60 + SETTLING
    track = np.repeat(np.arange(4), each)
    data = log(rng, np.full(4 * each, 52_000.0), 0.3, track)
    data["range_residual_m"] += 3.0 * np.where(np.arange(4 * each) % 2, 1.0, -1.0)
    row = one(accuracy(data, Bins()), "range_sigma")
    within = row.n_eff - 1.0  # what the samples leave
    assert row.extra["nu"] == pytest.approx(within * (1.959964 / 3.182446) ** 2, rel=1e-5)


def test_the_memory_of_an_angle_is_that_where_its_weights_are():
    """Residuals white far out and ringing close by: the angle, which weighs the last, has fewer degrees of freedom."""
    rng = np.random.default_rng(5)
    ranges = inbound(600)
    plain, ringing = log(rng, ranges), log(rng, ranges)
    x, near = ringing["z_residual_m"], ranges < 1500.0
    for k in np.flatnonzero(near):
        x[k] = -0.9 * x[k - 1] + np.sqrt(1.0 - 0.81) * x[k]
    white, rings = (one(accuracy(data, Bins()), "azimuth_sigma").extra["nu"] for data in (plain, ringing))
    assert white > 80
    assert rings < 0.75 * white


def test_a_robust_sigma_is_less_sure():
    """The median absolute deviation has 37 % of the efficiency: its degrees of freedom say so."""
    result = accuracy(log(np.random.default_rng(3), np.full(300, 52_000.0)), Bins())
    robust, plain = one(result, "range_residual_sigma_robust"), one(result, "range_residual_sigma")
    assert robust.extra["nu"] == pytest.approx(0.3675 * plain.extra["nu"])
    assert robust.high - robust.low > plain.high - plain.low


@pytest.mark.slow
def test_close_angle_intervals_cover():
    """Of 500 logs of 150 updates from 4.5 to 0.5 km, 92.5 to 97 % of the 95 % intervals hold the true angle sigma."""
    ranges = inbound()
    truth = true_angle_sigma(ranges)
    held = 0
    for seed in range(500):
        row = one(accuracy(log(np.random.default_rng(seed), ranges), Bins()), "azimuth_sigma")
        held += row.low <= truth <= row.high
    assert 0.925 < held / 500 < 0.97
