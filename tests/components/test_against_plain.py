"""Loops with a vehicle against a program that was written without eqt, on SO3 and SE3.

Both integrate at rtol 1e-12 or 1e-10; errors grow by less than a factor 100 over the horizon, so
that 1e-6 is far above either, and far below any effect of a wrong term.
"""

from functools import cache

import numpy as np
import plain
import pytest

TOLERANCE = 1e-6
INERTIA = {"SO3": [1.0, 2.0, 2.5], "SE3": [1.0, 2.0, 2.5, 3.0, 4.0, 5.0]}
TRUE = {"SO3": [1.2, 1.9, 2.6], "SE3": [1.2, 1.9, 2.6, 3.5, 3.5, 6.0]}
LIMIT, LAG, PUSH = 0.6, 0.3, 0.15
DURATION, SAMPLES = 2.0, 21

CASES = {
    "unequal limits": {"limit": (-0.4, [0.5, 0.2, 0.6, 1.0, 0.3, 0.7])},
    "all": {"true": True, "push": True, "limit": True, "lag": True},
    "delay": {"period": 0.1, "delay": 2},
    "uneven period": {"period": 0.08, "delay": 1},
    "sampled": {"true": True, "push": True, "limit": True, "lag": True, "period": 0.1, "delay": 1},
}


def text(group, engine, case):
    m = len(INERTIA[group])
    plant, actuators = [], []
    if case.get("true"):
        plant.append(f"  inertia: {TRUE[group]}")
    if case.get("push"):
        entries = [PUSH, "0.1*sin(t)"] + [0] * (m - 2)
        plant += ["  forces:", f"    - {{kind: expression, force: {entries}}}"]
    if isinstance(case.get("limit"), tuple):
        low, high = case["limit"]
        actuators.append(f"  - {{kind: limit, low: {low}, high: {high[:m]}}}")
    elif case.get("limit"):
        actuators.append(f"  - {{kind: limit, limit: {LIMIT}}}")
    if case.get("lag"):
        actuators.append(f"  - {{kind: lag, time_constant: {LAG}}}")
    lines = ["plant:", *plant] if plant else []
    lines += ["actuators:", *actuators] if actuators else []
    if "period" in case:
        lines.append(f"control: {{period: {case['period']}, delay: {case.get('delay', 0)}}}")
    start = [0.9, -0.5, 0.7, 0.3, -0.2, 0.4][:m]
    return f"""
group: {group}
inertia: {INERTIA[group]}
gains: {{kp: 1.5, kd: 1.2}}
reference: {{kind: torque, torque: {["0.3*cos(t)", "0.2*sin(t)", "0.1", "0.2", "0", "0.1*t"][:m]}}}
controllers: [eqt]
initial:
  pose: {{kind: exp_normal, std: 0.0, centre: {start}}}
  velocity: {{kind: fixed, coordinates: {start[::-1]}}}
time: {{duration: {DURATION}, samples: {SAMPLES}}}
solver: {{engine: {engine}, rtol: 1.0e-10}}
""" + "\n".join(lines)


@cache
def expected(group, name):
    """Q and V at the sample times, for both engines."""
    case, times = CASES[name], np.linspace(0.0, DURATION, SAMPLES)
    m = len(INERTIA[group])

    def torque(t):
        return np.array([0.3 * np.cos(t), 0.2 * np.sin(t), 0.1, 0.2, 0, 0.1 * t][:m])

    def push(t):
        return np.array([PUSH, 0.1 * np.sin(t), 0, 0, 0, 0][:m])

    limit = LIMIT
    if isinstance(case.get("limit"), tuple):
        limit = case["limit"][0], np.array(case["limit"][1][:m])
    program = plain.Plain(
        group,
        INERTIA[group],
        1.5,
        1.2,
        torque,
        true=TRUE[group] if case.get("true") else None,
        push=push if case.get("push") else None,
        limit=limit if case.get("limit") else np.inf,
    )
    start = np.array([0.9, -0.5, 0.7, 0.3, -0.2, 0.4][:m])
    d = program.d
    y = program.start(plain.exp(group, start), start[::-1], np.eye(d), np.zeros(m))
    lag = LAG if case.get("lag") else None
    y = program.run(y, times, lag=lag, period=case.get("period"), delay=case.get("delay", 0))
    return y[:, : d * d].reshape(-1, d, d), y[:, d * d : d * d + m]


SLOW = pytest.mark.ci("the plain program takes seconds there")
ENGINES = ("solve_ivp", "native")


@pytest.mark.parametrize(
    ("group", "engine", "name"),
    [
        pytest.param(group, ENGINES[(k + shift) % 2], name, marks=[SLOW] * (group == "SE3"))
        for group, shift in (("SO3", 0), ("SE3", 1))  # each case by both engines
        for k, name in enumerate(CASES)
    ],
)
def test_states_are_those_of_a_plain_program(solved, name, group, engine):
    case = CASES[name]
    problem, solution = solved(text(group, engine, case))
    assert solution.messages == [""]
    s = problem.loop.tracking(problem.times, solution.states)
    Q, V = expected(group, name)
    np.testing.assert_allclose(s.Q[0], Q, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(s.V[0], V, rtol=0, atol=TOLERANCE)
    # Limits leave kinks that solve_ivp steps over: its balance is as good as its states.
    L, W = s.lyapunov[0], problem.loop.work(solution.states)[0]
    np.testing.assert_allclose(L + W, L[0], rtol=0, atol=TOLERANCE)
