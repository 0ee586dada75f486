"""Labels: the code of a text is fixed once given, whatever type the file stores it in."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rangeeval.parsers.labels import Labels

TEXT = st.text(alphabet="AB12é ", max_size=3)


def stored(texts: list[str], form: str) -> Any:
    data = [t.encode() for t in texts]
    if form == "object":
        return np.array([*texts, None], dtype=object)[:-1]
    if form == "coded":
        return np.array(texts, dtype="U8")
    return np.array(data, dtype=f"S{form}")


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.lists(TEXT, min_size=1, max_size=40), max_size=5), st.sampled_from(["object", "coded", "7", "8", "20"])
)
def test_codes_are_of_first_appearance_and_stay(blocks: list[list[str]], form: str) -> None:
    """Block after block, the codes are those of a plain loop over all texts."""
    labels = Labels()
    codes: dict[str, int] = {}
    for texts in blocks:
        expected = []
        for text in texts:
            known = text.strip()
            expected.append(codes.setdefault(known, len(codes)) if known else -1)
        assert labels.code(stored(texts, form)).tolist() == expected
    assert labels.labels == tuple(codes)


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.lists(st.integers(-(2**40), 2**40) | st.integers(-5, 5), min_size=1, max_size=40), max_size=4),
    st.sampled_from([np.int64, np.float64]),
)
def test_numbers_are_the_text_of_the_number(blocks: list[list[int]], dtype: Any) -> None:
    """Whole numbers, stored as integers or floats, get the label a CSV would hold."""
    labels = Labels()
    codes: dict[int, int] = {}
    for numbers in blocks:
        expected = [codes.setdefault(n, len(codes)) for n in numbers]
        assert labels.code(np.array(numbers, dtype)).tolist() == expected
    assert labels.labels == tuple(str(n) for n in codes)


@pytest.mark.parametrize("count", [3, 900, 3000])
def test_many_labels_are_found_again(count: int) -> None:
    """Few or many different ids: the second block's codes are the first one's."""
    ids = np.array([f"T{i}".encode() for i in range(count)], "S8")
    labels = Labels()
    first = labels.code(ids)
    np.testing.assert_array_equal(labels.code(ids[::-1]), first[::-1])
    assert labels.code(np.array([b"new"], "S8")).tolist() == [count]
    np.testing.assert_array_equal(labels.code(ids), first)
