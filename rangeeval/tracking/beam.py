"""The alpha-beta filter run over plots: prediction in Cartesian, update in beam coordinates of the array face.

A face of fixed heading sees half of space; without a heading the face is taken to turn to each target, as a rotating
antenna does. Innovations are judged by the residual variance that the gains have in the steady state.

References
----------
Shin and Kim (2015), eqs 4-6 and A1-A2; gains by Kalata (1984).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rangeeval.compiled import compiled_ieee
from rangeeval.tracking.polar import wrap

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

START_PLOTS = 2

# Columns of what is written for each plot; flags as in runs.Flag.
STATE, PREDICTED_STATE, PREDICTED, INNOVATION, VARIANCE, NIS, DOF, LIKELIHOOD, GAINS = 0, 6, 12, 15, 18, 21, 22, 23, 24
WIDTH = 30
STARTING, MISSED, PARTIAL, GATED, RESTARTED = 1, 2, 4, 8, 16
ABSURD, BROKEN, REPEATED, DISORDERED, OVERHEAD = 32, 64, 128, 256, 512


@compiled_ieee
def run_tracks(
    fixed: FloatArray,
    design: float,
    heading: float,
    tilt: float,
    limits: FloatArray,
    restart_after: int,
    restart_gap: float,
    offsets: IntArray,
    rows: FloatArray,
    planar: NDArray[np.bool_],
    out: FloatArray,
    flags: IntArray,
) -> None:
    """Run every track, rows offsets[i] to offsets[i + 1], through the filter.

    `fixed` (6): alpha and beta of range, y, z, or NaN for gains by the tracking index with `design` m/s^2; `heading`:
    of the boresight counter-clockwise from x, NaN for an antenna that turns; `limits` (3, 3): factor on the sigmas,
    gate and absurd NIS by degrees of freedom; `rows` (n, 7): time, range, azimuth, elevation, sigmas.
    """
    p, u, e, rate = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    v, first, sigma, axes = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros((3, 3))
    for track in range(offsets.size - 1):
        collected, gated = 0, 0
        last, used = math.nan, math.nan
        for k in range(offsets[track], offsets[track + 1]):
            t = rows[k, 0]
            flat = planar[track]
            r, az = rows[k, 1], rows[k, 2]
            el = 0.0 if flat else rows[k, 3]
            has_r, has_az, has_el = math.isfinite(r), math.isfinite(az), math.isfinite(el)
            known = (1 if has_r else 0) + (1 if has_az else 0) + (1 if has_el and not flat else 0)
            startable = has_r and has_az and has_el and r > 0.0
            flag = 0
            if known == 0:
                flag = MISSED
            elif known < (2 if flat else 3):
                flag = PARTIAL
            if collected > 0 and startable and t - used > restart_gap:
                flag |= RESTARTED
                collected = 0
            begins = startable and collected < START_PLOTS and (collected == 0 or t > used)
            runs = collected > 0 and not begins
            if not math.isfinite(t) or (collected > 0 and t < last):
                flag |= DISORDERED
                runs, begins = False, False
            elif collected > 0 and t == last:
                flag |= REPEATED
            if runs:
                dt = t - last
                last = t
                for i in range(3):
                    p[i] += dt * v[i]
                ground2 = p[0] * p[0] + p[1] * p[1]
                distance = math.sqrt(ground2 + p[2] * p[2])
                azimuth, elevation = math.atan2(p[1], p[0]), math.atan2(p[2], math.sqrt(ground2))
                facing = azimuth if math.isnan(heading) else heading
                c, s, ct, st = math.cos(facing), math.sin(facing), math.cos(tilt), math.sin(tilt)
                axes[0, 0], axes[0, 1], axes[0, 2] = c * ct, s * ct, st  # boresight
                axes[1, 0], axes[1, 1], axes[1, 2] = -c * st, -s * st, ct  # up along the face
                axes[2, 0], axes[2, 1], axes[2, 2] = s, -c, 0.0  # right along the face
                for i in range(3):
                    u[i] = axes[i, 0] * p[0] + axes[i, 1] * p[1] + axes[i, 2] * p[2]
                    rate[i] = axes[i, 0] * v[0] + axes[i, 1] * v[1] + axes[i, 2] * v[2]
                radial = (u[0] * rate[0] + u[1] * rate[1] + u[2] * rate[2]) / distance
                for i in range(3):
                    out[k, PREDICTED_STATE + i] = p[i]
                    out[k, PREDICTED_STATE + 3 + i] = v[i]
                out[k, PREDICTED], out[k, PREDICTED + 1], out[k, PREDICTED + 2] = distance, azimuth, elevation
                # residuals in range, y, z; a direction that was not measured is taken as predicted
                a, b = az if has_az else azimuth, el if has_el else elevation
                d0, d1, d2 = math.cos(b) * math.cos(a), math.cos(b) * math.sin(a), math.sin(b)
                e[0] = r - distance if has_r else 0.0
                for i in range(1, 3):
                    e[i] = distance * (axes[i, 0] * d0 + axes[i, 1] * d1 + axes[i, 2] * d2) - u[i]
                if has_r:
                    out[k, INNOVATION] = e[0]
                if has_az:
                    out[k, INNOVATION + 1] = wrap(az - azimuth)
                if has_el and not flat:
                    out[k, INNOVATION + 2] = el - elevation
                sigma[0] = limits[0, 0] * rows[k, 4]
                sigma[1] = limits[0, 2] * rows[k, 6] * math.sqrt(max(distance * distance - u[1] * u[1], 0.0))
                sigma[2] = limits[0, 1] * rows[k, 5] * math.sqrt(ground2)
                nis, log_det = 0.0, 0.0
                for i in range(3):
                    component = 0 if i == 0 else 3 - i  # polar: range, azimuth, elevation; beam: range, y, z
                    alpha, beta = fixed[2 * i], fixed[2 * i + 1]
                    measured = has_r if i == 0 else (has_el and not flat if i == 1 else has_az)
                    if math.isnan(alpha):
                        index = design * dt * dt / sigma[i]
                        if index > 0.0:
                            root = 2.0 * index / (math.sqrt(index * (8.0 + index)) + index)
                            alpha, beta = root * (2.0 - root), 2.0 * root * root
                        else:
                            alpha, beta = 0.0, 0.0
                    if not measured or dt <= 0.0:
                        alpha, beta = 0.0, 0.0
                    out[k, GAINS + 2 * i], out[k, GAINS + 2 * i + 1] = alpha, beta
                    if measured and alpha > 0.0:
                        growth = (4.0 * alpha + 2.0 * beta) / (alpha * (4.0 - 2.0 * alpha - beta))
                        scaled = limits[0, component] * rows[k, 4 + component]
                        variance = growth * scaled * scaled
                        out[k, VARIANCE + component] = variance
                        nis += out[k, INNOVATION + component] ** 2 / variance
                        log_det += math.log(2.0 * math.pi * variance)
                    elif measured:
                        known -= 1
                if known > 0:
                    out[k, NIS] = nis
                    if nis > limits[1, known - 1]:
                        flag |= GATED
                        gated += 1
                    elif nis > limits[2, known - 1]:
                        flag |= ABSURD
                if flag & GATED or known == 0:
                    for i in range(6):
                        out[k, GAINS + i] = 0.0
                else:
                    out[k, DOF] = known
                    out[k, LIKELIHOOD] = -0.5 * (nis + log_det)
                    new = distance + out[k, GAINS] * e[0]
                    radial += out[k, GAINS + 1] / dt * e[0]
                    for i in range(1, 3):
                        u[i] += out[k, GAINS + 2 * i] * e[i]
                        rate[i] += out[k, GAINS + 2 * i + 1] / dt * e[i]
                    square = new * new - u[1] * u[1] - u[2] * u[2]
                    if new > 0.0 and square > 0.0:
                        u[0] = math.sqrt(square)
                        rate[0] = (new * radial - u[1] * rate[1] - u[2] * rate[2]) / u[0]
                        for i in range(3):
                            p[i] = axes[0, i] * u[0] + axes[1, i] * u[1] + axes[2, i] * u[2]
                            v[i] = axes[0, i] * rate[0] + axes[1, i] * rate[1] + axes[2, i] * rate[2]
                        gated, used = 0, t
                    else:
                        flag |= BROKEN
                if flag & BROKEN or (gated > 0 and gated == restart_after):
                    collected = 0
                    begins = startable
                    flag |= RESTARTED
                    for i in range(PREDICTED_STATE, WIDTH):
                        out[k, i] = math.nan if i < DOF else 0.0
            if begins:
                d0, d1, d2 = r * math.cos(el) * math.cos(az), r * math.cos(el) * math.sin(az), r * math.sin(el)
                u[0], u[1], u[2] = d0, d1, d2
                for i in range(3):
                    p[i] = u[i]
                    v[i] = (u[i] - first[i]) / (t - used) if collected > 0 else 0.0
                    first[i] = u[i]
                collected += 1
                flag |= STARTING
                gated, last, used = 0, t, t
            flags[k] = flag if collected > 0 else flag | MISSED
            if collected > 0:
                for i in range(3):
                    out[k, STATE + i] = p[i]
                    out[k, STATE + 3 + i] = v[i]
