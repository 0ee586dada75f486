"""The papers' chain snapshot by snapshot: PAST subspace, closed-form angular innovation, a Kalman filter a target.

References
----------
Yang (1995), IEEE Trans. SP 43, for PAST. The innovation: least squares of Pn (a + d x) = 0 over real and imaginary
parts, with the projector of a basis W that is not orthonormal, Pn = I - W (W^H W)^-1 W^H. Lag compensation and
coasting: docs/explanation/bearing.md.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rangeeval.arrays.manifold import respond
from rangeeval.arrays.small import cholesky, filled_up, forward, solve
from rangeeval.compiled import compiled

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_BLIND = 1e-10  # of |d|^2: less of the derivative outside the subspace says nothing
_FADE = 0.98  # smoothing of noise and power for soft coasting
_RIDGE = 1e-4  # of a sensor's gain: keeps the bound finite where two predictions coincide


class Scratch(NamedTuple):
    """Room of one run, so that the loop over snapshots allocates nothing."""

    response: Array  # (N, 4, M filled up): see `respond`
    inner_real: Array  # (N, width): W^H [W A D], columns N to 3N - 1 then L^-1 W^H [A D] with L L^H = W^H W
    inner_imag: Array
    factor: Complex  # (N, N): L
    seen_real: Array  # (N filled up,): y = W^H x
    seen_imag: Array
    gain_real: Array  # (N filled up,): zero beyond N
    gain_imag: Array
    gain: Complex  # (N,)


@compiled
def scratch(targets, sensors):  # type: ignore[no-untyped-def]
    """Room for so many targets and sensors."""
    wide, narrow = filled_up(3 * targets), filled_up(targets)
    return Scratch(
        np.zeros((targets, 4, filled_up(sensors))), np.zeros((targets, wide)), np.zeros((targets, wide)),
        np.empty((targets, targets), np.complex128), np.zeros(narrow), np.zeros(narrow),
        np.zeros(narrow), np.zeros(narrow), np.empty(targets, np.complex128),
    )  # fmt: skip


@compiled
def past(real, imag, inverse, x, forgetting, room):  # type: ignore[no-untyped-def]
    """Move the subspace basis W, columns 0 to N - 1 of real + j imag, and the inverse correlation by one snapshot."""
    sensors, n = real.shape[0], inverse.shape[0]
    seen_real, seen_imag, gain = room.seen_real, room.seen_imag, room.gain
    gain_real, gain_imag, wide = room.gain_real, room.gain_imag, filled_up(n)
    for i in range(wide):
        seen_real[i], seen_imag[i] = 0.0, 0.0
    for m in range(sensors):
        xr, xi = x[m].real, x[m].imag
        for i in range(wide):
            seen_real[i] += real[m, i] * xr + imag[m, i] * xi
            seen_imag[i] += real[m, i] * xi - imag[m, i] * xr
    scale = forgetting
    for i in range(n):
        total = 0.0j
        for k in range(n):
            total += inverse[i, k] * complex(seen_real[k], seen_imag[k])
        gain[i] = total
        scale += seen_real[i] * total.real + seen_imag[i] * total.imag
    share, growth = 1.0 / scale, 1.0 / forgetting
    for i in range(n):
        # Hermitian by construction: otherwise rounding grows at every step.
        own = gain[i] * share
        gain_real[i], gain_imag[i] = own.real, own.imag
        inverse[i, i] = (inverse[i, i].real - (own * gain[i].conjugate()).real) * growth
        for k in range(i + 1, n):
            inverse[i, k] = (inverse[i, k] - own * gain[k].conjugate()) * growth
            inverse[k, i] = inverse[i, k].conjugate()
    for m in range(sensors):
        er, ei = x[m].real, x[m].imag
        for i in range(n):
            er -= real[m, i] * seen_real[i] - imag[m, i] * seen_imag[i]
            ei -= real[m, i] * seen_imag[i] + imag[m, i] * seen_real[i]
        for i in range(wide):
            real[m, i] += er * gain_real[i] + ei * gain_imag[i]
            imag[m, i] += ei * gain_real[i] - er * gain_imag[i]


@compiled
def innovations(array, f, real, imag, theta, room, top, bottom):  # type: ignore[no-untyped-def]
    """Add one bin's Re(d^H Pn a) and d^H Pn d of every target to `top` and `bottom`; False for a lost basis.

    Puts A and D beside W, in columns N to 3N - 1 of real + j imag. The innovation is - top / bottom.
    """
    sensors, n = real.shape[0], theta.size
    inner_real, inner_imag, factor = room.inner_real, room.inner_imag, room.factor
    respond(array, f, theta, room.response)
    for j in range(n):
        one = room.response[j]
        for m in range(sensors):
            real[m, n + j], imag[m, n + j] = one[0, m], one[1, m]
            real[m, 2 * n + j], imag[m, 2 * n + j] = one[2, m], one[3, m]
    width = filled_up(3 * n)
    for i in range(n):
        for c in range(width):
            inner_real[i, c] = 0.0
            inner_imag[i, c] = 0.0
        for m in range(sensors):
            wr, wi = real[m, i], imag[m, i]
            for c in range(width):
                inner_real[i, c] += wr * real[m, c] + wi * imag[m, c]
                inner_imag[i, c] += wr * imag[m, c] - wi * real[m, c]
    for i in range(n):
        for k in range(i + 1):
            factor[i, k] = complex(inner_real[k, i], -inner_imag[k, i])
    if not cholesky(factor, n):
        return False
    for j in range(n):
        one = room.response[j]
        for m in range(sensors):
            top[j] += one[2, m] * one[0, m] + one[3, m] * one[1, m]
            bottom[j] += one[2, m] * one[2, m] + one[3, m] * one[3, m]
    for i in range(n):
        for k in range(i):
            lr, li = factor[i, k].real, factor[i, k].imag
            for c in range(width):
                inner_real[i, c] -= lr * inner_real[k, c] - li * inner_imag[k, c]
                inner_imag[i, c] -= lr * inner_imag[k, c] + li * inner_real[k, c]
        scale = factor[i, i].real
        for c in range(width):
            inner_real[i, c] *= scale
            inner_imag[i, c] *= scale
        for j in range(n):
            dr, di = inner_real[i, 2 * n + j], inner_imag[i, 2 * n + j]
            top[j] -= dr * inner_real[i, n + j] + di * inner_imag[i, n + j]
            bottom[j] -= dr * dr + di * di
    return True


@compiled
def left_over(real, imag, x, room):  # type: ignore[no-untyped-def]
    """|x|^2 outside the span of the basis, whose factor is in `room`; spoils y there."""
    sensors, n = real.shape[0], room.factor.shape[0]
    total = 0.0
    for m in range(sensors):
        total += x[m].real ** 2 + x[m].imag ** 2
    for i in range(n):
        y = 0.0j
        for m in range(sensors):
            y += complex(real[m, i], -imag[m, i]) * x[m]
        for k in range(i):
            y -= room.factor[i, k] * room.gain[k]
        y *= room.factor[i, i].real
        room.gain[i] = y
        total -= y.real**2 + y.imag**2
    return max(total, 0.0)


@compiled
def _fisher(array, f, theta, power, noise, information):  # type: ignore[no-untyped-def]
    """Add one bin's stochastic information of one snapshot, equal powers; a ridge keeps coincident bearings finite."""
    n, sensors = theta.size, array.facing.size
    response, b = np.empty((n, 4, filled_up(sensors))), np.empty((sensors, 2 * n), np.complex128)
    respond(array, f, theta, response)
    for i in range(n):
        one = response[i]
        for m in range(sensors):
            b[m, i], b[m, n + i] = complex(one[0, m], one[1, m]), complex(one[2, m], one[3, m])
    inner = np.zeros((2 * n, 2 * n), np.complex128)
    for m in range(sensors):
        for i in range(2 * n):
            for k in range(2 * n):
                inner[i, k] += b[m, i].conjugate() * b[m, k]
    clean, loaded = inner[:n].copy(), inner[:n, :n].copy()
    factor = inner[:n, :n].copy()
    for i in range(n):
        factor[i, i] += _RIDGE * sensors
    cholesky(factor, n)
    forward(factor, n, clean, 2 * n)
    factor = inner[:n, :n].copy()
    for i in range(n):
        factor[i, i] += noise / power
    cholesky(factor, n)
    forward(factor, n, loaded, n)
    for i in range(n):
        for k in range(n):
            left, gain = inner[n + i, n + k], inner[k, i]
            for j in range(n):
                left -= clean[j, n + i].conjugate() * clean[j, n + k]
                gain -= loaded[j, k].conjugate() * loaded[j, i]
            information[i, k] += 2.0 * power * power / (noise * noise) * (left * gain).real


@compiled
def track_past(  # type: ignore[no-untyped-def]
    array, x, usable, theta, omega, sigma_bearing, sigma_rate, basis, forgetting, q, r, lagging, hard, soft,
    power_known, out, coasted,
):  # fmt: skip
    """Track one run, snapshot by snapshot.

    x (K, bins, M); usable (K,). theta, omega (N,): the state at the snapshot before the first, moved. basis
    (bins, M, N): orthonormal. `lagging` whether to compensate the window's age; `hard`, `soft`: 0 for none;
    `power_known` 0 to estimate. Outputs: out (5, K, N) bearing, sigma, rate, its sigma, innovation; coasted (K, N).
    """
    bins, sensors = x.shape[1], x.shape[2]
    n = theta.size
    cov = np.zeros((3, n))  # variance of the bearing, covariance, variance of the rate
    for i in range(n):
        cov[0, i], cov[2, i] = sigma_bearing * sigma_bearing, sigma_rate * sigma_rate
    inverse = np.zeros((bins, n, n), np.complex128)
    real, imag = np.zeros((bins, sensors, filled_up(3 * n))), np.zeros((bins, sensors, filled_up(3 * n)))
    for f in range(bins):
        for i in range(n):
            inverse[f, i, i] = 1.0
            for m in range(sensors):
                real[f, m, i], imag[f, m, i] = basis[f, m, i].real, basis[f, m, i].imag
    lag = forgetting / (1.0 - forgetting) if lagging else 0.0
    size = (1.0 + forgetting) / (1.0 - forgetting)
    room = scratch(n, sensors)
    top, bottom, where, predicted = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    information, bound = np.empty((n, n)), np.empty((n, n))
    noise, level = np.zeros(bins), np.zeros(bins)
    for k in range(x.shape[0]):
        for i in range(n):
            theta[i] += omega[i]
            cov[0, i] += 2.0 * cov[1, i] + cov[2, i] + 0.25 * q
            cov[1, i] += cov[2, i] + 0.5 * q
            cov[2, i] += q
            predicted[i] = theta[i]
            where[i] = theta[i] - lag * omega[i]
            top[i], bottom[i] = 0.0, 0.0
        sees = usable[k]
        if sees:
            for f in range(bins):
                past(real[f], imag[f], inverse[f], x[k, f], forgetting, room)
                sees = innovations(array, f, real[f], imag[f], where, room, top, bottom) and sees
                if soft > 0.0:
                    rest = left_over(real[f], imag[f], x[k, f], room) / (sensors - n)
                    total = 0.0
                    for m in range(sensors):
                        total += x[k, f, m].real ** 2 + x[k, f, m].imag ** 2
                    if noise[f] <= 0.0:
                        noise[f], level[f] = rest, total / sensors
                    noise[f] = _FADE * noise[f] + (1.0 - _FADE) * rest
                    level[f] = _FADE * level[f] + (1.0 - _FADE) * total / sensors
        if sees and soft > 0.0:
            information.fill(0.0)
            for f in range(bins):
                power = power_known if power_known > 0.0 else max((level[f] - noise[f]) / n, 1e-6 * noise[f])
                _fisher(array, f, predicted, power, noise[f], information)
            bound.fill(0.0)
            for i in range(n):
                bound[i, i] = 1.0
            solve(information, n, bound, n)
        for i in range(n):
            near = False
            for j in range(n):
                near = near or (j != i and abs(predicted[i] - predicted[j]) < hard)
            if not sees or near or not bottom[i] > _BLIND:
                out[4, k, i] = 0.0
                coasted[k, i] = sees
            else:
                change = -top[i] / bottom[i]
                variance = r
                if soft > 0.0:
                    variance = max(r, soft * bound[i, i] / size)
                gain = 1.0 / (cov[0, i] + variance)
                gain, rate_gain = cov[0, i] * gain, cov[1, i] * gain
                theta[i] += gain * change
                omega[i] += rate_gain * change
                cov[2, i] -= rate_gain * cov[1, i]
                cov[1, i] -= gain * cov[1, i]
                cov[0, i] -= gain * cov[0, i]
                out[4, k, i] = change
                coasted[k, i] = variance > 10.0 * r
            out[0, k, i], out[1, k, i] = theta[i], math.sqrt(max(cov[0, i], 0.0))
            out[2, k, i], out[3, k, i] = omega[i], math.sqrt(max(cov[2, i], 0.0))
