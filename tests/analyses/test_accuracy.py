"""Accuracy on logs whose truth was chosen, and against the formulas written out on the same samples."""

import json

import numpy as np
import pytest

from rangeeval.analyses.accuracy import accuracy
from rangeeval.errors import InputError, RangeevalError, SettingsError
from rangeeval.model import Bins, Trial, TrialSettings, log_of
from rangeeval.model.settings import Radar
from rangeeval.stats.correlation import effective_samples_of
from rangeeval.stats.diagnostics import mad_sigma
from rangeeval.stats.intervals import sigma_interval
from rangeeval.stats.variance import angle_sigma, track_sigma
from rangeeval.tracking.alpha_beta import beta_from_alpha, q_cv, q_white, usable
from rangeeval.tracking.simulation import Scenario, simulate

AXES = ("range", "y", "z")


def columns(n=400, seed=0, alpha=0.5, bias=0.0):
    """A log of one track at about 50 km with white residuals of 10 m (range) and 30 m."""
    rng = np.random.default_rng(seed)
    data = {
        "time_s": np.arange(n) * 0.5,
        "range_predicted_m": 50_000.0 + np.arange(n) * 0.1,
        "y_predicted_m": np.full(n, 5_000.0),
        "z_predicted_m": np.full(n, -12_000.0),
    }
    for axis, sigma in zip(AXES, (10.0, 30.0, 30.0), strict=True):
        data[f"{axis}_residual_m"] = rng.standard_normal(n) * sigma + bias
        data[f"alpha_{axis}"] = np.full(n, alpha) if np.isscalar(alpha) else alpha
        data[f"beta_{axis}"] = beta_from_alpha(data[f"alpha_{axis}"])
    return data


def trial_of(data, **settings):
    """A trial in memory."""
    return Trial("made-up", (log_of("residuals", data),), TrialSettings(**settings))


def row(result, quantity, group=None, low=None):
    """The one row of a quantity, all samples together unless a group is named."""
    found = [
        r for r in result.rows if r.quantity == quantity and r.group == group and (low is None or r.bin_low == low)
    ]
    assert len(found) == 1, [(r.quantity, r.group, r.bin_low) for r in found]
    return found[0]


def varied(n=300, seed=1):
    """A log with varying gains, missing values, unstable gains and three bins."""
    rng = np.random.default_rng(seed)
    data = columns(n, seed)
    data["range_predicted_m"] = np.linspace(62_000, 48_000, n)
    for axis in AXES:
        data[f"alpha_{axis}"] = rng.uniform(0.25, 0.6, n)
        data[f"beta_{axis}"] = beta_from_alpha(data[f"alpha_{axis}"])
    data["range_residual_m"][[3, 50]] = np.nan
    data["alpha_range"][60], data["beta_range"][60] = 0.0, 0.0
    data["alpha_y"][70] = 1.9
    return data


@pytest.mark.parametrize("low", [45_000.0, 50_000.0, 55_000.0, 60_000.0])
def test_paper_estimator_is_the_papers_formula_on_every_usable_sample(low):
    """Divisor N - 1 without removing the mean, bin-mean gains, start-up included: range, y, z and both angles."""
    data = varied()
    result = accuracy(trial_of(data), Bins(), estimator="paper")
    inside = (data["range_predicted_m"] >= low) & (data["range_predicted_m"] < low + 5000)
    for axis in AXES:
        x, a, b = data[f"{axis}_residual_m"], data[f"alpha_{axis}"], data[f"beta_{axis}"]
        used = inside & usable(x, a, b)
        expected = track_sigma(x, a, b, q_cv, used=used, mode="paper")
        assert row(result, f"{axis}_sigma", low=low).value == pytest.approx(expected.sigma, rel=1e-12)
        assert row(result, f"{axis}_residual_sigma", low=low).value == pytest.approx(expected.sigma_residual, rel=1e-12)
        assert row(result, f"alpha_{axis}", low=low).value == pytest.approx(expected.alpha_mean, rel=1e-12)
        assert row(result, f"{axis}_sigma", low=low).n == expected.n
    for axis, angle in (("y", "elevation"), ("z", "azimuth")):
        x, a, b = data[f"{axis}_residual_m"], data[f"alpha_{axis}"], data[f"beta_{axis}"]
        expected = angle_sigma(
            x,
            a,
            b,
            data["range_predicted_m"],
            data[f"{axis}_predicted_m"],
            q_cv,
            used=inside & usable(x, a, b),
            mode="paper",
        )
        assert row(result, f"{angle}_sigma", low=low).value == pytest.approx(expected.sigma_rad, rel=1e-12)


def test_recommended_estimator_weights_each_sample_after_start_up():
    """Mean removed, each sample's own ratio and own R^2 - y^2, the first updates left out."""
    data = columns(400, alpha=0.5, bias=2.0)
    result = accuracy(trial_of(data), Bins())
    kept = np.arange(400) >= 22
    for axis, angle in (("range", None), ("y", "elevation"), ("z", "azimuth")):
        x, a, b = data[f"{axis}_residual_m"], data[f"alpha_{axis}"], data[f"beta_{axis}"]
        got = row(result, f"{axis}_sigma")
        expected = track_sigma(x, a, b, q_cv, used=kept)
        assert got.n == 378
        assert got.value == pytest.approx(expected.sigma_per_sample, rel=1e-12)
        assert row(result, f"{axis}_sigma_white").value == pytest.approx(
            track_sigma(x, a, b, q_white, used=kept).sigma_per_sample, rel=1e-12
        )
        assert got.n_eff == pytest.approx(effective_samples_of(x[kept]), rel=1e-9)
        low, high = sigma_interval(got.value, got.n_eff - 1, 0.95)
        assert (got.low, got.high) == pytest.approx((low, high), rel=1e-12)
        assert row(result, f"{axis}_residual_mean").value == pytest.approx(x[kept].mean(), rel=1e-12)
        assert row(result, f"{axis}_residual_sigma_robust").value == pytest.approx(mad_sigma(x[kept]), rel=1e-12)
        if angle:
            r, c = data["range_predicted_m"], data[f"{axis}_predicted_m"]
            expected_angle = angle_sigma(x, a, b, r, c, q_cv, used=kept)
            assert row(result, f"{angle}_sigma").value == pytest.approx(expected_angle.sigma_per_sample_rad, rel=1e-12)


def test_bracket_holds_whatever_the_motion():
    """min(alpha, 1 - alpha) and max(alpha, 1 - alpha) times the residual sigma enclose every model's sigma."""
    result = accuracy(trial_of(columns(alpha=0.3)), Bins())
    sigma = row(result, "range_residual_sigma").value
    assert row(result, "range_sigma_bracket_low").value == pytest.approx(0.3 * sigma, rel=1e-12)
    assert row(result, "range_sigma_bracket_high").value == pytest.approx(0.7 * sigma, rel=1e-12)
    for name in ("range_sigma", "range_sigma_white"):
        assert 0.3 * sigma <= row(result, name).value <= 0.7 * sigma


@pytest.mark.parametrize("n", [0, 1, 2])
def test_the_smallest_samples_give_no_value_and_no_exception(n):
    """A bin with N = 0, 1, 2 samples beside a full one: a missing value below two, a flag, never 0."""
    data = columns(200)
    data["range_predicted_m"] = np.where(np.arange(200) < 200 - n, 52_000.0, 58_000.0)
    data["range_residual_m"][-1] = 3.0
    result = accuracy(trial_of(data), Bins(), estimator="paper")
    if n == 0:
        assert not [r for r in result.rows if r.bin_low == 55_000.0]
        return
    got = row(result, "range_sigma", low=55_000.0)
    assert got.n == n
    assert "few-samples" in got.flags
    assert np.isnan(got.value) == (n < 2)
    json.loads(result.to_json(series=True))


def test_an_axis_with_no_usable_sample_in_a_bin_is_missing_not_zero():
    """Gains outside the stability triangle on one axis leave that axis without value; the others stand."""
    data = columns(200)
    data["alpha_y"][:] = 2.5
    result = accuracy(trial_of(data), Bins())
    assert np.isnan(row(result, "y_sigma").value)
    assert np.isnan(row(result, "elevation_sigma").value)
    assert row(result, "y_sigma").n == 0
    assert row(result, "range_sigma").value > 0
    assert any("stability triangle" in p.reason and p.count == 200 for p in result.problems)


def test_nothing_usable_is_one_clear_line():
    """A log without one usable update says why."""
    data = columns(50)
    for axis in AXES:
        data[f"alpha_{axis}"][:] = 0.0
    with pytest.raises(InputError, match=r"not one usable update in any bin.*stability triangle"):
        accuracy(trial_of(data), Bins())


def test_y_beyond_the_range_gives_no_angle():
    """A cross-range as long as the range is a frame or unit error: no angle, a flag, the metres stand."""
    data = columns(200)
    data["y_predicted_m"][:] = 60_000.0
    result = accuracy(trial_of(data), Bins())
    got = row(result, "elevation_sigma")
    assert np.isnan(got.value)
    assert "unobservable" in got.flags
    assert row(result, "y_sigma").value > 0


def test_legs_waveforms_and_attenuator_states_are_groups():
    """In- and outbound legs, waveforms and attenuator states get rows of their own after the row of all together."""
    n = 800
    data = columns(n)
    data["range_predicted_m"] = 50_000.0 + np.abs(np.linspace(-4000, 4000, n))
    data["waveform"] = np.where(data["range_predicted_m"] > 52_000, "LONG", "SHORT")
    data["attenuation_db"] = np.where(np.arange(n) < 600, 0.0, 10.0)
    result = accuracy(trial_of(data), Bins())
    rows = [r for r in result.rows if r.quantity == "range_sigma"]
    assert rows[0].group is None
    assert [r.group for r in rows[1:]] == [
        "inbound, waveform LONG, attenuation 0 dB",
        "inbound, waveform SHORT, attenuation 0 dB",
        "outbound, waveform LONG, attenuation 10 dB",
        "outbound, waveform SHORT, attenuation 0 dB",
        *([] if len(rows) == 5 else ["outbound, waveform SHORT, attenuation 10 dB"]),
    ]
    assert sum(r.n for r in rows[1:]) == rows[0].n


def test_per_track_rows_follow():
    """With per_track every track has its row, and they add up to all together."""
    data = columns(400)
    data["track_id"] = np.array(["A", "B"] * 200)
    result = accuracy(trial_of(data), Bins(), per_track=True)
    rows = [r for r in result.rows if r.quantity == "range_sigma"]
    assert [(r.track_id, r.group) for r in rows if r.track_id] == [("A", None), ("B", None)]
    assert sum(r.n for r in rows if r.track_id) == rows[0].n


def test_when_keeps_only_the_samples_it_names():
    """A limit in another unit is converted; an unknown column is an error with the nearest name."""
    data = columns(400)
    data["snr_db"] = np.where(np.arange(400) % 2 == 0, 25.0, 10.0)
    trial = trial_of(data)
    assert row(accuracy(trial, Bins(), when={"snr_db_min": 20.0}), "range_sigma").n == 189
    assert row(accuracy(trial, Bins(), when={"snr_linear_min": 100.0}), "range_sigma").n == 189
    with pytest.raises(SettingsError, match="did you mean 'snr_db'"):
        accuracy(trial, Bins(), when={"snr_bd_min": 20.0})


def test_duplicates_and_disorder_change_nothing():
    """Rows logged twice are counted once, rows out of order are put in order, and both are said."""
    data = columns(300)
    plain = accuracy(trial_of(data), Bins())
    order = np.arange(300)
    order[[100, 101]] = order[[101, 100]]
    twice = np.r_[order, order[250:]]
    messy = accuracy(trial_of({k: v[twice] for k, v in data.items()}), Bins())
    assert [r.value for r in messy.rows] == pytest.approx([r.value for r in plain.rows], nan_ok=True)
    reasons = " ".join(p.reason for p in messy.problems)
    assert "twice" in reasons
    assert "steps back" in reasons


def test_predicted_sigma_comes_from_snr_and_the_radars_parameters():
    """(c / 2B) / sqrt(2 SNR) through the filter, beside the assessed sigma with the interval of their ratio."""
    data = columns(600, alpha=0.5)
    data["snr_db"] = np.full(600, 20.0)
    radar = Radar(bandwidth_hz=1e6, beamwidth_elevation_deg=1.6, beamwidth_azimuth_deg=1.6, monopulse_slope=1.6)
    result = accuracy(trial_of(data, radar=radar), Bins())
    a, b = 0.5, float(beta_from_alpha(0.5))
    ratio = (2 * a * a - 3 * a * b + 2 * b) / (a * (4 - 2 * a - b))
    measured = 299_792_458 / 2e6 / np.sqrt(200)
    assert row(result, "predicted_range_sigma").value == pytest.approx(measured * np.sqrt(ratio), rel=1e-12)
    angle = np.deg2rad(1.6) / 1.6 / np.sqrt(200)
    assert row(result, "predicted_azimuth_sigma").value == pytest.approx(angle * np.sqrt(ratio), rel=1e-12)
    compared = row(result, "range_variance_ratio")
    expected = (row(result, "range_sigma").value / row(result, "predicted_range_sigma").value) ** 2
    assert compared.value == pytest.approx(expected)
    assert compared.low < expected < compared.high


@pytest.mark.parametrize(
    ("change", "flag"),
    [
        (lambda d: d["range_residual_m"].__iadd__(6.0), "biased"),
        (lambda d: d["range_residual_m"].__setitem__(slice(0, None, 40), 200.0), "outliers"),
        (lambda d: d["range_residual_m"].__setitem__(slice(0, None, 40), 200.0), "not-normal"),
        (lambda d: d["range_residual_m"].__imul__(np.linspace(0.3, 3, 600)), "range-varies"),
        (lambda d: d.__setitem__("range_residual_m", np.repeat(d["range_residual_m"][::3], 3)), "correlated"),
        (lambda d: d.__setitem__("range_residual_m", np.repeat(d["range_residual_m"][::3], 3)), "manoeuvre"),
    ],
)
def test_flags_say_what_is_wrong_and_a_sound_log_has_none(change, flag):
    """Each fault raises its flag; without it there is none."""
    data = columns(600, seed=5)
    assert row(accuracy(trial_of(data), Bins()), "range_sigma").flags == ()
    change(data)
    assert flag in row(accuracy(trial_of(data), Bins()), "range_sigma").flags


def test_heavy_tails_widen_the_interval():
    """With kurtosis k the degrees of freedom are 2 nu / (k - 1): a few large residuals make sigma less sure."""
    data = columns(600, seed=5)
    data["range_residual_m"][::20] *= 8.0
    got = row(accuracy(trial_of(data), Bins()), "range_sigma")
    kurtosis = row(accuracy(trial_of(data), Bins()), "range_residual_kurtosis").value
    assert "not-normal" in got.flags
    assert got.extra["nu"] == pytest.approx(2 * (got.n_eff - 1) / (kurtosis - 1))
    assert (got.low, got.high) == pytest.approx(sigma_interval(got.value, got.extra["nu"], 0.95))


def test_a_small_bin_borrows_the_correlation_of_all():
    """A bin of 40 samples beside one of 960: its n_eff comes from the correlation of all, not from its own noise."""
    x = filtered(np.random.default_rng(3), 1000, 0.5, 0.1715728752538099, 1.5)
    data = columns(1000)
    data["range_residual_m"] = x
    data["range_predicted_m"] = np.r_[np.full(960, 52_000.0), np.full(40, 57_000.0)]
    small = row(accuracy(trial_of(data), Bins()), "range_sigma", low=55_000.0)
    large = row(accuracy(trial_of(data), Bins()), "range_sigma", low=50_000.0)
    assert small.n == 40
    assert small.n_eff / 40 == pytest.approx(large.n_eff / large.n, rel=0.15)


def test_the_means_interval_counts_the_memory_of_the_samples():
    """Residuals that come in threes leave the mean three times as uncertain in variance (Newey-West, to 20 %)."""
    white = np.random.default_rng(2).standard_normal(3000)
    widths = []
    for x in (white, np.repeat(white[:1000], 3)):
        data = columns(3000)
        data["range_residual_m"] = x
        data["range_predicted_m"] = np.linspace(50_000, 54_000, 3000)
        got = row(accuracy(trial_of(data), Bins()), "range_residual_mean")
        widths.append(got.high - got.low)
    assert (widths[1] / widths[0]) ** 2 == pytest.approx(3.0, rel=0.25)


def test_floors_add_in_quadrature_to_the_predicted_sigma():
    """A range floor counts beside the thermal noise; without SNR nothing is predicted."""
    data = columns(600, alpha=0.5)
    assert not [
        r
        for r in accuracy(trial_of(data, radar=Radar(bandwidth_hz=1e6)), Bins()).rows
        if "predicted_range_sigma" in r.quantity
    ]
    data["snr_db"] = np.full(600, 20.0)
    plain, floored = (
        row(
            accuracy(trial_of(data, radar=Radar(bandwidth_hz=1e6, range_floor_m=f)), Bins()), "predicted_range_sigma"
        ).value
        for f in (0.0, 20.0)
    )
    b = float(beta_from_alpha(0.5))
    ratio = (0.5 - 1.5 * b + 2 * b) / (0.5 * (3 - b))
    assert floored**2 - plain**2 == pytest.approx(400.0 * ratio, rel=1e-9)


def test_a_floor_alone_predicts_what_it_can():
    """A log without SNR, a radar of known noise: the floor through the filter."""
    from rangeeval.tracking.alpha_beta import filtered_variance

    data = columns(600, alpha=0.5)
    got = row(accuracy(trial_of(data, radar=Radar(range_floor_m=3.0)), Bins()), "predicted_range_sigma").value
    assert got == pytest.approx(3.0 * np.sqrt(filtered_variance(0.5, beta_from_alpha(0.5))), rel=1e-9)


def test_what_a_known_association_gate_cut_off_is_given_back():
    """Normal residuals cut at two sigma lose 22.6 % of their variance; with the gate known sigma is right again."""
    x = np.random.default_rng(4).standard_normal(200_000) * 10
    x = x[np.abs(x) < 20][:20_000]
    data = columns(20_000)
    data["range_predicted_m"] = np.linspace(50_000, 54_000, 20_000)
    data["range_residual_m"] = x
    plain = row(accuracy(trial_of(data), Bins()), "range_residual_sigma").value
    known = accuracy(trial_of(data, radar=Radar(association_gate_sigmas=2.0)), Bins())
    assert plain == pytest.approx(8.8, rel=0.02)
    assert row(known, "range_residual_sigma").value == pytest.approx(10.0, rel=0.02)
    assert row(known, "range_sigma").value == pytest.approx(5.0, rel=0.02)


def test_small_sound_bins_are_not_called_outliers():
    """With 40 normal samples the two sigmas scatter by 15 %; the flag is up in few of 100 bins, and for one wild sample."""
    flagged = 0
    for seed in range(100):
        data = columns(62, seed=seed)
        flagged += "outliers" in row(accuracy(trial_of(data), Bins()), "range_sigma").flags
    assert flagged <= 6
    data["range_residual_m"][30] = 300.0
    assert "outliers" in row(accuracy(trial_of(data), Bins()), "range_sigma").flags


def test_range_noise_that_may_enter_an_angle_is_flagged():
    """tan(theta) sigma_R over R sigma_theta above 0.3: the flag, and a bound that adds the range noise."""
    data = columns(600)
    data["y_predicted_m"][:], data["z_predicted_m"][:] = 35_000.0, 0.0
    data["range_residual_m"] *= 10
    result = accuracy(trial_of(data), Bins())
    got = row(result, "elevation_sigma")
    assert "range-leak" in got.flags
    assert "range-leak" not in row(result, "azimuth_sigma").flags
    assert row(result, "elevation_sigma_leak_bound").value > 1.5 * got.value


def test_a_target_far_off_boresight_is_flagged():
    """A cosine below 0.1 is grazing."""
    data = columns(300)
    data["y_predicted_m"] = data["range_predicted_m"] * 0.997
    assert "grazing" in row(accuracy(trial_of(data), Bins()), "elevation_sigma").flags


def test_series_hold_what_the_figures_need():
    """Histogram counts add up to the samples, quantiles are the samples against normal ones, extremes are there."""
    from scipy.special import ndtri

    n = 9000
    data = columns(n)
    data["range_predicted_m"] = np.linspace(50_000, 54_000, n)
    data["range_residual_m"][777] = 500.0
    result = accuracy(trial_of(data), Bins())
    used = row(result, "range_sigma").n
    assert sum(result.series["range/0/histogram"]["count"]) == pytest.approx(used, rel=1e-9)
    samples = result.series["range/0/samples"]
    assert 500.0 in samples["residual"]
    assert samples["time_s"] == sorted(samples["time_s"])
    assert len(samples["time_s"]) < 1000
    small = accuracy(trial_of({k: v[:122] for k, v in data.items()}), Bins())
    qq = small.series["range/0/qq"]
    assert qq["residual"] == sorted(data["range_residual_m"][22:122])
    assert qq["normal"] == pytest.approx(ndtri((np.arange(100) + 0.5) / 100))


def test_gains_that_switch_inside_a_bin_are_flagged():
    """Two gain levels in one bin put the bin-mean formula off by over 2 %."""
    alpha = np.repeat([0.2, 0.8], 500)
    data = columns(1000, alpha=alpha)
    data["range_residual_m"] *= np.where(alpha > 0.5, 1.0, 3.0)
    assert "gains-vary" in row(accuracy(trial_of(data), Bins(), estimator="paper"), "range_sigma").flags


def test_quantities_of_the_contract_are_there():
    """The fixed names, with units."""
    data = columns(300)
    data["snr_db"] = np.full(300, 20.0)
    found = {r.quantity: r.unit for r in accuracy(trial_of(data), Bins()).rows}
    for axis in AXES:
        for name in ("residual_sigma", "residual_mean", "sigma", "sigma_bracket_low", "sigma_bracket_high"):
            assert found[f"{axis}_{name}"] == "m"
        assert found[f"alpha_{axis}"] == found[f"beta_{axis}"] == "1"
    assert found["elevation_sigma"] == found["azimuth_sigma"] == "rad"
    assert found["snr"] == "dB"


def test_direction_sines_stand_for_y_and_z():
    """A log of sines gives what the same log in metres gives."""
    data = columns(300)
    sines = {k: v for k, v in data.items() if not k.startswith(("y_", "z_"))}
    r = data["range_predicted_m"]
    for axis, angle in (("y", "elevation"), ("z", "azimuth")):
        sines[f"sin_{angle}_residual"] = data[f"{axis}_residual_m"] / r
        sines[f"sin_{angle}_predicted"] = data[f"{axis}_predicted_m"] / r
    one, other = accuracy(trial_of(data), Bins()), accuracy(trial_of(sines), Bins())
    assert row(other, "elevation_sigma").value == pytest.approx(row(one, "elevation_sigma").value, rel=1e-9)


def test_one_alpha_and_beta_serve_all_axes():
    """A log with plain alpha, beta gives what three equal pairs give."""
    data = columns(300)
    short = {k: v for k, v in data.items() if not k.startswith(("alpha", "beta"))}
    short["alpha"], short["beta"] = data["alpha_range"], data["beta_range"]
    assert row(accuracy(trial_of(short), Bins()), "azimuth_sigma") == row(
        accuracy(trial_of(data), Bins()), "azimuth_sigma"
    )


@pytest.mark.parametrize("bad", [{"estimator": "papre"}, {"confidence": 1.0}, {"confidence": 0.0}])
def test_impossible_arguments_are_named(bad):
    """A wrong argument is a one-line error."""
    with pytest.raises(SettingsError):
        accuracy(trial_of(columns(50)), Bins(), **bad)


@pytest.mark.parametrize("variable", ["elevation", "azimuth", "snr", "time"])
def test_other_variables_can_be_binned(variable):
    """Bins of any variable hold all samples."""
    data = columns(300)
    data["snr_db"] = np.linspace(10, 30, 300)
    width, start = {"elevation": (0.01, -1.0), "azimuth": (0.01, -1.0), "snr": (5.0, 0.0), "time": (60.0, 0.0)}[
        variable
    ]
    result = accuracy(trial_of(data), Bins(variable=variable, width=width, start=start))
    assert sum(r.n for r in result.rows if r.quantity == "range_sigma" and r.group is None) == 278


def test_the_same_log_gives_the_same_bits():
    """Two runs, also with one thread, give the same JSON."""
    trial = trial_of(varied())
    assert accuracy(trial).to_json(series=True) == accuracy(trial).to_json(series=True)


def simulated(seed, flights=40, **changes):
    """A simulated trial and its log with truth."""
    log = simulate(Scenario(flights=flights, **changes), seed)
    names = ("time_s", "range_predicted_m", "y_predicted_m", "z_predicted_m", "snr_db")
    data = {name: getattr(log, name) for name in names}
    for axis in AXES:
        for name in (f"{axis}_residual_m", f"alpha_{axis}", f"beta_{axis}"):
            data[name] = getattr(log, name)
    data["track_id"] = log.track.astype(str)
    return trial_of(data), log


def test_assessed_sigma_is_the_true_one_for_constant_velocity():
    """On simulated flights the range sigma without truth is within 6 % of the error against truth in every bin."""
    trial, log = simulated(3)
    result = accuracy(trial, Bins())
    error = log.range_filtered_m - log.range_true_m
    for low in np.arange(15_000.0, 85_000.0, 5_000.0):
        inside = (log.range_predicted_m >= low) & (log.range_predicted_m < low + 5000)
        assert row(result, "range_sigma", low=low).value == pytest.approx(np.std(error[inside]), rel=0.06)


def filtered(rng, n, alpha, beta, design):
    """Residuals of an alpha-beta filter that follows a target of white acceleration `design` in unit noise."""
    residual = np.empty(n)
    x = v = estimate = speed = 0.0
    for k in range(n):
        a = rng.standard_normal() * design
        x, v = x + v + a / 2, v + a
        predicted = estimate + speed
        residual[k] = x + rng.standard_normal() - predicted
        estimate, speed = predicted + alpha * residual[k], speed + beta * residual[k]
    return residual


@pytest.mark.parametrize("alpha", [0.2, 0.3, 0.5])
def test_manoeuvre_far_beyond_the_design_is_flagged(alpha):
    """At six times the design acceleration, where intervals under-cover, the flag is up in 19 of 20 logs of 150 updates."""
    from rangeeval.tracking.alpha_beta import tracking_index

    beta = float(beta_from_alpha(alpha))
    flagged = 0
    for seed in range(20):
        residual = filtered(np.random.default_rng(seed), 300, alpha, beta, 6 * float(tracking_index(alpha, beta)))
        data = columns(150)
        data["range_residual_m"] = residual[150:]
        data["alpha_range"][:], data["beta_range"][:] = alpha, beta
        flagged += "manoeuvre" in row(accuracy(trial_of(data), Bins()), "range_sigma").flags
    assert flagged >= 19


@pytest.mark.parametrize("mult", [0.0, 1.0, 3.0])
def test_sigma_from_the_residuals_own_correlation_needs_no_motion_model(mult):
    """With 20,000 updates it is within 5 % of the truth at no, designed and tripled manoeuvre; the noise-only ratio is not."""
    from rangeeval.tracking.alpha_beta import steady_state_covariance, tracking_index

    alpha, beta = 0.6, float(beta_from_alpha(0.6))
    design = mult * float(tracking_index(alpha, beta))
    truth = float(np.sqrt(steady_state_covariance(alpha, beta, sigma_a=design)[0][0, 0]))
    data = columns(20_000)
    data["range_predicted_m"] = np.linspace(50_000, 54_000, 20_000)
    data["range_residual_m"] = filtered(np.random.default_rng(11), 20_000, alpha, beta, design)
    data["alpha_range"][:], data["beta_range"][:] = alpha, beta
    result = accuracy(trial_of(data), Bins())
    assert row(result, "range_sigma_autocovariance").value == pytest.approx(truth, rel=0.05)
    low, high = (row(result, f"range_sigma_bracket_{end}").value for end in ("low", "high"))
    assert low <= truth <= high


@pytest.mark.slow
@pytest.mark.parametrize(("alpha", "sigma_a"), [(0.5, 0.0), (0.3, 0.0), (0.5, 1.0), (0.7, 1.0)])
def test_intervals_of_the_whole_analysis_cover(alpha, sigma_a):
    """End to end, correlation estimated from the log itself: the 95 % interval of the residual sigma holds it 93-97 %.

    An alpha-beta filter on white noise, alone and with the manoeuvre its gains are made for; 400 logs of 300 updates.
    """
    from rangeeval.tracking.alpha_beta import residual_autocovariance, tracking_index

    beta = float(beta_from_alpha(alpha))
    design = sigma_a * float(tracking_index(alpha, beta))
    truth = float(np.sqrt(residual_autocovariance(alpha, beta, 0, sigma_a=design)[0]))
    held = 0
    for seed in range(400):
        residual = filtered(np.random.default_rng(seed), 400, alpha, beta, design)
        data = columns(400)
        data["range_residual_m"] = residual
        data["alpha_range"][:], data["beta_range"][:] = alpha, beta
        got = row(accuracy(trial_of(data), Bins()), "range_residual_sigma")
        held += got.low <= truth <= got.high
    assert 0.93 <= held / 400 <= 0.975


def test_plain_tables_are_as_good_as_a_trial():
    """A DataFrame, a dict of columns, or one table a log kind give what the trial gives."""
    import pandas as pd

    data = columns(300)
    expected = accuracy(trial_of(data)).to_json()
    gains = {k: v for k, v in data.items() if k.startswith(("alpha", "beta", "time"))}
    residuals = {k: v for k, v in data.items() if not k.startswith(("alpha", "beta"))}
    for source in (data, pd.DataFrame(data)):
        assert accuracy(source).rows == accuracy(trial_of(data)).rows
    apart = accuracy({"residuals": residuals, "gains": gains})
    assert [r.value for r in apart.rows] == pytest.approx([r.value for r in accuracy(data).rows], nan_ok=True)
    assert '"accuracy"' in expected
    with pytest.raises(InputError, match="of no kind of log"):
        accuracy({"a": [1.0]})
    with pytest.raises(InputError, match="open_trial reads files"):
        accuracy("folder")


def test_every_error_can_be_caught_as_one():
    """Every error is a RangeevalError, so that a caller can catch one thing."""
    with pytest.raises(RangeevalError):
        log_of("residuals", {"time_s": [0.0]})
