"""Rotors: thrusts by the square of a speed that lags, and their drag."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from eqt_cli.components.forces import Drag, Restoring
from eqt_cli.components.groups import group_named
from eqt_cli.components.thrusters import Thruster, Thrusters
from eqt_cli.config import shipped
from eqt_cli.loop.linearised import flow
from eqt_cli.results.result import open_result

SE3 = group_named("SE3")
J, MASS = np.array([3.65e-3, 3.68e-3, 7.03e-3]), 0.5
THRUST, MOMENT, LAG, FASTEST = 5.57e-6, 1.36e-7, 0.05, 1500.0
AT = 0.17 / np.sqrt(2) * np.array([[1, 1, 0.1], [1, -1, 0.1], [-1, -1, 0.1], [-1, 1, 0.1]])
TURNS = [1.0, -1.0, 1.0, -1.0]
ROTORS = Thrusters(
    thrusters=[Thruster(AT[k].tolist(), [0.0, 0.0, 1.0], TURNS[k]) for k in range(4)],
    thrust_constant=THRUST,
    moment_constant=MOMENT,
    low_speed=0.0,
    high_speed=FASTEST,
    time_constant=LAG,
)


def by_hand(R, v, omega, speeds, drag, wind):
    """ẇ and v̇ in space, rotor by rotor: T = k_η η² e_z, H = −η D U at its hub, M = ±k_m η² e_z."""
    force, torque = np.zeros(3), np.zeros(3)
    for at, turns, speed in zip(AT, TURNS, speeds, strict=True):
        slip = R.T @ (v - wind) + np.cross(omega, at)
        push = np.array([0, 0, THRUST * speed**2]) - speed * drag * slip
        force += push
        torque += np.cross(at, push) + np.array([0, 0, turns * MOMENT * speed**2])
    omega_dot = (torque - np.cross(omega, J * omega)) / J
    return omega_dot, R @ force / MASS - np.array([0, 0, 9.81])


def by_rotorpy(R, v, omega, speeds, drag, wind):
    """ẇ and v̇ in space, by RotorPy."""
    reason = "RotorPy is not installed; make oracles installs it"
    program = pytest.importorskip("rotorpy.vehicles.multirotor", reason=reason)
    k_d, _, k_z = drag * np.ones(3)
    body = program.Multirotor(
        dict(zip(("Ixx", "Iyy", "Izz"), J, strict=True))
        | {"mass": MASS, "Ixy": 0.0, "Ixz": 0.0, "Iyz": 0.0}
        | {"num_rotors": 4, "rotor_pos": dict(enumerate(AT)), "rotor_directions": np.array(TURNS)}
        | {"rotor_speed_min": 0.0, "rotor_speed_max": FASTEST, "tau_m": LAG}
        | {"k_eta": THRUST, "k_m": MOMENT, "k_d": k_d, "k_z": k_z}
    )
    state = {"x": np.zeros(3), "v": v, "q": Rotation.from_matrix(R).as_quat(), "w": omega}
    state |= {"wind": wind, "rotor_speeds": speeds}
    found = body.statedot(state, {"cmd_motor_speeds": speeds}, 0.01)
    return found["wdot"], found["vdot"]


@pytest.mark.parametrize("plant", [by_hand, by_rotorpy])
@pytest.mark.parametrize("drag", [0.0, np.array([1.19e-4, 1.19e-4, 2.32e-4])], ids=["no drag", ""])
def test_the_plant_is_that_of_the_formulas_and_of_rotorpy_at_50_states(plant, drag):
    """Rotor drag is the force `drag` at the speeds of the rotors: Σ η BᵀDB, B = [−at^, I]."""
    random, rotors = np.random.default_rng(1), ROTORS.of_run(SE3, None)
    inertia = np.diag([*J, MASS, MASS, MASS])
    for _ in range(50):
        R = SE3.rotation(SE3.exp(random.normal(size=6)))
        v, omega, wind = random.normal(size=(3, 3)) * [[2.0], [3.0], [1.0]]
        speeds, asked = random.uniform(0.1, 0.95, (2, 4)) * FASTEST
        D = np.zeros((6, 6))
        for at, speed in zip(AT, speeds, strict=True):
            B = np.hstack([-np.cross(at, np.eye(3)).T, np.eye(3)])
            D += speed * B.T @ np.diag(drag * np.ones(3)) @ B
        Q, V = np.eye(4), np.concatenate([omega, R.T @ v])
        Q[:3, :3] = R
        command = rotors.matrix @ (THRUST * asked**2)
        force = rotors.output(SE3, command, speeds)
        for part in (Restoring(9.81 * MASS), Drag(linear=D.tolist(), current=wind.tolist())):
            force = force + part.of_run(SE3, None).in_body(SE3, 0.0, Q, V)
        V_dot = np.linalg.solve(inertia, force + SE3.ad_star(V, inertia @ V))
        found = V_dot[:3], R @ (V_dot[3:] + np.cross(omega, V[3:]))
        for one, other in zip(found, plant(R, v, omega, speeds, drag, wind), strict=True):
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-13 * 1e3)  # up to 1e3 rad/s²
        rate = rotors.state_rate(SE3, command, speeds)
        np.testing.assert_allclose(rate, (asked - speeds) / LAG, rtol=0, atol=1e-13 * FASTEST / LAG)


def test_a_speed_is_limited_and_starts_where_the_first_command_asks():
    rotors = ROTORS.of_run(SE3, None)
    command = rotors.matrix @ [1.0, 2.0, 20.0, 1.5]
    most = THRUST * FASTEST**2
    speeds = rotors.running(SE3, command)
    asked = np.clip(rotors.inverse @ command, 0.0, most)
    np.testing.assert_allclose(rotors.thrust(SE3, command, speeds), asked, rtol=1e-14)
    assert asked.max() == most and rotors.at_limit(SE3, command, speeds)
    np.testing.assert_allclose(rotors.state_rate(SE3, command, speeds), 0.0, atol=1e-9)


PLANAR = (
    "[{kind: thrusters, thrusters: [{at: [0.2, 0], along: [0, 1]}, {at: [-0.2, 0], along: [0, 1]}, "
    "{at: [0, 0.1], along: [1, 0]}], thrust_constant: 1.0e-6, low_speed: 1000 rpm, "
    "high_speed: 20000 rpm, time_constant: 30 ms%s}]"
)
LOOP = {
    "group": "SE2",
    "inertia": "[0.01, 0.5, 0.5]",
    "gains": "{kp: 1, kd: [0.1, 1, 1]}",
    "reference": "{kind: torque, torque: [0.01, 1, 4]}",
    "initial": "{pose: haar, velocity: normal}",
}


@pytest.mark.parametrize("control", [None, "{period: 10 ms, delay: 2}"])
def test_on_its_reference_a_loop_starts_with_the_rotors_running(experiment, control):
    """So that no rotor accelerates, and to first order each thrust lags by its time constant."""
    loop = experiment(**LOOP, actuators=PLANAR % "", control=control).loops["eqt"]
    there = np.eye(3)[None], np.zeros((1, 3))
    state = loop.initial_state(*there, *there)
    s = loop.tracking(0.0, state)
    acting, rates = loop.acting_and_rates(s)
    np.testing.assert_allclose(acting[0], s.tau_d, rtol=1e-13)
    assert max(np.abs(rate).max() for rate in rates.values()) < 1e-9
    matrix = flow(loop, np.zeros(1), *there)[0]  # of a sampled loop, under a held command
    lagging = np.sort(np.abs(np.linalg.eigvals(matrix) + 1 / 0.03))[:3]
    assert np.isfinite(matrix).all() and (control is None or lagging.max() < 1e-6)


@pytest.mark.slow("compiles a long law; test_benchmarks.py flies it beside a plain program")
def test_a_crazyflie_flies_by_both_engines_alike(invoke, tmp_path):
    short = "time.duration=0.02", "time.samples=3", "ensemble.runs=1", "solver.cross_check=0"
    found = []
    for engine in ("native", "solve_ivp"):
        overrides = [word for key in (*short, f"solver.engine={engine}") for word in ("--set", key)]
        invoke("run", shipped.folder() / "crazyflie.yaml", *overrides, "--out", tmp_path / engine)
        with open_result(tmp_path / engine) as result:
            found.append((result["pose"], result["thrust"], result["attitude_command_error"]))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-7)  # a hundred rtol
    away = found[0][2]  # of a body that starts askew
    assert (away > 0.01).all() and (away < 2).all()
    hover = 0.2943 / 4
    assert (np.abs(found[0][1] - hover) < 0.5 * hover).all()
