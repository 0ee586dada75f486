"""Results as tables and as JSON."""

import json
import math

import numpy as np
import pytest

from rangeeval.errors import InputError
from rangeeval.model import Estimate, Problem, Result
from rangeeval.model.result import COLUMNS

ROW = Estimate(
    quantity="range_sigma", unit="m", value=1 / 3, low=0.1, high=math.inf, n=7, n_eff=5.5, variable="range",
    bin_low=0.0, bin_high=5000.0, flags=("few-samples", "biased"), extra={"verdict": "pass"},
)  # fmt: skip
RESULT = Result(
    "accuracy", (ROW, Estimate(quantity="x", unit="1", value=math.nan)), {"width": np.float64(5), "none": None},
    (Problem("a.csv", "bad", 2, ("a.csv:3: x",), True),), {"s": {"x": [1.0, math.nan]}}, {"inputs": []},
)  # fmt: skip


def test_the_table_has_the_contracts_columns_in_order():
    """Further columns come last."""
    frame = RESULT.estimates
    assert tuple(frame.columns) == (*COLUMNS, "verdict")
    assert COLUMNS == (
        "track_id", "group", "variable", "bin_low", "bin_high", "quantity", "unit", "n", "n_eff", "value", "low", "high", "flags",
    )  # fmt: skip
    assert frame.loc[0, "flags"] == "few-samples biased"


def test_json_holds_full_precision_and_no_nan():
    """NaN and infinity are null, missing text is null, 1/3 keeps its last bit."""
    data = json.loads(RESULT.to_json(series=True), parse_constant=pytest.fail)
    assert data["schema"] == 1
    assert data["estimates"][0]["value"] == 1 / 3
    assert data["estimates"][0]["high"] is None
    assert data["estimates"][0]["group"] is None
    assert data["series"]["s"]["x"] == [1.0, None]
    assert set(data) == {"schema", "analysis", "settings", "estimates", "problems", "provenance", "series"}
    assert "series" not in json.loads(RESULT.to_json())


def test_a_result_comes_back_from_its_json():
    """Reading what was written gives the same again."""
    again = Result.from_dict(json.loads(RESULT.to_json(series=True)))
    assert again.to_json(series=True) == RESULT.to_json(series=True)


@pytest.mark.parametrize("data", [{}, [], {"schema": 2}, {"schema": 1, "analysis": "x", "estimates": [{}]}, None, 3])
def test_what_is_not_a_result_is_one_line(data):
    """Another schema or another file is named."""
    with pytest.raises(InputError, match=r"results\.json"):
        Result.from_dict(data)


def test_an_empty_result_is_an_empty_table():
    """No rows: the columns are still there."""
    assert list(Result("x", ()).estimates.columns) == list(COLUMNS)
