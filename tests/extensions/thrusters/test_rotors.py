"""Rotors: thrusts by the square of a speed that lags, and their drag."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import plain
import pytest
import yaml
from case_tables import from_yaml, refusal
from said import mentions
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from eqt_cli.components.vehicle_parts import Uniform
from eqt_cli.extend import Drag, EqtError, Restoring, group_named
from eqt_cli.extensions.thrusters.parts import Failure, Thruster
from eqt_cli.extensions.thrusters.thrusters import Thrusters
from eqt_cli.loop.linearised import flow

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


# Rotors with inertia, that fail, on a battery that sags -------------------------------------------

SPUN, FAILED, LEFT, SAG = 6e-5, 0.117, 0.4, "1 - 0.2*t"  # kg m², s
CHANGES = {"fails": {"rotor": 2, "at": "117 ms", "to": LEFT}, "sag": SAG}
WEAK = {"efficiency": [0.9, LEFT, 1.2, 1.0]}
OTHERS = pytest.mark.ci("repeats the program of a quick case from the start")
HEAVY = {"rotor_inertia": SPUN, "time_constant": LAG}
FORCE = [0.01, -0.02, 0.005, 0.1, 0.1, 4.9]


class Rotors(plain.Plain):
    """EqT on four rotors along z, as one would write them: speed by speed."""

    left, failed_from, sags = (1.0, LEFT, 1.0, 1.0), FAILED, True

    def __init__(self, lag=None, spun=0.0, fails=False, told=False):
        super().__init__("SE3", [*J, MASS, MASS, MASS], 0.2, 0.05, lambda t: np.array(FORCE))
        self.lag, self.spun, self.fails, self.told = lag, spun, fails, told
        self.rows = np.array(
            [
                [at[1], -at[0], turns * MOMENT / THRUST, 1]
                for at, turns in zip(AT, TURNS, strict=True)
            ]
        ).T

    def shares(self, t, failed):
        """What is left to each rotor."""
        left = np.array(self.left if failed else [1.0, 1.0, 1.0, 1.0])
        return (1 - 0.2 * t) ** self.sags * left if self.fails else np.ones(4)

    def thrusts(self, t, wanted, failed):
        share = self.shares(t, failed)
        asked = np.linalg.solve(self.rows * share if self.told else self.rows, wanted[[0, 1, 2, 5]])
        return share * np.clip(asked, 0.0, THRUST * FASTEST**2)

    def field(self, t, y, command, failed):
        Q, V, Qd, Pd, speeds = self.split(y)
        thrusts, rates = self.thrusts(t, command(t, y), failed), np.zeros(4)
        if self.lag:
            rates = (np.sqrt(thrusts / THRUST) - speeds) / self.lag
            thrusts = THRUST * speeds**2
        wrench = np.zeros(6)
        for at, turns, thrust, speed, rate in zip(AT, TURNS, thrusts, speeds, rates, strict=True):
            torque = np.cross(at, [0, 0, thrust])
            torque[2] += turns * MOMENT / THRUST * thrust
            axis = np.array([0, 0, -turns])  # it turns against the torque of its drag
            torque = torque - self.spun * (np.cross(V[:3], axis * speed) + axis * rate)
            wrench += [*torque, 0, 0, thrust]
        V_dot = np.linalg.solve(self.I, self.ad(V).T @ (self.I @ V) + wrench)
        Vd = np.linalg.solve(self.I, Pd)
        Pd_dot = self.ad(Vd).T @ Pd + self.torque(t)
        moving = (Q @ self.hat(V)).ravel(), V_dot, (Qd @ self.hat(Vd)).ravel(), Pd_dot, rates
        return np.concatenate(moving)

    def flown(self, y, times, period=None):
        """The states at the times, from leg to leg: the failure and the ticks end one."""
        asked, failed = self.law(0.0, *self.split(y)[:4]), self.failed_from <= 0
        speeds = np.sqrt(self.thrusts(0.0, asked, failed) / THRUST) if self.lag else np.zeros(4)
        y, states = np.concatenate([y[:-6], speeds]), []
        ticks = np.arange(0.0, times[-1], period or 10.0)
        ends = np.unique([*times, *ticks, FAILED])
        for start, end in pairwise(ends):
            states += [y] * (start in times)
            if start in ticks:
                held = self.law(start, *self.split(y)[:4])
            command = (lambda t, y, held=held: held) if period else self.now
            given = {"args": (command, start >= self.failed_from), **plain.TIGHT}
            y = solve_ivp(self.field, (start, end), y, **given).y[:, -1]
        return np.array([*states, y])

    def now(self, t, y):
        return self.law(t, *self.split(y)[:4])


def rotors_text(engine, control=None, **options):
    part = {
        "kind": "thrusters",
        "thrusters": [
            {"at": at, "along": [0, 0, 1], "turns": turns}
            for at, turns in zip(AT.tolist(), TURNS, strict=True)
        ],
        "thrust_constant": THRUST,
        "moment_constant": MOMENT,
        "low_speed": 0,
        "high_speed": FASTEST,
    }
    config = {
        "group": "SE3",
        "inertia": [*J.tolist(), MASS, MASS, MASS],
        "gains": {"kp": 0.2, "kd": 0.05},
        "reference": {"torque": FORCE},
        "controllers": ["eqt"],
        "actuators": [part | options],
        "initial": {
            "pose": {"kind": "exp_normal", "std": 0.0, "centre": [0.3, -0.2, 0.1, 0.1, 0.2, 0.3]},
            "velocity": {"kind": "fixed", "coordinates": [0.5, -0.3, 0.8, 0.1, 0.2, 0.0]},
        },
        "time": {"duration": 0.2, "samples": 3},
        "solver": {"engine": engine, "rtol": 1e-12, "atol": 1e-14},
    }
    return yaml.safe_dump(config | ({"control": control} if control else {}))


def test_each_run_draws_an_efficiency_that_only_a_told_allocation_knows():
    weak, command = replace(ROTORS, efficiency=[0.9, Uniform([0.7, 1.3]), 1.2, 0.0]), np.ones(6)
    parts = [weak.of_run(SE3, np.random.default_rng(seed)) for seed in (1, 2)]
    shares = np.array([part.share for part in parts])
    assert 0.7 < shares[0, 1] < 1.3 and shares[0, 1] != shares[1, 1]
    np.testing.assert_array_equal(shares[:, [0, 2, 3]], [[0.9, 1.2, 0.0]] * 2)
    healthy = ROTORS.of_run(SE3, None)
    asked = healthy.pushed(healthy.running(SE3, command))
    for part, share in zip(parts, shares, strict=True):
        np.testing.assert_allclose(part.pushed(part.running(SE3, command)), share * asked)
        told = replace(weak, told=True, efficiency=(0.5 * share + 0.5).tolist()).of_run(SE3, None)
        pushes = told.matrix @ (told.share[:, None] * told.inverse)
        np.testing.assert_allclose(pushes, healthy.matrix @ healthy.inverse, atol=1e-12)


@pytest.mark.parametrize(
    ("engine", "options", "control"),
    [
        ("solve_ivp", HEAVY | CHANGES, None),
        ("native", HEAVY | CHANGES, None),
        ("native", WEAK | {"efficiency_from": FAILED, "sag": SAG}, {"period": 0.05}),
        pytest.param("native", WEAK | HEAVY, None, marks=OTHERS),
        pytest.param("solve_ivp", WEAK | {"told": True}, {"period": 0.05}, marks=OTHERS),
        ("native", CHANGES | {"told": True}, {"period": 0.05}),
        ("solve_ivp", CHANGES, {"period": 0.05}),
    ],
    ids=[
        "inertia, solve_ivp",
        "inertia",
        "weak from a time",
        "weak",
        "told of weak ones",
        "told",
        "sampled, solve_ivp",
    ],
)
def test_rotors_that_fail_are_those_of_a_plain_program(solved, engine, options, control):
    problem, solution = solved(rotors_text(engine, control, **options))
    program = Rotors(options.get("time_constant"), options.get("rotor_inertia", 0.0), True)
    program.told, program.left = "told" in options, options.get("efficiency", program.left)
    if "efficiency" in options:
        program.failed_from, program.sags = options.get("efficiency_from", 0.0), "sag" in options
    start = program.start(
        plain.exp("SE3", np.array([0.3, -0.2, 0.1, 0.1, 0.2, 0.3])),
        np.array([0.5, -0.3, 0.8, 0.1, 0.2, 0.0]),
        np.eye(4),
        np.zeros(6),
    )
    states = program.flown(start, problem.times, control and control["period"])
    s = problem.loop.tracking(problem.times, solution.states)
    np.testing.assert_allclose(s.Q[0].reshape(3, 16), states[:, :16], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.V[0], states[:, 16:22], rtol=0, atol=1e-9)
    if "time_constant" in options:
        speeds = s.vehicle["actuators_0"][0]
        np.testing.assert_allclose(speeds, states[:, -4:], rtol=0, atol=1e-9 * FASTEST)
        assert np.abs(SPUN * speeds).max() > 0.01  # N m s: as much as the body at 3 rad/s


@pytest.mark.parametrize("told", [False, True])
def test_at_an_instant_wrench_and_rates_are_those_of_the_plain_program(experiment_of, told):
    random, options = np.random.default_rng(2), HEAVY | CHANGES | {"told": told}
    (loop,) = experiment_of(rotors_text("native", **options)).loops.values()
    program = Rotors(LAG, SPUN, True, told)
    for t in (0.0, 0.1, FAILED, 0.15):
        Q, Qd = SE3.exp(0.3 * random.normal(size=(2, 6)))
        V, Vd = random.normal(size=(2, 6))
        speeds = random.uniform(0.1, 0.9, 4) * FASTEST
        y = np.concatenate([program.start(Q, V, Qd, Vd)[:-6], speeds])
        expected = program.field(t, y, program.now, t >= FAILED)
        state = loop.initial_state(Q[None], V[None], Qd[None], Vd[None])
        state[:, loop.layout.slices["vehicle.actuators_0"]] = speeds
        s = loop.tracking(t, state)
        acting, rates = loop.acting_and_rates(s)
        V_dot = np.linalg.solve(program.I, program.ad(V).T @ (program.I @ V) + acting[0])
        np.testing.assert_allclose(V_dot, expected[16:22], rtol=1e-12, atol=1e-12)
        found = rates["actuators_0"][0]
        np.testing.assert_allclose(found, expected[-4:], rtol=1e-12, atol=1e-12 * FASTEST / LAG)


SIX = [
    {"at": [np.cos(a), np.sin(a), 0.0], "along": [0, 0, 1], "turns": (-1) ** k * 0.1}
    for k, a in enumerate(np.pi / 3 * np.arange(6).astype(float))
]


def six(**options):
    rotors = Thrusters(thrusters=[Thruster(**each) for each in SIX], low=0.0, high=9.0, **options)
    return rotors.of_run(SE3, None)


def test_an_allocation_that_is_told_gives_the_command_without_the_rotor_that_failed():
    fails, command = Failure("thruster 5", 1.0), np.array([0.3, -0.2, 0.02, 0.0, 0.0, 12.0])
    for told, t in ((True, 0.5), (True, 1.0), (False, 0.5), (False, 1.0)):
        rotors = six(fails=fails, sag="1 - 0.1*t", told=told).at(SimpleNamespace(t=t))
        thrusts = rotors.thrust(SE3, command, np.empty(0))
        found = rotors.output(SE3, command, np.empty(0))
        assert (thrusts[4] == 0.0) == (t == 1.0)
        if told:
            np.testing.assert_allclose(found, command, atol=1e-13)
        else:
            healthy = six().thrust(SE3, command, np.empty(0)) * (1 - 0.1 * t)
            healthy[4] *= t < 1.0
            np.testing.assert_allclose(thrusts, healthy, rtol=1e-14)


def test_times_of_failures_and_of_sags_are_instants():
    rotors = six(fails=Failure(1, 1.5), sag="1 - 0.1*step(t, 0.7)")
    times = [*rotors.instants(SE3, 2.0), *rotors.presence.instants(SE3, 2.0)]
    assert times == [0.7, 1.5]
    assert six().at(SimpleNamespace(t=1.0)).share is None


def test_a_regulator_does_not_know_what_fails(experiment_of):
    def gain(**options):
        text = rotors_text("native", **HEAVY, **options, high_speed=1e5)
        config = yaml.safe_load(text) | {"controllers": ["lqr"], "reference": {"kind": "constant"}}
        config["model"] = {"forces": [{"kind": "restoring", "weight": 9.81 * MASS}]}
        (loop,) = experiment_of(yaml.safe_dump(config)).loops.values()
        return loop.controller.regulator.gain

    np.testing.assert_array_equal(gain(), gain(fails={"rotor": 1, "at": 0.1}, sag="1 - t"))


@from_yaml
def test_what_no_rotor_does_is_refused(experiment_of, options, said):
    text = rotors_text("native", {"period": 0.01}, **yaml.safe_load(options))
    assert mentions(refusal(EqtError, experiment_of, text), "actuators[0]." + said)


def test_rotors_without_a_side_have_no_known_spin(experiment_of):
    config = yaml.safe_load(rotors_text("native", **HEAVY))
    config["actuators"][0]["thrusters"][1]["turns"] = 0
    assert (
        "rotor_inertia: needs thrusters with places and turns, thrust_constant and time_constant"
    ) in refusal(EqtError, experiment_of, yaml.safe_dump(config))
