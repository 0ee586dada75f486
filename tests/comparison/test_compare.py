"""Trials against each other, on tidy tables whose truth was chosen."""

import json
import math

import numpy as np
import pytest
from scipy import stats

import rangeeval
from rangeeval import flow
from rangeeval.comparison import Method, compare
from rangeeval.comparison.rules import RULES, rule_of
from rangeeval.errors import InputError, SettingsError
from rangeeval.model import Estimate, Result
from rangeeval.reporting.blocks import Notice
from rangeeval.reporting.sections import compare as layout
from rangeeval.stats.intervals import sigma_interval


def sigma(value, nu, low=0.0, quantity="range_sigma", unit="m", **more):
    """A row of a sigma with its interval, in the range bin that begins at `low`."""
    ends = sigma_interval(value, nu)
    return Estimate(
        quantity=quantity, unit=unit, value=value, low=float(ends[0]), high=float(ends[1]), n=int(nu) + 1, n_eff=nu + 1.0,
        variable="range", bin_low=low, bin_high=low + 5000.0, extra={"nu": nu}, **more,
    )  # fmt: skip


def mean(value, error, quantity="range_bias", unit="m", nu=200.0):
    """A row of a mean with its t interval, of the whole trial."""
    half = stats.t(nu).ppf(0.975) * error
    return Estimate(
        quantity=quantity, unit=unit, value=value, low=value - half, high=value + half, n=201, n_eff=201.0,
        extra={"nu": nu},
    )  # fmt: skip


def trial(*rows, name="A", sha="", settings=None, analysis="accuracy", **origin):
    """The results of one trial."""
    provenance = {
        "trial": {"name": name},
        "inputs": [{"file": "r.csv", "kind": "residuals", "sha256": sha or name}],
        **origin,
    }
    return [Result(analysis, rows, settings or {"confidence": 0.95}, provenance=provenance)]


def only(result, **wanted):
    """The one row with these columns."""
    found = [r for r in result.rows if all(r.as_row()[k] == v for k, v in wanted.items())]
    assert len(found) == 1, found
    return found[0]


def test_a_row_holds_the_ratio_its_f_interval_and_both_estimates():
    """value, low, high are the ratio's; quantity is the original's name; the estimates stand beside it."""
    row = only(compare([trial(sigma(2.0, 60.0)), trial(sigma(3.0, 80.0), name="B")]))
    f = stats.f(80, 60)
    assert (row.quantity, row.unit, row.extra["measure"], row.extra["of_unit"]) == ("range_sigma", "1", "ratio", "m")
    assert row.value == pytest.approx(1.5)
    assert (row.low, row.high) == pytest.approx((1.5 / math.sqrt(f.ppf(0.975)), 1.5 / math.sqrt(f.ppf(0.025))))
    assert row.extra["p_value"] == pytest.approx(2 * f.sf(2.25))
    assert (row.extra["reference_value"], row.extra["trial_value"]) == (2.0, 3.0)
    assert (row.extra["reference"], row.extra["trial"], row.extra["verdict"]) == ("A", "B", "worse")
    assert (row.n, row.n_eff) == (142, 142.0)


@pytest.mark.parametrize(
    ("rows", "verdict"),
    [
        ((sigma(2.0, 200.0), sigma(3.0, 200.0)), "worse"),
        ((sigma(3.0, 200.0), sigma(2.0, 200.0)), "better"),
        ((sigma(2.0, 200.0), sigma(2.1, 200.0)), "inconclusive"),
        ((sigma(2.0, 9000.0), sigma(2.02, 9000.0)), "equivalent"),
        ((sigma(2.0, 90000.0), sigma(2.1, 90000.0)), "equivalent"),  # it differs, but within the margin
        ((mean(1.0, 0.1), mean(3.0, 0.1)), "worse"),
        ((mean(-3.0, 0.1), mean(1.0, 0.1)), "better"),
        ((mean(-2.0, 0.1), mean(2.0, 0.1)), "inconclusive"),  # moved, but as far from zero as before
    ],
)
def test_verdicts_follow_the_quantitys_better_side(rows, verdict):
    """Smaller sigma is better, a bias nearer zero is; within the margin equal; else the data do not decide."""
    a, b = rows
    row = only(compare([trial(a), trial(b, name="B")]))
    assert row.extra["verdict"] == verdict
    assert row.extra["measure"] == ("difference" if row.quantity == "range_bias" else "ratio")


def test_detection_probability_is_a_difference_of_shares():
    """Hits and looks are tested exactly; more detections are better."""

    def share(hits, n):
        return Estimate(
            quantity="detection_probability", unit="1", value=hits / n, low=0.0, high=1.0, n=n, n_eff=float(n),
            extra={"detections": hits},
        )  # fmt: skip

    row = only(compare([trial(share(40, 100), analysis="rcs"), trial(share(75, 110), analysis="rcs", name="B")]))
    assert row.value == pytest.approx(75 / 110 - 0.4)
    tails = [stats.fisher_exact([[75, 35], [40, 60]], side).pvalue for side in ("greater", "less")]
    assert row.extra["p_value"] == pytest.approx(2 * min(tails))
    assert row.extra["verdict"] == "better"


def test_a_quantity_without_a_better_side_differs_but_has_no_verdict():
    """RCS is the target's: it can differ or be equivalent, never be better or worse."""
    rows = [
        Estimate(quantity="rcs", unit="m^2", value=v, low=v / 1.2, high=v * 1.2, n=300, n_eff=300.0) for v in (1.0, 2.0)
    ]
    row = only(compare([trial(rows[0], analysis="rcs"), trial(rows[1], analysis="rcs", name="B")]))
    assert (row.extra["verdict"], row.extra["differs"], row.value) == ("inconclusive", True, pytest.approx(2.0))
    assert row.low == pytest.approx(2.0 / 1.2 ** math.sqrt(2), rel=1e-3)


def test_p_values_are_adjusted_over_all_bins_and_quantities():
    """Of 12 tests Holm multiplies the smallest p value by 12; Benjamini-Hochberg never claims less than Holm."""
    rng = np.random.default_rng(0)
    names = ("range_sigma", "elevation_sigma", "azimuth_sigma")
    values = rng.uniform(1.0, 1.4, 12)
    a = [sigma(1.0, 90.0, 5000.0 * (i // 3), names[i % 3]) for i in range(12)]
    b = [sigma(v, 90.0, 5000.0 * (i // 3), names[i % 3]) for i, v in enumerate(values)]
    found = {}
    for adjust in ("holm", "bh"):
        result = compare([trial(*a), trial(*b, name="B")], Method(adjust=adjust))
        p, found[adjust] = (np.array([r.extra[c] for r in result.rows]) for c in ("p_value", "p_adjusted"))
        assert (len(p), result.settings["tests"]) == (12, 12)
        assert [r.extra["differs"] for r in result.rows] == (found[adjust] <= 0.05).tolist()
    assert found["holm"][p.argmin()] == pytest.approx(min(1.0, 12 * p.min()))
    assert found["bh"][p.argmax()] == pytest.approx(p.max())
    assert (found["bh"] <= found["holm"]).all()


def test_an_interval_at_another_confidence_is_the_same_evidence():
    """Results with 90 % intervals and with 95 % ones of the same mean give the same comparison."""
    a, b = mean(0.0, 0.3), mean(1.0, 0.4)
    half = stats.t(200).ppf(0.95) * 0.4
    narrow = Estimate(
        quantity=b.quantity, unit="m", value=1.0, low=1 - half, high=1 + half, n=201, n_eff=201.0, extra={"nu": 200.0}
    )
    one = only(compare([trial(a), trial(b, name="B")]))
    two = only(compare([trial(a), trial(narrow, name="B", settings={"confidence": 0.9})]))
    assert two.extra["p_value"] == pytest.approx(one.extra["p_value"])
    assert (two.low, two.high) == pytest.approx((one.low, one.high))


def test_the_samples_that_would_decide_are_said_and_would():
    """As many more samples of both, with the same estimates, decide; no number tells equal biases apart."""
    a, b = sigma(2.0, 100.0), sigma(2.3, 100.0)
    row = only(compare([trial(a), trial(b, name="B")]))
    more = row.extra["more_samples"]
    nu = 100.0 * (101 + more) / 101
    assert row.extra["verdict"] == "inconclusive"
    assert only(compare([trial(sigma(2.0, nu)), trial(sigma(2.3, nu), name="B")])).extra["verdict"] == "worse"
    same = only(compare([trial(mean(1.0, 0.1)), trial(mean(1.0, 0.1), name="B")]))
    assert same.extra["more_samples"] is None


def test_margins_are_stated_by_quantity_or_for_all():
    """A difference in its own unit is equivalent only within a margin of that unit."""
    pair = [trial(mean(1.0, 0.01)), trial(mean(1.01, 0.01), name="B")]
    assert only(compare(pair)).extra["verdict"] == "inconclusive"
    row = only(compare(pair, Method(margins={"range_bias": 0.1})))
    assert row.extra["verdict"] == "equivalent"
    close = [trial(sigma(2.0, 3000.0)), trial(sigma(2.05, 3000.0), name="B")]
    assert only(compare(close, Method(margin=0.01))).extra["verdict"] == "inconclusive"
    assert only(compare(close, Method(margin=0.2))).extra["verdict"] == "equivalent"
    with pytest.raises(SettingsError, match="expected more than 0"):
        Method(margin=-0.1)
    with pytest.raises(SettingsError, match="did you mean 'range_bias'"):
        compare(pair, Method(margins={"range_bais": 0.1}))


def test_more_than_two_are_each_compared_with_the_first():
    """The reference is the first; all tests are one family; names that occur twice are numbered."""
    result = compare([trial(sigma(2.0, 90.0)), trial(sigma(2.0, 90.0), sha="x"), trial(sigma(4.0, 90.0), name="C")])
    assert [(r.extra["reference"], r.extra["trial"], r.extra["verdict"]) for r in result.rows] == [
        ("A [1]", "A [2]", "inconclusive"),
        ("A [1]", "C", "worse"),
    ]
    assert result.settings["tests"] == 2


def test_bins_that_do_not_match_are_named_and_the_others_compared():
    """Each trial's own bins are listed; the common one is tested."""
    result = compare(
        [
            trial(sigma(1.0, 50.0), sigma(1.0, 50.0, 5000.0)),
            trial(sigma(1.0, 50.0), sigma(1.0, 50.0, 90000.0), name="B"),
        ]
    )
    assert [r.bin_low for r in result.rows] == [0.0]
    said = [str(p) for p in result.problems]
    assert "A: accuracy: bins that B does not have: range 5000 to 10000; not compared" in said
    assert "B: accuracy: bins that A does not have: range 90000 to 95000; not compared" in said


def test_no_common_bin_is_one_clear_line():
    """Which bins each has; nothing is compared."""
    with pytest.raises(InputError, match=r"nothing in common.*range 0 to 5000.*range 2500 to 7500"):
        compare([trial(sigma(1.0, 50.0)), trial(sigma(1.0, 50.0, 2500.0), name="B")])
    with pytest.raises(InputError, match="no analysis in common: A has accuracy; B has rcs"):
        compare([trial(sigma(1.0, 50.0)), trial(sigma(1.0, 50.0), name="B", analysis="rcs")])
    with pytest.raises(InputError, match="needs two or more"):
        compare([trial(sigma(1.0, 50.0))])
    with pytest.raises(InputError, match="B: holds no estimates"):
        compare([trial(sigma(1.0, 50.0)), trial(name="B")])


def test_units_that_differ_are_said_and_the_rest_is_compared():
    """A quantity in another unit is never divided by one in metres."""
    a = [sigma(1.0, 50.0), sigma(1e-3, 50.0, quantity="azimuth_sigma", unit="rad")]
    b = [sigma(0.001, 50.0, unit="km"), sigma(1e-3, 50.0, quantity="azimuth_sigma", unit="rad")]
    result = compare([trial(*a), trial(*b, name="B")])
    assert [r.quantity for r in result.rows] == ["azimuth_sigma"]
    assert any("range_sigma is in 'km' here and in 'm' in the reference" in p.reason for p in result.problems)


def test_the_same_trial_twice_is_said():
    """By the SHA-256 of its files, or by its estimates where none are recorded; shared files are counted."""
    one = trial(sigma(1.0, 50.0))
    result = compare([one, one])
    assert any("the same trial as A [1]: every file has the same SHA-256" in p.reason for p in result.problems)
    assert result.rows[0].value == 1.0
    bare = [Result("accuracy", (sigma(1.0, 50.0),))]
    assert any("the same trial twice?" in p.reason for p in compare([bare, bare]).problems)
    inputs = [{"file": f, "kind": "residuals", "sha256": f} for f in "xy"]
    part = trial(sigma(1.1, 50.0), name="B", inputs=inputs)
    whole = trial(sigma(1.0, 50.0), inputs=inputs[:1])
    assert any("shares 1 of 2 files with A" in p.reason for p in compare([whole, part]).problems)


def test_what_was_not_alike_is_listed_with_every_trials_value():
    """Settings, software, waveforms, mean gains and inputs; what is alike is not listed."""

    def gain(value):
        return Estimate(quantity="alpha_range", unit="1", value=value, n=100)

    trials = []
    for name, bandwidth, alpha, version, waveform in (("A", 1e6, 0.5, "1", "X"), ("B", 2e6, 0.6, "2", "Y")):
        origin = {
            "trial": {"name": name},
            "settings": {"radar": {"bandwidth_hz": bandwidth, "name": "R"}},
            "versions": {"rangeeval": version, "numpy": "2.0"},
            "inputs": [{"file": "r.csv", "kind": "residuals", "sha256": name}],
        }
        rows = (sigma(1.0, 50.0), sigma(1.0, 50.0, group=f"inbound, waveform {waveform}"), gain(alpha))
        settings = {"confidence": 0.95, "estimator": "recommended"}
        trials.append([Result("accuracy", rows, settings, provenance=origin)])
    found = {d["what"]: d["values"] for d in compare(trials).settings["differences"]}
    assert found["settings.radar.bandwidth_hz"] == [1e6, 2e6]
    assert found["versions.rangeeval"] == ["1", "2"]
    assert found["mean gain alpha_range"] == [0.5, 0.6]
    assert found["waveforms and attenuator states"] == ["waveform X", "waveform Y"]
    assert found["input residuals"] == ["r.csv (A)", "r.csv (B)"]
    assert not {"settings.radar.name", "versions.numpy", "accuracy.estimator"} & set(found)


def test_missing_estimates_are_no_test_and_no_nan_in_json():
    """A bin without a value has no p value and no verdict but inconclusive."""
    none = Estimate(quantity="range_sigma", unit="m", value=math.nan, low=math.nan, high=5.0, variable="range",
                    bin_low=0.0, bin_high=5000.0)  # fmt: skip
    result = compare([trial(sigma(1.0, 50.0)), trial(none, name="B")])
    row = only(result)
    assert math.isnan(row.extra["p_value"])
    assert row.extra["verdict"] == "inconclusive"
    json.loads(result.to_json(), parse_constant=pytest.fail)


def test_by_default_the_main_quantities_and_any_on_request():
    """Derived sigmas are not tested again; named ones, patterns and `all` are; unknown ones are an error."""
    rows = [sigma(1.0, 50.0), sigma(1.0, 50.0, quantity="range_sigma_white"), sigma(1.0, 50.0, quantity="y_sigma")]
    pair = [trial(*rows), trial(*rows, name="B")]

    def compared(*quantities):
        return [r.quantity for r in compare(pair, Method(quantities=quantities)).rows]

    assert compared() == ["range_sigma"]
    assert compared("all") == ["range_sigma", "range_sigma_white", "y_sigma"]
    assert compared("range_sigma*") == ["range_sigma", "range_sigma_white"]
    with pytest.raises(SettingsError, match="did you mean 'y_sigma'"):
        compared("y_sgma")


def test_every_quantity_has_a_rule_and_only_one_line_catches_the_rest():
    """A new analysis is compared without a word in the table: as a ratio, levels as differences."""
    assert rule_of("brand_new", "m").measure == "ratio"
    assert rule_of("brand_new", "dB").measure == "difference"
    assert rule_of("brand_new", "m").better == ""
    assert [rule for rule in RULES if "*" in rule.names] == [RULES[-1]]


def test_any_form_of_a_trial_gives_the_same_comparison(tmp_path):
    """Folder, Trial, archive, results.json and results; other bins need the logs."""
    from rangeeval.model import Bins
    from rangeeval.scenarios import simulate_alpha_beta

    folders = [tmp_path / name for name in "ab"]
    for seed, folder in enumerate(folders):
        simulate_alpha_beta(folder, seed=seed, flights=1, no_truth=True, name=folder.name)
        toml = folder / "trial.toml"
        toml.write_text(toml.read_text().split("[[requirements]]")[0])  # each would be a pass over the log
    trials = [rangeeval.open_trial(folder) for folder in folders]
    expected = json.loads(rangeeval.compare(*folders).to_json())["estimates"]
    archives = [flow.ingest(trial, tmp_path / f"{trial.name}.h5") for trial in trials]
    results = [flow.evaluate(trial) for trial in trials]
    saved = []
    for i, found in enumerate(results):
        saved.append(tmp_path / f"{i}.json")
        saved[-1].write_text(flow.results_json(found))
    for forms in (archives, results, (trials[0], saved[1])):
        assert json.loads(rangeeval.compare(*forms).to_json())["estimates"] == expected

    def plan_of(trial):
        return flow.Plan(bins=Bins(width=10_000.0))

    wider = rangeeval.compare(*archives, plan_of=plan_of)
    assert {r.bin_high - r.bin_low for r in wider.rows} == {10_000.0}
    with pytest.raises(InputError, match=r"0\.json: holds results, not logs"):
        rangeeval.compare(*saved, plan_of=plan_of)


@pytest.mark.parametrize(
    ("context", "flags"),
    [
        ({}, ()),
        ({"snr": (20.0, 20.8)}, ()),
        ({"snr": (20.0, 22.0)}, ("unlike-snr",)),
        ({"alpha_z": (0.4, 0.42)}, ()),
        ({"alpha_z": (0.4, 0.5)}, ("unlike-gains",)),
        ({"beta_z": (0.2, 0.1)}, ("unlike-gains",)),
        ({"alpha_y": (0.4, 0.5)}, ()),  # another axis
        ({"z_sigma": (10.0, 12.0)}, ("unlike-path",)),  # the same angle from more metres: another path
    ],
)
def test_what_else_was_not_alike_in_the_bin_is_flagged(context, flags):
    """SNR, gains of the axis and the lever from metres to angle, each from the rows of the same bin."""

    def made(which, name):
        rows = [sigma(1e-3, 200.0, quantity="azimuth_sigma", unit="rad")]
        for quantity, values in context.items():
            value = values[which]
            rows.append(Estimate(
                quantity=quantity, unit="1", value=value, low=value - 0.3, high=value + 0.3, n=201, n_eff=201.0,
                variable="range", bin_low=0.0, bin_high=5000.0,
            ))  # fmt: skip
        return trial(*rows, name=name)

    row = only(compare([made(0, "A"), made(1, "B")]), quantity="azimuth_sigma")
    assert row.flags == flags


def test_what_was_not_alike_stands_beside_the_verdict():
    """The table of tests has a column for it, and the notice says how many verdicts it touches."""
    gains = [
        Estimate(quantity="alpha_range", unit="1", value=v, low=v, high=v, n=201, n_eff=201.0, variable="range",
                 bin_low=0.0, bin_high=5000.0)
        for v in (0.3, 0.6)
    ]  # fmt: skip
    result = compare([trial(sigma(2.0, 200.0), gains[0]), trial(sigma(3.0, 200.0), gains[1], name="B")])
    (overview, *_) = layout.sections(result)
    texts = [block.text for block in overview.blocks if isinstance(block, Notice)]
    assert any("1 of the 1 better or worse stand where more than the radar differs" in text for text in texts)
    (table, *_) = layout.short_tables(result, "Tests")
    assert (table.head[-1], table.rows[0][-1]) == ("Not alike", "gains")
