import numpy as np
import pytest

from rangeeval.physics import measurement as ms
from rangeeval.tracking import alpha_beta as ab


def test_sigmas_follow_the_textbook_formulas():
    """At 20 dB and 1 MHz sigma_R is 10.6 m; at 20 dB a beam of 1.6 degrees gives 1/sqrt(200) degrees."""
    assert ms.range_sigma(20.0, 1e6) == pytest.approx(299792458 / 2e6 / np.sqrt(200), rel=1e-14)
    assert ms.angle_sigma(20.0, np.deg2rad(1.6)) == pytest.approx(np.deg2rad(1 / np.sqrt(200)), rel=1e-14)
    assert ms.range_sigma(26.0, 1e6) / ms.range_sigma(20.0, 1e6) == pytest.approx(10**-0.3, rel=1e-12)


def test_floors_add_in_quadrature():
    """A floor of 3 beside a thermal sigma of 4 makes 5, for range and angle."""
    bandwidth = 299792458 / 2 / 4 / np.sqrt(2)
    assert ms.range_sigma(0.0, bandwidth, 3.0) == pytest.approx(5.0)
    assert ms.angle_sigma(0.0, 4 * 1.6 * np.sqrt(2), floor_rad=3.0) == pytest.approx(5.0)


def test_cross_range_sigma_is_the_scatter_of_range_times_sine():
    """sigma_y is what R sin(theta) scatters by, with and without range noise."""
    rng = np.random.default_rng(4)
    r, theta, s_t, s_r = 30_000.0, 0.7, 2e-4, 20.0
    noise = rng.standard_normal((2, 400_000))
    y_predicted_range = r * np.sin(theta + s_t * noise[0])
    y_own_range = (r + s_r * noise[1]) * np.sin(theta + s_t * noise[0])
    assert ms.cross_range_sigma(s_t, r, np.sin(theta)) == pytest.approx(y_predicted_range.std(), rel=5e-3)
    assert ms.cross_range_sigma(s_t, r, np.sin(theta), s_r) == pytest.approx(y_own_range.std(), rel=5e-3)


def test_filtered_sigma_is_the_filters_own():
    """The predicted sigma of the estimate is the steady-state one; unstable gains have none."""
    assert ms.filtered_sigma(7.0, 0.3, 0.06) == pytest.approx(np.sqrt(ab.filtered_variance(0.3, 0.06, 7.0)))
    assert np.isnan(ms.filtered_sigma(7.0, 1.8, 0.6))


def test_snr_spans_and_widths_match_the_printed_ones():
    """A 5 km bin spans 1.0, 2.0, 3.9, 7.0, 12 dB at 82.5 to 7.5 km; 1, 2, 3 dB are 0.0575, 0.115, 0.172 R
    wide.
    """
    centre = np.array([82.5, 42.5, 22.5, 12.5, 7.5]) * 1e3
    np.testing.assert_allclose(ms.snr_span(centre - 2500, centre + 2500), [1.0, 2.0, 3.9, 7.0, 12.0], atol=0.06)
    np.testing.assert_allclose(ms.constant_snr_width(1.0, [1, 2, 3]), [0.0575, 0.115, 0.172], atol=6e-4)
    width = ms.constant_snr_width(40_000.0, 2.0)
    assert ms.snr_span(40_000 - width / 2, 40_000 + width / 2) == pytest.approx(2.0, rel=1e-12)
    assert ms.snr_span(0.0, 5000.0) == np.inf


def test_constant_snr_edges_cover_the_range_in_equal_spans():
    """Edges begin at the lower end, reach the upper one, and every bin spans the same SNR."""
    edges = ms.constant_snr_edges(10_000.0, 100_000.0, 3.0)
    np.testing.assert_allclose(ms.snr_span(edges[:-1], edges[1:]), 3.0)
    assert edges[0] == 10_000
    assert edges[-2] < 100_000 <= edges[-1]
    assert ms.constant_snr_edges(10_000.0, 100_000.0, 40.0).size == 2
    with pytest.raises(ValueError, match="give 0 < low < high"):
        ms.constant_snr_edges(0.0, 1.0, 1.0)


def test_snr_falls_with_the_fourth_power():
    """Twice the range costs 12.04 dB; decibels and ratios are inverse, and nothing has no decibels."""
    assert ms.snr_at_range(160e3, 20.0, 80e3) == pytest.approx(20 - 40 * np.log10(2))
    assert ms.snr_to_db(ms.snr_from_db(13.2)) == pytest.approx(13.2)
    assert np.isnan(ms.snr_to_db(0.0))
