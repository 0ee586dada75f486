"""How fast and in how much memory `accuracy` reads a long log, against what a user would otherwise do.

One run measures, on the same HDF5 file and in fresh processes: rangeeval's accuracy; the pandas group-by script a
test engineer would write (whole file in memory, the same sigmas, no intervals); and merely reading the same columns
with h5py. It prints seconds, ratios and peak memory, and whether repeated runs and other thread counts give the same
bits.

    python benchmarks/accuracy.py                       # 10 million updates
    python benchmarks/accuracy.py --updates 100000000   # and 100 million
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

import h5py
import numpy as np
from side_by_side import READ, digest, measure, run, same_bits

COLUMNS = (
    "time_s", "track_id", "range_residual_m", "y_residual_m", "z_residual_m", "range_predicted_m", "y_predicted_m",
    "z_predicted_m", "alpha_range", "beta_range", "alpha_y", "beta_y", "alpha_z", "beta_z",
)  # fmt: skip
TRACKS = 200
PIECE = 1_000_000


def make(path: Path, updates: int) -> None:
    """A log in time order, 200 tracks interleaved at 2 Hz, numbers with the digits logs have."""
    rng = np.random.default_rng(1)
    with h5py.File(path, "w") as file:
        options = {"chunks": (65_536,), "compression": "gzip", "compression_opts": 1, "fletcher32": True}
        sets = {
            name: file.create_dataset(name, (updates,), "i4" if name == "track_id" else "f8", **options)
            for name in COLUMNS
        }
        for start in range(0, updates, PIECE):
            n = min(PIECE, updates - start)
            row = np.arange(start, start + n)
            track = row % TRACKS
            turn = row // TRACKS
            time_s = turn * 0.5
            # Each track flies in and out between 100 and 10 km again and again.
            phase = (turn * 125.0 + track * 900.0) % 180_000.0
            distance = 10_000.0 + np.abs(90_000.0 - phase)
            noise = rng.standard_normal((3, n))
            sigma = 2.0 + distance * 1e-4
            alpha = np.round(0.3 + 0.4 * (distance / 100_000.0), 4)
            beta = np.round(2 * (2 - alpha) - 4 * np.sqrt(1 - alpha), 6)
            data = {
                "time_s": time_s, "track_id": track,
                "range_residual_m": np.round(noise[0] * sigma, 2),
                "y_residual_m": np.round(noise[1] * distance * 3e-4, 2),
                "z_residual_m": np.round(noise[2] * distance * 3e-4, 2),
                "range_predicted_m": np.round(distance, 1),
                "y_predicted_m": np.full(n, 2000.0), "z_predicted_m": np.round(distance * 0.1, 1),
            }  # fmt: skip
            for axis in ("range", "y", "z"):
                data[f"alpha_{axis}"], data[f"beta_{axis}"] = alpha, beta
            for name, values in data.items():
                sets[name][start : start + n] = values


RANGEEVAL = """
import sys, rangeeval
result = rangeeval.accuracy(rangeeval.open_trial(sys.argv[1]))
sys.stdout.write(result.to_json())
"""

PANDAS = """
import sys, h5py, numpy as np, pandas as pd
with h5py.File(sys.argv[1]) as f:
    d = pd.DataFrame({name: f[name][:] for name in f})
d["bin"] = np.floor(d.range_predicted_m / 5000.0)
out = {}
g = d.groupby("bin")
for axis in ("range", "y", "z"):
    a, b = d[f"alpha_{axis}"], d[f"beta_{axis}"]
    q = (2*a*a - 3*a*b + 2*b) / (2*(2*a + b))
    x = d[f"{axis}_residual_m"]
    d["_x2"] = q * (x - g[f"{axis}_residual_m"].transform("mean"))**2
    out[f"{axis}_sigma"] = (g["_x2"].sum() / (g.size() - 1))**0.5
    out[f"{axis}_residual"] = g[f"{axis}_residual_m"].agg(["count", "mean", "std", "min", "max", "median"])
    out[f"{axis}_gain"] = g[f"alpha_{axis}"].agg(["mean", "min", "max"])
print(pd.concat(out, axis=1).to_json())
"""


def main() -> None:
    """Make the log, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--updates", type=int, default=10_000_000)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument(
        "--no-pandas", action="store_true", help="leave out the script that needs the whole log in memory"
    )
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.h5"
        make(path, options.updates)
        print(f"{options.updates:,} updates, {len(COLUMNS)} columns, {path.stat().st_size / 2**20:.0f} MiB on disk")
        jobs = {"read the columns (h5py)": READ, "rangeeval accuracy": RANGEEVAL}
        if not options.no_pandas:
            jobs["pandas group-by"] = PANDAS
        found = measure(jobs, "rangeeval accuracy", path, options.repeats)
        digests = {*found.digests, *(digest(run(RANGEEVAL, path, threads)[2]) for threads in (1, 2, 3))}
        print(f"{options.repeats} runs and 1, 2, 3 threads: {same_bits(digests)}")
        print(json.dumps(found.as_json()))


if __name__ == "__main__":
    main()
