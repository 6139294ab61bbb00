"""Control-moment gyros against a plain program, by conservation, and their messages."""

from dataclasses import replace

import numpy as np
import pytest
from plain import hat
from plain_satellite import exp
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from eqt_cli.base.errors import ConfigError, Problems
from eqt_cli.components.blocks import signals
from eqt_cli.components.vehicle_parts import Uniform
from eqt_cli.extend import group_named
from eqt_cli.extensions.spacecraft.gyros import Gyros
from eqt_cli.loop.linearised import linearised

INERTIA = np.array([[12.0, 0.4, 0.0], [0.4, 10.0, -0.3], [0.0, -0.3, 6.0]])
MOMENTA, GIMBAL, GAIN = np.array([2.0, 2.1, 1.9, 2.0]), 0.02, 0.5
START = [0.1, -0.2, 0.3, 0.0]
TEXT = """
group: SO3
inertia: {inertia}
gains: {{kp: 2, kd: 8}}
reference: {{kind: torque, torque: [0, 0, 0]}}
controllers: [lee2010]
actuators:
  - {{kind: gyros, pyramid: 54.7 deg, momentum: {momenta}, inertia: {gimbal}, gain: {gain},
     start: {start}, limit: 1.0}}
initial:
  pose: {{kind: exp_normal, std: 0.0, centre: [0.9, -0.5, 0.7]}}
  velocity: {{kind: normal, std: 0.1}}
ensemble: {{runs: 1, seed: 1}}
time: {{duration: 2.5, samples: 11}}
solver: {{engine: {engine}, rtol: 1.0e-12, atol: 1.0e-14}}
"""


def axes():
    """Gimbal and spin axes of a pyramid of 54.7°, as columns."""
    rows, tilt = [], np.radians(54.7)
    for at in np.radians([45, 135, 225, 315]):
        g = [np.sin(tilt) * np.cos(at), np.sin(tilt) * np.sin(at), np.cos(tilt)]
        rows.append([g, [-np.sin(at), np.cos(at), 0.0]])
    return np.moveaxis(np.array(rows), 0, -1)


def rate(t, y):
    """Ṙ, ω̇, δ̇ and ṗ, with Newton's and Euler's laws for each gyro by itself."""
    g, s0 = axes()
    across = np.cross(g, s0, axis=0)
    R, w, angle, p = y[:9].reshape(3, 3), y[9:12], y[12:16], y[16:]
    s = np.cos(angle) * s0 + np.sin(angle) * across
    A = MOMENTA * (np.cos(angle) * across - np.sin(angle) * s0)
    error = np.array([(R - R.T)[2, 1], (R - R.T)[0, 2], (R - R.T)[1, 0]])
    command = -2.0 * error - 8.0 * w + np.cross(w, INERTIA @ w)
    regular = A @ A.T + 0.01 * np.mean(MOMENTA**2) * np.eye(3)
    wanted = np.clip(-A.T @ np.linalg.solve(regular, command), -1.0, 1.0)
    turning = p / GIMBAL - g.T @ w
    H, p_dot = s @ MOMENTA + g @ p, GAIN * (wanted - turning) + A.T @ w
    total = INERTIA @ w + H
    w_dot = np.linalg.solve(INERTIA, -np.cross(w, total) - A @ turning - g @ p_dot)
    return np.concatenate([(R @ hat(w)).ravel(), w_dot, turning, p_dot])


def plain(times, start):
    """R, ω, δ and p by SciPy."""
    how = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-14, "t_eval": times}
    return solve_ivp(rate, (0, times[-1]), start, **how).y.T


def test_the_linear_loop_at_rest_is_that_of_a_plain_program(experiment_of):
    """Eigenvalues by differences, of which four are 0: angles alone move nothing."""
    turned_by = Rotation.from_rotvec
    values = {"inertia": INERTIA.tolist(), "momenta": MOMENTA.tolist(), "gimbal": GIMBAL}
    text = TEXT.format(**values, gain=GAIN, start=START, engine="solve_ivp")
    loop = experiment_of(text).loops["lee2010"]
    rest = linearised(loop, np.zeros(1), np.eye(3)[None], np.zeros((1, 3)))

    def change(x):
        y = np.concatenate([turned_by(x[:3]).as_matrix().ravel(), x[3:6], START + x[6:10], x[10:]])
        turned = y[:9].reshape(3, 3).T @ rate(0.0, y)[:9].reshape(3, 3)
        skew = (turned - turned.T) / 2
        return np.concatenate([[skew[2, 1], skew[0, 2], skew[1, 0]], rate(0.0, y)[9:]])

    steps = 1e-6 * np.eye(14)
    slopes = np.array([(change(x) - change(-x)) / 2e-6 for x in steps]).T
    expected, found = np.linalg.eigvals(slopes), np.linalg.eigvals(rest.closed[0])
    assert np.sort(np.abs(expected))[3] < 1e-6
    expected = expected[np.argsort(np.abs(expected))[4:]]
    # Central differences are exact to about 1e-10 of the entries, which are up to 1e2.
    np.testing.assert_allclose(np.sort(found), np.sort(expected), rtol=0, atol=1e-6)


SLOW = pytest.mark.ci("solves by NumPy")


@pytest.fixture(params=["native", pytest.param("solve_ivp", marks=SLOW)])
def flown(request, solved):
    values = {"inertia": INERTIA.tolist(), "momenta": MOMENTA.tolist(), "gimbal": GIMBAL}
    text = TEXT.format(**values, gain=GAIN, start=START, engine=request.param)
    problem, solution = solved(text, label="lee2010")
    assert solution.messages == [""]
    return problem, problem.loop.tracking(problem.times, solution.states)


def test_states_are_those_of_a_plain_program(flown):
    problem, s = flown
    w = s.V[0, 0]
    momenta = GIMBAL * axes()[0].T @ w  # gimbals rest in the body
    y = np.concatenate([exp([0.9, -0.5, 0.7]).ravel(), w, START, momenta])
    np.testing.assert_allclose(s.Q[0, 0].ravel(), y[:9], rtol=0, atol=1e-15)
    expected = plain(problem.times, y)
    found = signals(problem.loop.now(s))
    np.testing.assert_allclose(s.Q[0].reshape(-1, 9), expected[:, :9], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.V[0], expected[:, 9:12], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found["gimbal_angle"][0], expected[:, 12:16], rtol=0, atol=1e-9)
    rates = expected[:, 16:] / GIMBAL - expected[:, 9:12] @ axes()[0]
    np.testing.assert_allclose(found["gimbal_rate"][0], rates, rtol=0, atol=1e-9)
    assert np.abs(expected[:, 12:16] - START).max() > 0.3  # they turn far
    assert np.linalg.norm(s.Q[0, -1] - np.eye(3)) < np.linalg.norm(s.Q[0, 0] - np.eye(3))


def test_total_momentum_stays(flown):
    """R(𝕁ω + H), by the tolerance of the solver."""
    s = flown[1]
    x = s.vehicle["actuators_0"][0]
    g, s0 = axes()
    turned = np.cos(x[:, None, :4]) * s0 + np.sin(x[:, None, :4]) * np.cross(g, s0, axis=0)
    H = turned @ MOMENTA + x[:, 4:] @ g.T
    total = np.einsum("tij,tj->ti", s.Q[0], s.V[0] @ INERTIA + H)
    np.testing.assert_allclose(total, total[:1] + 0 * total, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"start": [0.1]}, "expected 4 entries, one for each gyro, got 1"),
        ({"momentum": -1.0}, "greater than 0"),
        ({"gain": 0.0}, "greater than 0"),
    ],
)
def test_what_is_wrong_is_said(options, said):
    problems = Problems(str)
    numbers = {"pyramid": 1.0, "momentum": 1.0, "inertia": 0.1, "gain": 0.5} | options
    Gyros(**numbers).check(group_named("SO3"), problems)
    with pytest.raises(ConfigError, match=said):
        problems.raise_if_any()


def test_a_vehicle_has_one_entry_of_gyros(experiment_of):
    gyros = "{kind: gyros, pyramid: 1, momentum: 1, inertia: 1, gain: 1}"
    with pytest.raises(ConfigError, match=r"actuators\[1\]: a vehicle has one entry with gyros"):
        experiment_of(
            f"{{group: SO3, inertia: 1, gains: {{kp: 1, kd: 1}}, controllers: [eqt], "
            f"actuators: [{gyros}, {gyros}], reference: {{kind: torque, torque: [0, 0, 0]}}, "
            "initial: {pose: haar, velocity: fixed}, time: {duration: 1, samples: 2}}"
        )


@pytest.mark.parametrize(
    ("degrees", "said"),
    [
        (54.7, ""),
        (0.0, "with rank 2 of 3 cannot push along ωz; what a law asks for there is lost"),
        (90.0, "rank 1 of 3 cannot push along ωx, ωy; what a law asks for there is lost, until "),
    ],
)
def test_a_pyramid_without_all_torques_is_remarked_on(degrees, said):
    """All t are in the plane of upright gimbals, and at the start along z about level ones."""
    part = Gyros(pyramid=np.radians(degrees), momentum=1.0, inertia=0.1, gain=0.5)
    for name, axes in (("SO3", 3), ("SE3", 6)):
        told = [*part.remarks(group_named(name), np.eye(axes))]
        assert len(told) == bool(said) and all(said in text for text in told)


def test_a_singularity_loses_torque_and_stays_finite():
    """With upright gimbals at equal angles from x, all t are e_y: A Aᵀ = 4 e_y e_yᵀ."""
    part = Gyros(pyramid=0.0, momentum=1.0, inertia=0.1, gain=0.5).of_run(group_named("SO3"), None)
    command, angles = np.array([1.0, 2.0, 3.0]), -np.radians([135.0, 225.0, 315.0, 405.0])
    x = np.concatenate([angles, np.zeros(4)])
    _, torques = np.split(part.state_rate(group_named("SO3"), command, x), 2)
    np.testing.assert_allclose(torques / 0.5, [-2.0 / 4.01] * 4, rtol=0, atol=1e-14)


@pytest.mark.parametrize("told", [False, True])
def test_gyros_are_steered_with_their_mean_momentum(told):
    part = Gyros(momentum=Uniform([1.0, 3.0]), inertia=0.1, gain=2.0, pyramid=0.9, told=told)
    mean = replace(part, momentum=2.0, told=False).of_run(group_named("SO3"), None)
    flown = part.of_run(group_named("SO3"), np.random.default_rng(4))
    h, command, x = flown.momentum, np.array([0.2, -0.1, 0.3]), np.linspace(0.1, 0.4, 8)
    known = replace(part, momentum=float(h[0])).of_run(group_named("SO3"), None) if told else mean
    rates = known._steered(command, x)[0]
    np.testing.assert_allclose(flown._steered(command, x)[0], rates, rtol=1e-13)
    _, _, A = flown._turned(x)
    np.testing.assert_allclose(A, h[0] / 2.0 * mean._turned(x)[2], rtol=1e-13)
