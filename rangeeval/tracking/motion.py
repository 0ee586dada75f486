"""Motion models as compiled kernels: predicted state, its Jacobian and process noise of each, and the covariance.

States are padded to 9: position, velocity, and a third block that is the acceleration (`CA`), the vector turn rate
(`CT`, `CT2`) or unused (`CV`). Loops run over fixed small ranges, which the compiler unrolls.

References
----------
CT: dv/dt = w x v with constant w has v(T) = A v, p(T) = p + B v with A, B by Rodrigues' formula; `CT2` is the same to
second order in T: Jung (1999), eq 10 with its second derivatives put right.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rangeeval.compiled import compiled

FloatArray = NDArray[np.float64]

CV, CA, CT, CT2 = 0, 1, 2, 3
MOTIONS = {"cv": CV, "ca": CA, "ct": CT, "ct-second-order": CT2}
SMALL_TURN = 0.01  # w T below which the closed forms lose digits and the series are exact to the last


@compiled
def states_of(motion: int) -> int:
    """How many of the nine states a model has."""
    return 6 if motion == CV else 9


@compiled
def process_noise(
    motion: int, sigma: float, sigma_turn: float, dt: float, reference: float, continuous: bool, q: FloatArray
) -> None:
    """Write the six distinct elements of Q over `dt` into `q` (6): pp, pv, vv, pu, vu, uu (u the third block).

    `sigma` and `sigma_turn` refer to one reference interval. Every block is a multiple of the unit matrix.
    """
    s2 = sigma * sigma
    for i in range(6):
        q[i] = 0.0
    if motion == CA:
        if continuous:
            s2 = s2 / reference
            q[0], q[1], q[2] = s2 * dt**5 / 20.0, s2 * dt**4 / 8.0, s2 * dt**3 / 3.0
            q[3], q[4], q[5] = s2 * dt**3 / 6.0, s2 * dt**2 / 2.0, s2 * dt
        else:
            q[0], q[1], q[2] = s2 * dt**4 / 4.0, s2 * dt**3 / 2.0, s2 * dt**2
            q[3], q[4], q[5] = s2 * dt**2 / 2.0, s2 * dt, s2
        return
    if continuous:
        s2 = s2 * reference
        q[0], q[1], q[2] = s2 * dt**3 / 3.0, s2 * dt**2 / 2.0, s2 * dt
    else:
        q[0], q[1], q[2] = s2 * dt**4 / 4.0, s2 * dt**3 / 2.0, s2 * dt**2
    if motion != CV:
        q[5] = sigma_turn * sigma_turn * dt / reference


@compiled
def turn(x: FloatArray, dt: float, second_order: bool, y: FloatArray, jacobian: FloatArray) -> None:
    """Turn model at the state `x` (9): predicted position and velocity into `y`, their Jacobian into (6, 9).

    Columns of the Jacobian: position, velocity, turn rate; the position's own column block is [I; 0] and is not written.
    """
    v0, v1, v2 = x[3], x[4], x[5]
    w0, w1, w2 = x[6], x[7], x[8]
    square = w0 * w0 + w1 * w1 + w2 * w2
    if second_order:
        s1, s2, s3 = dt, 0.5 * dt * dt, 0.0
        d1, d2, d3 = 0.0, 0.0, 0.0
    else:
        rate = math.sqrt(square)
        angle = rate * dt
        if angle < SMALL_TURN:
            a2 = angle * angle
            s1 = dt * (1.0 - a2 / 6.0 * (1.0 - a2 / 20.0))
            s2 = dt * dt * (0.5 - a2 / 24.0 * (1.0 - a2 / 30.0))
            s3 = dt**3 * (1.0 / 6.0 - a2 / 120.0 * (1.0 - a2 / 42.0))
            d1 = -(dt**3) * (1.0 / 3.0 - a2 / 30.0 * (1.0 - a2 / 28.0))
            d2 = -(dt**4) * (1.0 / 12.0 - a2 / 180.0 * (1.0 - a2 / 37.333333333333336))
            d3 = -(dt**5) * (1.0 / 60.0 - a2 / 1260.0 * (1.0 - a2 / 48.0))
        else:
            s, c = math.sin(angle), math.cos(angle)
            s1 = s / rate
            s2 = (1.0 - c) / square
            s3 = (angle - s) / (square * rate)
            d1 = (angle * c - s) / (square * rate)
            d2 = (angle * s - 2.0 * (1.0 - c)) / (square * square)
            d3 = (3.0 * s - angle * c - 2.0 * angle) / (square * square * rate)
    dot = w0 * v0 + w1 * v1 + w2 * v2
    b0, b1, b2 = w1 * v2 - w2 * v1, w2 * v0 - w0 * v2, w0 * v1 - w1 * v0  # w x v
    c0, c1, c2 = w0 * dot - v0 * square, w1 * dot - v1 * square, w2 * dot - v2 * square  # w x (w x v)
    y[3] = v0 + s1 * b0 + s2 * c0
    y[4] = v1 + s1 * b1 + s2 * c1
    y[5] = v2 + s1 * b2 + s2 * c2
    y[0] = x[0] + dt * v0 + s2 * b0 + s3 * c0
    y[1] = x[1] + dt * v1 + s2 * b1 + s3 * c1
    y[2] = x[2] + dt * v2 + s2 * b2 + s3 * c2
    w = (w0, w1, w2)
    v = (v0, v1, v2)
    b = (b0, b1, b2)
    c = (c0, c1, c2)
    cross_w = (0.0, -w2, w1, w2, 0.0, -w0, -w1, w0, 0.0)
    cross_v = (0.0, -v2, v1, v2, 0.0, -v0, -v1, v0, 0.0)
    for i in range(3):
        for k in range(3):
            one = 1.0 if i == k else 0.0
            ww = w[i] * w[k] - square * one  # [w]x squared
            m = dot * one + w[i] * v[k] - 2.0 * v[i] * w[k]
            cw, cv = cross_w[3 * i + k], cross_v[3 * i + k]
            jacobian[i, 3 + k] = dt * one + s2 * cw + s3 * ww
            jacobian[3 + i, 3 + k] = one + s1 * cw + s2 * ww
            jacobian[i, 6 + k] = -s2 * cv + d2 * b[i] * w[k] + s3 * m + d3 * c[i] * w[k]
            jacobian[3 + i, 6 + k] = -s1 * cv + d1 * b[i] * w[k] + s2 * m + d2 * c[i] * w[k]


@compiled
def predict(
    motion: int,
    dt: float,
    decay: float,
    q: FloatArray,
    x: FloatArray,
    p: FloatArray,
    y: FloatArray,
    s: FloatArray,
    scratch: FloatArray,
) -> None:
    """Predict state and covariance (x, p) over `dt` into (y, s).

    `decay` multiplies the turn rate; `q` (6) of `process_noise`; `scratch` (24, 9) is free.
    """
    if motion == CV:
        _predict_cv(dt, q, x, p, y, s)
    elif motion == CA:
        _predict_ca(dt, q, x, p, y, s)
    else:
        turn(x, dt, motion == CT2, y, scratch[:6])
        _predict_ct(decay, q, x, p, y, s, scratch[:6], scratch[6:12])


@compiled
def _predict_cv(dt: float, q: FloatArray, x: FloatArray, p: FloatArray, y: FloatArray, s: FloatArray) -> None:
    for a in range(3):
        y[a] = x[a] + dt * x[3 + a]
        y[3 + a] = x[3 + a]
        for b in range(3):
            vv = p[3 + a, 3 + b]
            pv = p[a, 3 + b] + dt * vv
            s[a, b] = p[a, b] + dt * (p[3 + a, b] + pv)
            s[a, 3 + b] = pv
            s[3 + b, a] = pv
            s[3 + a, 3 + b] = vv
    for a in range(3):
        s[a, a] += q[0]
        s[a, 3 + a] += q[1]
        s[3 + a, a] += q[1]
        s[3 + a, 3 + a] += q[2]


@compiled
def _predict_ca(dt: float, q: FloatArray, x: FloatArray, p: FloatArray, y: FloatArray, s: FloatArray) -> None:
    h = 0.5 * dt * dt
    for a in range(3):
        y[a] = x[a] + dt * x[3 + a] + h * x[6 + a]
        y[3 + a] = x[3 + a] + dt * x[6 + a]
        y[6 + a] = x[6 + a]
    for a in range(3):
        for b in range(3):
            # rows of F P, then columns: P F'
            pp = p[a, b] + dt * p[3 + a, b] + h * p[6 + a, b]
            pv = p[a, 3 + b] + dt * p[3 + a, 3 + b] + h * p[6 + a, 3 + b]
            pu = p[a, 6 + b] + dt * p[3 + a, 6 + b] + h * p[6 + a, 6 + b]
            vv = p[3 + a, 3 + b] + dt * p[6 + a, 3 + b]
            vu = p[3 + a, 6 + b] + dt * p[6 + a, 6 + b]
            uu = p[6 + a, 6 + b]
            s[a, b] = pp + dt * pv + h * pu
            s[a, 3 + b] = pv + dt * pu
            s[a, 6 + b] = pu
            s[3 + a, 3 + b] = vv + dt * vu
            s[3 + a, 6 + b] = vu
            s[6 + a, 6 + b] = uu
    _add_noise(q, s)


@compiled
def _predict_ct(
    decay: float,
    q: FloatArray,
    x: FloatArray,
    p: FloatArray,
    y: FloatArray,
    s: FloatArray,
    f: FloatArray,
    fp: FloatArray,
) -> None:
    for a in range(3):
        y[6 + a] = decay * x[6 + a]
    for a in range(6):
        for c in range(9):
            total = p[a, c] if a < 3 else 0.0
            for b in range(3, 9):
                total += f[a, b] * p[b, c]
            fp[a, c] = total
    for a in range(6):
        for c in range(6):
            if c >= a:
                total = fp[a, c] if c < 3 else 0.0
                for b in range(3, 9):
                    total += fp[a, b] * f[c, b]
                s[a, c] = total
        for c in range(6, 9):
            s[a, c] = decay * fp[a, c]
    for a in range(6, 9):
        for c in range(6, 9):
            s[a, c] = decay * decay * p[a, c]
    _add_noise(q, s)


@compiled
def _add_noise(q: FloatArray, s: FloatArray) -> None:
    for a in range(3):
        s[a, a] += q[0]
        s[a, 3 + a] += q[1]
        s[3 + a, 3 + a] += q[2]
        s[a, 6 + a] += q[3]
        s[3 + a, 6 + a] += q[4]
        s[6 + a, 6 + a] += q[5]
    for a in range(9):
        for c in range(a):
            s[a, c] = s[c, a]


def transition(motion: str, state: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
    """Predicted state (9,) of a model and the Jacobian (9, 9) of the prediction, for one state (9,)."""
    kind = MOTIONS[motion]
    n = states_of(kind)
    x = np.zeros(9)
    x[:n] = np.asarray(state, dtype=np.float64)[:n]
    y, f = np.zeros(9), np.eye(9)
    if kind in (CT, CT2):
        turn(x, dt, kind == CT2, y, f[:6])
        y[6:] = x[6:]
        return y, f
    f[0:3, 3:6] = f[3:6, 6:9] = dt * np.eye(3)
    f[0:3, 6:9] = 0.5 * dt * dt * np.eye(3)
    if kind == CV:
        f[:6, 6:] = 0.0
    return f @ x, f


def noise_matrix(
    motion: str, sigma: float, sigma_turn: float, dt: float, reference: float = 1.0, continuous: bool = False
) -> FloatArray:
    """Process noise covariance (9, 9) of a model over `dt`; rows and columns of states it has not are zero."""
    q = np.empty(6)
    process_noise(MOTIONS[motion], sigma, sigma_turn, dt, reference, continuous, q)
    pp, pv, vv, pu, vu, uu = q
    return np.kron(np.array([[pp, pv, pu], [pv, vv, vu], [pu, vu, uu]]), np.eye(3))
