"""The papers' chain snapshot by snapshot: PAST subspace, closed-form angular innovation, a Kalman filter a target.

References
----------
Yang (1995), IEEE Trans. SP 43, for PAST. The innovation: least squares of Pn (a + d x) = 0 over real and imaginary
parts, with the projector of a basis W that is not orthonormal, Pn = I - W (W^H W)^-1 W^H. Lag compensation and
coasting: docs/explanation/bearing.md.
"""

from __future__ import annotations

import math

import numpy as np

from rangeeval.arrays.manifold import respond
from rangeeval.arrays.small import cholesky, forward, solve
from rangeeval.compiled import compiled

_BLIND = 1e-10  # of |d|^2: less of the derivative outside the subspace says nothing
_FADE = 0.98  # smoothing of noise and power for soft coasting
_RIDGE = 1e-4  # of a sensor's gain: keeps the bound finite where two predictions coincide


@compiled
def past(basis, inverse, x, forgetting, error):  # type: ignore[no-untyped-def]
    """Move the subspace basis (M, N) and the inverse correlation (N, N) by one snapshot; `error` gets x - W y."""
    sensors, n = basis.shape
    y, h = np.zeros(n, np.complex128), np.zeros(n, np.complex128)
    for m in range(sensors):
        for i in range(n):
            y[i] += basis[m, i].conjugate() * x[m]
    scale = forgetting
    for i in range(n):
        for k in range(n):
            h[i] += inverse[i, k] * y[k]
        scale += (y[i].conjugate() * h[i]).real
    for i in range(n):
        inverse[i, i] = (inverse[i, i].real - (h[i].real ** 2 + h[i].imag ** 2) / scale) / forgetting
        for k in range(i + 1, n):
            inverse[i, k] = (inverse[i, k] - h[i] * h[k].conjugate() / scale) / forgetting
            inverse[k, i] = inverse[i, k].conjugate()
    for i in range(n):
        h[i] = h[i].conjugate() / scale
    for m in range(sensors):
        total = x[m]
        for i in range(n):
            total -= basis[m, i] * y[i]
        error[m] = total
        for i in range(n):
            basis[m, i] += total * h[i]


@compiled
def innovations(array, f, basis, theta, response, inner, factor, top, bottom):  # type: ignore[no-untyped-def]
    """Add one bin's Re(d^H Pn a) and d^H Pn d of every target to `top` and `bottom`; False for a lost basis.

    `inner` (N, 2N) and `factor` (N, N) complex are scratch. The innovation is - top / bottom.
    """
    sensors, n = basis.shape
    for i in range(n):
        for k in range(i + 1):
            total = 0.0j
            for m in range(sensors):
                total += basis[m, i].conjugate() * basis[m, k]
            factor[i, k] = total
    if not cholesky(factor, n):
        return False
    for j in range(n):
        respond(array, f, theta[j], response)
        for i in range(n):
            inner[i, 2 * j] = 0.0
            inner[i, 2 * j + 1] = 0.0
        for m in range(sensors):
            a, d = complex(response[0, m], response[1, m]), complex(response[2, m], response[3, m])
            top[j] += d.real * a.real + d.imag * a.imag
            bottom[j] += d.real * d.real + d.imag * d.imag
            for i in range(n):
                w = basis[m, i].conjugate()
                inner[i, 2 * j] += w * a
                inner[i, 2 * j + 1] += w * d
    forward(factor, n, inner, 2 * n)
    for j in range(n):
        for i in range(n):
            a, d = inner[i, 2 * j], inner[i, 2 * j + 1]
            top[j] -= d.real * a.real + d.imag * a.imag
            bottom[j] -= d.real * d.real + d.imag * d.imag
    return True


@compiled
def left_over(basis, x):  # type: ignore[no-untyped-def]
    """|x|^2 outside the span of the basis."""
    sensors, n = basis.shape
    factor, y = np.empty((n, n), np.complex128), np.zeros((n, n), np.complex128)
    total = 0.0
    for m in range(sensors):
        total += x[m].real ** 2 + x[m].imag ** 2
        for i in range(n):
            y[i, 0] += basis[m, i].conjugate() * x[m]
    for i in range(n):
        for k in range(i + 1):
            product = 0.0j
            for m in range(sensors):
                product += basis[m, i].conjugate() * basis[m, k]
            factor[i, k] = product
    if cholesky(factor, n):
        forward(factor, n, y, 1)
        for i in range(n):
            total -= y[i, 0].real ** 2 + y[i, 0].imag ** 2
    return max(total, 0.0)


@compiled
def _fisher(array, f, theta, power, noise, information):  # type: ignore[no-untyped-def]
    """Add one bin's stochastic information of one snapshot, equal powers; a ridge keeps coincident bearings finite."""
    n, sensors = theta.size, array.sine.shape[1]
    response, b = np.empty((4, sensors)), np.empty((sensors, 2 * n), np.complex128)
    for i in range(n):
        respond(array, f, theta[i], response)
        for m in range(sensors):
            b[m, i], b[m, n + i] = complex(response[0, m], response[1, m]), complex(response[2, m], response[3, m])
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
    (bins, M, N): orthonormal, moved. `lagging` whether to compensate the window's age; `hard`, `soft`: 0 for none;
    `power_known` 0 to estimate. Outputs: out (5, K, N) bearing, sigma, rate, its sigma, innovation; coasted (K, N).
    """
    bins, sensors = x.shape[1], x.shape[2]
    n = theta.size
    cov = np.zeros((3, n))  # variance of the bearing, covariance, variance of the rate
    for i in range(n):
        cov[0, i], cov[2, i] = sigma_bearing * sigma_bearing, sigma_rate * sigma_rate
    inverse = np.zeros((bins, n, n), np.complex128)
    for f in range(bins):
        for i in range(n):
            inverse[f, i, i] = 1.0
    lag = forgetting / (1.0 - forgetting) if lagging else 0.0
    size = (1.0 + forgetting) / (1.0 - forgetting)
    error, response = np.empty(sensors, np.complex128), np.empty((4, sensors))
    inner, factor = np.empty((n, 2 * n), np.complex128), np.empty((n, n), np.complex128)
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
                past(basis[f], inverse[f], x[k, f], forgetting, error)
                sees = innovations(array, f, basis[f], where, response, inner, factor, top, bottom) and sees
                if soft > 0.0:
                    rest = left_over(basis[f], x[k, f]) / (sensors - n)
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
