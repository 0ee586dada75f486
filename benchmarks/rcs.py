"""Microseconds per window of the RCS estimators, against scipy a window at a time and a plain Python loop.

One run on one core: windows of 7, 10 and 15 looks, equal and unequal alpha, Swerling 3 at SNR 16 and false-alarm
probability 1e-3. The compiled kernels take all windows in one call, as the tool does. Then 1000 bootstrap replicates
of 200 bins (kernel time: the fits alone, and with simulation).

    python benchmarks/rcs.py
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.optimize import minimize_scalar

from rangeeval.stats.swerling import CASES, DETECTION, Looks, Windows
from rangeeval.stats.swerling.fitness import simulate
from rangeeval.stats.swerling.likelihood import maximum_likelihood
from rangeeval.stats.swerling.paper import iterate

SNR, PF = 16.0, 1e-3
COMPILED, SLOW = 10_000, 40  # windows in a call
THREE = CASES["3"]


def windows_of(length: int, count: int, unequal: bool) -> tuple[Looks, Windows]:
    """Simulated windows of one true square metre."""
    rng = np.random.default_rng(length)
    alpha = SNR * (10.0 ** rng.uniform(-0.5, 0.5, length * count) if unequal else np.ones(length * count))
    plain = Looks.of(np.full(length * count, np.nan), alpha, -math.log(PF))
    windows = Windows.groups(np.full(count, length))
    return simulate(plain, windows, THREE, np.ones(count), rng), windows


def scipy_one(z: np.ndarray, alpha: np.ndarray, t: float) -> float:
    """What one would write: bounded minimisation of numpy's log-likelihood over ln s."""
    hit = ~np.isnan(z)
    zd, ad, am = z[hit], alpha[hit], alpha[~hit]

    def lost(u: float) -> float:
        s = math.exp(u)
        a, b = 2.0 + ad * s, 1.0 + 0.5 * am * s
        x = t / b
        found = np.log(zd * ad * s + a) - 3.0 * np.log(a) - 2.0 * zd / a
        missed = np.log(-np.expm1(-x + np.log1p((1.0 - 1.0 / b) * x)))
        return -float(found.sum() + missed.sum())

    return math.exp(minimize_scalar(lost, bounds=(-7.0, 4.0), method="bounded", options={"xatol": 1e-8}).x)


def python_one(z: list[float], alpha: list[float], t: float) -> float:
    """Eq. 15 with its guard, in plain Python."""

    def value(s: float) -> float:
        total = 0.0
        for zi, a in zip(z, alpha, strict=True):
            snr = a * s
            if zi == zi:
                total += math.log(zi * snr + 2.0 + snr) - 3.0 * math.log(2.0 + snr) - 2.0 * zi / (2.0 + snr)
            else:
                b = 1.0 + 0.5 * snr
                total += math.log(1.0 - math.exp(-t / b) * (1.0 + (1.0 - 1.0 / b) * t / b))
        return total

    s = sum((zi - 1.0) / a for zi, a in zip(z, alpha, strict=True) if zi == zi) / len(z)
    if s <= 0.0:
        return 0.0
    known = value(s)
    for _ in range(100):
        total = 0.0
        for zi, a in zip(z, alpha, strict=True):
            if zi == zi:
                y = zi
            else:
                snr = a * s
                b = 1.0 + 0.5 * snr
                x, e = t / b, math.exp(-t / b)
                two = 1.0 - e * (1.0 + x)
                three = two - e * x * x / 2.0
                y = (snr * three + two) / (two + x * e / b)
            total += (y - 1.0) / a
        new = total / len(z)
        now = value(new)
        if now < known or abs(new - s) < 1e-6 * s:
            return new
        s, known = new, now
    return s


def best(jobs: dict[str, tuple[Callable[[], object], int]], rounds: int = 25) -> dict[str, float]:
    """Microseconds a window of each job: the quickest of many short calls, taken in turn so that all see one machine."""
    least = dict.fromkeys(jobs, math.inf)
    for _ in range(rounds):
        for name, (work, windows) in jobs.items():
            began = time.perf_counter()
            work()
            least[name] = min(least[name], (time.perf_counter() - began) / windows * 1e6)
    return least


def main() -> None:
    """Print the comparison."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    t = -math.log(PF)
    print(
        "microseconds per window      ML-A    ML-B   scipy  python | scipy/ML-A  scipy/ML-B  python/ML-B  ML-A off scipy"
    )
    for unequal in (False, True):
        for length in (7, 10, 15):
            looks, windows = windows_of(length, COMPILED, unequal)
            z = np.where(looks.kind == DETECTION, looks.z, np.nan)[: SLOW * length].reshape(SLOW, length)
            alpha = looks.alpha[: SLOW * length].reshape(SLOW, length)
            one_by_one = list(zip(z, alpha, strict=True))
            plain = list(zip(z.tolist(), alpha.tolist(), strict=True))
            spent = best({
                "ml-a": (partial(maximum_likelihood, looks, windows, THREE), COMPILED),
                "ml-b": (partial(iterate, looks, windows, THREE, "ml-b"), COMPILED),
                "scipy": (lambda rows=one_by_one: [scipy_one(a, b, t) for a, b in rows], SLOW),  # type: ignore[misc]
                "python": (lambda rows=plain: [python_one(a, b, t) for a, b in rows], SLOW),  # type: ignore[misc]
            })  # fmt: skip
            ours = maximum_likelihood(looks, windows, THREE)[:SLOW]
            seen = ours > 0
            off = np.max(np.abs(np.array([scipy_one(a, b, t) for a, b in one_by_one])[seen] / ours[seen] - 1.0))
            name = f"{length:2d} looks, {'unequal' if unequal else 'equal'} alpha"
            a, b, scipy, python = (spent[n] for n in ("ml-a", "ml-b", "scipy", "python"))
            print(
                f"{name:25s}{a:8.3f}{b:8.3f}{scipy:8.1f}{python:8.1f} |{scipy / a:9.0f}x{scipy / b:11.0f}x"
                f"{python / b:12.0f}x{off:16.1e}"
            )

    looks, windows = windows_of(10, 200, True)
    rng = np.random.default_rng(1)
    s = maximum_likelihood(looks, windows, THREE)
    fits = drawn = 0.0
    for _ in range(1000):
        began = time.perf_counter()
        again = simulate(looks, windows, THREE, s, rng)
        middle = time.perf_counter()
        maximum_likelihood(again, windows, THREE)
        drawn, fits = drawn + middle - began, fits + time.perf_counter() - middle
    print(f"1000 bootstrap replicates over 200 bins of 10 looks: fits {fits:.3f} s, simulation {drawn:.3f} s")


if __name__ == "__main__":
    main()
