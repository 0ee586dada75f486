"""The source paper's Monte Carlo comparison, held to numbers got another way and to what the paper says of its figures."""

import math

import numpy as np
import pytest

from rangeeval.scenarios.swerling import compare_methods

T = -math.log(1e-3)
SHAPES = {"3": 2.0, "1": 1.0}


@pytest.fixture(scope="module")
def table():
    """10,000 runs, as in the paper."""
    return {(c.swerling, c.snr, c.window): c for c in compare_methods(10_000, seed=5)}


def amplitudes(case, snr, shape, seed):
    """Power of one pulse from its parts: a gamma-distributed RCS, a phase, and complex noise of unit power."""
    rng = np.random.default_rng(seed)
    signal = np.sqrt(snr * rng.gamma(SHAPES[case], 1 / SHAPES[case], shape))
    noise = (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / math.sqrt(2)
    return np.abs(signal + noise) ** 2


def maximum_on_a_grid(z, snr, k):
    """The maximum of the likelihood written out, on 500 points of ln s, refined by a parabola; 0 with no detection."""
    u = np.linspace(math.log(0.02), math.log(8.0), 500)
    s = snr * np.exp(u)
    b = 1 + s / k
    x = T / b
    miss = np.log(-np.expm1(-x)) if k == 1 else np.log(1 - np.exp(-x) * (1 + (1 - 1 / b) * x))
    seen = z >= T
    value = (~seen).sum(axis=1)[:, None] * miss
    for i in range(z.shape[1]):
        a = z[:, i, None]
        f = -np.log(b) - a / b if k == 1 else np.log(s * a + 2 + s) - 3 * np.log(2 + s) - 2 * a / (2 + s)
        value += np.where(seen[:, i, None], f, 0.0)
    top = np.clip(value.argmax(axis=1), 1, len(u) - 2)
    left, mid, right = (np.take_along_axis(value, (top + d)[:, None], 1)[:, 0] for d in (-1, 0, 1))
    shift = 0.5 * (left - right) / (left - 2 * mid + right)
    return np.where(seen.any(axis=1), np.exp(u[top] + np.clip(shift, -1, 1) * (u[1] - u[0])), 0.0)


def rms(error):
    """RMS and its standard error."""
    square = error**2
    value = math.sqrt(square.mean())
    return value, square.std() / math.sqrt(len(error)) / (2 * value)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["3", "1"])
@pytest.mark.parametrize("snr", [8.0, 16.0, 32.0, 64.0])
@pytest.mark.parametrize("window", [7, 10, 15])
def test_ml_has_the_error_of_a_grid_search(table, case, snr, window):
    """Within four joint standard errors of 6,000 windows made and searched without the package; all four methods alike."""
    cell = table[case, snr, window]
    parts = [maximum_on_a_grid(amplitudes(case, snr, (1500, window), seed), snr, SHAPES[case]) - 1 for seed in range(4)]
    other, noise = rms(np.concatenate(parts))
    own = cell.standard_error["ml-a"]
    for method in ("ml-a", "em-a", "ml-b", "em-b"):
        assert abs(cell.rms[method] - other) < 4 * math.hypot(noise, own)
        assert abs(cell.rms[method] - cell.rms["ml-a"]) < 0.25 * own
    assert cell.rms["ml-a"] > cell.bound - 4 * own
    if snr >= 32:
        assert cell.rms["ml-a"] == pytest.approx(cell.bound, abs=4 * own)


def med(z, snr, until_near):
    """The rule written out, all runs side by side: the estimate after the last scan."""
    e = np.full(len(z), 10 * math.log10(1.5))
    latest, held = np.zeros((len(z), 5)), np.zeros(len(z), int)
    for scan in range(z.shape[1]):
        seen = z[:, scan] >= T
        e[~seen] -= 0.5
        rows = np.flatnonzero(seen)
        latest[rows, held[rows] % 5] = (z[rows, scan] - 1) / snr
        held[rows] += 1
        rows = rows[held[rows] >= 5]
        middle = 10 * np.log10(np.median(latest[rows], axis=1))
        for _ in range(100 if until_near else 1):
            step = 0.5 * (middle > e[rows] + 1) - 0.5 * (middle < e[rows] - 1)
            e[rows] += step
            if not step.any():
                break
    return 10 ** (0.1 * e)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["3", "1"])
@pytest.mark.parametrize("snr", [8.0, 16.0, 32.0, 64.0])
def test_med_has_the_error_of_the_rule_written_out(table, case, snr):
    """Both readings, 2,500 runs of 300 scans made without the package."""
    for name in ("med", "med*"):
        other, noise = rms(med(amplitudes(case, snr, (2500, 300), 9), snr, name == "med*") - 1)
        cell = table[case, snr, 10]
        assert abs(cell.rms[name] - other) < 4 * math.hypot(noise, cell.standard_error[name])


@pytest.mark.slow
@pytest.mark.parametrize("case", ["3", "1"])
def test_what_the_paper_says_of_its_figures(table, case):
    """ML gets better with SNR and window; MED* is always worse than ML (10), far better at 16 than at 8, then no better."""
    ml = {key[1:]: cell.rms["ml-a"] for key, cell in table.items() if key[0] == case}
    for snr, window in ml:
        assert ml[snr, 15] < ml[snr, 10] < ml[snr, 7]
        assert snr == 64 or ml[2 * snr, window] < ml[snr, window]
    near = {snr: table[case, snr, 10].rms["med*"] for snr in (8.0, 16.0, 32.0, 64.0)}
    noise = table[case, 16.0, 10].standard_error["med*"]
    assert all(near[snr] > 1.05 * ml[snr, 10] for snr in near)
    assert near[16] < 0.85 * near[8]
    assert near[16] - 4 * noise < near[32] < near[64]
    assert near[64] > near[16]
    assert table[case, 16.0, 10].rms["med"] < ml[16.0, 10]  # one step a scan cannot be what the paper simulated
