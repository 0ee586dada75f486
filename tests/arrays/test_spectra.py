"""Estimates of one block: on exact covariances they are exact, on data they reach what theory allows."""

import numpy as np
import pytest

from rangeeval.arrays import spectra
from rangeeval.arrays.bounds import crb
from rangeeval.arrays.geometry import ArrayGeometry, cylinder, line
from rangeeval.arrays.manifold import steering
from tests.arrays.made import ARC, FREQUENCY, LINE, RNG, SCATTERED, SPEED, model, normal, snapshots

TRUE = np.deg2rad([-35.0, -10.0, 15.0])
EXACT = {name: model(g, TRUE, [1.0, 0.5, 2.0], 0.3) for name, g in (("line", LINE), ("arc", ARC), ("any", SCATTERED))}


def test_exact_covariances_give_exact_bearings():
    """MUSIC on any geometry, root-MUSIC and ESPRIT on the line, also with the sensors counted backwards."""
    for geometry, name in ((LINE, "line"), (ARC, "arc"), (SCATTERED, "any")):
        assert spectra.music(geometry, EXACT[name], 3) == pytest.approx(TRUE, abs=1e-7)
    back = ArrayGeometry(LINE.sensor_position_m[::-1], LINE.frequency_hz, SPEED)
    turned = EXACT["line"][::-1, ::-1]
    for estimate in (spectra.root_music, spectra.esprit):
        assert estimate(LINE, EXACT["line"], 3) == pytest.approx(TRUE, abs=1e-5)
        assert estimate(back, turned, 3) == pytest.approx(TRUE, abs=1e-5)


def test_music_wraps_round_the_circle():
    """A source behind a ring of sensors, at 179.9 degrees, is found once."""
    ring = cylinder(0.2, np.arange(8) * np.pi / 4, FREQUENCY, SPEED)
    true = np.deg2rad([-90.0, 179.9])
    found = spectra.music(ring, model(ring, true, [1.0, 1.0], 0.1), 2)
    assert np.rad2deg(found) == pytest.approx([-90.0, 179.9], abs=1e-4)


def test_spectra_say_power():
    """One source: beamformer and Capon show its power plus the noise of the beam there; MUSIC its place."""
    cov = model(LINE, [0.3], [2.0], 0.5)
    grid = np.linspace(-1.2, 1.2, 481)
    assert spectra.beamformer(LINE, cov, [0.3])[0] == pytest.approx(2.0 + 0.5 / 15)
    assert spectra.capon(LINE, cov, [0.3])[0] == pytest.approx(2.0 + 0.5 / 15, rel=1e-6)
    for spectrum in (
        spectra.beamformer(LINE, cov, grid),
        spectra.capon(LINE, cov, grid),
        spectra.music_spectrum(LINE, cov, 1, grid),
    ):
        assert grid[np.argmax(spectrum)] == pytest.approx(0.3, abs=0.003)


def test_broad_band_bins_are_summed():
    """Two bins: MUSIC finds both sources, and a grating lobe of one frequency is none of the other."""
    both = line(10, 0.15, [FREQUENCY, 1.3 * FREQUENCY], SPEED)
    cov = np.array([model_of(both, f, TRUE) for f in range(2)])
    assert spectra.music(both, cov, 3) == pytest.approx(TRUE, abs=1e-6)
    grid = np.deg2rad(np.arange(-90.0, 90.5, 0.5))
    parts = sum(
        spectra.beamformer(line(10, 0.15, f, SPEED), c, grid) for f, c in zip(both.frequency_hz, cov, strict=True)
    )
    assert spectra.beamformer(both, cov, grid) == pytest.approx(parts)


def model_of(geometry, f, bearing):
    a = steering(geometry, bearing)[0][f]
    return a @ a.conj().T + 0.2 * np.eye(len(a))


def test_coherent_sources_need_smoothing():
    """A coherent pair has one signal eigenvector; forward-backward smoothing to 10 of 15 sensors separates it."""
    true = np.deg2rad([-10.0, 15.0])
    a = steering(LINE, true)[0] @ np.array([1.0, np.exp(0.7j)])
    cov = np.outer(a, a.conj()) + 0.1 * np.eye(15)
    smoothed = spectra.smooth(cov, 10)
    assert np.linalg.eigvalsh(cov)[-2] == pytest.approx(0.1)
    found = spectra.root_music(LINE.without(range(10, 15)), smoothed, 2)
    assert np.rad2deg(found) == pytest.approx([-10.0, 15.0], abs=0.01)


def test_counting_finds_the_number_of_sources():
    """MDL is right in nearly all of 200 blocks of 60 snapshots, AIC counts too many in some; none is none."""
    counts = [
        spectra.count_sources(spectra.covariance(snapshots(LINE, TRUE, 0.0, 60, seed)), 60) for seed in range(200)
    ]
    assert np.mean([c.mdl == 3 for c in counts]) > 0.97
    assert 0.5 < np.mean([c.aic == 3 for c in counts]) < 0.99
    assert spectra.count_sources(spectra.covariance(normal(RNG(1), 60, 15)), 60).mdl == 0
    few = spectra.count_sources(spectra.covariance(snapshots(LINE, TRUE, 20.0, 8, 1)), 8)
    assert few.mdl_values.size == 8


def test_moving_sources_are_counted_twice():
    """The caution: motion of two thirds of a beam in a block makes MDL over-count, a tenth does not."""

    def counts(rate_deg):
        path = TRUE + np.deg2rad(rate_deg) * np.arange(60)[:, None]
        return [
            spectra.count_sources(spectra.covariance(snapshots(LINE, path, 10.0, 60, s)), 60).mdl for s in range(20)
        ]

    assert np.mean(counts(0.075)) > 3.9
    assert np.mean(counts(0.01)) < 3.3


@pytest.mark.slow
def test_root_music_reaches_the_cramer_rao_bound():
    """Over 2000 blocks of 100 snapshots its variance is the bound's within 12 %."""
    found = np.array(
        [spectra.root_music(LINE, spectra.covariance(snapshots(LINE, TRUE, 5.0, 100, s)), 3) for s in range(2000)]
    )
    bound = np.diag(crb(LINE, TRUE, np.ones(3), 10**-0.5, 100))
    assert found.var(axis=0) / bound == pytest.approx(1.0, abs=0.12)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: spectra.root_music(ARC, EXACT["arc"], 3), "not an evenly spaced line"),
        (lambda: spectra.music(LINE, EXACT["line"], 15), "15 sources on 15 sensors"),
        (lambda: spectra.music(LINE, EXACT["any"], 2), "covariance of shape"),
        (lambda: spectra.covariance(np.full((3, 4), np.nan)), "no snapshot"),
        (lambda: spectra.smooth(EXACT["line"], 16), "subarray of 16"),
        (lambda: spectra.count_sources(np.zeros((3, 3)), 10), "nothing to count"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(call, words):
    """Geometry, number of sources, shapes, empty blocks."""
    with pytest.raises(ValueError, match=words):
        call()
