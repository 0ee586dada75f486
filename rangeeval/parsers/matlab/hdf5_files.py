"""Variables of MATLAB files of version 7.3, which are HDF5 behind 512 bytes of header; in the child process.

What MATLAB keeps in cells and struct arrays are references to objects of the same file, and only such are followed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rangeeval.errors import InputError
from rangeeval.parsers.hdf5 import MAX_OBJECTS, Audited
from rangeeval.parsers.matlab.values import (
    FUNCTION,
    SPARSE,
    Cells,
    Stored,
    Struct,
    Texts,
    Unread,
    Value,
    Wanted,
    check_depth,
    object_of,
)
from rangeeval.parsers.samples import is_pair

_MAX_TEXT = 16 << 20
_SMALL = 4096
_CACHE_BYTES = 64 << 20


def variables(path: str, wanted: Wanted | None = None) -> dict[str, Value]:
    """The variables of a file, or what of them is wanted. Raises InputError for what is refused."""
    # The columns of a matrix lie in the same chunks, and are asked for one after the other.
    file = _File(path, rdcc_nbytes=_CACHE_BYTES, rdcc_nslots=10_007)
    file.wanted = wanted
    return file.fields(file.file, "/", 0)


class _File(Audited):
    """The file, what is wanted of it, and how many references have been followed."""

    wanted: Wanted | None = None
    followed = 0

    def fields(self, group: Any, path: str, depth: int) -> dict[str, Value]:
        # What begins with # are MATLAB's own drawers for what references lead to.
        return {
            name: self.value(item, here, depth)
            for name, here, item in self.members(group, path, depth)
            if not name.startswith("#") and (self.wanted is None or here.strip("/").replace("/", ".") in self.wanted)
        }

    def value(self, item: Any, path: str, depth: int) -> Value:
        check_depth(depth)
        attributes = item.attrs
        named = attributes.get("MATLAB_class", b"")
        name = named.decode("ascii", "replace") if isinstance(named, bytes) else ""
        if "MATLAB_sparse" in attributes:
            return SPARSE
        if name == "function_handle":
            return FUNCTION
        if "MATLAB_object_decode" in attributes:
            return object_of(name)
        if isinstance(item, self.h5py.Group):
            return self.struct(item, path, depth)
        if not isinstance(item, self.h5py.Dataset):
            return Unread("type")
        self.look(item, path)
        if "MATLAB_empty" in attributes:
            return _empty(name)  # what is stored is its size
        if self.h5py.check_ref_dtype(item.dtype) is self.h5py.Reference:
            return Cells(self.cells(item, path, depth))
        text = name == "char" or self.h5py.check_string_dtype(item.dtype) is not None
        return self.texts(item) if text else self.numbers(item)

    def struct(self, group: Any, path: str, depth: int) -> Struct:
        fields = self.fields(group, path, depth + 1)
        # Of an array of structs, every field is a set of references that is no cell array itself.
        bare = [v for n, v in fields.items() if isinstance(v, Cells) and "MATLAB_class" not in group[n].attrs]
        sizes = {len(value.items) for value in bare}
        return Struct(fields, sizes.pop() if len(bare) == len(fields) and len(sizes) == 1 else 1)

    def cells(self, dataset: Any, path: str, depth: int) -> list[Value]:
        self.followed += dataset.size
        if self.followed > MAX_OBJECTS:
            raise InputError(f"it holds more than {MAX_OBJECTS} cells or structs; save each column as one vector")
        return [self.cell(reference, path, depth + 1) for reference in dataset[()].reshape(-1)]

    def cell(self, reference: Any, path: str, depth: int) -> Value:
        if not reference:
            return Unread("reference to nothing")
        small = self.small(reference)
        return self.value(self.file[reference], path, depth) if small is None else small

    def small(self, reference: Any) -> Value | None:
        """A number or a short text that stands by itself, in a fifth of the usual time; None for anything else."""
        h5 = self.h5py
        item = h5.h5r.dereference(reference, self.file.id)
        if not isinstance(item, h5.h5d.DatasetID):
            return None
        how = item.get_create_plist()
        if how.get_layout() not in (h5.h5d.COMPACT, h5.h5d.CONTIGUOUS) or how.get_external_count():
            return None
        shape, dtype = item.shape, item.dtype
        if dtype.kind not in "iuf" or len(shape) != 2 or shape[0] * shape[1] > _SMALL:
            return None
        if any(h5.h5a.exists(item, mark) for mark in (b"MATLAB_empty", b"MATLAB_object_decode")):
            return None
        values = np.empty(shape, dtype)
        item.read(h5.h5s.ALL, h5.h5s.ALL, values)
        coded = dtype.itemsize == 2 and h5.h5a.exists(item, b"MATLAB_int_decode")
        return _texts(values) if coded else values.T

    def texts(self, dataset: Any) -> Value:
        if dataset.size > _MAX_TEXT or dataset.dtype.kind not in "iuSO" or not 1 <= dataset.ndim <= 2:
            return Unread("text")
        if dataset.dtype.kind in "iu":
            return _texts(dataset[()])
        return Texts(dataset.asstr(errors="replace")[()].reshape(-1).tolist())  # not as MATLAB writes texts

    def numbers(self, dataset: Any) -> Value:
        kind = np.dtype(np.complex128) if is_pair(dataset.dtype.names) else dataset.dtype
        if kind.kind not in "biufc" or kind.shape != ():
            return Unread("type")
        if dataset.ndim not in (1, 2):
            return Unread(f"array of {dataset.ndim} dimensions")
        shape = (dataset.shape[-1], dataset.shape[0]) if dataset.ndim == 2 else (dataset.shape[0], 1)
        return Stored(dataset, shape, kind)


def _texts(stored: Any) -> Texts:
    """Rows of UTF-16 code units (an older writer's bytes are wide enough for them too)."""
    units = np.atleast_2d(stored.T).astype("<u2")
    return Texts([row.tobytes().decode("utf-16-le", "replace") for row in units])


def _empty(name: str) -> Value:
    if name == "char":
        return Texts([])
    if name in {"cell", "struct"}:
        return Cells([]) if name == "cell" else Struct({}, 0)
    return np.empty((0, 1))
