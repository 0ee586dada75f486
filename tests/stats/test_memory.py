"""n_eff and the variance of a mean, estimated from the samples themselves: right on average, and intervals that cover."""

import numpy as np
import pytest
from scipy import special
from scipy.signal import lfilter

from rangeeval.stats import correlation as co
from rangeeval.stats.intervals import sigma_interval


def series(rng, correlation, legs, length):
    """`legs` independent stretches of AR(1) with unit variance, one after another, and the stretch of each sample."""
    white = rng.standard_normal((legs, length + 60)) * np.sqrt(1 - correlation**2)
    x = lfilter([1.0], [1.0, -correlation], white)[:, 60:]
    return x.ravel(), np.repeat(np.arange(legs), length)


def sums_of(x, stretch, lags=40):
    """Its lag sums."""
    return co.lag_sums(x, min(lags, x.size - 1), stretch, origin=float(x.mean()))


def in_theory(correlation, legs, length):
    """Effective numbers for variance and mean: Bartlett's sums over the pairs that such stretches hold."""
    k = np.arange(1, length)
    pairs = legs * (length - k) / (legs * length)
    rho = correlation**k
    return legs * length / (1 + 2 * np.sum(pairs * rho**2)), 1 + 2 * np.sum(pairs * rho)


def test_white_samples_all_count():
    """The typical n_eff of 150 white samples is 150; squares of estimated correlations, taken as they are, make it 118."""
    rng = np.random.default_rng(0)
    data = [series(rng, 0.0, 1, 150) for _ in range(200)]
    assert np.median([co.effective_samples_of(x) for x, _ in data]) == pytest.approx(150, rel=0.01)
    plain = [co.effective_samples(co.autocorrelation(x), 150) for x, _ in data]
    assert np.median(plain) < 125


@pytest.mark.parametrize(
    ("correlation", "legs", "length"), [(0.6, 40, 4), (0.8, 15, 10), (0.6, 1, 400), (-0.5, 20, 10)]
)
def test_memory_is_seen_in_short_stretches_too(correlation, legs, length):
    """The typical n_eff is at most that of theory, and at most 20 % below (it leans to the safe side)."""
    rng = np.random.default_rng(1)
    found = [co.effective_samples_of(*series(rng, correlation, legs, length)) for _ in range(200)]
    expected = in_theory(correlation, legs, length)[0]
    assert 0.8 * expected < np.median(found) < 1.03 * expected


def test_memory_beyond_the_lags_is_extrapolated():
    """Oscillations that outlive 40 updates: n_eff is that of the whole stretches (within 30 %), not of 40 lags."""
    rng = np.random.default_rng(2)
    found = []
    for _ in range(60):
        x, stretch = series(rng, -0.995, 6, 100)
        found.append(co.effective_samples_of(x, stretch))
    assert np.median(found) == pytest.approx(in_theory(-0.995, 6, 100)[0], rel=0.3)


@pytest.mark.parametrize(("correlation", "legs", "length"), [(0.0, 1, 300), (0.5, 1, 600), (0.5, 60, 5), (-0.4, 60, 5)])
def test_the_variance_of_a_mean_is_found(correlation, legs, length):
    """The typical inflation is that of theory within 8 %, in one stretch and in many short ones."""
    rng = np.random.default_rng(3)
    found = [co.mean_memory(sums_of(*series(rng, correlation, legs, length))).inflation for _ in range(200)]
    assert np.median(found) == pytest.approx(in_theory(correlation, legs, length)[1], rel=0.08)


def test_a_borrowed_correlation_is_that_of_the_lender():
    """Twenty samples that borrow from 4000 count as theory says for twenty of that correlation, within 10 %."""
    rng = np.random.default_rng(4)
    x, stretch = series(rng, 0.7, 40, 100)
    few = sums_of(*series(rng, 0.7, 1, 20)).standardised()
    known = sums_of(x, stretch).standardised()
    lags = np.arange(co.default_lags(20) + 1)
    expected = co.effective_samples(0.7**lags, 20)
    pairs = known.pairs[: few.pairs.size]
    lender = co.LagSums(0.0, 100, pairs, known.products[: few.pairs.size], *np.zeros((2, few.pairs.size)))
    assert co.effective_samples_from(few, lender) == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("x", [np.ones(50), np.ones(1), np.zeros(0), np.array([1.0, 2.0])])
def test_too_little_to_tell_is_no_exception(x):
    """Constant, single, no and two samples: missing or the number itself, never an error."""
    found = co.effective_samples_of(x)
    assert np.isnan(found) or found == x.size
    memory = co.mean_memory(co.lag_sums(x, 1))
    assert memory.inflation == 1.0
    assert memory.dof >= 1.0


def covered(correlation, legs, length, runs, seed):
    """Shares of 95 % intervals that hold the true sigma and the true mean."""
    rng = np.random.default_rng(seed)
    held = np.zeros(2)
    for _ in range(runs):
        x, stretch = series(rng, correlation, legs, length)
        sums, s = sums_of(x, stretch), x.std(ddof=1)
        low, high = sigma_interval(s, co.effective_samples_from(sums) - 1.0)
        memory = co.mean_memory(sums)
        half = special.stdtrit(memory.dof, 0.975) * s * np.sqrt(memory.inflation / x.size)
        held += low <= 1.0 <= high, abs(x.mean()) <= half
    return held / runs


def test_intervals_cover_with_memory():
    """At correlation 0.3 and 150 samples, where the mean's interval used to cover 92 %: 93 to 97.5 % of 1000 each."""
    sigma, mean = covered(0.3, 1, 150, 1000, 5)
    assert 0.93 < sigma < 0.97
    assert 0.93 < mean < 0.975


@pytest.mark.slow
@pytest.mark.parametrize(("legs", "length"), [(1, 150), (1, 600), (15, 10), (40, 4)])
@pytest.mark.parametrize("correlation", [-0.4, 0.0, 0.3, 0.6])
def test_intervals_cover_in_every_regime(correlation, legs, length):
    """Of 4000 trials each, 93.5 to 96.5 % for sigma; at least 93.5 % for the mean, which may err to the wide side."""
    sigma, mean = covered(correlation, legs, length, 4000, 6)
    assert 0.935 < sigma < 0.965
    assert 0.935 < mean < 0.985
