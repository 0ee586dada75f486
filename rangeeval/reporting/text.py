"""Text from logs made fit to print: whatever a name holds, the page stays a page and reads as written.

Characters that would steer the reader's eye or the file format (controls, bidirectional overrides, lone
surrogates, private use) are shown as their code point, `[U+202E]`, instead of acted on.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Container

_SPACES = str.maketrans(dict.fromkeys("\t\n\v\f\r\x1c\x1d\x1e\x1f\x85\u2028\u2029", " "))
_JOINERS = frozenset("\u200c\u200d\u00ad\ufe0e\ufe0f")  # they shape emoji and scripts, and steer nothing
_LONG_WORD = re.compile(r"\S{25,}")
BREAK = "\u200b"


def code_point(character: str) -> str:
    """The visible stand-in for a character that cannot be printed."""
    return f"[U+{ord(character):04X}]"


def _acts(character: str) -> bool:
    category = unicodedata.category(character)
    return category in ("Cc", "Cs", "Cn") or (category == "Cf" and character not in _JOINERS)


def neutral(text: str) -> str:
    """The same text in NFC, with the characters that act rather than show written as code points."""
    if text.isascii() and text.isprintable():
        return text
    plain = unicodedata.normalize("NFC", text.translate(_SPACES))
    return "".join(code_point(c) if _acts(c) else c for c in plain)


def printable(text: str, glyphs: Container[int]) -> str:
    """`neutral` text in which every character has a glyph; the others are written as code points.

    Joiners and variation selectors are dropped where no font has them: they show nothing by themselves.
    """
    plain = neutral(text)
    if plain.isascii():
        return plain
    return "".join(
        c if ord(c) in glyphs and unicodedata.category(c) != "Co" else "" if c in _JOINERS else code_point(c)
        for c in plain
    )


def breakable(text: str) -> str:
    """Long unbroken words with places to break, so that a line never runs off the paper."""
    if len(text) < 25:
        return text
    return _LONG_WORD.sub(lambda word: BREAK.join(_pieces(word.group())), text)


def _pieces(word: str, size: int = 8) -> list[str]:
    pieces, start = [], 0
    for end in range(1, len(word) + 1):
        combining = end < len(word) and unicodedata.combining(word[end])
        if end == len(word) or (end - start >= size and not combining):
            pieces.append(word[start:end])
            start = end
    return pieces
