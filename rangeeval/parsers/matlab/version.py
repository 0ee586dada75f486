"""Which version of MATLAB file these first bytes begin."""

from __future__ import annotations

import re
import struct

HEADER_BYTES = 520
_HDF5 = b"\x89HDF\r\n\x1a\n"
_ORDERS = {b"IM": "<", b"MI": ">"}
_NAME = re.compile(rb"[A-Za-z][A-Za-z0-9_]{0,62}\0")


def version(head: bytes) -> str | None:
    """`7.3`, `5` (which -v6 and -v7 write), `4`, or None."""
    if head.startswith(b"MATLAB 7.3") or (head.startswith(b"MATLAB") and head[512:520] == _HDF5):
        return "7.3"
    if head.startswith(b"MATLAB 5.0") or (head[126:128] in _ORDERS and b"\0" not in head[:4] and 1 in head[124:126]):
        return "5"
    return "4" if _is_4(head) else None


def known_order(head: bytes) -> bool:
    """Whether the header of version 5 ends in a mark of the byte order, and the number of the version."""
    order = _ORDERS.get(head[126:128])
    return order is not None and struct.unpack(f"{order}H", head[124:126])[0] >> 8 == 1


def _is_4(head: bytes) -> bool:
    """Version 4 has no signature: five whole numbers that fit each other, then the name of the first variable."""
    if len(head) < 22:
        return False
    for order, machine in (("<", 0), (">", 1)):
        kind, rows, columns, imaginary, length = struct.unpack(f"{order}5i", head[:20])
        thousands, rest = divmod(kind, 1000)
        hundreds, rest = divmod(rest, 100)
        name = _NAME.match(head, 20)
        if (
            thousands == machine and hundreds == 0 and rest // 10 <= 5 and rest % 10 <= 2 and rows >= 0 and columns >= 0
            and imaginary in (0, 1) and name is not None and name.end() == 20 + length
        ):  # fmt: skip
            return True
    return False
