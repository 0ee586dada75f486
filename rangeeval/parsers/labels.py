"""Text columns as codes: the label of a code is fixed once given, in the order of first appearance."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

_MISSING = frozenset({"", "nan", "n/a", "-", "-nan"})
_WIDEST_TABLE = 1 << 20
_SHIFT = np.uint64(64 - 18)
# Odd numbers without pattern (multiples of the golden ratio's digits): multiplicative hashing, Knuth 6.4.
_FACTORS = tuple(np.uint64(0x9E3779B97F4A7C15 * (2 * k + 1) % 2**64) for k in range(16))


class Labels:
    """Codes the text of one column, block after block.

    Texts are trimmed; the contract's missing values become -1. Whole numbers are the text of the number, whether the
    file stores `12` or `12.0`.
    """

    def __init__(self) -> None:
        self._codes: dict[str, int] = {}
        self.labels: tuple[str, ...] = ()
        # What the block before has taught, for a quick look-up: numbers from `_low` on, and texts as sorted keys.
        self._seen: dict[Any, int] = {}
        self._low = 0
        self._table = np.empty(0, np.int32)
        self._keys: NDArray[Any] = np.empty(0, np.uint64)
        self._key_codes = np.empty(0, np.int32)
        self._slots: NDArray[np.int32] | None = None
        self._factor = np.uint64(1)

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
            return self._objects(values.tolist())
        if values.dtype.kind == "S":
            return self._fixed(values)
        return self._objects(values.tolist())

    def _objects(self, values: list[Any]) -> NDArray[np.int32]:
        seen = self._seen
        for value in dict.fromkeys(values):
            if value not in seen:
                seen[value] = self._code(_text(value))
        return np.fromiter(map(seen.__getitem__, values), np.int32, len(values))

    def _numbers(self, values: NDArray[Any]) -> NDArray[np.int32]:
        low, high = int(values.min()), int(values.max())
        if len(self._table) and low >= self._low and high < self._low + len(self._table):
            codes = self._table[values if self._low == 0 else values.astype(np.int64) - self._low]
            if codes.min() >= 0:
                return codes
        if high - low < _WIDEST_TABLE:
            offsets = values.astype(np.int64) - low
            first = np.full(high - low + 1, -1, np.int64)
            first[offsets[::-1]] = np.arange(len(offsets) - 1, -1, -1)
            seen = np.flatnonzero(first >= 0)
            table = np.full(high - low + 1, -1, np.int32)
            for offset in seen[np.argsort(first[seen])].tolist():
                table[offset] = self._code(str(offset + low))
            self._low, self._table = low, table
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
            codes = self._objects(values[starts].tolist())
            return np.repeat(codes, np.diff(np.concatenate([starts, [len(values)]])))
        if width <= 8:  # eight bytes compare as one number
            keys = np.zeros(len(values), "S8")
            keys[:] = values
            return self._unique(values, keys.view(np.uint64))
        return self._unique(values)

    def _unique(self, values: NDArray[Any], keys: NDArray[Any] | None = None) -> NDArray[np.int32]:
        keys = values if keys is None else keys
        if len(self._keys) and self._keys.dtype == keys.dtype:
            if self._slots is not None:
                place = self._slots[(keys * self._factor) >> _SHIFT]
            else:
                place = np.minimum(np.searchsorted(self._keys, keys), len(self._keys) - 1).astype(np.int32)
            if bool((self._keys[place] == keys).all()):
                return np.asarray(self._key_codes[place])
        known, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
        table = np.empty(len(first), np.int32)
        for i in np.argsort(first).tolist():
            table[i] = self._code(_text(values[first[i]]))
        self._keys, self._key_codes = known, table
        self._spread()
        return np.asarray(table[inverse])

    def _spread(self) -> None:
        """Find a factor that sends each known key to a place of its own: a look-up instead of a search."""
        self._slots = None
        if self._keys.dtype != np.uint64 or len(self._keys) > 1000:
            return
        for factor in _FACTORS:
            places = (self._keys * factor) >> _SHIFT
            if len(np.unique(places)) == len(places):
                self._slots = np.zeros(1 << 18, np.int32)
                self._slots[places] = np.arange(len(places), dtype=np.int32)
                self._factor = factor
                return


def _text(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if isinstance(value, (float, np.floating)):
        number = float(value)
        return str(int(number)) if abs(number) < 2**53 and number.is_integer() else str(number)
    return str(value)
