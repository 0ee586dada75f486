"""Replay of plots whose target, noise and mishaps were chosen."""

import io
import json
import math

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

import rangeeval
from rangeeval.analyses.replay import replay, run_replay
from rangeeval.analyses.replay.logs import as_csv
from rangeeval.cli import cli
from rangeeval.errors import RangeevalError
from rangeeval.model import Bins, Trial, log_of
from rangeeval.model.settings import settings_from
from rangeeval.physics.polar import polar
from rangeeval.tracking.alpha_beta import filtered_variance

BINS = Bins(width=10e3)
SIGMA = (12.0, 1e-3, 1.5e-3)
KALMAN = {"replay": {"process_noise_m_s2": [2.0]}}


def flight(t, seed=0, acceleration=2.0):
    """A target inbound at 200 m/s with white acceleration each second: positions north, up, east."""
    rng = np.random.default_rng([7, seed])
    steps = int(t[-1]) + 3
    a = rng.normal(size=(steps, 3)) * acceleration
    v = np.array([-180.0, 0.0, 60.0]) + np.vstack([np.zeros(3), np.cumsum(a, axis=0)])
    p = np.array([60e3, 6e3, -20e3 + 9e3 * seed]) + np.vstack([np.zeros(3), np.cumsum(v[:-1] + a / 2, axis=0)])
    k = np.floor(t).astype(int)
    u = (t - k)[:, None]
    return p[k] + v[k] * u + a[k] * u**2 / 2


def target(name="A", seed=0, n=250, sigma=SIGMA, step=1.0, acceleration=2.0):
    """Plots and truth of one target."""
    rng = np.random.default_rng([3, seed])
    t = np.arange(n) * step + 0.1 * seed
    p = flight(t, seed, acceleration)
    z = polar(p) + rng.normal(size=(n, 3)) * sigma
    plots = {
        "time_s": t, "target_id": [name] * n, "range_m": z[:, 0], "azimuth_rad": np.mod(z[:, 1], 2 * np.pi),
        "elevation_rad": z[:, 2],
    }  # fmt: skip
    when = np.arange(0.0, t[-1] + 1, 0.5)
    q = flight(when, seed, acceleration)
    true = {"time_s": when, "target_id": [name] * len(when), "north_m": q[:, 0], "up_m": q[:, 1], "east_m": q[:, 2]}
    return plots, true


def joined(tables):
    return {n: np.concatenate([np.asarray(t[n]) for t in tables]) for n in tables[0]}


def trial_of(plots, true=None, settings=None):
    logs = [log_of("plots", plots, "plots")] + ([log_of("truth", true, "truth")] if true else [])
    return Trial("made-up", tuple(logs), settings_from(settings or {}))


def whole(result, quantity, track=None, group=None):
    return next(
        r for r in result.rows
        if r.quantity == quantity and r.variable is None and r.track_id == track and r.group == group
    )  # fmt: skip


def given(sigma=SIGMA, **more):
    own = {"range_sigma_m": sigma[0], "azimuth_sigma_deg": math.degrees(sigma[1]),
           "elevation_sigma_deg": math.degrees(sigma[2]), **more}  # fmt: skip
    return {"replay": own}


def test_a_filter_whose_assumptions_hold_passes_its_own_tests():
    """Kalman with the right noises: NIS and NEES inside their acceptance regions, innovations white, errors below the plots'."""
    tables = [target(f"T{k}", k) for k in range(4)]
    trial = trial_of(joined([p for p, _ in tables]), joined([t for _, t in tables]),
                     given(filter="kalman", process_noise_m_s2=[2.0]))  # fmt: skip
    result = replay(trial, BINS)
    nis = whole(result, "nis_mean")
    assert nis.extra["accept_low"] < nis.value < nis.extra["accept_high"]
    assert nis.low < 3.0 < nis.high
    assert nis.n == whole(result, "updates").value == 4 * 247
    assert not {"optimistic", "pessimistic"} & set(whole(result, "nis_ratio").flags)
    for c in ("range", "azimuth", "elevation"):
        assert whole(result, f"{c}_whiteness_p").value > 1e-3
        assert "given" in whole(result, f"{c}_noise").flags
    assert whole(result, "nees_mean").value == pytest.approx(6.0, rel=0.12)
    assert whole(result, "position_rms").value < 0.8 * whole(result, "plot_rms").value
    for axis, direction in (("x", "east"), ("y", "north"), ("z", "up")):
        assert whole(result, f"{axis}_rms").extra["axis"] == direction


def test_rms_errors_are_those_of_the_state_against_the_truth():
    """Recomputed from the run itself, axis by axis."""
    plots, true = target()
    trial = trial_of(plots, true, given(filter="kalman"))
    done = run_replay(trial)
    run = done.runs[0]
    north, up, east = flight(run.measurements.time_s).T
    used = run.used
    result = replay(trial, BINS)
    for axis, k, truth in (("x", 0, east), ("y", 1, north), ("z", 2, up)):
        expected = np.sqrt(np.mean((run.state[used, k] - truth[used]) ** 2))
        assert whole(result, f"{axis}_rms").value == pytest.approx(expected, rel=1e-3)


def test_noise_nobody_gave_is_estimated_from_the_plots_and_said():
    """Within its interval; too few plots: assumed, flagged."""
    result = replay(trial_of(target(n=600, step=0.5)[0]), BINS)
    for c, s in zip(("range", "azimuth", "elevation"), SIGMA, strict=True):
        row = whole(result, f"{c}_noise")
        assert row.low <= s <= row.high, c
        assert "from-scatter" in row.flags
    few = replay(trial_of(target(n=5)[0]), BINS)
    assert "assumed-noise" in whole(few, "range_noise").flags
    assert "assumed-noise" in whole(few, "nis_mean").flags


def test_rows_of_tracks_follow_the_pooled_row_and_add_up():
    """Updates and log-likelihood of the tracks sum to those of all together; bins hold each update once."""
    tables = [target(f"T{k}", k)[0] for k in range(3)]
    result = replay(trial_of(joined(tables)), BINS, per_track=True)
    for quantity in ("updates", "log_likelihood"):
        rows = [r for r in result.rows if r.quantity == quantity]
        assert rows[0].track_id is None
        assert rows[0].variable is None
        tracks = [r.value for r in rows if r.variable is None and r.track_id]
        assert len(tracks) == 3
        assert sum(tracks) == pytest.approx(rows[0].value)
        assert sum(r.value for r in rows if r.variable and not r.track_id) == pytest.approx(rows[0].value)


def test_plots_without_names_become_the_same_tracks():
    """Three targets, no target_id: association finds three tracks and the same errors."""
    tables = [target(f"T{k}", k) for k in range(3)]
    plots, true = joined([p for p, _ in tables]), joined([t for _, t in tables])
    named = replay(trial_of(plots, true, given()), BINS)
    del plots["target_id"]
    for method in (None, "nearest", "pda"):
        found = replay(trial_of(plots, true, given()), BINS, association=method)
        assert found.settings["counts"]["tracks"] == 3
        a, b = whole(named, "position_rms").value, whole(found, "position_rms").value
        assert b == pytest.approx(a, rel=0.1)
        assert whole(found, "track_completeness").value > 0.97
        assert whole(found, "track_ambiguity").value == 1.0
        assert whole(found, "track_spuriousness").value < 0.02


def test_a_target_lost_for_a_while_counts_as_lost_and_found():
    """A gap of 60 s in the plots, none in the truth: one break, the missing share of completeness, no wild track."""
    plots, true = target(n=300)
    keep = (plots["time_s"] < 100) | (plots["time_s"] > 160)
    plots = {n: np.asarray(c)[keep] for n, c in plots.items()}
    result = replay(trial_of(plots, true, given(filter="imm")), BINS)
    assert whole(result, "track_breaks", track="A").value == 1
    assert whole(result, "identity_changes", track="A").value == 0
    # Held while it coasts, until the 30 s of the restart are over.
    assert 0.85 < whole(result, "track_completeness").value < 0.97
    assert whole(result, "position_rms").value < 200


def test_irregular_times_and_misses_are_no_trouble():
    """Three plots in five, at random times: still consistent."""
    rng = np.random.default_rng(11)
    plots, true = target(n=900, step=0.5)
    keep = np.sort(rng.choice(900, 540, replace=False))
    plots = {n: np.asarray(c)[keep] for n, c in plots.items()}
    row = whole(replay(trial_of(plots, true, given(filter="kalman", process_noise_m_s2=[2.0])), BINS), "nis_ratio")
    assert row.value == pytest.approx(1.0, abs=0.1)


def test_filters_are_compared_update_by_update():
    """On a target that turns hard the IMM is better than a Kalman filter made for straight flight, and the rows say so."""
    plots, true = target(acceleration=15.0)
    trial = trial_of(plots, true, given(filter="imm"))
    result = replay(trial, BINS, compare=["kalman-ca", "imm"])
    groups = {r.group for r in result.rows}
    assert {None, "imm", "kalman-ca", "kalman-ca less imm"} <= groups
    difference = next(r for r in result.rows if r.quantity == "log_likelihood_difference")
    a, b = (whole(result, "log_likelihood", group=g) for g in ("kalman-ca", "imm"))
    assert a.n == b.n == difference.n
    assert difference.value * difference.n == pytest.approx(a.value - b.value, rel=1e-6)
    assert set(difference.flags) & {"better", "worse", "not-told-apart"}


WRONG = {"range_sigma_m": 20.0, "azimuth_sigma_deg": 0.1, "elevation_sigma_deg": 0.05}


def test_tuning_finds_noise_and_manoeuvre_from_wrong_beginnings():
    """Started from noises twice off: every chosen value in its interval, and the likelihood gains on unseen tracks too."""
    tables = [target(f"T{k}", k)[0] for k in range(5)]
    result = replay(trial_of(joined(tables), settings={"replay": WRONG}), BINS, filter="kalman", tune=True)
    chosen = dict(
        zip(("range_noise", "azimuth_noise", "elevation_noise", "process_noise_1"), (*SIGMA, 2.0), strict=True)
    )
    for name, value in chosen.items():
        row = whole(result, f"tuned_{name}")
        assert row.low < value < row.high, row
        assert row.high / row.low < 1.5
        assert "tuned" in row.flags
    assert whole(result, "tuning_gain_held_out").low > 0
    assert whole(result, "nis_ratio").value == pytest.approx(1.0, abs=0.05)
    assert whole(result, "range_noise").value == whole(result, "tuned_range_noise").value


def test_a_target_that_flies_straight_leaves_the_process_noise_at_its_floor():
    """The likelihood asks for none: the floor, flagged, without an interval."""
    plots, _ = target(acceleration=0.0)
    row = whole(
        replay(trial_of(plots, settings={"replay": WRONG}), BINS, filter="kalman", tune=True), "tuned_process_noise_1"
    )
    assert row.value == pytest.approx(0.1, rel=1e-2)
    assert "at-floor" in row.flags
    assert math.isnan(row.low)


@pytest.mark.slow
def test_intervals_of_tuned_values_hold_them_about_as_often_as_they_say():
    """One recorded track of 150 plots, 60 times: of 240 intervals at least 88 % hold their value."""
    held = 0
    for seed in range(60):
        plots, _ = target(seed=seed, n=150)
        result = replay(trial_of(plots, settings={"replay": WRONG}), BINS, filter="kalman", tune=True)
        names = ("range_noise", "azimuth_noise", "elevation_noise", "process_noise_1")
        for name, value in zip(names, (*SIGMA, 2.0), strict=True):
            row = whole(result, f"tuned_{name}")
            held += row.low <= value <= row.high
    assert held >= 0.88 * 240


@pytest.mark.slow
def test_an_imm_filter_is_tuned_with_all_its_parameters():
    """Noise in its interval; two models' noises and persistence come out, the likelihood gains."""
    tables = [target(f"T{k}", k, acceleration=4.0)[0] for k in range(3)]
    result = replay(trial_of(joined(tables), settings={"replay": WRONG}), BINS, filter="imm", tune=True)
    for name, value in zip(("range_noise", "azimuth_noise", "elevation_noise"), SIGMA, strict=True):
        row = whole(result, f"tuned_{name}")
        assert row.low < value < row.high
    assert whole(result, "tuning_gain").low > 0
    assert {"tuned_process_noise_2", "tuned_turn_prior_2", "tuned_stay_probability_1"} <= {
        r.quantity for r in result.rows
    }


def test_what_cannot_be_tuned_is_said():
    """Alpha-beta has no likelihood; ten plots are too few."""
    with pytest.raises(RangeevalError, match="kalman or imm"):
        replay(trial_of(target()[0]), BINS, filter="alpha-beta", tune=True)
    with pytest.raises(RangeevalError, match="too few to tune"):
        replay(trial_of(target(n=10)[0]), BINS, filter="kalman", tune=True)


def shaken(what):
    """Plots of one target after one mishap."""
    plots, _ = target(n={"one plot": 1, "two plots": 2, "three plots": 3}.get(what, 200))
    plots = {n: np.array(c) for n, c in plots.items()}
    if what == "repeated times":
        plots["time_s"][50:53] = plots["time_s"][50]
    if what == "40 s gap":
        keep = (plots["time_s"] < 80) | (plots["time_s"] > 120)
        plots = {n: c[keep] for n, c in plots.items()}
    if what == "no elevation":
        del plots["elevation_rad"]
    if what == "elevation missing in places":
        plots["elevation_rad"][::3] = np.nan
    if what == "overhead pass":
        t = plots["time_s"]
        z = polar(np.stack([20e3 - 200 * t, 0 * t + 3000, 0.5 * t], -1))
        rng = np.random.default_rng(1)
        z = z + rng.normal(size=z.shape) * SIGMA
        plots |= {"range_m": z[:, 0], "azimuth_rad": np.mod(z[:, 1], 2 * np.pi), "elevation_rad": z[:, 2]}
    if what == "azimuth through north":
        plots["azimuth_rad"] = np.mod(plots["azimuth_rad"] - plots["azimuth_rad"][100], 2 * np.pi)
    if what == "jump of 100 km":
        plots["range_m"][100] += 100e3
    if what == "jump of 100 km that lasts":
        plots["range_m"][100:] += 100e3
    if what == "out of order":
        plots = {n: c[::-1] for n, c in plots.items()}
    if what == "all plots twice":
        plots = joined([plots, plots])
    return plots


MISHAPS = {
    "one plot": "few-samples", "two plots": "few-samples", "three plots": "few-samples",
    "repeated times": "repeated-times", "40 s gap": "restarted", "no elevation": "planar",
    "elevation missing in places": "partial", "overhead pass": "", "azimuth through north": "",
    "jump of 100 km": "outliers", "jump of 100 km that lasts": "restarted", "out of order": "",
    "all plots twice": "repeated-times",
}  # fmt: skip


@pytest.mark.parametrize("name", ["kalman", "imm", "alpha-beta"])
@pytest.mark.parametrize(("what", "flag"), MISHAPS.items())
def test_mishaps_are_flagged_and_never_spread(what, flag, name):
    """A result with a flag; no row counts updates that were none; everything written is finite."""
    trial = trial_of(shaken(what), settings=given())
    result = replay(trial, BINS, filter=name)
    nis = whole(result, "nis_mean")
    if flag:
        assert flag in nis.flags, nis
    if what in ("one plot", "two plots", "three plots"):
        assert nis.n < 2
    else:
        assert 0.3 < whole(result, "nis_ratio").value < 3.0, whole(result, "nis_ratio")
        assert nis.n > 100
    json.loads(result.to_json(series=True))
    log = run_replay(trial, name).residuals()
    assert np.isfinite(np.asarray(log["range_predicted_m"], float)).all()


@pytest.mark.parametrize("name", ["kalman", "imm"])
@pytest.mark.parametrize(("factor", "flag"), [(100.0, "pessimistic"), (0.01, "gated")])
def test_noise_a_hundred_times_wrong_is_told(name, factor, flag):
    """Too large: the filter is pessimistic; too small: plots fall out of the gate by the hundred."""
    plots, true = target()
    settings = given(tuple(s * factor for s in SIGMA), filter=name)
    result = replay(trial_of(plots, true, settings), BINS)
    assert flag in whole(result, "nis_ratio").flags
    assert any("gate" in p.reason for p in result.problems) == (factor < 1)


def test_the_residual_log_is_what_the_filter_saw():
    """Residuals in metres along the face that looks at the target, gains in (0, 1], modes that sum to one."""
    plots, _ = target()
    done = run_replay(trial_of(plots, settings=given()), "imm")
    log, run = done.residuals(), done.runs[0]
    rows = run.used
    assert len(log["time_s"]) == np.count_nonzero(rows)
    np.testing.assert_allclose(log["range_residual_m"], run.innovation[rows, 0])
    across = run.predicted[rows, 0] * np.cos(run.predicted[rows, 2] + run.innovation[rows, 2])
    np.testing.assert_allclose(log["z_residual_m"], -across * np.sin(run.innovation[rows, 1]), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(log["mode_1_probability"] + log["mode_2_probability"], 1.0)
    for axis in ("range", "y", "z"):
        assert ((log[f"alpha_{axis}"] > 0) & (log[f"alpha_{axis}"] <= 1)).all()


def straight(name, seed, n=500):
    """Plots and true positions of a target at constant velocity."""
    rng = np.random.default_rng([5, seed])
    t = np.arange(n) + 0.1 * seed
    p = np.stack([90e3 - 150 * t, 5e3 + 0 * t, -20e3 + 8e3 * seed + 20 * t], -1)
    z = polar(p) + rng.normal(size=(n, 3)) * SIGMA
    plots = {"time_s": t, "target_id": [name] * n, "range_m": z[:, 0], "azimuth_rad": np.mod(z[:, 1], 2 * np.pi),
             "elevation_rad": z[:, 2]}  # fmt: skip
    return plots, p


@pytest.mark.parametrize("name", ["alpha-beta", "kalman"])
def test_the_chain_closes_from_plots_to_accuracy(tmp_path, name):
    """Plots of known noise, replayed, written, read again: accuracy finds the sigma that filter and noise make.

    Known twice: from the gains by theory, and from the truth, which accuracy never saw.
    """
    tables = [straight(f"T{k}", k) for k in range(6)]
    done = run_replay(trial_of(joined([p for p, _ in tables]), settings=given()), name)
    written = tmp_path / "residuals.csv"
    written.write_text(done.residuals_csv(), encoding="utf-8")
    found = rangeeval.accuracy(rangeeval.open_trial(written), Bins(width=20e3))
    errors = []
    for run, (_, p) in zip(done.runs, tables, strict=True):
        away = np.linalg.norm(run.state[50:, :3], axis=1) - np.linalg.norm(p[50:], axis=1)
        errors.append(away)
    log = done.residuals()
    theory = SIGMA[0] * np.sqrt(filtered_variance(np.median(log["alpha_range"]), np.median(log["beta_range"])))
    assert np.std(np.concatenate(errors)) == pytest.approx(theory, rel=0.06)
    rows = [r for r in found.rows if r.quantity == "range_sigma" and r.group is None and r.n > 200]
    assert len(rows) >= 3
    assert sum(r.low <= theory <= r.high for r in rows) >= len(rows) - 1
    for row in rows:
        assert row.value == pytest.approx(theory, rel=0.15)


def test_the_smoothed_trajectory_is_a_truth_log_and_nearer_the_truth(tmp_path):
    """Read back with velocity and covariance; better than the filter; its covariance fits its error."""
    plots, true = target(n=300)
    done = run_replay(trial_of(plots, true, given(filter="kalman", process_noise_m_s2=[2.0])))
    csv = tmp_path / "reference.csv"
    csv.write_text(done.reference_csv(), encoding="utf-8")
    log = rangeeval.open_trial(csv).log("truth")
    table = log.read()
    assert not table.problems
    t = table.floats("time_s")
    p = flight(t)
    error = np.stack([table.floats(f"{a}_m") for a in ("north", "up", "east")], -1) - p
    run = done.runs[0]
    filtered = run.state[:, [1, 2, 0]] - flight(run.measurements.time_s)
    inside = slice(20, -20)
    assert np.sqrt(np.mean(error[inside] ** 2)) < 0.8 * np.sqrt(np.mean(filtered[inside] ** 2))
    names = ("north", "up", "east")
    cov = np.empty((len(t), 3, 3))
    for i in range(3):
        for j in range(i, 3):
            cov[:, i, j] = cov[:, j, i] = table.floats(f"covariance_{names[i]}_{names[j]}_m2")
    nees = np.einsum("ni,ni->n", error, np.linalg.solve(cov, error[..., None])[..., 0])
    assert np.mean(nees[inside]) == pytest.approx(3.0, rel=0.35)
    with pytest.raises(RangeevalError, match="no covariances"):
        run_replay(trial_of(plots), "alpha-beta").reference()


def test_a_planar_reference_has_no_height(tmp_path):
    """Slant plane: up is 0, its covariance missing; the log is read all the same."""
    plots, _ = target()
    del plots["elevation_rad"]
    csv = tmp_path / "reference.csv"
    csv.write_text(run_replay(trial_of(plots, settings=given()), "imm").reference_csv(), encoding="utf-8")
    table = rangeeval.open_trial(csv).log("truth").read()
    assert (table.floats("up_m") == 0).all()
    assert np.isnan(table.floats("covariance_up_up_m2")).all()
    assert np.isfinite(table.floats("covariance_north_east_m2")).all()


def test_a_fixed_face_gives_its_own_axes():
    """With `face = "site"` y and z are those of the tilted face: the same residual vector, turned."""
    plots, _ = target()
    settings = given(face="site") | {"site": {"heading_deg": -20.0, "tilt_deg": 10.0}}
    a = run_replay(trial_of(plots, settings=settings), "imm").residuals()
    b = run_replay(trial_of(plots, settings=given()), "imm").residuals()
    np.testing.assert_allclose(a["range_residual_m"], b["range_residual_m"])
    assert np.abs(np.asarray(a["z_predicted_m"])).max() > 1000
    assert np.abs(np.asarray(b["z_predicted_m"])).max() == pytest.approx(0.0, abs=1e-6)


def test_settings_that_cannot_be_are_refused_in_one_line():
    """Filter, association, number of process noises, transition, variable."""
    plots, _ = target(n=20)
    for settings, word in (
        ({"filter": "imn"}, "imm"), ({"association": "nearby"}, "known"), ({"process_noise_m_s2": [1.0]}, "models"),
        ({"transition": [[0.5, 0.6], [0.1, 0.9]]}, "sum to 1"),
    ):  # fmt: skip
        with pytest.raises(RangeevalError, match=word):
            replay(trial_of(plots, settings={"replay": settings}), BINS)
    with pytest.raises(RangeevalError, match="aspect"):
        replay(trial_of(plots), Bins("aspect", 0.1))
    with pytest.raises(RangeevalError, match="not one usable plot"):
        replay(trial_of({**plots, "range_m": -np.ones(20)}), BINS)


def test_a_report_goes_on_where_plots_are_of_no_use():
    """Replay and truth are left out with their reason; the other analyses stand."""
    inbound = rangeeval.open_trial("sample_logs/inbound")
    bad = log_of("plots", {"time_s": [1.0], "range_m": [-1.0], "azimuth_rad": [0.0]}, "plots")
    results = rangeeval.evaluate(Trial("t", (*inbound.logs, bad), inbound.settings))
    assert "accuracy" in {r.analysis for r in results}
    assert "replay" not in {r.analysis for r in results}
    assert any("replay was left out" in p.reason for r in results for p in r.problems)


def test_the_command_writes_residuals_and_prints_results(tmp_path):
    """-o is the residual log, the results go to standard output; a .json gets the results."""
    run = CliRunner()
    csv, out = tmp_path / "residuals.csv", tmp_path / "results.json"
    done = run.invoke(cli, ["replay", "sample_logs/attitude", "--filter", "imm", "-o", str(csv), "--format", "json"])
    assert done.exit_code == 0, done.output
    data = json.loads(done.stdout)
    assert data["analysis"] == "replay"
    assert {"nis_mean", "log_likelihood", "updates", "x_rms", "y_rms", "z_rms"} <= {
        e["quantity"] for e in data["estimates"]
    }
    log = pd.read_csv(csv)
    assert {"time_s", "track_id", "range_residual_m", "alpha_range", "beta_z", "mode_1_probability"} <= set(log)
    assert rangeeval.open_trial(csv).logs[0].kind == "residuals"
    assert run.invoke(cli, ["replay", "sample_logs/attitude", "-o", str(out)]).exit_code == 0
    assert json.loads(out.read_text())["analysis"] == "replay"
    table = run.invoke(cli, ["replay", "sample_logs/attitude", "--filter", "kalman"])
    assert "NIS ratio" in table.output
    rows = run.invoke(cli, ["replay", "sample_logs/attitude", "--filter", "kalman", "--format", "csv"])
    assert "nis_mean" in set(pd.read_csv(io.StringIO(rows.stdout)).quantity)


def test_a_written_log_keeps_every_digit_of_its_times():
    """Seconds since 1970 with microseconds are read back as they were: 1.7 thousand million is no reason to round."""
    time = np.array([1.7e9 + 0.123456, 1.7e9 + 1.123456])
    written = as_csv({"time_s": time, "target_id": ["A", "A"], "range_m": np.array([1 / 3, np.nan])})
    head, *rows = (line.split(",") for line in written.splitlines())
    assert head == ["time_s", "target_id", "range_m"]
    assert [float(row[0]) for row in rows] == time.tolist()
    assert float(rows[0][2]) == 1 / 3
    assert rows[1][2] == ""
