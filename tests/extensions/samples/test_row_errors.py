"""Errors of metrics by their samples, against quadrature of a pendulum that SciPy integrates."""

import numpy as np
import pytest
from scipy.integrate import simpson, solve_ivp
from small_experiment import mapping

from eqt_cli.api import load_experiment
from eqt_cli.extensions.samples.row_errors import row_errors

J, KP, KD, ANGLE = 0.5, 1.0, 0.8, 1.2


def errors(samples, duration=20.0):
    """Relative errors of means and peak, by trapezoids: J a″ = −2 kp sin a − kd a′ (Lee 2010)."""
    swing = solve_ivp(
        lambda t, x: [x[1], (-2 * KP * np.sin(x[0]) - KD * x[1]) / J],
        (0, duration),
        [ANGLE, 0],
        dense_output=True,
        rtol=1e-10,
        atol=1e-12,
    )

    def numbers(count):
        t = np.linspace(0, duration, count)
        angle, rate = swing.sol(t)
        torque = np.abs(2 * KP * np.sin(angle) + KD * rate)
        means = [np.trapezoid(x, t) / duration for x in (np.abs(angle), torque)]
        return np.array([*means, torque.max()])

    return np.abs(numbers(samples) / numbers(100_001) - 1)


def experiment(samples, **changes):
    changes = {
        "inertia": [J, J, J],
        "gains": {"kp": KP, "kd": KD},
        "reference": {"kind": "constant"},
        "controllers": ["lee2010"],
        "initial": {"pose": {"kind": "fixed", "coordinates": [0, 0, ANGLE]}},
        "ensemble": {"runs": 1},
        "time": {"duration": 20.0, "samples": samples},
        **changes,
    }
    return load_experiment(mapping(**changes))


@pytest.mark.ci("solves runs at thousands of samples")
@pytest.mark.parametrize("samples", [11, 41])
def test_rows_too_far_apart_are_told_with_a_number_that_does(samples):
    said = row_errors(experiment(samples))
    assert said["row_error"] >= 0.99 * errors(samples).max() > 0.01
    assert errors(said["row_samples"]).max() < 0.01
    assert row_errors(experiment(said["row_samples"])) == {}


def test_rows_that_are_near_enough_are_not_told():
    assert errors(401).max() < 0.005
    assert row_errors(experiment(401)) == {}


@pytest.mark.ci("integrates a stiff run by NumPy")
def test_rows_that_would_take_too_many_samples_are_said_not_to_be_judged():
    """A fast start of 0.1 s in 20 s, of which 1,001 rows miss most."""
    fast = {"inertia": 3 * [J / 100], "time": {"duration": 20.0, "samples": 1001}}
    said = row_errors(experiment(1001, solver={"engine": "solve_ivp"}, **fast))
    assert "of lee2010 are too far apart, which takes more than 4,000" in said["unjudged_rows"]


@pytest.mark.ci("solves runs at thousands of samples")
def test_a_lag_moves_the_torque_between_ticks_that_are_rows():
    """Rows at ticks miss ∫τ² of a lag τ′ = (u − τ)/T, whose commands u are held for a tick h."""
    h, T, count, parts = 0.2, 0.1, 21, 200
    state, torque = np.array([ANGLE, 0.0, -2 * KP * np.sin(ANGLE)]), []
    for _ in range(count - 1):
        u = -2 * KP * np.sin(state[0]) - KD * state[1]
        t = np.linspace(0, h, parts + 1)
        held = solve_ivp(
            lambda t, x, u=u: [x[1], x[2] / J, (u - x[2]) / T],
            (0, h),
            state,
            t_eval=t,
            rtol=1e-10,
            atol=1e-12,
        )
        torque.extend(held.y[2][:-1])
        state = held.y[:, -1]
    squares = np.array([*torque, state[2]]) ** 2
    exact = simpson(squares, dx=h / parts)
    error = abs(simpson(squares[::parts], dx=h) / exact - 1)
    with_lag = {
        "control": {"period": h},
        "actuators": [{"kind": "lag", "time_constant": T}],
        "time": {"duration": h * (count - 1), "samples": count},
    }
    said = row_errors(experiment(count, **with_lag))
    assert said["row_error"] >= 0.99 * error > 0.01
    assert row_errors(experiment(count, **{**with_lag, "actuators": []})) == {}
