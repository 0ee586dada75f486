"""What a MATLAB variable can be, whichever version of the file holds it.

Numbers are a NumPy matrix, or a `Stored` one that is read when it is asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import InputError
from rangeeval.parsers.hdf5 import MAX_DEPTH
from rangeeval.parsers.samples import as_complex


@dataclass(frozen=True)
class Stored:
    """A matrix of numbers in an HDF5 file, where MATLAB's columns are rows."""

    dataset: Any
    shape: tuple[int, int]
    dtype: np.dtype[Any]

    def __getitem__(self, place: tuple[slice | int, slice | int]) -> NDArray[Any]:
        rows, columns = place
        if self.dataset.ndim == 1:  # not MATLAB's own, which knows no vectors
            return as_complex(self.dataset[rows])[:, None][:, columns]
        return as_complex(self.dataset[columns, rows]).T


@dataclass(frozen=True)
class Texts:
    """A character array: a text a row."""

    rows: Sequence[str]


@dataclass(frozen=True)
class Cells:
    """A cell array, or one field of an array of structs: its elements, column after column."""

    items: Sequence[Value]


@dataclass(frozen=True)
class Struct:
    """A struct: its fields; those of an array of structs are `Cells` of as many items as there are `elements`."""

    fields: Mapping[str, Value]
    elements: int = 1


@dataclass(frozen=True)
class Unread:
    """What cannot be read: the word for it, and what to save `instead` (`{}` stands for its name)."""

    what: str
    instead: str = ""


Matrix = NDArray[Any] | Stored
Value = NDArray[Any] | Stored | Texts | Cells | Struct | Unread

SPARSE = Unread("sparse matrix", "full({})")
FUNCTION = Unread("function handle")

# Objects are stored in a way that MATLAB keeps to itself; each has a function that makes plain values of it.
_INSTEAD = {
    "table": "table2struct({}, 'ToScalar', true)",
    "timetable": "table2struct(timetable2table({}), 'ToScalar', true)",
    "datetime": "posixtime({})",
    "duration": "seconds({})",
    "string": "cellstr({})",
    "categorical": "cellstr({})",
}


def object_of(name: str) -> Unread:
    """An object of a MATLAB class."""
    return Unread(f"{name} object", _INSTEAD.get(name, "struct({})"))


@dataclass(frozen=True)
class Wanted:
    """Which fields of which struct are asked for, by its path (`run.residuals`; '' are the file's variables)."""

    struct: str
    names: frozenset[str]

    @property
    def variables(self) -> list[str]:
        """The variables of the file that are needed."""
        return [self.struct.split(".")[0]] if self.struct else sorted(self.names)

    def __contains__(self, path: str) -> bool:
        """Whether what is stored under this path is needed."""
        inside, _, name = path.rpartition(".")
        named = name in self.names or name.casefold() in self.names
        return f"{self.struct}.".startswith(f"{path}.") or (inside == self.struct and named)


def check_depth(depth: int) -> None:
    """Raises InputError for structs and cells in each other without end."""
    if depth > MAX_DEPTH:
        raise InputError(f"structs and cells are nested deeper than {MAX_DEPTH}")


def is_empty(value: Value) -> bool:
    """Whether it is the empty matrix, text, cell array or struct."""
    if isinstance(value, Struct):
        return value.elements == 0
    if isinstance(value, (np.ndarray, Stored)):
        return 0 in value.shape
    if isinstance(value, Texts):
        return not any(value.rows)
    return isinstance(value, Cells) and not value.items
