"""RCS by aspect, by target, over a sliding window and over range: bins, rows and curves of logs whose target was chosen."""

import math

import numpy as np
import pytest
from click.testing import CliRunner

from rangeeval.analyses.rcs import rcs
from rangeeval.cli import cli
from rangeeval.errors import SettingsError
from rangeeval.model import Bins, Trial, log_of
from rangeeval.model.settings import settings_from
from rangeeval.physics.radar_equation import sphere_rcs
from rangeeval.stats.proportions import exact_interval, wilson_interval
from rangeeval.stats.swerling import CASES, Looks, Windows
from rangeeval.stats.swerling.likelihood import fit, profile_interval

T = -math.log(1e-3)


def looks_at(mean, alpha, seed=1, shape=1.0, **columns):
    """A log of single pulses at a target of this mean RCS (one number, or one a look)."""
    rng = np.random.default_rng(seed)
    n = len(alpha)
    z = rng.gamma(1 + rng.poisson(np.asarray(mean) * alpha * rng.gamma(shape, 1 / shape, n)))
    seen = z >= T
    return {
        "time_s": np.arange(n) * 1.0, "detected": seen.astype(float), "amplitude": np.where(seen, z, np.nan),
        "snr_per_m2": np.asarray(alpha, float), "threshold": np.full(n, T), **columns,
    }  # fmt: skip


def trial_of(data, **settings):
    return Trial("made-up", (log_of("detections", data),), settings=settings_from(settings, "test"))


def rows_of(result, quantity, group=None, track=None):
    return [r for r in result.rows if r.quantity == quantity and r.group == group and r.track_id == track]


def binned(rows):
    return {round(math.degrees(r.bin_low)): r for r in rows if not math.isnan(r.bin_low)}


def test_aspect_bins_wrap_around():
    """-10, 350 and 710 degrees are one direction; bins cover one turn and each look falls into one."""
    aspect = np.deg2rad(np.tile([-10.0, 350.0, 710.0, 95.0, 455.0, 180.0], 100))
    result = rcs(
        trial_of(looks_at(2.0, np.full(600, 10.0), aspect_rad=aspect)),
        Bins("aspect", math.radians(30)),
        swerling="1",
        replicates=0,
    )
    found = binned(rows_of(result, "rcs"))
    assert {a: r.n for a, r in found.items()} == {90: 200, 180: 100, 330: 300}


def test_left_and_right_are_folded_on_request():
    """30 degrees left and right of the nose are one bin, 150 left and right another; the number of looks adds up."""
    aspect = np.deg2rad(np.tile([30.0, -30.0, 330.0, 150.0, 210.0], 100))
    mean = np.where(np.cos(aspect) > 0, 1.0, 8.0)
    data = looks_at(mean, np.full(500, 10.0), aspect_rad=aspect)
    bins = Bins("aspect", math.radians(60))
    apart = binned(rows_of(rcs(trial_of(data), bins, swerling="1", replicates=0), "rcs"))
    folded = binned(
        rows_of(rcs(trial_of(data, detections={"fold_aspect": True}), bins, swerling="1", replicates=0), "rcs")
    )
    assert {a: r.n for a, r in apart.items()} == {0: 100, 120: 100, 180: 100, 300: 200}
    assert {a: r.n for a, r in folded.items()} == {0: 300, 120: 200}
    assert folded[0].low <= 1.0 <= folded[0].high
    assert folded[120].low <= 8.0 <= folded[120].high


def test_sparse_aspects_are_limits_counted_by_looks():
    """A bin of twenty misses has an upper limit and no value, and is not short of samples; one of five is."""
    aspect = np.deg2rad(np.repeat([10.0, 100.0, 190.0], [40, 20, 5]))
    data = looks_at(2.0, np.full(65, 20.0), aspect_rad=aspect)
    data["detected"][40:], data["amplitude"][40:] = 0.0, np.nan
    found = binned(
        rows_of(
            rcs(trial_of(data), Bins("aspect", math.radians(45), min_samples=10), swerling="1", replicates=0), "rcs"
        )
    )
    assert "few-samples" not in found[90].flags
    assert "few-samples" in found[180].flags
    for low in (90, 180):
        assert "upper-limit" in found[low].flags
        assert math.isnan(found[low].value)
    miss = -math.expm1(-T / (1 + 20.0 * found[90].high))
    assert miss**20 == pytest.approx(0.05, rel=1e-6)


def test_each_target_has_rows_of_its_own():
    """Two targets of 1 and 9 m^2: pooled rows first, then each with its own RCS inside its interval."""
    names = np.array(["A", "B"] * 300)
    data = looks_at(np.where(names == "A", 1.0, 9.0), np.full(600, 10.0), seed=3, range_m=np.linspace(2e4, 39e3, 600))
    data["target_id"] = names
    result = rcs(trial_of(data), Bins(width=1e4), swerling="1", replicates=0, per_track=True)
    pooled, one, other = (rows_of(result, "rcs", track=t) for t in (None, "A", "B"))
    assert len(pooled) == len(one) == len(other) == 3
    assert all(r.n == 300 for r in (one[0], other[0]))
    assert one[0].low <= 1.0 <= one[0].high
    assert other[0].low <= 9.0 <= other[0].high
    assert any("pooled" in p.reason for p in result.problems)
    assert not rows_of(rcs(trial_of(data), Bins(width=1e4), swerling="1", replicates=0), "rcs", track="A")


def test_sliding_rows_are_the_estimates_of_their_windows():
    """One row from each look that fills the window, equal to that window fitted alone, for each target in time order."""
    data = looks_at(2.0, np.linspace(20, 5, 40), seed=4)
    data["target_id"] = np.array(["B", "A"] * 20)
    order = np.argsort(np.random.default_rng(1).random(40))  # the log is not in time order
    result = rcs(
        trial_of({k: v[order] for k, v in data.items()}), Bins(width=1e4), swerling="3", window=8, replicates=0
    )
    for name, first in (("A", 1), ("B", 0)):
        rows = rows_of(result, "rcs_sliding", track=name)
        assert len(rows) == 13
        for i in (0, 5, 12):
            part = slice(first + 2 * i, first + 2 * i + 16, 2)
            alone = Looks.of(data["amplitude"][part], data["snr_per_m2"][part], T)
            one = fit(alone, Windows.whole(alone), CASES["3"])
            low, high = profile_interval(alone, Windows.whole(alone), CASES["3"], one)
            row = rows[i]
            assert (row.value, row.low, row.high) == pytest.approx((one.s[0], low[0], high[0]), rel=1e-8)
            assert (row.bin_low, row.bin_high) == (data["time_s"][part][0], data["time_s"][part][-1])


def test_the_detection_probability_over_range_is_counted_and_modelled():
    """k of n with Wilson and exact intervals; the model is the mean over the looks of the bin at the fitted RCS."""
    rng = np.random.default_rng(5)
    distance = rng.uniform(20e3, 70e3, 800)
    alpha = 10 ** (0.1 * (195.0 - 40 * np.log10(distance)))
    data = looks_at(2.0, alpha, seed=6, range_m=distance)
    result = rcs(trial_of(data), Bins(width=10e3), swerling="1", replicates=0)
    s = rows_of(result, "rcs")[0]
    for share, exact, model in zip(*(rows_of(result, q) for q in (
        "detection_probability", "detection_probability_exact", "detection_probability_model")), strict=True):  # fmt: skip
        inside = (
            (distance >= share.bin_low) & (distance < share.bin_high) if not math.isnan(share.bin_low) else distance > 0
        )
        k, n = int(data["detected"][inside].sum()), int(inside.sum())
        assert (share.value, share.n) == (k / n, n)
        assert (share.low, share.high) == pytest.approx([float(v) for v in wilson_interval(k, n)])
        assert (exact.low, exact.high) == pytest.approx([float(v) for v in exact_interval(k, n)])
        for value, rcs_m2 in ((model.value, s.value), (model.low, s.low), (model.high, s.high)):
            assert value == pytest.approx(np.mean(np.exp(-T / (1 + alpha[inside] * rcs_m2))), rel=1e-9)


def test_ranges_for_50_80_and_90_percent():
    """Swerling 1, R^-4: P = exp(-T / (1 + S)) turned round by hand, at the RCS and at the ends of its interval."""
    distance = np.linspace(20e3, 70e3, 900)
    data = looks_at(2.0, 10 ** (0.1 * (195.0 - 40 * np.log10(distance))), seed=7, range_m=distance)
    result = rcs(trial_of(data), Bins(width=10e3), swerling="1", replicates=0)
    s = rows_of(result, "rcs")[0]
    for percent in (50, 80, 90):
        (row,) = rows_of(result, f"detection_range_{percent}")
        snr = T / -math.log(percent / 100) - 1

        def at(rcs_m2, snr=snr):
            return (10**19.5 * rcs_m2 / snr) ** 0.25

        assert row.value == pytest.approx(at(s.value), rel=1e-4)
        assert sorted((row.low, row.high)) == pytest.approx([at(s.low), at(s.high)], rel=1e-4)
        assert row.high / row.low == pytest.approx((s.high / s.low) ** 0.25, rel=1e-3)


def test_an_rcs_that_changes_over_range_is_said():
    """Loss left out of snr_per_m2 beyond 45 km: the bins do not share one RCS; without it they do."""
    distance = np.linspace(20e3, 70e3, 600)
    alpha = 10 ** (0.1 * (198.0 - 40 * np.log10(distance)))
    p = []
    for mean in (2.0, np.where(distance > 45e3, 0.7, 2.0)):
        result = rcs(
            trial_of(looks_at(mean, alpha, seed=8, range_m=distance)), Bins(width=10e3), swerling="1", replicates=0
        )
        (row,) = rows_of(result, "rcs_homogeneity_p")
        p.append(row.value)
        assert ("rcs-varies" in row.flags) == (row.value < 0.01)
    assert p[0] > 0.01 > p[1]


@pytest.mark.parametrize("interval", ["bootstrap", "credible"])
def test_other_intervals_hold_the_rcs_and_keep_exact_limits(interval):
    """Near the profile interval where looks are many; the same upper limit where nothing was detected."""
    alpha = np.repeat([20.0, 1e-3], [80, 10])
    data = looks_at(2.0, alpha, seed=9, range_m=np.repeat([1e4, 3e4], [80, 10]))
    data["detected"][80:], data["amplitude"][80:] = 0.0, np.nan
    plain, other = (
        rows_of(rcs(trial_of(data), Bins(width=2e4), swerling="3", interval=i, replicates=299), "rcs")
        for i in ("profile", interval)
    )
    assert other[1].low == pytest.approx(plain[1].low, rel=0.08)
    assert other[1].high == pytest.approx(plain[1].high, rel=0.08)
    assert other[1].low != plain[1].low
    assert other[2].high == plain[2].high
    with pytest.raises(SettingsError, match="did you mean 'profile'"):
        rcs(trial_of(data), Bins(width=2e4), interval="profil")


def test_a_free_shape_on_request():
    """Group `free`, its shape with an interval, an AIC that counts it, and a verdict that says so."""
    data = looks_at(2.0, np.full(300, 15.0), seed=10, shape=2.0, range_m=np.linspace(1e4, 3e4, 300))
    result = rcs(trial_of(data), Bins(width=1e4), swerling="free", replicates=0)
    (shape,) = rows_of(result, "swerling_shape")
    assert shape.low < 2.0 < shape.high
    (value,) = [r.value for r in rows_of(result, "log_likelihood", group="free") if r.variable is None]
    (aic,) = [r.value for r in rows_of(result, "aic", group="free") if r.variable is None]
    assert aic == pytest.approx(4 - 2 * value)
    assert rows_of(result, "aic")[0].value == aic
    assert result.settings["case"] == "free"
    assert "K = " in str(result.settings["case_verdict"])


def test_several_pulses_are_summed_and_per_pulse_cases_compared():
    """Eight pulses, Swerling 2: 2 m^2 in the interval, cases 0 to 4 told apart, mean amplitudes read as sums."""
    rng = np.random.default_rng(11)
    threshold = 29.162195  # P_F 1e-6 with eight pulses
    z = rng.gamma(8 + rng.poisson(2.0 * 1.5 * 8 * rng.gamma(8, 1 / 8, 400)))
    seen = z >= threshold
    data = {"time_s": np.arange(400.0), "detected": seen.astype(float), "amplitude": np.where(seen, z, np.nan) / 8,
            "snr_per_m2": np.full(400, 1.5), "false_alarm_probability": np.full(400, 1e-6)}  # fmt: skip
    result = rcs(trial_of(data, detections={"pulses": 8, "integrated": "mean"}), Bins("time", 1e3), replicates=0)
    row = rows_of(result, "rcs", group="2")[0]
    assert row.low <= 2.0 <= row.high
    assert {
        r.group for r in rows_of(result, "aic_all_bins") + [r for r in result.rows if r.quantity == "aic_all_bins"]
    } >= {"0", "1", "2", "3", "4"}
    aic = {r.group: r.value for r in result.rows if r.quantity == "aic_all_bins"}
    assert min(aic, key=aic.__getitem__) in ("2", "4", "free")
    assert aic["2"] < aic["1"] - 10


def test_slow_fading_is_flagged():
    """One fade for ten looks: consecutive amplitudes are alike, and every interval here would be too narrow."""
    rng = np.random.default_rng(12)
    z = rng.gamma(1 + rng.poisson(40.0 * np.repeat(rng.exponential(1.0, 60), 10)))
    seen = z >= T
    data = {"time_s": np.arange(600.0), "detected": seen.astype(float), "amplitude": np.where(seen, z, np.nan),
            "snr_per_m2": np.full(600, 20.0), "threshold": np.full(600, T)}  # fmt: skip
    row = rows_of(rcs(trial_of(data), Bins("time", 1e3), swerling="1", replicates=0), "rcs")[0]
    assert "slow-fading" in row.flags
    assert row.n_eff < 200


@pytest.mark.parametrize("confidence", [0.8, 0.95])
def test_a_sphere_gives_the_loop_gain(confidence):
    """25 looks at 17 to 29 dB: the true gain in the interval, at 95 % about 0.16 dB either way."""
    radius, wavelength, gain = 0.178, 299792458 / 5.3e9, 190.0
    distance = np.geomspace(1.0, 2.0, 25)
    distance *= (10 ** (0.1 * (gain - 29.0)) * sphere_rcs(radius, wavelength)) ** 0.25
    snr = 10 ** (0.1 * (gain - 40 * np.log10(distance))) * sphere_rcs(radius, wavelength)
    assert 10 * np.log10(snr[[0, -1]]) == pytest.approx([29.0, 17.0], abs=0.1)
    z = np.random.default_rng(13).noncentral_chisquare(2, 2 * snr) / 2
    data = {"time_s": np.arange(25.0), "detected": np.ones(25), "amplitude": z, "threshold": np.full(25, T),
            "range_m": distance}  # fmt: skip
    trial = trial_of(data, detections={"sphere_radius_m": radius}, radar_equation={"wavelength_m": wavelength})
    (row,) = rows_of(rcs(trial, Bins(width=1e6), swerling="0", replicates=0, confidence=confidence), "loop_gain")
    half = 0.5 * (row.high - row.low)
    assert half == pytest.approx(0.16 if confidence == 0.95 else 0.16 * 1.2816 / 1.96, rel=0.25)
    assert abs(row.value - gain) < 3 * half


HEAD = "time_s,detected,amplitude,snr_per_m2,threshold\n"


def table(rows):
    """A small detections log; `rows` replace its first ones."""
    plain = [f"{i},1,{20 + i},10,6.9" if i % 3 else f"{i},0,,10,6.9" for i in range(30)]
    return HEAD + "\n".join([*rows, *plain[len(rows) :]]) + "\n"


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("0,1,,10,6.9", "scan 1 (at 0 s): detected is 1 and amplitude is missing"),
        ("0,1,5,10,6.9", "scan 1 (at 0 s): amplitude 5 is below the threshold 6.9"),
        ("0,1,20,10,0", "scan 1 (at 0 s): threshold is 0"),
        ("0,1,20,10,-2", "scan 1 (at 0 s): threshold is -2"),
        ("0,1,20,-1,6.9", "scan 1 (at 0 s): snr_per_m2 is -1"),
        ("0,0,,0,6.9", "scan 1 (at 0 s): snr_per_m2 is 0"),
        ("0,2,20,10,6.9", "scan 1 (at 0 s): detected is 2"),
        ("0,,,10,6.9", "scan 1 (at 0 s): detected is missing"),
    ],
)
def test_the_command_names_a_bad_scan(tmp_path, row, words):
    """Exit status 0, the other 29 looks used, the bad one named on standard error."""
    (tmp_path / "d.csv").write_text(table([row]))
    ran = CliRunner().invoke(cli, ["rcs", str(tmp_path), "--swerling", "1", "--format", "csv"])
    assert ran.exit_code == 0, ran.stderr
    assert words in ran.stderr
    assert any(",29," in line for line in ran.stdout.splitlines() if ",rcs," in line)


@pytest.mark.parametrize("word", [("true", "false"), ("TRUE", "FALSE"), ("1", "0"), ("1.0", "0.0")])
def test_detected_may_be_a_word(tmp_path, word):
    """true/false in any case, 1/0: the same estimates to the last bit."""
    plain = table([])
    lines = [
        HEAD.strip(),
        *(
            ",".join([c if i != 1 else word[c == "0"] for i, c in enumerate(line.split(","))])
            for line in plain.splitlines()[1:]
        ),
    ]
    for name, text in (("a", plain), ("b", "\n".join(lines) + "\n")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "d.csv").write_text(text)
    one, other = (
        CliRunner().invoke(cli, ["rcs", str(tmp_path / n), "--swerling", "1", "--format", "csv"]) for n in "ab"
    )
    assert other.exit_code == 0, other.stderr
    assert one.stdout == other.stdout


def test_amplitude_threshold_and_alpha_in_decibels(tmp_path):
    """`amplitude_db`, `threshold_db` and `snr_per_m2_db` give what the linear columns give."""
    text = ["time_s,detected,amplitude_db,snr_per_m2_db,threshold_db"]
    for line in table([]).splitlines()[1:]:
        t, hit, *rest = line.split(",")
        text.append(",".join([t, hit, *(repr(10 * math.log10(float(v))) if v else "" for v in rest)]))
    for name, content in (("a", table([])), ("b", "\n".join(text) + "\n")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "d.csv").write_text(content)
    one, other = (rcs_of(tmp_path / n) for n in "ab")
    assert one == pytest.approx(other, rel=1e-9)


def rcs_of(path):
    import rangeeval

    row = rows_of(rcs(rangeeval.open_trial(path), Bins("time", 100.0), swerling="1", replicates=0), "rcs")[0]
    return row.value, row.low, row.high


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "time_s,detected,amplitude,snr_per_m2\n0,1,20,10\n1,0,,10\n",
            "no threshold; give a column threshold or false_alarm_probability",
        ),
        ("time_s,detected,amplitude,threshold\n0,1,20,7\n1,0,,7\n", "the SNR of a 1 m^2 target is not known"),
        ("time_s,detected,amplitude,snr_per_m2,threshold\n0,1,,10,7\n1,1,3,10,7\n", "not one usable look"),
        (
            "time_s,detected,amplitude,snr_per_m2,threshold\n0,yes,20,10,7\n1,no,,10,7\n",
            "detected is 'yes', not a number",
        ),
    ],
)
def test_what_cannot_be_had_is_one_line(tmp_path, text, words):
    """Exit status 1 and one line that says what to give."""
    (tmp_path / "d.csv").write_text(text)
    ran = CliRunner().invoke(cli, ["rcs", str(tmp_path)])
    assert ran.exit_code != 0
    assert words in (ran.stderr + str(ran.exception))


def test_all_misses_all_hits_and_too_few_are_said(tmp_path):
    """Limits with their flags, never a bare number: nothing detected, nothing but hits without amplitude, one hit."""
    logs = {
        "upper-limit": HEAD + "".join(f"{i},0,,8,6.907755278982137\n" for i in range(10)),
        "lower-limit": "time_s,detected,snr_per_m2,threshold\n" + "".join(f"{i},1,8,6.9\n" for i in range(10)),
        "few-detections": HEAD + "0,1,20,8,6.9\n" + "".join(f"{i},0,,8,6.9\n" for i in range(1, 10)),
    }
    for flag, text in logs.items():
        (tmp_path / flag).mkdir()
        (tmp_path / flag / "d.csv").write_text(text)
        import rangeeval

        row = rows_of(rcs(rangeeval.open_trial(tmp_path / flag), Bins("time", 100.0), swerling="3"), "rcs")[0]
        assert flag in row.flags
        assert math.isnan(row.value) == flag.endswith("limit")
        if flag == "upper-limit":
            assert (row.low, row.high) == (0.0, pytest.approx(0.508, abs=0.0005))
        if flag == "lower-limit":
            assert row.high == math.inf
