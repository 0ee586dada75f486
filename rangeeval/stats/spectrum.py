"""Oscillations in evenly spaced samples: where the spectrum peaks, the sine that fits, densities and coherence.

Densities are one-sided, in unit^2/Hz: white noise of sigma per sample has 2 sigma^2 dt.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

from rangeeval.angles import wrapped

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

HANN_OVERLAP_FREEDOM = 1.89  # degrees of freedom a half-overlapped Hann segment adds, of 2 (Welch 1967)


def spectral_peak(values: ArrayLike, interval_s: float, low_hz: float = 0.0, high_hz: float = np.inf) -> float:
    """Frequency (Hz) at which the spectrum of evenly spaced samples is highest; NaN with fewer than 8 or no variation.

    Mean removed, Hann window, zero-padded to the power of two at or above 8 n, the highest line between the ends (and
    the limits), a parabola through the logarithms of its power and its neighbours'.
    """
    x = np.asarray(values, dtype=np.float64)
    if x.size < 8 or not np.ptp(x) > 0:
        return float("nan")
    size = 1 << int(np.ceil(np.log2(8 * x.size)))
    power = np.abs(fft.rfft((x - x.mean()) * np.hanning(x.size), size)) ** 2
    step = 1 / (size * interval_s)
    first = max(1, int(np.ceil(low_hz / step)))
    last = int(min(power.size - 1, np.floor(high_hz / step) + 1 if np.isfinite(high_hz) else power.size - 1))
    if last - first < 1:
        return float("nan")
    k = first + int(np.argmax(power[first:last]))
    with np.errstate(divide="ignore"):
        before, here, after = np.log(power[k - 1 : k + 2])
    bend = before - 2 * here + after
    shift = 0.5 * (before - after) / bend if np.isfinite(bend) and bend != 0 else 0.0
    return float((k + shift) * step)


@dataclass(frozen=True)
class SineFit:
    """offset + amplitude sin(2 pi f t + phase), the sum of squares left, the number of samples, standard errors.

    The errors of `offset` and `amplitude` hold for white noise about the sine.
    """

    offset: float
    amplitude: float
    phase: float
    left: float
    n: int
    frequency_hz: float
    offset_error: float = float("nan")
    amplitude_error: float = float("nan")


def sine_fit(time_s: ArrayLike, values: ArrayLike, frequency_hz: float) -> SineFit:
    """Least-squares sine of known frequency through samples at any times; values that are not finite are left out.

    Raises
    ------
    ValueError : fewer than three samples.

    References
    ----------
    IEEE 1057, three-parameter sine fit.
    """
    t, x = np.asarray(time_s, dtype=np.float64), np.asarray(values, dtype=np.float64)
    use = np.isfinite(x) & np.isfinite(t)
    if not use.all():
        t, x = t[use], x[use]
    if x.size < 3:
        raise ValueError(f"{x.size} samples; a sine has three parameters")
    w = 2 * np.pi * frequency_hz
    middle = 0.5 * (t[0] + t[-1])  # far from zero the columns would be as good, the phase would lose digits
    angle = w * (t - middle)
    s, c = np.sin(angle), np.cos(angle)
    mean = x.mean()
    y = x - mean
    sums = (s @ c, s.sum(), c.sum())
    normal = np.array([[s @ s, sums[0], sums[1]], [sums[0], c @ c, sums[2]], [sums[1], sums[2], x.size]])
    (a, b, offset), *_ = np.linalg.lstsq(normal, np.array([s @ y, c @ y, y.sum()]), rcond=None)
    y -= a * s
    y -= b * c
    y -= offset
    left = float(y @ y)
    amplitude = float(np.hypot(a, b))
    phase = float(wrapped(np.arctan2(b, a) - w * middle))
    variance = left / max(x.size - 3, 1)
    try:
        covariance = np.linalg.inv(normal) * variance
        offset_error = float(np.sqrt(covariance[2, 2]))
        amplitude_error = float(np.sqrt(0.5 * (covariance[0, 0] + covariance[1, 1])))
    except np.linalg.LinAlgError:
        offset_error = amplitude_error = float("nan")
    return SineFit(mean + float(offset), amplitude, phase, left, x.size, frequency_hz, offset_error, amplitude_error)


def frequency_error(amplitude: float, sigma: float, n: float, interval_s: float) -> float:
    """Standard error (Hz) of a Hann-windowed spectral peak of a steady sine in white noise of `sigma` per sample.

    The bound on any estimate is sqrt(6) sigma / (pi A dt n^1.5) (Rife and Boorstyn 1974); the window costs a factor
    of 1.53 (counted over simulated records, see the tests).
    """
    if not (amplitude > 0 and n > 0):
        return float("nan")
    return float(1.53 * np.sqrt(6) * sigma / (np.pi * amplitude * interval_s * n**1.5))


@dataclass
class CrossSpectra:
    """Welch cross-spectral densities of several channels, added up stretch by stretch in bounded memory.

    Half-overlapping Hann segments of `size` samples, each with its mean removed. A segment with a missing sample, or
    across the end of a stretch, is left out. The density of any weighted sum of the channels follows (`density`), so
    one pass serves every method.

    References
    ----------
    Welch (1967), The use of fast Fourier transform for the estimation of power spectra.
    """

    channels: int
    size: int
    interval_s: float
    segments: int = 0
    total: ComplexArray = field(init=False)
    _rest: FloatArray = field(init=False)
    _window: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.total = np.zeros((self.size // 2 + 1, self.channels, self.channels), np.complex128)
        self._rest = np.empty((self.channels, 0))
        self._window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(self.size) / self.size)

    def add(self, values: FloatArray) -> None:
        """Add samples (channels, n) that follow those added before."""
        joined = np.concatenate([self._rest, values], axis=1) if self._rest.size else values
        hop = self.size // 2
        count = (joined.shape[1] - self.size) // hop + 1 if joined.shape[1] >= self.size else 0
        if count:
            view = np.lib.stride_tricks.sliding_window_view(joined, self.size, axis=1)[:, : count * hop : hop]
            batch = max(1, 2**18 // self.size)
            for start in range(0, count, batch):
                part = view[:, start : start + batch]
                whole = np.isfinite(part.sum(axis=(0, 2)))
                part = part[:, whole] if not whole.all() else part
                lines = fft.rfft((part - part.mean(axis=2, keepdims=True)) * self._window, axis=2)
                for i in range(self.channels):
                    for j in range(i, self.channels):
                        here = np.einsum("sf,sf->f", lines[i], np.conj(lines[j]))
                        self.total[:, i, j] += here
                        if i != j:
                            self.total[:, j, i] += np.conj(here)
                self.segments += int(whole.sum())
        self._rest = np.array(joined[:, count * hop :])

    def end(self) -> None:
        """The stretch ends: what comes next does not follow it."""
        self._rest = np.empty((self.channels, 0))

    @property
    def frequency_hz(self) -> FloatArray:
        """The lines, from 0 to the Nyquist frequency."""
        return np.arange(self.size // 2 + 1) / (self.size * self.interval_s)

    def density(self, weights: ArrayLike) -> FloatArray:
        """One-sided density (unit^2/Hz) of the weighted sum of the channels; NaN before any segment."""
        w = np.asarray(weights, dtype=np.float64)
        if not self.segments:
            return np.full(self.total.shape[0], np.nan)
        scale = self.interval_s / (np.sum(self._window**2) * self.segments)
        power = np.real(np.einsum("i,fij,j->f", w, self.total, w)) * scale
        power[1 : -1 if self.size % 2 == 0 else None] *= 2
        return np.asarray(np.maximum(power, 0.0))

    def coherence(self, i: int, j: int) -> FloatArray:
        """Squared coherence of two channels at each line, 0 to 1."""
        with np.errstate(divide="ignore", invalid="ignore"):
            value: FloatArray = np.abs(self.total[:, i, j]) ** 2 / np.real(self.total[:, i, i] * self.total[:, j, j])
        return value

    def phase(self, i: int, j: int) -> FloatArray:
        """Phase (rad) by which channel i leads channel j at each line."""
        return np.asarray(np.angle(self.total[:, i, j]))

    def floor(self, weights: ArrayLike, low_hz: float = 0.0) -> tuple[float, float]:
        """Level of the flat noise floor (unit^2/Hz) of a weighted sum above `low_hz`, and its degrees of freedom.

        The median of the lines: oscillations, a few lines each, do not lift it. With k degrees of freedom a line the
        median is the chi-square median over k; its scatter is that of 64 % of the lines.
        """
        from scipy.special import gammaincinv

        density = self.density(weights)
        chosen = density[(self.frequency_hz >= low_hz) & (np.arange(density.size) > 1)][:-1]
        if not self.segments or chosen.size < 4:
            return float("nan"), float("nan")
        k = max(2.0, HANN_OVERLAP_FREEDOM / 2 * 2 * self.segments) if self.segments > 1 else 2.0
        centre = 2 * gammaincinv(k / 2, 0.5) / k
        # Neighbouring Hann lines share their noise: 2/3 of them are independent.
        return float(np.median(chosen) / centre), float(max(0.64 * k * chosen.size * 0.67, 1.0))


def segment_size(n: int) -> int:
    """A power of two that leaves n samples about sixteen half-overlapped segments: 16 to 8192."""
    return int(np.clip(1 << int(np.log2(max(n, 2) / 8)), 16, 8192))
