"""Does `compare` keep its promises? Counted over made-up pairs of trials, through the real `accuracy` and `compare`.

Prints, for each kind of trial: how often the 95 % interval of a ratio or difference holds the truth, how many pairs
that are alike have any false verdict (all bins and quantities together, Holm), and how often a real change is found.

    python benchmarks/compare_power.py [--pairs 100] [--kind tracker] [--picture docs/images/compare-power.svg]
"""

from __future__ import annotations

import argparse
import math
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.special import fdtrc, fdtri

from rangeeval.analyses.accuracy import accuracy
from rangeeval.comparison import Method, compare
from rangeeval.model import Bins, Result
from rangeeval.tracking.alpha_beta import beta_from_alpha
from rangeeval.tracking.simulation import Scenario, simulate

Array = NDArray[np.float64]
AXES = ("range", "y", "z")
SIGMAS = ("range_sigma", "elevation_sigma", "azimuth_sigma")
MEANS = ("range_residual_mean", "y_residual_mean", "z_residual_mean")

# An aircraft towards the radar, its gains following SNR: the residuals are coloured by the filter.
TRACKER = Scenario(flights=4)
KINDS: dict[str, Scenario | float] = {
    "tracker": TRACKER,
    "close": replace(
        TRACKER, start_range_m=20_000.0, end_range_m=600.0, altitude_m=300.0, cross_range_m=200.0, speed_m_s=120.0
    ),
    "short-tracks": replace(TRACKER, flights=24, speed_m_s=900.0, start_range_m=60_000.0, end_range_m=20_000.0),
    "manoeuvre": replace(TRACKER, acceleration_sigma_m_s2=5.0),
    # Plain series with this correlation from one sample to the next, ten bins.
    "white": 0.0,
    "correlated": 0.3,
    "alternating": -0.4,
}


def columns(kind: str, seed: int, ratio: float = 1.0) -> dict[str, Array]:
    """A residuals log with gains; every residual `ratio` times as large as it would be."""
    made = KINDS[kind]
    if isinstance(made, Scenario):
        log = simulate(made, seed)
        names = [f"{a}_{what}_m" for a in AXES for what in ("residual", "predicted")]
        names += [f"{gain}_{a}" for a in AXES for gain in ("alpha", "beta")] + ["time_s", "snr_db"]
        data = {name: np.asarray(getattr(log, name), np.float64) for name in names}
        data["track_id"] = log.track.astype(np.float64)
    else:
        data = _series(made, seed)
    for axis in AXES:
        data[f"{axis}_residual_m"] = data[f"{axis}_residual_m"] * ratio
    return data


def _series(correlation: float, seed: int, bins: int = 10, each: int = 150) -> dict[str, Array]:
    rng, n, alpha = np.random.default_rng(seed), bins * each + 22, 0.5
    data = {
        "time_s": np.arange(n) * 0.5,
        "range_predicted_m": np.linspace(10_000.0 + bins * 5_000.0, 10_001.0, n),
        "y_predicted_m": np.full(n, 2_000.0),
        "z_predicted_m": np.full(n, -3_000.0),
    }
    for axis in AXES:
        white = rng.standard_normal(n + 50) * 10.0 * math.sqrt(1.0 - correlation**2)
        data[f"{axis}_residual_m"] = np.asarray(lfilter([1.0], [1.0, -correlation], white))[50:]
        data[f"alpha_{axis}"] = np.full(n, alpha)
        data[f"beta_{axis}"] = np.full(n, float(beta_from_alpha(alpha)))
    return data


def assessed(kind: str, seed: int, ratio: float = 1.0) -> Result:
    """What `accuracy` makes of a made-up trial."""
    return accuracy(columns(kind, seed, ratio), Bins())


@dataclass
class Counts:
    """Of pairs of trials with one true ratio: intervals that hold the truth, and verdicts."""

    pairs: int = 0
    pairs_with_claim: int = 0
    pairs_with_claim_of_alike: int = 0  # in a row where SNR, gains and path were alike
    tests: int = 0
    claims: Counter[str] = field(default_factory=Counter)
    intervals: Counter[str] = field(default_factory=Counter)
    held: Counter[str] = field(default_factory=Counter)
    missed_bins: Counter[float] = field(default_factory=Counter)

    def add(self, result: Result, ratio: float) -> None:
        """Count one comparison."""
        self.pairs += 1
        claims = [row.extra["verdict"] for row in result.rows if row.extra["verdict"] in {"better", "worse"}]
        self.pairs_with_claim += bool(claims)
        self.pairs_with_claim_of_alike += any(
            row.extra["verdict"] in {"better", "worse"} and not any(f.startswith("unlike-") for f in row.flags)
            for row in result.rows
        )
        self.claims.update(claims)
        self.tests += len(result.rows)
        for row in result.rows:
            truth = ratio if row.extra["measure"] == "ratio" else 0.0
            if math.isfinite(row.low):
                held = row.low <= truth <= row.high
                self.intervals[row.quantity] += 1
                self.held[row.quantity] += held
                self.missed_bins[row.bin_low] += not held

    def merged(self, other: Counts) -> Counts:
        """Both together."""
        return Counts(*(getattr(self, f) + getattr(other, f) for f in self.__dataclass_fields__))

    def coverage(self, quantity: str) -> float:
        """Share of the intervals that hold the truth."""
        return self.held[quantity] / max(self.intervals[quantity], 1)


def counted(kind: str, ratio: float, pairs: int, seed: int = 0, quantities: tuple[str, ...] = ()) -> Counts:
    """Counts over `pairs` pairs of independent trials, the second with every residual `ratio` times as large."""
    counts = Counts()
    for i in range(pairs):
        first, second = assessed(kind, seed + 2 * i), assessed(kind, seed + 2 * i + 1, ratio)
        counts.add(compare([[first], [second]], Method(quantities=quantities)), ratio)
    return counts


def _job(job: tuple[str, float, int, int, tuple[str, ...]]) -> Counts:
    return counted(*job)


def shared_out(kind: str, ratio: float, pairs: int, workers: int, quantities: tuple[str, ...] = ()) -> Counts:
    """The same, over several processes; the numbers do not depend on how many."""
    size = 25
    other = 0 if ratio == 1.0 else 1_000_000  # trials of their own
    jobs = [(kind, ratio, min(size, pairs - start), other + 2 * start, quantities) for start in range(0, pairs, size)]
    total = Counts()
    with ProcessPoolExecutor(workers) as pool:
        for counts in pool.map(_job, jobs):
            total = total.merged(counts)
    return total


def lines(kinds: Mapping[str, object], pairs: int, workers: int) -> Iterator[str]:
    """The table of coverage and false claims, kind by kind."""
    yield "kind          ratio  pairs  tests  σ coverage  mean coverage  pairs with a false verdict, in a bin flown alike"
    for kind in kinds:
        for ratio, share in ((1.0, pairs), (1.25, max(pairs // 5, 1))):
            counts = shared_out(kind, ratio, share, workers)
            sigma, mean = (
                sum(counts.held[q] for q in group) / max(sum(counts.intervals[q] for q in group), 1)
                for group in (SIGMAS, MEANS)
            )
            claims = (
                ", ".join(
                    f"{n / counts.pairs:.4f} ({n})" for n in (counts.pairs_with_claim, counts.pairs_with_claim_of_alike)
                )
                if ratio == 1.0
                else "-"
            )
            tests = counts.tests // counts.pairs
            yield f"{kind:13s} {ratio:5.2f} {share:6d} {tests:6d} {sigma:11.4f} {mean:14.4f}  {claims}"


RATIOS = (1.0, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.8, 2.0)
BINS = 18


def power(pairs: int, workers: int, kind: str = "tracker") -> list[tuple[float, float, float]]:
    """(ratio, share of bins found worse, share of trials with any bin found worse) of range sigma, counted."""
    found = []
    for ratio in RATIOS:
        counts = shared_out(kind, ratio, pairs, workers, ("range_sigma",))
        found.append((ratio, counts.claims["worse"] / counts.tests, counts.pairs_with_claim / counts.pairs))
    return found


def power_in_theory(ratio: Array, nu: float, tests: int = BINS, level: float = 0.05) -> Array:
    """Chance that one bin is found worse when each test has its share of the level (the first step of Holm)."""
    least = 1.0 / fdtri(nu, nu, level / tests / 2.0)  # the upper quantile of F
    return np.asarray(fdtrc(nu, nu, least / ratio**2))


def draw(curve: list[tuple[float, float, float]], path: Path) -> None:
    """The power curve: in theory for several effective numbers of samples a bin, and as counted."""
    import matplotlib

    matplotlib.use("Agg")
    matplotlib.rcParams.update({"svg.hashsalt": "compare", "svg.fonttype": "none"})
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(7.0, 4.0), layout="constrained")
    ratio = np.linspace(1.0, 2.0, 201)
    for n, dash in ((50, ":"), (150, "-"), (500, "--"), (1500, "-.")):
        axes.plot(ratio, power_in_theory(ratio, n - 1.0), dash, color="#0072B2", label=f"{n} effective samples a bin")
    axes.plot(
        *zip(*[(r, bins) for r, bins, _ in curve], strict=True), "s", color="#D55E00", label="counted, about 160 a bin"
    )
    axes.set(xlabel="True ratio of sigmas", ylabel="Share of bins found worse", xlim=(1.0, 2.0), ylim=(0.0, 1.02))
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right", fontsize=8)
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    """Print the table and the power curve; with --picture also draw it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--pairs", type=int, default=100, help="of each kind and ratio")
    parser.add_argument("--kind", action="append", choices=list(KINDS))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--no-power", action="store_true")
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args()
    started = time.perf_counter()
    for line in lines(dict.fromkeys(given.kind or KINDS), given.pairs, given.workers):
        print(line, flush=True)
    if not given.no_power:
        curve = power(given.pairs, given.workers)
        print("\nrange sigma, 18 bins of about 160 updates")
        print("ratio  bins found worse  (in theory)  trials with any bin found worse")
        for ratio, bins, trials in curve:
            print(f"{ratio:5.2f} {bins:17.3f} {float(power_in_theory(np.array(ratio), 155.0)):12.3f} {trials:32.3f}")
        if given.picture:
            draw(curve, given.picture)
    print(f"{time.perf_counter() - started:.0f} s")


if __name__ == "__main__":
    main()
