"""What bearings a real infrasound array gives, against the one that was published.

Reads the four SAC files of a four-element array in Utah (YJ.BRP1 to BRP4, 9 April 2012, 18:00 to 18:20 UTC; infrapy,
Los Alamos National Laboratory, examples). The data are not part of this repository.

    python benchmarks/infrasound.py FOLDER                              # prints the numbers
    python benchmarks/infrasound.py FOLDER docs/images/real-array.svg   # and draws the waterfall
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import rangeeval
from rangeeval.model import SensorArray, TrialSettings
from rangeeval.reporting.fonts import Glyphs
from rangeeval.reporting.sections.bearing import waterfall_figure
from rangeeval.reporting.svg import render_svg

PUBLISHED = "318.2 degrees and 371 m/s"
FIRST, SECOND, THIRD = (418.0, 434.0), (610.0, 790.0), (800.0, 840.0)
ARRAY = SensorArray(propagation_speed_m_s=340.0, band_hz=(0.5, 5.0), block_s=4.0, targets=1)


def heard(result: rangeeval.Result, span: tuple[float, float]) -> np.ndarray:
    """Time, bearing (degrees), half width of its interval and coherence of the blocks with one clear wave in a span."""
    track, share = result.series["bearing/1"], result.series["coherence"]["share"]
    rows = np.array([
        (t, np.rad2deg(b), np.rad2deg(high - b), c)
        for t, b, high, on, c in zip(track["time_s"], track["bearing_rad"], track["high_rad"], track["heard"], share, strict=True)
        if on and span[0] <= t <= span[1]
    ])  # fmt: skip
    return rows.reshape(-1, 4)


def main() -> None:
    """Blocks by themselves at several speeds of the wave, then one track through the second event."""
    folder = Path(sys.argv[1])
    files = sorted(folder.glob("*.SAC"))
    for speed in (340.0, 371.0):
        array = replace(ARRAY, propagation_speed_m_s=speed)
        trial = rangeeval.open_trial(files, settings=TrialSettings(array=array))
        result = rangeeval.bearing(trial, method="music", block=3)
        print(f"MUSIC, {result.settings['bins']} bins, blocks of 8 s, a wave of {speed:g} m/s")
        for t, bearing, half, share in heard(result, FIRST):
            print(f"  {t:6.1f} s: {bearing:5.1f} +- {half:3.1f} degrees, {share:.0%} of the power in one wave")
        for span in (SECOND, THIRD):
            bearing = heard(result, span)[:, 1]
            low, middle, high = np.quantile(bearing, (0.1, 0.5, 0.9))
            print(
                f"  {span[0]:.0f} to {span[1]:.0f} s: {len(bearing)} blocks, median {middle:.1f}, 80 % from {low:.1f} to {high:.1f}"
            )
        if len(sys.argv) > 2 and speed == ARRAY.propagation_speed_m_s:
            Path(sys.argv[2]).write_text(render_svg(waterfall_figure(result), Glyphs()), encoding="utf-8")
    print(f"published for the first: {PUBLISHED}")
    trial = rangeeval.open_trial(files, settings=TrialSettings(array=ARRAY))
    tracks, problems = rangeeval.bearing_tracks(trial, span_s=SECOND)
    low, middle, high = tracks["compass_deg"].quantile((0.1, 0.5, 0.9))
    print(f"joint-ml, {SECOND[0]:.0f} to {SECOND[1]:.0f} s: {len(tracks)} updates, median {middle:.1f}, 80 % from {low:.1f} to {high:.1f}, "
          f"sigma {tracks['sigma_deg'].median():.1f}")  # fmt: skip
    for problem in problems:
        print(f"  {problem}")


if __name__ == "__main__":
    main()
