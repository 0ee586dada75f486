"""The typefaces a page is set in, found inside installed packages so that every machine prints the same.

matplotlib carries DejaVu Sans; the extra `korean` brings NanumGothic. Only their files are used.
"""

from __future__ import annotations

import functools
import importlib.util
from pathlib import Path

_DEJAVU = ("DejaVuSans.ttf", "DejaVuSans-Bold.ttf")
_NANUM = ("NanumGothic.ttf", "NanumGothicBold.ttf")


def _package_folder(package: str) -> Path | None:
    found = importlib.util.find_spec(package)  # locates it without running it
    return Path(found.origin).parent if found is not None and found.origin else None


def _existing(folder: Path | None, names: tuple[str, ...]) -> list[Path]:
    return [] if folder is None else [folder / name for name in names if (folder / name).is_file()]


def font_files() -> list[Path]:
    """Every typeface file at hand, the Latin ones first."""
    matplotlib = _package_folder("matplotlib")
    latin = matplotlib / "mpl-data" / "fonts" / "ttf" if matplotlib else None
    korean = _package_folder("koreanize_matplotlib")
    return _existing(latin, _DEJAVU) + _existing(korean / "fonts" if korean else None, _NANUM)


@functools.cache
def _glyphs_of(path: Path) -> dict[int, float]:
    """Advance width in em of each code point a file has a glyph for."""
    from fontTools.ttLib import TTFont

    with TTFont(path, lazy=True) as font:
        em, advance = font["head"].unitsPerEm, font["hmtx"].metrics
        return {code: advance[name][0] / em for code, name in font.getBestCmap().items()}


@functools.cache
def _widths(family: tuple[Path, ...]) -> dict[int, float]:
    """Advance widths of the first file of a family, where every file of it has the glyph."""
    regular, *others = (_glyphs_of(path) for path in family)
    return {code: width for code, width in regular.items() if all(code in other for other in others)}


class Glyphs:
    """What a page can print, and how wide; a family of files is opened when those before it lack a glyph."""

    def __init__(self, files: list[Path] | None = None) -> None:
        every = font_files() if files is None else files
        families = (tuple(path for path in every if path.name in names) for names in (_DEJAVU, _NANUM))
        self._families = [family for family in families if family]
        self.missing: set[int] = set()

    def __contains__(self, code: object) -> bool:
        if any(code in _widths(family) for family in self._families):
            return True
        if isinstance(code, int):
            self.missing.add(code)
        return False

    def width(self, text: str) -> float:
        """Width of a line of text, in em."""
        return sum(self._advance(ord(character)) for character in text)

    def _advance(self, code: int) -> float:
        for family in self._families:
            if (width := _widths(family).get(code)) is not None:
                return width
        return 0.6
