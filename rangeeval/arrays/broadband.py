"""Time series to snapshots of frequency bins, each of them narrow band."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, eq=False)
class BinSnapshots:
    """Complex snapshots (K, bins, M), the sample in the middle of each, and the bins' frequencies."""

    snapshots: NDArray[np.complex128]
    centre_sample: NDArray[np.float64]
    frequency_hz: NDArray[np.float64]


def bin_snapshots(
    signals: ArrayLike,
    sample_rate_hz: float,
    length: int,
    *,
    band_hz: tuple[float, float],
    overlap: float = 0.5,
) -> BinSnapshots:
    """Windowed Fourier transforms of real signals (samples, M), the bins inside the band.

    The phases follow this room's convention: a sensor nearer to the source is ahead. Each stretch loses its mean and
    is weighted by a Hann window, scaled so that white noise of variance v has power v in every bin. A stretch with a
    NaN gives a NaN snapshot. A bin is narrow when the wave crosses the array in much less than `length` samples.
    """
    x = np.asarray(signals, dtype=np.float64)
    if x.ndim != 2:
        raise ValueError(f"signals of shape {x.shape}; give (samples, sensors)")
    if not 8 <= length <= len(x):
        raise ValueError(f"stretches of {length} samples; give 8 to {len(x)}, the length of the record")
    if not 0 <= overlap < 1:
        raise ValueError(f"the overlap is {overlap}; give 0 or more and less than 1")
    frequency: NDArray[np.float64] = np.asarray(np.fft.rfftfreq(length, 1.0 / sample_rate_hz), dtype=np.float64)
    low, high = band_hz
    inside = (frequency >= low) & (frequency <= high) & (frequency > 0)
    if not inside.any():
        raise ValueError(
            f"no bin between {low:g} and {high:g} Hz; {length} samples at {sample_rate_hz:g} Hz have bins of"
            f" {sample_rate_hz / length:g} Hz up to {sample_rate_hz / 2:g} Hz"
        )
    first = np.arange(0, len(x) - length + 1, max(1, round(length * (1.0 - overlap))))
    window = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(length) + 0.5) / length)
    window /= np.sqrt((window**2).sum())
    snapshots = np.empty((first.size, int(inside.sum()), x.shape[1]), np.complex128)
    for row, start in enumerate(first):
        stretch = x[start : start + length]
        snapshots[row] = np.fft.rfft((stretch - stretch.mean(axis=0)) * window[:, None], axis=0)[inside]
    return BinSnapshots(snapshots, first.astype(np.float64) + (length - 1) / 2, frequency[inside])
