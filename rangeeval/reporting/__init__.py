"""Blocks of text and numbers placed on a page: one self-contained HTML file and one PDF."""

from rangeeval.reporting.blocks import (
    Block,
    Cell,
    Document,
    Figure,
    Mark,
    Notice,
    Panel,
    Paragraph,
    Section,
    Table,
)
from rangeeval.reporting.render import Rendered, render, render_html, render_pdf

__all__ = [
    "Block",
    "Cell",
    "Document",
    "Figure",
    "Mark",
    "Notice",
    "Panel",
    "Paragraph",
    "Rendered",
    "Section",
    "Table",
    "render",
    "render_html",
    "render_pdf",
]
