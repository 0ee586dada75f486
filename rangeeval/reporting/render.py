"""A document in, its HTML text and PDF bytes out; each figure is drawn once for both."""

from __future__ import annotations

from dataclasses import dataclass

from rangeeval.reporting.blocks import Document
from rangeeval.reporting.html import write_html
from rangeeval.reporting.pages import draw
from rangeeval.reporting.pdf import write_pdf


@dataclass(frozen=True)
class Rendered:
    """The two files of a report."""

    html: str
    pdf: bytes


def render(document: Document) -> Rendered:
    """Both files of a report."""
    drawn = draw(document)
    return Rendered(write_html(drawn), write_pdf(drawn))


def render_html(document: Document) -> str:
    """One HTML file that needs nothing beside it and asks nothing of a network."""
    return write_html(draw(document))


def render_pdf(document: Document) -> bytes:
    """One tagged PDF, to the standards PDF/A-2a and PDF/UA-1."""
    return write_pdf(draw(document))
