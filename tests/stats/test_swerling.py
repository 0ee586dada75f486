"""Swerling statistics against the likelihood written out, against Monte Carlo, and against closed forms."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize_scalar
from scipy.special import gammainc, gammaincc, gammaln
from scipy.stats import gamma, poisson

from rangeeval.stats.swerling import CASES, Looks, Windows
from rangeeval.stats.swerling import detection as pd
from rangeeval.stats.swerling import likelihood as ml
from rangeeval.stats.swerling.paper import iterate

T = -math.log(1e-3)


def shape_of(case, n):
    return {"0": math.inf, "1": 1.0, "2": float(n), "3": 2.0, "4": 2.0 * n}[case]


def density(z, snr, n, k):
    """Density of the sum of n pulses: noise plus a gamma (shape k) or constant signal, as a Poisson mixture."""
    j = np.arange(0, 4000)
    total = n * snr
    weight = poisson.pmf(j, total) if math.isinf(k) else np.exp(
        gammaln(j + k) - gammaln(k) - gammaln(j + 1) + k * math.log(k / (k + total)) + j * math.log(total / (k + total))
    )  # fmt: skip
    return float(weight @ gamma.pdf(z, n + j)), float(weight @ gammainc(n + j, T))


@pytest.mark.parametrize("case", list(CASES))
@pytest.mark.parametrize("n", [1, 4])
def test_detection_probability_is_that_of_the_poisson_mixture(case, n):
    """Every case, one pulse and four, at several SNR; at SNR zero it is the false-alarm probability."""
    for snr in (0.5, 3.0, 20.0):
        found = float(pd.detection_probability(snr, T, CASES[case], n))
        assert found == pytest.approx(1.0 - density(1.0, snr, n, shape_of(case, n))[1], rel=1e-6)
    assert float(pd.detection_probability(0.0, T, CASES[case], n)) == pytest.approx(float(gammaincc(n, T)), rel=1e-9)


def test_the_closed_forms_of_one_pulse():
    """Swerling 1: exp(-T / (1 + S)); Swerling 3: (1 + T / (1 + S/2)^2 S/2) exp(-T / (1 + S/2))."""
    s = np.array([0.1, 1.0, 10.0, 100.0])
    np.testing.assert_allclose(pd.detection_probability(s, T, CASES["1"]), np.exp(-T / (1 + s)), rtol=1e-12)
    half = s / 2
    three = (1 + half * T / (1 + half) ** 2) * np.exp(-T / (1 + half))
    np.testing.assert_allclose(pd.detection_probability(s, T, CASES["3"]), three, rtol=1e-10)


def looks(case, seed, count=12, n=1):
    """Looks at a target of 2 m^2 with unequal alpha, missed below the threshold."""
    rng = np.random.default_rng(seed)
    alpha = rng.uniform(2.0, 8.0, count)
    k = shape_of(case, n)
    signal = 2.0 * alpha * n * (1.0 if math.isinf(k) else rng.gamma(k, 1 / k, count))
    z = rng.gamma(n + rng.poisson(signal))
    return Looks.of(np.where(z > T, z, np.nan), alpha, T, pulses=n)


@pytest.mark.parametrize("case", list(CASES))
@pytest.mark.parametrize("n", [1, 3])
@pytest.mark.parametrize("seed", [1, 2])
def test_maximum_likelihood_is_the_maximum_of_the_likelihood_written_out(case, n, seed):
    """Detections by their density, misses by the probability to be below the threshold; scipy finds the same maximum."""
    data = looks(case, seed, n=n)
    k = shape_of(case, n)

    def cost(u):
        terms = [
            density(z if math.isfinite(z) else 1.0, math.exp(u) * a, n, k)
            for z, a in zip(data.z, data.alpha, strict=True)
        ]
        return -sum(math.log(d) if kind == 1 else math.log(m) for (d, m), kind in zip(terms, data.kind, strict=True))

    found = ml.fit(data, Windows.whole(data), CASES[case])
    best = minimize_scalar(cost, bounds=(-4, 4), method="bounded", options={"xatol": 1e-9})
    assert found.s[0] == pytest.approx(math.exp(best.x), rel=1e-5)
    low, high = ml.profile_interval(data, Windows.whole(data), CASES[case], found)
    for end in (low[0], high[0]):  # 2 (max - lnL) is the 95 % point of chi-square with one degree of freedom
        assert 2 * (cost(math.log(end)) - best.fun) == pytest.approx(3.841459, abs=1e-4)


def test_windows_in_a_batch_are_what_they_are_alone():
    """Sliding windows together give, to the last bits, what each gives alone."""
    data = looks("3", 3, 60)
    windows = Windows.sliding(60, 10)
    together = ml.maximum_likelihood(data, windows, CASES["3"])
    for i in range(len(windows)):
        rows = slice(int(windows.first[i]), int(windows.last[i]))
        part = data.take(rows)
        alone = ml.maximum_likelihood(part, Windows.whole(part), CASES["3"])
        assert together[i] == pytest.approx(alone[0], rel=1e-9)


def test_nothing_detected_is_zero_with_an_exact_upper_limit():
    """Swerling 1, equal alpha, ten misses: at the limit the probability of ten misses is 5 %."""
    data = Looks.of(np.full(10, np.nan), 4.0, T)
    found = ml.fit(data, Windows.whole(data), CASES["1"])
    assert found.s[0] == 0.0
    _, high = ml.profile_interval(data, Windows.whole(data), CASES["1"], found)
    miss = 1.0 - math.exp(-T / (1.0 + 4.0 * high[0]))
    assert miss**10 == pytest.approx(0.05, rel=1e-6)


def test_ignoring_misses_makes_the_target_larger():
    """With the misses left out the estimate is high, the more so the weaker the target."""
    data = looks("1", 5, 400)
    whole = ml.maximum_likelihood(data, Windows.whole(data), CASES["1"])[0]
    seen = data.take(data.kind == 1)
    assert whole == pytest.approx(2.0, rel=0.15)
    assert ml.maximum_likelihood(seen, Windows.whole(seen), CASES["1"])[0] < np.mean((seen.z - 1) / seen.alpha)


def test_the_papers_em_converges_to_the_maximum():
    """EM-A, run to the end, finds what the exact maximisation finds (Swerling 3)."""
    data = looks("3", 7)
    s, _, _ = iterate(data, Windows.whole(data), CASES["3"], "em-a", relative=1e-10)
    assert s[0] == pytest.approx(ml.maximum_likelihood(data, Windows.whole(data), CASES["3"])[0], rel=1e-5)


def test_information_is_the_mean_square_of_the_score():
    """Swerling 1, one look: E[(d lnL / d ln s)^2] by quadrature, the miss counted."""
    snr = 8.0
    data = Looks.of([np.nan], snr, T)
    found = pd.information(data, CASES["1"], 1.0)
    share = snr / (1 + snr)
    seen, _ = quad(lambda z: (share * (z / (1 + snr) - 1)) ** 2 * math.exp(-z / (1 + snr)) / (1 + snr), T, 400)
    p = math.exp(-T / (1 + snr))
    slope = p * T * snr / (1 + snr) ** 2
    assert found == pytest.approx(seen + slope**2 / (1 - p), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["1", "3"])
def test_profile_intervals_cover(case):
    """Of 2,000 windows of 25 looks the 95 % interval holds the true mean RCS in 93.5 to 96.5 %."""
    held = 0
    for seed in range(2000):
        data = looks(case, 10_000 + seed, 25)
        found = ml.fit(data, Windows.whole(data), CASES[case])
        low, high = ml.profile_interval(data, Windows.whole(data), CASES[case], found)
        held += low[0] <= 2.0 <= high[0]
    assert 0.935 <= held / 2000 <= 0.965
