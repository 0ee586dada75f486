"""Text columns as codes: the label of a code is fixed once given, in the order of first appearance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

_MISSING = frozenset({"", "nan", "n/a", "-", "-nan"})
_WIDEST_TABLE = 1 << 20


class Labels:
    """Codes the text of one column, block after block.

    Texts are trimmed; the contract's missing values become -1. Whole numbers are the text of the number, whether the
    file stores `12` or `12.0`.
    """

    def __init__(self) -> None:
        self._codes: dict[str, int] = {}
        self.labels: tuple[str, ...] = ()

    def _code(self, text: str) -> int:
        text = text.strip().strip("\0")
        if text.casefold() in _MISSING:
            return -1
        code = self._codes.get(text)
        if code is None:
            code = self._codes[text] = len(self._codes)
            self.labels = (*self.labels, text)
        return code

    def recode(self, codes: NDArray[Any], categories: Sequence[object]) -> NDArray[np.int32]:
        """The codes of rows that a reader has coded into its own categories (-1 where missing)."""
        table = np.full(len(categories) + 1, -1, np.int32)
        if len(categories):
            used, first = np.unique(codes, return_index=True)
            for category in used[np.argsort(first)].tolist():
                if category >= 0:
                    table[category] = self._code(_text(categories[category]))
        return np.asarray(table[codes])

    def code(self, values: NDArray[Any]) -> NDArray[np.int32]:
        """The codes of an array of texts (fixed-length or objects) or numbers."""
        if len(values) == 0:
            return np.empty(0, np.int32)
        if values.dtype.kind in "iub":
            return self._numbers(values)
        if values.dtype.kind == "f":
            whole = np.isfinite(values) & (values == np.floor(values)) & (np.abs(values) < 2**53)
            if whole.all():
                return self._numbers(values.astype(np.int64))
            return self._objects([_text(v) for v in values.tolist()])
        if values.dtype.kind == "S":
            return self._fixed(values)
        return self._objects([_text(v) for v in values.tolist()])

    def _objects(self, texts: list[str]) -> NDArray[np.int32]:
        codes: dict[str, int] = {}
        found = np.empty(len(texts), np.int32)
        for i, text in enumerate(texts):
            code = codes.get(text)
            if code is None:
                code = codes[text] = self._code(text)
            found[i] = code
        return found

    def _numbers(self, values: NDArray[Any]) -> NDArray[np.int32]:
        low, high = int(values.min()), int(values.max())
        if high - low < _WIDEST_TABLE:
            offsets = (values.astype(np.int64) - low) if values.dtype.kind != "b" else values.astype(np.int64)
            first = np.full(high - low + 1, -1, np.int64)
            first[offsets[::-1]] = np.arange(len(offsets) - 1, -1, -1)
            seen = np.flatnonzero(first >= 0)
            table = np.full(high - low + 1, -1, np.int32)
            for offset in seen[np.argsort(first[seen])].tolist():
                table[offset] = self._code(str(offset + low))
            return np.asarray(table[offsets])
        return self._unique(values)

    def _fixed(self, values: NDArray[np.bytes_]) -> NDArray[np.int32]:
        width = values.dtype.itemsize
        if width == 0:
            return np.full(len(values), -1, np.int32)
        # Runs of one label are common (a log sorted by track): code each run once.
        changes = np.flatnonzero(values[1:] != values[:-1]) + 1
        if len(changes) < len(values) // 8:
            starts = np.concatenate([[0], changes])
            codes = self._objects([_text(v) for v in values[starts].tolist()])
            return np.repeat(codes, np.diff(np.concatenate([starts, [len(values)]])))
        if width <= 8:
            return self._unique(values, np.ascontiguousarray(values.astype("S8")).view(np.uint64))
        return self._unique(values)

    def _unique(self, values: NDArray[Any], keys: NDArray[Any] | None = None) -> NDArray[np.int32]:
        _, first, inverse = np.unique(values if keys is None else keys, return_index=True, return_inverse=True)
        table = np.empty(len(first), np.int32)
        for i in np.argsort(first).tolist():
            table[i] = self._code(_text(values[first[i]]))
        return np.asarray(table[inverse])


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if isinstance(value, (float, np.floating)):
        number = float(value)
        return str(int(number)) if abs(number) < 2**53 and number.is_integer() else str(number)
    return str(value)
