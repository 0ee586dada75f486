"""From the detections log to looks: what each row says of z, threshold and alpha, and which rows cannot be used."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rangeeval.errors import InputError, SettingsError
from rangeeval.model import Bins, Problem, Table, Trial, gather
from rangeeval.model.settings import RadarEquation, TrialSettings
from rangeeval.model.table import MAX_SHOWN
from rangeeval.physics.radar_equation import loop_gain_db, snr_of_square_metre
from rangeeval.stats.swerling import DETECTION, HIT, MISS, SATURATED, Looks
from rangeeval.stats.swerling.detection import false_alarm_of, threshold_of

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

AGREE = 0.01  # a threshold given both ways must agree to this share; logs are rounded


@dataclass(frozen=True)
class Gathered:
    """The usable looks in the order of the log, with where and when each was."""

    looks: Looks
    time_s: Floats
    range_m: Floats
    aspect_rad: Floats
    target: NDArray[np.int32]
    targets: tuple[str, ...]
    counts: Mapping[str, int]
    problems: tuple[Problem, ...]

    def take(self, rows: NDArray[np.int64] | Flags) -> Gathered:
        """The looks chosen."""
        own = {name: getattr(self, name)[rows] for name in ("time_s", "range_m", "aspect_rad", "target")}
        return replace(self, looks=self.looks.take(rows), **own)

    def values_of(self, variable: str) -> Floats:
        """What decides the bin; snr is that of 1 m^2 (a missed look has no other)."""
        if variable == "snr":
            return np.asarray(10.0 * np.log10(self.looks.alpha))
        return {"range": self.range_m, "aspect": self.aspect_rad, "time": self.time_s}[variable]


def aspect_between(aspect: Floats, start: float, fold: bool) -> Floats:
    """Aspect within one turn from `start`; folded: the angle from the nose, 0 to pi."""
    if fold:
        return np.asarray(np.abs(np.mod(aspect + np.pi, 2 * np.pi) - np.pi))
    return np.asarray(np.mod(aspect - start, 2 * np.pi) + start)


def gain_of(equation: RadarEquation) -> float | None:
    """The loop gain that a radar equation gives, in dB; None when it gives none."""
    if equation.loop_gain_db is not None:
        return equation.loop_gain_db
    e = equation
    if e.energy_j is None or e.gain_transmit_db is None or e.gain_receive_db is None or e.wavelength_m is None:
        return None
    return loop_gain_db(
        e.energy_j, e.gain_transmit_db, e.gain_receive_db, e.wavelength_m, e.noise_temperature_k,
        e.noise_figure_db, e.loss_db,
    )  # fmt: skip


def nominal(table: Table, column: str) -> Floats:
    """A column in dB, 0 where it is missing."""
    return np.nan_to_num(table.floats(column), nan=0.0)


def relative_alpha(table: Table, equation: RadarEquation, gain: float) -> Floats:
    """alpha of each row from the radar equation."""
    return snr_of_square_metre(
        table.floats("range_m"),
        gain,
        energy_db=nominal(table, "energy_db"),
        loss_db=nominal(table, "loss_db"),
        attenuation_db_per_km=equation.attenuation_db_per_km,
    )


class _Judge:
    """Marks rows as unusable, each for the first reason met, and words them."""

    def __init__(self, source: str, time_s: Floats) -> None:
        self.source, self.time_s = source, time_s
        self.left = np.ones(len(time_s), dtype=bool)
        self.problems: list[Problem] = []

    def set_aside(self, rows: Flags, reason: str, words: Callable[[int], str], *, rejected: bool = True) -> None:
        """Set aside these rows, with the first few cases by scan number (from 1) and time."""
        now = rows & self.left
        if not now.any():
            return
        examples = tuple(
            f"{self.source}: scan {i + 1} (at {self.time_s[i]:g} s): {words(i)}"
            for i in np.flatnonzero(now)[:MAX_SHOWN].tolist()
        )
        self.problems.append(Problem(self.source, reason, int(now.sum()), examples, rejected))
        self.left &= ~now


def _threshold(table: Table, settings: TrialSettings, pulses: Floats, scale: Floats, judge: _Judge) -> Floats:
    """The threshold on z of each row, from a threshold or a false-alarm probability, which must agree."""
    own = settings.detections
    given = table.floats("threshold")
    if own.threshold is not None:
        given = np.where(np.isnan(given), own.threshold, given)
    offset = pulses if own.amplitude == "signal" else np.zeros(len(pulses))
    direct = given * scale + offset
    pf = table.floats("false_alarm_probability")
    if own.false_alarm_probability is not None:
        pf = np.where(np.isnan(pf), own.false_alarm_probability, pf)
    judge.set_aside(
        ~np.isnan(pf) & ~((pf > 0) & (pf < 1)), "false_alarm_probability is not between 0 and 1; set aside",
        lambda i: f"false_alarm_probability is {pf[i]:g}",
    )  # fmt: skip
    ok = np.where((pf > 0) & (pf < 1), pf, np.nan)
    with np.errstate(invalid="ignore"):
        derived = np.where(np.isnan(ok), np.nan, threshold_of(np.nan_to_num(ok, nan=0.5), pulses))
        differ = np.abs(direct - derived) > AGREE * derived
    judge.set_aside(
        differ, "threshold and false_alarm_probability contradict each other; set aside",
        lambda i: f"threshold {given[i]:.6g} and false_alarm_probability {pf[i]:g}, which means {derived[i]:.6g}",
    )  # fmt: skip
    return np.where(np.isnan(direct), derived, direct)


def gather_looks(trial: Trial, progress: Callable[[int], None] | None = None) -> Gathered:
    """The looks of a trial's detections log; rows that cannot be are set aside with their scan number.

    Raises InputError when alpha or the threshold cannot be had at all, or not one look is usable.
    """
    log = trial.log("detections")
    settings, own = trial.settings, trial.settings.detections
    table = log.read()
    if progress:
        progress(len(table))
    gain = gain_of(settings.radar_equation)
    if "snr_per_m2" not in log and (gain is None or "range_m" not in log) and own.sphere_radius_m is None:
        raise InputError(
            f"{log.source}: the SNR of a 1 m^2 target is not known; give a column snr_per_m2, or range_m and a "
            "[radar_equation] with loop_gain_db in trial.toml"
        )
    if not (
        {"threshold", "false_alarm_probability"} & set(log.columns)
        or own.threshold is not None
        or own.false_alarm_probability is not None
    ):
        raise InputError(
            f"{log.source}: no threshold; give a column threshold or false_alarm_probability, or one value in "
            "[detections] of trial.toml"
        )
    judge = _Judge(log.source, table.floats("time_s"))
    detected = table.floats("detected")
    judge.set_aside(
        np.isnan(detected),
        "rows without 0 or 1 in detected: not looked at, not a miss",
        lambda i: "detected is missing",
    )
    judge.set_aside(
        ~np.isin(detected, (0.0, 1.0)),
        "detected is neither 0 nor 1; set aside",
        lambda i: f"detected is {detected[i]:g}",
    )
    seen = detected == 1.0
    pulses = table.floats("pulses")
    pulses = np.where(np.isnan(pulses), float(own.pulses), pulses)
    judge.set_aside(
        ~((pulses >= 1) & (pulses == np.floor(pulses))), "pulses is not a whole number of 1 or more; set aside",
        lambda i: f"pulses is {pulses[i]:g}",
    )  # fmt: skip
    pulses = np.where(judge.left, pulses, 1.0)
    alpha = _alpha(table, trial, gain, judge)
    scale = pulses if own.integrated == "mean" else np.ones(len(pulses))
    threshold = _threshold(table, settings, pulses, scale, judge)
    judge.set_aside(
        np.isnan(threshold), "rows without a threshold or false-alarm probability; set aside", lambda i: "no threshold"
    )
    judge.set_aside(
        ~(threshold > 0), "threshold is not above zero; set aside", lambda i: f"threshold is {threshold[i]:g}"
    )
    z, kind = _amplitudes(table, trial, seen, pulses, scale, threshold, judge)
    keep = judge.left
    if not keep.any():
        reasons = "".join(
            f"; {p.reason} ({p.count})" + (f", such as {p.examples[0]}" if p.examples else "")
            for p in (*table.problems, *judge.problems)[:3]
        )
        raise InputError(f"{log.source}: not one usable look{reasons}")
    looks = Looks(
        kind[keep], z[keep], threshold[keep], alpha[keep], pulses[keep].astype(np.int64), float(own.gate_cells)
    )
    codes = np.where(table.codes("target_id") < 0, 0, table.codes("target_id")).astype(np.int32)
    counts = {
        "looks": int(keep.sum()),
        "detections": int((kind[keep] != MISS).sum()),
        "misses": int((kind[keep] == MISS).sum()),
        "set_aside": int((~keep).sum()),
    }
    return Gathered(
        looks,
        judge.time_s[keep],
        table.floats("range_m")[keep],
        table.floats("aspect_rad")[keep],
        codes[keep],
        table.labels.get("target_id", ("",)),
        counts,
        gather([*table.problems, *judge.problems]),
    )


def _alpha(table: Table, trial: Trial, gain: float | None, judge: _Judge) -> Floats:
    alpha = table.floats("snr_per_m2")
    if gain is None and np.isnan(alpha).all() and trial.settings.detections.sphere_radius_m is not None:
        gain = 0.0  # only a sphere's loop gain is asked for
    if gain is not None and "range_m" in table:
        alpha = np.where(np.isnan(alpha), relative_alpha(table, trial.settings.radar_equation, gain), alpha)
    judge.set_aside(
        alpha == 0, "rows without energy (snr_per_m2 is 0): not looked at, not a miss", lambda i: "snr_per_m2 is 0"
    )
    judge.set_aside(
        ~((alpha > 0) & np.isfinite(alpha)), "snr_per_m2 is not a number above zero; set aside",
        lambda i: f"snr_per_m2 is {alpha[i]:g}",
    )  # fmt: skip
    return alpha


def _amplitudes(
    table: Table, trial: Trial, seen: Flags, pulses: Floats, scale: Floats, threshold: Floats, judge: _Judge
) -> tuple[Floats, NDArray[np.int8]]:
    own = trial.settings.detections
    logged = table.floats("amplitude")
    offset = pulses if own.amplitude == "signal" else np.zeros(len(pulses))
    z = logged * scale + offset
    if "amplitude" in table and not np.isnan(logged).all():
        judge.set_aside(
            seen & np.isnan(z), "detections without an amplitude; set aside",
            lambda i: "detected is 1 and amplitude is missing",
        )  # fmt: skip
        judge.set_aside(
            seen & (z < threshold * (1 - 1e-6)), "amplitudes of detections below their threshold; set aside",
            lambda i: f"amplitude {z[i]:.6g} is below the threshold {threshold[i]:.6g} (as sums with noise)",
        )  # fmt: skip
        z = np.where(seen, np.maximum(z, threshold), z)
        kind = np.where(seen, DETECTION, MISS)
    else:
        kind = np.where(seen, HIT, MISS)
    if own.saturation is not None:
        limit = own.saturation * scale + offset
        with np.errstate(invalid="ignore"):
            full = seen & (z >= limit)
        kind = np.where(full, SATURATED, kind)
        z = np.where(full, limit, z)
    return np.where((kind == DETECTION) | (kind == SATURATED), z, 0.0), kind.astype(np.int8)


def bins_of_looks(gathered: Gathered, bins: Bins, fold: bool) -> NDArray[np.int32]:
    """The bin of each look. Raises SettingsError for a variable a detections log cannot have."""
    if bins.variable not in ("range", "aspect", "snr", "time"):
        raise SettingsError(
            f"bins.variable '{bins.variable}' is not in a detections log; it has range, aspect, snr and time"
        )
    values = gathered.values_of(bins.variable)
    if bins.variable == "aspect":
        values = aspect_between(values, bins.start, fold)
    return bins.index(values)


def false_alarms_matter(looks: Looks, missed: float) -> bool:
    """Whether a strange cell may often stand in for the target: (m - 1) P_F not small against 1 - P_D."""
    rate = (looks.cells - 1.0) * float(np.mean(false_alarm_of(looks.threshold, looks.pulses)))
    return rate > 0.1 * missed
