"""What goes beyond one window: false alarms, free shape, tests of fit, homogeneity, other intervals, MED."""

import math

import numpy as np
import pytest
from mpmath import mp
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import gammaincc, ndtr
from scipy.stats import chi2, kstest, nbinom

from rangeeval.stats.swerling import CASES, MISS, Case, Looks, Windows
from rangeeval.stats.swerling import detection as pd
from rangeeval.stats.swerling import likelihood as ml
from rangeeval.stats.swerling.closed import density_one, density_three, miss_one, miss_three
from rangeeval.stats.swerling.fitness import (
    bootstrap,
    choose,
    free_shape,
    homogeneity,
    lag_one,
    measures,
    simulate,
)
from rangeeval.stats.swerling.intervals import bootstrap_interval, credible_interval
from rangeeval.stats.swerling.paper import iterate, iterate_together, median_rule
from rangeeval.stats.swerling.terms import above, look_terms

T = -math.log(1e-3)


def drawn(case, count, length, alpha, s=1.0, seed=1, cells=1.0):
    """Windows of looks at a target of `s` m^2, and the windows."""
    plain = Looks.of(
        np.full(count * length, np.nan), np.resize(np.asarray(alpha, float), count * length), T, cells=cells
    )
    windows = Windows.groups(np.full(count, length))
    return simulate(plain, windows, CASES[case], np.full(count, s), np.random.default_rng(seed)), windows


@pytest.mark.parametrize("kernel", [miss_one, miss_three, density_one, density_three])
@pytest.mark.parametrize("z", [0.4, 6.9, 40.0])
@pytest.mark.parametrize("s", [0.05, 3.0, 400.0])
def test_the_three_derivatives_are_those_of_the_logarithm_written_out(kernel, z, s):
    """Differentiated with 40 digits: ln f and ln P(miss) of Swerling 1 and 3."""
    k = 1 if kernel.__name__.endswith("one") else 2

    def value(u):
        snr = mp.exp(u)
        b = 1 + snr / k
        x = z / b
        if kernel.__name__.startswith("miss"):
            return mp.log(1 - mp.exp(-x) * (1 if k == 1 else 1 + (1 - 1 / b) * x))
        return -mp.log(b) - x if k == 1 else mp.log(snr * z + 2 + snr) - 3 * mp.log(2 + snr) - 2 * z / (2 + snr)

    with mp.workdps(40):
        wanted = [float(mp.diff(value, mp.log(s), order)) for order in (1, 2, 3)]
    for found, exact in zip(kernel(z, s), wanted, strict=True):
        assert found == pytest.approx(exact, rel=1e-11, abs=1e-13 * abs(wanted[0]))


@pytest.mark.parametrize("k", [0.3, 1.9, 40.0])
@pytest.mark.parametrize(("t", "mean"), [(7.0, 0.5), (50.0, 50.0), (3000.0, 800.0)])
def test_the_tail_of_any_shape_is_the_negative_binomial_sum(k, t, mean):
    """P(z >= t) against 400,000 terms summed by scipy, also far out where few counts matter."""
    j = np.arange(400_000)
    assert above(t, 1, mean, k) == pytest.approx(
        float(np.sum(nbinom.pmf(j, k, k / (k + mean)) * gammaincc(1 + j, t))), rel=1e-9
    )


@pytest.mark.parametrize("case", ["1", "3"])
@pytest.mark.parametrize("spread", [0.0, 0.5, 1.0])
def test_a_batch_finds_the_maximum_whatever_the_path(case, spread):
    """Closed form, series and grid give the same maximum; from any start nearby too."""
    rng = np.random.default_rng(3)
    data, windows = drawn(case, 60, 9, 12.0 * 10.0 ** rng.uniform(-spread, spread, 540), seed=4)
    found = ml.maximum_likelihood(data, windows, CASES[case])
    series = ml._maxima(data, windows, ml._likelihood(data, Case("same", CASES[case].shape)), np.zeros(60))
    np.testing.assert_allclose(found, series, rtol=1e-10)
    grid = ml._from_grid(data, windows, ml._likelihood(data, CASES[case]), windows.reduce(np.maximum, data.alpha))
    np.testing.assert_allclose(found, np.where(found > 0, grid, 0.0), rtol=1e-9)
    near = ml.maximum_likelihood(data, windows, CASES[case], near=np.where(found > 0, 3.0 * found, 0.0))
    np.testing.assert_allclose(found, near, rtol=1e-10)


def test_of_several_maxima_the_highest_is_taken():
    """500 windows with alphas over five decades: nothing on a grid of 1,500 points is more likely than what is found."""
    rng = np.random.default_rng(9)
    alpha = 10.0 ** rng.uniform(-2, 3, 4000)
    z = np.where(rng.random(4000) < 0.5, T + rng.exponential(30, 4000), np.nan)
    z[::8] = T + 1.0  # none without a detection
    data, windows = Looks.of(z, alpha, T), Windows.groups(np.full(500, 8))
    found = ml.fit(data, windows, CASES["3"])
    grid = np.exp(np.linspace(math.log(1e-5), math.log(1e4), 1500))
    many = windows.take(np.repeat(np.arange(500), 1500))
    value = ml.log_likelihood(data, many, CASES["3"], np.tile(grid, 500))[0].reshape(500, 1500)
    assert np.all(found.value >= value.max(axis=1) - 1e-9)
    turns = ((value[:, 1:-1] > value[:, :-2]) & (value[:, 1:-1] > value[:, 2:])).sum(axis=1)
    assert np.count_nonzero(turns > 1) >= 5  # the point of the test


@pytest.mark.parametrize("case", ["1", "3"])
def test_the_quick_ml_b_takes_the_steps_of_the_plain_one(case):
    """Estimate, number of steps and reason of 300 windows, the paper's stop and a strict one."""
    rng = np.random.default_rng(5)
    data, windows = drawn(case, 300, 8, 8.0 * 10.0 ** rng.uniform(-0.4, 0.4, 2400), seed=6)
    for absolute, relative in ((1e-3, 0.0), (0.0, 1e-5)):
        quick = iterate(data, windows, CASES[case], "ml-b", absolute=absolute, relative=relative)
        plain = iterate_together(data, windows, CASES[case], "ml-b", np.zeros(300), absolute, relative)
        np.testing.assert_allclose(quick[0], plain[0], rtol=1e-6)
        assert np.mean((quick[1] == plain[1]) & (quick[2] == plain[2])) > 0.98  # the guard may turn on the last bit


@pytest.mark.parametrize(
    ("case", "spread_db", "rms_db"), [("1", 10.0, 0.18), ("3", 10.0, 0.21), ("1", 20.0, 0.42), ("3", 20.0, 0.46)]
)
def test_eq_15_is_not_the_maximum_when_alpha_varies(case, spread_db, rms_db):
    """Its fixed point lies 0.2 to 0.5 dB (rms) from the maximum; with equal alpha of Swerling 1 it is the maximum."""
    rng = np.random.default_rng(7)
    alpha = 16.0 * 10.0 ** (0.1 * rng.uniform(-spread_db / 2, spread_db / 2, 15_000))
    data, windows = drawn(case, 1500, 10, alpha, seed=8)
    s = ml.maximum_likelihood(data, windows, CASES[case])
    fixed = _fixed_point(data, CASES[case].shape, 1500)
    some = (s > 0) & (fixed > 0)
    assert np.sqrt(np.mean((10 * np.log10(fixed[some] / s[some])) ** 2)) == pytest.approx(rms_db, rel=0.25)
    if case == "1" and spread_db == 10.0:
        data, windows = drawn("1", 500, 10, 16.0, seed=9)
        s = ml.maximum_likelihood(data, windows, CASES["1"])
        np.testing.assert_allclose(_fixed_point(data, 1.0, 500), s, rtol=1e-9)


def _fixed_point(data, k, count):
    """Eq. 15 iterated 40 times without a guard, E[z | miss] by 24-point Gauss-Legendre."""
    z, alpha = (a.reshape(count, -1) for a in (data.z, data.alpha))
    missed = data.kind.reshape(count, -1) == MISS
    nodes, weights = np.polynomial.legendre.leggauss(24)
    y = 0.5 * T * (nodes + 1)
    s = np.maximum(np.where(missed, 0, (z - 1) / alpha).mean(axis=1), 0.0)
    for _ in range(40):
        snr = (alpha * s[:, None])[..., None]
        f = np.exp(-y / (1 + snr)) if k == 1 else (snr * (y + 1) + 2) * np.exp(-2 * y / (2 + snr))
        level = (f * weights * y).sum(axis=-1) / (f * weights).sum(axis=-1)
        s = np.where(missed, (level - 1) / alpha, (z - 1) / alpha).mean(axis=1)
    return np.where(missed.all(axis=1), 0.0, s)


@pytest.mark.parametrize("kind", ["detection", "miss"])
@pytest.mark.parametrize("case", ["1", "3"])
def test_a_look_at_one_of_many_cells_is_the_distribution_of_the_strongest(kind, case):
    """m gate cells, m - 1 with noise alone: the density is the derivative of the product of distributions; m = 1 is plain."""
    m, s, shape = 50.0, 6.0, CASES[case].shape

    def below(z):
        return math.exp(look_terms(MISS, 0.0, z, 1, s, shape, 1.0)[0]) * (-math.expm1(-z)) ** (m - 1)

    if kind == "miss":
        assert math.exp(look_terms(0, 0.0, T, 1, s, shape, m)[0]) == pytest.approx(below(T), rel=1e-12)
        assert look_terms(0, 0.0, T, 1, s, shape, 1.0)[0] == pytest.approx(
            math.log(below(T)) - (m - 1) * math.log(0.999)
        )
    else:
        for z in (8.0, 15.0, 40.0):
            slope = (below(z + 1e-4) - below(z - 1e-4)) / 2e-4
            assert math.exp(look_terms(1, z, T, 1, s, shape, m)[0]) == pytest.approx(slope, rel=1e-5)


@pytest.mark.parametrize(
    ("snr", "cells", "mean"), [(8.0, 100, 1.02), (8.0, 500, 1.11), (4.0, 100, 1.08), (4.0, 500, 1.41), (2.0, 500, 2.2)]
)
def test_false_alarms_left_out_raise_the_rcs(snr, cells, mean):
    """Swerling 3 of 1 m^2, ten looks, false-alarm probability 1e-3: the mean estimate that takes all hits as the target."""
    mixed, windows = drawn("3", 6000, 10, snr, seed=11, cells=float(cells))
    ignored = Looks(mixed.kind, mixed.z, mixed.threshold, mixed.alpha, mixed.pulses)
    assert np.mean(ml.maximum_likelihood(ignored, windows, CASES["3"])) == pytest.approx(mean, abs=0.03)


@pytest.mark.slow
def test_the_mixture_takes_the_bias_off():
    """SNR 4, 500 cells: from 41 % to within a few percent of what the target alone gives."""
    mixed, windows = drawn("3", 1500, 10, 4.0, seed=11, cells=500.0)
    clean, _ = drawn("3", 1500, 10, 4.0, seed=12)
    own = np.mean(ml.maximum_likelihood(clean, windows, CASES["3"]))
    assert np.mean(ml.maximum_likelihood(mixed, windows, CASES["3"])) == pytest.approx(own, abs=0.08)


def test_widths_of_ten_looks():
    """SNR 16: the 95 % interval is typically 4.3 dB wide for Swerling 3 and 5.7 dB for Swerling 1."""
    for case, width in (("3", 4.3), ("1", 5.7)):
        data, windows = drawn(case, 2000, 10, 16.0, seed=13)
        low, high = ml.profile_interval(data, windows, CASES[case], ml.fit(data, windows, CASES[case]))
        assert np.median(10 * np.log10(high / low)) == pytest.approx(width, abs=0.15)


def test_a_credible_interval_is_the_quantiles_of_the_posterior():
    """Nothing detected in ten looks, prior 1 / (s + 1/8): quantiles by adaptive quadrature."""
    data = Looks.of(np.full(10, np.nan), 8.0, T)
    found = credible_interval(data, Windows.whole(data), CASES["1"])

    def mass(s):
        return quad(lambda x: (-math.expm1(-T / (1 + 8 * x))) ** 10 / (x + 0.125), 0, s, limit=200)[0]

    total = mass(1.0) + quad(lambda x: (-math.expm1(-T / (1 + 8 * x))) ** 10 / (x + 0.125), 1, 60)[0]
    for end, share in zip(found, (0.025, 0.5, 0.975), strict=True):
        assert end[0] == pytest.approx(brentq(lambda s, p=share: mass(s) - p * total, 1e-6, 3), rel=1e-4)
    assert np.isnan(credible_interval(data, Windows.whole(data), CASES["1"], prior="log")[0][0])


def test_the_three_intervals_agree_where_looks_are_many():
    """300 looks: bootstrap and credible ends within a tenth of the profile interval's width."""
    data, windows = drawn("3", 1, 300, 16.0, seed=14)
    found = ml.fit(data, windows, CASES["3"])
    low, high = ml.profile_interval(data, windows, CASES["3"], found)
    width = high[0] - low[0]
    again = bootstrap_interval(data, windows, CASES["3"], found.s, 2000, np.random.default_rng(1))
    belief = credible_interval(data, windows, CASES["3"])
    for ends in (again, (belief[0], belief[2])):
        assert ends[0][0] == pytest.approx(low[0], abs=0.1 * width)
        assert ends[1][0] == pytest.approx(high[0], abs=0.1 * width)


def test_bootstrap_p_values_have_their_size_and_tabled_ones_do_not():
    """1,500 windows of the right model: about 5 % below 0.05; the tabled KS point would reject about 1 % or fewer."""
    data, windows = drawn("3", 1500, 15, 16.0, seed=15)
    s = ml.maximum_likelihood(data, windows, CASES["3"])
    p = bootstrap(data, windows, CASES["3"], s, 199, np.random.default_rng(2))
    for values in (p.ks, p.ad):
        assert 0.035 <= np.mean(values <= 0.05) <= 0.07
    assert np.mean(p.count <= 0.05) <= 0.07
    m = measures(data, windows, CASES["3"], s)
    held = np.add.reduceat((data.kind > 0).astype(int), windows.first)
    assert np.mean(np.sqrt(held) * m.ks > 1.358) < 0.02
    assert np.quantile(np.sqrt(held) * m.ks, 0.95) == pytest.approx(1.1, abs=0.1)  # 1.03 to 1.17
    assert np.quantile(m.ad, 0.95) == pytest.approx(1.46, abs=0.25)  # 1.29 to 1.64


def test_a_wrong_model_fails_its_tests_of_fit():
    """A steady target fitted as Swerling 1: the amplitudes are far too alike."""
    data, windows = drawn("0", 1, 120, 12.0, seed=16)
    s = ml.maximum_likelihood(data, windows, CASES["1"])
    p = bootstrap(data, windows, CASES["1"], s, 199, np.random.default_rng(3))
    assert p.ad[0] <= 0.01


def test_kolmogorov_and_anderson_are_scipys():
    """The distances of one window's u from uniform."""
    data, windows = drawn("3", 3, 40, 16.0, seed=17)
    m = measures(data, windows, CASES["3"], np.ones(3))
    for i in range(3):
        u = m.u[windows.first[i] : windows.last[i]]
        u = np.sort(u[np.isfinite(u)])
        n = len(u)
        assert m.ks[i] == pytest.approx(kstest(u, "uniform").statistic, rel=1e-12)
        k = np.arange(1, n + 1)
        assert m.ad[i] == pytest.approx(-n - np.mean((2 * k - 1) * (np.log(u) + np.log(1 - u[::-1]))), rel=1e-10)


def test_the_case_is_told_with_enough_looks_only():
    """Power for 1 against 3 at SNR 16: about 57 % of windows of 10, 96 % of 100; no verdict below 60 looks."""
    for length, least in ((10, 0.57), (100, 0.96)):
        right = []
        for truth in ("1", "3"):
            data, windows = drawn(truth, 600, length, 16.0, seed=18)
            value = {c: ml.fit(data, windows, CASES[c]).value for c in ("1", "3")}
            other = "3" if truth == "1" else "1"
            right.append(np.mean(value[truth] > value[other]))
        assert min(right) == pytest.approx(least, abs=0.05)
    data, windows = drawn("3", 1, 40, 16.0)
    assert not choose(data, windows, (CASES["1"], CASES["3"])).decided
    assert "too few" in choose(data, windows, (CASES["1"], CASES["3"])).sentence


def test_a_free_shape_is_found_with_its_interval():
    """400 looks of shape 2 in four windows: K within its interval, and no worse than K = 1, 2 or steady."""
    data, windows = drawn("3", 4, 100, 16.0, seed=19)
    shape = free_shape(data, windows)
    assert shape.low < 2.0 < shape.high
    for k in (1.0, 2.0, math.inf):
        assert shape.value >= ml.fit(data, windows, Case("k", k)).value.sum() - 1e-6
    assert shape.aic == pytest.approx(2 * 5 - 2 * shape.value)
    spread = math.log(shape.high / shape.low) / 3.92
    assert spread == pytest.approx(2.0 / math.sqrt(400), rel=0.4)  # sigma(ln K) = c / sqrt(W), c = 2.0 at SNR 16


def test_a_steady_targets_shape_has_no_upper_end():
    """Nothing bounds K above."""
    data, windows = drawn("0", 1, 150, 12.0, seed=20)
    assert free_shape(data, windows).high == math.inf


def test_homogeneity_has_its_size_and_sees_a_change():
    """One RCS in four bins: p below 5 % in about 5 % of trials; one bin 6 dB up: nearly always."""
    small, seen = 0, 0
    for seed in range(200):
        data, windows = drawn("3", 4, 30, 16.0, seed=100 + seed)
        small += homogeneity(data, windows, CASES["3"], ml.fit(data, windows, CASES["3"])).p_value < 0.05
        if seed < 20:
            plain = Looks.of(np.full(120, np.nan), 16.0, T)
            other = simulate(plain, windows, CASES["3"], np.array([1.0, 1.0, 1.0, 4.0]), np.random.default_rng(seed))
            seen += homogeneity(other, windows, CASES["3"], ml.fit(other, windows, CASES["3"])).p_value < 0.01
    assert 3 <= small <= 20
    assert seen >= 19
    test = homogeneity(other, windows, CASES["3"], ml.fit(other, windows, CASES["3"]))
    assert test.degrees == 3
    assert test.p_value == pytest.approx(chi2.sf(test.statistic, 3), rel=1e-9)


def test_looks_that_follow_each_other_are_noticed():
    """Normal scores of a first-order chain: the correlation is found; without pairs there is none."""
    rng = np.random.default_rng(21)
    x = np.zeros(3000)
    for i in range(1, 3000):
        x[i] = 0.6 * x[i - 1] + 0.8 * rng.normal()
    rho, pairs = lag_one(ndtr(x))
    assert (rho, pairs) == (pytest.approx(0.6, abs=0.04), 2999)
    assert math.isnan(lag_one(np.array([0.2, np.nan] * 20))[0])


def test_average_linear_values_then_decibels():
    """The mean of dB lies 2.51 dB (1) and 1.17 dB (3) below the dB of the mean, the median 1.59 and 0.76 dB."""
    rng = np.random.default_rng(22)
    for case, mean, median, spread in (("1", 2.51, 1.59, 5.57), ("3", 1.17, 0.76, 3.49)):
        k = CASES[case].shape
        db = 10 * np.log10(rng.gamma(k, 1 / k, 400_000))
        assert -np.mean(db) == pytest.approx(mean, abs=0.03)
        assert -np.median(db) == pytest.approx(median, abs=0.03)
        assert np.std(db) == pytest.approx(spread, abs=0.03)


@pytest.mark.parametrize(("case", "shares"), [("3", (0.53, 0.78, 0.92, 0.98)), ("1", (0.46, 0.67, 0.81, 0.90))])
def test_the_papers_detection_probabilities(case, shares):
    """Its tables 2 and 3: SNR 8, 16, 32, 64 at false-alarm probability 1e-3."""
    found = pd.detection_probability([8.0, 16.0, 32.0, 64.0], T, CASES[case])
    np.testing.assert_allclose(found, shares, atol=0.0051)


def test_med_by_hand():
    """A miss: 0.5 dB down. Five hits far above: 0.5 dB up, or in one look to within 1 dB of their median."""
    z = [math.nan, *[101.0] * 5]
    data = Looks.of(z, 10.0, T)
    plain = 10 * np.log10(median_rule(data))
    start = 10 * math.log10(1.5)
    np.testing.assert_allclose(plain, [start - 0.5] * 5 + [start], atol=1e-12)
    near = 10 * np.log10(median_rule(data, until_near=True))
    assert 9.0 - 1e-9 <= near[-1] < 9.5
    assert (near[-1] - plain[0]) / 0.5 == pytest.approx(round((near[-1] - plain[0]) / 0.5))
    every = median_rule(Looks.of([*z, math.nan], 10.0, T), every_scan=True)
    np.testing.assert_allclose(10 * np.log10(every[-1]), start, atol=1e-12)  # down for the miss, up for the median
    raw = 10 * np.log10(median_rule(data, until_near=True, subtract_noise=False)[-1])
    assert raw >= near[-1]
