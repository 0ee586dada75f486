"""Where the page templates are, and what all renderers share of one document: its pictures, drawn once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rangeeval.reporting.blocks import Document, Figure
from rangeeval.reporting.fonts import Glyphs
from rangeeval.reporting.svg import render_svg

LEVEL_WORD = {"info": "Note", "good": "Good", "caution": "Caution", "bad": "Problem"}
VERDICT_WORD = {
    "pass": "✓ pass", "fail": "✗ fail", "inconclusive": "? inconclusive", "info": "i note",
    "better": "✓ better", "worse": "✗ worse", "equivalent": "= equivalent",
}  # fmt: skip


def template_folder() -> Path:
    """The folder of page templates: inside an installed package, or at the root of a checkout."""
    package = Path(__file__).resolve().parents[1]
    shipped = package / "templates"
    return shipped if shipped.is_dir() else package.parent / "templates"


@dataclass(frozen=True)
class Drawn:
    """A document with the SVG of each of its figures, in order, and the glyphs that were at hand."""

    document: Document
    pictures: tuple[str, ...]
    glyphs: Glyphs


def figures(document: Document) -> list[Figure]:
    """Every figure of a document, in order."""
    return [block for section in document.sections for block in section.blocks if isinstance(block, Figure)]


def draw(document: Document) -> Drawn:
    """Draw every figure once."""
    glyphs = Glyphs()
    return Drawn(document, tuple(render_svg(figure, glyphs) for figure in figures(document)), glyphs)
