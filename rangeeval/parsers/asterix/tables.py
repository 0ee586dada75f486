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

from rangeeval.errors import InputError, MissingExtra

Length = int | Callable[[bytes, int], int]  # bytes of an item, or how to tell from its first ones
Getter = Callable[[bytes, int], int | None]  # the raw number of a field of the item at a place; None where absent

HEADER_BYTES = 3


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
    if not _installed():
        raise MissingExtra("reading ASTERIX", "asterix")
    raise InputError(
        "the installed package 'asterix' is not libasterix (asterix-decoder takes the same name): "
        "pip uninstall asterix-decoder, then pip install --force-reinstall libasterix"
    )


def _installed() -> bool:
    """Whether some package of the name is there."""
    return importlib.util.find_spec("asterix") is not None


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
    walk = _compound_walk(variation)
    return lambda data, at: walk(data, at)[1] - at


def _compound_walk(variation: Any) -> Callable[[bytes, int], tuple[dict[str, int], int]]:
    """How to find the subfields of a compound item: the place of each, and the item's end."""
    items = [None if item is None else (item.cv_name, _length(_variation(item))) for item in variation.cv_items_list]
    most = variation.cv_fspec_max_bytes

    def walk(data: bytes, at: int) -> tuple[dict[str, int], int]:
        spec = _fspec(data, at, most)
        end = at + len(spec)
        places = {}
        for i in _chosen(spec):
            item = items[i] if i < len(items) else None
            if item is None:
                raise Malformed
            name, size = item
            places[name] = end
            end += size if isinstance(size, int) else size(data, end)
        return places, end

    return walk


# --- fields ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Value:
    """A number of a record: its item, how to read it there, and what one unit of it is."""

    item: str
    get: Getter
    unit: float


def _bits(offset: int, size: int, element: Any) -> tuple[Getter, float]:
    """A bit field of an item, and what one unit of it is."""
    base, _ = library()
    content = getattr(element.cv_rule, "cv_content", None)
    signed = getattr(content, "cv_signedness", None) is base.Signed
    first, last = offset // 8, (offset + size + 7) // 8
    shift, mask, half = 8 * last - offset - size, (1 << size) - 1, 1 << (size - 1)

    def get(data: bytes, at: int) -> int:
        raw = int.from_bytes(data[at + first : at + last], "big") >> shift & mask
        return raw - 2 * half if signed and raw >= half else raw

    return get, float(getattr(content, "cv_lsb", 1.0))


def _among(items: Any, name: str) -> tuple[int, int, Any] | None:
    """Bit offset, size and element of a named field among fields that follow each other; None when it has none."""
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


def _field(variation: Any, name: str) -> tuple[Getter, float] | None:
    """How to read a named field (or, without a name, the one there is); None where the edition does not have it."""
    base, _ = library()
    if issubclass(variation, base.Element):
        return None if name else _bits(0, variation.cv_bit_size, variation)
    if issubclass(variation, base.Group):
        found = _among(variation.cv_items_list, name)
        return None if found is None else _bits(*found)
    if issubclass(variation, base.Extended):
        begin = 0
        announced_by: list[int] = []  # the bytes whose last bit must be set for the part to be there
        for (size, _), part in zip(_parts(variation), variation.cv_items_list, strict=True):
            found = _among(part, name)
            if found is not None:
                offset, bits, element = found
                return _if_announced(_bits(8 * begin + offset, bits, element), tuple(announced_by))
            begin += size
            announced_by.append(begin - 1)
        return None
    if issubclass(variation, base.Compound) and name in variation.cv_items_dict:
        read = _field(_variation(variation.cv_items_dict[name]), "")
        return None if read is None else _in_compound(read, _compound_walk(variation), name)
    return None


def _if_announced(read: tuple[Getter, float], announced_by: tuple[int, ...]) -> tuple[Getter, float]:
    get, unit = read
    if not announced_by:
        return read

    def get_there(data: bytes, at: int) -> int | None:
        return get(data, at) if all(data[at + i] & 1 for i in announced_by) else None

    return get_there, unit


def _in_compound(read: tuple[Getter, float], walk: Any, name: str) -> tuple[Getter, float]:
    get, unit = read

    def get_there(data: bytes, at: int) -> int | None:
        place = walk(data, at)[0].get(name)
        return None if place is None else get(data, place)

    return get_there, unit


# --- records ---------------------------------------------------------------------------------------------------------

Places = list[int]  # where each wanted item of a record begins, -1 where it has none


class Edition:
    """One edition of a category: walks the records of its data blocks and reads the wanted fields.

    `fields` names each wanted number by item and field (`040/RHO`, or `140` of a single one); one that the edition does
    not have is missing in every record.
    """

    def __init__(self, name: str, definition: Any, fields: Mapping[str, str]) -> None:
        base, _ = library()
        self.name = name
        self.values: dict[str, Value] = {}
        record = definition.cv_record
        self._most = record.cv_fspec_max_bytes
        for short, written in fields.items():
            item, _, field = written.partition("/")
            known = record.cv_items_dict.get(item)
            found = None if known is None else _field(_variation(known), field)
            if found is not None:
                self.values[short] = Value(item, *found)
        self.items = tuple(dict.fromkeys(v.item for v in self.values.values()))
        slots = {item: i for i, item in enumerate(self.items)}
        self._getters = [(slots[value.item], value.get) for value in self.values.values()]
        self._steps: list[tuple[int, Length] | None] = []
        for entry in record.cv_items_list:
            if issubclass(entry, base.UapItem):
                item = entry.cv_non_spare
                self._steps.append((slots.get(item.cv_name, -1), _length(_variation(item))))
            else:
                self._steps.append(None)
        self._plans: dict[bytes, tuple[tuple[int, Length], ...]] = {}

    def _plan(self, spec: bytes) -> tuple[tuple[int, Length], ...]:
        steps = [self._steps[i] if i < len(self._steps) else None for i in _chosen(spec)]
        if None in steps or not steps:
            raise Malformed
        plan = tuple(step for step in steps if step is not None)
        if len(self._plans) < 4096:
            self._plans[spec] = plan
        return plan

    def records(self, block: bytes) -> list[Places]:
        """Where the wanted items of each record of a whole data block begin. Raises Malformed."""
        found: list[Places] = []
        at, end = HEADER_BYTES, len(block)
        plans, most, none = self._plans, self._most, [-1] * len(self.items)
        try:
            while at < end:
                spec = _fspec(block, at, most)
                at += len(spec)
                places = none.copy()
                for slot, size in plans.get(spec) or self._plan(spec):
                    if slot >= 0:
                        places[slot] = at
                    at += size if size.__class__ is int else size(block, at)  # type: ignore[operator]
                found.append(places)
        except IndexError:
            raise Malformed from None
        if at != end or not found:
            raise Malformed
        return found

    def raw(self, block: bytes, places: Places) -> list[int | None]:
        """The raw number of each of `values` in a record, None where missing. Raises Malformed."""
        try:
            return [None if places[slot] < 0 else get(block, places[slot]) for slot, get in self._getters]
        except IndexError:
            raise Malformed from None
