"""The joint maximum-likelihood tracker: score and information against the likelihood itself, and what it promises."""

import numpy as np
import pytest

from rangeeval.arrays.assessment import bearing_errors, outcome
from rangeeval.arrays.geometry import line
from rangeeval.arrays.joint import likelihood_terms, load, workspace
from rangeeval.arrays.manifold import manifold, steering
from rangeeval.arrays.options import FADED, MISSING, OUTSIDE, UNMODELLED, UNRESOLVED, JointOptions, flag_words
from rangeeval.arrays.tracker import start, track
from tests.arrays.made import ARC, LINE, RNG, SCATTERED, SPEED, model, normal, snapshots

POWER, NOISE = np.array([1.0, 0.5, 2.0]), 0.7
THETA = np.deg2rad([-20.0, 5.0, 12.0])


def terms(geometry, x, theta, power=POWER, noise=NOISE):
    """Score, information, EM quantities, mean |R^-1 x|^2 and trace of R^-1, from the kernel."""
    n = theta.size
    work = workspace(n, geometry.sensors, len(x))
    load(x[:, None, :], np.ones(len(x), np.bool_), 0, 0, len(x), 2 * n, work)
    score, info = np.zeros(n), np.zeros((n, n))
    residual, trace = likelihood_terms(manifold(geometry), 0, theta, power, noise, len(x), work, score, info)
    return score, info, work.fit, work.model, residual, trace


def minus_log_likelihood(geometry, x, theta):
    r = model(geometry, theta, POWER, NOISE)
    e = x.T @ x.conj() / len(x)
    return len(x) * (np.linalg.slogdet(r)[1] + np.trace(np.linalg.solve(r, e)).real)


@pytest.mark.parametrize("geometry", [LINE, ARC, SCATTERED], ids=["line", "arc", "scattered"])
def test_the_score_is_the_slope_of_the_likelihood(geometry):
    """Against finite differences of log det R + tr R^-1 E, R formed and inverted."""
    x = snapshots(geometry, THETA, 3.0, 10, 1)
    score = terms(geometry, x, THETA)[0]
    for n in range(3):
        step = 1e-5 * np.eye(3)[n]
        slope = (
            minus_log_likelihood(geometry, x, THETA + step) - minus_log_likelihood(geometry, x, THETA - step)
        ) / 2e-5
        assert score[n] == pytest.approx(slope, rel=1e-6, abs=1e-5)


@pytest.mark.parametrize("geometry", [LINE, ARC, SCATTERED], ids=["line", "arc", "scattered"])
def test_the_information_is_the_trace_formula(geometry):
    """L tr(R^-1 dR R^-1 dR'), with the derivatives of R written out."""
    x = snapshots(geometry, THETA, 3.0, 10, 1)
    info = terms(geometry, x, THETA)[1]
    a, d = steering(geometry, THETA)
    inverse = np.linalg.inv(model(geometry, THETA, POWER, NOISE))
    slopes = [p * (np.outer(d[:, n], a[:, n].conj()) + np.outer(a[:, n], d[:, n].conj())) for n, p in enumerate(POWER)]
    for i in range(3):
        for k in range(3):
            assert info[i, k] == pytest.approx(10 * np.trace(inverse @ slopes[i] @ inverse @ slopes[k]).real, rel=1e-9)


def test_woodbury_gives_what_the_inverse_gives():
    """a^H R^-1 a, mean |a^H R^-1 x|^2, mean |R^-1 x|^2 and tr R^-1 against the inverse itself."""
    x = snapshots(LINE, THETA, 3.0, 10, 2)
    *_, fit, own, residual, trace = terms(LINE, x, THETA)
    a = steering(LINE, THETA)[0]
    inverse = np.linalg.inv(model(LINE, THETA, POWER, NOISE))
    assert own == pytest.approx(np.diag(a.conj().T @ inverse @ a).real, rel=1e-10)
    assert fit == pytest.approx((np.abs(a.conj().T @ inverse @ x.T) ** 2).mean(axis=1), rel=1e-10)
    assert residual == pytest.approx((np.abs(inverse @ x.T) ** 2).sum(axis=0).mean(), rel=1e-10)
    assert trace == pytest.approx(np.trace(inverse).real, rel=1e-10)


def test_coincident_bearings_leave_their_centroid_known():
    """The information is singular exactly in the difference of two equal sources at the same bearing."""
    info = terms(LINE, snapshots(LINE, THETA, 3.0, 10, 1), np.array([0.1, 0.1]), np.ones(2))[1]
    assert info @ np.array([1.0, -1.0]) == pytest.approx(0.0, abs=1e-9 * info[0, 0])
    assert np.array([1.0, 1.0]) @ info @ np.array([1.0, 1.0]) > info[0, 0]


CROSSING = np.deg2rad(np.array([-12.0, 12.0, 40.0]) + np.array([0.06, -0.06, 0.0]) * np.arange(400)[:, None])


@pytest.mark.parametrize("geometry", [LINE, ARC], ids=["line", "arc"])
def test_targets_are_held_through_a_crossing(geometry):
    """Two cross while a third stands still: held, unresolved flagged there only, powers and noise found, no alarm."""
    x = snapshots(geometry, CROSSING, 5.0, 400, 3)
    found = track("joint-ml", geometry, x, CROSSING[0] + 0.005, CROSSING[1] - CROSSING[0])
    bearing = found.at(np.arange(400))
    assert outcome(bearing, CROSSING) == "held"
    assert np.rad2deg(np.sqrt(bearing_errors(bearing, CROSSING, 0.1).mse)) < 0.25
    flagged = (found.flags & UNRESOLVED).astype(bool)
    assert flagged[np.abs(found.sample - 200) < 20, :2].all()
    assert not flagged[found.sample < 120].any()
    assert not flagged[:, 2].any()
    assert found.power[-1] == pytest.approx(1.0, abs=0.5)
    assert found.noise[-1] == pytest.approx(10**-0.5, rel=0.15)
    assert not (found.flags & UNMODELLED).any()
    assert np.isnan(found.guard[:5]).all()
    assert np.nanmax(found.guard) < 4.6


def test_sigma_is_consistent():
    """Over 60 runs of three separate targets the error squared over sigma squared is 1 within a third; runs may batch."""
    path = np.deg2rad(np.array([-30.0, 0.0, 35.0]) + np.array([0.02, 0.0, -0.03]) * np.arange(200)[:, None])
    rng = RNG(7)
    x = np.array([snapshots(LINE, path, 5.0, 200, 100 + run) for run in range(60)])
    starts = path[0] + np.deg2rad(0.5) * rng.standard_normal((60, 3))
    rates = path[1] - path[0] + 1e-4 * rng.standard_normal((60, 3))
    found = track("joint-ml", LINE, x, starts, rates, JointOptions(process_variance=1e-13))
    truth = path[np.round(found.sample + 0.01).astype(int)] - 0.5 * (path[1] - path[0])
    ratio = ((found.bearing_rad - truth) / found.bearing_sigma_rad)[:, 5:] ** 2
    assert 0.67 < ratio.mean() < 1.33
    one = track("joint-ml", LINE, x[7], starts[7], rates[7], JointOptions(process_variance=1e-13))
    assert (one.bearing_rad == found.bearing_rad[7]).all()


def test_the_guard_sees_a_source_too_many():
    """With one of three sources left out the largest whitened eigenvalue is above 5 and flagged; the others stay."""
    path = np.deg2rad(np.broadcast_to([-30.0, 0.0, 35.0], (300, 3)))
    for snr in (0.0, 5.0, 10.0):
        x = snapshots(LINE, path, snr, 300, 11)
        whole = track("joint-ml", LINE, x, path[0])
        assert np.nanmax(whole.guard) < 4.6
        short = track("joint-ml", LINE, x, path[0, :2])
        assert np.nanmax(short.guard) > 5.8
        assert (short.flags[10:] & UNMODELLED).all()
        assert "unmodelled-source" in flag_words(int(short.flags[-1, 0]))


def in_numpy(x, bearing, rate, *, q, largest, ahead, opening):
    """The tracker on LINE written out: R inverted, the whole state's covariance inverted, steps shortened together."""
    n, m, block = bearing.size, LINE.sensors, 10
    one, zero = np.eye(n), np.zeros((n, n))
    s, cov = np.concatenate([bearing, rate]), np.diag(np.repeat([np.deg2rad(0.5) ** 2, 1e-8], n))

    def parts(power, noise):
        a, d = steering(LINE, s[:n])
        return a, d, np.linalg.inv((a * power) @ a.conj().T + noise * np.eye(m))

    def refitted(power, noise, e, share):
        a, _, inverse = parts(power, noise)
        grown = power + share * power**2 * np.diag(a.conj().T @ inverse @ (e @ inverse - np.eye(m)) @ a).real
        return grown, noise + share * noise**2 * np.trace(inverse @ e @ inverse - inverse).real / m

    def covariance_of(part):
        return part.T @ part.conj() / len(part)

    found = []
    for b in range(len(x) // block):
        e = covariance_of(x[b * block : (b + 1) * block])
        f = np.block([[one, ahead * one], [zero, one]])
        noise_of_f = np.zeros((2 * n, 2 * n))
        for _ in range(round(ahead)):  # a new acceleration every snapshot
            step = np.block([[one, one], [zero, one]])
            noise_of_f = step @ noise_of_f @ step.T + q * np.block([[one / 4, one / 2], [one / 2, one]])
        s, cov, ahead = f @ s, f @ cov @ f.T + noise_of_f, block
        if b == 0:
            power, noise = np.ones(n), 1.0
            for _ in range(200):
                power, noise = refitted(power, noise, covariance_of(x[:opening]), 1.0)
        prior, before = np.linalg.inv(cov), s
        for _ in range(2):
            a, d, inverse = parts(power, noise)
            ad, aa, dd = (left.conj().T @ inverse @ right for left, right in ((a, d), (a, a), (d, d)))
            slope, info = prior @ (s - before), prior.copy()
            slope[:n] += 2 * block * power * np.diag(ad - a.conj().T @ inverse @ e @ inverse @ d).real
            info[:n, :n] += 2 * block * np.outer(power, power) * (ad * ad.T + aa * dd.T).real
            ds = np.linalg.solve(info, slope)
            s = s - ds * min(1.0, largest / np.abs(ds[:n]).max())
        cov = np.linalg.inv(info)
        power, noise = refitted(power, noise, e, 0.2)
        found.append(np.concatenate([s, np.sqrt(np.diag(cov)), power, [noise]]))
    return np.array(found)


@pytest.mark.parametrize("largest_deg", [0.15, 5.0], ids=["short steps", "whole steps"])
def test_the_tracker_is_its_equations_written_out(largest_deg):
    """Every output against numpy and full matrices, through a crossing; start in a block's middle, 40 to open."""
    x = snapshots(LINE, CROSSING, 5.0, 400, 3)
    bearing, rate = CROSSING[0] + np.deg2rad([0.6, -0.4, 0.3]), CROSSING[1] - CROSSING[0]
    options = JointOptions(
        process_variance=1e-9, largest_step_rad=np.deg2rad(largest_deg), limit_together=True, opening=40,
        start_sample=4.5,
    )  # fmt: skip
    found = track("joint-ml", LINE, x, bearing, rate, options)
    ours = np.hstack([found.bearing_rad, found.rate_rad, found.bearing_sigma_rad, found.rate_sigma_rad, found.power])
    wanted = in_numpy(x, bearing, rate, q=1e-9, largest=np.deg2rad(largest_deg), ahead=0, opening=40)
    assert ours == pytest.approx(wanted[:, :-1], rel=1e-6, abs=1e-9)
    assert found.noise == pytest.approx(wanted[:, -1], rel=1e-6)


@pytest.mark.parametrize("sample", [-3.0, 0.0, 4.5, 30.0])
def test_the_start_may_hold_at_any_snapshot(sample):
    """Without data the state is the start carried there, forward or back, and as uncertain as that makes it."""
    x = np.full((20, LINE.sensors), np.nan, complex)
    found = track("joint-ml", LINE, x, [0.2], [1e-3], JointOptions(process_variance=1e-8, start_sample=sample))
    ahead = 4.5 - sample
    assert found.bearing_rad[0, 0] == pytest.approx(0.2 + 1e-3 * ahead, abs=1e-15)
    acceleration = 1e-8 * (abs(ahead) ** 3 / 3 - abs(ahead) / 12)
    assert found.bearing_sigma_rad[0, 0] ** 2 == pytest.approx(
        np.deg2rad(0.5) ** 2 + (1e-4 * ahead) ** 2 + acceleration, rel=1e-12
    )
    assert found.rate_sigma_rad[0, 0] ** 2 == pytest.approx(1e-8 + 1e-8 * abs(ahead), rel=1e-12)


@pytest.mark.parametrize("opening", [1, 40])
def test_powers_and_noise_open_at_their_most_likely(opening):
    """At the bearings of the start the likelihood of that many snapshots, a block at least, is flat in all of them."""
    x = snapshots(LINE, THETA, 3.0, 100, 8)
    found = track("joint-ml", LINE, x, THETA, None, JointOptions(opening=opening, memory=1e12))
    part = x[: max(opening, 10)]
    e = part.T @ part.conj() / len(part)
    a = steering(LINE, THETA)[0]
    inverse = np.linalg.inv(model(LINE, THETA, found.power[0], found.noise[0]))
    assert np.diag(a.conj().T @ inverse @ e @ inverse @ a).real == pytest.approx(
        np.diag(a.conj().T @ inverse @ a).real, rel=1e-3
    )
    assert np.trace(inverse @ e @ inverse).real == pytest.approx(np.trace(inverse).real, rel=1e-3)


def test_a_step_is_limited_for_each_bearing_or_for_all():
    """Each: those that would go farther go as far as they may. Together: all go the same share of their way."""
    x, wrong = snapshots(LINE, THETA, 5.0, 10, 3), THETA + np.deg2rad([0.5, -0.1, 0.3])

    def moved(**how):
        found = track("joint-ml", LINE, x, wrong, None, JointOptions(iterations=1, **how))
        return found.innovation_rad[0], found.rate_rad[0]

    whole, turned = moved()
    most = 0.5 * np.abs(whole).max()
    assert moved(largest_step_rad=most)[0] == pytest.approx(np.clip(whole, -most, most), rel=1e-9)
    shared, shared_rate = moved(largest_step_rad=most, limit_together=True)
    assert shared == pytest.approx(0.5 * whole, rel=1e-9)
    assert shared_rate == pytest.approx(0.5 * turned, rel=1e-9)


def test_blocks_of_one_broad_band_snapshot_open_on_more():
    """One snapshot does not tell a bin's powers from its noise: over 30 runs ten of them halve the error."""
    band = line(8, 0.12, [SPEED / w for w in np.linspace(0.24, 0.36, 10)], SPEED)
    path = np.deg2rad(np.array([-30.0, 0.0, 25.0]) + np.array([0.3, -0.15, -0.24]) * np.arange(60)[:, None])
    a = steering(band, path.ravel())[0].reshape(10, 8, 60, 3)
    square = {1: 0.0, 10: 0.0}
    for run in range(30):
        rng = RNG([12, run])
        x = np.einsum("fmkn,fkn->kfm", a, normal(rng, 10, 60, 3)) + 10**-0.25 * normal(rng, 60, 10, 8)
        starts = path[0] + np.deg2rad(0.5) * rng.standard_normal(3)
        for opening in square:
            options = JointOptions(block=1, opening=opening, process_variance=1e-8)
            found = track("joint-ml", band, x, starts, path[1] - path[0], options)
            square[opening] += np.mean((found.bearing_rad - path) ** 2)
    assert square[10] < 0.5 * square[1]


def test_missing_snapshots_are_predicted_over():
    """Two blocks without data: flagged, sigma grows, and the track is picked up again where it went."""
    x = snapshots(LINE, CROSSING[:, :1], 5.0, 400, 4)
    x[200:225] = np.nan
    found = track("joint-ml", LINE, x, CROSSING[0, :1], CROSSING[1, :1] - CROSSING[0, :1])
    assert [int(i) for i in np.flatnonzero(found.flags[:, 0] & MISSING)] == [20, 21]
    assert found.bearing_sigma_rad[21] > found.bearing_sigma_rad[19]
    assert np.isfinite(found.bearing_rad).all()
    assert np.rad2deg(np.abs(found.at(np.arange(400)) - CROSSING[:, :1])).max() < 1.0


def test_a_target_that_falls_silent_fades():
    """Its power goes and is flagged; its sigma says that nothing holds it any longer."""
    path = np.deg2rad(np.broadcast_to([-20.0, 20.0], (1000, 2)))
    x = snapshots(LINE, path, 5.0, 1000, 5)
    x[300:] = snapshots(LINE, path[:, :1], 5.0, 1000, 6)[300:]
    found = track("joint-ml", LINE, x, path[0])
    assert (found.flags[-10:, 1] & FADED).all()
    assert not (found.flags[:30] & FADED).any()
    assert not (found.flags[:, 0] & FADED).any()
    assert found.bearing_sigma_rad[-1, 1] > 3 * found.bearing_sigma_rad[-1, 0]


def test_a_target_that_leaves_the_sector_is_flagged():
    """A bearing beyond broadside plus 90 degrees is none of this array's."""
    found = track("joint-ml", LINE, snapshots(LINE, [1.5], 5.0, 100, 1), [1.5], [0.01])
    assert (found.flags & OUTSIDE).any()


def test_bearings_follow_round_the_circle():
    """On a ring a target that passes from +180 to -180 degrees is one smooth track."""
    from rangeeval.arrays.geometry import cylinder

    ring = cylinder(0.25, np.arange(9) * 2 * np.pi / 9, 6250.0, SPEED)
    path = np.deg2rad(160.0 + 0.1 * np.arange(400))[:, None]
    found = track("joint-ml", ring, snapshots(ring, path, 5.0, 400, 2), path[0], path[1] - path[0])
    assert np.rad2deg(np.abs(found.at(np.arange(400)) - path)).max() < 1.5
    assert np.diff(found.bearing_rad[:, 0]).min() > 0
    assert not (found.flags & OUTSIDE).any()


def test_broad_band_bins_share_the_bearings():
    """Two bins, each narrow band: over 40 runs the error is below that of either bin alone, and powers are of each."""
    waves = (0.3, 0.24)
    x = np.array([
        [snapshots(line(8, 0.12, SPEED / w, SPEED), 0.3, 0.0, 200, 1000 * i + run, w) for i, w in enumerate(waves)]
        for run in range(40)
    ]).swapaxes(1, 2)  # fmt: skip
    both = track("joint-ml", line(8, 0.12, [SPEED / w for w in waves], SPEED), x, [0.3])
    square = np.mean((both.bearing_rad - 0.3) ** 2)
    for i, w in enumerate(waves):
        alone = track("joint-ml", line(8, 0.12, SPEED / w, SPEED), x[:, :, i], [0.3])
        assert square < 0.8 * np.mean((alone.bearing_rad - 0.3) ** 2)


def test_the_automatic_start_finds_the_targets():
    """How many, where and how fast, on a line, on an arc, and on sensors anywhere; the tracker takes it from there."""
    for geometry, degrees in ((LINE, [-30.0, 5.0, 40.0]), (ARC, [-30.0, 5.0, 40.0]), (SCATTERED, [-100.0, 60.0])):
        path = np.deg2rad(np.array(degrees) + 0.01 * np.arange(200)[:, None])
        x = snapshots(geometry, path, 10.0, 200, 9)
        found = start(geometry, x)
        assert np.rad2deg(found.bearing_rad) == pytest.approx(degrees, abs=1.5)
        assert np.rad2deg(found.rate_rad) == pytest.approx(0.01, abs=0.1)
        options = JointOptions(start=found.uncertainty)
        followed = track("joint-ml", geometry, x, found.bearing_rad, found.rate_rad, options)
        assert np.rad2deg(np.abs(followed.at(np.arange(200))[-50:] - path[-50:])).max() < 2.0
    nothing = start(LINE, normal(RNG(1), 100, 15))
    assert nothing.flags == ("none-found",)
    assert nothing.bearing_rad.size == 0


@pytest.mark.parametrize(
    ("method", "geometry", "shape", "targets", "words"),
    [
        ("joint", LINE, (100, 15), 2, "the method is 'joint'"),
        ("ryu", ARC, (100, 15), 2, "do not stand in a line"),
        ("joint-ml", LINE, (100, 15), 15, "15 targets on 15 sensors; 16 sensors"),
        ("joint-ml", LINE, (100, 14), 2, r"shape \(100, 14\)"),
        ("joint-ml", LINE, (9, 15), 2, "less than one block"),
        ("modified", LINE, (100, 2, 15), 2, "starts of shapes"),
    ],
)
def test_what_cannot_be_tracked_is_said_in_one_line(method, geometry, shape, targets, words):
    """Method, geometry, targets, shapes, length."""
    starts = np.zeros((3, targets)) if len(shape) == 3 else np.zeros(targets)
    with pytest.raises(ValueError, match=words) as raised:
        track(method, geometry, np.zeros(shape), starts)
    assert "\n" not in str(raised.value)
