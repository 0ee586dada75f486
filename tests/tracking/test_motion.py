import numpy as np
import pytest
from scipy.linalg import expm

from rangeeval.tracking.motion import SMALL_TURN, noise_matrix, transition

STATE = np.array([21e3, 14e3, 400.0, -80.0, -390.0, 35.0, 0.04, -0.02, 0.15])


def differences(motion, state, dt, n):
    """Jacobian by central differences, with steps that suit metres, metres per second and radians per second."""
    steps = np.array([1e-1] * 3 + [1e-3] * 3 + [1e-6 if motion.startswith("ct") else 1e-3] * 3)[:n]
    columns = []
    for i, h in enumerate(steps):
        e = np.zeros(9)
        e[i] = h
        columns.append((transition(motion, state + e, dt)[0] - transition(motion, state - e, dt)[0])[:n] / (2 * h))
    return np.array(columns).T


@pytest.mark.parametrize("motion", ["cv", "ca", "ct", "ct-second-order"])
@pytest.mark.parametrize("rate", [0.0, 1e-5, 0.008, 0.15, 1.2])
def test_the_jacobian_is_the_derivative_of_the_prediction(motion, rate):
    """Analytic and numerical Jacobian agree, at no turn, in the series and beyond it."""
    state = STATE.copy()
    state[6:] *= rate / np.linalg.norm(STATE[6:])
    n = 6 if motion == "cv" else 9
    np.testing.assert_allclose(
        transition(motion, state, 1.3)[1][:n, :n], differences(motion, state, 1.3, n), rtol=2e-5, atol=2e-3
    )


def test_the_exact_turn_solves_its_differential_equation():
    """dv/dt = w x v, dp/dt = v: the matrix exponential of the linear system for fixed w gives the same motion."""
    w0, w1, w2 = STATE[6:]
    cross = np.array([[0, -w2, w1], [w2, 0, -w0], [-w1, w0, 0]])
    system = np.zeros((6, 6))
    system[:3, 3:], system[3:, 3:] = np.eye(3), cross
    np.testing.assert_allclose(transition("ct", STATE, 2.5)[0][:6], expm(2.5 * system) @ STATE[:6], rtol=1e-13)


def test_series_and_closed_form_meet():
    """Just below and just above the switch the Jacobian is the same to the digits that the closed form has."""
    below, above = STATE.copy(), STATE.copy()
    unit = STATE[6:] / np.linalg.norm(STATE[6:])
    below[6:], above[6:] = unit * SMALL_TURN * (1 - 1e-12), unit * SMALL_TURN * (1 + 1e-12)
    np.testing.assert_allclose(transition("ct", below, 1.0)[1], transition("ct", above, 1.0)[1], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("motion", ["cv", "ca"])
def test_continuous_noise_adds_up_over_any_division_of_time(motion):
    """Q over 3 s is the sum over 1 s and 2 s carried along; noise that is constant over a step does not add up so."""

    def over(dt, continuous):
        return noise_matrix(motion, 3.0, 0.0, dt, 1.0, continuous)

    f = transition(motion, np.zeros(9), 2.0)[1]
    np.testing.assert_allclose(f @ over(1.0, True) @ f.T + over(2.0, True), over(3.0, True), rtol=1e-12)
    assert not np.allclose(f @ over(1.0, False) @ f.T + over(2.0, False), over(3.0, False), rtol=0.01)


def test_both_kinds_of_noise_agree_in_velocity_over_the_reference_interval():
    """A reference interval changes the velocity by the same sigma whichever way the noise is thought of."""
    one, other = (noise_matrix("cv", 3.0, 0.0, 4.0, 4.0, continuous) for continuous in (True, False))
    assert one[3, 3] == pytest.approx(other[3, 3]) == pytest.approx((3.0 * 4.0) ** 2)


def test_the_turn_rate_block_has_its_own_noise():
    """Erratum of the paper's eq. 11: the turn rate's noise is not multiplied by that of the velocity."""
    q = noise_matrix("ct", 40.0, 0.05, 1.0)
    np.testing.assert_allclose(q[6:, 6:], 0.05**2 * np.eye(3))
    assert not np.any(q[:6, 6:])
