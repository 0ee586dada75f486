"""The response of any geometry: its formula, its derivative, its convention, its element patterns."""

from dataclasses import replace

import numpy as np
import pytest

from rangeeval.arrays import patterns
from rangeeval.arrays.geometry import ArrayGeometry, cylinder, line
from rangeeval.arrays.manifold import steering
from tests.arrays.made import ARC, FREQUENCY, LINE, RNG, SCATTERED, SPEED, response

BEARINGS = np.deg2rad([-84.0, -30.0, -5.0, 0.0, 12.5, 60.0])
TABLE = np.exp(1j * np.linspace(0, 2 * np.pi, 37)[:-1]) + 2.0
PATTERNS = {
    "omnidirectional": patterns.OMNIDIRECTIONAL,
    "cosine": patterns.cosine(2.0),
    "cardioid": patterns.cardioid(),
    "baffle": patterns.baffle(0.2, 3.0),
    "table": patterns.table(TABLE),
}


@pytest.mark.parametrize("geometry", [LINE, ARC, SCATTERED], ids=["line", "arc", "scattered"])
def test_the_response_is_the_plane_wave(geometry):
    """exp(+j k p.u): the formula, to the last digits, for a line along y, an arc, and sensors anywhere."""
    a, _ = steering(geometry, BEARINGS)
    for n, bearing in enumerate(BEARINGS):
        assert a[:, n] == pytest.approx(response(geometry.sensor_position_m, bearing), abs=1e-12)


def test_a_line_array_counts_from_broadside_wherever_it_points():
    """The same 15 sensors along y, along x, or up along z have the same responses to a bearing."""
    for axis in np.eye(3):
        turned = ArrayGeometry(np.arange(15)[:, None] * 0.12 * axis, np.array([FREQUENCY]), SPEED)
        assert turned.linear
        assert steering(turned, BEARINGS)[0] == pytest.approx(steering(LINE, BEARINGS)[0], abs=1e-12)
        assert np.angle(steering(turned, [0.1])[0][1, 0]) == pytest.approx(np.pi * np.sin(0.1))


def test_elevation_tilts_the_plane_of_bearings():
    """In three dimensions the wave comes from the fixed elevation."""
    tilted = replace(SCATTERED, elevation_rad=0.4)
    expected = response(SCATTERED.sensor_position_m, 0.7, elevation_rad=0.4)
    assert steering(tilted, [0.7])[0][:, 0] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("pattern", PATTERNS.values(), ids=PATTERNS)
@pytest.mark.parametrize("geometry", [LINE, ARC, SCATTERED], ids=["line", "arc", "scattered"])
def test_the_derivative_is_that_of_finite_differences(geometry, pattern):
    """For every geometry and every element pattern."""
    shaped = replace(geometry, pattern=pattern)
    step = 1e-6
    ahead, behind = (steering(shaped, BEARINGS + s)[0] for s in (step, -step))
    assert steering(shaped, BEARINGS)[1] == pytest.approx(
        (ahead - behind) / (2 * step), abs=1e-6
    )  # a half-cosine has a kink in its slope


def test_element_patterns_have_their_gains():
    """In front, aside and behind; a table has its own values at its own angles."""
    at = np.array([0.0, np.pi / 2, np.pi])
    for pattern, gains in (
        (patterns.cosine(2.0), [1, 0, 0]), (patterns.cardioid(), [1, 0.5, 0]), (patterns.baffle(0.2), [1, 0.6, 0.2]),
        (patterns.table(TABLE), TABLE[[0, 9, 18]]),
    ):  # fmt: skip
        one = ArrayGeometry(SCATTERED.sensor_position_m, SCATTERED.frequency_hz, SPEED, pattern, np.zeros(7))
        plain = steering(SCATTERED, at)[0]
        assert (steering(one, at)[0] / plain)[3] == pytest.approx(np.array(gains), abs=1e-12)


def test_staves_of_a_cylinder_face_outwards():
    """Also when only their positions are known."""
    known = replace(ARC, pattern=patterns.cardioid())
    ring = cylinder(1.0, np.arange(12) * np.pi / 6, FREQUENCY, SPEED, pattern=patterns.cardioid())
    found = ArrayGeometry(ring.sensor_position_m, ring.frequency_hz, SPEED, patterns.cardioid())
    assert steering(found, [0.3])[0] == pytest.approx(steering(ring, [0.3])[0], abs=1e-12)
    assert np.argmax(np.abs(steering(known, [np.deg2rad(-60)])[0][:, 0])) == 2


def test_phases_of_far_apart_sensors_keep_their_digits():
    """The kernel's own sine and cosine are exact to rounding up to phases of a hundred thousand."""
    far = line(15, 100.0, FREQUENCY, SPEED)
    phase = far.wavenumber_rad_m[0] * far.along_m * np.sin(0.3)
    assert phase[-1] > 1e4
    assert steering(far, [0.3])[0][:, 0] == pytest.approx(np.exp(1j * phase), abs=1e-9)
    angles = RNG(1).uniform(-1e5, 1e5, 200)
    for angle in angles[:20]:
        pair = ArrayGeometry(np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([abs(angle)]), 2 * np.pi)
        assert steering(pair, [np.pi / 2])[0][1, 0] == pytest.approx(np.exp(1j * abs(angle)), abs=3e-11)


def test_bins_have_each_their_wavelength():
    """Broad band: the responses of each frequency alone."""
    both = line(6, 0.1, [2000.0, 5000.0], SPEED)
    a, d = steering(both, BEARINGS)
    assert a.shape == d.shape == (2, 6, 6)
    for f, frequency in enumerate([2000.0, 5000.0]):
        assert a[f] == pytest.approx(steering(line(6, 0.1, frequency, SPEED), BEARINGS)[0])


def test_without_leaves_sensors_out():
    """Their rows of the response go, the others stay."""
    kept = replace(ARC, pattern=patterns.table(np.ones((15, 8)) * np.arange(1, 16)[:, None])).without([3, 7])
    assert kept.sensors == 13
    gains = np.delete(np.arange(1, 16), [3, 7])
    assert np.abs(steering(kept, [0.2])[0][:, 0]) == pytest.approx(gains)
    with pytest.raises(ValueError, match="1 sensors are left of 15"):
        ARC.without(range(14))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sensor_position_m": np.zeros((4, 2))}, "same place"),
        ({"sensor_position_m": np.zeros(4)}, "shape"),
        ({"sensor_position_m": np.array([[0.0, 0.0], [np.nan, 1.0]])}, "position of sensor 1"),
        ({"frequency_hz": 0.0}, "frequency_hz"),
        ({"propagation_speed_m_s": -1.0}, "propagation_speed_m_s"),
        ({"sector_rad": (1.0, 0.0)}, "sector"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(change, words):
    """Positions, frequency, speed, sector."""
    with pytest.raises(ValueError, match=words) as raised:
        ArrayGeometry(
            **{"sensor_position_m": LINE.sensor_position_m, "frequency_hz": 1.0, "propagation_speed_m_s": 1.0} | change
        )
    assert "\n" not in str(raised.value)
