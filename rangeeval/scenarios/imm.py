"""The source paper's manoeuvring target: as a trial with known answers, and as its Monte Carlo comparison of filters.

A fighter flies in at 400 m/s and turns twice, at 60 and 40 m/s^2; a radar measures it every second with 30 m and 3
mrad.

References
----------
Jung (1999), Performance evaluation of tracking model for a 3D maneuvering target; times, positions and turns as there,
what it leaves open as in docs/explanation/imm.md.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rangeeval.angles import wrapped
from rangeeval.scenarios.files import column, write_csv
from rangeeval.stats.consistency import average_bounds, normalised_squares
from rangeeval.tracking import polar
from rangeeval.tracking.filters import PAPER_IMM, TEXTBOOK_IMM3, TUNED_IMM, AlphaBeta, AnyFilter, Filter, Model, kalman
from rangeeval.tracking.measurements import Measurements, azimuth_to_log
from rangeeval.tracking.motion import noise_matrix, transition
from rangeeval.tracking.runs import Smoothed, run_many, smooth_many
from rangeeval.tracking.starting import three_point

FloatArray = NDArray[np.float64]

SIGMA = np.array([30.0, 0.003, 0.003])  # m, rad, rad
START_M = np.array([21689.0, 14840.0, 400.0])  # east, north, up at t = 0
VELOCITY_M_S = np.array([-8.3, -399.9, 0.0])
FIRST_S, LAST_S = -2, 100
# End of each segment (s) and its turn rate about the vertical (rad/s, positive to the left).
SPEED_M_S = float(np.linalg.norm(VELOCITY_M_S))
SEGMENTS = ((30, 0.0), (45, -60.0 / SPEED_M_S), (65, 0.0), (80, 40.0 / SPEED_M_S), (100, 0.0))

ASSESSED = slice(5, 97)  # t = 5 to 96 s: the start is over, the overhead pass has not begun
LEGS = {"CV1": slice(5, 31), "T1": slice(31, 46), "CV2": slice(46, 66), "T2": slice(66, 81), "CV3": slice(81, 97)}
SETTLING_S = 10  # after a start or a turn, before the consistency of straight flight is judged
SEED = 20240

_TRIAL_TOML = """\
# A simulated trial: seed {seed}. A target at 400 m/s turns right at 60 m/s^2 (30 to 45 s) and left at 40 m/s^2 (65 to
# 80 s). Its last three seconds are a pass almost overhead. Truth: range sigma 30 m, azimuth and elevation sigma 3 mrad.
[trial]
name = "Simulated manoeuvring target"
date = 2026-05-14
radar = "Simulated three-dimensional radar"
handling = "UNCLASSIFIED - SIMULATED DATA"

[site]
latitude_deg = 36.42
longitude_deg = 127.39
height_m = 110.0

[radar]
update_interval_s = 1.0

[bins]
variable = "range"
width = 5000.0
start = 0.0
min_samples = 10
"""


@dataclass(frozen=True)
class Flight:
    """The true motion at each time (n): position, velocity (ENU), and the turn rate vector that led to it."""

    time_s: FloatArray
    position: FloatArray
    velocity: FloatArray
    turn_rate: FloatArray


def flight() -> Flight:
    """The paper's trajectory, exact, every second from two seconds before it begins (for the start of a track)."""
    time = np.arange(FIRST_S, LAST_S + 1, dtype=np.float64)
    states = np.empty((len(time), 9))
    states[0] = np.concatenate([START_M + FIRST_S * VELOCITY_M_S, VELOCITY_M_S, np.zeros(3)])
    for k in range(1, len(time)):
        states[k] = states[k - 1]
        states[k, 8] = next(rate for end, rate in SEGMENTS if time[k] <= end)
        states[k] = transition("ct", states[k], 1.0)[0]
    return Flight(time, states[:, :3], states[:, 3:6], states[:, 6:])


def measured(truth: Flight, *seed: int) -> FloatArray:
    """Range, azimuth, elevation (n, 3) of a flight with the radar's noise; the seed is a list of integers."""
    noise = np.random.default_rng(list(seed)).standard_normal((len(truth.time_s), 3)) * SIGMA
    z: FloatArray = polar.of_position(truth.position) + noise
    return z


def simulate_imm(directory: str | os.PathLike[str], *, seed: int) -> list[Path]:
    """Write a trial of the paper's flight: plots, truth, trial.toml. The same seed gives the same bytes."""
    truth = flight()
    z = measured(truth, SEED, seed)
    folder = Path(directory)
    folder.mkdir(parents=True, exist_ok=True)
    time = column(truth.time_s, 1)
    name = ["1"] * len(time)
    plots = write_csv(
        folder / "plots.csv",
        {
            "time_s": time,
            "target_id": name,
            "range_m": column(z[:, 0], 2),
            "azimuth_deg": column(np.rad2deg(azimuth_to_log(z[:, 1])), 5),
            "elevation_deg": column(np.rad2deg(z[:, 2]), 5),
        },
    )
    true = write_csv(
        folder / "truth.csv",
        {
            "time_s": time,
            "target_id": name,
            "north_m": column(truth.position[:, 1], 3),
            "up_m": column(truth.position[:, 2], 3),
            "east_m": column(truth.position[:, 0], 3),
        },
    )
    toml = folder / "trial.toml"
    toml.write_text(_TRIAL_TOML.format(seed=seed), encoding="utf-8")
    return [plots, true, toml]


@dataclass(frozen=True)
class Row:
    """One filter in the comparison; lengths in m, velocity in m/s; NaN where a filter has no such number.

    `xyz`, `rms`: of each axis and of all, over runs and t = 5..96 s; `steady` over the last five samples of a leg,
    `peak` the greatest over time from the onset of a turn to 4 s after it. `nees`, `nis`: per degree of freedom, over
    all and by leg (straight legs once settled). `onset_s`, `end_s`: of the first turn, mean time until the probability
    of straight flight has crossed one half.
    """

    name: str
    xyz: FloatArray
    rms: float
    standard_error: float
    velocity: float
    predicted: float
    steady: dict[str, FloatArray]
    peak: dict[str, FloatArray]
    nees: dict[str, float]
    nis: float
    onset_s: float
    end_s: float


def filters() -> dict[str, AnyFilter]:
    """The filters of the comparison, by the name of their row."""
    return {
        "IMM-2, paper's values": PAPER_IMM,
        "IMM-3 CV/CA/CA, textbook": TEXTBOOK_IMM3,
        **{
            f"EKF CV {name}": replace(kalman("cv", sigma), noise="discrete")
            for name, sigma in (("sqrt 10", math.sqrt(10.0)), ("20", 20.0), ("32.5 (ML)", 32.5), ("40", 40.0))
        },
        "alpha-beta 0.556, 0.222": AlphaBeta(alpha=(5 / 9,) * 3, beta=(2 / 9,) * 3),
        "IMM-2, ML-tuned": TUNED_IMM,
        "IMM-3, ML-tuned": TUNED_IMM3,
    }


# Tuned on forty flights of other seeds ([20241, r]), the first model held at 1 m/s^2: the truth is exactly straight,
# and would have no noise at all.
TUNED_IMM3 = Filter(
    models=(Model("cv", 1.0), Model("ca", 0.01), Model("ca", 13.56)),
    transition=((0.98645, 0.0, 0.01355), (0.0, 0.75583, 0.24417), (0.06249, 0.0625, 0.87501)),
    noise="discrete",
    padding="zero",
)


def compare_filters(runs: int = 100) -> list[Row]:
    """Run every filter over the same noisy flights: run r has the random numbers of seed [20240, r]."""
    truth = flight()
    tracks = [Measurements.of(truth.time_s, measured(truth, SEED, r), SIGMA) for r in range(runs)]
    rows = [_filtered(name, spec, tracks, truth) for name, spec in filters().items()]
    rows.append(_clairvoyant(tracks, truth))
    for name, spec in (
        ("IMM-2, ML-tuned, smoothed", TUNED_IMM),
        ("IMM-2, paper's, smoothed", PAPER_IMM),
        ("EKF CV 32.5, smoothed (RTS)", replace(kalman("cv", 32.5), noise="discrete")),
    ):
        rows.append(_smoothed(name, smooth_many(run_many(spec, tracks, detail=True)), truth))
    return rows


def _filtered(name: str, spec: AnyFilter, tracks: list[Measurements], truth: Flight) -> Row:
    found = run_many(spec, tracks)
    probability = np.stack([run.mode_probability[2:, 0] for run in found])
    return _row(
        name,
        truth,
        np.stack([run.state[2:] for run in found]),
        np.stack([run.covariance[2:] for run in found]),
        np.stack([run.predicted_state[2:, :3] for run in found]),
        np.stack([run.nis[2:] for run in found]) if isinstance(spec, Filter) else None,
        probability if isinstance(spec, Filter) and len(spec.models) > 1 else None,
    )


def _smoothed(name: str, found: list[Smoothed], truth: Flight) -> Row:
    return _row(
        name, truth, np.stack([one.state[2:] for one in found]), np.stack([one.covariance[2:] for one in found])
    )


def _clairvoyant(tracks: list[Measurements], truth: Flight) -> Row:
    """A Kalman filter that is told the turn rate at each moment: what no filter without it can beat."""
    runs, steps = len(tracks), len(truth.time_s) - 2
    state, covariance = np.empty((runs, steps, 6)), np.empty((runs, steps, 6, 6))
    predicted = np.full((runs, steps, 3), np.nan)
    q, noise = noise_matrix("cv", 1.0, 0.0, 1.0)[:6, :6], np.diag(SIGMA**2)
    for i, track in enumerate(tracks):
        x9, p9 = three_point(track.time_s[:3], track.z[:3], SIGMA)
        x, p = x9[:6], p9[:6, :6]
        for k in range(steps):
            if k > 0:
                moved, jacobian = transition("ct", np.concatenate([x, truth.turn_rate[k + 2]]), 1.0)
                x, p = moved[:6], jacobian[:6, :6] @ p @ jacobian[:6, :6].T + q
                predicted[i, k] = x[:3]
                h = np.hstack([polar.jacobian(x[:3]), np.zeros((3, 3))])
                nu = track.z[k + 2] - polar.of_position(x[:3])
                nu[1] = wrapped(nu[1])
                gain = np.linalg.solve(h @ p @ h.T + noise, h @ p).T
                left = np.eye(6) - gain @ h
                x, p = x + gain @ nu, left @ p @ left.T + gain @ noise @ gain.T
            state[i, k], covariance[i, k] = x, p
    return _row("told the turn rate", truth, state, covariance, predicted)


def _row(
    name: str,
    truth: Flight,
    state: FloatArray,
    covariance: FloatArray,
    predicted: FloatArray | None = None,
    nis: FloatArray | None = None,
    straight: FloatArray | None = None,
) -> Row:
    position, velocity = truth.position[2:], truth.velocity[2:]
    error = state - np.hstack([position, velocity])
    each = np.sqrt(np.mean(error[:, :, :3] ** 2, 0))  # (times, 3)
    squares = np.sum(error[:, ASSESSED, :3] ** 2, 2)  # (runs, times)
    rms = float(np.sqrt(squares.mean()))
    influence = squares.mean(1) / (2 * rms)  # of each run on the RMS
    nees = normalised_squares(error, covariance) / 6
    ahead = math.nan
    if predicted is not None:
        ahead = float(np.sqrt(np.mean(np.sum((predicted - position)[:, ASSESSED] ** 2, 2))))
    settled = {leg: slice(w.start + SETTLING_S - 1, w.stop) if leg[0] == "C" else w for leg, w in LEGS.items()}
    settled["CV1"] = slice(SETTLING_S, LEGS["CV1"].stop)
    return Row(
        name=name,
        xyz=np.sqrt(np.mean(error[:, ASSESSED, :3] ** 2, (0, 1))),
        rms=rms,
        standard_error=float(influence.std(ddof=1) / math.sqrt(len(state))),
        velocity=float(np.sqrt(np.mean(np.sum(error[:, ASSESSED, 3:] ** 2, 2)))),
        predicted=ahead,
        steady={leg: each[where.stop - 5 : where.stop].mean(0) for leg, where in LEGS.items()},
        peak={leg: each[where.start - 1 : where.stop + 4].max(0) for leg, where in LEGS.items() if leg[0] == "T"},
        nees={leg: float(nees[:, where].mean()) for leg, where in {"all": ASSESSED, **settled}.items()},
        nis=math.nan if nis is None else float(nis[:, ASSESSED].mean()) / 3,
        onset_s=math.nan if straight is None else _crossing(straight, SEGMENTS[0][0], below=True),
        end_s=math.nan if straight is None else _crossing(straight, SEGMENTS[1][0], below=False),
    )


def _crossing(straight: FloatArray, at: int, *, below: bool) -> float:
    """Mean seconds after a change of motion at `at` until the probability of straight flight has crossed one half."""
    part = straight[:, at + 1 : at + 16]
    crossed = part < 0.5 if below else part > 0.5
    return float(np.mean([np.argmax(row) + 1 for row in crossed if row.any()]))


def comparison_text(rows: list[Row], runs: int) -> str:
    """The comparison as plain tables."""

    def three(values: FloatArray) -> str:
        return "/".join(f"{v:.0f}" for v in values)

    def number(value: float, form: str) -> str:
        return "-" if math.isnan(value) else f"{value:{form}}"

    lines = [
        f"{runs} runs, t = 5 to 96 s. RMS of position in m (s.e.: standard error of the 3-D value), velocity in m/s,",
        "position predicted one second ahead in m.",
        f"{'filter':28s}{'x/y/z':>16s}{'3-D':>8s}{'s.e.':>6s}{'vel.':>7s}{'pred.':>7s}",
    ]
    for r in rows:
        axes = "/".join(f"{v:.1f}" for v in r.xyz)
        lines.append(
            f"{r.name:28s}{axes:>16s}{r.rms:8.1f}{r.standard_error:6.2f}{r.velocity:7.1f}"
            f"{number(r.predicted, '.1f'):>7s}"
        )
    lines += ["", "x/y/z in m: mean of the last five samples of each leg, and greatest in each turn (to 4 s after it)."]
    heads = [*LEGS, "peak T1", "peak T2"]
    lines.append(f"{'filter':28s}" + "".join(f"{h:>13s}" for h in heads))
    for r in rows:
        cells = [*r.steady.values(), *r.peak.values()]
        lines.append(f"{r.name:28s}" + "".join(f"{three(c):>13s}" for c in cells))
    low, high = average_bounds(6, runs)
    nis_low, nis_high = average_bounds(3, runs)
    lines += [
        "",
        f"Consistency per degree of freedom; a consistent filter has NEES in [{low:.3f}, {high:.3f}] and NIS in "
        f"[{nis_low:.3f}, {nis_high:.3f}] (95 %).",
        "Straight legs from 10 s on. Onset, end: of the first turn, mean seconds until the probability of straight",
        "flight has crossed one half.",
        f"{'filter':28s}" + "".join(f"{h:>7s}" for h in ("all", *LEGS, "NIS", "onset", "end")),
    ]
    for r in rows:
        words = [number(v, ".2f") for v in (*r.nees.values(), r.nis)]
        words += [number(r.onset_s, ".1f"), number(r.end_s, ".1f")]
        lines.append(f"{r.name:28s}" + "".join(f"{w:>7s}" for w in words))
    return "\n".join(lines) + "\n"
