"""Microseconds per snapshot of the bearing trackers, against numpy and against MUSIC, root-MUSIC and ESPRIT per block.

CPU time of one core (set OMP_NUM_THREADS=1): 5 targets, 15 sensors on a line, 1000 snapshots a run, as the scenario of the paper. The compiled
kernels are called as the tool calls them, a run at a time, without the checks and flags around them; what these cost
is printed too. The numpy versions are the same equations, checked here against the kernels. A fresh cache shows what
compiling costs.

    python benchmarks/bearing.py
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time

import numpy as np

from rangeeval.arrays.joint import track_joint
from rangeeval.arrays.manifold import manifold, steering
from rangeeval.arrays.options import JointOptions, PastOptions
from rangeeval.arrays.past import track_past
from rangeeval.arrays.spectra import covariance, esprit, music, root_music
from rangeeval.arrays.tracker import track
from rangeeval.scenarios.bearing import geometry_of, paths, receive, starts

GEOMETRY, TRUTH = geometry_of("line"), paths()
ARRAY = manifold(GEOMETRY)
N, M, K = 5, 15, 1000
START = (np.deg2rad(0.5), 1e-4)
WORK = """
import numpy as np
from rangeeval.arrays.tracker import track
from rangeeval.scenarios.bearing import geometry_of
import time
x, g = np.random.default_rng(1).standard_normal((40, 15)) + 0j, geometry_of("line")
for method in ("ryu", "joint-ml"):
    began = time.process_time()
    track(method, g, x, np.array([-0.5, 0.0, 0.5]))
    print(f"{time.process_time() - began:.1f}", end=" ")
"""


def past_kernel(x: np.ndarray, bearing: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """The published chain, compiled."""
    out, coasted = np.empty((5, K, N)), np.empty((K, N), np.bool_)
    basis = np.ascontiguousarray(np.linalg.qr(steering(GEOMETRY, bearing)[0])[0])[None]
    track_past(ARRAY, x[:, None], np.ones(K, np.bool_), bearing.copy(), rate.copy(), *START, basis, 0.83, 1e-10, 1e-3,
               False, 0.0, 0.0, 0.0, out, coasted)  # fmt: skip
    return out[0]


def joint_kernel(x: np.ndarray, bearing: np.ndarray, rate: np.ndarray, block: int = 10) -> np.ndarray:
    """The joint tracker, compiled."""
    t = K // block
    out, powers, noises = np.empty((5, t, N)), np.empty((t, 1, N)), np.empty((t, 1))
    track_joint(ARRAY, x[:, None], np.ones(K, np.bool_), bearing.copy(), rate.copy(), *START, 0.0, 10, block, 2, 1e-10,
                np.deg2rad(1.5), False, 50.0, 60, np.ones((1, N)), np.ones(1), out, powers, noises, np.empty(t),
                np.empty(t, np.int64))  # fmt: skip
    return out[0]


def past_numpy(x: np.ndarray, bearing: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """The published chain in numpy."""
    w, p = np.linalg.qr(steering(GEOMETRY, bearing)[0])[0], np.eye(N, dtype=complex)
    theta, omega, found = bearing.copy(), rate.copy(), np.empty((K, N))
    c00, c01, c11 = (np.full(N, v) for v in (START[0] ** 2, 0.0, START[1] ** 2))
    along = np.pi * np.arange(M)[:, None]
    for k in range(K):
        theta = theta + omega
        c00, c01, c11 = c00 + 2 * c01 + c11 + 0.25e-10, c01 + c11 + 0.5e-10, c11 + 1e-10
        y = w.conj().T @ x[k]
        h = p @ y
        g = h / (0.83 + (y.conj() @ h).real)
        p = (p - np.outer(g, h.conj())) / 0.83
        p = 0.5 * (p + p.conj().T)
        w = w + np.outer(x[k] - w @ y, g.conj())
        a = np.exp(1j * along * np.sin(theta))
        d = 1j * along * np.cos(theta) * a
        both = np.hstack([a, d])
        left = both - w @ np.linalg.solve(w.conj().T @ w, w.conj().T @ both)
        change = -(d.conj() * left[:, :N]).sum(0).real / (d.conj() * left[:, N:]).sum(0).real
        g0, g1 = c00 / (c00 + 1e-3), c01 / (c00 + 1e-3)
        theta, omega = theta + g0 * change, omega + g1 * change
        c11, c01, c00 = c11 - g1 * c01, c01 - g0 * c01, c00 - g0 * c00
        found[k] = theta
    return found


def joint_numpy(x: np.ndarray, bearing: np.ndarray, rate: np.ndarray, block: int = 10) -> np.ndarray:
    """The joint tracker in numpy, R inverted; without the guard."""
    q = 1e-10
    one, zero = np.eye(N), np.zeros((N, N))
    s, cov = np.concatenate([bearing, rate]), np.diag(np.repeat(np.square(START), N))
    power, noise, ahead, found = np.ones(N), 1.0, (block - 1) / 2, np.empty((K // block, N))
    along = np.pi * np.arange(M)[:, None]
    for b in range(K // block):
        part = x[b * block : (b + 1) * block]
        e = part.T @ part.conj() / block
        f = np.block([[one, ahead * one], [zero, one]])
        cross = q * ahead**2 / 2 * one
        cov = f @ cov @ f.T + np.block([[q * (ahead**3 / 3 - ahead / 12) * one, cross], [cross, q * ahead * one]])
        s = f @ s
        ahead, before = float(block), s.copy()
        prior = np.linalg.inv(cov)
        for turn in range(3):
            a = np.exp(1j * along * np.sin(s[:N]))
            d = 1j * along * np.cos(s[:N]) * a
            inverse = np.linalg.inv((a * power) @ a.conj().T + noise * np.eye(M))
            ra = inverse @ a
            if turn == 2:
                break
            rd = inverse @ d
            ad = a.conj().T @ rd
            score = 2 * block * power * (np.diag(ad) - (ra.conj() * (e @ rd)).sum(0)).real
            info = prior.copy()
            info[:N, :N] += (
                2 * block * np.outer(power, power) * (ad * ad.T + (a.conj().T @ ra) * (d.conj().T @ rd).T).real
            )
            slope = prior @ (s - before)
            slope[:N] += score
            s = s - np.linalg.solve(info, slope)
        cov = np.linalg.inv(info)
        own = (a.conj() * ra).sum(0).real
        power = np.maximum(power + 0.2 * power**2 * ((ra.conj() * (e @ ra)).sum(0).real - own), 1e-6 * noise)
        noise += 0.2 * noise**2 * np.trace(inverse @ e @ inverse - inverse).real / M
        found[b] = s[:N]
    return found


def per_block(estimate: object, block: int) -> object:
    """An estimate of every block by itself."""

    def run(x: np.ndarray, *_: np.ndarray) -> None:
        for first in range(0, K - block + 1, block):
            estimate(GEOMETRY, covariance(x[first : first + block]), N)  # type: ignore[operator]

    return run


def best(work: object, runs: list[tuple[np.ndarray, ...]], repeats: int) -> float:
    """Microseconds per snapshot, mean over the runs of the quickest of a few rounds of each."""
    quickest = np.full(len(runs), np.inf)
    for _ in range(repeats):
        for i, run in enumerate(runs):
            began = time.process_time()
            work(*run)  # type: ignore[operator]
            quickest[i] = min(quickest[i], time.process_time() - began)
    return float(quickest.mean()) / K * 1e6


def main() -> None:
    """Print the comparison."""
    runs = [(receive(TRUTH, GEOMETRY, 5.0, np.random.default_rng([1, run])), *starts(TRUTH, run)) for run in range(20)]
    off = np.abs(past_kernel(*runs[0]) - past_numpy(*runs[0])).max()
    apart = np.abs(joint_kernel(*runs[0]) - joint_numpy(*runs[0])).max()
    print(f"largest difference to numpy: PAST chain {off:.1e} rad, joint ML {apart:.1e} rad")
    whole = [
        ("PAST chain, with checks and flags", PastOptions(), "ryu"),
        ("joint ML, the same", JointOptions(), "joint-ml"),
    ]
    rows = [("PAST chain, compiled", past_kernel, 20, 10), ("joint ML per 10, compiled", joint_kernel, 20, 10)]
    rows += [(name, lambda *run, m=m, o=o: track(m, GEOMETRY, *run, o), 20, 5) for name, o, m in whole]
    rows += [("PAST chain, numpy", past_numpy, 2, 3), ("joint ML per 10, numpy", joint_numpy, 2, 3)]
    for estimate in (music, root_music, esprit):
        name = estimate.__name__.replace("_", "-")
        rows += [(f"{name} per {block}", per_block(estimate, block), 2, 3) for block in (20, 50)]
    measured = {name: best(work, runs[:count], repeats) for name, work, count, repeats in rows}
    past, joint = measured["PAST chain, compiled"], measured["joint ML per 10, compiled"]
    print(f"{'us per snapshot':36s}{'us':>9} {'/ PAST':>9} {'/ joint':>9}")
    for name, us in measured.items():
        print(f"{name:36s}{us:9.2f} {us / past:9.1f} {us / joint:9.1f}")
    with tempfile.TemporaryDirectory() as cache:
        environment = dict(os.environ, NUMBA_CACHE_DIR=cache)
        done = subprocess.run([sys.executable, "-c", WORK], capture_output=True, text=True, check=True, env=environment)
    print(
        f"compiling with an empty cache, CPU seconds: PAST chain, joint ML (what they share is in the first): {done.stdout}"
    )


if __name__ == "__main__":
    main()
