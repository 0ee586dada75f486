"""A document as one HTML file: no network, two scripts of its own, a still picture under every plot.

The page's Content-Security-Policy allows scripts by their SHA-256 alone, so nothing a log holds can ever
run. Styles are allowed inline, because bokeh writes its own while drawing; no data goes into any of them.
"""

from __future__ import annotations

import base64
import hashlib
import importlib.metadata
import importlib.util
import json
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from rangeeval.reporting import style
from rangeeval.reporting.axes import legend
from rangeeval.reporting.blocks import Block, Cell, Figure, outline
from rangeeval.reporting.pages import LEVEL_WORD, VERDICT_WORD, Drawn, template_folder
from rangeeval.reporting.plots import plot_document
from rangeeval.reporting.text import neutral


def write_html(drawn: Drawn) -> str:
    """The HTML file of a drawn document; the same document gives the same text."""
    document, folder = drawn.document, template_folder()
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(folder),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=_shown,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    scripts = [_bokeh_script(), (folder / "boot.js").read_text(encoding="utf-8")]
    placed = _Placed(drawn)
    return environment.get_template("report.html.j2").render(
        document=document,
        sections=placed.sections,
        pictures=[_data_uri(picture) for picture in drawn.pictures],
        plots=_inert_json(placed.plots),
        css=Markup((folder / "report.css").read_text(encoding="utf-8") + _role_css()),
        scripts=[Markup(script) for script in scripts],
        hashes=[_script_hash(script) for script in scripts],
        look=style.look,
        heat=style.HEAT,
        level_word=LEVEL_WORD,
        verdict_word=VERDICT_WORD,
    )


def _shown(value: Any) -> Any:
    """Every text a template prints, made safe for the reader's eye; markup of our own passes as it is."""
    return neutral(value) if type(value) is str else value


class _Placed:
    """The sections of a document with their addresses, and the plot of each figure."""

    def __init__(self, drawn: Drawn) -> None:
        version = importlib.metadata.version("bokeh")
        self._tables = 0
        self.plots: dict[str, Any] = {}
        self.sections: list[dict[str, Any]] = []
        for section, level, key in outline(drawn.document):
            blocks = [self._block(block, version) for block in section.blocks]
            self.sections.append({"section": section, "level": level, "key": key, "blocks": blocks})

    def _block(self, block: Block, version: str) -> dict[str, Any]:
        kind = type(block).__name__.lower()
        if isinstance(block, Figure):
            number = len(self.plots) + 1
            name = f"f{number}"
            self.plots[name] = plot_document(block, name, version)
            cells = [
                panel is not None for row in block.panels for panel in [*row, *[None] * (block.columns - len(row))]
            ]
            return {
                "kind": kind,
                "block": block,
                "name": name,
                "number": number,
                "cells": cells,
                "legend": legend(block),
            }
        if kind == "table":
            rows = [[cell if isinstance(cell, Cell) else Cell(cell) for cell in row] for row in block.rows]  # type: ignore[union-attr]
            self._tables += 1
            return {"kind": kind, "block": block, "rows": rows, "number": self._tables}
        return {"kind": kind, "block": block}


def _bokeh_script() -> str:
    """The drawing script that the installed bokeh ships; its core bundle is all that plots need."""
    found = importlib.util.find_spec("bokeh")
    if found is None or found.origin is None:
        raise ModuleNotFoundError("bokeh is not installed")
    script = Path(found.origin).parent / "server" / "static" / "js" / "bokeh.min.js"
    text = script.read_text(encoding="utf-8").replace("\r\n", "\n")
    return text.replace("</script", "<\\/script").replace("<!--", "<\\!--")


def _script_hash(script: str) -> Markup:
    return Markup("'sha256-" + base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() + "'")


def _inert_json(value: Any) -> Markup:
    """JSON that no HTML parser can take for anything else."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)


def _data_uri(picture: str) -> Markup:
    return Markup("data:image/svg+xml;base64," + base64.b64encode(picture.encode()).decode())


def _role_css() -> str:
    """The colour of each role as a class, for the legends."""
    return "".join(f".role-{name}{{color:{style.look(name).colour}}}\n" for name in style.ROLES)
