"""RCS and detection: mean RCS by Swerling maximum likelihood with the misses counted, and detection probability."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rangeeval.analyses.rcs.gathering import (
    Gathered,
    bins_of_looks,
    false_alarms_matter,
    gain_of,
    gather_looks,
)
from rangeeval.analyses.rcs.numbers import (
    PERCENTS,
    CaseFit,
    Method,
    Place,
    RangeLaw,
    Window,
    correlations,
    fit_case,
    limit_flags,
    mean_detection,
    test_values,
    window_flags,
    window_rows,
)
from rangeeval.analyses.rcs.series import amplitude_series, curve_series, sliding_series
from rangeeval.errors import InputError, SettingsError, did_you_mean
from rangeeval.model import Bins, Estimate, Problem, Result, Trial, as_trial
from rangeeval.physics.radar_equation import sphere_rcs
from rangeeval.stats.swerling import CASES, MISS, Case, Looks, Windows
from rangeeval.stats.swerling.fitness import (
    FEW_LOOKS,
    Choice,
    Shape,
    bootstrap,
    choose,
    free_shape,
    homogeneity,
    measures,
)
from rangeeval.stats.swerling.likelihood import detections, fit, in_closed_form, profile_interval

METHODS = ("ml-a", "em-a", "ml-b", "em-b", "med")
SWERLING = (*CASES, "free", "auto")
INTERVALS = ("profile", "bootstrap", "credible")
SHOWN_WINDOW = (10, 100)  # looks in the figure's sliding estimate: a fiftieth of the log, within these
ASPECT_STEP = math.radians(15.0)  # of the figure over aspect
WORK = 2_000_000  # looks simulated in a bootstrap, at most
SERIES_LOOKS = 1000  # of a case without closed form, at most, for p-values
SHAPE_LOOKS = 20_000  # a free shape is found from at most so many: then its ln is good to 2 %
Floats = NDArray[np.float64]


def rcs(
    trial: Trial | Any,
    bins: Bins | None = None,
    *,
    confidence: float = 0.95,
    method: str = "ml-a",
    swerling: str = "auto",
    window: int | None = None,
    interval: str = "profile",
    per_track: bool = False,
    replicates: int = 499,
    seed: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Result:
    """Mean RCS and detection probability in each bin from logged looks, missed ones included.

    A miss says that the echo stayed below the threshold; leaving misses out would bias the RCS upward where the
    detection probability is low. The error of alpha (the radar equation) goes straight into the RCS and is in no
    interval here.

    Parameters
    ----------
    trial : holds a `detections` log (CONTRACT section 3), or a plain table of one.
    bins : of range, aspect, snr (that of 1 m^2) or time; by default those of the trial's settings.
    confidence : of the intervals (profile likelihood; one-sided where nothing or everything was detected).
    method : `ml-a` exact maximum likelihood; `em-a`, `ml-b`, `em-b`, `med` the source paper's others.
    swerling : `0` to `4`; `free`, one shape for all bins found from the looks; or `auto`: all cases that differ, told
        apart by AIC over the whole trial, never bin by bin.
    interval : `profile` likelihood, parametric `bootstrap`, or Bayesian `credible`; limits are exact in each.
    window : looks in the sliding estimate; given, its rows (`rcs_sliding`) are among the estimates.
    per_track : also rows for each target.
    replicates, seed : of the parametric bootstrap behind the p-values of fit (fewer for long logs).
    progress : called with the number of rows read.

    Raises
    ------
    InputError : no detections log, no alpha or threshold to be had, or not one usable look.
    SettingsError : an impossible argument.

    References
    ----------
    Jung and Hong (2017), eqs 1-15, as corrected in docs/explanation/rcs.md.
    """
    trial = as_trial(trial)
    bins = bins or Bins.of(trial.settings.bins)
    asked = ((method, METHODS, "method"), (swerling, SWERLING, "swerling"), (interval, INTERVALS, "interval"))
    for value, known, word in asked:
        if value not in known:
            raise SettingsError(f"{word} '{value}' is not known; {did_you_mean(value, known)}")
    if not 0.0 < confidence < 1.0:
        raise SettingsError(f"confidence is {confidence:g}, expected more than 0 and less than 1")
    if window is not None and window < 1:
        raise SettingsError(f"window is {window}, expected 1 look or more")
    gathered = gather_looks(trial, progress)
    own = trial.settings.detections
    if own.sphere_radius_m is not None and trial.settings.radar_equation.wavelength_m is None:
        raise SettingsError("detections.sphere_radius_m needs radar_equation.wavelength_m")
    problems = list(gathered.problems)
    places, order, windows = _places(gathered, bins, own.fold_aspect, problems)
    binned = gathered.take(order)
    whole = Windows.whole(gathered.looks)
    each, cut = (binned.looks, windows) if places else (gathered.looks, whole)
    cases = _cases(gathered.looks, method, swerling)
    shape = _shape(each, cut, confidence) if swerling == "free" or (len(cases) > 1 and len(each) >= FEW_LOOKS) else None
    if swerling == "free" and shape is not None:
        cases = (shape.case,)
    how = Method(method, cases, confidence, interval, max(replicates, 199), seed)
    choice = choose(each, cut, cases)
    chosen = next(c for c in cases if c.name == choice.best)
    made = _replicates(gathered.looks, chosen, replicates)
    among = choice.among if len(cases) > 1 else (chosen.name,)

    fits = {c.name: fit_case(binned.looks, windows, c, how) for c in cases} if places else {}
    all_fits = {c.name: fit_case(gathered.looks, whole, c, how) for c in cases}
    every = all_fits[chosen.name]
    model_s = np.array([every.s[0], every.low[0], every.high[0]])

    rng = np.random.default_rng(seed)
    rows: list[Estimate] = []
    law = RangeLaw.of(gathered.looks, gathered.range_m)
    done = _windows(gathered, whole, np.arange(len(gathered.looks)), [Place()], all_fits, bins, chosen, made, rng)
    rows += [row for w in done for row in window_rows(w, how, chosen, among, model_s)]
    rows += _trial_rows(
        done[0], gathered, binned, windows, fits, chosen, choice, shape, law, model_s, trial, confidence
    )
    if places:
        for w in _windows(binned, windows, np.arange(len(order)), places, fits, bins, chosen, made, rng):
            rows += window_rows(w, how, chosen, among, model_s)
    if per_track and len(gathered.targets) > 1:
        rows += _target_rows(gathered, bins, own.fold_aspect, how, chosen, among)
    length = window or int(np.clip(len(gathered.looks) // 50, *SHOWN_WINDOW))
    slid = _sliding(gathered, length, 1 if window else max(1, length // 8), chosen, how)
    if window is not None:
        rows += [row for name, columns in slid.items() for row in _sliding_rows(name, columns, length)]
    missed = 1.0 - mean_detection(gathered.looks, chosen, float(every.own.s[0]))
    if false_alarms_matter(gathered.looks, missed):
        problems.append(Problem(
            trial.log("detections").source,
            f"strange cells matter: with {own.gate_cells} cells in the gate a false alarm may stand in for the target; "
            "the likelihood counts them",
        ))  # fmt: skip
    if len(set(gathered.target.tolist())) > 1:
        problems.append(Problem(
            trial.log("detections").source,
            f"{len(set(gathered.target.tolist()))} targets are pooled; rows per target come with --per-track",
        ))  # fmt: skip
    return Result(
        "rcs",
        tuple(rows),
        settings={
            "method": method,
            "swerling": swerling,
            "case": chosen.name,
            "cases": [c.name for c in cases],
            "case_verdict": choice.sentence if len(cases) > 1 else _verdict(chosen, shape),
            "case_among": list(among),
            "confidence": confidence,
            "interval": interval,
            "window": length,
            "variable": bins.variable,
            "bin_width": bins.width,
            "bin_start": bins.start,
            "bin_ratio": bins.ratio,
            "min_samples": bins.min_samples,
            "amplitude": own.amplitude,
            "integrated": own.integrated,
            "pulses": own.pulses,
            "gate_cells": own.gate_cells,
            "loop_gain_db": gain_of(trial.settings.radar_equation),
            "calibration_db": trial.settings.radar_equation.calibration_db,
            "replicates": made,
            "seed": seed,
            "counts": dict(gathered.counts),
        },
        problems=tuple(problems),
        series=_series(
            gathered, binned, windows, all_fits, fits, cases, chosen, law, model_s, slid, confidence, own.fold_aspect
        ),
    )


def _replicates(looks: Looks, case: Case, asked: int) -> int:
    """How many replicates a bootstrap can make in a few seconds; none of a long log whose case is a slow series."""
    if not asked or (not in_closed_form(looks, case) and len(looks) > SERIES_LOOKS):
        return 0
    work = WORK if in_closed_form(looks, case) else 39 * SERIES_LOOKS
    return min(asked, max(39, work // len(looks)))


def _shape(looks: Looks, windows: Windows, confidence: float) -> Shape:
    """The free shape, from every so manieth look where there are many."""
    step = max(1, len(looks) // SHAPE_LOOKS)
    rows = np.arange(0, len(looks), step)
    counts = np.bincount(np.searchsorted(windows.last, rows, side="right"), minlength=len(windows))
    return free_shape(looks.take(rows), Windows.groups(counts[counts > 0]), confidence)


def _verdict(chosen: Case, shape: Shape | None) -> str:
    if chosen.free and shape is not None:
        return (
            f"Free shape: K = {shape.k:.3g} [{shape.low:.3g}, {shape.high:.3g}] over all bins (Swerling 1: 1, Swerling "
            "3: 2, steady: beyond reach); intervals of the RCS take it as known."
        )
    return f"Swerling {chosen.name}, as asked."


def _cases(looks: Looks, method: str, swerling: str) -> tuple[Case, ...]:
    """The cases to fit; for a free shape none yet."""
    single = bool((looks.pulses == 1).all())
    if method in ("em-a", "em-b") and (not single or swerling in ("0", "free") or (looks.kind > 1).any()):
        raise SettingsError(
            f"method {method} is defined for Swerling 1 to 4, single pulses and recorded amplitudes; use ml-a"
        )
    if swerling == "free":
        return ()
    if swerling != "auto":
        return (CASES[swerling],)
    if method in ("em-a", "em-b"):
        return CASES["1"], CASES["3"]
    return tuple(CASES[c] for c in ("013" if single else "01234"))


def _places(
    gathered: Gathered, bins: Bins, fold: bool, problems: list[Problem]
) -> tuple[list[Place], NDArray[np.int64], Windows]:
    """The bins that hold looks, the looks in their order, and the window of each."""
    index = bins_of_looks(gathered, bins, fold)
    inside = index >= 0
    if not inside.any():
        problems.append(Problem("detections", f"no look has a {bins.variable}: no bins, only the whole trial"))
    elif not inside.all():
        problems.append(Problem("detections", f"looks in no bin of {bins.variable}", int((~inside).sum())))
    order = np.argsort(index, kind="stable")[int((~inside).sum()) :]
    numbers, counts = np.unique(index[order], return_counts=True)
    places = []
    for i in numbers.tolist():
        low, high = bins.edges(i)
        if bins.variable == "aspect":
            high = min(high, (math.pi if fold else bins.start + 2 * math.pi))
        places.append(Place(bins.variable, low, high))
    return places, order.astype(np.int64), Windows.groups(counts)


def _windows(
    binned: Gathered, windows: Windows, order: NDArray[np.intp], places: list[Place], fits: Mapping[str, CaseFit],
    bins: Bins, chosen: Case, replicates: int, rng: np.random.Generator,
) -> list[Window]:  # fmt: skip
    """Each window with its fits, tests and flags."""
    own = fits[chosen.name].own
    s = np.where(np.isfinite(own.s), own.s, 0.0)
    m = measures(binned.looks, windows, chosen, s)
    related = correlations(m, windows, order, binned.time_s)
    p = bootstrap(binned.looks, windows, chosen, s, replicates, rng) if replicates else None
    found = []
    for i, place in enumerate(places):
        looks = binned.looks.take(slice(int(windows.first[i]), int(windows.last[i])))
        tests = test_values(p, i) if p is not None else {}
        found.append(Window(
            place, looks,
            {c: (float(f.s[i]), float(f.low[i]), float(f.high[i]), float(f.value[i])) for c, f in fits.items()},
            window_flags(looks, bins, tests, related[i]), tests, related[i],
        ))  # fmt: skip
    return found


def _trial_rows(
    whole: Window, gathered: Gathered, binned: Gathered, windows: Windows, fits: Mapping[str, CaseFit],
    chosen: Case, choice: Choice, shape: Shape | None, law: RangeLaw | None, model_s: Floats, trial: Trial,
    confidence: float,
) -> list[Estimate]:  # fmt: skip
    """What only the whole trial can tell: one RCS for all bins or not, which case, how far."""
    rows = []
    if fits and len(windows) > 1:
        test = homogeneity(binned.looks, windows, chosen, fits[chosen.name].own)
        flags = ("rcs-varies",) if test.p_value < 0.01 else ()
        rows.append(whole.row("rcs_homogeneity_p", "1", test.p_value, flags=flags))
    rows += [whole.row("aic_all_bins", "1", v, group=c, flags=()) for c, v in choice.aic.items()]
    if shape is not None:
        if shape.case.name not in choice.aic and len(gathered.looks) <= SHAPE_LOOKS:
            rows.append(whole.row("aic_all_bins", "1", shape.aic, group=shape.case.name, flags=()))
        bound = ("lower-limit",) if math.isinf(shape.high) else ("upper-limit",) if shape.low == 0.0 else ()
        rows.append(whole.row("swerling_shape", "1", shape.k, (shape.low, shape.high), flags=bound))
    if law is not None:
        for percent in PERCENTS:
            value, low, high = (law.range_for(percent / 100.0, chosen, float(s)) for s in model_s)
            beyond = not law.nearest <= value <= law.farthest
            rows.append(whole.row(
                f"detection_range_{percent}", "m", value, (low, high), flags=("extrapolated",) if beyond else ()
            ))  # fmt: skip
    radius = trial.settings.detections.sphere_radius_m
    if radius is not None:
        rows.append(_loop_gain(whole, gathered, radius, trial, confidence))
    return rows


def _loop_gain(whole: Window, gathered: Gathered, radius: float, trial: Trial, confidence: float) -> Estimate:
    """The loop gain from looks at a sphere: a steady target of known RCS, misses counted."""
    equation = trial.settings.radar_equation
    assert equation.wavelength_m is not None
    assumed = gain_of(equation)
    if assumed is None and not (np.isfinite(gathered.range_m)).all():
        raise InputError("a sphere calibration needs range_m on every look")
    known = sphere_rcs(radius, equation.wavelength_m)
    one = Windows.whole(gathered.looks)
    best = fit(gathered.looks, one, CASES["0"])
    low, high = profile_interval(gathered.looks, one, CASES["0"], best, confidence)
    db = [
        (assumed or 0.0) + 10.0 * math.log10(v / known) if 0 < v < math.inf else math.nan
        for v in (float(best.s[0]), float(low[0]), float(high[0]))
    ]
    return whole.row("loop_gain", "dB", db[0], (db[1], db[2]), flags=limit_flags(float(best.s[0])))


def _target_rows(
    gathered: Gathered, bins: Bins, fold: bool, how: Method, chosen: Case, among: tuple[str, ...]
) -> list[Estimate]:
    """Detection probability and RCS of each target, over the trial and in each bin."""
    rows: list[Estimate] = []
    for code, name in enumerate(gathered.targets):
        mine = gathered.take(gathered.target == code)
        if not len(mine.looks):
            continue
        places, order, windows = _places(mine, bins, fold, [])
        parts = [([Place(track=name)], mine, Windows.whole(mine.looks))]
        if places:
            named = [Place(p.variable, p.low, p.high, name) for p in places]
            parts.append((named, mine.take(order), windows))
        for here, looks, cut in parts:
            fitted = {c.name: c for c in (chosen, *(CASES[name] for name in among if name in CASES))}
            fits = {name: fit_case(looks.looks, cut, c, how) for name, c in fitted.items()}
            alone = Method(how.name, (), how.confidence)
            for w in _windows(looks, cut, np.arange(len(looks.looks)), here, fits, bins, chosen, 0,
                              np.random.default_rng(0)):  # fmt: skip
                s = w.fits[chosen.name]
                rows += window_rows(w, alone, chosen, among, np.array([s[0], s[1], s[2]]))
    return rows


Slid = Mapping[str, NDArray[Any]]


def _sliding(gathered: Gathered, length: int, step: int, case: Case, how: Method) -> dict[str, Slid]:
    """The estimate of the last `length` looks, after every `step` looks, of each target in time order."""
    found: dict[str, Slid] = {}
    for code, name in enumerate(gathered.targets):
        mine = np.flatnonzero(gathered.target == code)
        mine = mine[np.argsort(gathered.time_s[mine], kind="stable")]
        if len(mine) < length:
            continue
        one = gathered.take(mine)
        windows = Windows.sliding(len(mine), length).take(np.arange(0, len(mine) - length + 1, step))
        if how.name == "med":
            from rangeeval.stats.swerling.paper import median_rule

            s = median_rule(one.looks)[windows.last - 1]
            low = high = np.full(len(s), np.nan)
        else:
            estimate = fit_case(one.looks, windows, case, Method(how.name, how.cases, how.confidence))
            s, low, high = estimate.s, estimate.low, estimate.high
        found[name] = {
            "first_s": one.time_s[windows.first],
            "time_s": one.time_s[windows.last - 1],
            "s": np.where((s > 0) & np.isfinite(s), s, np.nan),
            "low": low,
            "high": high,
            "hits": detections(one.looks, windows),
        }
    return found


def _sliding_rows(name: str, slid: Slid, length: int) -> list[Estimate]:
    columns = (slid[c].tolist() for c in ("first_s", "time_s", "s", "low", "high", "hits"))
    return [
        Estimate(
            quantity="rcs_sliding", unit="m^2", value=s, low=low, high=high, n=length, n_eff=float(length),
            variable="time", bin_low=first, bin_high=last, track_id=name or None,
            flags=("upper-limit",) if hits == 0 else ("few-detections",) if hits < 3 else (),
            extra={"detections": hits},
        )
        for first, last, s, low, high, hits in zip(*columns, strict=True)
    ]  # fmt: skip


def _series(
    gathered: Gathered, binned: Gathered, windows: Windows, all_fits: Mapping[str, CaseFit],
    fits: Mapping[str, CaseFit], cases: tuple[Case, ...], chosen: Case, law: RangeLaw | None, model_s: Floats,
    slid: Mapping[str, Slid], confidence: float, fold: bool,
) -> dict[str, Mapping[str, list[float]]]:  # fmt: skip
    series: dict[str, Mapping[str, list[float]]] = {}
    for name, s in slid.items():
        series[f"sliding/{name}"] = sliding_series(s["time_s"], s["s"], s["low"], s["high"], s["hits"])
    if np.isfinite(gathered.aspect_rad).any():
        series["aspect"] = _aspect_series(gathered, chosen, confidence, fold)
    if law is not None:
        series["curve"] = curve_series(law, chosen, model_s)
    sizes = windows.last - windows.first
    if fits:
        of_look = {c.name: np.repeat(fits[c.name].s, sizes) for c in cases}
        series |= amplitude_series(binned, of_look, cases)
    else:
        of_look = {c.name: np.full(len(gathered.looks), all_fits[c.name].s[0]) for c in cases}
        series |= amplitude_series(gathered, of_look, cases)
    return series


def _aspect_series(gathered: Gathered, case: Case, confidence: float, fold: bool) -> dict[str, list[float]]:
    """Mean RCS in steps of aspect, with the profile interval; NaN where nothing was detected."""
    bins = Bins("aspect", ASPECT_STEP)
    places, order, windows = _places(gathered, bins, fold, [])
    looks = gathered.looks.take(order)
    found = fit(looks, windows, case)
    low, high = profile_interval(looks, windows, case, found, confidence)
    bounded = (found.s > 0) & np.isfinite(found.s)
    return {
        "low_rad": [p.low for p in places],
        "high_rad": [p.high for p in places],
        "rcs_m2": np.where(bounded, found.s, np.nan).tolist(),
        "low_m2": low.tolist(),
        "high_m2": high.tolist(),
        "looks": (windows.last - windows.first).astype(float).tolist(),
    }


__all__ = ["METHODS", "MISS", "SWERLING", "rcs"]
