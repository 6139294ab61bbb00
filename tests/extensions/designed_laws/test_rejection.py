"""INDI, the momentum observer and the accelerometer against plain programs."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from case_tables import from_yaml, in_ci, refusal
from plain import hat
from said import mentions
from scipy.linalg import block_diag, expm
from scipy.signal import butter

from eqt_cli.base.errors import ConfigError
from eqt_cli.components.laws import outputs
from eqt_cli.extend import Controller

T, LAG, CUTOFF, RATE = 0.002, 0.05, 20.0, 88.9
SUBSTEPS = 8  # of 0.25 ms; halving them changes V by less than 1e-11
J, MASS, G = np.diag([0.04, 0.05, 0.08]), 1.3, 9.81
V_D = np.array([0.3, -0.5, 0.9, 0.2, 0.1, -0.3])
DELTA = np.array([0.1, -0.2, 0.15, 0.8, -0.5, 0.6])
ARM, BIAS, SENSOR_LAG = np.array([0.1, -0.05, 0.02]), np.array([0.1, 0.2, -0.3]), 0.01

ATTITUDE = {
    "group": "SO3",
    "inertia": np.diag(J).tolist(),
    "gains": {"k_R": 4.0, "k_Omega": 0.8},
    "reference": {"kind": "constant", "velocity": V_D[:3].tolist()},
    "controllers": [
        {"kind": "indi", "law": "lee2010", "cutoff": CUTOFF},
        {"kind": "observer", "law": "lee2010", "rate": RATE},
    ],
    "plant": {
        "inertia": {"relative": 0.5},
        "forces": [{"kind": "constant", "force": DELTA[:3].tolist()}],
    },
    "actuators": [{"kind": "lag", "time_constant": LAG}],
    "control": {"period": T},
    "initial": {
        "pose": {"kind": "exp_normal", "std": 0.0, "centre": [0.4, -0.3, 0.5]},
        "velocity": {"kind": "fixed", "coordinates": [0.5, 0.2, -0.4]},
    },
    "ensemble": {"runs": 1},
    "time": {"duration": 0.12, "samples": 4},
    "solver": {"engine": "native", "rtol": 1e-12, "atol": 1e-13},
}
BODY = {
    "group": "SE3",
    "inertia": [*np.diag(J).tolist(), MASS, MASS, MASS],
    "gains": {"kp": 2.0, "kd": [0.8, 0.8, 0.8, 3.0, 3.0, 3.0]},
    "reference": {"kind": "constant", "velocity": V_D.tolist()},
    "model": {"forces": [{"kind": "restoring", "weight": MASS * G}]},
    "plant": {
        "forces": [
            {"kind": "restoring", "weight": MASS * G},
            {"kind": "constant", "force": DELTA.tolist()},
        ],
        "inertia": [*(1.5 * np.diag(J)).tolist(), *[1.5 * MASS] * 3],
    },
    "initial": {
        "pose": {"kind": "exp_normal", "std": 0.0, "centre": [0.4, -0.3, 0.5, 0.2, 0.1, -0.2]},
        "velocity": {"kind": "fixed", "coordinates": [0.5, 0.2, -0.4, 0.3, 0.0, 0.1]},
    },
}
MOUNTED = [
    {"kind": "lever", "at": ARM.tolist()},
    {"kind": "lag", "time_constant": SENSOR_LAG},
    {"kind": "bias", "value": BIAS.tolist()},
]


def vee(A):
    return np.array([A[2, 1] - A[1, 2], A[0, 2] - A[2, 0], A[1, 0] - A[0, 1]]) / 2


class Filter:
    """A Butterworth filter of SciPy in direct form, settled on its first input."""

    def __init__(self):
        self.b, self.a = butter(2, CUTOFF, fs=1 / T)
        self.x = self.y = None

    def __call__(self, x):
        if self.x is None:
            self.x = self.y = [x, x]
        y = self.b @ [x, *self.x] - self.a[1:] @ self.y
        self.x, self.y = [x, self.x[0]], [y, self.y[0]]
        return y


def flown(s, law, linear="differences", mounted=False, limit=np.inf, turns_only=False):
    """Q and V over 0.12 s: RK4 between instants, the laws as they are published."""
    kp, kd = (2.0, [0.8] * 3) if turns_only else (2.0, [0.8] * 3 + [3.0] * 3)
    n = 3 if turns_only else 6
    inertia = block_diag(J, MASS * np.eye(3))
    true, H = 1.5 * inertia, Filter()
    R, p = s.Q[0, 0][:3, :3], (np.zeros(3) if turns_only else s.Q[0, 0][:3, 3])
    V = np.concatenate([s.V[0, 0], np.zeros(6 - n)])
    weight = 0.0 if turns_only else MASS * G
    delta, V_d = (np.concatenate([x[:n], np.zeros(6 - n)]) for x in (DELTA, V_D))

    def coadjoint(V, P):
        return np.concatenate(
            [np.cross(P[:3], V[:3]) + np.cross(P[3:], V[3:]), np.cross(P[3:], V[:3])]
        )

    def rates(y, command):
        R, V, x = y[:9].reshape(3, 3), y[12:18], y[18:24]
        force = x + delta + np.concatenate([np.zeros(3), -weight * R[2]])
        V_dot = np.linalg.solve(true, coadjoint(V, true @ V) + force)
        f = V_dot[3:] + np.cross(V[:3], V[3:]) + weight / (1.5 * MASS) * R[2]
        if mounted:
            f = f + np.cross(V_dot[:3], ARM) + np.cross(V[:3], np.cross(V[:3], ARM))
        moves = [(R @ hat(V[:3])).ravel(), R @ V[3:], V_dot, (command - x) / LAG]
        return np.concatenate([*moves, (f - y[24:]) / SENSOR_LAG]), f

    y = np.concatenate([R.ravel(), p, V, np.zeros(6), np.zeros(3)])
    y[24:] = rates(y, np.zeros(6))[1]
    u_hat, last, P_hat, found = np.zeros(6), V, inertia @ V, []
    for k in range(60):
        R, p, V = y[:9].reshape(3, 3), y[9:12], y[12:18]
        pose = np.zeros((4, 4))
        pose[:3, :3], pose[:3, 3] = hat(V_d[:3]), V_d[3:]
        pose = expm(k * T * pose)
        R_L, p_L = pose[:3, :3].T @ R, pose[:3, :3].T @ (p - pose[:3, 3])
        xi = np.concatenate([R_L.T @ V_d[:3], R_L.T @ (V_d[3:] + np.cross(V_d[:3], p_L))])
        rate = np.concatenate(
            [np.cross(V[:3], xi[:3]), np.cross(V[:3], xi[3:]) + np.cross(V[3:], xi[:3])]
        )
        force = kp * np.concatenate([2 * vee(R_L), R_L.T @ p_L])
        damping = np.array([*kd, *[0.0] * (6 - n)]) * (V - xi)
        nu = -inertia @ rate - damping - force  # 𝕀ν
        if law == "observer":
            delta_hat = RATE * (inertia @ V - P_hat)
            u = nu - coadjoint(V, inertia @ V) - delta_hat
        elif linear == "differences":
            u = nu + H(u_hat - inertia @ (V - last) / T)
        else:
            measured = y[24:] + BIAS if mounted else rates(y, np.zeros(6))[1]
            felt = np.concatenate([J @ (V - last)[:3] / T, MASS * measured])
            u = nu + H(u_hat - felt)
            u[3:] += MASS * np.cross(V[:3], V[3:]) + weight * R[2]
        known = np.concatenate([np.zeros(3), -weight * R[2]]) if law == "observer" else 0.0
        command = np.clip(u - known, -limit, limit)
        u_hat, last = u_hat + (1 - np.exp(-T / LAG)) * (command - u_hat), V
        if law == "observer":
            P_hat = P_hat + T * (coadjoint(V, inertia @ V) + u_hat + known + delta_hat)
        for _ in range(SUBSTEPS):
            h = T / SUBSTEPS
            a = rates(y, command)[0]
            b = rates(y + h / 2 * a, command)[0]
            c = rates(y + h / 2 * b, command)[0]
            d = rates(y + h * c, command)[0]
            y = y + h / 6 * (a + 2 * b + 2 * c + d)
        if (k + 1) % 20 == 0:
            found.append(y.copy())
    return np.array(found)


@pytest.mark.parametrize(
    ("engine", "law", "limit"),
    [
        ("solve_ivp", "indi", 1.5),
        in_ci("another law", "solve_ivp", "observer", 1.5),
        in_ci("compiles a law", "native", "indi", 1.5),
        in_ci("compiles a law", "native", "indi", None),
        in_ci("compiles a law", "native", "observer", None),
    ],
)
def test_on_attitudes_a_run_is_that_of_a_plain_program(solved, engine, law, limit):
    """Within 1e-9: the engines' tolerance, over 60 periods."""
    text = ATTITUDE | {"solver": ATTITUDE["solver"] | {"engine": engine}}
    if limit:
        cut = {"kind": "limit", "limit": limit}
        text = text | {"actuators": [cut, *ATTITUDE["actuators"]]}
    problem, solution = solved(yaml.safe_dump(text), label=law)
    s = problem.loop.tracking(problem.times, solution.states)
    found = flown(s, law, limit=limit or np.inf, turns_only=True)
    if limit:  # it is reached at some instants and along some axes
        at_limit = np.abs(problem.loop.command(s)[0]) >= limit
        assert at_limit.any() and not at_limit.all()
    np.testing.assert_allclose(s.Q[0, 1:].reshape(3, 9), found[:, :9], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.V[0, 1:], found[:, 12:15], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("engine", "law", "linear", "mounted"),
    [
        ("solve_ivp", "indi", "accelerometer", True),
        in_ci("another law", "solve_ivp", "indi", "differences", False),
        in_ci("compiles a law", "native", "indi", "differences", False),
        in_ci("compiles a law", "native", "indi", "accelerometer", False),
        in_ci("compiles a law", "native", "indi", "accelerometer", True),
        in_ci("compiles a law", "native", "observer", "differences", False),
    ],
)
def test_on_rigid_motions_a_run_is_that_of_a_plain_program(solved, engine, law, linear, mounted):
    """A heavier body with its weight and a wrench, its accelerometer mounted off the origin."""
    text = ATTITUDE | BODY | {"solver": ATTITUDE["solver"] | {"engine": engine}}
    text["controllers"] = [dict(entry) for entry in ATTITUDE["controllers"]]
    text["controllers"][0]["linear"] = linear
    if mounted:
        text["sensors"] = {"accelerometer": MOUNTED}
    problem, solution = solved(yaml.safe_dump(text), label=law)
    s = problem.loop.tracking(problem.times, solution.states)
    found = flown(s, law, linear, mounted)
    np.testing.assert_allclose(s.Q[0, 1:, :3, :3].reshape(3, 9), found[:, :9], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.Q[0, 1:, :3, 3], found[:, 9:12], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.V[0, 1:], found[:, 12:18], rtol=0, atol=1e-9)


def changed(base, **changes):
    return yaml.safe_dump(base | changes)


LAW = {"kind": "indi", "law": "lee2010", "cutoff": CUTOFF}
OBSERVER = {"kind": "observer", "law": "lee2010", "rate": RATE}
QUICK = {"solver": {"engine": "solve_ivp", "rtol": 1e-10, "atol": 1e-12}}


@pytest.mark.ci("four runs")
def test_without_lag_and_filter_it_commands_what_its_law_does(solved):
    """With H = 1, the exact model and no lag, u − τ is a difference for a rate: it falls with T."""
    apart = []
    for period in (0.002, 0.001):
        law = LAW | {"cutoff": 0.49999 / period, "lag": 0.0}
        bare = {"plant": {}, "actuators": [], "control": {"period": period}}
        time = {"duration": 0.08, "samples": 41}
        text = changed(ATTITUDE | bare | QUICK, controllers=[law, "lee2010"], time=time)
        found = []
        for label in ("indi", "lee2010"):
            problem, solution = solved(text, label=label)
            s = problem.loop.tracking(problem.times, solution.states)
            found.append(problem.loop.command(s)[0, 4:])
        apart.append(np.abs(found[0] - found[1]).max())
    assert apart[0] < 0.06 * np.abs(found[1]).max()
    assert apart[1] / apart[0] == pytest.approx(0.5, abs=0.05)


@pytest.mark.ci("a run of a second and a half")
def test_the_estimate_is_a_signal_and_tends_to_the_torque(solved):
    """After 60 time constants of the filter, about a rest."""
    rest = {"plant": {"forces": ATTITUDE["plant"]["forces"]}, "reference": {"kind": "constant"}}
    time = {"duration": 1.5, "samples": 4}
    text = changed(ATTITUDE | rest | QUICK, controllers=[LAW], time=time)
    problem, solution = solved(text, label="indi")
    s = problem.loop.tracking(problem.times, solution.states)
    law = problem.loop.controller
    assert [*outputs(law, s.G)] == ["disturbance"] and law.output_units["disturbance"] == "N m"
    np.testing.assert_allclose(s.memory["disturbance"][0, -1], DELTA[:3], rtol=0, atol=1e-3)


def test_an_accelerometer_feels_nothing_in_free_fall_and_the_push_at_rest(experiment_of):
    """f = F/m without the weight, and what a lever of the angular acceleration adds."""
    text = ATTITUDE | BODY | {"controllers": [LAW | {"linear": "accelerometer"}, "lee2010"]}
    push = {"kind": "constant", "force": [0.2, 0.0, 0.0, 0.0, 2.6, 0.0]}
    weight = {"kind": "restoring", "weight": MASS * G}
    for forces, expected in (([weight], [0, 0, 0]), ([weight, push], [0, 2, -0.5])):
        sensors = {"accelerometer": [{"kind": "lever", "at": [0.0, 0.1, 0.0]}]}
        plant = {"forces": forces, "inertia": [0.04, 0.05, 0.08, MASS, MASS, MASS]}
        if forces[1:]:  # ω̇ × r = 5 × 0.1 along z
            push["force"] = [-0.2, 0.0, 0.0, 0.0, 2.6, 0.0]
        experiment = experiment_of(changed(text, plant=plant, sensors=sensors))
        loop, bare = experiment.loops["indi"], experiment.loops["lee2010"]
        still = np.zeros(6)
        state = loop.initial_state(np.eye(4), still, np.eye(4), still)
        f = loop.law_input(0.0, state).specific_force
        np.testing.assert_allclose(f, expected, rtol=0, atol=1e-12)
        assert bare.vehicle.more_sensors == ((), (), ())
        assert (
            bare.law_input(0.0, bare.initial_state(*2 * (np.eye(4), still))).specific_force is None
        )


class Feeling(Controller):
    """A law of somebody else that reads the accelerometer."""

    reads_specific_force = True

    def torque(self, s):
        return np.concatenate([0 * s.V[..., :3], -MASS * s.specific_force], axis=-1)


def test_any_law_may_read_the_accelerometer(experiment_of):
    loop = experiment_of(changed(ATTITUDE | BODY, plant={}, controllers=["lee2010"])).loop
    loop = replace(loop, controller=Feeling(), known_forces=())
    still = np.zeros(6)
    state = loop.initial_state(np.eye(4), still, np.eye(4), still)
    lag = loop.layout.slices["vehicle.actuators_0"]
    state[lag] = [0, 0, 0, 0, 0, MASS * G]  # at rest, with its weight on the rotors
    torque, _ = loop.answer(loop.law_input(0.0, state), {}, T)
    np.testing.assert_allclose(torque, [0, 0, 0, 0, 0, -MASS * G], rtol=0, atol=1e-12)


@pytest.mark.ci("runs with noise")
def test_the_law_reads_the_accelerometer_at_its_clock(solved):
    """Noise of every second instant, one period late, in the held measurement."""
    noise = {"kind": "noise", "std": 0.5, "period": 2 * T, "delay": 1}
    text = ATTITUDE | BODY | QUICK | {"sensors": {"accelerometer": [noise]}}
    time = {"duration": 0.04, "samples": 21}
    controllers = [LAW | {"linear": "accelerometer"}]
    problem, solution = solved(changed(text, controllers=controllers, time=time), label="indi")
    s = problem.loop.tracking(problem.times, solution.states)
    held = s.vehicle["measured_accelerometer_translation"][0]
    drawn = problem.drawn().felt[0]
    assert np.ptp(drawn[::2, 3:], axis=0).min() > 0.1 and not drawn[:, :3].any()
    force = s.vehicle["actuators_0"][0, :, 3:] + DELTA[3:]
    measured = force[:20] / (1.5 * MASS) + drawn[:, 3:]
    expected = [measured[max(k - 1, 0) // 2 * 2] for k in range(20)]
    np.testing.assert_allclose(held[:20, :3], expected, rtol=0, atol=1e-9)


def test_rotors_that_run_begin_against_the_forces_that_the_law_knows(experiment_of):
    """At hover the first command is the weight, and û is what the rotors run at."""
    arms = [[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]
    rotors = [
        {"at": [0.2 * x for x in at], "along": [0, 0, 1], "turns": 0.02 * (-1) ** k}
        for k, at in enumerate(arms)
    ]
    wings = {"kind": "thrusters", "thrusters": rotors, "low": 0.0, "high": 8.0}
    wings |= {"thrust_constant": 1e-5, "time_constant": LAG, "least": 0.0}
    law = LAW | {"linear": "accelerometer"}
    text = ATTITUDE | BODY | {"actuators": [wings], "controllers": [law]}
    text["reference"] = {"kind": "constant"}
    text["plant"] = {"forces": BODY["model"]["forces"]}
    loop = experiment_of(changed(text)).loops["indi"]
    still = np.zeros(6)
    state = loop.initial_state(np.eye(4), still, np.eye(4), still)
    after = loop.after_instant(0.0, state)
    s = loop.tracking(0.0, after)
    weight = [0, 0, 0, 0, 0, MASS * G]
    np.testing.assert_allclose(loop.command(s), weight, rtol=0, atol=1e-12)
    np.testing.assert_allclose(s.memory["actuated"], weight, rtol=0, atol=1e-12)


def test_gains_of_the_law_inside_are_numbers_of_one_structure(experiment_of):
    """So that a tuning of them traces it once."""
    inside = ({"kind": "goodarzi2013", "ki": ki, "c2": 1.0} for ki in (0.1, 0.2))
    bases = (changed(ATTITUDE, controllers=[LAW | {"law": law}]) for law in inside)
    one, two = (experiment_of(base).loop.controller for base in bases)
    assert one.structure == two.structure
    assert (one.inner.ki, two.inner.ki) == (0.1, 0.2)


@from_yaml
def test_what_is_wrong_is_said_at_its_place(experiment_of, base, changes, said):
    bases = {"attitude": ATTITUDE, "body": ATTITUDE | BODY}
    text = changed(bases[base], **yaml.safe_load(changes))
    assert mentions(refusal(ConfigError, experiment_of, text), said)


@pytest.mark.parametrize("lag", [0.03, [0.03, 0.04, 0.05]])
def test_a_lag_is_that_of_the_actuators_unless_written(experiment_of, lag):
    actuators = [{"kind": "lag", "time_constant": lag}]
    controllers = [LAW, LAW | {"lag": [0.1, 0.2, 0.3], "label": "told"}]
    text = changed(ATTITUDE, actuators=actuators, controllers=controllers)
    loops = experiment_of(text).loops
    np.testing.assert_array_equal(loops["indi"].controller.believed, np.broadcast_to(lag, 3))
    np.testing.assert_array_equal(loops["told"].controller.believed, [0.1, 0.2, 0.3])


def test_c2_of_the_geometric_pid_follows_the_body(experiment_of):
    """Offsets decay at k_I c₂/(k_I + H) = ¼ min(H/K_d, K_d/𝕀): a root of its characteristic."""
    pid = {"kind": "goodarzi2013", "label": "told", "c2": 0.5}
    experiment = experiment_of(changed(ATTITUDE, controllers=["goodarzi2013", pid]))
    law, told = (experiment.loops[name].controller for name in ("goodarzi2013", "told"))
    assert (law.ki, told.c2) == (pytest.approx(0.4), 0.5)
    assert law.c2 * law.ki / (law.ki + 4) == pytest.approx(min(4 / 0.8, 0.8 / 0.08) / 4)
    for inertia in np.diag(J):
        roots = np.roots([inertia, 0.8, 4 + law.ki, law.ki * law.c2])
        assert -roots.real.max() > 1.0
    assert -np.roots([0.05, 0.8, 4.4, 0.4 * told.c2]).real.max() == pytest.approx(0.0458, abs=1e-3)
    assert "c2" not in experiment.laws["goodarzi2013"].resolved


def test_inside_another_law_c2_of_the_geometric_pid_follows_the_body_too(experiment_of):
    inside = LAW | {"law": "goodarzi2013"}
    told = LAW | {"law": {"kind": "goodarzi2013", "c2": 0.5}, "label": "told"}
    laws = ["goodarzi2013", inside, OBSERVER | {"law": "goodarzi2013"}, told]
    loops = experiment_of(changed(ATTITUDE, controllers=laws)).loops
    alone = loops["goodarzi2013"].controller
    for name in ("indi", "observer"):
        law = loops[name].controller.inner
        assert (law.ki, law.c2) == (alone.ki, alone.c2) == (pytest.approx(0.4), 13.75)
    assert loops["told"].controller.inner.c2 == 0.5
