"""All bearings in one state, corrected block by block by the likelihood of the snapshots: the kernel of `joint-ml`.

The model of a block's covariance is R = A diag(p) A^H + s I. Its score and Fisher information in the bearings correct
the state [bearings, rates] by Gauss-Newton steps towards the maximum a posteriori; one expectation-maximisation step
then moves the powers p and the noise s. Where two bearings coincide the information is singular exactly in their
difference: the difference coasts and the centroid is still corrected.

R is never formed. With B = [A D] and C C^H = A^H A + s P^-1, Woodbury's identity gives everything as
B^H R^-1 [B X] = (B^H [B X] - Z_B^H Z) / s, where Z = C^-1 A^H [B X].

References
----------
docs/explanation/bearing.md derives it. Miller and Fuhrmann (1990), IEEE Trans. ASSP 38, for the expectation step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rangeeval.arrays.manifold import respond
from rangeeval.arrays.small import cholesky, filled_up, solve
from rangeeval.compiled import compiled

Array = NDArray[np.float64]

_SPARK = 1e-6  # of the noise: the power a faded source keeps, to come back from
_ROUNDS = 20  # expectation steps that find powers and noise of the opening
_TURNS = 60  # of the power iteration of the guard
_CLOSE = 1e-4  # relative change at which it stops


class Work(NamedTuple):
    """Scratch of one run, so that the loop over blocks allocates nothing."""

    response: Array  # (N, 4, M filled up): see `respond`
    real: Array  # (M, 2N + L): [B X]
    imag: Array
    inner_real: Array  # (2N, 2N + L): B^H [B X], then B^H R^-1 [B X]
    inner_imag: Array
    low_real: Array  # (N, 2N + L): Z
    low_imag: Array
    factor: NDArray[np.complex128]  # (N, N)
    fit: Array  # (N,) mean |a^H R^-1 x|^2
    model: Array  # (N,) a^H R^-1 a


@compiled
def workspace(targets, sensors, block):  # type: ignore[no-untyped-def]
    """Room for `block` snapshots."""
    wide = 2 * targets + block
    return Work(
        np.empty((targets, 4, filled_up(sensors))), np.empty((sensors, wide)), np.empty((sensors, wide)),
        np.empty((2 * targets, wide)), np.empty((2 * targets, wide)), np.empty((targets, wide)),
        np.empty((targets, wide)), np.empty((targets, targets), np.complex128), np.empty(targets), np.empty(targets),
    )  # fmt: skip


@compiled
def likelihood_terms(array, f, theta, power, noise, used, work, score, info):  # type: ignore[no-untyped-def]
    """Add one bin's score (N,) and information (N, N) of `used` snapshots, which stand in `work` from column 2N on.

    Leaves `work.fit` and `work.model`; gives the mean of |R^-1 x|^2 and the trace of R^-1.
    """
    n, sensors = theta.size, work.real.shape[0]
    wide = 2 * n + used
    real, imag, low_real, low_imag = work.real, work.imag, work.low_real, work.low_imag
    inner_real, inner_imag, factor = work.inner_real, work.inner_imag, work.factor
    respond(array, f, theta, work.response)
    for i in range(n):
        one = work.response[i]
        for m in range(sensors):
            real[m, i], imag[m, i] = one[0, m], one[1, m]
            real[m, n + i], imag[m, n + i] = one[2, m], one[3, m]
    for j in range(2 * n):
        for c in range(wide):
            inner_real[j, c] = 0.0
            inner_imag[j, c] = 0.0
        for m in range(sensors):
            br, bi = real[m, j], imag[m, j]
            for c in range(wide):
                inner_real[j, c] += br * real[m, c] + bi * imag[m, c]
                inner_imag[j, c] += br * imag[m, c] - bi * real[m, c]
    for i in range(n):
        for j in range(i + 1):
            factor[i, j] = complex(inner_real[i, j], inner_imag[i, j])
        factor[i, i] += noise / power[i]
    cholesky(factor, n)  # positive: a Gram matrix and something on its diagonal
    for i in range(n):
        for c in range(wide):
            low_real[i, c] = inner_real[i, c]
            low_imag[i, c] = inner_imag[i, c]
        for k in range(i):
            lr, li = factor[i, k].real, factor[i, k].imag
            for c in range(wide):
                low_real[i, c] -= lr * low_real[k, c] - li * low_imag[k, c]
                low_imag[i, c] -= lr * low_imag[k, c] + li * low_real[k, c]
        scale = factor[i, i].real
        for c in range(wide):
            low_real[i, c] *= scale
            low_imag[i, c] *= scale
    for j in range(2 * n):
        for i in range(n):
            zr, zi = low_real[i, j], low_imag[i, j]
            for c in range(wide):
                inner_real[j, c] -= zr * low_real[i, c] + zi * low_imag[i, c]
                inner_imag[j, c] -= zr * low_imag[i, c] - zi * low_real[i, c]
        for c in range(wide):
            inner_real[j, c] /= noise
            inner_imag[j, c] /= noise

    total, share = 0.0, 0.0
    for c in range(2 * n, wide):
        for m in range(sensors):
            total += real[m, c] * real[m, c] + imag[m, c] * imag[m, c]
        for i in range(n):
            total -= low_real[i, c] * low_real[i, c] + low_imag[i, c] * low_imag[i, c]
    for i in range(n):
        fit, cross = 0.0, 0.0
        for c in range(2 * n, wide):
            fit += inner_real[i, c] * inner_real[i, c] + inner_imag[i, c] * inner_imag[i, c]
            cross += inner_real[i, c] * inner_real[n + i, c] + inner_imag[i, c] * inner_imag[n + i, c]
        total -= noise * power[i] * fit
        work.fit[i] = fit / used
        work.model[i] = inner_real[i, i]
        share += power[i] * inner_real[i, i]
        score[i] += 2.0 * power[i] * (used * inner_real[i, n + i] - cross)
        for k in range(i + 1):
            ad = inner_real[i, n + k] * inner_real[k, n + i] - inner_imag[i, n + k] * inner_imag[k, n + i]
            # (a_i' a_k)(d_k' d_i): Hermitian blocks, so only their stored halves are read
            ad += inner_real[i, k] * inner_real[n + k, n + i] - inner_imag[i, k] * inner_imag[n + k, n + i]
            term = 2.0 * used * power[i] * power[k] * ad
            info[i, k] += term
            if k != i:
                info[k, i] += term
    return total / (noise * noise * used), (sensors - share) / noise


@compiled
def _predict(theta, omega, cov, steps, q):  # type: ignore[no-untyped-def]
    """Carry the state over `steps` snapshots, or back over as many: acceleration noise q, new in each of them."""
    n = theta.size
    span = abs(steps)
    for i in range(n):
        theta[i] += steps * omega[i]
    for i in range(2 * n):
        for j in range(n):
            cov[i, j] += steps * cov[i, n + j]
    for i in range(n):
        for j in range(2 * n):
            cov[i, j] += steps * cov[n + i, j]
        cov[i, i] += q * max(span**3 / 3.0 - span / 12.0, 0.0)
        cov[i, n + i] += q * steps * span / 2.0
        cov[n + i, i] += q * steps * span / 2.0
        cov[n + i, n + i] += q * span


@compiled
def load(x, usable, f, first, count, column, work):  # type: ignore[no-untyped-def]
    """Put the usable ones of `count` snapshots of bin f into `work`; gives how many."""
    used = 0
    for k in range(first, first + count):
        if usable[k]:
            for m in range(x.shape[2]):
                work.real[m, column + used] = x[k, f, m].real
                work.imag[m, column + used] = x[k, f, m].imag
            used += 1
    return used


@compiled
def _towards(theta, predicted, cov, score, info, largest, together, system, gain, step):  # type: ignore[no-untyped-def]
    """One Gauss-Newton step of the state to the maximum a posteriori.

    Written in N x N systems: s = s0 + P_xb z with (I + J P_bb) z = J (theta - theta0) - g. A bearing goes no farther
    than `largest`; `together`, all bearings and rates go the share of their way that takes none farther. `step` holds
    z before and after; leaves (I + J P_bb)^-1 J in `gain`.
    """
    n = theta.size
    for i in range(n):
        for k in range(n):
            total = 1.0 if i == k else 0.0
            for j in range(n):
                total += info[i, j] * cov[j, k]
            system[i, k] = total
            gain[i, k] = info[i, k]
        total = -score[i]
        for k in range(n):
            total += info[i, k] * (theta[k] - predicted[k])
        gain[i, n] = total
    solve(system, n, gain, n + 1)
    share = 1.0
    if together:
        for i in range(n):
            target = predicted[i]
            for k in range(n):
                target += cov[i, k] * gain[k, n]
            share = min(share, largest / max(abs(target - theta[i]), largest))
    for i in range(n):
        step[i] += share * (gain[i, n] - step[i])
    for i in range(n):
        target = predicted[i]
        for k in range(n):
            target += cov[i, k] * step[k]
        theta[i] += min(max(target - theta[i], -largest), largest)


@compiled
def _tighten(cov, gain, half, new):  # type: ignore[no-untyped-def]
    """P - P_xb (I + J P_bb)^-1 J P_bx, `gain` as `_towards` leaves it."""
    n = gain.shape[0]
    for i in range(2 * n):
        for k in range(n):
            total = 0.0
            for j in range(n):
                total += cov[i, j] * gain[j, k]
            half[i, k] = total
    for i in range(2 * n):
        for k in range(i + 1):
            total = cov[i, k]
            for j in range(n):
                total -= half[i, j] * cov[k, j]
            new[i, k] = total
            new[k, i] = total
    for i in range(2 * n):
        for k in range(2 * n):
            cov[i, k] = new[i, k]


@compiled
def _refit(power, noise, f, residual, trace, rate, sensors, work):  # type: ignore[no-untyped-def]
    """One expectation-maximisation step of one bin's powers and noise, a share `rate` of it."""
    old = noise[f]
    noise[f] = old + rate * old * old * (residual - trace) / sensors
    least = _SPARK * noise[f]
    for i in range(work.fit.size):
        p = power[f, i]
        power[f, i] = max(p + rate * p * p * (work.fit[i] - work.model[i]), least)


@compiled
def _open(array, x, usable, theta, first, count, power, noise, work, score, info):  # type: ignore[no-untyped-def]
    """Find powers and noise in `count` snapshots, at bearings that stand: their likelihood's maximum, nearly.

    From the power shared among sources and noise alike; `score` and `info` are spoiled.
    """
    n, sensors = theta.size, x.shape[2]
    for f in range(x.shape[1]):
        used = load(x, usable, f, first, count, 2 * n, work)
        total = 0.0
        for c in range(2 * n, 2 * n + used):
            for m in range(sensors):
                total += work.real[m, c] * work.real[m, c] + work.imag[m, c] * work.imag[m, c]
        level = max(total / (used * sensors * (n + 1)), 1e-300)
        noise[f] = level
        for i in range(n):
            power[f, i] = level
        for _ in range(_ROUNDS):
            residual, trace = likelihood_terms(array, f, theta, power[f], noise[f], used, work, score, info)
            _refit(power, noise, f, residual, trace, 1.0, sensors, work)


@compiled
def _watch(watch, f, power, noise, used, work):  # type: ignore[no-untyped-def]
    """Add a block to the covariance found (0) and the model's (1) of the window; lower halves."""
    n, sensors = work.fit.size, work.real.shape[0]
    real, imag = work.real, work.imag
    for i in range(sensors):
        for j in range(i + 1):
            sr, si, mr, mi = 0.0, 0.0, 0.0, 0.0
            for c in range(2 * n, 2 * n + used):
                sr += real[i, c] * real[j, c] + imag[i, c] * imag[j, c]
                si += imag[i, c] * real[j, c] - real[i, c] * imag[j, c]
            for c in range(n):
                mr += power[c] * (real[i, c] * real[j, c] + imag[i, c] * imag[j, c])
                mi += power[c] * (imag[i, c] * real[j, c] - real[i, c] * imag[j, c])
            if i == j:
                mr += noise
            watch[0, f, i, j] += complex(sr, si)
            watch[1, f, i, j] += used * complex(mr, mi)


@compiled
def largest_eigenvalue(found, model):  # type: ignore[no-untyped-def]
    """Of L^-1 E L^-H with model = L L^H, from lower halves, both spoiled; power iteration."""
    n = found.shape[0]
    if not cholesky(model, n):
        return np.nan
    for i in range(n):
        for j in range(i):
            found[j, i] = found[i, j].conjugate()
    v, w = np.empty(n, np.complex128), np.empty(n, np.complex128)
    for i in range(n):
        v[i] = 1.0 / (1.0 + i)  # no symmetry of the array is orthogonal to this
    value = 0.0
    for _ in range(_TURNS):
        for i in range(n - 1, -1, -1):  # L^-H v
            total = v[i]
            for k in range(i + 1, n):
                total -= model[k, i].conjugate() * w[k]
            w[i] = total * model[i, i].real
        for i in range(n):
            total = 0.0j
            for k in range(n):
                total += found[i, k] * w[k]
            v[i] = total
        norm = 0.0
        for i in range(n):  # L^-1 E L^-H v
            total = v[i]
            for k in range(i):
                total -= model[i, k] * v[k]
            v[i] = total * model[i, i].real
            norm += v[i].real * v[i].real + v[i].imag * v[i].imag
        norm = math.sqrt(norm)
        if norm == 0.0:
            return 0.0
        for i in range(n):
            v[i] /= norm
        if abs(norm - value) < _CLOSE * norm:
            return norm
        value = norm
    return value


@compiled
def track_joint(  # type: ignore[no-untyped-def]
    array, x, usable, theta, omega, sigma_bearing, sigma_rate, begin, opening, block, iterations, q, largest, together,
    memory, window, power, noise, out, powers, noises, guards, counts,
):  # fmt: skip
    """Track one run, block by block.

    x (K, bins, M); usable (K,) which snapshots count. theta, omega (N,): the state at snapshot `begin`; power
    (bins, N), noise (bins,): where they start, or zeros to be found first in `opening` snapshots. All four are moved.
    Row b of the outputs is the state in the middle of block b: out (5, T, N) bearing, sigma, rate, its sigma,
    innovation; powers (T, bins, N), noises (T, bins), guards (T,), counts (T,) of usable snapshots.
    """
    bins, sensors = x.shape[1], x.shape[2]
    n = theta.size
    cov, new = np.zeros((2 * n, 2 * n)), np.empty((2 * n, 2 * n))
    for i in range(n):
        cov[i, i] = sigma_bearing * sigma_bearing
        cov[n + i, n + i] = sigma_rate * sigma_rate
    reach = max(block, min(opening, x.shape[0]))
    work = workspace(n, sensors, reach)
    watch = np.zeros((2, bins, sensors, sensors), np.complex128)
    watched, guard = 0, np.nan
    predicted, score, step = np.empty(n), np.empty(n), np.empty(n)
    info, system, gain, half = np.empty((n, n)), np.empty((n, n)), np.empty((n, n + 1)), np.empty((2 * n, n))
    ahead = 0.5 * (block - 1) - begin
    unknown = power[0, 0] <= 0.0
    for b in range(counts.size):
        first = b * block
        _predict(theta, omega, cov, ahead, q)
        ahead = float(block)
        for i in range(n):
            predicted[i] = theta[i]
            step[i] = 0.0
        counts[b] = 0
        for k in range(first, first + block):
            counts[b] += usable[k]
        used = counts[b]
        if unknown and used > 0:
            _open(array, x, usable, theta, first, min(reach, x.shape[0] - first), power, noise, work, score, info)
            unknown = False
        for turn in range(iterations + 1 if used > 0 else 0):  # Gauss-Newton steps, then the step of powers and noise
            score.fill(0.0)
            info.fill(0.0)
            last = turn == iterations
            for f in range(bins):
                load(x, usable, f, first, block, 2 * n, work)
                residual, trace = likelihood_terms(array, f, theta, power[f], noise[f], used, work, score, info)
                if last:
                    _refit(power, noise, f, residual, trace, min(1.0, used / memory), sensors, work)
                    _watch(watch, f, power[f], noise[f], used, work)
            if not last:
                _towards(theta, predicted, cov, score, info, largest, together, system, gain, step)
        if used > 0:
            for i in range(n):
                for k in range(n):
                    omega[i] += cov[n + i, k] * step[k]
            _tighten(cov, gain, half, new)
            watched += used
        if watched >= window:
            guard = 0.0
            for f in range(bins):
                guard = max(guard, largest_eigenvalue(watch[0, f], watch[1, f]))
            watch.fill(0.0)
            watched = 0
        for i in range(n):
            out[0, b, i], out[1, b, i] = theta[i], math.sqrt(max(cov[i, i], 0.0))
            out[2, b, i], out[3, b, i] = omega[i], math.sqrt(max(cov[n + i, n + i], 0.0))
            out[4, b, i] = theta[i] - predicted[i]
        for f in range(bins):
            noises[b, f] = noise[f]
            for i in range(n):
                powers[b, f, i] = power[f, i]
        guards[b] = guard
