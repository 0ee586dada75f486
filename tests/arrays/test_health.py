"""What spoils bearings is found where it was put, and nothing is found where nothing was."""

from dataclasses import replace

import numpy as np
import pytest

from rangeeval.arrays import patterns
from rangeeval.arrays.broadband import bin_snapshots
from rangeeval.arrays.geometry import cylinder, line
from rangeeval.arrays.health import check_geometry, check_snapshots, mirrored
from rangeeval.arrays.spectra import covariance, music
from tests.arrays.made import ARC, FREQUENCY, LINE, RNG, SCATTERED, SPEED, snapshots

TRUE = np.deg2rad([-35.0, 15.0])


def test_healthy_snapshots_are_healthy():
    """Ten recordings: nothing dead, weak, clipped or missing."""
    for seed in range(10):
        found = check_snapshots(snapshots(LINE, TRUE, 5.0, 500, seed))
        assert (found.dead, found.weak, found.clipped) == ((), (), ())
        assert not found.missing.any()


def test_spoilt_sensors_are_named():
    """Silent, constant, never a number, 30 dB down, clipped; and snapshots with a hole in a live sensor."""
    x = snapshots(LINE, TRUE, 5.0, 500, 1)
    x[:, 1] = 0.0
    x[:, 4] = 2.0 - 1.0j
    x[:, 6] = np.nan
    x[:, 8] *= 10**-1.5
    x[:, 11] = np.clip(x[:, 11].real, -1, 1) + 1j * np.clip(x[:, 11].imag, -1, 1)
    x[37, 0] = np.nan
    found = check_snapshots(x)
    assert found.dead == (1, 4, 6)
    assert found.weak == (8,)
    assert found.clipped == (11,)
    assert np.flatnonzero(found.missing).tolist() == [37]


@pytest.mark.parametrize(("spacing", "aliased"), [(0.08, False), (0.12, False), (0.125, True), (0.2, True)])
def test_a_line_aliases_beyond_half_a_wavelength(spacing, aliased):
    """Exactly half a wavelength is still well."""
    found = check_geometry(line(15, spacing, FREQUENCY, SPEED))
    assert found.aliased == aliased
    assert found.half_wavelengths == pytest.approx(spacing / 0.12)


def test_the_papers_arc_has_high_side_lobes_but_no_alias():
    """0.87 wavelengths between staves: side lobes of -4.4 dB in the sector, which the paper does not mention."""
    found = check_geometry(ARC)
    assert not found.aliased
    assert found.half_wavelengths == pytest.approx(1.74, abs=0.01)
    assert found.level_db == pytest.approx(-4.4, abs=0.2)


def test_who_can_tell_a_mirrored_recording():
    """A line never; a ring of equal ears never (it sees it behind); an arc that looks ahead, or baffled staves, yes."""
    ring = cylinder(0.2, np.arange(8) * np.pi / 4, FREQUENCY, SPEED)
    assert not check_geometry(LINE).tells_mirror
    assert not check_geometry(ring).tells_mirror
    assert check_geometry(ARC).tells_mirror
    assert check_geometry(replace(ring, pattern=patterns.cardioid())).tells_mirror
    assert check_geometry(replace(SCATTERED, elevation_rad=0.6)).tells_mirror


def test_a_mirrored_recording_is_found_out():
    """On 8 recordings of two sources each way; None where the array cannot tell."""
    for seed in range(8):
        x = snapshots(ARC, TRUE, 5.0, 60, seed)
        assert mirrored(ARC, x, 2) is False
        assert mirrored(ARC, x.conj(), 2) is True
    assert mirrored(LINE, snapshots(LINE, TRUE, 5.0, 60, 1), 2) is None


def test_time_series_become_snapshots_of_bins():
    """A wave from 250 degrees that passes four microphones, as real samples: MUSIC over the bins finds it; white noise
    keeps its variance; a hole is one missing stretch.
    """
    place = np.array([[0.0, 0.0], [70.0, 10.0], [-20.0, 80.0], [40.0, -60.0]])
    bearing, rate, c = np.deg2rad(250.0 - 360.0), 100.0, 340.0
    ahead = place @ np.array([np.cos(bearing), np.sin(bearing)]) / c
    rng = RNG(4)
    tones = rng.uniform(1.0, 4.0, 80), rng.uniform(0, 2 * np.pi, 80)
    t = np.arange(6000) / rate
    wave = sum(np.cos(2 * np.pi * f * (t[:, None] + ahead) + p) for f, p in zip(*tones, strict=True))
    wave = wave + 0.5 * rng.standard_normal(wave.shape)
    bins = bin_snapshots(wave, rate, 512, band_hz=(1.0, 4.0))
    assert bins.snapshots.shape == (22, 15, 4)
    assert bins.centre_sample[:2] == pytest.approx([255.5, 511.5])
    from rangeeval.arrays.geometry import ArrayGeometry

    array = ArrayGeometry(place, bins.frequency_hz, c)
    assert np.rad2deg(music(array, covariance(bins.snapshots), 1)) == pytest.approx([-110.0], abs=1.0)
    white = bin_snapshots(3.0 * rng.standard_normal((20_000, 3)), rate, 256, band_hz=(5.0, 45.0))
    assert np.mean(np.abs(white.snapshots) ** 2) == pytest.approx(9.0, rel=0.03)
    wave[1000, 2] = np.nan
    holed = bin_snapshots(wave, rate, 512, band_hz=(1.0, 4.0), overlap=0.0)
    assert np.flatnonzero(~np.isfinite(holed.snapshots).all(axis=(1, 2))).tolist() == [1]
    with pytest.raises(ValueError, match="no bin between 60 and 80 Hz"):
        bin_snapshots(wave, rate, 512, band_hz=(60.0, 80.0))
