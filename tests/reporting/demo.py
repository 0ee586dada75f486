"""A made-up report as large as a real one, from seeded numbers, to measure and to look at."""

from __future__ import annotations

import datetime

import numpy as np

from rangeeval.reporting.blocks import Cell, Document, Figure, Mark, Notice, Panel, Paragraph, Section, Table

AXES = ("Range", "y", "z")


def bin_section(number: int, rng: np.random.Generator, samples: int = 300) -> Section:
    """A page on one range bin: twelve panels, numbers with intervals, flags in words."""
    rows, lines = [], []
    low, high = 5 * number, 5 * number + 5
    for index, axis in enumerate(AXES):
        sigma = (4.0 + 0.8 * number) * (1, 2.3, 2.9)[index]
        time = np.sort(rng.uniform(100.0 + 40 * number, 140.0 + 40 * number, samples))
        noise = rng.normal(size=samples)
        value = sigma * np.convolve(noise, (1.0, 0.3), "same")
        counts, edges = np.histogram(value, 24)
        spread = value.std()
        curve = np.linspace(edges[0], edges[-1], 81)
        normal = samples * (edges[1] - edges[0]) * np.exp(-0.5 * (curve / spread) ** 2) / (spread * np.sqrt(2 * np.pi))
        position = (np.arange(samples) + 0.5) / samples
        quantile = spread * np.sqrt(2) * _erfinv(2 * position - 1)
        lags = np.arange(1, 31)
        memory = np.array([np.corrcoef(value[:-k], value[k:])[0, 1] for k in lags])
        limit = 1.96 / np.sqrt(samples)
        label = f"{axis} residual [m]"
        rows.append(
            (
                Panel(
                    "Samples",
                    "time [s]",
                    label,
                    (
                        Mark("points", time, value, label="residual", role="measured"),
                        Mark("rule", y=(0.0,), role="reference"),
                        Mark("rule", y=(-2 * spread, 2 * spread), label="± 2 sigma", role="limit"),
                    ),
                    share_x="time",
                ),
                Panel(
                    "Histogram",
                    label,
                    "samples",
                    (
                        Mark("bars", edges, counts, label="residual", role="measured"),
                        Mark("line", curve, normal, label="normal with the same sigma", role="predicted"),
                    ),
                ),
                Panel(
                    "Normal Q-Q",
                    "normal quantile [m]",
                    label,
                    (
                        Mark(
                            "line",
                            (quantile[0], quantile[-1]),
                            (quantile[0], quantile[-1]),
                            label="normal with the same sigma",
                            role="predicted",
                        ),
                        Mark("points", quantile, np.sort(value), label="residual", role="measured"),
                    ),
                ),
                Panel(
                    "Autocorrelation",
                    "lag [updates]",
                    "correlation",
                    (
                        Mark("stems", lags, memory, label="residual", role="measured"),
                        Mark("rule", y=(-limit, limit), label="95 % limits of white noise", role="reference"),
                    ),
                ),
            )
        )
        lines.append(
            (
                axis,
                str(samples),
                f"{samples * 0.8:.0f}",
                f"{value.mean():+.2f}",
                f"{spread:.2f}",
                f"{spread * 0.93:.2f} to {spread * 1.08:.2f}",
                Cell("", "pass" if spread < 20 else "fail" if spread > 40 else "inconclusive"),
            )
        )
    return Section(
        f"{low} to {high} km",
        (
            Table(
                f"Random error between {low} and {high} km, with 95 % intervals",
                ("axis", "samples", "effective", "mean [m]", "sigma [m]", "95 % interval [m]", "requirement"),
                lines,
                "lrrrrrl",
            ),
            Figure(
                f"Residuals of the {samples} updates between {low} and {high} km.",
                f"Time, histogram, quantiles and autocorrelation of the residuals, {low} to {high} km.",
                rows,
                "compact",
            ),
            Notice(
                "Neighbouring residuals are correlated: the intervals count the effective samples.",
                "caution",
                "Correlated.",
            ),
        ),
        own_page=number > 0,
        level=2,
        key=f"bin-{low}-{high}",
    )


def _erfinv(x: np.ndarray) -> np.ndarray:
    """Winitzki's approximation, good enough for a picture."""
    a = 0.147
    log = np.log(np.maximum(1 - x * x, 1e-12))
    first = 2 / (np.pi * a) + log / 2
    return np.sign(x) * np.sqrt(np.sqrt(first**2 - log / a) - first)


def overview(number: int, rng: np.random.Generator, bins: int = 18) -> Figure:
    """One larger figure of sigma against range, measured and predicted."""
    centre = np.arange(bins) * 5.0 + 2.5
    predicted = 4 + 0.35 * centre ** (1 + 0.05 * number)
    value = predicted * rng.normal(1.0, 0.06, bins)
    log = number == 3
    panels = tuple(
        Panel(
            f"{axis} random error",
            "predicted range [km]",
            f"{axis} sigma [m]",
            (
                Mark(
                    "band",
                    centre,
                    low=predicted * 0.85,
                    high=predicted * 1.15,
                    label="predicted, SNR ± 1.5 dB",
                    role="predicted",
                ),
                Mark("line", centre, predicted, label="predicted from SNR", role="predicted"),
                Mark(
                    "errorbars",
                    centre,
                    value * scale,
                    value * scale * 0.9,
                    value * scale * 1.12,
                    "assessed, 95 % interval",
                    "measured",
                ),
                Mark("rule", y=(20.0,), label="requirement, 20 m", role="limit"),
            ),
            y_log=log,
            share_x="range",
        )
        for axis, scale in zip(AXES[: 1 + number % 3], (1.0, 1.1, 1.2), strict=False)
    )
    return Figure(
        f"Assessed random error against its prediction from the signal-to-noise ratio, view {number + 1}.",
        "Sigma grows with range, close to the predicted curve; it crosses the required 20 m near 45 km.",
        (panels,) if number % 3 else tuple((panel,) for panel in panels),
        "tall" if number == 0 else "normal",
    )


def cloud_figure(points: int, rng: np.random.Generator, number: int = 0) -> Figure:
    """One panel with a dense cloud and its running mean."""
    time = np.sort(rng.uniform(0.0, 900.0, points))
    value = rng.normal(size=points) * (1 + time / 300) + np.sin(time / 40)
    return Figure(
        f"All {points} updates of the trial, view {number + 1}.",
        "A cloud of residuals that widens with time.",
        (
            (
                Panel(
                    "Residuals over time",
                    "time [s]",
                    "range residual [m]",
                    (
                        Mark("points", time, value, label="residual", role="measured"),
                        Mark("rule", y=(0.0,), role="reference"),
                    ),
                ),
            ),
        ),
    )


def demo(bins: int = 18, overviews: int = 8, clouds: int = 1, points: int = 10_000) -> Document:
    """The whole made-up report."""
    rng = np.random.default_rng(20260514)
    verdicts = ("pass", "pass", "inconclusive", "fail")
    summary = Table(
        "Requirements, each at 95 % confidence",
        ("quantity", "where", "limit", "assessed", "95 % interval", "verdict"),
        [
            (
                name,
                where,
                "20.0 m",
                f"{value:.1f} m",
                f"{value * 0.92:.1f} to {value * 1.09:.1f} m",
                Cell("", verdict),
            )
            for name, where, value, verdict in zip(
                ("range sigma", "range sigma", "y sigma", "z sigma"),
                ("0 to 40 km", "SNR above 20 dB", "0 to 40 km", "all"),
                (9.83, 12.1, 19.2, 31.6),
                verdicts,
                strict=True,
            )
        ],
        "llrrrl",
    )
    per_bin = Table(
        "Random error per range bin",
        (
            "bin [km]",
            "samples",
            "effective",
            "range sigma [m]",
            "y sigma [m]",
            "z sigma [m]",
            "elevation sigma [arcmin]",
            "flags",
        ),
        [
            (
                f"{5 * b} to {5 * b + 5}",
                "300",
                str(240 - 3 * b),
                f"{4 + 0.8 * b:.2f}",
                f"{9 + 1.8 * b:.1f}",
                Cell(f"{11 + 2.3 * b:.1f}", strong=b == 4),
                f"{1.2 + 0.03 * b:.2f}",
                "correlated" if b % 3 else "correlated, not normal",
            )
            for b in range(bins)
        ],
        "lrrrrrrl",
    )
    sections = [
        Section(
            "Summary",
            (
                Paragraph(
                    "Two of four requirements are met, one is not, and one is open with these samples. "
                    "Every number below is a random error only: a constant bias leaves no trace in residuals."
                ),
                Notice("z sigma beyond 60 km exceeds the limit at 95 % confidence.", "bad"),
                Notice(
                    "42 more effective samples between 35 and 40 km would decide the open requirement.",
                    "info",
                ),
                summary,
                overview(0, rng),
            ),
            key="summary",
        ),
        Section(
            "Accuracy from residuals and gains",
            (
                Paragraph(
                    "The standard deviation of the residuals becomes that of the measurement with the gains "
                    "the filter recorded, sample by sample."
                ),
                Notice("Start-up was removed: the first 12 updates of each track.", "good"),
                per_bin,
                *(overview(k, rng) for k in range(1, overviews)),
                *(cloud_figure(points, rng, k) for k in range(clouds)),
            ),
            key="accuracy",
        ),
        Section(
            "Range bins",
            (Paragraph("One page for each bin of the predicted range."),),
            key="bins",
            own_page=True,
        ),
        *(bin_section(b, rng) for b in range(bins)),
        Section(
            "What was read",
            (
                Table(
                    "Files",
                    ("file", "kind", "rows", "rejected", "SHA-256"),
                    [
                        (
                            "trial_a/residuals.csv",
                            "residuals",
                            "61,234",
                            "3",
                            "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08",
                        ),
                        (
                            "시험_3/이득.csv",
                            "gains",
                            "61,234",
                            "0",
                            "60303ae22b998861bce3b28f33eec1be758a213c86c93c076dbe9f558c11c752",
                        ),
                    ],
                    "llrrl",
                ),
            ),
            own_page=True,
            key="read",
        ),
    ]
    return Document(
        "Accuracy report: 진입 시험 3 (Inbound pass 3)",
        datetime.datetime(2026, 5, 14, 9, 30, tzinfo=datetime.UTC),
        "Radar MFR-1, residuals and gains without truth",
        "UNCLASSIFIED",
        (
            ("Trial", "Inbound pass 3"),
            ("Date", "2026-05-14"),
            ("Radar", "MFR-1"),
            ("Updates used", "5,400 of 5,412"),
            ("Confidence", "95 %"),
            ("Software", "rangeeval 0.1.0"),
        ),
        sections,
    )
