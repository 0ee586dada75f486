"""Motion models as compiled kernels: predicted state, its Jacobian and process noise of each, and the covariance.

States are padded to 9: position, velocity, and a third block that is the acceleration (`CA`), the vector turn rate
(`CT`, `CT2`) or unused (`CV`, where its numbers are kept finite but mean nothing).

Kernels of this package take arrays with a density (or a 3 x 3 matrix, written flat) in each row, and row numbers: a
view of a row would be counted in and out at each call, which costs more than the arithmetic.

References
----------
CT: dv/dt = w x v with constant w has v(T) = A v, p(T) = p + B v with A, B by Rodrigues' formula; `CT2` is the same to
second order in T: Jung (1999), eq 10 with its second derivatives put right.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rangeeval.compiled import compiled_ieee, compiled_inside

FloatArray = NDArray[np.float64]

CV, CA, CT, CT2 = 0, 1, 2, 3
MOTIONS = {"cv": CV, "ca": CA, "ct": CT, "ct-second-order": CT2}
SMALL_TURN = 0.01  # w T below which the closed forms lose digits and the series are exact to the last


@compiled_ieee
def states_of(motion: int) -> int:
    """How many of the nine states a model has."""
    return 6 if motion == CV else 9


@compiled_ieee
def process_noise(
    motion: int, sigma: float, sigma_turn: float, dt: float, reference: float, continuous: bool, q: FloatArray, j: int
) -> None:
    """Write the six distinct elements of Q over `dt` into row `j` of `q` (models, 6): pp, pv, vv, pu, vu, uu (u the
    third block).

    `sigma` and `sigma_turn` refer to one reference interval. Every block is a multiple of the unit matrix.
    """
    s2 = sigma * sigma
    for i in range(6):
        q[j, i] = 0.0
    if motion == CA:
        if continuous:
            s2 = s2 / reference
            q[j, 0], q[j, 1], q[j, 2] = s2 * dt**5 / 20.0, s2 * dt**4 / 8.0, s2 * dt**3 / 3.0
            q[j, 3], q[j, 4], q[j, 5] = s2 * dt**3 / 6.0, s2 * dt**2 / 2.0, s2 * dt
        else:
            q[j, 0], q[j, 1], q[j, 2] = s2 * dt**4 / 4.0, s2 * dt**3 / 2.0, s2 * dt**2
            q[j, 3], q[j, 4], q[j, 5] = s2 * dt**2 / 2.0, s2 * dt, s2
        return
    if continuous:
        s2 = s2 * reference
        q[j, 0], q[j, 1], q[j, 2] = s2 * dt**3 / 3.0, s2 * dt**2 / 2.0, s2 * dt
    else:
        q[j, 0], q[j, 1], q[j, 2] = s2 * dt**4 / 4.0, s2 * dt**3 / 2.0, s2 * dt**2
    if motion != CV:
        q[j, 5] = sigma_turn * sigma_turn * dt / reference


@compiled_ieee
def turn(x: FloatArray, row: int, to: int, dt: float, second_order: bool, f: FloatArray) -> None:
    """Turn model at the state in `row` of `x` (n, 9): predicted position and velocity into row `to`, Jacobian into `f`
    (54).

    `f` has six rows of nine, for position, velocity, turn rate; the position's own block [I; 0] is not written.
    """
    v0, v1, v2 = x[row, 3], x[row, 4], x[row, 5]
    w0, w1, w2 = x[row, 6], x[row, 7], x[row, 8]
    square = w0 * w0 + w1 * w1 + w2 * w2
    angle = math.sqrt(square) * dt
    s1, s2, s3 = dt, 0.5 * dt * dt, 0.0
    d1, d2, d3 = 0.0, 0.0, 0.0
    if not second_order and angle < SMALL_TURN:
        a2 = angle * angle
        s1 = dt * (1.0 - a2 / 6.0 * (1.0 - a2 / 20.0))
        s2 = dt * dt * (0.5 - a2 / 24.0 * (1.0 - a2 / 30.0))
        s3 = dt * dt * dt * (1.0 / 6.0 - a2 / 120.0 * (1.0 - a2 / 42.0))
        d1 = -dt * dt * dt * (1.0 / 3.0 - a2 / 30.0 * (1.0 - a2 / 28.0))
        d2 = -dt * dt * dt * dt * (1.0 / 12.0 - a2 / 180.0 * (1.0 - a2 * 3.0 / 112.0))
        d3 = -dt * dt * dt * dt * dt * (1.0 / 60.0 - a2 / 1260.0 * (1.0 - a2 / 48.0))
    elif not second_order:
        rate = math.sqrt(square)
        s, c = math.sin(angle), math.cos(angle)
        one = 1.0 / square
        s1 = s / rate
        s2 = (1.0 - c) * one
        s3 = (angle - s) * one / rate
        d1 = (angle * c - s) * one / rate
        d2 = (angle * s - 2.0 * (1.0 - c)) * one * one
        d3 = (3.0 * s - angle * c - 2.0 * angle) * one * one / rate
    dot = w0 * v0 + w1 * v1 + w2 * v2
    b0, b1, b2 = w1 * v2 - w2 * v1, w2 * v0 - w0 * v2, w0 * v1 - w1 * v0  # w x v
    c0, c1, c2 = w0 * dot - v0 * square, w1 * dot - v1 * square, w2 * dot - v2 * square  # w x (w x v)
    x[to, 0] = x[row, 0] + dt * v0 + s2 * b0 + s3 * c0
    x[to, 1] = x[row, 1] + dt * v1 + s2 * b1 + s3 * c1
    x[to, 2] = x[row, 2] + dt * v2 + s2 * b2 + s3 * c2
    x[to, 3] = v0 + s1 * b0 + s2 * c0
    x[to, 4] = v1 + s1 * b1 + s2 * c1
    x[to, 5] = v2 + s1 * b2 + s2 * c2
    _turn_rows(0, dt, s2, s3, d2, d3, v0, v1, v2, w0, w1, w2, b0, b1, b2, c0, c1, c2, dot, square, f)
    _turn_rows(27, 1.0, s1, s2, d1, d2, v0, v1, v2, w0, w1, w2, b0, b1, b2, c0, c1, c2, dot, square, f)


@compiled_inside
def _turn_rows(
    row: int, s0: float, s1: float, s2: float, d1: float, d2: float, v0: float, v1: float, v2: float,
    w0: float, w1: float, w2: float, b0: float, b1: float, b2: float, c0: float, c1: float, c2: float,
    dot: float, square: float, f: FloatArray,
) -> None:  # fmt: skip
    """Rows s0 I + s1 [w]x + s2 [w]x^2 (velocity) and -s1 [v]x + d1 b w' + s2 M + d2 c w' (turn rate) of the
    Jacobian.
    """
    f[row + 3] = s0 + s2 * (w0 * w0 - square)
    f[row + 4] = -s1 * w2 + s2 * w0 * w1
    f[row + 5] = s1 * w1 + s2 * w0 * w2
    f[row + 12] = s1 * w2 + s2 * w1 * w0
    f[row + 13] = s0 + s2 * (w1 * w1 - square)
    f[row + 14] = -s1 * w0 + s2 * w1 * w2
    f[row + 21] = -s1 * w1 + s2 * w2 * w0
    f[row + 22] = s1 * w0 + s2 * w2 * w1
    f[row + 23] = s0 + s2 * (w2 * w2 - square)
    # M = (w.v) I + w v' - 2 v w'; the terms with w' on the right are gathered in g
    g0, g1, g2 = d1 * b0 + d2 * c0 - 2.0 * s2 * v0, d1 * b1 + d2 * c1 - 2.0 * s2 * v1, d1 * b2 + d2 * c2 - 2.0 * s2 * v2
    f[row + 6] = g0 * w0 + s2 * (dot + w0 * v0)
    f[row + 7] = g0 * w1 + s2 * w0 * v1 + s1 * v2
    f[row + 8] = g0 * w2 + s2 * w0 * v2 - s1 * v1
    f[row + 15] = g1 * w0 + s2 * w1 * v0 - s1 * v2
    f[row + 16] = g1 * w1 + s2 * (dot + w1 * v1)
    f[row + 17] = g1 * w2 + s2 * w1 * v2 + s1 * v0
    f[row + 24] = g2 * w0 + s2 * w2 * v0 + s1 * v1
    f[row + 25] = g2 * w1 + s2 * w2 * v1 - s1 * v0
    f[row + 26] = g2 * w2 + s2 * (dot + w2 * v2)


@compiled_inside
def predict(
    motion: int,
    dt: float,
    decay: float,
    q: FloatArray,
    j: int,
    x: FloatArray,
    p: FloatArray,
    row: int,
    to: int,
    f: FloatArray,
) -> None:
    """Predict the density in `row` of `x` (n, 9) and `p` (n, 81) over `dt`, into row `to`.

    `decay` multiplies the turn rate; row `j` of `q` is the process noise; `f` (162) is scratch. The covariance is
    copied and then worked on in place: within one row the compiler knows which elements are apart, and vectorises.
    """
    for k in range(81):
        p[to, k] = p[row, k]
    if motion >= CT:
        turn(x, row, to, dt, motion == CT2, f)
        for a in range(6, 9):
            x[to, a] = decay * x[row, a]
        _turn_covariance(decay, p, to, f)
    else:
        third = 0.5 * dt * dt if motion == CA else 0.0
        first = dt if motion == CA else 0.0
        for a in range(3):
            x[to, a] = x[row, a] + dt * x[row, 3 + a] + third * x[row, 6 + a]
            x[to, 3 + a] = x[row, 3 + a] + first * x[row, 6 + a]
            x[to, 6 + a] = x[row, 6 + a]
        _shift(p, to, dt, first, third)
    for a in range(3):
        p[to, 10 * a] += q[j, 0]
        p[to, 10 * a + 3] += q[j, 1]
        p[to, 10 * a + 27] += q[j, 1]
        p[to, 10 * a + 30] += q[j, 2]
        p[to, 10 * a + 6] += q[j, 3]
        p[to, 10 * a + 54] += q[j, 3]
        p[to, 10 * a + 33] += q[j, 4]
        p[to, 10 * a + 57] += q[j, 4]
        p[to, 10 * a + 60] += q[j, 5]


@compiled_inside
def _shift(p: FloatArray, to: int, dt: float, first: float, half: float) -> None:
    """F P F' in place for constant acceleration, or velocity when `first` and `half` are zero."""
    for c in range(27):
        p[to, c] += dt * p[to, 27 + c] + half * p[to, 54 + c]
        p[to, 27 + c] += first * p[to, 54 + c]
    for a in range(9):
        for b in range(3):
            p[to, 9 * a + b] += dt * p[to, 9 * a + 3 + b] + half * p[to, 9 * a + 6 + b]
            p[to, 9 * a + 3 + b] += first * p[to, 9 * a + 6 + b]


@compiled_inside
def _turn_covariance(decay: float, p: FloatArray, to: int, f: FloatArray) -> None:
    """F P F' in place in row `to` for the turn model whose Jacobian is in the first 54 of `f`; the rest of `f` is
    free.
    """
    for a in range(6):
        f3, f4, f5, f6, f7, f8 = f[9 * a + 3], f[9 * a + 4], f[9 * a + 5], f[9 * a + 6], f[9 * a + 7], f[9 * a + 8]
        for c in range(9):
            f[54 + 9 * a + c] = (
                f3 * p[to, 27 + c]
                + f4 * p[to, 36 + c]
                + f5 * p[to, 45 + c]
                + f6 * p[to, 54 + c]
                + f7 * p[to, 63 + c]
                + f8 * p[to, 72 + c]
            )
    for c in range(27):  # the position's own block is the unit matrix
        f[54 + c] += p[to, c]
    for a in range(6):
        g = 54 + 9 * a
        g3, g4, g5, g6, g7, g8 = f[g + 3], f[g + 4], f[g + 5], f[g + 6], f[g + 7], f[g + 8]
        for c in range(a, 6):
            total = (
                g3 * f[9 * c + 3] + g4 * f[9 * c + 4] + g5 * f[9 * c + 5]
                + g6 * f[9 * c + 6] + g7 * f[9 * c + 7] + g8 * f[9 * c + 8]
            )  # fmt: skip
            if c < 3:
                total += f[g + c]
            p[to, 9 * a + c] = total
            p[to, 9 * c + a] = total
        for c in range(6, 9):
            p[to, 9 * a + c] = decay * f[g + c]
            p[to, 9 * c + a] = decay * f[g + c]
    for a in range(6, 9):
        for c in range(6, 9):
            p[to, 9 * a + c] *= decay * decay


def transition(motion: str, state: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
    """Predicted state (9,) of a model and the Jacobian (9, 9) of the prediction, for one state (9,)."""
    kind = MOTIONS[motion]
    n = states_of(kind)
    x = np.zeros((2, 9))
    x[0, :n] = np.asarray(state, dtype=np.float64)[:n]
    f = np.eye(9)
    if kind in (CT, CT2):
        turn(x, 0, 1, dt, kind == CT2, f[:6].reshape(-1))
        x[1, 6:] = x[0, 6:]
        return x[1], f
    f[0:3, 3:6] = f[3:6, 6:9] = dt * np.eye(3)
    f[0:3, 6:9] = 0.5 * dt * dt * np.eye(3)
    if kind == CV:
        f[:6, 6:] = 0.0
    return f @ x[0], f


def noise_matrix(
    motion: str, sigma: float, sigma_turn: float, dt: float, reference: float = 1.0, continuous: bool = False
) -> FloatArray:
    """Process noise covariance (9, 9) of a model over `dt`; rows and columns of states it has not are zero."""
    q = np.empty((1, 6))
    process_noise(MOTIONS[motion], sigma, sigma_turn, dt, reference, continuous, q, 0)
    pp, pv, vv, pu, vu, uu = q[0]
    return np.kron(np.array([[pp, pv, pu], [pv, vv, vu], [pu, vu, uu]]), np.eye(3))
