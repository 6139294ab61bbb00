"""Sensors whose states follow the motion, such as a gyroscope that lags."""

import numpy as np
import pytest
from scipy.linalg import expm

from eqt_cli.api import load_experiment, margins
from eqt_cli.config import yaml_source
from eqt_cli.core.errors import EqtError
from eqt_cli.mechanics.law_input import LawInput

PERIOD, INERTIA, BIAS = 0.1, 2.0, 0.1

LOOP = f"""group: R1
inertia: {INERTIA}
gains: {{kp: 2, kd: 2}}
reference: {{kind: constant, velocity: [0.3]}}
controllers: [eqt]
initial: {{pose: {{kind: exp_normal, std: 0.6}}, velocity: {{kind: normal, std: 0.4}}}}
ensemble: {{runs: 2, seed: 4}}
time: {{duration: 2, samples: 21}}
control: {{period: {PERIOD}}}
"""


@pytest.mark.parametrize("engine", ["solve_ivp", "native"])
def test_a_law_reads_the_velocity_of_a_lagging_gyroscope(solved, engine):
    """While a command is held, V is linear in time, and the lag's answer has a closed form."""
    sensors = "{kind: lag, time_constant: {uniform: [0.2, 0.4]}}, {kind: bias, value: 0.1}"
    text = f"{LOOP}sensors: {{velocity: [{sensors}]}}\nsolver: {{engine: {engine}}}\n"
    problem, solution = solved(text)
    loop = problem.batched_loop(extra_axes=1)
    s = loop.tracking(problem.times, solution.states)
    T = loop.vehicle.moving_sensors[0].time_constant[:, 0]
    assert T[0] != T[1]
    x = [s.V[:, 0]]
    for k in range(20):
        V, slope = s.V[:, k], loop.command(s)[:, k] / INERTIA
        settled = V - slope * T
        x.append(settled + slope * PERIOD + (x[-1] - settled) * np.exp(-PERIOD / T))
    told = LawInput.of(s)._replace(velocity=np.stack(x, axis=1) + BIAS)
    law = loop.controller.torque(told.tracking(loop.group, loop.inertia, loop.gains, {}))
    # The solver's rtol is 1e-9.
    np.testing.assert_allclose(loop.command(s)[:, :-1], law[:, :-1], rtol=0, atol=1e-8)


def test_margins_contain_the_lag_of_a_gyroscope():
    """The eigenvalues are those of a plain linear system (x, v, measured v, held u)."""
    lag = "sensors: {velocity: [{kind: lag, time_constant: 0.3}]}"
    experiment = load_experiment(yaml_source.load(LOOP + lag, "text").data)
    [loop] = experiment.base.loops.values()
    Q, V = loop.group.exp(np.array([[0.0], [1.0], [0.0]])), np.array([[0.0], [0.0], [1.0]])
    Qd, Vd = loop.group.exp(np.zeros((3, 1))), np.zeros((3, 1))
    torque = loop.controller.torque(loop.tracking(0.0, loop.initial_state(Q, V, Qd, Vd)))[:, 0]
    A = np.zeros((4, 4))
    A[0, 1], A[1, 3], A[2, 1], A[2, 2] = 1, 1 / INERTIA, 1 / 0.3, -1 / 0.3
    answer = np.diag([1.0, 1.0, 1.0, 0.0])
    answer[3, :3] = torque[1] - torque[0], 0, torque[2] - torque[0]
    expected = np.abs(np.linalg.eigvals(expm(A * PERIOD) @ answer)).max()
    [found] = margins(experiment).laws
    np.testing.assert_allclose(found.size, expected, rtol=1e-7)  # of differences
    assert not margins(experiment).left_out


@pytest.mark.parametrize(
    ("sensors", "message"),
    [
        (
            "pose: [{kind: lag, time_constant: 1}]",
            "sensors.pose[0]: lag measures velocities; move it to sensors.velocity",
        ),
        (
            "velocity: [{kind: lag, time_constant: 0}]",
            "sensors.velocity[0].time_constant: expected a number greater than 0, got 0",
        ),
        (
            "velocity: [{kind: lag, time_constant: [1, 2]}]",
            "sensors.velocity[0].time_constant: expected 1 entries for R1, got 2",
        ),
    ],
)
def test_what_is_wrong_is_said_at_its_place(sensors, message):
    with pytest.raises(EqtError) as caught:
        load_experiment(yaml_source.load(f"{LOOP}sensors: {{{sensors}}}", "text").data)
    assert str(caught.value).split(": ", 1)[1] == message
