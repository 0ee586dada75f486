"""A document as a PDF: one fixed typst template reads the blocks from JSON, so data never becomes mark-up."""

from __future__ import annotations

import datetime
import json
import shutil
import tempfile
from pathlib import Path
from typing import Any, Literal

from rangeeval.errors import RangeevalError
from rangeeval.reporting.blocks import Block, Cell, Figure, Notice, Paragraph, Table, outline
from rangeeval.reporting.fonts import Glyphs, font_files
from rangeeval.reporting.pages import LEVEL_WORD, VERDICT_WORD, Drawn, template_folder
from rangeeval.reporting.text import breakable, printable

STANDARDS: tuple[Literal["a-2a", "ua-1"], ...] = (
    "a-2a",
    "ua-1",
)  # archivable for decades, and readable by a screen reader


def write_pdf(drawn: Drawn) -> bytes:
    """Compile the PDF of a drawn document; the same document gives the same bytes.

    Raises
    ------
    RangeevalError : when the compiler refuses the document, with its own words.
    """
    import typst

    with tempfile.TemporaryDirectory(prefix="rangeeval-") as name:
        root = Path(name)
        shutil.copyfile(template_folder() / "report.typ", root / "report.typ")
        for number, picture in enumerate(drawn.pictures):
            (root / f"figure-{number}.svg").write_text(picture, encoding="utf-8")
        (root / "data.json").write_text(json.dumps(_content(drawn), allow_nan=False), encoding="utf-8")
        folder = root / "fonts"
        folder.mkdir()
        for path in font_files():
            shutil.copyfile(path, folder / path.name)
        try:
            compiled = typst.compile(
                str(root / "report.typ"),
                root=str(root),
                font_paths=[str(folder)],
                ignore_system_fonts=True,
                pdf_standards=[*STANDARDS],
                timestamp=_aware(drawn.document.date),
                format="pdf",
            )
        except typst.TypstError as error:
            raise RangeevalError(f"the PDF could not be made: {error.message}") from error
    return bytes(compiled)


def _aware(date: datetime.datetime) -> datetime.datetime:
    return date if date.tzinfo else date.replace(tzinfo=datetime.UTC)


class _Writer:
    """Blocks as the plain values the template reads, every text made printable."""

    def __init__(self, glyphs: Glyphs) -> None:
        self._glyphs = glyphs
        self._figures = 0

    def text(self, text: str) -> str:
        return breakable(printable(text, self._glyphs))

    def block(self, block: Block) -> dict[str, Any]:
        if isinstance(block, Paragraph):
            return {"kind": "paragraph", "text": self.text(block.text)}
        if isinstance(block, Notice):
            title = self.text(block.title) or LEVEL_WORD[block.level]
            return {"kind": "notice", "level": block.level, "title": title, "text": self.text(block.text)}
        if isinstance(block, Table):
            return self._table(block)
        return self._figure(block)

    def _table(self, table: Table) -> dict[str, Any]:
        return {
            "kind": "table",
            "caption": self.text(table.caption),
            "head": [self.text(text) for text in table.head],
            "align": list(table.alignment),
            "rows": [[self._cell(cell) for cell in row] for row in table.rows],
        }

    def _cell(self, cell: str | Cell) -> dict[str, Any]:
        given = cell if isinstance(cell, Cell) else Cell(cell)
        return {
            "text": self.text(given.text),
            "verdict": given.verdict,
            "word": VERDICT_WORD.get(given.verdict, ""),
            "strong": given.strong,
        }

    def _figure(self, figure: Figure) -> dict[str, Any]:
        self._figures += 1
        return {
            "kind": "figure",
            "file": f"figure-{self._figures - 1}.svg",
            "alt": self.text(figure.alt or figure.caption or "Figure"),
            "caption": self.text(figure.caption),
        }


def _content(drawn: Drawn) -> dict[str, Any]:
    document, writer = drawn.document, _Writer(drawn.glyphs)
    content: dict[str, Any] = {
        "title": writer.text(document.title) or "Report",
        "subtitle": writer.text(document.subtitle),
        "handling": writer.text(document.handling),
        "language": document.language,
        "date": document.date.strftime("%Y-%m-%d"),
        "meta": [[writer.text(name), writer.text(value)] for name, value in document.meta],
        "sections": [
            {
                "title": writer.text(section.title) or "Section",
                "level": level,
                "own_page": section.own_page,
                "blocks": [writer.block(block) for block in section.blocks],
            }
            for section, level, _ in outline(document)
        ],
    }
    content["missing"] = _missing_glyphs(drawn.glyphs)
    return content


def _missing_glyphs(glyphs: Glyphs) -> str:
    """What to install when a text could not be printed as it is written; empty when all of it could."""
    if not glyphs.missing:
        return ""
    words = (
        "Some characters have no glyph in the installed typefaces and are printed as [U+code]; "
        "the HTML report shows them."
    )
    if any(0x1100 <= code <= 0x11FF or 0x3130 <= code <= 0x318F or 0xAC00 <= code <= 0xD7FF for code in glyphs.missing):
        words += " For Korean: pip install 'rangeeval[korean]'."
    return words
