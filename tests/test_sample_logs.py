"""The sample logs are what the documented commands write, and show what they are there to show."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

import rangeeval
from rangeeval.scenarios import simulate_alpha_beta, simulate_attitude, simulate_bearing, simulate_imm
from tests import legacy, recordings

SAMPLES = Path(__file__).resolve().parents[1] / "sample_logs"


def _bytes(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_inbound_is_made_again_byte_for_byte(tmp_path: Path) -> None:
    """`rangeeval simulate alpha-beta -o sample_logs/inbound --seed 1 --flights 3` gives the same bytes."""
    simulate_alpha_beta(tmp_path, seed=1, flights=3)
    assert _bytes(tmp_path) == _bytes(SAMPLES / "inbound")


def test_attitude_is_made_again_byte_for_byte(tmp_path: Path) -> None:
    """`rangeeval simulate attitude -o sample_logs/attitude --seed 1` gives the same bytes."""
    simulate_attitude(tmp_path, seed=1)
    assert _bytes(tmp_path) == _bytes(SAMPLES / "attitude")


def test_imm_is_made_again_byte_for_byte(tmp_path: Path) -> None:
    """`rangeeval simulate imm -o sample_logs/imm --seed 1` gives the same bytes."""
    simulate_imm(tmp_path, seed=1)
    assert _bytes(tmp_path) == _bytes(SAMPLES / "imm")


def test_bearing_is_made_again(tmp_path: Path) -> None:
    """`rangeeval simulate bearing -o sample_logs/bearing --seed 1` gives the same samples and texts; 300 kB at most."""
    simulate_bearing(tmp_path, seed=1)
    made, kept = _bytes(tmp_path), _bytes(SAMPLES / "bearing")
    assert sum(map(len, kept.values())) < 300_000
    assert made.keys() == kept.keys()
    assert all(made[name] == kept[name] for name in made if not name.endswith(".h5"))
    with h5py.File(tmp_path / "snapshots.h5") as one, h5py.File(SAMPLES / "bearing" / "snapshots.h5") as other:
        for name in other:
            np.testing.assert_allclose(one[name][()], other[name][()], rtol=1e-6, atol=1e-6)


def test_legacy_is_made_again_byte_for_byte(tmp_path: Path) -> None:
    """`python -m tests.legacy sample_logs/legacy` gives the same bytes."""
    legacy.write(tmp_path)
    assert _bytes(tmp_path) == _bytes(SAMPLES / "legacy")


def test_asterix_is_made_again_byte_for_byte(tmp_path: Path) -> None:
    """`python -m tests.recordings sample_logs/asterix` gives the same bytes."""
    recordings.write(tmp_path)
    assert _bytes(tmp_path) == _bytes(SAMPLES / "asterix")


def test_asterix_gives_the_errors_it_was_made_with() -> None:
    """Bias and sigma of the recorded plots against what the aircraft report; the recording crosses midnight."""
    found = rangeeval.truth(rangeeval.open_trial(SAMPLES / "asterix")).estimates
    of = found[found["bin_low"].isna() & found["group"].isna()].set_index("quantity")
    for quantity, true in (
        ("range_bias", recordings.BIAS_M),
        ("range_sigma", recordings.SIGMA_M),
        ("azimuth_bias", np.radians(recordings.BIAS_DEG)),
        ("azimuth_sigma", np.radians(recordings.SIGMA_DEG)),
        ("time_offset", 0.0),
    ):
        assert of.loc[quantity, "low"] <= true <= of.loc[quantity, "high"], quantity
    assert of.loc["range_bias", "n"] == 300


def test_inbound_shows_every_verdict() -> None:
    """The requirements of the sample pass in some bins, fail in some, and stay open in some."""
    verdicts = rangeeval.check(rangeeval.open_trial(SAMPLES / "inbound")).estimates["verdict"]
    assert set(verdicts) == {"pass", "fail", "inconclusive"}


def test_inbound_shows_the_waveform_switch() -> None:
    """Range sigma is larger below 35 km, where the waveform is shorter, than just above; angles are not."""
    trial = rangeeval.open_trial(SAMPLES / "inbound")
    found = rangeeval.accuracy(trial).estimates
    of = found[found["group"].isna()].set_index(["quantity", "bin_low"])["value"]
    assert of["range_sigma", 30e3] > 1.3 * of["range_sigma", 35e3]
    assert of["elevation_sigma", 30e3] < of["elevation_sigma", 35e3]


def test_legacy_gives_the_numbers_of_the_same_flight(tmp_path: Path) -> None:
    """Feet, decimal commas and other names change nothing but the rounding; its bad rows are named and counted."""
    simulate_alpha_beta(tmp_path, seed=1, flights=1, no_truth=True)
    trial = rangeeval.open_trial(SAMPLES / "legacy")
    old = rangeeval.accuracy(trial)
    new = rangeeval.accuracy(rangeeval.open_trial(tmp_path)).estimates
    new = new[new["group"].isna()].set_index(["quantity", "bin_low"])
    rows = old.estimates[old.estimates["group"].isna()]
    for row in rows[rows["quantity"].isin(["range_sigma", "azimuth_sigma"]) & (rows["n"] > 30)].itertuples():
        assert row.value == pytest.approx(new.loc[(row.quantity, row.bin_low), "value"], rel=0.1)
    reasons = " ".join(f"{p} {p.examples}" for p in old.problems)
    assert "****" in reasons
    assert "same update twice" in reasons
