import numpy as np
import pytest

from rangeeval.stats.allan import (
    BIAS_INSTABILITY,
    allan_deviation,
    allan_interval_freedom,
    averaging_lengths,
    steady_stretch,
)


def plain(x, m):
    """The definition, one running mean after the other."""
    means = np.array([x[j : j + m].mean() for j in range(x.size - m + 1)])
    return np.sqrt(np.mean((means[m:] - means[:-m]) ** 2) / 2)


def test_it_is_the_overlapping_definition():
    """Sums of the integrated series give what running means give, an offset far from zero included."""
    x = 1e6 + np.random.default_rng(1).standard_normal(400)
    lengths = [1, 2, 7, 50, 200]
    assert allan_deviation(x, lengths) == pytest.approx([plain(x, m) for m in lengths], rel=1e-8)


def test_white_noise_falls_with_the_root_and_a_ramp_rises():
    """White noise of sigma 1 gives m^-1/2; a drift of d a sample gives d m / sqrt(2)."""
    x = np.random.default_rng(2).standard_normal(400_000)
    m = np.array([1, 10, 100, 1000])
    assert allan_deviation(x, m) == pytest.approx(m**-0.5, rel=0.08)
    assert allan_deviation(0.5 * np.arange(1000.0), m[:3]) == pytest.approx(0.5 * m[:3] / np.sqrt(2))


def test_too_few_averages_are_missing():
    """Two averages are the least; lengths asked for leave nine."""
    assert np.isnan(allan_deviation(np.arange(5.0), [3, 0])).all()
    assert averaging_lengths(5).size == 0
    assert averaging_lengths(900).max() == 100
    assert pytest.approx(np.sqrt(2 * np.log(2) / np.pi), abs=5e-4) == BIAS_INSTABILITY


def test_degrees_of_freedom_are_the_scatter_of_repeated_records():
    """The variance of the Allan variance over 2000 white records is 2/nu of its square, within a tenth."""
    rng = np.random.default_rng(3)
    for m in (1, 8, 30):
        squares = np.array([allan_deviation(rng.standard_normal(300), [m])[0] ** 2 for _ in range(2000)])
        seen = 2 * squares.mean() ** 2 / squares.var()
        assert allan_interval_freedom(300, m) == pytest.approx(seen, rel=0.15)


def test_the_steady_stretch_is_the_longest_without_motion_or_gap():
    """Noise between two oscillations, broken by a missing sample: the longer side of the break, in whole windows."""
    x = np.random.default_rng(1).standard_normal(3000)
    x[:500] += 10 * np.sin(np.arange(500))
    x[2500:] += 10 * np.sin(np.arange(500))
    x[1010] = np.nan
    found = steady_stretch(x, 1.0, 50)
    assert (found.start, found.stop) == (1050, 2500)
    assert steady_stretch(x * 10, 1.0, 50) == slice(0, 0)
