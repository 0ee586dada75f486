"""The fields of a binary log of fixed records, as `trial.toml` lists them: a name and a type each, in their order."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rangeeval.errors import SettingsError, did_you_mean, one_line

# Plain numbers as NumPy spells them: a letter and how many bytes. A byte order may stand before each.
_NUMBERS = ("f2", "f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "b1")
_ALIASES = {
    "float16": "f2", "float32": "f4", "float64": "f8", "int8": "i1", "int16": "i2", "int32": "i4", "int64": "i8",
    "uint8": "u1", "uint16": "u2", "uint32": "u4", "uint64": "u8", "bool": "b1",
    "half": "f2", "single": "f4", "float": "f8", "double": "f8",
    "e": "f2", "f": "f4", "d": "f8", "b": "i1", "h": "i2", "i": "i4", "q": "i8",
    "B": "u1", "H": "u2", "I": "u4", "Q": "u8", "?": "b1",
}  # fmt: skip
_SIZED = re.compile(r"[|<>=]?([SV])([1-9][0-9]{0,4})")
_KNOWN = [*(order + name for order in ("", "<", ">") for name in _NUMBERS), *_ALIASES, "S8"]


@dataclass(frozen=True)
class RecordField:
    """One field of a record: its name (from `_` on: bytes that are passed over) and its NumPy type.

    A type is a number (`<f8`, `>i2`, `uint16`; little-endian where no byte order is given), or text of so many bytes
    (`S8`).
    """

    name: str
    dtype: str

    @property
    def padding(self) -> bool:
        """Whether the field's bytes are passed over."""
        return self.name.startswith("_")

    @property
    def numpy(self) -> str:
        """The type in the one spelling that means the same on every machine: with its byte order."""
        name = self.dtype.strip()
        if sized := _SIZED.fullmatch(name):
            return f"{sized[1]}{sized[2]}"
        order, short = (name[0], name[1:]) if name[:1] in {"<", ">", "|", "="} else ("<", name)
        return f"{'>' if order == '>' else '<'}{_ALIASES.get(short, short)}"

    @property
    def bytes(self) -> int:
        """How many bytes of the record it takes."""
        return int(self.numpy.lstrip("<>")[1:])


def record_fields(value: Any, where: str) -> tuple[RecordField, ...]:
    """The fields out of TOML, in their order.

    They are `[{ time_s = "<f8" }, ...]`, or a table, `["time_s = <f8", ...]`, or tables with the keys name and dtype.
    Raises SettingsError for another form, a type that is none, and a name given twice.
    """
    if isinstance(value, dict):
        value = [value]
    if not isinstance(value, list):
        raise SettingsError(f'{where}: is {one_line(repr(value), 40)}, expected a list such as [{{ time_s = "<f8" }}]')
    fields = [field for i, item in enumerate(value) for field in _fields(item, f"{where}[{i}]")]
    seen: set[str] = set()
    for field in fields:
        _check(field, where)
        if not field.padding and field.name.casefold() in seen:
            raise SettingsError(f"{where}: names '{one_line(field.name, 60)}' twice")
        seen.add(field.name.casefold())
    if fields and all(field.padding for field in fields):
        raise SettingsError(f"{where}: names only bytes to pass over (names that begin with '_'), no field to read")
    return tuple(fields)


def _fields(item: Any, where: str) -> Sequence[RecordField]:
    if isinstance(item, str) and item.count("=") == 1:
        name, dtype = item.split("=")
        return [RecordField(name.strip(), dtype.strip().strip("\"'"))]
    if isinstance(item, dict) and all(isinstance(dtype, str) for dtype in item.values()):
        if item.keys() == {"name", "dtype"}:
            return [RecordField(item["name"], item["dtype"])]
        return [RecordField(name, dtype) for name, dtype in item.items()]
    raise SettingsError(f'{where}: is {one_line(repr(item), 40)}, expected a name and its type: {{ time_s = "<f8" }}')


def _check(field: RecordField, where: str) -> None:
    shown = f"{where}: {one_line(field.name, 60)} is '{one_line(field.dtype, 40)}'"
    if not field.name.strip():
        raise SettingsError(f"{where}: a field of type '{one_line(field.dtype, 40)}' has no name")
    if sized := _SIZED.fullmatch(field.dtype.strip()):
        if sized[1] == "V" and not field.padding:
            raise SettingsError(f"{shown}, bytes without a meaning; begin the name with '_' to pass over them")
        return
    if field.numpy[1:] not in _NUMBERS:
        near = did_you_mean(field.dtype, _KNOWN)
        near = near if near.startswith("did") else "known: numbers such as <f8, >i2, uint16, and text such as S8"
        raise SettingsError(f"{shown}, not the type of one number or of a text; {near}")
