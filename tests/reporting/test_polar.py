"""Polar plots: angles and radii land where a compass would put them, in both renderers."""

import math
import re

import numpy as np
import pytest

from rangeeval.reporting.blocks import Figure
from rangeeval.reporting.fonts import Glyphs
from rangeeval.reporting.plots import plot_document
from rangeeval.reporting.polar import Sector, polar_panel
from rangeeval.reporting.svg import render_svg

DEGREE = math.pi / 180


def sector(middle, value, low=None, high=None, width=10.0):
    start, end = (middle - width / 2) * DEGREE, (middle + width / 2) * DEGREE
    return Sector(start, end, value, value - 1 if low is None else low, value + 1 if high is None else high, f"{value}")


def points(panel):
    (mark,) = [m for m in panel.marks if m.kind == "points"]
    return np.array(mark.x), np.array(mark.y)


def test_the_nose_is_up_and_angles_go_clockwise():
    """0, 90, 180 and 270 degrees: up, right, down, left, all at one radius."""
    x, y = points(polar_panel("p", [sector(a, 3.0) for a in (0, 90, 180, 270)], "dBsm", label="s"))
    r = y[0]
    assert r > 0
    np.testing.assert_allclose(x / r, [0, 1, 0, -1], atol=1e-12)
    np.testing.assert_allclose(y / r, [1, 0, -1, 0], atol=1e-12)


def test_the_radius_is_linear_between_the_rings():
    """Values 2 apart lie equally far apart, and on the rings that bear their names."""
    panel = polar_panel("p", [sector(0, v, v, v) for v in (-2.0, 0.0, 2.0, 4.0)], "dBsm", label="s")
    _, y = points(panel)
    np.testing.assert_allclose(np.diff(y), np.diff(y)[0])
    labels = [m for m in panel.marks if m.kind == "text"][1]
    at = {
        text.split()[0].replace("−", "-"): math.hypot(a, b)
        for a, b, text in zip(labels.x, labels.y, labels.texts, strict=True)
    }
    assert at["0"] == pytest.approx(y[1])
    assert at["4"] == pytest.approx(y[3])
    assert labels.texts[-1].endswith(" dBsm")


def test_intervals_are_radial_and_limits_are_left_out():
    """The bar of a sector at 90 degrees runs along the x axis; what has no value has no point."""
    panel = polar_panel("p", [sector(90, 3.0, 1.0, 5.0), sector(180, math.nan, math.nan, 2.0)], "dBsm", label="s")
    assert len(points(panel)[0]) == 1
    line = next(m for m in panel.marks if m.kind == "line" and m.role == "measured")
    across, up = np.array(line.x)[-3:-1], np.array(line.y)[-3:-1]
    assert across[1] - across[0] > 0
    arc = np.array(line.x)[:3], np.array(line.y)[:3]  # from 85 degrees on: to the right, a little up
    assert arc[0][0] > 5 * arc[1][0] > 0
    np.testing.assert_allclose(up, 0, atol=1e-12)


def test_both_renderers_keep_it_round():
    """One scale both ways: the SVG's frame is square, bokeh's frame too, and no axes are drawn."""
    panel = polar_panel(
        "p", [sector(a, 3.0) for a in range(0, 360, 15)], "dBsm", label="s", level=2.0, level_label="all"
    )
    figure = Figure("c", "a", [[panel, None]], "tall")
    clip = re.search(r'<clipPath id="c0"><path d="M[\d.]+ [\d.]+h([\d.]+)v([\d.]+)', render_svg(figure, Glyphs()))
    assert clip is not None
    assert float(clip[1]) == pytest.approx(float(clip[2]), abs=0.11)
    (root,) = plot_document(figure, "f1", "3")["doc"]["roots"]
    own = root["attributes"]
    assert own["frame_width"] == own["frame_height"] > 0
    assert own["left"] == own["below"] == []
    assert panel.x_limits == panel.y_limits


def test_nothing_to_draw_is_an_empty_frame():
    """No sector with a value: rings and spokes, no failure."""
    panel = polar_panel("p", [sector(0, math.nan, math.nan, math.nan)], "dBsm", label="s")
    assert "<svg" in render_svg(Figure("c", "a", [[panel]]), Glyphs())
