import numpy as np
import pytest

from rangeeval import open_trial
from rangeeval.scenarios.imm import SIGMA, Row, compare_filters, comparison_text, flight, simulate_imm
from rangeeval.tracking import polar
from rangeeval.tracking.measurements import azimuth_from_log


def test_the_flight_is_the_papers():
    """It starts where the paper says, keeps its speed, turns right then left, and ends overhead, 81 m from the radar."""
    truth = flight()
    at = {int(t): k for k, t in enumerate(truth.time_s)}
    np.testing.assert_allclose(truth.position[at[0]], [21689, 14840, 400], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(truth.velocity, axis=1), np.hypot(8.3, 399.9), rtol=1e-12)
    heading = np.unwrap(np.arctan2(truth.velocity[:, 1], truth.velocity[:, 0]))
    speed = np.hypot(8.3, 399.9)
    assert heading[at[45]] - heading[at[30]] == pytest.approx(-15 * 60 / speed)
    assert heading[at[80]] - heading[at[65]] == pytest.approx(15 * 40 / speed)
    assert np.linalg.norm(truth.position[-1, :2]) == pytest.approx(81.5, abs=0.1)


def test_the_trial_reads_back_as_what_was_flown(tmp_path):
    """Plots minus truth is the noise it claims, once azimuth is turned from north to east."""
    simulate_imm(tmp_path, seed=3)
    trial = open_trial(tmp_path)
    plots, truth = trial.log("plots").read().columns, trial.log("truth").read().columns
    place = np.column_stack([truth[name] for name in ("east_m", "north_m", "up_m")])
    z = np.column_stack([plots[name] for name in ("range_m", "azimuth_rad", "elevation_rad")])
    z[:, 1] = azimuth_from_log(z[:, 1])
    normal = (z - polar.of_position(place)) / SIGMA
    assert normal.std(0) == pytest.approx(np.ones(3), abs=0.25)
    assert np.abs(normal).max() < 5


def test_the_table_has_a_row_for_every_filter():
    """Even with two runs; every number that a filter has is there."""
    rows = compare_filters(2)
    assert all(isinstance(row, Row) and np.isfinite(row.rms) for row in rows)
    text = comparison_text(rows, 2)
    assert text.count("IMM-2, paper's values") == 3
    assert "nan" not in text


# 3-D RMS (m), velocity RMS (m/s) of an independent implementation in numpy, over the same hundred runs.
EXPECTED = {
    "IMM-2, paper's values": (54.5, 39.1),
    "IMM-3 CV/CA/CA, textbook": (53.7, 36.1),
    "EKF CV sqrt 10": (257.5, 126.0),
    "EKF CV 20": (65.8, 53.2),
    "EKF CV 32.5 (ML)": (62.2, 49.1),
    "EKF CV 40": (62.6, 50.3),
    "IMM-2, ML-tuned": (46.4, 26.5),
    "IMM-3, ML-tuned": (50.0, 34.1),
    "told the turn rate": (33.9, 4.8),
    "IMM-2, ML-tuned, smoothed": (20.0, 4.2),
    "IMM-2, paper's, smoothed": (28.1, 15.0),
    "EKF CV 32.5, smoothed (RTS)": (35.0, 18.2),
}
# NEES per degree of freedom: all, first turn, second turn.
NEES = {
    "IMM-2, paper's values": (0.62, 0.85, 0.85),
    "IMM-3 CV/CA/CA, textbook": (0.80, 1.36, 1.13),
    "IMM-2, ML-tuned": (1.25, 2.75, 2.35),
    "EKF CV 20": (1.16, 3.2, 1.4),
}


@pytest.mark.slow
def test_the_table_is_that_of_an_independent_implementation():
    """All rows over a hundred runs with the same random numbers: to the digits printed."""
    rows = {row.name: row for row in compare_filters(100)}
    for name, (rms, velocity) in EXPECTED.items():
        assert rows[name].rms == pytest.approx(rms, abs=0.5 if name == "IMM-3, ML-tuned" else 0.11, rel=1e-3), name
        assert rows[name].velocity == pytest.approx(
            velocity, abs=0.25 if name == "IMM-3, ML-tuned" else 0.15, rel=4e-3
        ), name
    for name, expected in NEES.items():
        found = [rows[name].nees[leg] for leg in ("all", "T1", "T2")]
        assert found == pytest.approx(expected, abs=0.06), name
    assert rows["alpha-beta 0.556, 0.222"].rms == pytest.approx(76.5, abs=1.0)
    for row in rows.values():
        assert row.standard_error < 1.0
