"""Smoothing: the best estimate of a trajectory from the plots before and after, with one model (RTS) or several (IMM).

Works on many runs of equal length and equal times at once (the first axis), in numpy.

References
----------
Rauch, Tung and Striebel (1965). Several models: for each pair (model i at k, model j at k + 1) the likelihood of the
later plots, as a Gaussian function of the state at k + 1, is the quotient of model j's smoothed and predicted
densities; the pair's weight is its integral over the prediction of j from i. Kim's shortcut (one smoothed density for
all i, no such weight) is worse than not smoothing at all, see docs/explanation/imm.md.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rangeeval.tracking.cycle import DECAY, PRIOR, SIGMA, SIGMA_TURN, Setup, probabilities_over
from rangeeval.tracking.mixing import RESET, UNBIASED, UNBIASED_CROSS
from rangeeval.tracking.motion import moved, noise_matrix, states_of, third_block

FloatArray = NDArray[np.float64]


class Densities(NamedTuple):
    """The models' densities of many runs at one time: (runs, models, 9), (runs, models, 9, 9), (runs, models)."""

    state: FloatArray
    covariance: FloatArray
    probability: FloatArray


def backward(setup: Setup, later: Densities, predicted: Densities, filtered: Densities, dt: float) -> Densities:
    """One step back: smoothed densities at k from those at k + 1 (`later`), the prediction to k + 1 and the filtered at
    k.
    """
    motions = [int(motion) for motion in setup.motions]
    if len(motions) == 1:
        return _rts(setup, motions[0], later, predicted, filtered, dt)
    pi = _transition(setup, dt)
    runs, models = filtered.probability.shape
    weights = np.full((runs, models, models), -np.inf)
    states = np.zeros((runs, models, models, 9))
    covariances = np.zeros((runs, models, models, 9, 9))
    for j, motion in enumerate(motions):
        n = states_of(motion)
        xs, ps = later.state[:, j, :n], later.covariance[:, j, :n, :n]
        xp, pp = predicted.state[:, j, :n], predicted.covariance[:, j, :n, :n]
        information = _inverse(pp)
        more = _positive(_inverse(ps) - information)
        vector = _times(more, xs) + _times(information, xs - xp)
        base = _integral(xp, pp, more, vector)
        for i, from_motion in enumerate(motions):
            m = states_of(from_motion)
            x, p, cross = _converted(setup, i, j, filtered)
            a, jacobian = _moved(setup, j, x, dt)
            spread = jacobian @ p @ _t(jacobian) + _noise(setup, j, dt)[:n, :n]
            inverse = _inverse(spread)
            pq = _inverse(inverse + more)
            xq = _times(pq, _times(inverse, a) + vector)
            gain = cross @ _t(jacobian) @ inverse
            states[:, i, j, :m] = filtered.state[:, i, :m] + _times(gain, xq - a)
            covariances[:, i, j, :m, :m] = filtered.covariance[:, i, :m, :m] + gain @ (pq - spread) @ _t(gain)
            with np.errstate(divide="ignore", invalid="ignore"):
                log_weight = (
                    np.log(
                        pi[i, j] * filtered.probability[:, i] * later.probability[:, j] / predicted.probability[:, j]
                    )
                    + _integral(a, spread, more, vector)
                    - base
                )
            weights[:, i, j] = np.where(np.isfinite(log_weight), log_weight, -np.inf)
    weights = np.exp(weights - weights.max((1, 2), keepdims=True))
    weights /= weights.sum((1, 2), keepdims=True)
    probability = weights.sum(2)
    # a model without any weight keeps its filtered density
    inner = np.where(probability[..., None] > 0, weights / np.maximum(probability[..., None], 1e-300), 0.0)
    state = np.einsum("nij,nija->nia", inner, states)
    away = states - state[:, :, None]
    covariance = np.einsum("nij,nijab->niab", inner, covariances + away[..., :, None] * away[..., None, :])
    lost = ~(probability > 0)
    state[lost] = filtered.state[lost]
    covariance[lost] = filtered.covariance[lost]
    return Densities(state, covariance, probability)


def merged(densities: Densities) -> tuple[FloatArray, FloatArray]:
    """Mean (runs, 6) and covariance (runs, 6, 6) of position and velocity over the models."""
    x, p = densities.state[..., :6], densities.covariance[..., :6, :6]
    mean = np.einsum("nj,nja->na", densities.probability, x)
    away = x - mean[:, None]
    covariance = np.einsum("nj,njab->nab", densities.probability, p + away[..., :, None] * away[..., None, :])
    return mean, covariance


def retrodicted(setup: Setup, state: FloatArray, covariance: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
    """Position and velocity (runs, 6) a time `dt` before, at constant velocity with the first model's noise."""
    f = np.eye(6)
    f[:3, 3:] = -dt * np.eye(3)
    noise = _noise(setup, 0, dt)[:6, :6]
    flip = np.diag([1.0, 1, 1, -1, -1, -1])  # time runs backward: the noise's cross terms change sign
    return state @ f.T, f @ covariance @ f.T + flip @ noise @ flip


def _rts(
    setup: Setup, motion: int, later: Densities, predicted: Densities, filtered: Densities, dt: float
) -> Densities:
    n = states_of(motion)
    x, p = filtered.state[:, 0, :n], filtered.covariance[:, 0, :n, :n]
    jacobian = _moved(setup, 0, x, dt)[1]
    gain = p @ _t(jacobian) @ _inverse(predicted.covariance[:, 0, :n, :n])
    state, covariance = filtered.state.copy(), filtered.covariance.copy()
    state[:, 0, :n] = x + _times(gain, later.state[:, 0, :n] - predicted.state[:, 0, :n])
    change = later.covariance[:, 0, :n, :n] - predicted.covariance[:, 0, :n, :n]
    covariance[:, 0, :n, :n] = p + gain @ change @ _t(gain)
    return Densities(state, covariance, filtered.probability)


def _converted(setup: Setup, i: int, j: int, at: Densities) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Filtered density of model i in the states of model j, and its covariance with the states of model i."""
    m, n = states_of(int(setup.motions[i])), states_of(int(setup.motions[j]))
    x, p = at.state[:, i, :m], at.covariance[:, i, :m, :m]
    if n == 6 or third_block(int(setup.motions[i])) == third_block(int(setup.motions[j])):
        return x[:, :n], p[:, :n, :n], p[:, :, :n]
    runs = len(x)
    y, s, cross = np.zeros((runs, 9)), np.zeros((runs, 9, 9)), np.zeros((runs, m, 9))
    y[:, :6], s[:, :6, :6], cross[:, :, :6] = x[:, :6], p[:, :6, :6], p[:, :, :6]
    own_x, own_p = at.state[:, j], at.covariance[:, j]
    padding = setup.scalars.padding
    if padding == RESET:
        s[:, 6:, 6:] = np.eye(3) * setup.table[j, PRIOR] ** 2
    elif padding == UNBIASED:
        y[:, 6:], s[:, 6:, 6:] = own_x[:, 6:], own_p[:, 6:, 6:]
    elif padding == UNBIASED_CROSS:
        b = own_p[:, 6:, :6] @ _inverse(own_p[:, :6, :6])
        y[:, 6:] = own_x[:, 6:] + _times(b, x[:, :6] - own_x[:, :6])
        s[:, 6:, :6] = b @ p[:, :6, :6]
        s[:, :6, 6:] = _t(s[:, 6:, :6])
        s[:, 6:, 6:] = own_p[:, 6:, 6:] + b @ (p[:, :6, :6] - own_p[:, :6, :6]) @ _t(b)
        cross[:, :, 6:] = p[:, :, :6] @ _t(b)
    return y, s, cross


def _moved(setup: Setup, j: int, x: FloatArray, dt: float) -> tuple[FloatArray, FloatArray]:
    """Predicted states (runs, n) of model j and Jacobians (runs, n, n)."""
    return moved(int(setup.motions[j]), x, dt, float(np.exp(-dt * setup.table[j, DECAY])))


def _noise(setup: Setup, j: int, dt: float) -> FloatArray:
    o, row = setup.scalars, setup.table[j]
    return noise_matrix(int(setup.motions[j]), row[SIGMA], row[SIGMA_TURN], dt, o.reference, o.continuous)


def _transition(setup: Setup, dt: float) -> FloatArray:
    m = len(setup.motions)
    if abs(dt - setup.scalars.reference) <= 1e-9 * setup.scalars.reference:
        return setup.pi[:m]
    return probabilities_over(setup.pi, dt)


def _integral(mean: FloatArray, covariance: FloatArray, more: FloatArray, vector: FloatArray) -> FloatArray:
    """Log of the integral of N(x; mean, covariance) exp(-x' more x / 2 + vector' x), up to a constant."""
    inverse = _inverse(covariance)
    b = _times(inverse, mean) + vector
    total = inverse + more
    quadratics = np.einsum("na,na->n", b, np.linalg.solve(total, b[..., None])[..., 0]) - np.einsum(
        "na,nab,nb->n", mean, inverse, mean
    )
    result: FloatArray = 0.5 * (quadratics - np.linalg.slogdet(covariance)[1] - np.linalg.slogdet(total)[1])
    return result


def _inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of positive definite matrices, scaled first: metres and radians per second differ by powers of ten."""
    scale = 1.0 / np.sqrt(np.diagonal(matrix, axis1=-2, axis2=-1))
    unit = matrix * scale[..., :, None] * scale[..., None, :]
    inverse = np.linalg.inv(unit) * scale[..., :, None] * scale[..., None, :]
    symmetric: FloatArray = 0.5 * (inverse + _t(inverse))
    return symmetric


def _positive(matrix: FloatArray) -> FloatArray:
    """The nearest matrices without negative eigenvalues: merging can leave a smoothed density wider than its
    prediction.
    """
    values, vectors = np.linalg.eigh(matrix)
    positive: FloatArray = (vectors * np.maximum(values, 0.0)[..., None, :]) @ _t(vectors)
    return positive


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    product: FloatArray = (matrix @ vector[..., None])[..., 0]
    return product


def _t(matrix: FloatArray) -> FloatArray:
    return np.swapaxes(matrix, -1, -2)
