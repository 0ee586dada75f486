"""Variables of MATLAB files of version 4 and 5 (as saved by -v4, -v6 and -v7), through SciPy; in the child process."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from rangeeval.errors import InputError, one_line
from rangeeval.parsers.matlab.values import (
    FUNCTION,
    SPARSE,
    Cells,
    Struct,
    Texts,
    Unread,
    Value,
    Wanted,
    check_depth,
    object_of,
)


def variables(path: str, wanted: Wanted | None = None) -> dict[str, Value]:
    """The variables of a file, or those that are wanted. Raises InputError for a damaged file."""
    import scipy.io

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of names that are met twice
            loaded = scipy.io.loadmat(path, variable_names=None if wanted is None else wanted.variables)
    except MemoryError:
        raise
    except Exception as error:  # SciPy raises what its parts raise
        text = f"{type(error).__name__}: {error}"
        raise InputError(f"the MATLAB file is damaged or cut off ({one_line(text, 120)})") from None
    return {_name(name, item): _value(item, 0) for name, item in loaded.items() if not name.startswith("__")}


def _name(name: str, item: Any) -> str:
    """SciPy calls every opaque variable None; its first field is the name."""
    from scipy.io.matlab import MatlabOpaque

    return _text(item["s0"][0]) if isinstance(item, MatlabOpaque) else name


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _value(item: Any, depth: int) -> Value:
    from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

    check_depth(depth)
    if isinstance(item, MatlabFunction):
        return FUNCTION
    if isinstance(item, MatlabOpaque):
        return object_of(_text(item["s2"][0]))
    if isinstance(item, MatlabObject):
        return object_of(str(item.classname))
    if not isinstance(item, np.ndarray):
        return SPARSE
    if item.dtype.names is not None or item.dtype == object:
        return _nested(item, depth)
    if item.dtype.kind == "U":
        return Texts(item.reshape(-1).tolist())
    if item.ndim == 2 and item.dtype.kind in "biufc":
        return item
    return Unread(f"array of {item.ndim} dimensions")


def _nested(item: Any, depth: int) -> Value:
    elements = item.reshape(-1, order="F")
    if item.dtype.names is None:
        return Cells([_value(element, depth + 1) for element in elements])
    if len(elements) == 1:
        return Struct({name: _value(elements[name][0], depth + 1) for name in item.dtype.names})
    fields = {name: Cells([_value(element, depth + 1) for element in elements[name]]) for name in item.dtype.names}
    return Struct(fields, len(elements))
