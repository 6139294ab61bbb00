"""Reversible propellers against a plain program and by their static curve, and their messages."""

import numpy as np
import plain_thrusters as plain
import pytest
import yaml
from scipy.integrate import solve_ivp

from eqt_cli.base.errors import ConfigError, Problems
from eqt_cli.components.blocks import signals
from eqt_cli.extend import group_named
from eqt_cli.extensions.thrusters.parts import Jets
from eqt_cli.extensions.thrusters.propellers import Propellers

K, ASTERN, DEAD, NEUTRAL = [4e-4, 5e-4, 4e-4, 3e-4], 0.7, [20.0, 25.0, 20.0, 30.0], 0.05
LOW, HIGH, LAG = -100.0, [120.0, 70.0, 120.0, 120.0], [0.1, 0.15, 0.2, 0.1]
PLACES = [
    {"at": [0.5, 0.0], "along": [0, 1]},
    {"at": [-0.5, 0.1], "along": [0, 3]},
    {"at": [0.0, 0.4], "along": [1, 0]},
    {"at": [0.0, -0.4], "along": [1, 0.5]},
]
INERTIA, START = [1.0, 2.0, 2.5], np.array([0.9, -0.5, 0.7])
TIMES = np.linspace(0.0, 4.0, 11)
OPTIONS = {
    "thrust_constant": K,
    "time_constant": LAG,
    "low_speed": LOW,
    "high_speed": HIGH,
    "astern": ASTERN,
    "dead_speed": DEAD,
    "neutral": NEUTRAL,
}


def thrust(n, i):
    """The static curve of propeller i."""
    if n > DEAD[i]:
        return K[i] * (n**2 - DEAD[i] ** 2)
    return -ASTERN * K[i] * (n**2 - DEAD[i] ** 2) if n < -DEAD[i] else 0.0


def speed(f, i):
    """Its inverse, with a line of n |n| through the dead band."""
    k = K[i] if f > 0 else ASTERN * K[i]
    return np.sign(f) * np.sqrt(abs(f) / k + DEAD[i] ** 2 * min(abs(f) / NEUTRAL, 1.0))


class Vehicle(plain.Vehicle):
    """EqT on a plant whose propellers lag by their speeds."""

    def asked(self, wanted):
        low = [thrust(LOW, i) for i in range(4)]
        high = [thrust(HIGH[i], i) for i in range(4)]
        f = np.clip(self.B.T @ np.linalg.solve(self.B @ self.B.T, wanted), low, high)
        return np.array([speed(f[i], i) for i in range(4)])

    def field(self, t, y, command, _):
        rate = super().field(t, y, lambda t, y: np.zeros(4), None)  # the reference, and kinematics
        _, V, _, _, n = self.split(y)
        torque = self.B @ [thrust(n[i], i) for i in range(4)]
        d = self.d**2
        rate[d : d + 3] = np.linalg.solve(self.I, self.ad(V).T @ (self.I @ V) + torque)
        rate[-4:] = (self.asked(command(t, y)) - n) / LAG
        return rate


def torque(t):
    return np.array([0.3 * np.cos(t), 0.2 * np.sin(t), 0.1])


@pytest.mark.ci("integrates by a plain program")
@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
def test_states_are_those_of_a_plain_program(solved, engine):
    config = {
        "group": "SE2",
        "inertia": INERTIA,
        "gains": {"kp": 1.5, "kd": 1.2},
        "reference": {"torque": ["0.3*cos(t)", "0.2*sin(t)", 0.1]},
        "controllers": ["eqt"],
        "actuators": [{"kind": "propellers", "thrusters": PLACES} | OPTIONS],
        "initial": {
            "pose": {"kind": "exp_normal", "std": 0.0, "centre": START.tolist()},
            "velocity": {"kind": "fixed", "coordinates": START[::-1].tolist()},
        },
        "ensemble": {"runs": 1, "seed": 1},
        "time": {"duration": float(TIMES[-1]), "samples": len(TIMES)},
        "solver": {"engine": engine, "rtol": 1e-12, "atol": 1e-14},
    }
    problem, solution = solved(yaml.safe_dump(config))
    assert solution.messages == [""]
    s = problem.loop.tracking(problem.times, solution.states)
    program = Vehicle("SE2", INERTIA, 1.5, 1.2, torque, PLACES, -1.0, 1.0)
    Q = plain.plain.exp("SE2", START)
    y = program.start(Q, START[::-1], np.eye(3), np.zeros(3))
    y[-4:] = program.asked(program.law(0.0, *program.split(y)[:4]))
    # A speed crosses a kink where a thrust changes sign. There the step of SciPy errs by 1.6e-7
    # rad/s at the tolerances of other plain programs; at these, steps of 1 ms agree.
    law = lambda t, y: program.law(t, *program.split(y)[:4])  # noqa: E731
    ends, tight = (TIMES[0], TIMES[-1]), {"rtol": 1e-13, "atol": 1e-15}
    y = solve_ivp(program.field, ends, y, "DOP853", TIMES, args=(law, None), **tight).y.T
    n, found = y[:, -4:], signals(problem.loop.now(s))
    np.testing.assert_allclose(s.Q[0].reshape(-1, 9), y[:, :9], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.V[0], y[:, 9:12], rtol=0, atol=1e-9)
    # Speeds are up to 120 rad/s; plain programs with other largest steps differ by 7e-9.
    np.testing.assert_allclose(found["propeller_speed"][0], n, rtol=0, atol=12e-9)
    f = [[thrust(row[i], i) for i in range(4)] for row in n]
    np.testing.assert_allclose(found["thrust"][0], f, rtol=0, atol=1e-9)
    assert np.any(np.abs(n) < DEAD)
    assert np.any(n < -np.array(DEAD))
    assert np.any(n > DEAD)


def part(**options):
    places = {"matrix": np.eye(3).tolist(), "thrust_constant": 2e-3, "time_constant": 0.1}
    speeds = {"low_speed": -50.0, "high_speed": 60.0}
    return Propellers(**places | speeds | options).of_run(group_named("SO3"), None)


def test_the_allocation_is_the_inverse_of_the_curve():
    propellers = part(astern=0.8, dead_speed=10.0, neutral=0.1)
    f = np.array([-3.0, 0.1, 5.0])
    np.testing.assert_allclose(propellers.pushed(propellers.followed(f)), f, rtol=1e-14)
    ends = propellers.low, propellers.high
    np.testing.assert_allclose(ends, [[-0.8 * 2e-3 * 2400] * 3, [2e-3 * 3500] * 3], rtol=1e-14)


def test_within_the_neutral_range_thrust_is_lost():
    """The curve meets half of `neutral` at n² = f/k + n₀²/2 < n₀²: none of it arrives."""
    propellers = part(dead_speed=10.0, neutral=0.1)
    half = propellers.followed(np.full(3, 0.05))
    np.testing.assert_allclose(half**2, 0.05 / 2e-3 + 50.0, rtol=1e-14)
    np.testing.assert_array_equal(propellers.pushed(half), 0.0)


def test_without_a_dead_band_thrust_has_the_sign_of_the_speed():
    n = np.array([-20.0, 0.0, 30.0])
    np.testing.assert_allclose(part().pushed(n), 2e-3 * n * np.abs(n), rtol=1e-14)


def test_the_linear_part_lags_by_thrusts():
    """Of f = k n² and n_c = √(f_c/k), T ṅ = n_c − n becomes T ḟ = f_c − f near each f ≠ 0."""
    G, f, step = group_named("SO3"), np.array([3.0, -2.0, 1.0]), 1e-6
    propellers, linear = part(astern=0.8, dead_speed=10.0), part().linear_part
    n = propellers.followed(f)
    rates = propellers.state_rate(G, f + step, n) / step
    slopes = (propellers.pushed(n + 1e-3) - propellers.pushed(n - 1e-3)) / 2e-3
    np.testing.assert_allclose(slopes * rates, linear.state_rate(G, f + step, f) / step, rtol=1e-5)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"time_constant": None}, "time_constant: missing; propellers need it, for example 0.1 s"),
        ({"dead_speed": 55.0}, "beyond the dead band, to both sides; got 0 to 1.15 N"),
        ({"low_speed": 0.0}, "beyond the dead band, to both sides; got 0 to 7.2 N"),
        ({"low_speed": None}, "low_speed: missing; give both limits, low_speed and high_speed"),
        ({"jets": Jets(0.1)}, "jets: need period"),
        ({"astern": [1.0, 2.0]}, "astern: expected 3 entries, one for each thruster, got 2"),
        ({"neutral": 0.0}, "neutral: expected a number greater than 0, got 0"),
    ],
)
def test_what_is_wrong_is_said(options, said):
    problems = Problems(str)
    numbers = {"thrust_constant": 2e-3, "time_constant": 0.1, "low_speed": -50, "high_speed": 60}
    numbers |= {"matrix": np.eye(3).tolist()} | options
    Propellers(**numbers).check(group_named("SO3"), problems)
    with pytest.raises(ConfigError, match=said):
        problems.raise_if_any()
