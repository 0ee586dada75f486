"""A figure as one SVG picture: the static form, used by the PDF and under every plot of the HTML.

Written directly, since a report has hundreds of panels: eighteen figures of twelve panels take 5.2 s
through matplotlib and 0.2 s here, and the same numbers give the same bytes on every machine. Text stays
text: it can be searched, and what a log calls a series is only ever characters.
"""

from __future__ import annotations

import base64
import math
import struct
import zlib
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from rangeeval.reporting import style
from rangeeval.reporting.axes import (
    MISSING_LEVEL,
    Floats,
    Range,
    floats,
    heat_levels,
    legend,
    panels,
    ticks,
    views,
)
from rangeeval.reporting.blocks import Figure, Mark, Panel
from rangeeval.reporting.fonts import Glyphs
from rangeeval.reporting.text import printable
from rangeeval.stats.reduce import decimate, thin

DENSE = 3000  # points beyond which a cloud is drawn as pixels
_MARKED = 60  # points up to which each gets the marker of its role
_PIXELS_PER_POINT = 3.0
_SMALL, _LABEL, _TITLE = 6.4, 7.0, 7.6  # sizes of text, in points
_ABOVE, _BELOW = 14.0, 27.0  # room for a title over the frame, and for labels under it


class _Canvas:
    """SVG elements in drawing order, with text measured and made safe on the way in."""

    def __init__(self, glyphs: Glyphs) -> None:
        self.parts: list[str] = []
        self._glyphs = glyphs

    def width(self, text: str, size: float) -> float:
        return self._glyphs.width(text) * size

    def fitted(self, text: str, size: float, room: float) -> str:
        """Text as it can be printed, shortened with an ellipsis to the room there is."""
        shown = printable(text[:400], self._glyphs)
        if self.width(shown, size) <= room:
            return shown
        used, kept = self.width("…", size), []
        for character in shown:
            used += self.width(character, size)
            if used > room:
                break
            kept.append(character)
        return "".join(kept).rstrip() + "…"

    def text(
        self, x: float, y: float, text: str, size: float, anchor: str = "start", *,
        colour: str = style.INK, bold: bool = False, up: bool = False,
    ) -> None:  # fmt: skip
        """A line of text, already `fitted`."""
        turn = f' transform="rotate(-90 {x:.1f} {y:.1f})"' if up else ""
        weight = ' font-weight="700"' if bold else ""
        self.parts.append(
            f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" text-anchor="{anchor}" '
            f'fill="{colour}"{weight}{turn}>{escape(text)}</text>'
        )

    def path(self, d: str, attributes: str) -> None:
        """A path, unless there is nothing to draw."""
        if d:
            self.parts.append(f'<path d="{d}" {attributes}/>')


class _Axes:
    """The frame of one panel on the page, and the way from values to points."""

    def __init__(self, panel: Panel, view: tuple[Range, Range], box: tuple[float, float, float, float]) -> None:
        self.panel, self.view = panel, view
        self.left, self.top, self.right, self.bottom = box

    def x(self, values: Floats) -> Floats:
        return self.left + _share(values, self.view[0], self.panel.x_log) * (self.right - self.left)

    def y(self, values: Floats) -> Floats:
        return self.bottom - _share(values, self.view[1], self.panel.y_log) * (self.bottom - self.top)


def _share(values: Floats, view: Range, log: bool) -> Floats:
    low, high = view
    if log:
        low, high = math.log10(low), math.log10(high)
        values = np.log10(np.where(values > 0, values, np.nan))
    return np.clip((values - low) / (high - low), -50.0, 50.0)


def render_svg(figure: Figure, glyphs: Glyphs) -> str:
    """A figure as an SVG document as wide as the text of a page."""
    canvas = _Canvas(glyphs)
    total = style.TEXT_WIDTH_PT
    rows, columns = len(figure.panels), max(1, figure.columns)
    top = _draw_legend(canvas, legend(figure), total)
    height = style.ROW_HEIGHT_PT[figure.size]
    ranges = views(figure)
    gap = 9.0
    pitch = (total + gap) / columns
    widest = [0.0] * columns  # of the y tick labels in a column, so that its frames line up
    for row, column, panel in panels(figure):
        labels = [] if panel.square else _y_ticks(panel, ranges[row, column][1], height)[1]
        widest[column] = max([widest[column], *(canvas.width(label, _SMALL) for label in labels)])
    for number, (row, column, panel) in enumerate(panels(figure)):
        cell = (column * pitch, top + row * height, (column + 1) * pitch - gap, top + (row + 1) * height)
        _draw_panel(canvas, panel, ranges[row, column], cell, f"c{number}", widest[column])
    bottom = top + rows * height
    families = ", ".join((*style.FONT_FAMILIES, "Verdana", "sans-serif"))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {total:.0f} {bottom:.0f}" '
        f'width="{total:.0f}pt" height="{bottom:.0f}pt" font-family="{families}" fill="none">'
        + "".join(canvas.parts)
        + "</svg>"
    )


def _draw_legend(canvas: _Canvas, marks: list[Mark], room: float) -> float:
    """The legend in rows over the panels, where it covers no data; returns its height."""
    if not marks:
        return 2.0
    x, y, sample = 2.0, 8.0, 16.0
    for mark in marks:
        label = canvas.fitted(mark.label, _LABEL, room - sample - 10)
        width = sample + 4 + canvas.width(label, _LABEL)
        if x > 2.0 and x + width > room:
            x, y = 2.0, y + 11.0
        _draw_sample(canvas, mark, x, y - 2.4, sample)
        canvas.text(x + sample + 4, y, label, _LABEL)
        x += width + 14
    return y + 8.0


def _draw_sample(canvas: _Canvas, mark: Mark, x: float, y: float, width: float) -> None:
    seen = style.look(mark.role)
    middle = x + width / 2
    if mark.kind == "heat":
        for i, colour in enumerate(style.HEAT):
            step = width / len(style.HEAT)
            canvas.path(f"M{x + i * step:.1f} {y - 3:.1f}h{step:.1f}v6h-{step:.1f}z", f'fill="{colour}"')
        canvas.path(f"M{x:.1f} {y - 3:.1f}h{width}v6h-{width}z", f'stroke="{style.FRAME}" stroke-width="0.4"')
        return
    if mark.kind in ("bars", "band"):
        canvas.path(f"M{x:.1f} {y - 3:.1f}h{width}v6h-{width}z", _fill(seen, mark.kind))
        return
    if mark.kind in ("line", "step", "rule"):
        canvas.path(f"M{x:.1f} {y:.1f}h{width}", _stroke(seen))
        return
    if mark.kind == "errorbars":
        canvas.path(f"M{middle:.1f} {y - 4:.1f}v8", _stroke(seen, dashed=False))
    if mark.kind == "stems":
        canvas.path(f"M{middle:.1f} {y + 4:.1f}v-6", _stroke(seen, dashed=False))
    canvas.path(_markers(seen, [(middle, y)], 2.0), f'fill="{seen.colour}"')


def _draw_panel(
    canvas: _Canvas,
    panel: Panel,
    view: tuple[Range, Range],
    cell: tuple[float, float, float, float],
    clip: str,
    widest: float,
) -> None:
    left, top, right, bottom = cell
    plot_top, plot_bottom = top + _ABOVE, bottom - _BELOW
    y_ticks = _y_ticks(panel, view[1], bottom - top)
    plot_left = left + widest + (14.0 if panel.y_label else 4.0)
    plot_right = right - 2.0
    if panel.square:
        _draw_square(canvas, panel, view, (left, plot_top, plot_right, bottom), clip)
        return
    axes = _Axes(panel, view, (plot_left, plot_top, plot_right, plot_bottom))
    x_ticks = _fitting_ticks(canvas, view[0], plot_right - plot_left, panel.x_log)

    grid_y = _finite(axes.y(floats(y_ticks[0])))
    grid_x = _finite(axes.x(floats(x_ticks[0])))
    width, height = plot_right - plot_left, plot_bottom - plot_top
    canvas.path(
        "".join(f"M{plot_left:.1f} {y:.1f}h{width:.1f}" for y in grid_y)
        + "".join(f"M{x:.1f} {plot_top:.1f}v{height:.1f}" for x in grid_x),
        f'stroke="{style.GRID}" stroke-width="0.5"',
    )
    _draw_marks(canvas, axes, clip)
    canvas.path(
        f"M{plot_left:.1f} {plot_top:.1f}v{height:.1f}h{width:.1f}",
        f'stroke="{style.FRAME}" stroke-width="0.7"',
    )
    for y, label in zip(grid_y, y_ticks[1], strict=False):
        canvas.text(plot_left - 3, y + _SMALL * 0.36, label, _SMALL, "end", colour=style.MUTED)
    for x, label in zip(grid_x, x_ticks[1], strict=False):
        inside = min(
            x, right + 2.0 - canvas.width(label, _SMALL) / 2
        )  # a label at the frame's end stays on the picture
        canvas.text(inside, plot_bottom + 8.2, label, _SMALL, "middle", colour=style.MUTED)
    middle = (plot_left + plot_right) / 2
    if panel.title:
        room = right - plot_left - 2
        canvas.text(plot_left, plot_top - 5, canvas.fitted(panel.title, _TITLE, room), _TITLE, bold=True)
    if panel.x_label:
        text = canvas.fitted(_with_power(panel.x_label, x_ticks[2]), _LABEL, width + 12)
        canvas.text(middle, plot_bottom + 17.5, text, _LABEL, "middle")
    if panel.y_label:
        text = canvas.fitted(_with_power(panel.y_label, y_ticks[2]), _LABEL, height + 8)
        canvas.text(plot_left - widest - 7.4, (plot_top + plot_bottom) / 2, text, _LABEL, "middle", up=True)


def _draw_marks(canvas: _Canvas, axes: _Axes, clip: str) -> None:
    """The marks of a panel, cut off at its frame."""
    width, height = axes.right - axes.left, axes.bottom - axes.top
    canvas.parts.append(
        f'<clipPath id="{clip}"><path d="M{axes.left:.1f} {axes.top:.1f}'
        f'h{width:.1f}v{height:.1f}h-{width:.1f}z"/></clipPath><g clip-path="url(#{clip})">'
    )
    for mark in axes.panel.marks:
        _draw_mark(canvas, axes, mark)
    canvas.parts.append("</g>")


def _draw_square(
    canvas: _Canvas, panel: Panel, view: tuple[Range, Range], box: tuple[float, float, float, float], clip: str
) -> None:
    """A panel of one scale both ways: as large as fits, in the middle, under its title."""
    left, top, right, bottom = box
    half = 0.5 * min(right - left, bottom - top)
    x, y = 0.5 * (left + right), 0.5 * (top + bottom)
    _draw_marks(canvas, _Axes(panel, view, (x - half, y - half, x + half, y + half)), clip)
    if panel.title:
        canvas.text(left + 2, top - 5, canvas.fitted(panel.title, _TITLE, right - left - 4), _TITLE, bold=True)


def _y_ticks(panel: Panel, view: Range, height: float) -> tuple[list[float], list[str], str]:
    return ticks(view, int((height - _ABOVE - _BELOW) / 17), panel.y_log)


def _with_power(label: str, power: str) -> str:
    return f"{label} × {power}" if power else label


def _fitting_ticks(canvas: _Canvas, view: Range, width: float, log: bool) -> tuple[list[float], list[str], str]:
    """As many ticks as fit side by side with air between them."""
    for most in (8, 7, 6, 5, 4, 3, 2):
        found = ticks(view, most, log)
        needed = sum(canvas.width(label, _SMALL) + 7.0 for label in found[1])
        if needed <= width:
            break
    return found


def _finite(values: Floats) -> list[float]:
    return [value for value in values.tolist() if math.isfinite(value)]


def _stroke(seen: style.Look, *, dashed: bool = True) -> str:
    dash = f' stroke-dasharray="{" ".join(map(str, seen.dash))}"' if dashed and seen.dash else ""
    return f'stroke="{seen.colour}" stroke-width="{seen.width}" stroke-linejoin="round"{dash}'


def _fill(seen: style.Look, kind: str) -> str:
    return f'fill="{seen.colour}" fill-opacity="{0.45 if kind == "bars" else 0.16}"'


def _draw_mark(canvas: _Canvas, axes: _Axes, mark: Mark) -> None:
    seen = style.look(mark.role)
    if mark.kind == "rule":
        _draw_rules(canvas, axes, mark, seen)
    elif mark.kind == "bars":
        edges, heights = axes.x(floats(mark.x)), axes.y(floats(mark.y))
        base = axes.bottom if axes.panel.y_log else float(axes.y(np.zeros(1))[0])
        sides = zip(edges[:-1].tolist(), edges[1:].tolist(), heights.tolist(), strict=True)
        bars = "".join(
            f"M{a + 0.2:.1f} {base:.1f}V{h:.1f}H{b - 0.2:.1f}V{base:.1f}z"
            for a, b, h in sides
            if a == a and b == b and h == h
        )
        canvas.path(bars, _fill(seen, "bars"))
    elif mark.kind == "band":
        x, low, high = axes.x(floats(mark.x)), axes.y(floats(mark.low)), axes.y(floats(mark.high))
        good = np.isfinite(x) & np.isfinite(low) & np.isfinite(high)
        if good.any():
            there = _polyline(x[good], high[good])
            back = _polyline(x[good][::-1], low[good][::-1]).replace("M", "L", 1)
            canvas.path(there + back + "z", _fill(seen, "band"))
    elif mark.kind in ("line", "step"):
        x, y = decimate(floats(mark.x), floats(mark.y))
        if mark.kind == "step":
            x, y = np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]
        canvas.path(_polyline(axes.x(x), axes.y(y)), f"{_stroke(seen)}")
    elif mark.kind == "stems":
        across, up = _pair(axes, mark)
        base = axes.bottom if axes.panel.y_log else float(axes.y(np.zeros(1))[0])
        canvas.path(
            "".join(f"M{a:.1f} {base:.1f}V{b:.1f}" for a, b in zip(across, up, strict=True)),
            _stroke(seen, dashed=False),
        )
        canvas.path(_dots(across, up), _dot_stroke(seen, 2.4))
    elif mark.kind == "errorbars":
        _draw_errorbars(canvas, axes, mark, seen)
    elif mark.kind == "text":
        places = zip(axes.x(floats(mark.x)).tolist(), axes.y(floats(mark.y)).tolist(), mark.texts, strict=True)
        for x, y, text in places:
            if x == x and y == y:
                shown = canvas.fitted(text, _SMALL, axes.right - axes.left)
                canvas.text(x, y + _SMALL * 0.36, shown, _SMALL, "middle", colour=style.MUTED)
    elif mark.kind == "heat":
        _draw_heat(canvas, axes, mark)
    else:
        _draw_points(canvas, axes, mark, seen)


def _draw_rules(canvas: _Canvas, axes: _Axes, mark: Mark, seen: style.Look) -> None:
    width, height = axes.right - axes.left, axes.bottom - axes.top
    across = "".join(f"M{axes.left:.1f} {y:.2f}h{width:.1f}" for y in _finite(axes.y(floats(mark.y))))
    up = "".join(f"M{x:.2f} {axes.top:.1f}v{height:.1f}" for x in _finite(axes.x(floats(mark.x))))
    canvas.path(across + up, _stroke(seen))


def _draw_errorbars(canvas: _Canvas, axes: _Axes, mark: Mark, seen: style.Look) -> None:
    x = axes.x(floats(mark.x))
    low, high = axes.y(floats(mark.low)), axes.y(floats(mark.high))
    ends = zip(x.tolist(), low.tolist(), high.tolist(), strict=True)
    bars = "".join(
        f"M{a:.1f} {b:.1f}V{c:.1f}M{a - 1.8:.1f} {b:.1f}h3.6M{a - 1.8:.1f} {c:.1f}h3.6"
        for a, b, c in ends
        if a == a and b == b and c == c
    )
    canvas.path(bars, f'stroke="{seen.colour}" stroke-width="0.8"')
    canvas.path(_markers(seen, list(zip(*_pair(axes, mark), strict=True)), 1.9), f'fill="{seen.colour}"')


def _draw_heat(canvas: _Canvas, axes: _Axes, mark: Mark) -> None:
    x, y = axes.x(floats(mark.x)), axes.y(floats(mark.y))
    if not len(mark.z) or not (np.isfinite(x).all() and np.isfinite(y).all()):
        return
    picture = base64.b64encode(_heat_png(heat_levels(mark)[::-1])).decode()
    canvas.parts.append(
        f'<image x="{x[0]:.2f}" y="{y[-1]:.2f}" width="{x[-1] - x[0]:.2f}" height="{y[0] - y[-1]:.2f}" '
        f'preserveAspectRatio="none" href="data:image/png;base64,{picture}"/>'
    )


def _draw_points(canvas: _Canvas, axes: _Axes, mark: Mark, seen: style.Look) -> None:
    x, y = _pair(axes, mark)
    if len(x) <= _MARKED:
        canvas.path(_markers(seen, list(zip(x, y, strict=True)), 1.7), f'fill="{seen.colour}"')
    elif len(x) <= DENSE:
        opacity = "" if len(x) <= 500 else ' stroke-opacity="0.7"'
        canvas.path(_dots(x, y), _dot_stroke(seen, 1.9 if len(x) <= 500 else 1.4) + opacity)
    else:
        picture = _cloud(
            np.array(x) - axes.left,
            np.array(y) - axes.top,
            axes.right - axes.left,
            axes.bottom - axes.top,
            seen.colour,
        )
        canvas.parts.append(
            f'<image x="{axes.left:.1f}" y="{axes.top:.1f}" width="{axes.right - axes.left:.1f}" '
            f'height="{axes.bottom - axes.top:.1f}" preserveAspectRatio="none" '
            f'href="data:image/png;base64,{picture}"/>'
        )


def _pair(axes: _Axes, mark: Mark) -> tuple[list[float], list[float]]:
    x, y = axes.x(floats(mark.x)), axes.y(floats(mark.y))
    good = np.isfinite(x) & np.isfinite(y)
    if mark.kind == "points":
        x, y = thin(x[good], y[good], int(3 * (axes.right - axes.left)), int(3 * (axes.bottom - axes.top)))
        return x.tolist(), y.tolist()
    return x[good].tolist(), y[good].tolist()


def _polyline(x: Floats, y: Floats) -> str:
    pieces, pen = [], "M"
    for a, b in zip(x.tolist(), y.tolist(), strict=True):
        if a != a or b != b:
            pen = "M"
            continue
        pieces.append(f"{pen}{a:.1f} {b:.1f}")
        pen = "L"
    return "".join(pieces)


def _dots(x: list[float], y: list[float]) -> str:
    return "".join(f"M{a:.1f} {b:.1f}h.01" for a, b in zip(x, y, strict=True))


def _dot_stroke(seen: style.Look, size: float) -> str:
    return f'stroke="{seen.colour}" stroke-width="{size}" stroke-linecap="round"'


def _markers(seen: style.Look, places: list[tuple[float, float]], r: float) -> str:
    shape = {
        "circle": f"m-{r} 0a{r} {r} 0 1 0 {2 * r} 0a{r} {r} 0 1 0 -{2 * r} 0z",
        "square": f"m-{r * 0.9:.2f} -{r * 0.9:.2f}h{r * 1.8:.2f}v{r * 1.8:.2f}h-{r * 1.8:.2f}z",
        "triangle": f"m0 -{r * 1.2:.2f}l{r * 1.1:.2f} {r * 2:.2f}h-{r * 2.2:.2f}z",
        "diamond": "m0 -{0:.2f}l{1:.2f} {0:.2f}l-{1:.2f} {0:.2f}l-{1:.2f} -{0:.2f}z".format(r * 1.3, r * 1.2),
    }[seen.marker]
    return "".join(f"M{x:.1f} {y:.1f}{shape}" for x, y in places)


def _cloud(x: Floats, y: Floats, width: float, height: float, colour: str) -> str:
    """A dense cloud of dots as a small palette PNG whose opacity grows with the number of dots on a pixel."""
    across, up = max(1, round(width * _PIXELS_PER_POINT)), max(1, round(height * _PIXELS_PER_POINT))
    column, row = (x * across / width).astype(np.int64), (y * up / height).astype(np.int64)
    count = np.zeros((up + 4, across + 4), dtype=np.int64)
    for down, aside in ((0, 1), (1, 0), (1, 1), (1, 2), (2, 1)):
        inside = (column >= -1) & (column <= across) & (row >= -1) & (row <= up)
        np.add.at(count, (row[inside] + down + 1, column[inside] + aside + 1), 1)
    levels = np.minimum(count[2:-2, 2:-2], 3).astype(np.uint8)
    return base64.b64encode(_png(levels, colour, bytes((0, 140, 200, 255)))).decode()


def _png(levels: NDArray[np.uint8], colour: str, alpha: bytes) -> bytes:
    """A PNG of one colour in four opacities, two bits a pixel."""
    height, width = levels.shape
    padded = np.zeros((height, -(-width // 4) * 4), dtype=np.uint8)
    padded[:, :width] = levels
    packed = padded[:, 0::4] << 6 | padded[:, 1::4] << 4 | padded[:, 2::4] << 2 | padded[:, 3::4]
    lines = np.zeros((height, packed.shape[1] + 1), dtype=np.uint8)  # the leading 0 of a line: no filter
    lines[:, 1:] = packed
    return _palette_png(lines, width, 2, bytes.fromhex(colour.removeprefix("#")) * len(alpha), alpha)


def _heat_png(levels: NDArray[np.uint8]) -> bytes:
    """A PNG of the colours of a heat mark, a byte a pixel; a missing value is transparent."""
    height, width = levels.shape
    lines = np.zeros((height, width + 1), dtype=np.uint8)
    lines[:, 1:] = np.where(levels == MISSING_LEVEL, style.HEAT_LEVELS, levels)
    colours = [*style.heat_colours(), "#FFFFFF"]
    palette = b"".join(bytes.fromhex(colour.removeprefix("#")) for colour in colours)
    return _palette_png(lines, width, 8, palette, bytes((255,)) * style.HEAT_LEVELS + bytes((0,)))


def _palette_png(lines: NDArray[np.uint8], width: int, bits: int, palette: bytes, alpha: bytes) -> bytes:
    """A palette PNG of packed lines, each led by the number of its filter."""
    header = struct.pack(">IIBBBBB", width, len(lines), bits, 3, 0, 0, 0)
    chunks = (
        (b"IHDR", header),
        (b"PLTE", palette),
        (b"tRNS", alpha),
        (b"IDAT", zlib.compress(lines.tobytes(), 9)),
        (b"IEND", b""),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body)) for name, body in chunks
    )
