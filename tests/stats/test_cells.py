"""One pass over samples against the plain formulas on the same samples."""

import numpy as np
import pytest

from rangeeval.stats import cells as c
from rangeeval.stats.cells import LAGS, AxisSums, Cell, CellNumbers, Follower
from rangeeval.stats.correlation import lag_sums
from rangeeval.tracking.alpha_beta import q_cv, q_white


def gathered(
    x, *, cell=None, track=None, alpha=None, beta=None, rng=None, cross=None, snr=None, mark=None, startup=0.0, pieces=1
):
    """An AxisSums after adding samples, in `pieces` parts."""
    n = len(x)
    full = {
        "residual": np.asarray(x, float),
        "alpha": np.full(n, 0.4) if alpha is None else np.asarray(alpha, float),
        "beta": np.full(n, 0.1) if beta is None else np.asarray(beta, float),
        "rng": np.full(n, 5e4) if rng is None else np.asarray(rng, float),
        "cross": np.full(n, 1e4) if cross is None else np.asarray(cross, float),
        "time": np.arange(n, dtype=float),
        "cell": np.zeros(n, np.int32) if cell is None else np.asarray(cell, np.int32),
        "track": np.zeros(n, np.int32) if track is None else np.asarray(track, np.int32),
        "mark": np.zeros(n, np.int8) if mark is None else np.asarray(mark, np.int8),
    }
    sums = AxisSums(angle=cross is not None, startup=startup)
    for part in np.array_split(np.arange(n), pieces):
        some = {k: v[part] for k, v in full.items()}
        s = None if snr is None else np.asarray(snr, float)[part]
        sums.add(**some, snr=s, cells=int(full["cell"].max(initial=0)) + 1)
    return sums


def test_moments_equal_those_of_numpy():
    """Mean and central sums to the fourth equal numpy's, at an offset where plain sums of squares fail."""
    x = np.random.default_rng(0).standard_normal(5000) + 1e8
    s = gathered(x).cell(0).sums
    exact = x - 1e8
    d = exact - exact.mean()
    assert s[c.N] == 5000
    assert s[c.MEAN] == pytest.approx(x.mean(), abs=1e-6)
    assert s[c.M2] == pytest.approx((d**2).sum(), rel=1e-7)
    assert s[c.M4] == pytest.approx((d**4).sum(), rel=1e-6)


def test_ratio_per_sample_weights_each_sample_with_its_own_gains():
    """Weighted sums about any centre equal the sum written out."""
    rng = np.random.default_rng(1)
    x, a = rng.standard_normal(300) * 7 + 3, rng.uniform(0.2, 0.8, 300)
    b, r, y = 0.2 * a, rng.uniform(4e4, 5e4, 300), rng.uniform(-1e4, 2e4, 300)
    cell = gathered(x, alpha=a, beta=b, rng=r, cross=y).cell(0)
    for m in (0.0, x.mean()):
        for first, weight in (
            (c.Q0, q_cv(a, b)), (c.W0, q_white(a)), (c.U0, q_cv(a, b) / (r * r - y * y)), (c.V0, q_white(a) / (r * r - y * y)),
        ):  # fmt: skip
            assert cell.centred(first, m) == pytest.approx(float(np.sum(weight * (x - m) ** 2)), rel=1e-12)


def test_lag_products_equal_the_plain_autocovariance():
    """One unbroken stretch gives sum (x_j - m)(x_{j+k} - m) at every lag, and N - k pairs."""
    x = np.random.default_rng(2).standard_normal(500).cumsum()
    cov, pairs = gathered(x).cell(0).covariances()
    d = x - x.mean()
    assert cov == pytest.approx([float(d[: d.size - k] @ d[k:]) for k in range(LAGS + 1)], rel=1e-9, abs=1e-6)
    assert pairs.tolist() == [500 - k for k in range(LAGS + 1)]


def test_lag_products_never_pair_samples_of_different_tracks_or_stretches():
    """Tracks interleaved row by row, each broken by another bin, give the sum over their unbroken stretches."""
    rng = np.random.default_rng(3)
    x, track = rng.standard_normal(400), np.tile([0, 1], 200)
    cell = np.where((np.arange(400) // 100) % 2 == 0, 0, 1)
    got, pairs = gathered(x, cell=cell, track=track).cell(0).covariances()
    here = cell == 0
    stretch = (np.arange(400) // 200) * 2 + track
    order = np.lexsort((np.arange(400), stretch))
    order = order[here[order]]
    expected = lag_sums(x[order], LAGS, stretch[order])
    assert got / here.sum() == pytest.approx(expected.autocovariance(), abs=1e-12)
    assert pairs[1] == 4 * 49


def test_weighted_lag_products_are_those_of_every_unbroken_stretch():
    """Two tracks interleaved, each broken by another bin: products of the scaled samples written out, pair by pair."""
    rng = np.random.default_rng(13)
    x, track, r = rng.standard_normal(400) * 5, np.tile([0, 1], 200), np.linspace(5e4, 2e4, 400)
    kind = np.where((np.arange(400) // 100) % 2 == 0, 0, 1)
    cell = gathered(x, cell=kind, track=track, rng=r, cross=np.full(400, 1e4)).cell(0)
    found = cell.weighted_lag_sums(c.ANGLE_WEIGHT, 0.5)
    scaled = np.sqrt(q_cv(0.4, 0.1) / (r * r - 1e8)) * (x - 0.5)
    stretches = [scaled[(track == t) & (np.arange(400) // 100 == part)] for t in (0, 1) for part in (0, 2)]
    for k in range(LAGS + 1):
        assert found.pairs[k] == sum(max(s.size - k, 0) for s in stretches)
        assert found.products[k] == pytest.approx(sum(float(s[: s.size - k] @ s[k:]) for s in stretches), abs=1e-12)
    assert found.longest == 50


def test_a_missing_update_keeps_its_place():
    """A coasted update inside a stretch counts at no lag, and does not shift the others' lags."""
    x = np.random.default_rng(4).standard_normal(300)
    x[[50, 51, 170]] = np.nan
    got, pairs = gathered(x).cell(0).covariances()
    d = np.where(np.isnan(x), 0.0, x - np.nanmean(x))
    there = (~np.isnan(x)).astype(float)
    assert got == pytest.approx([float(d[: 300 - k] @ d[k:]) for k in range(LAGS + 1)], abs=1e-9)
    assert pairs == pytest.approx([float(there[: 300 - k] @ there[k:]) for k in range(LAGS + 1)])


@pytest.mark.parametrize("pieces", [2, 3, 17])
def test_the_same_samples_in_more_pieces_give_the_same_bits(pieces):
    """Where a log is cut into pieces leaves no trace, not even in the last bit."""
    rng = np.random.default_rng(5)
    x, cell, track = rng.standard_normal(9000), rng.integers(0, 3, 9000), rng.integers(0, 4, 9000)
    snr = rng.uniform(10, 30, 9000)
    whole, cut = (gathered(x, cell=cell, track=track, cross=np.full(9000, 1e3), snr=snr, pieces=k) for k in (1, pieces))
    for i in range(3):
        a, b = whole.cell(i), cut.cell(i)
        for name in ("sums", "products", "sketch", "kept"):
            assert np.array_equal(getattr(a, name), getattr(b, name)), name


def test_cells_add_up():
    """Merging the cells of two groups gives the sums of all their samples together."""
    rng = np.random.default_rng(6)
    x = np.concatenate([rng.standard_normal(700) * 3 + 5, rng.standard_normal(300) - 8])
    cell = np.repeat([0, 1], [700, 300])
    y, snr = rng.uniform(0, 1e4, 1000), rng.uniform(5, 40, 1000)
    a = rng.uniform(0.2, 0.6, 1000)
    parts = gathered(x, cell=cell, cross=y, snr=snr, alpha=a)
    both = Cell.merged([parts.cell(0), parts.cell(1)])
    whole = gathered(x, cross=y, snr=snr, alpha=a).cell(0)
    same = [i for i in range(c.N_STRETCH) if i not in {c.SHIFT, c.Q1, c.Q2, c.W1, c.W2, c.U1, c.U2, c.V1, c.V2}]
    assert both.sums[same] == pytest.approx(whole.sums[same], rel=1e-9)
    assert both.centred(c.U0, 1.5) == pytest.approx(whole.centred(c.U0, 1.5), rel=1e-10)
    assert both.median() == whole.median()
    assert both.n == whole.n


def test_medians_of_many_samples_come_from_buckets_and_are_close():
    """Beyond the samples kept, median and median deviation agree with numpy within 0.2 % of the spread."""
    x = np.random.default_rng(7).standard_normal(60_000) * 12 + 4
    cell = gathered(x).cell(0)
    assert not cell.exact
    assert cell.median() == pytest.approx(np.median(x), abs=0.002 * 12)
    assert cell.median_absolute_deviation() == pytest.approx(np.median(np.abs(x - np.median(x))), rel=0.002)


def test_thinned_samples_are_every_second_then_every_fourth():
    """The samples kept for plots are evenly spaced over the whole log."""
    n = 3 * c.KEPT
    cell = gathered(np.arange(n, dtype=float)).cell(0)
    assert cell.stride == 4
    assert cell.kept[0].tolist() == list(range(0, n, 4))


def test_startup_leaves_out_the_first_updates_of_a_track_and_after_a_lasting_gain_jump():
    """With alpha 0.5 the first 22 updates go, and 29 more when alpha falls to 0.38 and stays; a restart likewise."""
    alpha = np.r_[np.full(100, 0.5), np.full(100, 0.38)]
    cell = gathered(np.ones(200), alpha=alpha, startup=11.0).cell(0)
    assert cell.startup == 22 + 29
    assert cell.n == 149
    mark = np.zeros(200, np.int8)
    mark[60] = c.RESTART
    assert gathered(np.ones(200), alpha=np.full(200, 0.5), startup=11.0, mark=mark).cell(0).startup == 44


def test_gains_that_jump_all_the_time_do_not_empty_the_bin():
    """Gains that alternate have no settled state to come back to: only the start of the track is left out."""
    alpha = np.tile([0.3, 0.7], 500)
    cell = gathered(np.ones(1000), alpha=alpha, startup=11.0).cell(0)
    assert cell.n > 900


def test_unusable_samples_are_not_counted():
    """A missing residual or gain, and gains on or outside the stability triangle, leave a sample out."""
    x = [1.0, np.nan, np.inf, 1.0, 1.0, 1.0, 1.0, 1.0]
    alpha = [0.4, 0.4, 0.4, np.nan, 0.0, 1.8, 0.4, -0.1]
    beta = [0.1, 0.1, 0.1, 0.1, 0.0, 0.6, np.nan, 0.1]
    assert gathered(x, alpha=alpha, beta=beta).cell(0).n == 1


def test_legs_turn_where_the_range_turns():
    """Inbound to the closest point and outbound after it, in spite of noise, and never by a single sample."""
    n = 2000
    rng = np.abs(np.linspace(30e3, -30e3, n)) + 8e3 + np.random.default_rng(8).normal(0, 15, n)
    track = np.zeros(n, np.int32)
    mark, leg, duplicates = Follower().follow(np.arange(float(n)), track, rng, np.ones(n))
    turn = int(np.argmin(rng))
    assert set(leg[: turn - 3]) == {-1}
    assert set(leg[turn + 3 :]) == {1}
    assert np.count_nonzero(np.diff(leg)) == 1
    assert (mark[0], duplicates) == (c.RESTART, 0)


def test_a_coast_restarts_the_track_and_a_few_misses_do_not():
    """Five missed updates are a coast; two are not."""
    time = np.r_[np.arange(20), np.arange(22, 40), np.arange(46, 60)].astype(float)
    n = time.size
    mark, *_ = Follower().follow(time, np.zeros(n, np.int32), np.linspace(5e4, 4e4, n), np.ones(n))
    assert np.flatnonzero(mark).tolist() == [0, 38]


def test_the_same_update_twice_is_dropped_once():
    """A row equal to the one before it on the same track is marked; one that only shares its time is not."""
    time = np.array([0.0, 1.0, 1.0, 2.0, 2.0])
    mark, _, duplicates = Follower().follow(
        time, np.zeros(5, np.int32), np.array([5e4, 4e4, 4e4, 3e4, 3e4]), np.array([1.0, 2.0, 2.0, 3.0, 4.0])
    )
    assert duplicates == 1
    assert mark.tolist() == [c.RESTART, 0, c.DROP, 0, 0]


def test_cells_are_numbered_in_the_order_met():
    """Numbers stay what they were when later pieces bring more groups and bins."""
    numbers = CellNumbers()
    first = numbers.assign(np.array([0, 0, 1], np.int32), np.array([5, 2, 5], np.int32))
    second = numbers.assign(np.array([9, 0, 0], np.int32), np.array([500, 5, -1], np.int32))
    assert first.tolist() == [0, 1, 2]
    assert second.tolist() == [3, 0, -1]
    assert numbers.places() == [(0, 2, 1), (0, 5, 0), (1, 5, 2), (9, 500, 3)]
