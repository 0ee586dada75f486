"""Swerling statistics against the likelihood written out, against Monte Carlo, and against closed forms."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize_scalar
from scipy.special import gammainc, gammaincc, gammaln
from scipy.stats import gamma, poisson

from rangeeval.stats.swerling import CASES, HIT, MISS, SATURATED, Looks, Windows
from rangeeval.stats.swerling import detection as pd
from rangeeval.stats.swerling import likelihood as ml
from rangeeval.stats.swerling.fitness import simulate
from rangeeval.stats.swerling.paper import REASONS, iterate
from rangeeval.stats.swerling.terms import level_below

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


def drawn(case, count, length, alpha, s=1.0, seed=1):
    """Windows of looks at a target of `s` m^2, drawn by the tool itself."""
    size = count * length
    plain = Looks.of(np.full(size, np.nan), np.resize(np.asarray(alpha, np.float64), size), T)
    windows = Windows.groups(np.full(count, length))
    return simulate(plain, windows, CASES[case], np.full(count, s), np.random.default_rng(seed)), windows


@pytest.mark.parametrize("case", list(CASES))
def test_looks_drawn_pulse_by_pulse_are_detected_as_often_as_predicted(case):
    """Four pulses, each noise plus an echo that fluctuates as its case says; 5 standard errors."""
    rng, n, snr, size = np.random.default_rng(4), 4, 1.5, 200_000
    shape = {"0": None, "1": 1, "2": 1, "3": 2, "4": 2}[case]
    per_pulse = case in "24"
    level = np.ones((size, n)) if shape is None else rng.gamma(shape, 1 / shape, (size, n if per_pulse else 1))
    noise = rng.standard_normal((size, n)) + 1j * rng.standard_normal((size, n))
    z = np.sum(np.abs(np.sqrt(snr * level) + noise / math.sqrt(2)) ** 2, axis=1)
    threshold = float(pd.threshold_of(1e-3, n))
    p = float(pd.detection_probability(snr, threshold, CASES[case], n))
    assert np.mean(z >= threshold) == pytest.approx(p, abs=5 * math.sqrt(p * (1 - p) / size))


@pytest.mark.parametrize(("case", "limit"), [("3", 0.5079443656968958), ("1", 0.5139223954145032)])
def test_ten_misses_at_snr_8_bound_the_target_exactly(case, limit):
    """One-sided 95 %: 0.508 m^2 (Swerling 3), 0.514 m^2 (1); the likelihood ratio's 0.315 and 0.294 would be too small."""
    data = Looks.of(np.full(10, np.nan), 8.0, T)
    found = ml.fit(data, Windows.whole(data), CASES[case])
    low, high = ml.profile_interval(data, Windows.whole(data), CASES[case], found)
    assert (low[0], found.s[0]) == (0.0, 0.0)
    assert high[0] == pytest.approx(limit, rel=1e-8)
    assert found.value[0] == pytest.approx(10 * math.log1p(-1e-3), abs=1e-9)


@pytest.mark.parametrize(("z", "moments", "exact"), [(7.0, 6.0, 6.12), (200.0, 199.0, 199.005)])
def test_one_detection_of_swerling_3_is_not_its_moment_estimate(z, moments, exact):
    """Swerling 1 gives (z - 1) / alpha, Swerling 3 a little more."""
    data = Looks.of([z], 1.0, T)
    whole = Windows.whole(data)
    assert ml.maximum_likelihood(data, whole, CASES["1"])[0] == pytest.approx(moments, rel=1e-10)
    assert ml.maximum_likelihood(data, whole, CASES["3"])[0] == pytest.approx(exact, abs=0.005)


@pytest.mark.parametrize("kind", [HIT, SATURATED])
def test_nothing_but_hits_gives_a_lower_limit_only(kind):
    """No amplitude and no miss: the likelihood grows for ever, and at the limit all four are seen in 5 % of cases."""
    data = Looks.of(np.full(4, 9.0), 25.0, T, kind=np.full(4, kind))
    whole = Windows.whole(data)
    found = ml.fit(data, whole, CASES["1"])
    low, high = ml.profile_interval(data, whole, CASES["1"], found)
    assert (found.s[0], high[0]) == (math.inf, math.inf)
    assert math.exp(-(T if kind == HIT else 9.0) / (1 + 25 * low[0])) ** 4 == pytest.approx(0.05, rel=1e-6)


def test_detections_weaker_than_noise_put_the_maximum_at_zero():
    """A threshold below the noise: the score at zero is negative, the estimate 0."""
    data = Looks.of(np.full(20, 0.5), 3.0, 0.3)
    assert ml.maximum_likelihood(data, Windows.whole(data), CASES["1"])[0] == 0.0


@pytest.mark.parametrize("case", ["1", "3"])
def test_the_score_is_zero_at_the_maximum_with_a_threshold_for_each_look(case):
    """Equal and unequal alpha, thresholds from 1e-3 to 1e-6."""
    rng = np.random.default_rng(8)
    threshold = -np.log(10.0 ** -rng.uniform(3, 6, 30))
    for alpha in (np.full(30, 16.0), 10.0 ** rng.uniform(0, 2, 30)):
        z = rng.exponential(1 + alpha)
        data = Looks.of(np.where(z >= threshold, z, np.nan), alpha, threshold)
        found = ml.fit(data, Windows.whole(data), CASES[case])
        _, slope, bend = ml.log_likelihood(data, Windows.whole(data), CASES[case], found.s)
        assert abs(slope[0]) < 1e-8
        assert bend[0] < 0


@pytest.mark.parametrize(
    ("n", "threshold", "level"),
    [(1, 13.815510557964274, 13.68344468664457), (4, 21.350456963272137, 21.27231450612787),
     (10, 38.799007510528874, 38.73318290030475)],
)  # fmt: skip
def test_the_mean_of_a_miss_holds_where_a_miss_cannot_happen(n, threshold, level):
    """Swerling 0 at SNR 1000, P(miss) down to exp(-8825): the Poisson mixture summed with 80 digits."""
    assert level_below(threshold, n, 1000.0, math.inf) == pytest.approx(level, rel=1e-12)


def test_ml_b_depends_on_where_it_starts_and_ml_a_does_not():
    """Four starts, the paper's step of 1e-3: four results, two of them by the guard; ML-A is one number."""
    z = [
        10.845872685699772,
        29.967906799136998,
        9.537992493764028,
        17.695424346433654,
        14.0500704016118,
        7.787117369850156,
    ]
    data = Looks.of(z + [math.nan] * 9, 8.0, T)
    whole = Windows.whole(data)
    for start, s, steps, reason in (
        (0.2, 0.8881263502627366, 4, "guard"), (1.5, 0.8884985704001348, 4, "converged"),
        (5.0, 0.8885033822452918, 4, "converged"), (0.6990365341374701, 0.8877173362257238, 3, "guard"),
    ):  # fmt: skip
        found, taken, why = iterate(data, whole, CASES["3"], "ml-b", start=start, absolute=1e-3, relative=0)
        assert found[0] == pytest.approx(s, rel=1e-9)
        assert (taken[0], REASONS[why[0]]) == (steps, reason)
        assert ml.maximum_likelihood(data, whole, CASES["3"], near=start)[0] == pytest.approx(
            0.8859877159798017, rel=1e-8
        )


@pytest.mark.parametrize(("case", "snr", "bound"), [("1", 8.0, 0.3603896848182948), ("1", 64.0, 0.32118405507523906)])
def test_cramer_rao_of_ten_looks(case, snr, bound):
    """Standard deviation of 1 m^2 from ten looks, false-alarm probability 1e-3."""
    data = Looks.of(np.full(10, np.nan), snr, T)
    assert 1 / math.sqrt(pd.information(data, CASES[case], 1.0)) == pytest.approx(bound, rel=1e-7)


def test_weak_targets_leave_windows_empty_and_the_estimate_low():
    """SNR 2, ten looks: detected in 8.7 % of looks, 40 % of windows empty, mean estimate 0.76 (Swerling 3)."""
    data, windows = drawn("3", 20_000, 10, 2.0)
    s = ml.maximum_likelihood(data, windows, CASES["3"])
    assert np.mean(data.kind != MISS) == pytest.approx(0.087, abs=0.002)
    assert np.mean(s == 0) == pytest.approx(0.40, abs=0.015)
    assert np.mean(s) == pytest.approx(0.76, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["1", "3"])
@pytest.mark.parametrize(("length", "snr"), [(7, 16.0), (10, 8.0), (10, 16.0), (15, 32.0), (30, 64.0)])
def test_a_95_percent_interval_holds_the_truth_in_94_to_96_percent(case, length, snr):
    """20,000 windows each."""
    data, windows = drawn(case, 20_000, length, snr, seed=length)
    low, high = ml.profile_interval(data, windows, CASES[case], ml.fit(data, windows, CASES[case]))
    assert 0.94 <= np.mean((low <= 1.0) & (high >= 1.0)) <= 0.96
