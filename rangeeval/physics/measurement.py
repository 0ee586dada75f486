"""What a radar should measure: sigma of range and angle from the signal-to-noise ratio, and bins of equal SNR
span.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

SPEED_OF_LIGHT_M_S = 299792458.0


def snr_from_db(snr_db: ArrayLike) -> FloatArray:
    """Power ratio from decibels."""
    ratio: FloatArray = 10 ** (_float(snr_db) / 10)
    return ratio


def snr_to_db(snr: ArrayLike) -> FloatArray:
    """Decibels from a power ratio; NaN where the ratio is not above zero."""
    ratio = _float(snr)
    with np.errstate(divide="ignore", invalid="ignore"):
        decibel: FloatArray = np.where(ratio > 0, 10 * np.log10(ratio), np.nan)[()]
    return decibel


def range_sigma(snr_db: ArrayLike, bandwidth_hz: ArrayLike, floor_m: ArrayLike = 0.0) -> FloatArray:
    """Sigma (m) of a range measurement: c / (2 B sqrt(2 SNR)), a floor added in quadrature.

    The floor stands for quantisation, multipath and glint.

    References
    ----------
    Barton, Radar System Analysis, on pulse-delay measurement.
    """
    resolution = SPEED_OF_LIGHT_M_S / (2 * _float(bandwidth_hz))
    sigma: FloatArray = np.hypot(resolution / np.sqrt(2 * snr_from_db(snr_db)), _float(floor_m))
    return sigma


def angle_sigma(
    snr_db: ArrayLike, beamwidth_rad: ArrayLike, monopulse_slope: ArrayLike = 1.6, floor_rad: ArrayLike = 0.0
) -> FloatArray:
    """Sigma (rad) of a monopulse angle measurement: beamwidth / (k_m sqrt(2 SNR)), a floor added in
    quadrature.

    `beamwidth_rad` is the 3 dB beamwidth; the slope k_m is about 1.6.

    References
    ----------
    Barton, Radar System Analysis, on monopulse.
    """
    thermal = _float(beamwidth_rad) / (_float(monopulse_slope) * np.sqrt(2 * snr_from_db(snr_db)))
    sigma: FloatArray = np.hypot(thermal, _float(floor_rad))
    return sigma


def cross_range_sigma(
    angle_sigma_rad: ArrayLike, range_m: ArrayLike, sine: ArrayLike, range_sigma_m: ArrayLike = 0.0
) -> FloatArray:
    """Sigma (m) of y = R sin(theta): R cos(theta) sigma_theta, and sin(theta) sigma_R where range noise
    enters.

    A tracker that forms its angle residual with the predicted range has no range noise in it: leave
    `range_sigma_m` 0.
    """
    s = _float(sine)
    cosine = np.sqrt(np.clip(1 - s**2, 0.0, None))
    sigma: FloatArray = np.hypot(_float(range_m) * cosine * _float(angle_sigma_rad), s * _float(range_sigma_m))
    return sigma


def filtered_sigma(measurement_sigma: ArrayLike, alpha: ArrayLike, beta: ArrayLike) -> FloatArray:
    """Sigma of an alpha-beta filter's estimate that a measurement sigma predicts, for a target at constant
    velocity.

    4 to 11 % low when the target manoeuvres as the gains expect. NaN for gains without a steady state.

    References
    ----------
    Shin and Kim (2015), eq 8.
    """
    a, b = _float(alpha), _float(beta)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = (2 * a**2 - 3 * a * b + 2 * b) / (a * (4 - 2 * a - b))
        stable = (a > 0) & (b > 0) & (2 * a + b < 4)
        sigma: FloatArray = _float(measurement_sigma) * np.sqrt(np.where(stable, ratio, np.nan))
    return sigma


def snr_at_range(range_m: ArrayLike, reference_snr_db: ArrayLike, reference_range_m: ArrayLike) -> FloatArray:
    """SNR (dB) at a range, from that at a reference range, falling with the fourth power."""
    snr: FloatArray = _float(reference_snr_db) + 40 * np.log10(_float(reference_range_m) / _float(range_m))
    return snr


def snr_span(low_m: ArrayLike, high_m: ArrayLike) -> FloatArray:
    """Change of SNR (dB) across a range bin: 40 log10(high / low); infinite for a bin that starts at zero."""
    with np.errstate(divide="ignore"):
        span: FloatArray = 40 * np.log10(_float(high_m) / _float(low_m))
    return span


def constant_snr_width(centre_m: ArrayLike, span_db: ArrayLike) -> FloatArray:
    """Width (m) of a range bin around a centre that spans a given SNR change: 0.0575 R for 1 dB."""
    k = 10 ** (_float(span_db) / 40)
    width: FloatArray = _float(centre_m) * 2 * (k - 1) / (k + 1)
    return width


def constant_snr_edges(low_m: float, high_m: float, span_db: float) -> FloatArray:
    """Edges (m) of range bins from `low_m` up to at least `high_m`, each spanning `span_db`.

    Raises
    ------
    ValueError : the ends or the span are not above zero, or the ends are in the wrong order.
    """
    if not (0 < low_m < high_m and span_db > 0):
        raise ValueError(
            f"bins from {low_m} m to {high_m} m of {span_db} dB; give 0 < low < high and a span above 0 dB"
        )
    count = int(np.ceil(40 * np.log10(high_m / low_m) / span_db - 1e-9))
    edges: FloatArray = low_m * np.power(10.0, span_db / 40 * np.arange(count + 1, dtype=np.float64))
    return edges


def _float(value: ArrayLike) -> FloatArray:
    return np.asarray(value, dtype=np.float64)
