"""Five targets cross before 15 sensors, on a line or on an arc of a cylinder: the bearing paper's scenario.

What the paper does not give is chosen: paths, steps, signals, starts (docs/explanation/bearing.md). `bearing_table`
repeats it over many runs with every method; `crossing_table` sees what becomes of two targets that cross, or that meet
and part again.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from rangeeval.arrays.assessment import bearing_difference, outcomes
from rangeeval.arrays.bounds import posterior_crb
from rangeeval.arrays.geometry import ArrayGeometry, cylinder, line
from rangeeval.arrays.manifold import steering
from rangeeval.arrays.options import JointOptions, PastOptions
from rangeeval.arrays.spectra import covariance, music
from rangeeval.arrays.tracker import track
from rangeeval.errors import SettingsError
from rangeeval.scenarios.files import column, write_csv

Array = NDArray[np.float64]
Snapshots = NDArray[np.complex128]

SPEED_M_S = 1500.0
FREQUENCY_HZ = 6250.0  # a wavelength of 0.24 m in sea water
SENSORS = 15
STEPS = 1000
INTERVAL_S = 0.1
START_BEARING_RAD, START_RATE_RAD = math.radians(0.5), 1e-4
_STARTS = 9  # the stream of the starts, apart from that of the snapshots
_TRUTH_EVERY = 10  # snapshots between two rows of the truth log: the bearings change evenly

_TRIAL_TOML = """\
# A simulated trial: seed {seed}. Five targets pass before {sensors} sensors, {array}, at {snr:g} dB.
[trial]
name = {name}
date = 2026-05-14
radar = "Simulated array"
handling = "UNCLASSIFIED - SIMULATED DATA"

[array]
targets = 5
start_bearing_deg = {start}  # true ones, with an error of 0.5 deg
{sector}"""


def paths(steps: int = STEPS) -> Array:
    """True bearings (steps, 5) in rad: each changes evenly, and four of them cross another."""
    s = np.arange(steps)[:, None] / steps
    return np.deg2rad(np.array([-40.0, -15.0, 5.0, 30.0, 45.0]) + np.array([60.0, -20.0, 0.0, -55.0, -34.5]) * s)


def geometry_of(array: str) -> ArrayGeometry:
    """The paper's 15 sensors: "line", half a wavelength apart; "cylinder", 12 degrees apart at 1 m."""
    if array == "line":
        return line(SENSORS, 0.12, FREQUENCY_HZ, SPEED_M_S)
    if array == "cylinder":
        staves = np.deg2rad(np.arange(-84.0, 85.0, 12.0))
        return cylinder(1.0, staves, FREQUENCY_HZ, SPEED_M_S, sector_rad=(-math.pi / 2, math.pi / 2))
    raise SettingsError(f"the array is '{array}'; known: line, cylinder")


def receive(truth_rad: Array, geometry: ArrayGeometry, snr_db: float, rng: np.random.Generator) -> Snapshots:
    """Snapshots (steps, sensors) of independent Gaussian sources of power 1 at every sensor, and white noise."""
    steps, targets = truth_rad.shape
    sources = rng.standard_normal((steps, targets)) + 1j * rng.standard_normal((steps, targets))
    noise = rng.standard_normal((steps, geometry.sensors)) + 1j * rng.standard_normal((steps, geometry.sensors))
    response = steering(geometry, truth_rad.ravel())[0].reshape(geometry.sensors, steps, targets)
    found: Snapshots = np.einsum("mkn,kn->km", response, sources) + 10.0 ** (-snr_db / 20) * noise
    return found / math.sqrt(2.0)


def starts(truth_rad: Array, run: int) -> tuple[Array, Array]:
    """Bearings and rates that a tracker starts a run from: the true ones and an error."""
    rng = np.random.default_rng([_STARTS, run])
    targets = truth_rad.shape[1]
    bearing = truth_rad[0] + START_BEARING_RAD * rng.standard_normal(targets)
    return bearing, truth_rad[1] - truth_rad[0] + START_RATE_RAD * rng.standard_normal(targets)


def simulate_bearing(
    directory: str | os.PathLike[str],
    *,
    seed: int,
    array: str = "cylinder",
    snr_db: float = 5.0,
    steps: int = STEPS,
    name: str = "Simulated crossing of five targets",
) -> list[Path]:
    """Write a trial of the scenario: snapshots as HDF5, the truth, trial.toml. The same seed gives the same bytes.

    Parameters
    ----------
    array : "line" or "cylinder".
    snr_db : of one source at one sensor.
    steps : snapshots, 0.1 s apart.
    """
    if steps < 2 * _TRUTH_EVERY:
        raise SettingsError(f"{steps} snapshots; give {2 * _TRUTH_EVERY} or more")
    geometry, truth = geometry_of(array), paths(steps)
    snapshots = receive(truth, geometry, snr_db, np.random.default_rng([seed, 0]))
    time = INTERVAL_S * np.arange(steps)
    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    recorded = folder / "snapshots.h5"
    with h5py.File(recorded, "w") as file:
        file["samples"] = snapshots.astype(np.complex64)
        file["time_s"] = time
        file["sensor_position_m"] = np.round(geometry.sensor_position_m[:, :2], 9)
        file["frequency_hz"] = FREQUENCY_HZ
        file["propagation_speed_m_s"] = SPEED_M_S
    kept = np.unique(np.append(np.arange(0, steps, _TRUTH_EVERY), steps - 1))
    targets = truth.shape[1]
    surveyed = {
        "time_s": column(np.repeat(time[kept], targets), 2),
        "target_id": [f"T{n + 1:03d}" for n in range(targets)] * kept.size,
        "bearing_rad": column(truth[kept].ravel(), 6),
    }
    low, high = np.rad2deg(geometry.sector)
    toml = folder / "trial.toml"
    toml.write_text(
        _TRIAL_TOML.format(
            seed=seed, sensors=SENSORS, snr=snr_db, name=json.dumps(name, ensure_ascii=False),
            array="half a wavelength apart in a line" if array == "line" else "on an arc of 1 m radius",
            start=np.round(np.rad2deg(starts(truth, seed)[0]), 3).tolist(),
            sector="" if array == "line" else f"sector_deg = [{low:g}, {high:g}]\n",
        ),
        encoding="utf-8",
    )  # fmt: skip
    return [recorded, write_csv(folder / "truth.csv", surveyed), toml]


Tracker = Callable[[ArrayGeometry, Snapshots, Array, Array], Array]


@dataclass(frozen=True)
class Row:
    """Mean-square errors of one method, deg^2: line, then cylinder, at every SNR; standard errors (NaN: none)."""

    method: str
    mse: tuple[float, ...]
    error: tuple[float, ...]


ARRAYS = ("line", "cylinder")
SNRS_DB = (0.0, 5.0, 10.0)
PUBLISHED = PastOptions()
LAG = PastOptions(lag_compensation=True)
SOFT = PastOptions(process_variance=1e-9, lag_compensation=True, soft_coasting=1000.0, source_power=1.0)


def _with(options: PastOptions | JointOptions) -> Tracker:
    method = "joint-ml" if isinstance(options, JointOptions) else "modified"

    def follow(geometry: ArrayGeometry, x: Snapshots, bearing: Array, rate: Array) -> Array:
        return track(method, geometry, x, bearing, rate, options).at(np.arange(len(x), dtype=np.float64))

    return follow


def music_and_filter(
    geometry: ArrayGeometry, x: Snapshots, bearing: Array, rate: Array, *, block: int = 20, sigma: float = 0.012
) -> Array:
    """What one would do without these methods: MUSIC per block, nearest targets, a Kalman filter each."""
    n = bearing.size
    state, cov = np.stack([bearing, rate]), np.zeros((2, 2, n))
    cov[0, 0], cov[1, 1] = START_BEARING_RAD**2, START_RATE_RAD**2
    found = np.empty((len(x), n))
    ahead = (block - 1) / 2
    for first in range(0, len(x) - block + 1, block):
        move, q = np.array([[1.0, ahead], [0.0, 1.0]]), 1e-10 * ahead
        state = move @ state
        cov = np.einsum("ab,bcn,dc->adn", move, cov, move)
        cov += q * np.array([[ahead**2 / 3, ahead / 2], [ahead / 2, 1.0]])[:, :, None]
        ahead = float(block)
        measured = music(geometry, covariance(x[first : first + block]), n)
        off = bearing_difference(measured[:, None], state[0][None, :])
        for row, column_ in zip(*linear_sum_assignment(np.abs(off)), strict=True):
            s = cov[0, 0, column_] + sigma**2
            if off[row, column_] ** 2 > 4.0 * s:  # no bearing of this target
                continue
            gain = cov[:, 0, column_] / s
            state[:, column_] += gain * off[row, column_]
            cov[:, :, column_] -= np.outer(gain, cov[0, :, column_])
        steps = np.arange(block)[:, None] - (block - 1) / 2
        found[first : first + block] = state[0] + steps * state[1]
    return found


METHODS: tuple[tuple[str, Tracker], ...] = (
    ("ryu (line), modified (cylinder)", _with(PUBLISHED)),
    ("  with lag compensation", _with(LAG)),
    ("  and gain x10, soft coasting", _with(SOFT)),
    ("MUSIC per 20 and Kalman filters", music_and_filter),
    ("joint-ml, blocks of 10", _with(JointOptions())),
)


def bearing_table(
    runs: int = 100, seed: int = 1, *, progress: Callable[[str], None] = lambda _: None, steps: int = STEPS
) -> list[Row]:
    """Mean-square error over all targets and snapshots, every method on the same snapshots; and the bounds."""
    truth = paths(steps)
    square = np.empty((len(METHODS), len(ARRAYS) * len(SNRS_DB), runs))
    bounds = np.empty((2, square.shape[1]))
    for column_, (array, snr) in enumerate((a, s) for a in ARRAYS for s in SNRS_DB):
        progress(f"{array}, {snr:g} dB")
        geometry = geometry_of(array)
        for run in range(runs):
            x = receive(truth, geometry, snr, np.random.default_rng([seed, run]))
            bearing, rate = starts(truth, run)
            for row, (_, follow) in enumerate(METHODS):
                off = bearing_difference(follow(geometry, x, bearing, rate), truth)
                square[row, column_, run] = np.mean(np.rad2deg(off) ** 2)
        for row, q in enumerate((1e-10, 0.0)):
            variance = posterior_crb(
                geometry, truth, np.ones(5), 10.0 ** (-snr / 10), process_variance=q,
                start_bearing_sigma_rad=START_BEARING_RAD, start_rate_sigma_rad=START_RATE_RAD,
            )  # fmt: skip
            bounds[row, column_] = np.rad2deg(1.0) ** 2 * variance.mean()
    mean, error = square.mean(axis=2), square.std(axis=2, ddof=1) / math.sqrt(runs)
    rows = [Row(name, tuple(m), tuple(e)) for (name, _), m, e in zip(METHODS, mean, error, strict=True)]
    nothing = (math.nan,) * square.shape[1]
    names = ("posterior bound, q = 1e-10", "posterior bound, q = 0")
    return [*rows, *(Row(name, tuple(b), nothing) for name, b in zip(names, bounds, strict=True))]


def table_text(rows: list[Row], runs: int) -> str:
    """The table, each mean with its standard error."""
    width = max(len(row.method) for row in rows)
    title = f"Mean-square error of the bearings (deg^2) over {runs} runs, +- its standard error"
    head = " " * width + "".join(f"{f'{array} {snr:g} dB':>19}" for array in ARRAYS for snr in SNRS_DB)
    lines = [title, head]
    for row in rows:
        cells = (
            f"{m:>19.4f}" if math.isnan(e) else f"{f'{m:.4f} +-{e:.4f}':>19}"
            for m, e in zip(row.mse, row.error, strict=True)
        )
        lines.append(f"{row.method:<{width}}" + "".join(cells))
    return "\n".join(lines) + "\n"


RATES_DEG = (0.02, 0.05, 0.1, 0.2, 0.4)
NEAREST_DEG = (1.0, 2.0, 3.0, 4.0)
_APART_DEG = 12.0
CROSSING_METHODS: tuple[tuple[str, PastOptions | JointOptions], ...] = (
    ("ryu, q/r 1e-8", PastOptions(process_variance=1e-11)),
    ("ryu, q/r 1e-7 (as published)", PUBLISHED),
    ("ryu, q/r 1e-6", PastOptions(process_variance=1e-9)),
    ("ryu, q/r 1e-5", PastOptions(process_variance=1e-8)),
    ("ryu, lag, soft coasting, q/r 1e-6", SOFT),
    ("joint-ml, q 1e-10", JointOptions()),
    ("joint-ml, q 1e-8", JointOptions(process_variance=1e-8)),
)


def crossing_paths(rate_deg: float) -> Array:
    """Two targets that cross at broadside at this relative rate, 12 deg apart at either end."""
    half = 0.5 * rate_deg * np.arange(round(2 * _APART_DEG / rate_deg))
    found: Array = np.deg2rad(np.column_stack([half - _APART_DEG / 2, _APART_DEG / 2 - half]))
    return found


def bounce_paths(nearest_deg: float, rate_deg: float = 0.1) -> Array:
    """Two targets that approach to a least separation and part again, 12 deg apart at either end."""
    steps = np.arange(round(2 * (_APART_DEG - nearest_deg) / rate_deg))
    apart = nearest_deg + rate_deg * np.abs(steps - (steps.size - 1) / 2)
    found: Array = np.deg2rad(np.column_stack([-apart / 2, apart / 2]))
    return found


def what_becomes(
    truth: Array, options: PastOptions | JointOptions, runs: int, seed: int, snr_db: float = 5.0
) -> dict[str, float]:
    """Share of the runs held, swapped and lost on the line array."""
    geometry, follow = geometry_of("line"), _with(options)
    tracks = []
    for run in range(runs):
        x = receive(truth, geometry, snr_db, np.random.default_rng([seed, run]))
        tracks.append(follow(geometry, x, *starts(truth, run)))
    return outcomes(np.array(tracks), truth)


def crossing_text(runs: int = 60, seed: int = 1, *, progress: Callable[[str], None] = lambda _: None) -> str:
    """Shares of runs held through a crossing, and swapped in a bounce, as two tables."""
    width = max(len(name) for name, _ in CROSSING_METHODS)
    lines = [
        f"Two targets cross, line array, 5 dB, {runs} runs: share held (swapped) by relative rate, deg a snapshot",
        " " * width + "".join(f"{rate:>14g}" for rate in RATES_DEG),
    ]
    for name, options in CROSSING_METHODS:
        progress(name)
        shares = [what_becomes(crossing_paths(rate), options, runs, seed) for rate in RATES_DEG]
        cells = (f"{held['held']:.2f} ({held['swapped']:.2f})" for held in shares)
        lines.append(f"{name:<{width}}" + "".join(f"{cell:>14}" for cell in cells))
    lines += [
        "",
        f"Two targets meet and part (0.1 deg a snapshot), {runs} runs: share swapped (lost) by least distance, deg",
        " " * width + "".join(f"{nearest:>14g}" for nearest in NEAREST_DEG),
    ]
    bouncing = (CROSSING_METHODS[1], CROSSING_METHODS[4], CROSSING_METHODS[6])
    for name, options in bouncing:
        progress(name)
        shares = [what_becomes(bounce_paths(nearest), options, runs, seed) for nearest in NEAREST_DEG]
        cells = (f"{held['swapped']:.2f} ({held['lost']:.2f})" for held in shares)
        lines.append(f"{name:<{width}}" + "".join(f"{cell:>14}" for cell in cells))
    return "\n".join(lines) + "\n"


__all__ = [
    "ARRAYS", "Row", "bearing_table", "bounce_paths", "crossing_paths", "crossing_text", "geometry_of", "paths",
    "receive", "simulate_bearing", "starts", "table_text", "what_becomes",
]  # fmt: skip
