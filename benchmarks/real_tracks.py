"""Replay on recorded aircraft: measurement noise from plots alone, filters compared, and real flights as truth.

    python benchmarks/real_tracks.py FOLDER

FOLDER holds `lebl-cat048-csv/P3_20_24h.csv` (plots of 153 aircraft, an airport's Mode S radar) and `adsb-tracks`
(`zero_gravity.json.gz`, `noisy_time_issue.json.gz`, `UAV_Rot.csv`). The data are not part of this repository. The numbers
are those of docs/explanation/real-tracks.md.
"""

from __future__ import annotations

import gzip
import json
import shutil
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import numpy as np

import rangeeval
from rangeeval.analyses.replay.gathering import gather_tracks
from rangeeval.model import Trial, log_of
from rangeeval.model.paths import true_paths
from rangeeval.model.settings import settings_from
from rangeeval.physics.polar import polar
from rangeeval.stats.local_noise import leave_one_out, noise_of

TOML = """\
[trial]
name = "Airport Mode S radar"

[radar]
update_interval_s = 4.0

[[logs]]
file = "P3_20_24h.csv"
kind = "plots"
delimiter = ";"
decimal = ","
columns = { "TIME" = "time_s", "RHO" = "range_nmi", "THETA" = "azimuth_deg", "TA" = "target_id" }
"""
MILE = 1852.0
EDGES_NMI = (3, 10, 20, 40)
STRETCHES, FEWEST = 30, 30  # stretches of aircraft a band is tuned on, and plots in the shortest
FASTEST = 350.0  # m/s, of an airliner with the wind
NOISE = (15.0, 1e-3, 1e-3)  # of the made-up radar that watches the real flights


def recorded(folder: Path, work: Path) -> Trial:
    """The trial: the recording as it is, and a trial.toml beside a copy of it."""
    shutil.copy(folder / "lebl-cat048-csv" / "P3_20_24h.csv", work)
    (work / "trial.toml").write_text(TOML, encoding="utf-8")
    return rangeeval.open_trial(work)


def scatter(trial: Trial) -> None:
    """Noise by range from each plot against the parabola through its neighbours: no filter in it."""
    gathered = gather_tracks(trial)
    plots = [t.plots for t in gathered.tracks]
    where = np.concatenate([p.range_m for p in plots]) / MILE
    distance = np.concatenate([leave_one_out(p.time_s, p.range_m, max_gap=10.0) for p in plots])
    azimuth = np.concatenate([leave_one_out(p.time_s, np.unwrap(p.azimuth_rad), max_gap=10.0) for p in plots])
    print(f"{len(plots)} aircraft, {where.size} plots, noise from scatter:")
    for low, high in pairwise(EDGES_NMI):
        inside = (where >= low) & (where < high)
        r, a = noise_of(distance[inside]), noise_of(azimuth[inside])
        print(f"  {low:2d} to {high:2d} NM  n {r.n:6d}  range {r.value:.2f} [{r.low:.2f}, {r.high:.2f}] m  "
              f"azimuth {np.degrees(a.value):.4f} [{np.degrees(a.low):.4f}, {np.degrees(a.high):.4f}] deg")  # fmt: skip


def associated(trial: Trial) -> None:
    """The same plots without their addresses: do the tracks found hold one aircraft each?"""
    named = gather_tracks(trial)
    owner = {(t, r): k.name for k in named.tracks for t, r in zip(k.plots.time_s, k.plots.range_m, strict=True)}
    start = time.perf_counter()
    found = gather_tracks(trial, "global").tracks
    seconds = time.perf_counter() - start
    own: dict[str, list[int]] = {}
    for track in found:
        names = [owner[key] for key in zip(track.plots.time_s, track.plots.range_m, strict=True)]
        for name in dict.fromkeys(names):
            own.setdefault(name, []).append(names.count(name))
    plots = sum(map(sum, own.values()))
    print(f"association without addresses: {len(found)} tracks in {seconds:.1f} s; "
          f"{sum(max(v) for v in own.values()) / plots:.3f} of the plots in their aircraft's longest track")  # fmt: skip


def tuned(trial: Trial) -> None:
    """Noise by range again, now by the likelihood of an IMM filter's innovations: stretches of aircraft inside a band."""
    tracks = gather_tracks(trial).tracks
    for low, high in pairwise(EDGES_NMI):
        stretches = []
        for track in tracks:
            p = track.plots
            inside = (p.range_m >= low * MILE) & (p.range_m < high * MILE)
            runs = np.split(np.arange(len(p)), np.flatnonzero(np.diff(inside) | (np.diff(p.time_s) > 10.0)) + 1)
            stretches += [p.take(r, f"{p.target}-{r[0]}") for r in runs if len(r) >= FEWEST and inside[r[0]]]
        stretches = sorted(stretches, key=lambda p: (-len(p), p.target))[:STRETCHES]
        columns = {n: np.concatenate([getattr(p, n) for p in stretches]) for n in ("time_s", "range_m", "azimuth_rad")}
        columns["target_id"] = np.concatenate([[p.target] * len(p) for p in stretches])
        band = Trial("band", (log_of("plots", columns),))
        by_scatter = gather_tracks(band).noise.sigma
        start = time.perf_counter()
        result = rangeeval.replay(band, filter="imm", tune=True)
        seconds = time.perf_counter() - start
        found = {r.quantity: r for r in result.rows if r.variable is None and r.track_id is None}
        r, a, held = found["tuned_range_noise"], found["tuned_azimuth_noise"], found["tuning_gain_held_out"]
        print(f"  {low:2d} to {high:2d} NM  n {r.n:6d}  range {r.value:.2f} [{r.low:.2f}, {r.high:.2f}] m  "
              f"azimuth {np.degrees(a.value):.4f} [{np.degrees(a.low):.4f}, {np.degrees(a.high):.4f}] deg  "
              f"held out {held.value:+.3f} [{held.low:+.3f}, {held.high:+.3f}] per update  ({seconds:.0f} s); "
            f"the same plots by scatter {by_scatter[0]:.2f} m, {np.degrees(by_scatter[1]):.4f} deg")  # fmt: skip
        print("    " + ", ".join(f"{q.removeprefix('tuned_')} {r.value:.3g}{'*' * ('at-floor' in r.flags)}"
              for q, r in found.items() if q.startswith("tuned_") and not q.endswith("h_noise")))  # fmt: skip


def compared(trial: Trial, name: str) -> None:
    """The three filters on the same plots."""
    start = time.perf_counter()
    result = rangeeval.replay(trial, filter="imm", compare=True)
    print(f"{name}: filters compared in {time.perf_counter() - start:.1f} s")
    for r in result.rows:
        if r.variable is None and r.track_id is None and r.group and r.quantity in (
            "nis_ratio", "log_likelihood_per_update", "position_rms", "velocity_rms", "log_likelihood_difference",
        ):  # fmt: skip
            print(f"  {r.group:22s} {r.quantity:28s} {r.value:9.3f} [{r.low:.3f}, {r.high:.3f}]  n {r.n}")


def flight(path: Path) -> dict[str, object]:
    """A truth log's columns from a recorded flight."""
    if path.suffix == ".csv":
        rows = np.genfromtxt(path, delimiter=",", names=True, usecols=(1, 2, 3, 4))
        t, lat, lon, up = (rows[n] for n in rows.dtype.names)
        name = "UAV"
    else:
        data = json.loads(gzip.decompress(path.read_bytes()))
        fields = ("timestamp", "latitude", "longitude", "altitude")
        t, lat, lon, up = (np.array([np.nan if r.get(k) is None else r[k] for r in data], float) for k in fields)
        t, up, name = (t - t[0]) / 1e3, up * 0.3048, str(data[0]["icao24"])
    return {"time_s": t, "target_id": [name] * len(t), "latitude_deg": lat, "longitude_deg": lon, "height_m": up}


def watched(path: Path, away_deg: float) -> None:
    """A made-up radar beside a real flight: what cleaning left of the flight, and how the filters follow it."""
    true = flight(path)
    lat, lon = float(np.nanmedian(true["latitude_deg"])) - away_deg, float(np.nanmedian(true["longitude_deg"]))
    own = {"range_sigma_m": NOISE[0], "azimuth_sigma_deg": float(np.degrees(NOISE[1])),
           "elevation_sigma_deg": float(np.degrees(NOISE[2]))}  # fmt: skip
    flown_at = {"max_speed_m_s": FASTEST}
    settings = settings_from({"truth": flown_at, "site": {"latitude_deg": lat, "longitude_deg": lon}, "replay": own})
    bare = Trial(path.name, (log_of("truth", true, path.name),), settings)
    paths, problems = true_paths(bare)
    flown = next(iter(paths.values()))
    at = np.arange(flown.time_s[0], flown.time_s[-1], 2.0)
    position, _ = flown.at(at)
    there = np.isfinite(position[:, 0])
    z = polar(position[there]) + np.random.default_rng(1).normal(size=(int(there.sum()), 3)) * NOISE
    plots = {"time_s": at[there], "target_id": [flown.target] * len(z), "range_m": z[:, 0],
             "azimuth_rad": np.mod(z[:, 1], 2 * np.pi), "elevation_rad": z[:, 2]}  # fmt: skip
    print(f"{path.name}: {len(true['time_s'])} positions, {len(flown.time_s)} usable; "
          + "; ".join(f"{p.count} {p.reason.split(':')[0]}" for p in problems))  # fmt: skip
    compared(Trial(path.name, (log_of("plots", plots), *bare.logs), settings), path.name)


def main() -> None:
    """Everything, in one run."""
    folder = Path(sys.argv[1])
    with tempfile.TemporaryDirectory() as work:
        trial = recorded(folder, Path(work))
        scatter(trial)
        print("noise by the likelihood (* at its floor):")
        tuned(trial)
        associated(trial)
        compared(trial, "recorded plots")
    watched(folder / "adsb-tracks" / "zero_gravity.json.gz", 0.5)
    watched(folder / "adsb-tracks" / "noisy_time_issue.json.gz", 0.5)
    watched(folder / "adsb-tracks" / "UAV_Rot.csv", 0.05)


if __name__ == "__main__":
    main()
