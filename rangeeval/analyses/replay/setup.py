"""Which filter, with which numbers: the settings of a trial over the ready-made filters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rangeeval.errors import SettingsError, did_you_mean
from rangeeval.model import Trial
from rangeeval.model.settings import ReplaySettings
from rangeeval.tracking.filters import FILTERS, AlphaBeta, AnyFilter, Filter

DEFAULT = "imm"
GATE_PROBABILITY = 1.0 - 1e-6
RESTART_AFTER = 3
RESTART_GAP_S = 30.0  # or ten usual intervals, where that is longer
METHODS = ("id", "nearest", "global", "pda")


def filter_of(name: str, trial: Trial, interval_s: float) -> AnyFilter:
    """The filter of that name with what the trial's `[replay]` settings change.

    Raises SettingsError naming the nearest filter, or the setting whose number of values does not fit.
    """
    if name not in FILTERS:
        raise SettingsError(f"filter '{name}' is not known; {did_you_mean(name, FILTERS)}")
    own, spec = trial.settings.replay, FILTERS[name]
    common: dict[str, Any] = {
        "gate_probability": GATE_PROBABILITY if own.gate_probability is None else own.gate_probability,
        "restart_after": RESTART_AFTER if own.restart_after is None else own.restart_after,
        "restart_gap_s": max(RESTART_GAP_S, 10.0 * interval_s) if own.restart_gap_s is None else own.restart_gap_s,
    }
    if isinstance(spec, AlphaBeta):
        return _alpha_beta(replace(spec, **common), trial)
    return _kalman(replace(spec, **common), own, name)


def _alpha_beta(spec: AlphaBeta, trial: Trial) -> AlphaBeta:
    own, site = trial.settings.replay, trial.settings.site
    if own.face == "site":
        spec = replace(spec, heading_rad=math.radians(site.heading_deg), tilt_rad=math.radians(site.tilt_deg))
    if own.design_acceleration_m_s2 is not None:
        spec = replace(spec, design_acceleration_m_s2=own.design_acceleration_m_s2)
    if own.alpha:
        alpha, beta = (_three(values, key) for values, key in ((own.alpha, "alpha"), (own.beta, "beta")))
        spec = replace(spec, alpha=alpha, beta=beta)
    return spec


def _three(values: Sequence[float], key: str) -> tuple[float, float, float]:
    if len(values) == 1:
        return (values[0],) * 3
    if len(values) != 3:
        raise SettingsError(f"replay.{key} has {len(values)} values, expected one, or three (range, y, z)")
    return values[0], values[1], values[2]


def _kalman(spec: Filter, own: ReplaySettings, name: str) -> Filter:
    models = list(spec.models)
    if own.process_noise_m_s2 and len(own.process_noise_m_s2) == len(models):
        models = [replace(m, sigma_m_s2=v) for m, v in zip(models, own.process_noise_m_s2, strict=True)]
    elif own.process_noise_m_s2 and own.filter in (None, name):
        raise SettingsError(
            f"replay.process_noise_m_s2 has {len(own.process_noise_m_s2)} values, "
            f"filter '{name}' has {len(models)} models"
        )
    if own.turn_noise_rad_s is not None:
        models = [replace(m, sigma_turn_rad_s=own.turn_noise_rad_s) if m.motion.startswith("ct") else m for m in models]
    if own.turn_prior_rad_s is not None:
        models = [replace(m, prior_turn_rad_s=own.turn_prior_rad_s) if m.motion.startswith("ct") else m for m in models]
    spec = replace(spec, models=tuple(models))
    if own.transition and len(own.transition) == len(models):
        rows = np.array(own.transition)
        if rows.shape != (len(models),) * 2 or np.any(rows < 0) or np.any(np.abs(rows.sum(axis=1) - 1) > 1e-6):
            raise SettingsError("replay.transition: every row must hold one probability a model and sum to 1")
        spec = replace(spec, transition=own.transition)
    if own.reference_interval_s is not None:
        spec = replace(spec, reference_interval_s=own.reference_interval_s)
    return spec


def modes(spec: AnyFilter) -> tuple[str, ...]:
    """The models of a filter in words, in order; empty for alpha-beta."""
    words = {"cv": "constant velocity", "ca": "constant acceleration", "ct": "turn", "ct-second-order": "turn"}
    if isinstance(spec, AlphaBeta):
        return ()
    return tuple(f"{words[m.motion]}, {m.sigma_m_s2:g} m/s²" for m in spec.models)


def described(spec: AnyFilter) -> dict[str, object]:
    """The filter's numbers as a result's settings keep them."""
    if isinstance(spec, AlphaBeta):
        return {
            "alpha": list(spec.alpha) if spec.alpha else f"tracking index of {spec.design_acceleration_m_s2:g} m/s^2",
            "beta": list(spec.beta) if spec.beta else "with alpha",
        }
    return {
        "models": list(modes(spec)),
        "turn_noise_rad_s": [m.sigma_turn_rad_s for m in spec.models if m.motion.startswith("ct")],
        "turn_prior_rad_s": [m.prior_turn_rad_s for m in spec.models if m.motion.startswith("ct")],
        "transition": [list(row) for row in spec.transition],
        "reference_interval_s": spec.reference_interval_s,
        "update": spec.update,
    }
