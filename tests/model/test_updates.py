"""Updates: each residual beside the gains of its track and time, whatever the order of the two logs."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rangeeval.errors import InputError
from rangeeval.model import Log, Table, Trial, gather, log_of, updates
from rangeeval.model import table as table_module

N = 60


def residuals(**more: object) -> Log:
    columns = {
        "time_s": np.repeat(np.arange(N // 3), 3) * 0.5,
        "track_id": ["A", "B", "C"] * (N // 3),
        "range_residual_m": np.arange(N) * 1.0,
        "range_predicted_m": np.full(N, 3e4),
    }
    return log_of("residuals", columns | more, "residuals")


def gains(rows: object = slice(None), shift: float = 0.0, **more: object) -> Log:
    columns = {
        "time_s": (np.repeat(np.arange(N // 3), 3) * 0.5 + shift)[rows],
        "track_id": np.array(["A", "B", "C"] * (N // 3))[rows],
        "alpha": (np.arange(N) / 100.0)[rows],
        "beta": (np.arange(N) / 1000.0)[rows],
    }
    return log_of("gains", columns | more, "gains")


def joined(*logs: Log, names: list[str] | None = None) -> tuple[Table, dict[str, int]]:
    tables = list(updates(Trial("trial", logs), names))
    last = tables[-1]
    whole = Table({n: np.concatenate([t.columns[n] for t in tables]) for n in last.columns}, last.labels)
    return whole, {p.reason: p.count for p in gather([p for t in tables for p in t.problems])}


def test_aligned_logs_are_put_side_by_side() -> None:
    """Rows in the same order: the gains of all three axes from alpha and beta, nothing to report."""
    table, problems = joined(residuals(), gains())
    assert problems == {}
    for axis in ("range", "y", "z"):
        np.testing.assert_array_equal(table.floats(f"alpha_{axis}"), np.arange(N) / 100)
        np.testing.assert_array_equal(table.floats(f"beta_{axis}"), np.arange(N) / 1000)
    assert list(table.columns)[:4] == ["time_s", "track_id", "range_residual_m", "range_predicted_m"]


def test_only_the_columns_asked_for_are_given() -> None:
    """The keys of the join are read when needed, and not given unless asked for."""
    table, _problems = joined(residuals(), gains(), names=["range_residual_m", "alpha_range"])
    assert list(table.columns) == ["range_residual_m", "alpha_range"]
    table, _problems = joined(residuals(), names=["range_residual_m"])
    assert list(table.columns) == ["range_residual_m"]


@settings(max_examples=60, deadline=None)
@given(st.randoms(use_true_random=False), st.integers(0, 10), st.sampled_from([1, 7, 20, 1000]))
def test_any_order_and_any_gap_gives_the_same_join(random: object, dropped: int, size: int) -> None:
    """Shuffled gain rows with some missing: every update has its own gains or is counted, whatever the piece size."""
    order = list(range(N))
    random.shuffle(order)  # type: ignore[attr-defined]
    kept = np.array(order[dropped:])
    with pytest.MonkeyPatch.context() as patch:
        for module in (table_module, __import__("sys").modules["rangeeval.model.updates"]):
            patch.setattr(module, "CHUNK_ROWS", size)
        table, problems = joined(residuals(), gains(kept))
    expected = np.where(np.isin(np.arange(N), kept), np.arange(N) / 100, np.nan)
    np.testing.assert_array_equal(table.floats("alpha_y"), expected)
    assert sum(n for reason, n in problems.items() if "updates without gains" in reason) == dropped
    np.testing.assert_array_equal(table.floats("range_residual_m"), np.arange(N))


@pytest.mark.parametrize("size", [6, 20, 1000])
def test_gains_of_no_update_and_strange_tracks_are_said(size: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows and tracks that only one of the logs has are counted and named."""
    for module in (table_module, __import__("sys").modules["rangeeval.model.updates"]):
        monkeypatch.setattr(module, "CHUNK_ROWS", size)
    ids = np.array(["A", "B", "D"] * (N // 3))
    table, problems = joined(residuals(), gains(track_id=ids))
    assert np.isnan(table.floats("alpha_y")).sum() == N // 3
    assert problems == {
        "updates without gains: gains has no row of their track and time": N // 3,
        "gains that belong to no update of residuals": N // 3,
        "tracks that gains does not have: C": 0,
        "tracks that residuals does not have: D": 0,
    }


@pytest.mark.parametrize("size", [6, 20, 1000])
def test_gains_after_the_last_update_are_counted(size: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A gain log that goes on longer joins without a copy, and its surplus is said."""
    for module in (table_module, __import__("sys").modules["rangeeval.model.updates"]):
        monkeypatch.setattr(module, "CHUNK_ROWS", size)
    longer = {
        "time_s": np.concatenate([np.repeat(np.arange(N // 3), 3) * 0.5, [99.0, 99.5]]),
        "track_id": [*(["A", "B", "C"] * (N // 3)), "A", "A"],
        "alpha": np.arange(N + 2) / 100,
    }
    table, problems = joined(residuals(), log_of("gains", longer, "gains"), names=["alpha_range"])
    np.testing.assert_array_equal(table.floats("alpha_range"), np.arange(N) / 100)
    assert problems == {"gains that belong to no update of residuals": 2}


def test_times_may_differ_by_less_than_the_tolerance() -> None:
    """1e-6 s apart is the same update; 1e-3 s is not."""
    assert joined(residuals(), gains(shift=5e-7))[1] == {}
    shuffled = np.arange(N)[::-1]
    assert joined(residuals(), gains(shuffled, shift=5e-7))[1] == {}
    _table, problems = joined(residuals(), gains(shift=1e-3))
    assert problems["updates without gains: gains has no row of their track and time"] == N


def test_equal_times_take_gains_in_their_order() -> None:
    """The k-th of equal (track, time) updates takes the k-th of the equal gains."""
    log = log_of(
        "residuals",
        {"time_s": [0, 1, 1, 2], "range_residual_m": [0, 1, 2, 3], "range_predicted_m": [3e4] * 4},
    )
    other = log_of("gains", {"time_s": [2, 1, 0, 1], "alpha": [0.3, 0.1, 0.0, 0.2], "beta": [0.0] * 4})
    table, problems = joined(log, other)
    assert table.floats("alpha_range").tolist() == [0.0, 0.1, 0.2, 0.3]
    assert problems == {}


def test_gains_in_the_residual_log_are_used_themselves() -> None:
    """A log with its own gains needs no other; another one there is not used, and that is said."""
    log = residuals(alpha=np.full(N, 0.5), beta_y=np.full(N, 0.1))
    table, problems = joined(log)
    assert table.floats("alpha_z").tolist() == [0.5] * N
    assert "beta_range" not in table
    assert problems == {}
    full = residuals(alpha=np.full(N, 0.5), beta=np.full(N, 0.1))
    table, problems = joined(full, gains())
    assert table.floats("alpha_z").tolist() == [0.5] * N
    assert problems == {"not used: residuals holds the gains of its updates itself": 0}


def test_no_gains_is_one_clear_line() -> None:
    """Asking for gains that no log has says what is needed."""
    with pytest.raises(
        InputError, match=r"no gains in trial: the columns alpha and beta, or alpha_range, .* are needed"
    ):
        list(updates(Trial("trial", (residuals(),))))


def test_direction_sines_become_y_and_z() -> None:
    """y and z are the sine times the predicted range."""
    log = residuals(sin_elevation_residual=np.full(N, 1e-3), sin_azimuth_predicted=np.full(N, 0.5))
    table, _problems = joined(log, gains())
    assert table.floats("y_residual_m").tolist() == [30.0] * N
    assert table.floats("z_predicted_m").tolist() == [15e3] * N
    only, _problems = joined(log, names=["y_residual_m"])
    assert list(only.columns) == ["y_residual_m"]


def test_residuals_after_the_update_are_converted() -> None:
    """r_predicted = r_updated / (1 - alpha); alpha of 1 or more makes the residual missing, and is said."""
    alpha = np.full(N, 0.75)
    alpha[4] = 1.0
    log = residuals(alpha=alpha, beta=np.full(N, 0.1))
    log = Log(log.kind, log.source, log.columns, log.pieces, log.rows, "updated")
    table, problems = joined(log, names=["range_residual_m"])
    expected = np.arange(N) * 4.0
    expected[4] = np.nan
    np.testing.assert_array_equal(table.floats("range_residual_m"), expected)
    assert list(problems.values()) == [1]
    bare = residuals()
    bare = Log(bare.kind, bare.source, bare.columns, bare.pieces, bare.rows, "updated")
    with pytest.raises(InputError, match="to convert residuals after the update"):
        list(updates(Trial("trial", (bare,)), ["range_residual_m"]))


def test_an_empty_log_has_no_updates() -> None:
    """N = 0 is an empty table, not an error."""
    log = log_of("residuals", {"time_s": [], "range_residual_m": [], "range_predicted_m": []})
    table, problems = joined(log, log_of("gains", {"time_s": [], "alpha": [], "beta": []}))
    assert len(table) == 0
    assert problems == {}
