"""A figure as a bokeh document: plain JSON, written without bokeh's own model classes.

Building the models in Python takes 0.6 s to import and about 10 ms a panel; a page of range bins has over two
hundred panels. A test reads what is written here back through bokeh's own classes, so that a new bokeh
that means something else is noticed.

Series longer than `EXACT` travel as 16-bit steps of the range they span, finer than a pixel, which the boot
script turns back into doubles (as it does with the levels of a heat map). That is half the size of single precision
and, unlike it, does not blur times that are counted from 1970.
"""

from __future__ import annotations

import base64
import math
from typing import Any

import numpy as np

from rangeeval.reporting import style
from rangeeval.reporting.axes import Floats, Range, floats, heat_levels, panels, views
from rangeeval.reporting.blocks import Figure, Mark, Panel
from rangeeval.reporting.text import neutral
from rangeeval.stats.reduce import decimate, thin

Json = dict[str, Any]

EXACT = 64
_STEPS = 65534  # 65535 stands for a value that is missing


class _Models:
    """Bokeh models with ids that are the same in every run."""

    def __init__(self, prefix: str) -> None:
        self._prefix, self._count = prefix, 0

    def new(self, name: str, **attributes: Any) -> Json:
        self._count += 1
        return {
            "type": "object",
            "name": name,
            "id": f"{self._prefix}-{self._count}",
            "attributes": attributes,
        }


def column(values: Floats) -> Json | list[float | None]:
    """One column of numbers: as they are when few, in 16-bit steps when many."""
    finite = np.isfinite(values)
    if values.size <= EXACT:
        return [value if good else None for value, good in zip(values.tolist(), finite.tolist(), strict=True)]
    low, high = (float(values[finite].min()), float(values[finite].max())) if finite.any() else (0.0, 0.0)
    scale = _STEPS / (high - low) if high > low else 0.0
    steps = np.full(values.shape, 65535, dtype="<u2")
    steps[finite] = np.rint((values[finite] - low) * scale)
    return {"steps": base64.b64encode(steps.tobytes()).decode(), "low": low, "high": high}


def plot_document(figure: Figure, prefix: str, version: str) -> Json:
    """The bokeh document of a figure: one root a panel, and what names them."""
    models, roots = _Models(prefix), []
    shared: dict[tuple[str, bool], Json] = {}
    for (_, _, panel), (x_view, y_view) in zip(panels(figure), views(figure).values(), strict=True):
        x_range = shared.get((panel.share_x, panel.x_log)) if panel.share_x else None
        if x_range is None:
            x_range = models.new("Range1d", start=x_view[0], end=x_view[1])
        if panel.share_x:
            shared.setdefault((panel.share_x, panel.x_log), {"id": x_range["id"]})
        roots.append(_plot(models, panel, x_range, (x_view, y_view), style.ROW_HEIGHT_PX[figure.size]))
    return {
        "doc": {"version": version, "title": "", "roots": roots},
        "roots": [root["id"] for root in roots],
    }


def _plot(models: _Models, panel: Panel, x_range: Json, view: tuple[Range, Range], height: int) -> Json:
    renderers = [renderer for mark in panel.marks for renderer in _renderers(models, mark, panel)]
    spans = [span for mark in panel.marks if mark.kind == "rule" for span in _spans(models, mark)]
    x_axis = _axis(models, panel.x_label, panel.x_log, view[0])
    y_axis = _axis(models, panel.y_label, panel.y_log, view[1])
    tools = [
        models.new("PanTool"),
        models.new("BoxZoomTool", overlay=_zoom_box(models), match_aspect=panel.square),
        models.new("WheelZoomTool"),
        models.new("ResetTool"),
        *_hover_tools(models, panel, view, renderers),
    ]
    grid = [
        models.new("Grid", axis={"id": x_axis["id"]}, grid_line_color=style.GRID),
        models.new("Grid", dimension=1, axis={"id": y_axis["id"]}, grid_line_color=style.GRID),
    ]
    side = height - 40
    sizes: Json = (
        {"frame_width": side, "frame_height": side, "width": None, "height": None, "min_border": 4}
        if panel.square
        else {"height": height, "sizing_mode": "stretch_width", "min_border_left": 64, "min_border_right": 12}
    )
    return models.new(
        "Figure",
        **sizes,
        x_range=x_range,
        y_range=models.new("Range1d", start=view[1][0], end=view[1][1]),
        x_scale=models.new("LogScale" if panel.x_log else "LinearScale"),
        y_scale=models.new("LogScale" if panel.y_log else "LinearScale"),
        title=models.new(
            "Title",
            text=_plain(models, panel.title),
            text_color=style.INK,
            text_font=_FONT,
            text_font_size="13px",
        ),
        renderers=renderers,
        toolbar=models.new("Toolbar", tools=tools, active_drag={"id": tools[1]["id"]}, active_scroll=None),
        toolbar_location=None,
        left=[] if panel.square else [y_axis],
        below=[] if panel.square else [x_axis],
        center=[*([] if panel.square else grid), *spans],
        outline_line_color=None,
        background_fill_color=None,
        border_fill_color=None,
    )


def _hover_tools(models: _Models, panel: Panel, view: tuple[Range, Range], renderers: list[Json]) -> list[Json]:
    """What the pointer tells of a sample: its values, and the ends of its interval where it has one."""
    across, up = _number_format(view[0]), _number_format(view[1])
    plain = [
        [neutral(panel.x_label)[:80] or "x", f"@x{across}"],
        [neutral(panel.y_label)[:80] or "y", f"@y{up}"],
    ]
    told = {"text": [["", "@text"]], "low": [*plain, ["interval", f"@low{up} to @high{up}"]], "": plain}
    hovered: dict[str, list[Json]] = {key: [] for key in told}
    for renderer in renderers:
        drawn = renderer["attributes"]
        names = [name for name, _ in drawn["data_source"]["attributes"]["data"]["entries"]]
        if drawn["glyph"]["name"] in _HOVERED and (not panel.square or "text" in names):
            hovered[next((key for key in told if key in names), "")].append({"id": renderer["id"]})
    return [
        models.new("HoverTool", renderers=some, tooltips=told[key]) for key, some in hovered.items() if some
    ]  # fmt: skip


_FONT = "system-ui, 'Segoe UI', 'DejaVu Sans', sans-serif"
_HOVERED = ("Scatter", "Line", "Step", "Quad")


def _number_format(view: Range) -> str:
    """Plain decimals where they read well over a range, powers of ten elsewhere."""
    return "{0.[0000]}" if 0.01 < max(abs(view[0]), abs(view[1])) < 1e10 else "{0.[000]e+0}"


def _plain(models: _Models, text: str) -> Json:
    """Text that is never taken for a formula."""
    return models.new("PlainText", text=neutral(text)[:200])


def _zoom_box(models: _Models) -> Json:
    nan = {"type": "number", "value": "nan"}
    return models.new(
        "BoxAnnotation",
        syncable=False,
        level="overlay",
        visible=False,
        left=nan,
        right=nan,
        top=nan,
        bottom=nan,
        left_units="canvas",
        right_units="canvas",
        top_units="canvas",
        bottom_units="canvas",
        line_color=style.MUTED,
        line_alpha=1.0,
        line_dash=[4, 3],
        fill_color="#0b4f7d",
        fill_alpha=0.12,
    )


def _axis(models: _Models, label: str, log: bool, view: Range) -> Json:
    plain = view[1] - view[0] <= 1e-2 * max(abs(view[0]), abs(view[1]))
    if log:
        ticker, formatter = _log_ticker(models, view), models.new("LogTickFormatter")
    else:
        ticker = models.new("BasicTicker", mantissas=[1, 2, 5], desired_num_ticks=6)
        formatter = models.new("BasicTickFormatter", power_limit_low=-4, power_limit_high=7, use_scientific=not plain)
    return models.new(
        "LogAxis" if log else "LinearAxis",
        ticker=ticker,
        formatter=formatter,
        major_label_policy=models.new("NoOverlap", min_distance=6),
        axis_label=_plain(models, label) if label else None,
        axis_label_text_font=_FONT,
        axis_label_text_font_style="normal",
        axis_label_text_font_size="12px",
        axis_label_text_color=style.INK,
        axis_label_standoff=5,
        major_label_text_font=_FONT,
        major_label_text_font_size="11px",
        major_label_text_color=style.MUTED,
        axis_line_color=style.FRAME,
        major_tick_line_color=style.FRAME,
        major_tick_in=0,
        major_tick_out=4,
        minor_tick_line_color=None,
    )


def _log_ticker(models: _Models, view: Range) -> Json:
    """Decades; where there are few of them, some between them too (bokeh's own would space them linearly)."""
    first, last = math.floor(math.log10(view[0])), math.ceil(math.log10(view[1]))
    if last - first > 3:
        return models.new("LogTicker")
    return models.new(
        "FixedTicker",
        ticks=[factor * 10.0**power for power in range(first, last + 1) for factor in (1, 2, 3, 5, 7)],
    )


def _renderers(models: _Models, mark: Mark, panel: Panel) -> list[Json]:
    seen = style.look(mark.role)
    x, y, low, high = floats(mark.x), floats(mark.y), floats(mark.low), floats(mark.high)
    line: Json = {
        "line_color": seen.colour,
        "line_width": 1.6,
        "line_join": "round",
        "line_dash": _dash(seen),
    }
    floor = _floor(panel)
    if mark.kind == "text" or (mark.kind == "points" and mark.texts):
        told = {"x": x, "y": y, "text": [neutral(text)[:200] for text in mark.texts]}
        if mark.kind == "points":
            return [_renderer(models, "Scatter", told, _scatter(seen, 7, 1.0))]
        return [_renderer(models, "Text", told, _values(text_color=style.MUTED, text_font_size="11px",
                text_font=_FONT, text_align="center", text_baseline="middle")
                | {"text": {"type": "field", "field": "text"}})]  # fmt: skip
    if mark.kind == "points":
        x, y = thin(x, y)
        size, alpha = (7, 1.0) if x.size <= 60 else (4.5, 0.75) if x.size <= 500 else (3.0, 0.55)
        return [_renderer(models, "Scatter", {"x": x, "y": y}, _scatter(seen, size, alpha))]
    if mark.kind in ("line", "step"):
        x, y = decimate(x, y)
        if mark.kind == "step":
            line["mode"] = "after"
        return [_renderer(models, "Line" if mark.kind == "line" else "Step", {"x": x, "y": y}, line)]
    if mark.kind == "bars":
        columns = {
            "left": x[:-1],
            "right": x[1:],
            "top": y,
            "bottom": np.full(y.shape, floor),
            "x": (x[:-1] + x[1:]) / 2,
            "y": y,
        }
        edges = {name: {"type": "field", "field": name} for name in ("left", "right", "top", "bottom")}
        return [
            _renderer(
                models,
                "Quad",
                columns,
                edges | _values(fill_color=seen.colour, fill_alpha=0.45, line_color="#ffffff"),
            )
        ]
    if mark.kind == "band":
        area = {"fill_color": seen.colour, "fill_alpha": 0.16}
        fields = {"x": "x", "y1": "low", "y2": "high"}
        good = np.isfinite(x) & np.isfinite(low) & np.isfinite(high)
        columns = {"x": x[good], "low": low[good], "high": high[good]}
        return [
            _renderer(models, "VArea", columns, {k: {"type": "field", "field": v} for k, v in fields.items()} | area)
        ]
    if mark.kind == "stems":
        columns = {"x": x, "y": y, "floor": np.full(y.shape, floor)}
        return [
            _segments(models, columns, "floor", "y", seen),
            _renderer(models, "Scatter", {"x": x, "y": y}, _scatter(seen, 6, 1.0)),
        ]
    if mark.kind == "heat":
        return [_heat(models, mark)] if len(mark.z) else []
    if mark.kind == "errorbars":
        columns = {"x": x, "y": y, "low": low, "high": high}
        return [
            _segments(models, columns, "low", "high", seen),
            _renderer(models, "Scatter", columns, _scatter(seen, 7, 1.0)),
        ]
    return []


def _heat(models: _Models, mark: Mark) -> Json:
    """An image of one byte a cell, coloured by its levels."""
    levels, x, y = heat_levels(mark), floats(mark.x), floats(mark.y)
    picture = {"levels": base64.b64encode(levels.tobytes()).decode(), "shape": list(levels.shape)}
    mapper = models.new(
        "LinearColorMapper",
        palette=style.heat_colours(),
        low=0,
        high=style.HEAT_LEVELS,
        high_color="rgba(255, 255, 255, 0)",
    )
    glyph = {"image": {"type": "field", "field": "image"}, "color_mapper": mapper}
    glyph |= _values(x=float(x[0]), y=float(y[0]), dw=float(x[-1] - x[0]), dh=float(y[-1] - y[0]))
    return _glyph_renderer(models, [["image", [picture]]], models.new("Image", **glyph))


def _floor(panel: Panel) -> float:
    return 1e-300 if panel.y_log else 0.0


def _values(**visuals: Any) -> Json:
    return {name: {"type": "value", "value": value} for name, value in visuals.items()}


def _dash(seen: style.Look) -> list[int]:
    return [round(1.4 * length) for length in seen.dash]


def _scatter(seen: style.Look, size: float, alpha: float) -> Json:
    marker = seen.marker if size >= 6 else "circle"
    return _values(marker=marker, size=size, fill_color=seen.colour, fill_alpha=alpha, line_color=None)


def _segments(models: _Models, columns: dict[str, Floats], start: str, end: str, seen: style.Look) -> Json:
    ends = {"x0": "x", "y0": start, "x1": "x", "y1": end}
    glyph = {k: {"type": "field", "field": v} for k, v in ends.items()} | _values(
        line_color=seen.colour, line_width=1.4
    )
    return _renderer(models, "Segment", columns, glyph)


def _renderer(models: _Models, name: str, columns: dict[str, Any], glyph: Json) -> Json:
    entries = [[key, values if isinstance(values, list) else column(values)] for key, values in columns.items()]
    fields = {"x": {"type": "field", "field": "x"}, "y": {"type": "field", "field": "y"}}
    drawn = models.new(name, **(fields if name in ("Scatter", "Line", "Step", "Text") else {}), **glyph)
    return _glyph_renderer(models, entries, drawn)


def _glyph_renderer(models: _Models, entries: list[list[Any]], drawn: Json) -> Json:
    return models.new(
        "GlyphRenderer",
        data_source=models.new(
            "ColumnDataSource",
            data={"type": "map", "entries": entries},
            selected=models.new("Selection"),
            selection_policy=models.new("UnionRenderers"),
        ),
        view=models.new("CDSView", filter=models.new("AllIndices")),
        glyph=drawn,
    )


def _spans(models: _Models, mark: Mark) -> list[Json]:
    seen = style.look(mark.role)
    return [
        models.new(
            "Span",
            location=float(at),
            dimension=dimension,
            line_color=seen.colour,
            line_width=1.4,
            line_dash=_dash(seen),
        )
        for dimension, values in (("width", floats(mark.y)), ("height", floats(mark.x)))
        for at in values[np.isfinite(values)]
    ]
