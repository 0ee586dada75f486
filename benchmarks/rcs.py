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

import numpy as np
from scipy.optimize import minimize_scalar

from rangeeval.stats.swerling import CASES, DETECTION, Looks, Windows
from rangeeval.stats.swerling.fitness import simulate
from rangeeval.stats.swerling.likelihood import maximum_likelihood
from rangeeval.stats.swerling.paper import iterate

SNR, PF = 16.0, 1e-3
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


def best(work: object, repeats: int = 5) -> float:
    """Seconds of the quickest of a few calls."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()  # type: ignore[operator]
        times.append(time.perf_counter() - began)
    return min(times)


def main() -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--windows", type=int, default=100_000)
    count = parser.parse_args().windows
    print(
        "microseconds per window    ML-A     ML-B   scipy  python |  scipy/ML-A  scipy/ML-B  largest difference, ML-A to scipy"
    )
    for unequal in (False, True):
        for length in (7, 10, 15):
            looks, windows = windows_of(length, count, unequal)
            maximum_likelihood(looks, windows, THREE)
            iterate(looks, windows, THREE, "ml-b")
            exact = best(lambda: maximum_likelihood(looks, windows, THREE)) / count * 1e6
            paper = best(lambda: iterate(looks, windows, THREE, "ml-b"), 3) / count * 1e6
            some = 1000
            z = np.where(looks.kind == DETECTION, looks.z, np.nan)[: some * length].reshape(some, length)
            alpha = looks.alpha[: some * length].reshape(some, length)
            t = -math.log(PF)
            found = [scipy_one(a, b, t) for a, b in zip(z, alpha, strict=True)]
            peer = best(lambda: [scipy_one(a, b, t) for a, b in zip(z, alpha, strict=True)], 2) / some * 1e6
            rows = list(zip(z.tolist(), alpha.tolist(), strict=True))
            plain = best(lambda: [python_one(a, b, t) for a, b in rows], 2) / some * 1e6
            ours = maximum_likelihood(looks, windows, THREE)[:some]
            seen = ours > 0
            off = float(np.max(np.abs(np.array(found)[seen] / ours[seen] - 1.0)))
            name = f"{length:2d} looks, {'unequal' if unequal else 'equal  '} alpha"
            print(
                f"{name:24s}{exact:8.3f} {paper:8.3f} {peer:7.1f} {plain:7.1f} |{peer / exact:10.0f}x {peer / paper:10.0f}x  {off:.1e}"
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
