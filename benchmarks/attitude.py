"""How fast and in how much memory `attitude` reads a long tilt log, against what a user would otherwise do.

One run measures, on the same HDF5 file and in fresh processes: rangeeval's attitude; the numpy script a test engineer
would write (whole file in memory: pair tilt of both axes, mean, spectrum by one long transform, sine fit, no intervals,
no checks); and merely reading the same columns with h5py. It prints seconds, ratios and peak memory, and whether
repeated runs give the same bits.

    python benchmarks/attitude.py              # one hour at 1 kHz, two axes: 3.6 million samples
    python benchmarks/attitude.py --hours 4
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

import h5py
import numpy as np
from side_by_side import READ, measure, same_bits

COLUMNS = (
    "time_s", "upper_x_accel_m_s2", "lower_x_accel_m_s2", "upper_z_accel_m_s2", "lower_z_accel_m_s2",
)  # fmt: skip
RATE = 1000
PIECE = 1_000_000
G = 9.80665

TOML = """
[attitude]
radius_upper_m = 5.0
radius_lower_m = 1.0
gravity_m_s2 = 9.80665
"""


def make(path: Path, samples: int) -> None:
    """A radar that rocks at 0.8 Hz with 0.1 degree of sensor noise, numbers with the digits logs have."""
    rng = np.random.default_rng(1)
    w = 2 * np.pi * 0.8
    with h5py.File(path, "w") as file:
        options = {"chunks": (65_536,), "compression": "gzip", "compression_opts": 1, "fletcher32": True}
        sets = {name: file.create_dataset(name, (samples,), "f8", **options) for name in COLUMNS}
        for start in range(0, samples, PIECE):
            n = min(PIECE, samples - start)
            t = np.arange(start, start + n) / RATE
            swing = np.sin(w * t)
            sets["time_s"][start : start + n] = t
            for axis, static, dynamic in (("x", 3.0, 0.2), ("z", 2.0, 0.3)):
                alpha = np.deg2rad(static + dynamic * swing)
                for place, radius in (("upper", 5.0), ("lower", 1.0)):
                    force = G * np.sin(alpha) - radius * np.deg2rad(dynamic) * w**2 * swing
                    noisy = force + 0.0171 * rng.standard_normal(n)
                    sets[f"{place}_{axis}_accel_m_s2"][start : start + n] = np.round(noisy, 5)


RANGEEVAL = """
import sys, rangeeval
from pathlib import Path
result = rangeeval.attitude(rangeeval.open_trial(Path(sys.argv[1]).parent))
sys.stdout.write(result.to_json(series=True))
"""

NUMPY = """
import sys, h5py, numpy as np
with h5py.File(sys.argv[1]) as f:
    d = {name: f[name][:] for name in f}
g, ru, rl = 9.80665, 5.0, 1.0
t = d["time_s"]
dt = np.median(np.diff(t))
for axis in ("x", "z"):
    u, l = d[f"upper_{axis}_accel_m_s2"], d[f"lower_{axis}_accel_m_s2"]
    alpha = np.arcsin((ru * l - rl * u) / (g * (ru - rl)))
    single = np.arcsin(u / g)
    power = np.abs(np.fft.rfft((alpha - alpha.mean()) * np.hanning(alpha.size)))**2
    f0 = np.fft.rfftfreq(alpha.size, dt)[np.argmax(power[1:]) + 1]
    A = np.column_stack([np.sin(2*np.pi*f0*t), np.cos(2*np.pi*f0*t), np.ones_like(t)])
    c, *_ = np.linalg.lstsq(A, alpha, rcond=None)
    print(axis, c[2], np.hypot(c[0], c[1]), f0, np.abs(single - alpha).max(), (alpha - A @ c).std())
"""


def main() -> None:
    """Make the log, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    samples = round(options.hours * 3600 * RATE)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tilt.h5"
        make(path, samples)
        (Path(folder) / "trial.toml").write_text(TOML)
        print(f"{samples:,} samples, {len(COLUMNS)} columns, {path.stat().st_size / 2**20:.0f} MiB on disk")
        jobs = {"read the columns (h5py)": READ, "rangeeval attitude": RANGEEVAL, "plain numpy script": NUMPY}
        found = measure(jobs, "rangeeval attitude", path, options.repeats)
        print(f"{options.repeats} runs: {same_bits(found.digests)}")
        print(json.dumps(found.as_json()))


if __name__ == "__main__":
    main()
