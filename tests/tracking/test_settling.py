import numpy as np
import pytest

from rangeeval.tracking.alpha_beta import startup_length
from rangeeval.tracking.settling import restarts, settled


@pytest.mark.parametrize("alpha", [0.05, 0.1, 0.3, 0.5, 0.9])
def test_fixed_gains_leave_out_the_startup_length(alpha):
    """With one alpha exactly ceil(11 / alpha) updates of each track are left out."""
    a = np.full(600, alpha)
    track = np.repeat([7, 3], 300)
    kept = settled(a, restarts(a, track))
    length = int(startup_length(alpha))
    np.testing.assert_array_equal(np.flatnonzero(kept), [k for k in range(600) if k % 300 >= length])


def test_a_filter_starts_anew_after_a_jump_or_a_long_coast_only():
    """A jump of alpha beyond 20 % and a coast of more than 3 updates restart; slow drift and short
    coasts do not.
    """
    drift = 0.5 * 1.01 ** np.arange(6)
    alpha = np.concatenate([drift, [0, 0, 0], [0.53], [np.nan] * 4, [0.53, 0.53], [0.66], [0.66]])
    found = np.flatnonzero(restarts(alpha, np.zeros(alpha.size)))
    np.testing.assert_array_equal(found, [0, 14, 16])


def test_a_new_track_is_not_compared_with_the_old_one():
    """The first update of a track is a restart, also when it coasts first, and its alpha is no jump."""
    alpha, track = [0.9, 0.9, 0.0, 0.1, 0.1], [1, 1, 2, 2, 2]
    np.testing.assert_array_equal(restarts(alpha, track), [True, False, True, False, False])


def test_coasted_rows_add_no_memory():
    """Three missed updates among the first push the settled part back by three."""
    alpha = np.full(100, 0.5)
    alpha[3:6] = 0
    assert np.flatnonzero(settled(alpha, restarts(alpha, np.zeros(100))))[0] == 25


def test_nothing_and_mismatched_lists():
    """No rows give no rows; lists that do not pair up are refused."""
    assert restarts([], []).size == settled([], []).size == 0
    with pytest.raises(ValueError, match="two lists of the same length"):
        restarts([0.1, 0.2], [1])
