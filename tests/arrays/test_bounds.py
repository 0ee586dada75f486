"""Bounds against formulas written out another way, and against each other."""

import numpy as np
import pytest

from rangeeval.arrays.bounds import beam_width, crb, fisher, posterior_crb, uncorrelated_crb
from rangeeval.arrays.manifold import steering
from tests.arrays.made import ARC, LINE, RNG, SCATTERED, model, normal

TRUE, POWER, NOISE = np.deg2rad([-35.0, -10.0, 15.0]), np.array([1.0, 0.5, 2.0]), 0.3


def trace_formula(a, d, slopes_of_s, s, noise):
    """Information from tr(R^-1 dR R^-1 dR'), every derivative of R written out."""
    n, m = s.shape[0], len(a)
    inverse = np.linalg.inv(a @ s @ a.conj().T + noise * np.eye(m))
    slopes = []
    for i in range(n):
        one = np.zeros((m, n), complex)
        one[:, i] = d[:, i]
        slopes.append(one @ s @ a.conj().T + a @ s @ one.conj().T)
    slopes += [a @ k @ a.conj().T for k in slopes_of_s] + [np.eye(m)]
    parts = [inverse @ k for k in slopes]
    return np.array([[np.trace(p @ q).real for q in parts] for p in parts])


def hermitian_basis(n):
    for i in range(n):
        for k in range(i, n):
            unit = np.zeros((n, n), complex)
            unit[i, k] = unit[k, i] = 1.0
            yield unit
            if k > i:
                other = np.zeros((n, n), complex)
                other[i, k], other[k, i] = 1j, -1j
                yield other


@pytest.mark.parametrize("geometry", [LINE, ARC, SCATTERED], ids=["line", "arc", "scattered"])
def test_the_stochastic_bound_is_the_inverse_information(geometry):
    """Of bearings, every element of a correlated source covariance, and noise: 20 snapshots."""
    a, d = steering(geometry, TRUE)
    root = normal(RNG(1), 3, 3)
    s = root @ root.conj().T
    full = 20 * trace_formula(a, d, list(hermitian_basis(3)), s, NOISE)
    assert crb(geometry, TRUE, s, NOISE, 20) == pytest.approx(np.linalg.inv(full)[:3, :3], rel=1e-6)


@pytest.mark.parametrize("geometry", [LINE, ARC, SCATTERED], ids=["line", "arc", "scattered"])
def test_the_uncorrelated_bound_is_the_inverse_information(geometry):
    """Of bearings, powers and noise; it is never above the bound that also estimates the correlation."""
    a, d = steering(geometry, TRUE)
    units = [np.diag(np.eye(3)[i]).astype(complex) for i in range(3)]
    full = trace_formula(a, d, units, np.diag(POWER), NOISE)
    assert fisher(a, d, POWER, NOISE) == pytest.approx(full, rel=1e-9, abs=1e-9)
    bound = uncorrelated_crb(geometry, TRUE, POWER, NOISE, 20)
    assert bound == pytest.approx(np.linalg.inv(20 * full)[:3, :3], rel=1e-7)
    assert (np.diag(bound) <= np.diag(crb(geometry, TRUE, POWER, NOISE, 20)) * (1 + 1e-9)).all()


def test_one_source_has_the_textbook_bound():
    """A line at broadside, one snapshot: 6 s (1 + s / M) / (M (M^2 - 1) (k d)^2) with s the noise over the power."""
    for snr in (0.0, 5.0, 10.0):
        s = 10 ** (-snr / 10)
        expected = 6 * s * (1 + s / 15) / (15 * (15**2 - 1) * np.pi**2)
        assert crb(LINE, [0.0], [1.0], s)[0, 0] == pytest.approx(expected, rel=1e-9)


def test_coincident_sources_have_no_bound():
    """Infinite, not an error and not a number that rounding made."""
    assert np.isinf(crb(LINE, [0.1, 0.1], [1.0, 1.0], 0.3, 10)).all()


def test_the_bound_of_a_straight_track_falls_with_its_length():
    """No process noise, one target: the filter's variance is that of a straight line fitted to all blocks."""
    path = np.zeros((200, 1))
    found = posterior_crb(LINE, path, [1.0], 0.3, process_variance=0.0, start_bearing_sigma_rad=10.0,
                          start_rate_sigma_rad=10.0)  # fmt: skip
    one = uncorrelated_crb(LINE, [0.0], [1.0], 0.3, 5)[0, 0]
    blocks = 40
    fitted = one * (4 * blocks - 2) / (blocks * (blocks + 1))  # at the last point of a line of equal errors
    assert found[-1, 0] == pytest.approx(fitted, rel=1e-3)
    noisy = posterior_crb(LINE, path, [1.0], 0.3, process_variance=1e-10, start_bearing_sigma_rad=10.0,
                          start_rate_sigma_rad=10.0)  # fmt: skip
    assert noisy[-1, 0] > found[-1, 0]


def test_a_crossing_is_bounded():
    """Where two paths meet the bound stays finite, and is larger than where they are apart."""
    path = np.deg2rad(np.array([-10.0, 10.0]) + np.array([0.1, -0.1]) * np.arange(201)[:, None])
    found = posterior_crb(LINE, path, [1.0, 1.0], 0.3, process_variance=1e-10,
                          start_bearing_sigma_rad=0.01, start_rate_sigma_rad=1e-4)  # fmt: skip
    assert np.isfinite(found).all()
    assert (found[110] > found[50]).all()


def test_beam_widths_are_the_textbooks():
    """0.886 lambda / (M d) at broadside, over cos(bearing) aside; turned round, an arc has the same."""
    expected = 0.886 * 0.24 / (15 * 0.12)
    assert beam_width(LINE) == pytest.approx(expected, rel=0.005)
    assert beam_width(LINE, np.pi / 4) == pytest.approx(expected * np.sqrt(2), rel=0.02)
    assert np.rad2deg(beam_width(ARC)) == pytest.approx(4.93, abs=0.02)
    for bearing in (0.0, 0.4):
        r = (
            np.abs(
                np.array(
                    [
                        np.vdot(*steering(ARC, [bearing, bearing + x])[0].T)
                        for x in (-0.5 * beam_width(ARC, bearing), 0.5 * beam_width(ARC, bearing))
                    ]
                )
            )
            ** 2
        )
        assert r.mean() == pytest.approx(0.5 * 15**2, rel=0.05)


def test_a_covariance_of_sources_or_their_powers():
    """(N,) and (N, N) mean the same for uncorrelated sources, in the exact model too."""
    assert crb(LINE, TRUE, np.diag(POWER), NOISE) == pytest.approx(crb(LINE, TRUE, POWER, NOISE))
    assert model(LINE, TRUE, POWER, NOISE).shape == (15, 15)
