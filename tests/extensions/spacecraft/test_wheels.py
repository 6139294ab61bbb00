"""Reaction wheels against a plain program, against Basilisk, and by conservation."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from case_tables import from_yaml
from plain import hat
from plain_satellite import exp, pyramid
from said import mentions
from scipy.integrate import solve_ivp
from scipy.optimize import linprog

from eqt_cli.base.errors import ConfigError, Problems
from eqt_cli.components.blocks import signals
from eqt_cli.components.vehicle_parts import Uniform
from eqt_cli.config.remarks import along_reference, limits_below_reference, wheels_needed
from eqt_cli.extend import group_named
from eqt_cli.extensions.spacecraft.wheels import Bias, Friction, Wheels

INERTIA = np.array([[0.03, 0.001, 0.0], [0.001, 0.025, 0.0], [0.0, 0.0, 0.01]])
SPIN = 2e-5
WHEELS = (
    "{kind: wheels, pyramid: 54.7 deg, limit: 2 mN m, speed: 600, inertia: 2.0e-5, friction: "
    "{viscous: 5.0e-9, coulomb: 2.0e-6}, start: [4 mN m s, -3 mN m s, 4 mN m s, 1 mN m s]}"
)
TEXT = f"""
group: SO3
inertia: {INERTIA.tolist()}
gains: {{kp: 0.004, kd: 0.01}}
reference: {{kind: torque, torque: [0, 0, 0]}}
controllers: [lee2010]
actuators: [{WHEELS}]
control: {{period: 0.1}}
initial:
  pose: {{kind: exp_normal, std: 0.0, centre: [0.9, -0.5, 0.7]}}
  velocity: {{kind: fixed, coordinates: [0.05, -0.04, 0.1]}}
time: {{duration: 6.0, samples: 61}}
solver: {{engine: native, rtol: 1.0e-12, atol: 1.0e-15}}
"""


def states_of(solved, text):
    problem, solution = solved(text, label="lee2010")
    assert not any(solution.messages)
    s = problem.loop.tracking(problem.times, solution.states)
    found = signals(problem.loop.now(s))
    h, speed = found["wheel_momentum"], found["wheel_speed"]
    return s, h[0], speed[0]


def test_states_are_those_of_a_plain_program(solved):
    """Limits of torque and speed, friction: RK45 by SciPy at 1e-12 from tick to tick."""
    s, h, speed = states_of(solved, TEXT)
    A, h_most, T = pyramid(), 600 * SPIN, 0.1
    y = np.concatenate([s.Q[0, 0].ravel(), s.V[0, 0], [4e-3, -3e-3, 4e-3, 1e-3]])
    found, at_limit = [y], []
    for _ in range(60):
        Q, w, momentum = y[:9].reshape(3, 3), y[9:12], y[12:]
        error = 0.004 * np.array([(Q - Q.T)[2, 1], (Q - Q.T)[0, 2], (Q - Q.T)[1, 0]])
        command = -error - 0.01 * w + np.cross(w, INERTIA @ w)
        u = np.clip(np.linalg.pinv(A) @ command, -2e-3, 2e-3)
        u = np.clip(u, (momentum - h_most) / T, (momentum + h_most) / T)
        at_limit.append(np.abs(u).max() > 1.99e-3)

        def rate(t, y, u=u):
            Q, w, momentum = y[:9].reshape(3, 3), y[9:12], y[12:]
            relative = momentum / SPIN - A.T @ w
            pull = u + 5e-9 * relative + 2e-6 * np.tanh(relative)
            turn = np.cross(INERTIA @ w + A @ momentum, w) + A @ pull
            return np.concatenate([(Q @ hat(w)).ravel(), np.linalg.solve(INERTIA, turn), -pull])

        y = solve_ivp(rate, (0, T), y, method="DOP853", rtol=1e-12, atol=1e-15).y[:, -1]
        found.append(y)
    found = np.array(found)
    assert any(at_limit)
    np.testing.assert_allclose(s.Q[0].reshape(-1, 9), found[:, :9], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.V[0], found[:, 9:12], rtol=0, atol=1e-9)
    np.testing.assert_allclose(h, found[:, 12:], rtol=0, atol=1e-12)
    np.testing.assert_allclose(speed, found[:, 12:] / SPIN - found[:, 9:12] @ A, atol=1e-6)


@pytest.mark.parametrize(
    ("engine", "sampled"),
    [
        ("native", False),
        ("solve_ivp", True),
        pytest.param("native", True, marks=pytest.mark.ci("the same by the other engine")),
        pytest.param("solve_ivp", False, marks=pytest.mark.ci("the same by the other engine")),
    ],
)
def test_the_total_momentum_is_constant(solved, engine, sampled):
    text = TEXT.replace("engine: native", f"engine: {engine}")
    if not sampled:
        text = text.replace("control: {period: 0.1}\n", "").replace("speed: 600, ", "")
    s, h, _ = states_of(solved, text)
    total = np.einsum("tij,tj->ti", s.Q[0], s.V[0] @ INERTIA + h @ pyramid().T)
    assert np.abs(total - total[0]).max() < 1e-12
    assert np.abs(h - h[0]).max() > 1e-3


DRIVE = {"command": "speed", "gain": 2e-4, "ki": 1e-3}


@pytest.mark.parametrize("drive", [{}, DRIVE], ids=["torque", "speed"])
def test_friction_by_stribeck_breaks_away_at_its_largest_torque(drive):
    """c Ω + T_c tanh(10 x) + (T_s − T_c) x e^((1 − x²)/2), x = Ω/Ω_b: T_s + c Ω_b at x = 1."""
    G, x, (c, Tc, Ts, Wb) = group_named("SO3"), np.array([1, -0.3, 0.1, 5]), (5e-9, 2e-5, 4e-5, 20)
    friction = Friction(viscous=c, coulomb=Tc, static=Ts, breakaway=Wb)
    part = Wheels(pyramid=0.9, limit=1.0, inertia=SPIN, friction=friction, **drive).of_run(G, None)
    state = np.concatenate([np.zeros(part.states(G) - 4), SPIN * Wb * x])
    _, rates = part.reaction(G, np.zeros(3), state)
    curve = c * Wb * x + Tc * np.tanh(10 * x) + (Ts - Tc) * x * np.exp((1 - x * x) / 2)
    # A drive whose integral holds a speed has the torque of its motor and its error as states.
    of_drive = [*curve, 0.0, 0.0, 0.0, 0.0] if drive else []
    np.testing.assert_allclose(rates, [*of_drive, *-curve], rtol=1e-13)
    assert -rates[-4] == pytest.approx(Ts + c * Wb, rel=1e-8)


DRIVEN = (
    "{kind: wheels, pyramid: 54.7 deg, limit: 2 mN m, inertia: 2.0e-5, command: speed, gain: 2.0e-4"
    ", ki: 1.0e-3, friction: {viscous: 5.0e-9, coulomb: 2.0e-5, static: 4.0e-5, breakaway: 20.0}, "
    "start: [-0.4 mN m s, 0.3 mN m s, -0.4 mN m s, -0.1 mN m s]}"
)


def driven(held, speed_limit=None):
    """States Q, V, h and Ω of wheels by speed, at every 0.1 s, by SciPy's DOP853 at 1e-12."""
    A, start = pyramid(), np.array([-0.4e-3, 0.3e-3, -0.4e-3, -0.1e-3])

    def wanted(Q, w, speeds):
        error = 0.004 * np.array([(Q - Q.T)[2, 1], (Q - Q.T)[0, 2], (Q - Q.T)[1, 0]])
        command = -error - 0.01 * w + np.cross(w, INERTIA @ w)
        u = np.clip(np.linalg.pinv(A) @ command, -2e-3, 2e-3)
        if speed_limit is None:
            return u
        ends = [SPIN * (speeds + sign * speed_limit) / 0.1 for sign in (-1, 1)]
        return np.clip(u, *ends)

    def rate(t, y, u=None):
        Q, w, h, told, z = y[:9].reshape(3, 3), y[9:12], y[12:16], y[16:20], y[20:]
        speed = h / SPIN - A.T @ w
        u = wanted(Q, w, told) if u is None else u
        motor = np.clip(2e-4 * (told - speed) + z, -2e-3, 2e-3)
        drag = 5e-9 * speed + 2e-5 * np.tanh(speed / 2)
        drag += np.sqrt(2 * np.e) * 2e-5 * np.exp(-((speed / 20) ** 2) / 2) * speed / (20 * 2**0.5)
        turn = np.cross(INERTIA @ w + A @ h, w) + A @ (drag - motor)
        slopes = [np.linalg.solve(INERTIA, turn), motor - drag, -u / SPIN, 1e-3 * (told - speed)]
        return np.concatenate([(Q @ hat(w)).ravel(), *slopes])

    Q, w = exp([0.9, -0.5, 0.7]), np.array([0.05, -0.04, 0.1])
    y = np.concatenate([Q.ravel(), w, start, start / SPIN - A.T @ w, np.zeros(4)])
    found, options = [y], {"method": "DOP853", "rtol": 1e-12, "atol": 1e-15}
    for _ in range(60):
        u = (wanted(y[:9].reshape(3, 3), y[9:12], y[16:20]),) if held else ()
        y = solve_ivp(rate, (0, 0.1), y, args=u, **options).y[:, -1]
        found.append(y)
    return np.array(found)


SLOW = pytest.mark.ci("the same by the other engine")


@pytest.mark.parametrize(
    ("engine", "held"),
    [
        ("native", True),
        ("solve_ivp", False),
        pytest.param("native", False, marks=SLOW),
        pytest.param("solve_ivp", True, marks=SLOW),
    ],
)
def test_wheels_by_speed_are_those_of_a_plain_program(solved, engine, held):
    """With an integral, Stribeck's curve, limits of the torque and of the speed that is told."""
    text = TEXT.replace(WHEELS, DRIVEN).replace("engine: native", f"engine: {engine}")
    if held:
        text = text.replace("limit: 2 mN m", "limit: 2 mN m, speed: 60")
    else:
        text = text.replace("control: {period: 0.1}\n", "")
    s, h, speed = states_of(solved, text)
    found = driven(held, 60.0 if held else None)
    assert (speed[1:] * speed[:-1] < 0).any()  # a wheel goes through 0
    if held:
        assert np.isclose(np.abs(found[:, 16:20]), 60, rtol=1e-12).any()  # at the limit
    np.testing.assert_allclose(s.Q[0].reshape(-1, 9), found[:, :9], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.V[0], found[:, 9:12], rtol=0, atol=1e-9)
    np.testing.assert_allclose(h, found[:, 12:16], rtol=0, atol=1e-11)


def test_margins_know_the_drives(experiment_of):
    """About rest, with the gyroscopic torque of the start and without limits and friction."""
    from eqt_cli.loop.linearised import linearised

    text = TEXT.replace(WHEELS, DRIVEN).replace("control: {period: 0.1}\n", "")
    experiment = experiment_of(text)
    [loop] = experiment.loops.values()
    found = linearised(loop, *along_reference(experiment, experiment.reference_over_horizon()))
    A, H = pyramid(), pyramid() @ [-0.4e-3, 0.3e-3, -0.4e-3, -0.1e-3]
    e = np.hstack([np.zeros((4, 3)), A.T, np.eye(4) / SPIN, np.zeros((4, 4))])
    motor = -2e-4 * e - np.eye(4, 14, 10)  # on the body
    command = np.hstack([-0.008 * np.eye(3), -0.01 * np.eye(3), np.zeros((3, 8))])
    turn = np.linalg.solve(INERTIA, A @ motor + hat(H) @ np.eye(3, 14, 3))
    ahead = motor - np.linalg.pinv(A) @ command
    hand = np.vstack([np.eye(3, 14, 3), turn, ahead, 1e-3 * e])
    np.testing.assert_allclose(found.closed[0], hand, rtol=1e-6, atol=1e-8)


def test_a_drive_that_lags_cuts_no_command():
    options = {"pyramid": 0.9, "limit": 1.0, "inertia": 1.0, "command": "speed", "gain": 2.0}
    wheels, G = Wheels(**options).of_run(group_named("SO3"), None), group_named("SO3")
    x, command = np.random.default_rng(1).random(wheels.states(G)), np.array([0.1, -0.2, 0.3])
    np.testing.assert_allclose(wheels.within(G, command, x), command, rtol=0, atol=1e-14)
    assert np.abs(wheels.output(G, command, x) - command).max() > 0.1


def test_min_max_is_the_least_largest_torque():
    """Against the linear programme: least t with A u = τ and |u_i| ≤ t, for five wheels."""
    random = np.random.default_rng(1)
    axes = random.standard_normal((5, 3)).tolist()
    wheels = Wheels(axes=axes, allocation="min_max").of_run(group_named("SO3"), None)
    for command in random.standard_normal((20, 3)):
        u = wheels.allocated(command)
        A, one = wheels.matrix, np.ones((5, 1))
        found = linprog(
            [0] * 5 + [1],
            A_ub=np.block([[np.eye(5), -one], [-np.eye(5), -one]]),
            b_ub=np.zeros(10),
            A_eq=np.hstack([A, np.zeros((3, 1))]),
            b_eq=command,
            bounds=[(None, None)] * 6,
        )
        np.testing.assert_allclose(A @ u, command, atol=1e-12)
        assert np.abs(u).max() == pytest.approx(found.x[-1], rel=1e-7)


def test_a_bias_moves_the_wheels_and_not_the_body():
    G, target = group_named("SO3"), [5e-3, -5e-3, 5e-3, -5e-3]
    wheels = Wheels(pyramid=np.radians(54.7), bias=Bias(target, 20.0)).of_run(G, None)
    h = np.array([1e-3, 2e-3, 0.0, -1e-3])
    command = np.array([1e-3, 0.0, -2e-3])
    np.testing.assert_allclose(wheels.output(G, command, h), command, atol=1e-15)
    rate, null = wheels.state_rate(G, command, h), np.array([1, -1, 1, -1]) / 2
    # Along the null vector, ḣ = (b − h)/T.
    assert null @ rate == pytest.approx(null @ (np.array(target) - h) / 20, rel=1e-12)


@from_yaml
def test_what_does_not_fit_is_said(options, message):
    parts = {"friction": Friction, "bias": Bias}
    made = {name: parts[name](**options[name]) for name in parts.keys() & options.keys()}
    problems = Problems()
    Wheels(**options | made).check(group_named("SO3"), problems)
    assert [mentions(problem.message, message) for problem in problems] == [True]


def test_wheels_may_spin_either_way_at_the_start(noted):
    fitting = Wheels(pyramid=0.9, start=-1.0, limit=1.0, speed=2.0, inertia=1.0)
    assert noted(fitting, group_named("SO3")) == []


def test_a_torque_or_a_momentum_is_at_its_limit():
    G, limits = group_named("SO3"), {"limit": [1.0, 2.0, 3.0], "momentum": 1.0}
    wheels = Wheels(axes=np.eye(3).tolist(), **limits).of_run(G, None)
    torques = np.array([[0.9, 1.9, -2.9], [1.0, 0, 0], [0, -2.5, 0], [0, 0, 0], [0, 0, 0]])
    h = np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, -1.0, 0], [0.9, -0.9, 0.9]])
    found = wheels.at_limit(G, torques, np.concatenate([0 * h, h], axis=1))
    assert found.tolist() == [False, True, True, True, False]


def test_nothing_acts_behind_wheels(experiment_of):
    with pytest.raises(ConfigError, match="the torque of wheels is final; put it before"):
        experiment_of(TEXT.replace(f"[{WHEELS}]", f"[{WHEELS}, {{kind: limit, limit: 1}}]"))


def test_what_wheels_need_is_as_by_hand(experiment_of):
    """At rest, a torque of 1 µN m about x for 120 s, and the slew of the CubeSat.

    The slew is a polynomial of fifth degree: its largest rate is 15/8 θ/T, its largest acceleration
    10/√3 θ/T². Torques of the orbit change a wheel by less than 0.02 mN m s.
    """
    share = 1 / (2 * np.sqrt(2) * np.sin(np.radians(54.7)))
    text = TEXT.replace("duration: 6.0", "duration: 120.0")
    text += "plant: {forces: [{kind: constant, force: [1.0e-6, 0, 0]}]}\n"
    text = text.replace(", start: [4 mN m s, -3 mN m s, 4 mN m s, 1 mN m s]", "")
    experiment = experiment_of(text)
    found = wheels_needed(experiment, experiment.reference_over_horizon())
    np.testing.assert_allclose(np.abs(found.momentum[-1]), 1.2e-4 * share, rtol=1e-9)
    np.testing.assert_allclose(np.abs(found.torque), 1e-6 * share, rtol=1e-9)
    assert not found.are_too_much
    cubesat = (Path(__file__).parents[3] / "configs" / "cubesat.yaml").read_text(encoding="utf-8")
    experiment = experiment_of(cubesat)
    found = wheels_needed(experiment, experiment.reference_over_horizon())
    rate, acceleration = 1.875 * np.pi / 3 / 60, 10 / np.sqrt(3) * np.pi / 3 / 3600
    most = np.abs(found.momentum).max()
    assert most == pytest.approx(4e-3 + 0.042 * rate * share, abs=2e-5)
    assert np.abs(found.torque).max() == pytest.approx(0.042 * acceleration * share, rel=0.05)
    weak = experiment_of(cubesat.replace("momentum: 15 mN m s", "momentum: 4.5 mN m s"))
    [(place, said)] = limits_below_reference(weak)
    assert place == ("actuators",)
    assert said.startswith("the reference, with the forces of the plant, needs 4.6 of 4.5")


@pytest.mark.parametrize(
    ("axes", "lost", "arrives"),
    [
        (pyramid().T[[0, 2]], "ωx − ωy", ["ωx 50 %", "ωy 50 %"]),
        (pyramid().T[[0, 1]], "ωy − 0.999 ωz", ["ωy 50 %", "ωz 50 %"]),
        (np.eye(3)[:2], "ωz", []),
    ],
)
def test_two_wheels_of_four_are_flown_with_a_remark(axes, lost, arrives):
    """The direction is normal to both axes."""
    wheels, G = Wheels(axes=axes.tolist()), group_named("SO3")
    problems = Problems()
    wheels.check(G, problems)
    assert not problems
    [said] = wheels.remarks(G, np.eye(3))
    lines = said.split("; ")
    assert lines[:2] == [
        f"with rank 2 of 3 cannot push along {lost}",
        "what a law asks for there is lost",
    ]
    assert [
        word for line in lines[2:] for word in line.partition("arrives ")[2].split(", ")
    ] == arrives
    assert list(wheels.of_run(G, None).remarks(G, np.eye(3))) == [said]
    normal, part = np.cross(*axes), wheels.of_run(G, None)
    np.testing.assert_allclose(part.output(G, normal, np.zeros(2)), 0, atol=1e-12)
    across = np.cross(normal, axes[0])
    np.testing.assert_allclose(part.output(G, across, np.zeros(2)), across, atol=1e-12)


def test_a_direction_of_wheels_that_almost_agree_is_given_up_and_named():
    """Two of three axes 0.004 rad apart: 1 N m across them takes 250 N m of each, or none."""
    G, across = group_named("SO3"), np.array([0.0, 1.0, -1.0])
    wheels = Wheels(axes=[[1, 0, 0], [0, 1.004, 1], [0, 1, 1.004]])
    assert list(wheels.remarks(G, np.eye(3))) == [
        "push along ωy − ωz with less than 0.05 of their strength elsewhere (the rows of B divided "
        "by their norms), which is given up: what a law asks for there is lost; of what it asks "
        "along one axis alone arrives ωy 50 %, ωz 50 %; add wheels, or set a smaller least"
    ]
    part, free = (replace(wheels, least=least).of_run(G, None) for least in (0.05, 1e-3))
    assert np.abs(part.allocated(across)).max() < 0.01 and not list(free.remarks(G, np.eye(3)))
    assert np.abs(free.allocated(across)).max() > 200
    for command in np.array([[1.0, 0, 0], [0, 1.0, 1.0]]):
        found = part.output(G, command, np.zeros(3))
        np.testing.assert_allclose(found, command, rtol=0, atol=0.005)
    np.testing.assert_allclose(free.output(G, across, np.zeros(3)), across, rtol=0, atol=1e-10)


@pytest.mark.parametrize("told", [False, True])
def test_speeds_of_wheels_are_computed_with_their_mean_inertia(told):
    """J_w Ω̇_c = −u with the mean J_w, so that the state J_w Ω_c − h changes by the own one."""
    drives = {"inertia": Uniform([1e-4, 3e-4]), "gain": 1e-3, "command": "speed"}
    part = Wheels(axes=np.eye(3).tolist(), told=told, **drives)
    flown = part.of_run(group_named("SO3"), np.random.default_rng(4))
    J, u = flown.inertia, np.array([1e-3, -2e-3, 5e-4])
    rates = flown.state_rate(group_named("SO3"), u, np.zeros(9))
    np.testing.assert_allclose(rates[:3], -J * u / (J if told else 2e-4), rtol=1e-13)
