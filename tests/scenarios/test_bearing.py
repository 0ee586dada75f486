"""The bearing scenario is what it says, and over many runs every method shows what is claimed for it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rangeeval.arrays.options import JointOptions
from rangeeval.scenarios.bearing import (
    CROSSING_METHODS,
    METHODS,
    bearing_table,
    bounce_paths,
    crossing_paths,
    crossing_text,
    geometry_of,
    paths,
    receive,
    table_text,
    what_becomes,
)


def test_the_paths_cross_where_they_should():
    """1-2 at 0.312 of the run, 3-4 at 0.455, 1-4 at 0.609, 1-3 at 0.75, 1-5 at 0.899."""
    truth = paths(10_000)
    for one, other, share in ((0, 1, 0.3125), (2, 3, 0.4545), (0, 3, 0.6087), (0, 2, 0.75), (0, 4, 0.8995)):
        assert np.argmin(np.abs(truth[:, one] - truth[:, other])) / 10_000 == pytest.approx(share, abs=2e-4)
    assert np.rad2deg(np.diff(crossing_paths(0.1), axis=0))[0] == pytest.approx([0.05, -0.05])
    assert np.rad2deg(np.abs(np.diff(bounce_paths(3.0), axis=1))).min() == pytest.approx(3.0, abs=0.06)


def test_signals_have_their_power_and_are_uncorrelated():
    """Per sensor 5 sources of power 1 and the noise of the SNR; the covariance is the model's."""
    for array in ("line", "cylinder"):
        geometry = geometry_of(array)
        still = np.broadcast_to(paths()[0], (40_000, 5))
        x = receive(still, geometry, 5.0, np.random.default_rng(1))
        cov = x.T @ x.conj() / len(x)
        assert np.diag(cov).real == pytest.approx(5 + 10**-0.5, rel=0.05)
        eigenvalues = np.linalg.eigvalsh(cov)
        assert eigenvalues[:10] == pytest.approx(10**-0.5, rel=0.05)
        assert eigenvalues[10] > 5.0


def test_the_tables_print_what_was_measured():
    """Two short runs: every method with its mean and standard error, bounds without; both tables of crossings."""
    rows = bearing_table(2, 1, steps=100)
    text = table_text(rows, 2)
    assert [row.method for row in rows][: len(METHODS)] == [name for name, _ in METHODS]
    assert all(math.isnan(e) for row in rows[-2:] for e in row.error)
    assert f"{rows[4].mse[0]:.4f} +-{rows[4].error[0]:.4f}" in text
    crossings = crossing_text(2)
    assert crossings.count("joint-ml") == 3
    assert "1.00 (0.00)" in crossings


@pytest.mark.slow
def test_the_papers_tables_are_repeated():
    """40 runs: the papers' row within 8 % of the independent reference, joint ML 8 times better and between the bounds."""
    rows = {row.method.strip(): row for row in bearing_table(40, 2)}
    published = next(row for name, row in rows.items() if name.startswith("ryu"))
    reference = (0.3285, 0.1676, 0.1045, 0.1723, 0.1098, 0.0858)
    assert published.mse == pytest.approx(reference, rel=0.08)
    joint = rows["joint-ml, blocks of 10"].mse
    assert joint == pytest.approx((0.0313, 0.0145, 0.0072, 0.0207, 0.0097, 0.0052), rel=0.2)
    assert all(8 * j < p for j, p in zip(joint, published.mse, strict=True))
    above, below = rows["posterior bound, q = 1e-10"].mse, rows["posterior bound, q = 0"].mse
    assert all(low < j < high for low, j, high in zip(below, joint, above, strict=True))


@pytest.mark.slow
def test_what_holds_through_a_crossing_and_a_bounce():
    """The published tracker loses slow crossings and swaps every bounce; joint ML holds, and swaps none from 2 degrees on."""
    methods = dict(CROSSING_METHODS)
    published, soft = methods["ryu, q/r 1e-7 (as published)"], methods["ryu, lag, soft coasting, q/r 1e-6"]
    assert what_becomes(crossing_paths(0.02), published, 30, 1)["held"] < 0.1
    assert what_becomes(crossing_paths(0.1), published, 30, 1)["held"] == 1.0
    assert what_becomes(crossing_paths(0.02), soft, 30, 1)["held"] == 1.0
    assert what_becomes(crossing_paths(0.02), JointOptions(), 30, 1)["held"] > 0.9
    for nearest in (1.0, 2.0):
        assert what_becomes(bounce_paths(nearest), published, 30, 1)["swapped"] == 1.0
        assert what_becomes(bounce_paths(nearest), soft, 30, 1)["swapped"] == 1.0
    for nearest in (2.0, 3.0, 4.0):
        found = what_becomes(bounce_paths(nearest), JointOptions(process_variance=1e-8), 30, 1)
        assert found == {"held": 1.0, "swapped": 0.0, "lost": 0.0}
