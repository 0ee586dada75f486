"""Motion models as compiled kernels: predicted state, its Jacobian and process noise of each, and the covariance.

States are padded to 9: position, velocity, and a third block that is the acceleration (`CA`), the vector turn rate
(`CT`, `CT2`) or unused (`CV`, where its numbers are kept finite but mean nothing). Kernels work in a model's row, see
`layout`.

References
----------
CT: dv/dt = w x v with constant w has v(T) = A v, p(T) = p + B v with A, B by Rodrigues' formula; `CT2` is the same to
second order in T: Jung (1999), eq 10 with its second derivatives put right.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rangeeval.compiled import compiled_borrowing, compiled_inside
from rangeeval.tracking.layout import JACOBIAN, NOISE, PREDICTED, PREDICTED_P, PRODUCT, WIDTH

FloatArray = NDArray[np.float64]

CV, CA, CT, CT2 = 0, 1, 2, 3
MOTIONS = {"cv": CV, "ca": CA, "ct": CT, "ct-second-order": CT2}
SMALL_TURN = 0.1  # w T below which the closed forms lose digits and the series are exact to the last

# Room of `turn`: velocity, w x v, w x (w x v); the matrices of w x and v x, row by row.
VELOCITY, FIRST, SECOND = PRODUCT, PRODUCT + 3, PRODUCT + 6
CROSS_W, CROSS_V = PRODUCT + 9, PRODUCT + 18


def states_of(motion: int) -> int:
    """How many of the nine states a model has."""
    return 6 if motion == CV else 9


def third_block(motion: int) -> int:
    """What the third block of a model's state is: 0 nothing, 1 acceleration, 2 turn rate."""
    return 0 if motion == CV else (1 if motion == CA else 2)


@compiled_inside
def process_noise(
    own: FloatArray, motion: int, sigma: float, sigma_turn: float, dt: float, reference: float, continuous: bool
) -> None:
    """Process noise over `dt` into NOISE: its blocks are multiples of the unit matrix.

    `sigma` and `sigma_turn` refer to one reference interval. With white noise in derivative n + 1 of the position the
    block of derivatives i and k is dt^m / ((n - i)! (n - k)! m), m = 2 n + 1 - i - k; noise that is constant over a
    step has g g' with g = (dt^2 / 2, dt, 1).
    """
    n = 2 if motion == CA else 1
    scale = sigma * sigma
    if continuous:
        scale = scale / reference if motion == CA else scale * reference
    halved = motion == CA or not continuous
    for c in range(9):
        own[NOISE + c] = 0.0
    for i in range(n + 1):
        for k in range(n + 1):
            power = float(2 * n + 1 - i - k) if continuous else float(4 - i - k)
            shared = scale * math.pow(dt, power) / (power if continuous else 1.0)
            shared *= (0.5 if i == 0 and halved else 1.0) * (0.5 if k == 0 and halved else 1.0)
            own[NOISE + 3 * i + k] = shared
    if motion >= CT:
        own[NOISE + 8] = sigma_turn * sigma_turn * dt / reference


@compiled_inside
def cross(own: FloatArray, to: int, at: int) -> None:
    """Matrix of the cross product with the vector at `at`, row by row, into the nine numbers from `to` on."""
    x, y, z = own[at], own[at + 1], own[at + 2]
    own[to], own[to + 4], own[to + 8] = 0.0, 0.0, 0.0
    own[to + 1], own[to + 2], own[to + 5] = -z, y, -x
    own[to + 3], own[to + 6], own[to + 7] = z, -y, x


@compiled_inside
def turn(own: FloatArray, dt: float, second_order: bool) -> None:
    """Turn model at the state in PREDICTED: predicted position and velocity in place, Jacobian into JACOBIAN.

    The coefficients are s_n = (T^(n-2) / (n-2)! - s_(n-2)) / w^2 from s_0 = cos wT and s_1 = sin wT / w on: the sine
    and cosine series from the power n on. Their derivatives by w, divided by w, need no division.
    """
    w0, w1, w2 = own[PREDICTED + 6], own[PREDICTED + 7], own[PREDICTED + 8]
    v0, v1, v2 = own[PREDICTED + 3], own[PREDICTED + 4], own[PREDICTED + 5]
    square = w0 * w0 + w1 * w1 + w2 * w2
    dot = w0 * v0 + w1 * v1 + w2 * v2
    half = 0.5 * dt * dt
    s1, s2, s3, d1, d2, d3 = dt, half, 0.0, 0.0, 0.0, 0.0
    if not second_order:
        a2 = square * dt * dt
        if a2 < SMALL_TURN * SMALL_TURN:
            s4 = (1.0 - a2 / 30.0 * (1.0 - a2 / 56.0 * (1.0 - a2 / 90.0))) / 24.0
            s5 = (1.0 - a2 / 42.0 * (1.0 - a2 / 72.0 * (1.0 - a2 / 110.0))) / 120.0
        else:
            angle = math.sqrt(a2)
            s4 = (0.5 - (1.0 - math.cos(angle)) / a2) / a2
            s5 = (1.0 / 6.0 - (angle - math.sin(angle)) / (a2 * angle)) / a2
        s4 *= half * half * 4.0
        s5 *= half * half * 4.0 * dt
        s3 = half * dt / 3.0 - square * s5
        s2 = half - square * s4
        s1 = dt - square * s3
        d1, d2, d3 = s3 - dt * s2, 2.0 * s4 - dt * s3, 3.0 * s5 - dt * s4
    cross(own, CROSS_W + 0, PREDICTED + 6)
    cross(own, CROSS_V + 0, PREDICTED + 3)
    for a in range(3):
        own[VELOCITY + a] = own[PREDICTED + 3 + a]
        row = CROSS_W + 3 * a
        own[FIRST + a] = own[row] * v0 + own[row + 1] * v1 + own[row + 2] * v2
        own[SECOND + a] = own[PREDICTED + 6 + a] * dot - own[VELOCITY + a] * square
    for block in range(2):  # position, then velocity: A and B in t0 I + t1 [w]x + t2 [w]x^2, their derivatives by w
        t0, t1, t2, e1, e2 = (dt, s2, s3, d2, d3) if block == 0 else (1.0, s1, s2, d1, d2)
        for a in range(3):
            row = 3 * block + a
            w, v, b, c = own[PREDICTED + 6 + a], own[VELOCITY + a], own[FIRST + a], own[SECOND + a]
            own[PREDICTED + row] = (own[PREDICTED + a] if block == 0 else 0.0) + t0 * v + t1 * b + t2 * c
            bent = e1 * b + e2 * c - 2.0 * t2 * v
            for k in range(3):
                wk, vk = own[PREDICTED + 6 + k], own[VELOCITY + k]
                own[JACOBIAN + 6 * k + row] = t1 * own[CROSS_W + 3 * a + k] + t2 * w * wk
                own[JACOBIAN + 18 + 6 * k + row] = bent * wk + t2 * w * vk - t1 * own[CROSS_V + 3 * a + k]
            own[JACOBIAN + 6 * a + row] += t0 - t2 * square
            own[JACOBIAN + 18 + 6 * a + row] += t2 * dot


@compiled_inside
def predict(own: FloatArray, motion: int, dt: float, decay: float) -> None:
    """Predict the density in PREDICTED over `dt`, in place; `decay` multiplies the turn rate."""
    if motion >= CT:
        turn(own, dt, motion == CT2)
        for a in range(6, 9):
            own[PREDICTED + a] *= decay
        _turn_covariance(own, decay)
    else:
        first = dt if motion == CA else 0.0
        third = 0.5 * dt * dt if motion == CA else 0.0
        for a in range(3):
            own[PREDICTED + a] += dt * own[PREDICTED + 3 + a] + third * own[PREDICTED + 6 + a]
            own[PREDICTED + 3 + a] += first * own[PREDICTED + 6 + a]
        for c in range(PREDICTED_P, PREDICTED_P + 27):
            own[c] += dt * own[c + 27] + third * own[c + 54]
            own[c + 27] += first * own[c + 54]
        for a in range(PREDICTED_P, PREDICTED_P + 81, 9):
            for c in range(a, a + 3):
                own[c] += dt * own[c + 3] + third * own[c + 6]
                own[c + 3] += first * own[c + 6]
    for i in range(3):
        for k in range(3):
            for a in range(3):
                own[PREDICTED_P + 27 * i + 3 * k + 10 * a] += own[NOISE + 3 * i + k]
    for a in range(9):  # rounding must not add up to a covariance that is not symmetric
        for c in range(a):
            own[PREDICTED_P + 9 * a + c] = own[PREDICTED_P + 9 * c + a]


@compiled_inside
def _turn_covariance(own: FloatArray, decay: float) -> None:
    """F P F' in place for the Jacobian of `turn`; only the upper triangle counts."""
    for a in range(6):
        for c in range(9):
            total = own[PREDICTED_P + 9 * a + c] if a < 3 else 0.0  # the position's own block is the unit matrix
            for k in range(6):
                total += own[JACOBIAN + 6 * k + a] * own[PREDICTED_P + 27 + 9 * k + c]
            own[PRODUCT + 9 * a + c] = total
    for a in range(6):
        for c in range(6):
            total = own[PRODUCT + 9 * a + c] if c < 3 else 0.0
            for k in range(6):
                total += own[PRODUCT + 9 * a + 3 + k] * own[JACOBIAN + 6 * k + c]
            own[PREDICTED_P + 9 * a + c] = total
    for a in range(6):
        for c in range(6, 9):
            own[PREDICTED_P + 9 * a + c] = decay * own[PRODUCT + 9 * a + c]
    for a in range(6, 9):
        for c in range(6, 9):
            own[PREDICTED_P + 9 * a + c] *= decay * decay


@compiled_borrowing
def _turned(states: FloatArray, dt: float, second_order: bool, jacobians: FloatArray, own: FloatArray) -> None:
    for run in range(len(states)):
        for a in range(9):
            own[PREDICTED + a] = states[run, a]
        turn(own, dt, second_order)
        for a in range(6):
            states[run, a] = own[PREDICTED + a]
            for k in range(6):
                jacobians[run, a, 3 + k] = own[JACOBIAN + 6 * k + a]


@compiled_borrowing
def _noise(
    own: FloatArray, motion: int, sigma: float, sigma_turn: float, dt: float, reference: float, continuous: bool
) -> None:
    process_noise(own, motion, sigma, sigma_turn, dt, reference, continuous)


def moved(motion: int, states: FloatArray, dt: float, decay: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Predicted states (runs, n) of a model and the Jacobians (runs, n, n) of the prediction; n is `states_of`."""
    runs, n = states.shape
    jacobians = np.broadcast_to(np.eye(n), (runs, n, n)).copy()
    if motion >= CT:
        after = np.array(states, dtype=np.float64)
        _turned(after, float(dt), motion == CT2, jacobians, np.zeros(WIDTH))
        after[:, 6:] *= decay
        jacobians[:, range(6, 9), range(6, 9)] = decay
        return after, jacobians
    jacobians[:, range(n - 3), range(3, n)] = dt
    if motion == CA:
        jacobians[:, range(3), range(6, 9)] = 0.5 * dt * dt
    return states @ jacobians[0].T, jacobians


def transition(motion: str, state: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
    """Predicted state (9,) of a model and the Jacobian (9, 9) of the prediction, for one state (9,)."""
    n = states_of(MOTIONS[motion])
    x, f = np.zeros(9), np.eye(9)
    after, jacobians = moved(MOTIONS[motion], np.asarray(state, dtype=np.float64)[None, :n], dt)
    x[:n], f[:n, :n] = after[0], jacobians[0]
    return x, f


def noise_matrix(
    motion: str | int, sigma: float, sigma_turn: float, dt: float, reference: float = 1.0, continuous: bool = False
) -> FloatArray:
    """Process noise covariance (9, 9) of a model over `dt`; rows and columns of states it has not are zero."""
    own = np.zeros(WIDTH)
    kind = MOTIONS[motion] if isinstance(motion, str) else motion
    _noise(own, kind, float(sigma), float(sigma_turn), float(dt), float(reference), continuous)
    blocks: FloatArray = own[NOISE : NOISE + 9].reshape(3, 3)
    matrix: FloatArray = np.kron(blocks, np.eye(3)).astype(np.float64)
    return matrix
