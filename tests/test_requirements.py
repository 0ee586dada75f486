"""Verdicts."""

import math

import pytest

from rangeeval.errors import SettingsError
from rangeeval.model import Estimate, Result
from rangeeval.model.settings import Requirement
from rangeeval.requirements import check
from rangeeval.stats.intervals import sigma_lower_bound, sigma_upper_bound


def rows(value, nu, *, white=None, n=100, low=0.0):
    """A bin's range sigma by both ratios."""
    common = {
        "unit": "m",
        "n": n,
        "n_eff": nu + 1,
        "variable": "range",
        "bin_low": low,
        "bin_high": low + 5e3,
        "extra": {"nu": nu},
    }
    return (
        Estimate(quantity="range_sigma", value=value, **common),
        Estimate(quantity="range_sigma_white", value=value if white is None else white, **common),
    )


def judged(limit, *bins, confidence=0.95):
    """The rows of check on one requirement."""
    return check(
        [(Requirement("range_sigma", limit, confidence), Result("accuracy", tuple(r for b in bins for r in b)))]
    ).rows


@pytest.mark.parametrize(
    ("s", "nu", "verdict"),
    [
        (14.0, 29, "pass"),
        (16.0, 29, "inconclusive"),
        (23.0, 29, "inconclusive"),
        (25.0, 99, "fail"),
        (18.0, 400, "pass"),
    ],
)
def test_the_verdict_is_that_of_the_one_sided_bound(s, nu, verdict):
    """Pass when the upper 95 % bound is within 20 m, fail when the lower is beyond, else inconclusive."""
    (row,) = judged(20.0, rows(s, nu))
    assert row.extra["verdict"] == verdict
    bound = sigma_lower_bound(s, nu, 0.95) if verdict == "fail" else sigma_upper_bound(s, nu, 0.95)
    assert row.extra["bound"] == pytest.approx(float(bound))


def test_both_gain_ratios_must_agree():
    """Whether the target manoeuvred is unknown: the larger sigma must pass, the smaller must fail."""
    assert judged(20.0, rows(10.0, 99, white=19.0))[0].extra["verdict"] == "inconclusive"
    assert judged(20.0, rows(40.0, 99, white=19.0))[0].extra["verdict"] == "inconclusive"
    assert judged(20.0, rows(40.0, 99, white=30.0))[0].extra["verdict"] == "fail"
    assert judged(20.0, rows(40.0, 99, white=19.0))[0].extra["more_samples"] is None


def test_more_samples_would_decide():
    """With that many more the verdict is decided, with one fewer it is not."""
    (row,) = judged(20.0, rows(17.0, 29, n=30))
    more = row.extra["more_samples"]
    assert judged(20.0, rows(17.0, 29 * (30 + more) / 30))[0].extra["verdict"] == "pass"
    assert judged(20.0, rows(17.0, 29 * (30 + more - 1) / 30))[0].extra["verdict"] == "inconclusive"


def test_many_bins_together_need_more():
    """A sigma that passes in one bin alone does not at the level of twenty bins together."""
    alone = judged(20.0, rows(15.5, 29))
    together = judged(20.0, *(rows(15.5, 29, low=i * 5e3) for i in range(20)))
    assert alone[0].extra["family_verdict"] == "pass"
    assert together[0].extra["verdict"] == "pass"
    assert together[0].extra["family_verdict"] == "inconclusive"


def test_a_bin_without_samples_is_not_judged_and_said():
    """No sample that the requirement speaks of: no row, one problem."""
    result = check(
        [
            (
                Requirement("range_sigma", 20.0),
                Result("accuracy", (*rows(1.0, 50), *rows(math.nan, math.nan, n=0, low=5e3))),
            )
        ]
    )
    assert len(result.rows) == 1
    assert "1 bins hold no sample" in result.problems[0].reason


def test_a_bin_with_one_sample_is_inconclusive():
    """No sigma, no verdict."""
    (row,) = judged(20.0, rows(math.nan, math.nan, n=1))
    assert row.extra["verdict"] == "inconclusive"
    assert row.extra["more_samples"] is None


def test_an_unknown_quantity_is_named():
    """With the nearest one."""
    with pytest.raises(SettingsError, match="did you mean 'range_sigma'"):
        check([(Requirement("rnage_sigma", 20.0), Result("accuracy", rows(1.0, 50)))])
