"""Records of a category found by libasterix's tables: where each item begins, and the few numbers that are wanted.

The tables (which items an edition has, their lengths, bits, signs and least significant bits) are libasterix's. Its own
`parse` makes an object of every bit field of a record; to walk over what nobody asks for is 20 times as fast.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import InputError, MissingExtra, one_line

Length = int | Callable[[bytes, int], int]  # bytes of an item, or how to tell from its first ones
Bytes = NDArray[np.uint8]
Places = NDArray[np.int64]
Floats = NDArray[np.float64]

HEADER_BYTES = 3
_PLANS = 4096  # field specifications whose meaning is kept


class Malformed(Exception):
    """A data block is not what its category's tables say."""


@lru_cache(maxsize=1)
def library() -> tuple[Any, Any]:
    """libasterix's two modules. Raises MissingExtra, or InputError when another package took its place."""
    try:
        from asterix import base, generated
    except ImportError:
        base = generated = None
    if generated is not None and "CATS" in getattr(generated, "manifest", {}):
        return base, generated
    found = _installed()
    if found is None:
        raise MissingExtra("reading ASTERIX", "asterix")
    raise InputError(
        f"the package 'asterix' that Python finds ({found}) is not libasterix; asterix-decoder takes the same name: "
        f"pip uninstall asterix-decoder, then pip install --force-reinstall libasterix"
    )


def _installed() -> str | None:
    """Where Python finds a package of the name; None when there is none."""
    try:
        spec = importlib.util.find_spec("asterix")
    except ValueError:  # one that was put there by hand
        return "in memory"
    return None if spec is None else one_line(spec.origin or "a folder without modules", 100)


def editions(category: int) -> dict[str, Any]:
    """The editions of a category that libasterix knows, newest first: `2.1` and its definition."""
    _, generated = library()
    known = sorted(generated.manifest["CATS"].get(category, ()), key=lambda c: c.cv_edition, reverse=True)
    return {".".join(map(str, c.cv_edition)): c for c in known}


# --- lengths ---------------------------------------------------------------------------------------------------------


def _variation(definition: Any) -> Any:
    """The layout of an item; of one that depends on another item, the layout that all its cases share."""
    rule = definition.cv_rule
    return rule.cv_variation if hasattr(rule, "cv_variation") else rule.cv_default_variation


def _bytes(bits: int) -> int:
    assert bits % 8 == 0
    return bits // 8


def _parts(extended: Any) -> list[tuple[int, bool]]:
    """The parts of an extended item: bytes of each, and whether its last bit announces the next."""
    return [
        (_bytes(sum(1 if item is None else item[1] for item in part)), part[-1] is None)
        for part in extended.cv_items_list
    ]


def _length(variation: Any) -> Length:
    base, _ = library()
    if issubclass(variation, (base.Element, base.Group)):
        return _bytes(variation.cv_bit_size)
    if issubclass(variation, base.Extended):
        return _extended(_parts(variation))
    if issubclass(variation, base.Repetitive):
        return _repetitive(variation.cv_rep_bytes, variation.cv_variation)
    if issubclass(variation, base.Explicit):
        return _explicit
    assert issubclass(variation, base.Compound)
    return _compound(variation)


def _extended(parts: Sequence[tuple[int, bool]]) -> Length:
    def length(data: bytes, at: int) -> int:
        end = at
        for size, announces in parts:
            end += size
            if not announces or not data[end - 1] & 1:
                return end - at
        raise Malformed

    return length


def _repetitive(count_bytes: int | None, variation: Any) -> Length:
    if count_bytes is None:  # each one ends in a bit that announces the next
        size = _bytes(variation.cv_bit_size + 1)

        def announced(data: bytes, at: int) -> int:
            end = at + size
            while data[end - 1] & 1:
                end += size
            return end - at

        return announced
    one = _length(variation)

    def counted(data: bytes, at: int) -> int:
        end = at + count_bytes
        times = int.from_bytes(data[at:end], "big")
        if isinstance(one, int):
            return count_bytes + times * one
        for _ in range(times):
            end += one(data, end)
        return end - at

    return counted


def _explicit(data: bytes, at: int) -> int:
    if not data[at]:
        raise Malformed
    return data[at]


def _fspec(data: bytes, at: int, most: int) -> bytes:
    """The field specification that begins here: bytes whose last bit announces another."""
    end = at
    while data[end] & 1:
        end += 1
    if end - at >= most:
        raise Malformed
    return data[at : end + 1]


def _chosen(spec: bytes) -> Iterator[int]:
    """The places of the items that a field specification announces, from 0."""
    for i, byte in enumerate(spec):
        for bit in range(7):
            if byte & (0x80 >> bit):
                yield 7 * i + bit


def _compound(variation: Any) -> Callable[[bytes, int], int]:
    walk = _subfields(variation)
    return lambda data, at: walk(data, at)[1]


def _subfields(variation: Any) -> Callable[[bytes, int], tuple[dict[str, int], int]]:
    """How to find the subfields of a compound item: how far from its begin each lies, and the item's length."""
    items = [None if item is None else (item.cv_name, _length(_variation(item))) for item in variation.cv_items_list]
    most = variation.cv_fspec_max_bytes
    fixed: dict[bytes, tuple[dict[str, int], int]] = {}

    def walk(data: bytes, at: int) -> tuple[dict[str, int], int]:
        spec = _fspec(data, at, most)
        if spec in fixed:
            return fixed[spec]
        far, places, varies = len(spec), {}, False
        for i in _chosen(spec):
            item = items[i] if i < len(items) else None
            if item is None:
                raise Malformed
            name, size = item
            places[name] = far
            varies |= not isinstance(size, int)
            far += size if isinstance(size, int) else size(data, at + far)
        if not varies and len(fixed) < _PLANS:
            fixed[spec] = places, far
        return places, far

    return walk


# --- fields ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Bits:
    """A bit field: where it stands in what holds it, and what one unit of it is.

    `announced_by`: the bytes whose last bit must be set for the part of an extended item to be there that holds it.
    """

    offset: int
    size: int
    signed: bool
    unit: float
    announced_by: tuple[int, ...] = ()

    def numbers(self, data: Bytes, places: Places) -> Floats:
        """The field's number at each place, (n,); NaN where there is none (a place of -1)."""
        there = places >= 0
        for byte in self.announced_by:
            there &= (data[places + byte] & 1) == 1
        first, last = self.offset // 8, (self.offset + self.size + 7) // 8
        raw = np.zeros(len(places), np.int64)
        for byte in range(first, last):
            raw = raw << 8 | data[places + byte]
        raw = raw >> (8 * last - self.offset - self.size) & (1 << self.size) - 1
        if self.signed:
            raw -= (raw >> (self.size - 1)) << self.size
        return np.where(there, raw * self.unit, np.nan)


def _bits(offset: int, size: int, element: Any, announced_by: tuple[int, ...] = ()) -> _Bits:
    base, _ = library()
    content = getattr(element.cv_rule, "cv_content", None)
    signed = getattr(content, "cv_signedness", None) is base.Signed
    return _Bits(offset, size, signed, float(getattr(content, "cv_lsb", 1.0)), announced_by)


def _among(items: Any, name: str) -> tuple[int, int, Any] | None:
    """Bit offset, size and element of a named field among fields that follow each other; None when it is none."""
    offset = 0
    for item in items:
        if item is None:
            offset += 1
            continue
        definition, size = item
        field = getattr(definition, "cv_non_spare", None)
        if field is not None and field.cv_name == name:
            return offset, size, _variation(field)
        offset += size
    return None


def _field(variation: Any, name: str) -> _Bits | None:
    """A named field of an item, or (without a name) the whole of a plain one; None where the edition has it not."""
    base, _ = library()
    if issubclass(variation, base.Element):
        return None if name else _bits(0, variation.cv_bit_size, variation)
    if issubclass(variation, base.Group):
        found = _among(variation.cv_items_list, name)
        return None if found is None else _bits(*found)
    if not issubclass(variation, base.Extended):
        return None
    begin = 0
    announced_by: tuple[int, ...] = ()
    for (size, _), part in zip(_parts(variation), variation.cv_items_list, strict=True):
        found = _among(part, name)
        if found is not None:
            offset, bits, element = found
            return _bits(8 * begin + offset, bits, element, announced_by)
        begin += size
        announced_by += (begin - 1,)
    return None


# --- records ---------------------------------------------------------------------------------------------------------


class Edition:
    """One edition of a category: walks the records of its data blocks and reads the wanted fields.

    `fields` names each wanted number by item and field: `140` of a plain item, `040/RHO`, or a subfield of a compound
    one (`130/SAM`). One that the edition does not have is missing in every record.
    """

    def __init__(self, name: str, definition: Any, fields: Mapping[str, str]) -> None:
        base, _ = library()
        self.name = name
        record = definition.cv_record
        self.slots: dict[str, int] = {}  # the wanted items and subfields, numbered
        self._bits: dict[str, tuple[int, _Bits]] = {}
        self._compounds: dict[str, list[str]] = {}
        for short, written in fields.items():
            item, _, field = written.partition("/")
            if item not in record.cv_items_dict:
                continue
            layout = _variation(record.cv_items_dict[item])
            inside = issubclass(layout, base.Compound) and field in layout.cv_items_dict
            bits = _field(_variation(layout.cv_items_dict[field]), "") if inside else _field(layout, field)
            if bits is not None:
                self.slots.setdefault(item, len(self.slots))
                holder = written if inside else item
                self._bits[short] = self.slots.setdefault(holder, len(self.slots)), bits
                if inside:
                    self._compounds.setdefault(item, []).append(field)
        self._inside = [
            (self.slots[item], _subfields(_variation(record.cv_items_dict[item])),
             [(name, self.slots[f"{item}/{name}"]) for name in names])
            for item, names in self._compounds.items()
        ]  # fmt: skip
        self._most = record.cv_fspec_max_bytes
        self._steps: list[tuple[int, Length] | None] = []
        for entry in record.cv_items_list:
            if issubclass(entry, base.UapItem):
                item = entry.cv_non_spare
                self._steps.append((self.slots.get(item.cv_name, -1), _length(_variation(item))))
            else:
                self._steps.append(None)
        self._plans: dict[bytes, tuple[tuple[int, Length], ...]] = {}

    def _plan(self, spec: bytes) -> tuple[tuple[int, Length], ...]:
        """The items that a field specification announces: the slot of each (-1: not wanted), and its length."""
        steps = [self._steps[i] if i < len(self._steps) else None for i in _chosen(spec)]
        if None in steps or not steps:
            raise Malformed
        plan = tuple(step for step in steps if step is not None)
        if len(self._plans) < _PLANS:
            self._plans[spec] = plan
        return plan

    def records(self, block: bytes) -> list[list[int]]:
        """Where each wanted item (by its slot) begins in each record of a whole data block, -1 where there is none.

        Raises Malformed.
        """
        found: list[list[int]] = []
        at, end = HEADER_BYTES, len(block)
        plans, most, none = self._plans, self._most, [-1] * len(self.slots)
        try:
            while at < end:
                spec = _fspec(block, at, most)
                at += len(spec)
                places = none.copy()
                for slot, size in plans.get(spec) or self._plan(spec):
                    if slot >= 0:
                        places[slot] = at
                    at += size if size.__class__ is int else size(block, at)  # type: ignore[operator]
                for slot, walk, subfields in self._inside:
                    if places[slot] >= 0:
                        inside = walk(block, places[slot])[0]
                        for name, place in subfields:
                            if name in inside:
                                places[place] = places[slot] + inside[name]
                found.append(places)
        except IndexError:
            raise Malformed from None
        if at != end or not found:
            raise Malformed
        return found

    def numbers(self, data: Bytes, places: Places) -> dict[str, Floats]:
        """The wanted numbers of records, (n,) each, NaN where missing, from the places (n, slots) of their items."""
        return {short: bits.numbers(data, places[:, slot]) for short, (slot, bits) in self._bits.items()}
