"""Milliseconds until the first plot of a large page stands, in a cold browser and in a warm one. Needs a Chromium.

python benchmarks/page.py
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from rangeeval.reporting import render_html
from tests.reporting.browser import browser, find_browser
from tests.reporting.demo import demo


def main() -> None:
    """Write the page, open it a few times, print."""
    program = find_browser()
    if program is None:
        sys.exit("no Chromium or Chrome on this machine")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
        file = Path(scratch) / "report.html"
        text = render_html(demo(bins=0, overviews=1, clouds=30))
        file.write_text(text, encoding="utf-8")
        times = []
        with browser(program, Path(scratch) / "profile") as page:
            page.size(1400)
            for _ in range(5):
                page.open(file)
                times.append(float(page.wait("document.documentElement.dataset.firstPlot")))
    print(f"30 plots of 10,000 points, {len(text) / 1e6:.2f} MB")
    print(f"first plot: {times[0]:.0f} ms in a cold browser, {min(times[1:]):.0f} ms in a warm one")


if __name__ == "__main__":
    main()
