"""What a name holds is shown, never acted on."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rangeeval.reporting.fonts import Glyphs, font_files
from rangeeval.reporting.text import BREAK, breakable, neutral, printable


@pytest.mark.parametrize(
    ("given_text", "shown"),
    [
        ("plain", "plain"),
        ("a\nb\tc\r\nd", "a b c  d"),
        ("\x1b[31m", "[U+001B][31m"),
        ("\u202eevil", "[U+202E]evil"),
        ("\ud800", "[U+D800]"),
        ("e\u0301", "é"),
        ("\u1112\u1161\u11ab", "한"),
        ("👩\u200d🚀", "👩\u200d🚀"),
        ("\uffff", "[U+FFFF]"),
    ],
)
def test_neutral(given_text: str, shown: str) -> None:
    """Controls, overrides and surrogates become code points; everything that only shows stays."""
    assert neutral(given_text) == shown


def test_without_the_korean_typeface_code_points_are_printed() -> None:
    """A character without a glyph is still told, and remembered."""
    glyphs = Glyphs([path for path in font_files() if "DejaVu" in path.name])
    assert printable("range 거리", glyphs) == "range [U+AC70][U+B9AC]"
    assert glyphs.missing == {0xAC70, 0xB9AC}


@given(st.text(st.characters(), max_size=60))
def test_printable_text_is_inert_and_has_glyphs(text: str) -> None:
    """Whatever comes in, what goes out can be encoded, has glyphs and does nothing."""
    glyphs = Glyphs()
    shown = printable(text, glyphs)
    shown.encode()
    assert all(ord(c) in glyphs for c in shown if not c.isascii())
    assert shown.isprintable() or "\u00ad" in shown or "\u200c" in shown or any(c.isspace() for c in shown)
    assert neutral(neutral(text)) == neutral(text)


def test_long_words_get_places_to_break() -> None:
    """No run of more than eight characters without one, and nothing else changes."""
    word = "x" * 500
    assert max(map(len, breakable(word).split(BREAK))) == 8
    assert breakable(word).replace(BREAK, "") == word
    assert breakable("short words only, many of them, in a row") == "short words only, many of them, in a row"
