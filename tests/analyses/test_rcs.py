"""RCS and detection probability of logs whose target was chosen."""

import contextlib
import math

import numpy as np
import pytest

import rangeeval
from rangeeval.analyses.rcs import rcs
from rangeeval.errors import RangeevalError
from rangeeval.model import Bins, Trial, log_of
from rangeeval.scenarios import scenario


def log(seed=1, n=600, sigma=2.0):
    """A Swerling 1 target of `sigma` m^2 whose SNR of 1 m^2 falls from 12 to 1."""
    rng = np.random.default_rng(seed)
    alpha = np.linspace(12.0, 1.0, n)
    z = rng.exponential(1 + sigma * alpha)
    threshold = -math.log(1e-3)
    seen = z > threshold
    return {
        "time_s": np.arange(n) * 1.0, "detected": seen.astype(float), "amplitude": np.where(seen, z, np.nan),
        "snr_per_m2": alpha, "threshold": np.full(n, threshold), "range_m": np.linspace(20e3, 59e3, n),
    }  # fmt: skip


def trial_of(data):
    return Trial("made-up", (log_of("detections", data),))


def of(result, quantity):
    """The pooled rows of a quantity, by the low edge of their bin (None: whole trial)."""
    return {
        None if math.isnan(r.bin_low) else r.bin_low: r
        for r in result.rows
        if r.quantity == quantity and r.track_id is None
    }


def test_a_known_rcs_is_found_in_every_bin_with_misses_counted():
    """2 m^2 lies in the interval of the whole and of at least seven of eight bins; dropping misses would double the far ones."""
    data = log(n=2400)
    result = rcs(trial_of(data), Bins(width=5e3, start=20e3), swerling="1", replicates=49)
    found = of(result, "rcs")
    bins = [r for low, r in found.items() if low is not None]
    assert len(bins) == 8
    assert sum(r.low <= 2.0 <= r.high for r in bins) >= 7
    assert all(r.unit == "m^2" for r in bins)
    far = data["range_m"] > 50e3
    seen = far & (data["detected"] == 1)
    assert np.mean((data["amplitude"][seen] - 1) / data["snr_per_m2"][seen]) > 3.0


def test_detection_probability_is_counted_with_its_interval():
    """k of n with an interval that holds it, bin by bin."""
    data = log()
    found = of(rcs(trial_of(data), Bins(width=10e3, start=20e3), swerling="1", replicates=49), "detection_probability")
    for low, row in found.items():
        if low is None:
            continue
        inside = (data["range_m"] >= low) & (data["range_m"] < low + 10e3)
        assert row.value == pytest.approx(data["detected"][inside].mean())
        assert row.low <= row.value <= row.high


def test_nothing_detected_gives_a_limit_not_a_number():
    """A bin of misses only: an upper limit and a flag."""
    data = log()
    data["detected"][:] = 0.0
    data["amplitude"][:] = np.nan
    found = of(rcs(trial_of(data), Bins(width=50e3, start=20e3), swerling="1", replicates=49), "rcs")
    row = next(iter(found.values()))
    assert "upper-limit" in row.flags
    assert math.isfinite(row.high)


@pytest.mark.parametrize("method", ["ml-a", "em-a", "ml-b", "em-b", "med"])
def test_every_method_runs_and_agrees_roughly(method):
    """Close to 2 m^2 where detections are many (MED to its own 0.5 dB steps)."""
    data = {k: v[:200] for k, v in log().items()}
    found = of(rcs(trial_of(data), Bins(width=50e3, start=20e3), swerling="1", method=method, replicates=49), "rcs")
    assert all(0.8 < r.value < 5.0 for r in found.values())


def test_the_sample_is_recovered(tmp_path):
    """`simulate swerling` writes a trial of 2 m^2 that `rcs` reads back."""
    scenario("swerling")(tmp_path, seed=3, looks=1500)
    result = rcs(rangeeval.open_trial(tmp_path), swerling="3", replicates=49)
    whole = of(result, "rcs")
    inside = [r.low <= 2.0 <= r.high for r in whole.values() if math.isfinite(r.high)]
    assert np.mean(inside) > 0.75
    assert '"rcs"' in result.to_json(series=True)


@pytest.mark.parametrize("spoil", [{"detected": 3.0}, {"amplitude": -1.0}, {"snr_per_m2": -2.0}, {"threshold": -1.0}])
def test_an_impossible_look_is_said_or_refused_never_used_silently(spoil):
    """One bad value in one look: a problem that counts it, or one clear line."""
    data = log()
    name, value = next(iter(spoil.items()))
    data[name][5] = value
    with contextlib.suppress(RangeevalError):  # one clear line will do as well
        assert rcs(trial_of(data), Bins(width=50e3, start=20e3), swerling="1", replicates=49).problems


@pytest.mark.parametrize(
    ("column", "value", "reason", "words"),
    [
        ("amplitude", math.nan, "detections without an amplitude", "amplitude is missing"),
        ("amplitude", 3.0, "amplitudes of detections below their threshold", "below the threshold 6.90776"),
        ("threshold", 0.0, "threshold is not above zero", "threshold is 0"),
        ("threshold", -1.0, "threshold is not above zero", "threshold is -1"),
        ("snr_per_m2", -2.0, "snr_per_m2 is not a number above zero", "snr_per_m2 is -2"),
        ("snr_per_m2", 0.0, "not looked at, not a miss", "snr_per_m2 is 0"),
        ("detected", math.nan, "not looked at, not a miss", "detected is missing"),
        ("detected", 3.0, "detected is neither 0 nor 1", "detected is 3"),
    ],
)
def test_a_bad_look_is_set_aside_with_its_scan_number(column, value, reason, words):
    """One bad value in the sixth look: named by scan and time, one look fewer, the estimate that of the rest."""
    data = log()
    rest = {k: np.delete(v, 5) for k, v in data.items()}
    data[column] = data[column].copy()
    data[column][5] = value
    how = {"bins": Bins(width=50e3, start=20e3), "swerling": "1", "replicates": 0}
    result = rcs(trial_of(data), **how)
    (problem,) = [p for p in result.problems if reason in p.reason]
    assert problem.count == 1
    assert "scan 6 (at 5 s)" in problem.examples[0]
    assert words in problem.examples[0]
    found, expected = of(result, "rcs")[None], of(rcs(trial_of(rest), **how), "rcs")[None]
    assert (found.n, found.value) == (599, pytest.approx(expected.value, rel=1e-12))


def test_nothing_but_hits_without_amplitude_gives_a_lower_limit():
    """All detected, no amplitude column: no value, a finite lower end, no upper end."""
    data = log()
    data["detected"][:] = 1.0
    del data["amplitude"]
    row = of(rcs(trial_of(data), Bins(width=50e3, start=20e3), swerling="1", replicates=0), "rcs")[None]
    assert math.isnan(row.value)
    assert row.low > 0
    assert row.high == math.inf
    assert "lower-limit" in row.flags


def test_detections_weaker_than_noise_are_a_limit():
    """A threshold below the noise and amplitudes that show no target: a limit, no value."""
    data = {k: v[:40] for k, v in log().items()}
    data["threshold"][:], data["detected"][:], data["amplitude"][:] = 0.3, 1.0, 0.5
    row = of(rcs(trial_of(data), Bins(width=50e3, start=20e3), swerling="1", replicates=0), "rcs")[None]
    assert math.isnan(row.value)
    assert "upper-limit" in row.flags


def test_one_detection_among_few_looks_is_said():
    """A number, with the flag that it rests on too few detections."""
    data = {k: v[:40].copy() for k, v in log().items()}
    data["detected"][1:] = 0.0
    data["amplitude"][1:] = np.nan
    data["detected"][0], data["amplitude"][0] = 1.0, 9.0
    row = of(rcs(trial_of(data), Bins(width=50e3, start=20e3), swerling="1", replicates=0), "rcs")[None]
    assert "few-detections" in row.flags
