"""Cell arrays and arrays of structs, as what columns can be made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.parsers.matlab.values import Cells, Stored, Struct, Texts, Unread, Value, is_empty


def as_structs(cells: Cells) -> Struct | None:
    """The structs in the cells, of the same fields, as one array of structs; None where that is not what they hold."""
    structs = [item for item in cells.items if isinstance(item, Struct) and item.elements]
    if not structs or len(structs) != sum(not is_empty(item) for item in cells.items):
        return None
    names = structs[0].fields.keys()
    if any(s.fields.keys() != names for s in structs):
        return None
    fields = {name: Cells(list(chain.from_iterable(_elements(s, name) for s in structs))) for name in names}
    return Struct(fields, sum(s.elements for s in structs))


def _elements(struct: Struct, name: str) -> Sequence[Value]:
    value = struct.fields[name]
    return value.items if struct.elements != 1 and isinstance(value, Cells) else [value]


# --- one element, one row --------------------------------------------------------------------------------------------


def as_column(cells: Cells) -> Value:
    """A number or a text in each cell as a column, a row of numbers in each as a matrix; an empty cell is missing."""
    simple = [_number(item) for item in cells.items]
    if None not in simple:
        return np.array(simple, np.float64)[:, None]
    texts = [_text(item, number) for item, number in zip(cells.items, simple, strict=True)]
    if None not in texts:
        return Texts([text for text in texts if text is not None])
    shapes = {item.shape if isinstance(item, (np.ndarray, Stored)) else (0, 0) for item in cells.items}
    if len(shapes) == 1 and min(shapes.pop()) == 1:
        return np.stack([whole(item) for item in cells.items])
    return Unread(f"{len(cells.items)} cells")


def whole(value: Value) -> NDArray[Any]:
    """The numbers of a vector."""
    assert isinstance(value, (np.ndarray, Stored))
    return np.asarray(value[:, :]).reshape(-1)


def _number(item: Value) -> float | int | None:
    """The number in a cell, NaN for an empty one; None where it is something else."""
    if is_empty(item):
        return np.nan
    one = isinstance(item, (np.ndarray, Stored)) and item.shape == (1, 1) and item.dtype.kind in "biuf"
    return whole(item).item() if one else None


def _text(item: Value, number: float | int | None) -> str | None:
    if number is not None:
        return "" if is_empty(item) else repr(int(number) if float(number).is_integer() else number)
    return item.rows[0] if isinstance(item, Texts) and len(item.rows) == 1 else None


# --- one element, many rows ------------------------------------------------------------------------------------------


def unrolled(struct: Struct, is_time: Callable[[str], bool]) -> Mapping[str, Value]:
    """The fields of an array of structs, each element of which is a track: a vector of times, and fields as long.

    What stands once in an element holds for all its rows. Where times are one number each, an element is a row.
    """
    times = next((value for name, value in struct.fields.items() if is_time(name)), None)
    if not isinstance(times, Cells) or not all(_is_vector(item) for item in times.items):
        return struct.fields
    lengths = [0 if is_empty(item) else len(whole(item)) for item in times.items]
    if max(lengths, default=0) <= 1:
        return struct.fields
    return {
        name: _chained(value, lengths) if isinstance(value, Cells) else value for name, value in struct.fields.items()
    }


def _is_vector(item: Value) -> bool:
    return isinstance(item, (np.ndarray, Stored)) and (1 in item.shape or 0 in item.shape)


def _chained(cells: Cells, lengths: Sequence[int]) -> Value:
    """The elements one after the other, each of the length of its times."""
    parts = [_long(item, length) for item, length in zip(cells.items, lengths, strict=True)]
    numbers = [part for part in parts if isinstance(part, np.ndarray)]
    texts = [part for part in parts if isinstance(part, list)]
    if len(numbers) == len(parts):
        return np.concatenate(numbers)[:, None]
    return Texts(list(chain.from_iterable(texts))) if len(texts) == len(parts) else Unread("not as long as its times")


def _long(item: Value, length: int) -> NDArray[Any] | list[str] | None:
    if isinstance(item, Texts) and len(item.rows) in (1, length):
        return list(item.rows) * (length // len(item.rows)) if length else []
    if is_empty(item):
        return np.full(length, np.nan)
    if not _is_vector(item):
        return None
    values = whole(item)
    return np.resize(values, length) if len(values) in (1, length) else None
