import numpy as np
import pytest

from rangeeval.stats.channels import Blocks, ChannelWatch


def watched(values, pieces=1):
    watch = ChannelWatch()
    marks = np.concatenate([watch.look(p) for p in np.array_split(values, pieces)])
    return watch, marks


def noise(n=5000, seed=1):
    return np.random.default_rng(seed).standard_normal(n)


def test_a_value_that_stands_still_is_marked_and_chance_is_not():
    """200 equal samples in a live channel are marked, all of them; the rest are not."""
    x = noise()
    x[1000:1200] = x[1000]
    watch, marks = watched(x)
    assert marks[1000:1200].all()
    assert marks.sum() == watch.stuck == 200
    assert not watched(noise())[1].any()


def test_coarse_steps_of_a_resting_sensor_are_not_stuck():
    """A sensor whose noise is a fifth of its step repeats itself for long, and is left alone."""
    x = np.round(0.2 * noise(50_000) + 0.35)
    watch, marks = watched(x)
    assert not marks.any()
    assert watch.saturated == 0


def test_a_ceiling_is_seen_and_a_highest_value_is_not():
    """Clipping at 1 sigma counts the clipped samples; an unclipped channel, quantised or not, counts none."""
    x = noise()
    assert watched(np.minimum(x, 1.0), 7)[0].saturated == np.count_nonzero(x >= 1.0)
    assert watched(np.clip(x, -1.5, 1.5), 3)[0].saturated == np.count_nonzero(np.abs(x) >= 1.5)
    assert watched(x)[0].saturated == 0
    assert watched(np.round(x, 1))[0].saturated == 0


def test_a_channel_that_never_changes_is_known():
    """A constant is no reading."""
    assert watched(np.full(100, 2.5))[0].constant
    assert not watched(noise(100))[0].constant


def test_blocks_are_means_that_never_cross_a_break_nor_outgrow_their_limit():
    """Whatever the pieces, the blocks are means of consecutive samples of one stretch, and their number is bounded."""
    x = np.arange(40_000.0)
    blocks = Blocks(1, limit=1000)
    for piece in np.array_split(x[:25_000], 11):
        blocks.add(piece[None])
    blocks.end()
    blocks.add(x[None, 25_000:])
    values, stretch = blocks.finish()
    assert blocks.size == 64
    assert values.shape[1] <= 1000
    for number, part in ((0, x[:25_000]), (1, x[25_000:])):
        inside = values[0, stretch == number]
        assert inside.min() >= part[0]
        assert inside.max() <= part[-1]
        assert np.diff(inside)[:-1] == pytest.approx(64.0)


def test_short_records_stay_as_they_are():
    """Below the limit every sample is its own block, missing ones too."""
    x = np.array([[1.0, np.nan, 3.0]])
    blocks = Blocks(1)
    blocks.add(x)
    values, _ = blocks.finish()
    assert values == pytest.approx(x, nan_ok=True)
