"""How many steps stability alone asks for: known stability limits, and what engines then take."""

import math

import numpy as np
import pytest
from scipy.integrate import DOP853, RK23, RK45

from eqt_cli.engines import solve_ivp


def exponential(order):
    """The coefficients of the truncated exponential, in rising powers."""
    return np.array([1 / math.factorial(k) for k in range(order + 1)])


# Hairer and Wanner (1996), Section IV.2: on the negative real axis.
LIMITS = {
    "RK23": (solve_ivp.FUNCTIONS["RK23"], 2.513),
    "RK45": (solve_ivp.FUNCTIONS["RK45"], 3.307),
    "RK4": (exponential(4), 2.785),
    "Euler": (exponential(1), 2.0),
}


@pytest.mark.parametrize("method", LIMITS)
def test_limits_on_the_real_axis(method):
    coefficients, limit = LIMITS[method]
    steps = solve_ivp.steps(coefficients, np.array([[-10.0, -0.1, 3.0]]), 7.0)
    assert steps == pytest.approx(70 / limit, rel=2 * solve_ivp.RESOLUTION)


@pytest.mark.parametrize("method", [DOP853, RK45, RK23])
def test_functions_are_those_of_the_tableaus(method):
    """1 + z bᵀ(1 − zA)⁻¹1, by its series; the numbers in the table have 10 to 14 digits."""
    A, powers = np.zeros((method.n_stages,) * 2), [np.ones(method.n_stages)]
    of_stages = method.A[: method.n_stages, : method.n_stages]
    A[: len(of_stages), : of_stages.shape[1]] = of_stages
    for _ in range(method.n_stages - 1):
        powers.append(A @ powers[-1])
    expected = [1.0, *(method.B @ power for power in powers)]
    np.testing.assert_allclose(solve_ivp.FUNCTIONS[method.__name__], expected, rtol=1e-9)


def test_the_fastest_of_several_instants_does_not_count_for_all():
    coefficients, limit = LIMITS["Euler"]
    steps = solve_ivp.steps(coefficients, np.array([[-10.0], [-30.0]]), 1.0)
    assert steps == pytest.approx(20 / limit, rel=2 * solve_ivp.RESOLUTION)


def test_what_grows_or_rests_asks_for_no_step():
    for rates in ([5.0, 0.0], [0.5], [0.5 + 3j, 0.5 - 3j], [0.0], [3j, -3j]):
        assert solve_ivp.steps(LIMITS["RK4"][0], np.array([rates]), 1.0) == 0


def test_limit_of_an_oscillation_that_hardly_decays():
    """2√2 on the imaginary axis, where |R(iy)|² = 1 − y⁶/72 + y⁸/576 (ibid.)."""
    steps = solve_ivp.steps(LIMITS["RK4"][0], np.array([[-1e-12 + 10j, -1e-12 - 10j]]), 7.0)
    assert steps == pytest.approx(70 / np.sqrt(8), rel=2 * solve_ivp.RESOLUTION)


def test_a_method_that_is_always_stable_takes_steps_of_forty_time_constants():
    """R = ½ everywhere: farther than that nobody looks."""
    steps = solve_ivp.steps(np.array([0.5]), np.array([[-80.0, -1.0]]), 3.0)
    assert steps == pytest.approx(6, rel=4e-4)
