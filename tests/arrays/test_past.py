"""The papers' chain: each step against its own definition, and the whole against numpy written out."""

import numpy as np
import pytest

from rangeeval.arrays.geometry import line
from rangeeval.arrays.manifold import manifold, steering
from rangeeval.arrays.options import COASTED, MISSING, UNRESOLVED, PastOptions
from rangeeval.arrays.past import filled_up, innovations, left_over, past, scratch
from rangeeval.arrays.tracker import track
from tests.arrays.made import ARC, LINE, RNG, SCATTERED, SPEED, normal, response, snapshots


def split(basis):
    """Real and imaginary part of a basis, with room for responses beside it, as the kernels hold it."""
    m, n = basis.shape
    real, imag = np.zeros((m, filled_up(3 * n))), np.zeros((m, filled_up(3 * n)))
    real[:, :n], imag[:, :n] = basis.real, basis.imag
    return real, imag


PATH = np.deg2rad(np.array([-30.0, 0.0, 25.0]) + np.array([0.01, -0.02, 0.0]) * np.arange(300)[:, None])


def test_past_is_its_recursion():
    """Every state after 40 snapshots is that of the published equations."""
    rng = RNG(3)
    w, p = np.linalg.qr(normal(rng, 9, 3))[0], np.eye(3, dtype=complex)
    (real, imag), inverse, room = split(w), p.copy(), scratch(3, 9)
    for x in normal(rng, 40, 9):
        y = w.conj().T @ x
        h = p @ y
        g = h / (0.9 + (y.conj() @ h).real)
        p = (p - np.outer(g, h.conj())) / 0.9
        e = x - w @ y
        w = w + np.outer(e, g.conj())
        past(real, imag, inverse, x, 0.9, room)
    assert real[:, :3] + 1j * imag[:, :3] == pytest.approx(w, abs=1e-11)
    assert inverse == pytest.approx(p, abs=1e-9)
    assert inverse == pytest.approx(inverse.conj().T, abs=0)


def test_past_converges_to_the_signal_subspace():
    """At high signal to noise its span is that of the largest eigenvectors of the exponentially weighted covariance."""
    x = snapshots(LINE, np.deg2rad([-20.0, 10.0]), 30.0, 400, 5)
    (real, imag), inverse = split(np.linalg.qr(normal(RNG(1), 15, 2))[0]), np.eye(2, dtype=complex)
    cov = np.zeros((15, 15), complex)
    for one in x:
        past(real, imag, inverse, one, 0.95, scratch(2, 15))
        cov = 0.95 * cov + np.outer(one, one.conj())
    q = np.linalg.qr(real[:, :2] + 1j * imag[:, :2])[0]
    top = np.linalg.eigh(cov)[1][:, -2:]
    assert np.linalg.norm(q @ q.conj().T - top @ top.conj().T, 2) < 0.01


@pytest.mark.parametrize("geometry", [LINE, ARC, SCATTERED], ids=["line", "arc", "scattered"])
def test_the_innovation_is_least_squares_of_the_null(geometry):
    """Solving Pn (a + d x) = 0 over stacked real and imaginary parts gives the closed form, for any basis."""
    rng = RNG(2)
    basis = normal(rng, geometry.sensors, 3)
    theta = np.array([-0.4, 0.1, 0.5])
    top, bottom = np.zeros(3), np.zeros(3)
    real, imag = split(basis)
    room = scratch(3, geometry.sensors)
    assert innovations(manifold(geometry), 0, real, imag, theta, room, top, bottom)
    x = normal(rng, geometry.sensors)
    pn = np.eye(geometry.sensors) - basis @ np.linalg.pinv(basis)
    a, d = steering(geometry, theta)
    for n in range(3):
        left, right = pn @ d[:, n], -(pn @ a[:, n])
        stacked = np.linalg.lstsq(np.concatenate([left.real, left.imag])[:, None],
                                  np.concatenate([right.real, right.imag]), rcond=None)[0]  # fmt: skip
        assert -top[n] / bottom[n] == pytest.approx(stacked[0], rel=1e-10)
    assert left_over(real, imag, x, room) == pytest.approx(np.linalg.norm(pn @ x) ** 2, rel=1e-10)


def test_the_innovation_of_an_exact_subspace_points_to_the_target():
    """Predictions 0.2 deg too high are corrected by about -0.2 deg."""
    true = np.deg2rad([-35.0, 0.0, 40.0])
    basis = np.array([response(ARC.sensor_position_m, b) for b in true]).T.copy()
    top, bottom = np.zeros(3), np.zeros(3)
    innovations(manifold(ARC), 0, *split(basis), true + np.deg2rad(0.2), scratch(3, 15), top, bottom)
    assert np.rad2deg(-top / bottom) == pytest.approx(-0.2, abs=0.003)


def chain(geometry, x, theta, rate, options):
    """The whole chain in numpy, written from its equations."""
    n, beta = theta.size, options.forgetting
    w, p = np.linalg.qr(steering(geometry, theta)[0])[0], np.eye(n, dtype=complex)
    state = np.stack([theta, rate])
    cov = np.zeros((2, 2, n)) + np.diag([options.start.bearing_rad**2, options.start.rate_rad**2])[:, :, None]
    f = np.array([[1.0, 1.0], [0.0, 1.0]])
    q = options.process_variance * np.array([[0.25, 0.5], [0.5, 1.0]])
    found = np.empty((len(x), n))
    for k, one in enumerate(x):
        state, cov = f @ state, np.einsum("ab,bcn,dc->adn", f, cov, f) + q[:, :, None]
        if np.isfinite(one).all():
            y = w.conj().T @ one
            h = p @ y
            g = h / (beta + (y.conj() @ h).real)
            p = np.triu(p - np.outer(g, h.conj())) / beta  # kept Hermitian: rounding would grow otherwise
            p = p + np.triu(p, 1).conj().T - 1j * np.diag(np.diag(p).imag)
            w = w + np.outer(one - w @ y, g.conj())
            at = state[0] - (beta / (1 - beta) * state[1] if options.lag_compensation else 0.0)
            pn = np.eye(geometry.sensors) - w @ np.linalg.pinv(w)
            a, d = steering(geometry, at)
            change = -np.real((d.conj() * (pn @ a)).sum(0)) / np.real((d.conj() * (pn @ d)).sum(0))
            apart = np.abs(state[0][:, None] - state[0]) + np.diag(np.full(n, np.inf))
            for i in range(n):
                if options.hard_coasting_rad and apart[i].min() < options.hard_coasting_rad:
                    continue
                gain = cov[:, 0, i] / (cov[0, 0, i] + options.measurement_variance)
                state[:, i] += gain * change[i]
                cov[:, :, i] -= np.outer(gain, cov[0, :, i])
        found[k] = state[0]
    return found


@pytest.mark.parametrize(
    "options",
    [
        PastOptions(),
        PastOptions(lag_compensation=True),
        PastOptions(hard_coasting_rad=np.deg2rad(28.0), forgetting=0.9),
    ],
    ids=["published", "lag compensation", "hard coasting"],
)
def test_the_tracker_is_its_equations(options):
    """Bearings of 300 snapshots, some missing, are those of numpy written out; `ryu` and `modified` agree on a line."""
    x = snapshots(LINE, PATH, 5.0, 300, 4)
    x[100:120, 3] = np.nan
    start, rate = PATH[0] + 0.003, np.full(3, 1e-4)
    expected = chain(LINE, x, start, rate, options)
    for method in ("ryu", "modified"):
        found = track(method, LINE, x, start, rate, options)
        assert found.bearing_rad == pytest.approx(expected, abs=1e-9)
    assert (found.flags[100:120] & MISSING).all()
    assert not (found.flags[120:] & MISSING).any()
    if options.hard_coasting_rad:
        assert not (found.flags[:50, 0] & COASTED).any()
        assert (found.flags[:50, 1] & COASTED).all()


def test_lag_compensation_takes_the_lag_away():
    """A target at 0.1 deg a snapshot is followed 0.49 deg behind (rate times the window's age), and then not."""
    path = np.deg2rad(-40.0 + 0.1 * np.arange(700))[:, None]
    x = snapshots(LINE, path, 20.0, 700, 8)
    for options, lag in ((PastOptions(), 0.1 * 0.83 / 0.17), (PastOptions(lag_compensation=True), 0.0)):
        found = track("ryu", LINE, x, path[0], path[1] - path[0], options)
        assert np.rad2deg(path - found.bearing_rad)[300:].mean() == pytest.approx(lag, abs=0.04)


def test_soft_coasting_weakens_the_measurement_near_another_target():
    """Two targets that cross are flagged there, and held; the power may be given or estimated."""
    path = np.deg2rad(np.array([-5.0, 5.0]) + np.array([0.02, -0.02]) * np.arange(500)[:, None])
    x = snapshots(LINE, path, 5.0, 500, 6)
    for power in (1.0, None):
        options = PastOptions(process_variance=1e-9, lag_compensation=True, soft_coasting=1000.0, source_power=power)
        found = track("ryu", LINE, x, path[0], path[1] - path[0], options)
        assert np.rad2deg(np.abs(found.bearing_rad[-25:] - path[-25:])).max() < 2.0
        assert (found.flags[240:260] & COASTED).all()
        assert (found.flags[200:300] & UNRESOLVED).all()


def test_broad_band_bins_add_up():
    """The same array at two frequencies: over 30 runs the error of the two together is below that of either alone."""
    waves = (0.3, 0.24)
    x = np.array([
        [snapshots(line(8, 0.12, SPEED / w, SPEED), 0.3, 0.0, 200, 1000 * i + run, w) for i, w in enumerate(waves)]
        for run in range(30)
    ]).swapaxes(1, 2)  # fmt: skip
    both = track("modified", line(8, 0.12, [SPEED / w for w in waves], SPEED), x, [0.3])
    square = np.mean((both.bearing_rad[:, 100:] - 0.3) ** 2)
    for i, w in enumerate(waves):
        alone = track("modified", line(8, 0.12, SPEED / w, SPEED), x[:, :, i], [0.3])
        assert square < 0.8 * np.mean((alone.bearing_rad[:, 100:] - 0.3) ** 2)
