import numpy as np
import pytest
from scipy import signal

from rangeeval.stats.spectrum import CrossSpectra, frequency_error, segment_size, sine_fit, spectral_peak


def test_the_peak_of_a_sine_is_found_between_the_lines():
    """Frequencies that no line of the transform hits come back to a ten-thousandth of a hertz from 60 s."""
    t = np.arange(600) * 0.1
    for f in (0.3071, 0.83, 2.2222):
        assert spectral_peak(3.0 + np.sin(2 * np.pi * f * t + 1), 0.1) == pytest.approx(f, abs=1e-4)


def test_limits_and_degenerate_records():
    """A limit leaves out a stronger line below it; constants and handfuls of samples have no peak."""
    t = np.arange(2000) * 0.01
    x = 5 * np.sin(2 * np.pi * 0.5 * t) + np.sin(2 * np.pi * 8 * t)
    assert spectral_peak(x, 0.01, low_hz=2.0) == pytest.approx(8.0, abs=1e-2)
    assert spectral_peak(x, 0.01, high_hz=3.0) == pytest.approx(0.5, abs=1e-2)
    assert np.isnan(spectral_peak(np.ones(100), 0.1))
    assert np.isnan(spectral_peak(t[:5], 0.1))


def test_a_sine_fit_is_exact_and_says_how_sure_it_is():
    """Exact without noise, at uneven times and across a gap; under noise the errors are those of 400 repeated records."""
    rng = np.random.default_rng(1)
    t = np.sort(rng.uniform(1000.0, 1100.0, 700))
    t = t[(t < 1030) | (t > 1060)]
    clean = 0.3 + 0.05 * np.sin(2 * np.pi * 0.83 * t + 0.4)
    fit = sine_fit(t, clean, 0.83)
    assert (fit.offset, fit.amplitude, fit.phase) == pytest.approx((0.3, 0.05, 0.4), abs=1e-10)
    found = [sine_fit(t, clean + 0.02 * rng.standard_normal(t.size), 0.83) for _ in range(400)]
    assert np.std([x.offset for x in found]) == pytest.approx(found[0].offset_error, rel=0.12)
    assert np.std([x.amplitude for x in found]) == pytest.approx(found[0].amplitude_error, rel=0.12)
    with pytest.raises(ValueError, match="three parameters"):
        sine_fit([0, 1], [0, 1], 1.0)


def test_the_peaks_standard_error_is_what_repeated_records_scatter():
    """Over 400 noisy records the found frequency scatters by the error given, within a tenth."""
    rng = np.random.default_rng(2)
    t = np.arange(500) * 0.1
    found = [
        spectral_peak(np.sin(2 * np.pi * 0.8 * t + p) + 0.5 * rng.standard_normal(500), 0.1)
        for p in rng.uniform(0, 6, 400)
    ]
    assert np.std(found) == pytest.approx(frequency_error(1.0, 0.5, 500, 0.1), rel=0.12)


def test_densities_are_those_of_welch_in_any_pieces():
    """The density of a channel and of a weighted sum is scipy's, whether added at once or in pieces."""
    rng = np.random.default_rng(3)
    x = rng.standard_normal((2, 5000))
    x[1] += 0.5 * x[0]
    whole, parts = CrossSpectra(2, 256, 0.02), CrossSpectra(2, 256, 0.02)
    whole.add(x)
    for piece in np.split(x, [100, 130, 2111], axis=1):
        parts.add(piece)
    weights = np.array([2.0, -1.0])
    _, expected = signal.welch(weights @ x, 50.0, "hann", 256)
    assert whole.density(weights) == pytest.approx(expected, rel=1e-10)
    assert parts.density(weights) == pytest.approx(whole.density(weights), rel=1e-10)
    _, coherence = signal.coherence(*x, 50.0, "hann", 256)
    assert whole.coherence(0, 1) == pytest.approx(coherence, abs=1e-10)


def test_a_missing_sample_and_the_end_of_a_stretch_cost_their_segments():
    """No segment holds a missing sample or reaches across a break."""
    x = np.random.default_rng(4).standard_normal((1, 1024))
    broken = x.copy()
    broken[0, 500] = np.nan
    spectra = CrossSpectra(1, 128, 1.0)
    spectra.add(broken)
    assert spectra.segments == 13
    assert np.isfinite(spectra.density([1.0])).all()
    apart = CrossSpectra(1, 128, 1.0)
    apart.add(x[:, :100])
    apart.end()
    apart.add(x[:, 100:200])
    assert apart.segments == 0
    assert np.isnan(apart.density([1.0])).all()


def test_the_floor_is_the_noise_under_an_oscillation():
    """sigma per sample comes back from the floor while a sine ten times as strong stands in it, within its interval's reach."""
    rng = np.random.default_rng(5)
    t = np.arange(4000) * 0.1
    spectra = CrossSpectra(1, segment_size(4000), 0.1)
    spectra.add((3 * np.sin(2 * np.pi * 0.8 * t) + 0.3 * rng.standard_normal(4000))[None])
    level, freedom = spectra.floor([1.0])
    assert np.sqrt(level / 0.2) == pytest.approx(0.3, rel=4 / np.sqrt(2 * freedom))
