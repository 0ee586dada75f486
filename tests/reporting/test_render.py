"""Blocks go in; one HTML file and one PDF come out, whatever the blocks say."""

from __future__ import annotations

import base64
import datetime
import html.parser
import io
import itertools
import json
import re
import xml.etree.ElementTree as ET
from typing import Any

import matplotlib.image
import numpy as np
import pytest

from rangeeval.reporting import (
    Cell,
    Document,
    Figure,
    Mark,
    Notice,
    Panel,
    Paragraph,
    Section,
    Table,
    fonts,
    pdf,
    render,
    render_html,
    render_pdf,
    style,
)
from rangeeval.reporting.blocks import outline
from rangeeval.reporting.fonts import Glyphs
from rangeeval.reporting.pages import draw
from rangeeval.reporting.plots import plot_document
from rangeeval.reporting.svg import render_svg
from tests.reporting.demo import demo
from tests.reporting.hostile import STRINGS, hostile_document

DATE = datetime.datetime(2026, 1, 2, tzinfo=datetime.UTC)
X = np.arange(5.0)
MARKS = {
    "points": Mark("points", X, X, label="p"),
    "many points": Mark("points", np.arange(500.0), np.arange(500.0) % 7, label="p"),
    "dense points": Mark("points", np.arange(9000.0), np.sin(np.arange(9000.0)), label="p"),
    "line": Mark("line", X, [1, np.nan, 2, 3, 4], label="l", role="predicted"),
    "step": Mark("step", X, X, label="s", role="reference"),
    "bars": Mark("bars", np.arange(6.0), [3, 0, 2, np.nan, 1], label="b"),
    "stems": Mark("stems", X, [1, -1, 0.5, 0, np.nan], label="t"),
    "band": Mark("band", X, low=X - 1, high=X + 1, label="band", role="group3"),
    "errorbars": Mark("errorbars", X, X, X - 0.5, [1, 2, 3, np.inf, 5], label="e", role="group12"),
    "heat": Mark("heat", X, (-1.0, 0.0, 1.0), z=[[0, 1, 2, 3], [4, np.nan, 6, 7]], label="h"),
    "rules": Mark("rule", x=(1.0, 2.0), y=(3.0, np.nan), label="r", role="limit"),
    "empty": Mark("points", (), (), label="none"),
    "one point": Mark("points", (3.0,), (0.0,), label="one"),
    "huge": Mark("line", (0.0, 1e308, -1e308), (1e-308, 1e308, 0.0), label="huge"),
    "nothing finite": Mark("line", (np.nan, np.inf), (np.nan, 1.0), label="nan"),
    "text": Mark("text", X[:3], X[:3], texts=["0°", "<b>", "$x$"]),
    "told points": Mark("points", X[:2], X[:2], texts=["one", "two"], label="told"),
    "late": Mark("points", 1.7e9 + np.arange(100.0), np.arange(100.0), label="late"),
}


class _Page(html.parser.HTMLParser):
    """What a browser would find: elements, attributes, text outside scripts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.words: list[str] = []
        self.inert = ""
        self._inside = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(tag, name, value or "") for name, value in attrs]
        self._inside = "json" if ("type", "application/json") in attrs else tag

    def handle_endtag(self, tag: str) -> None:
        self._inside = ""

    def handle_data(self, data: str) -> None:
        if self._inside == "json":
            self.inert += data
        elif self._inside not in ("script", "style"):
            self.words.append(data)


def _figure(mark: Mark, **options: Any) -> Figure:
    return Figure("caption", "alt", ((Panel("title", "x", "y", (mark,), **options),),))


def _document(*blocks: Any) -> Document:
    return Document("Title", DATE, handling="UNCLASSIFIED", sections=(Section("Section", blocks),))


@pytest.mark.parametrize("log", [False, True])
@pytest.mark.parametrize("name", MARKS)
def test_every_kind_of_mark_is_drawn_in_both(name: str, log: bool) -> None:
    """Each kind gives a well-formed picture and a bokeh document, on linear and logarithmic axes."""
    figure = _figure(MARKS[name], x_log=log, y_log=log)
    picture = ET.fromstring(render_svg(figure, Glyphs()))
    numbers = [element.get(name, "") for element in picture.iter() for name in ("d", "x", "y", "width", "height")]
    assert not [text for text in numbers if "nan" in text or "inf" in text]
    json.dumps(plot_document(figure, "f1", "3"), allow_nan=False)


def test_every_kind_of_block_is_placed_in_both() -> None:
    """Their texts are all in the HTML, and the PDF is one."""
    document = _document(
        Paragraph("a paragraph"),
        Notice("a notice", "caution"),
        Table(
            "a table",
            ("head", "number"),
            (("row", Cell("1.5", "inconclusive")), (Cell("two", strong=True), "2")),
        ),
        *(_figure(mark) for mark in MARKS.values()),
    )
    rendered = render(document)
    words = " ".join(_Page(rendered.html).words)
    for text in (
        "a paragraph",
        "a notice",
        "Caution",
        "a table",
        "head",
        "1.5",
        "? inconclusive",
        "UNCLASSIFIED",
    ):
        assert text in words
    assert rendered.pdf.startswith(b"%PDF-1.7")
    assert b"pdfuaid:part" in rendered.pdf or b"pdfaid" in rendered.pdf


def test_empty_blocks_render() -> None:
    """A table without rows or columns and a figure without panels or marks are still placed."""
    rendered = render(
        _document(
            Table("", ("a", "b"), ()),
            Table("no columns", (), ()),
            Figure("", "", ()),
            Figure("", "", ((None,),)),
            Figure("", "", ((Panel(),),)),
            Paragraph(""),
            Notice(""),
        )
    )
    assert rendered.pdf.startswith(b"%PDF")
    assert "<figure" in rendered.html


def test_blocks_refuse_what_cannot_be_placed() -> None:
    """Series or rows of unequal length are an error where they are made, in words."""
    with pytest.raises(ValueError, match="differ in length"):
        Mark("line", (1.0, 2.0), (1.0,))
    with pytest.raises(ValueError, match="2 rows of"):
        Mark("heat", (0.0, 1.0), (0.0, 1.0), z=((1.0,), (2.0,)))
    with pytest.raises(ValueError, match="row 0 has 1 cells, not 2"):
        Table("t", ("a", "b"), (("x",),))
    with pytest.raises(ValueError, match="language"):
        Document("t", DATE, language='en" onload=')


def test_an_empty_document_renders() -> None:
    """No section, no meta, no banner: still a page and a PDF."""
    rendered = render(Document("", DATE))
    assert "<main" in rendered.html
    assert rendered.pdf.startswith(b"%PDF")


def test_the_same_document_gives_the_same_bytes() -> None:
    """Nothing depends on the clock, on memory addresses or on chance."""
    first, second = (render(demo(bins=2, overviews=3)) for _ in range(2))
    assert first == second


def test_the_page_fetches_nothing() -> None:
    """Addresses lead into the page itself or hold their data; the policy forbids the rest."""
    page = _Page(render_html(demo(bins=1, overviews=2)))
    addresses = [value for _, name, value in page.attributes if name in ("src", "href", "srcset", "action", "data")]
    assert addresses
    assert all(value.startswith(("#", "data:image/", "data:,")) for value in addresses)
    policy = next(value for _, name, value in page.attributes if name == "content" and "default-src" in value)
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe" not in policy.split("style-src")[0]
    assert not [name for _, name, _ in page.attributes if name.startswith("on") or name == "style"]


def test_headings_come_in_order_and_every_target_exists() -> None:
    """No level is skipped, and each address of the contents is somewhere on the page once."""
    page = _Page(render_html(demo(bins=2, overviews=1)))
    levels = [int(tag[1]) for tag in page.tags if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels))
    ids = [value for _, name, value in page.attributes if name == "id"]
    assert len(ids) == len(set(ids))
    assert {value[1:] for _, name, value in page.attributes if name == "href" and value.startswith("#")} <= set(ids)


def test_a_skipped_level_and_a_repeated_key_are_mended() -> None:
    """Screen readers and addresses need order, whatever the sections say."""
    sections = (Section("a", level=3, key="k"), Section("b", level=3, key="k"), Section("c", key="<x> y"))
    placed = outline(Document("t", DATE, sections=sections))
    assert [(level, key) for _, level, key in placed] == [(1, "k"), (2, "k-2"), (1, "x--y")]


@pytest.mark.parametrize("text", STRINGS)
def test_text_never_becomes_markup(text: str) -> None:
    """A hostile text leaves the elements and attributes of the page as those of a harmless one."""
    harmless = _Page(render_html(hostile_document("harmless" if text else "")))
    page = _Page(render_html(hostile_document(text)))
    assert page.tags == harmless.tags
    names = [(tag, name) for tag, name, _ in page.attributes]
    assert names == [(tag, name) for tag, name, _ in harmless.attributes]
    json.loads(page.inert)
    for _, name, value in page.attributes:
        if name == "src":
            ET.fromstring(base64.b64decode(value.removeprefix("data:image/svg+xml;base64,")))


def test_hostile_text_prints() -> None:
    """All of it in one PDF, under the archive and accessibility standards."""
    sections = [section for text in STRINGS for section in hostile_document(text).sections]
    for text in STRINGS:
        document = hostile_document(text)
        document = Document(**{**vars(document), "sections": sections if text == STRINGS[0] else document.sections[1:]})
        assert render_pdf(document).startswith(b"%PDF")


def test_without_the_korean_typeface_the_pdf_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing fails; the characters are printed as code points, and a notice names the extra."""
    latin = [path for path in fonts.font_files() if "DejaVu" in path.name]
    monkeypatch.setattr(fonts, "font_files", lambda: latin)
    monkeypatch.setattr(pdf, "font_files", lambda: latin)
    drawn = draw(hostile_document("진입 시험"))
    assert "[U+C9C4]" in drawn.pictures[0]
    assert "rangeeval[korean]" in pdf._content(drawn)["missing"]
    assert pdf.write_pdf(drawn).startswith(b"%PDF")


def test_every_glyph_that_counts_as_printable_prints_bold_too() -> None:
    """The standards refuse a document with one missing glyph, so what is let through must be there."""
    codes = sorted(set().union(*(fonts._widths((path,)) for path in fonts.font_files())))
    text = "".join(map(chr, codes[::3]))
    title = Document(text[:3000], DATE, sections=(Section(text[3000:6000]), Section("s", (Paragraph(text),))))
    assert render_pdf(title).startswith(b"%PDF")


def _expanded(value: Any) -> Any:
    """Columns as the boot script makes them: plain lists."""
    if isinstance(value, dict) and "steps" in value:
        steps = np.frombuffer(base64.b64decode(value["steps"]), dtype="<u2").astype(float)
        return list(np.where(steps == 65535, 0.0, value["low"] + steps * (value["high"] - value["low"]) / 65534))
    if isinstance(value, dict) and "levels" in value:
        return np.frombuffer(base64.b64decode(value["levels"]), np.uint8).reshape(value["shape"]).tolist()
    if isinstance(value, dict):
        return {key: _expanded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_expanded(item) for item in value]
    return value


@pytest.mark.filterwarnings("ignore::bokeh.util.warnings.BokehUserWarning")
def test_bokeh_itself_reads_what_is_written() -> None:
    """Every model and property exists in the installed bokeh and takes the value given."""
    from bokeh.document import Document as BokehDocument

    panels = [
        Panel("t", "x", "y", (mark,), x_log=log, y_log=log, share_x="x")
        for mark in MARKS.values()
        for log in (False, True)
    ]
    panels.append(Panel("t", marks=(MARKS["text"], MARKS["told points"]), square=True))
    document = plot_document(Figure("c", "a", (panels,)), "f1", "3.0.0")
    written = {"version": "3.0.0", "config": None, "title": "", "roots": _expanded(document["doc"]["roots"])}
    read = BokehDocument.from_json(written)
    assert [root.id for root in read.roots] == document["roots"]
    assert {renderer.glyph.__class__.__name__ for root in read.roots for renderer in root.renderers} >= {
        "Scatter", "Line", "Step", "Quad", "Segment", "VArea", "Image",
    }  # fmt: skip
    first = read.roots[0]
    assert (first.x_range.start, first.title.text.text) == (
        document["doc"]["roots"][0]["attributes"]["x_range"]["attributes"]["start"],
        "t",
    )


def test_a_heat_mark_has_its_lowest_row_at_the_bottom_in_both() -> None:
    """Values become levels of one palette, missing ones transparent; it fills its panel."""
    figure = _figure(MARKS["heat"])
    picture = next(e for e in ET.fromstring(render_svg(figure, Glyphs())).iter() if e.tag.endswith("image"))
    png = base64.b64decode(picture.get("href", "").split(",")[1])
    shown = (matplotlib.image.imread(io.BytesIO(png), format="png") * 255).round().astype(int)
    colours = [[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in style.heat_colours()]
    levels = [[36, -1, 54, 63], [0, 9, 18, 27]]
    for row, wanted in zip(shown, levels, strict=True):
        for pixel, level in zip(row, wanted, strict=True):
            assert pixel[3] == (0 if level < 0 else 255)
            assert level < 0 or pixel[:3].tolist() == colours[level]
    (root,) = plot_document(figure, "f", "3")["doc"]["roots"]
    ((_, (image,)),) = root["attributes"]["renderers"][0]["attributes"]["data_source"]["attributes"]["data"]["entries"]
    cells = np.frombuffer(base64.b64decode(image["levels"]), np.uint8).reshape(image["shape"])
    assert cells.tolist() == [[0, 9, 18, 27], [36, 255, 54, 63]]
    ends = root["attributes"]["y_range"]["attributes"]
    assert (ends["start"], ends["end"]) == (-1, 1)


def test_sixteen_bit_columns_are_finer_than_a_pixel() -> None:
    """Long series come back within half a step of 1/65,534 of their span; short ones are exact; gaps stay."""
    rng = np.random.default_rng(1)
    x, y = 1.7e9 + np.sort(rng.uniform(0, 3600, 3000)), rng.normal(size=3000)
    y[7] = np.nan
    document = plot_document(_figure(Mark("line", x, y)), "f", "3")
    data = dict(
        document["doc"]["roots"][0]["attributes"]["renderers"][0]["attributes"]["data_source"]["attributes"]["data"][
            "entries"
        ]
    )
    assert np.abs(np.array(_expanded(data["x"])) - x).max() <= 3600 / 65534 * 0.51
    steps = np.frombuffer(base64.b64decode(data["y"]["steps"]), dtype="<u2")
    assert np.flatnonzero(steps == 65535).tolist() == [7]


def test_thirty_plots_of_ten_thousand_points_stay_small() -> None:
    """Under 4.5 MB with the drawing script and the still pictures."""
    assert len(render_html(demo(bins=0, overviews=1, clouds=30)).encode()) < 4.5e6


def test_shared_axes_and_labels_are_the_same_in_a_figure() -> None:
    """Panels that share x have one range, and one label has one place in the legend."""
    narrow = Panel("a", "x", "y", (Mark("line", (0.0, 1.0), (0.0, 1.0), label="same"),), share_x="time")
    wide = Panel("b", "x", "y", (Mark("line", (-5.0, 9.0), (0.0, 1.0), label="same"),), share_x="time")
    figure = Figure("c", "a", ((narrow, wide),))
    roots = plot_document(figure, "f", "3")["doc"]["roots"]
    assert roots[1]["attributes"]["x_range"] == {"id": roots[0]["attributes"]["x_range"]["id"]}
    assert render_svg(figure, Glyphs()).count(">same</text>") == 1
