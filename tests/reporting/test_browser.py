"""The page in a real browser: it draws, it is quiet, it asks for nothing, and it prints. Needs a Chromium."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import rangeeval
from rangeeval.reporting import Document, render_html
from rangeeval.scenarios import simulate_alpha_beta
from tests.reporting.browser import Browser, browser, find_browser
from tests.reporting.demo import demo
from tests.reporting.hostile import STRINGS, hostile_document

PROGRAM = find_browser()
pytestmark = pytest.mark.skipif(PROGRAM is None, reason="no Chromium or Chrome on this machine")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """One browser for all tests, its first start behind it."""
    assert PROGRAM is not None
    with browser(PROGRAM, tmp_path_factory.mktemp("profile")) as started:
        started.size(1400)
        yield started


def _write(folder: Path, document: Document) -> Path:
    file = folder / "report.html"
    file.write_text(render_html(document), encoding="utf-8")
    return file


def _inked(page: Browser) -> list[bool]:
    """For each panel, whether its canvas holds any ink; bokeh draws inside shadow trees."""
    return list(
        page.evaluate("""(() => {
          const canvases = (root) => [...root.querySelectorAll("*")].flatMap((e) =>
            (e.tagName === "CANVAS" ? [e] : []).concat(e.shadowRoot ? canvases(e.shadowRoot) : []));
          const panels = [...document.querySelectorAll("[data-panel]")];
          return panels.map((panel) => canvases(panel).some((canvas) => {
            if (!canvas.width || !canvas.height) return false;
            const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
            return data.some((value) => value !== 0);
          }));
        })()""")
    )


def test_thirty_plots_of_ten_thousand_points(page: Browser, tmp_path: Path) -> None:
    """The first is drawn before the last is asked for; then all of them hold ink; no word on the console, no request."""
    page.open(_write(tmp_path, demo(bins=0, overviews=1, clouds=30)))
    assert page.wait("document.documentElement.dataset.firstPlot")
    drawn = page.evaluate(
        """[...document.querySelectorAll("[data-plot]")].map((figure) => "drawn" in figure.dataset)"""
    )
    assert drawn[0]
    assert not drawn[-1]
    page.scroll_through()
    inked = _inked(page)
    assert len(inked) >= 31
    assert all(inked)
    assert page.complaints() == []
    assert page.requests() == []


def test_a_real_report_comes_alive(page: Browser, tmp_path: Path) -> None:
    """The report on a simulated trial: every panel drawn, not a word on the console, no request."""
    simulate_alpha_beta(tmp_path / "trial", seed=1, flights=1)
    rangeeval.report(rangeeval.open_trial(tmp_path / "trial"), tmp_path / "out")
    page.open(tmp_path / "out" / "report.html")
    assert page.wait("document.documentElement.dataset.firstPlot")
    page.scroll_through()
    assert all(_inked(page))
    assert page.complaints() == []
    assert page.requests() == []


def test_a_page_of_a_range_bin_zooms_together_and_resets(page: Browser, tmp_path: Path) -> None:
    """Dragging a box over one panel changes it and the panels that share its axis; Reset brings all back."""
    page.open(_write(tmp_path, demo(bins=1, overviews=1, clouds=0)))
    page.scroll_through()
    page.evaluate("document.querySelector('figure.compact').scrollIntoView()")
    time.sleep(0.3)
    read = (
        "JSON.stringify(Object.values(Bokeh.index.roots ?? Bokeh.index)"
        ".map(v => v.model).filter(m => m.id.startsWith('f2-')).map(m => [m.x_range.start, m.x_range.end]))"
    )
    before = page.evaluate(read)
    box = page.evaluate(
        "(() => { const b = document.getElementById('f2-p1').getBoundingClientRect(); return [b.x, b.y]; })()"
    )
    x, y = box[0] + 100, box[1] + 60
    for kind, dx, dy in (
        ("mousePressed", 0, 0),
        ("mouseMoved", 60, 40),
        ("mouseMoved", 80, 60),
        ("mouseReleased", 80, 60),
    ):
        page.call("Input.dispatchMouseEvent", type=kind, x=x + dx, y=y + dy, button="left", buttons=1, clickCount=1)
    time.sleep(0.3)
    after = page.evaluate(read)
    assert after != before
    page.evaluate("document.querySelector('figure.compact [data-tool=reset]').click()")
    time.sleep(0.3)
    assert page.evaluate(read) == before
    for name in ("pan", "wheel", "box"):
        page.evaluate(f"document.querySelector('figure.compact [data-tool={name}]').click()")
    assert page.complaints() == []


@pytest.mark.parametrize("number", range(len(STRINGS)))
def test_markup_in_any_text_is_inert(page: Browser, tmp_path: Path, number: int) -> None:
    """Nothing a log says runs, asks for anything, or stops a plot."""
    page.open(_write(tmp_path, hostile_document(STRINGS[number])))
    page.scroll_through()
    assert page.evaluate("document.documentElement.dataset.pwned") is None
    assert page.evaluate("document.querySelectorAll('figure.live').length") == 1
    page.evaluate("document.querySelector('figure').scrollIntoView({block: 'center'})")
    box = page.evaluate(
        "(() => { const b = document.querySelector('[data-panel]').getBoundingClientRect();"
        " return [b.x, b.y, b.width, b.height]; })()"
    )
    for across in (0.3, 0.5, 0.52):
        page.call("Input.dispatchMouseEvent", type="mouseMoved", x=box[0] + across * box[2], y=box[1] + 0.5 * box[3])
    assert page.complaints() == []
    assert page.requests() == []


@pytest.mark.parametrize("width", [1400, 800, 390])
def test_nothing_is_wider_than_the_window(page: Browser, tmp_path: Path, width: int) -> None:
    """The page never scrolls sideways; wide tables scroll in their own frame."""
    try:
        page.size(width)
        page.open(_write(tmp_path, demo(bins=1, overviews=2, clouds=0)))
        page.scroll_through()
        assert page.evaluate("document.documentElement.scrollWidth") <= width
    finally:
        page.size(1400)


def test_it_prints(page: Browser, tmp_path: Path) -> None:
    """Printing after some plots are live gives a PDF with the still pictures in their place."""
    page.open(_write(tmp_path, demo(bins=2, overviews=2, clouds=0)))
    page.wait("document.documentElement.dataset.firstPlot")
    printed = page.pdf()
    assert printed.startswith(b"%PDF")
    page.call("Emulation.setEmulatedMedia", media="print")
    try:
        shown = page.evaluate(
            "[...document.querySelectorAll('figure')].every((f) =>"
            " getComputedStyle(f.querySelector('img')).display === 'block'"
            " && getComputedStyle(f.querySelector('.plot')).display === 'none')"
        )
    finally:
        page.call("Emulation.setEmulatedMedia", media="")
    assert shown


def test_without_script_the_still_pictures_show(page: Browser, tmp_path: Path) -> None:
    """A reader whose browser runs no scripts sees every figure."""
    page.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        page.open(_write(tmp_path, demo(bins=1, overviews=1, clouds=0)))
        assert page.evaluate(
            "[...document.querySelectorAll('figure img')].every((i) => getComputedStyle(i).display === 'block')"
        )
        assert page.evaluate("document.querySelectorAll('figure.live').length") == 0
    finally:
        page.call("Emulation.setScriptExecutionDisabled", value=False)
