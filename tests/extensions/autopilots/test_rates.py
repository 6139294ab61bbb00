"""Laws that command rates, and the rate loop: against quaternions and plain programs."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from case_tables import from_yaml, refusal
from said import mentions
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.signal import butter, lfilter, lfilter_zi
from scipy.spatial.transform import Rotation

from eqt_cli.components.blocks import signals
from eqt_cli.components.mechanics import Gains, LawInput
from eqt_cli.extend import EqtError, Inertia, Problem, group_named
from eqt_cli.extensions.autopilots.rate import Rate
from eqt_cli.extensions.autopilots.rate_loop import RateLoop
from eqt_cli.loop.law_program import law_program

SO3 = group_named("SO3")
J, TURN, KP = np.array([0.02, 0.021, 0.04]), np.array([0.3, -0.2, 0.7]), [8.0, 7.0, 3.0]
TIGHT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}


def positive(q):
    """The unit quaternion x, y, z, w of the shorter turn."""
    q = q.as_quat()
    return q if q[3] >= 0 else -q


def error_by_quaternions(E, kind):
    """2 sgn(q_0) q of the turn E; with `reduced` of the shortest turn of e_3, then about it."""
    if kind == "full":
        return 2 * positive(Rotation.from_matrix(E))[:3]
    axis = np.cross([0, 0, 1], E[:, 2])
    size = np.linalg.norm(axis)
    tilt = Rotation.from_rotvec(axis / size * np.arctan2(size, E[2, 2]))
    about = positive(tilt.inv() * Rotation.from_matrix(E))
    assert np.abs(about[:2]).max() < 1e-6  # of a matrix that is integrated
    return 2 * np.array([*positive(tilt)[:2], about[2]])


@pytest.mark.parametrize("kind", ["full", "reduced"])
def test_the_rate_is_that_of_quaternions(kind):
    random, law = np.random.default_rng(1), Rate(np.array(KP), error=kind)
    for _ in range(50):
        Q, Qd = SO3.exp(random.normal(size=(2, 3)))
        V, Vd = random.normal(size=(2, 3))
        given = LawInput(0.0, Q[None], V[None], Qd[None], Vd[None], 0.0 * Vd[None])
        unit = Inertia(np.diag(J), np.diag(1 / J))
        found = law.torque(given.tracking(SO3, unit, Gains(np.eye(3), np.eye(3)), {}))[0]
        expected = Q.T @ Qd @ Vd + KP * error_by_quaternions(Q.T @ Qd, kind)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def text(engine="native", control=None, error="full", **loop):
    config = {
        "group": "SO3",
        "inertia": J.tolist(),
        "reference": {"kind": "path", "factors": [{"axis": TURN.tolist(), "by": "t"}]},
        "controllers": [{"kind": "rate", "kp": KP, "error": error}],
        "actuators": [{"kind": "rate_loop", **loop}],
        "initial": {
            "pose": {"kind": "exp_normal", "std": 0.0, "centre": [0.5, -0.8, 1.0]},
            "velocity": {"kind": "fixed", "coordinates": [0.5, -0.3, 0.8]},
        },
        "time": {"duration": 0.1, "samples": 3},
        "solver": {"engine": engine, "rtol": 1e-12, "atol": 1e-14},
    }
    return yaml.safe_dump(config | ({"control": control} if control else {}))


def pid(asked, omega, x, gains, cutoff, ki, kd, feedforward=(0, 0, 0), i_limit=None, d_cutoff=20.0):
    """Torque, and rates of ω̂, ω̂', α and z, axis by axis, of PX4's rate loop."""
    torque, rates = np.zeros(3), np.zeros((4, 3))
    for k in range(3):
        measured, slope, alpha, z = x.reshape(4, 3)[:, k]
        error = asked[k] - measured
        torque[k] = gains[k] * error + z - kd[k] * alpha + feedforward[k] * asked[k]
        size, rate = abs(error) * 180 / np.pi / 400, 0.0
        if size < 1:
            rate = ki[k] * error * (1 - size**2)
        if i_limit is not None and abs(z) >= i_limit[k] and np.sign(rate) == np.sign(z):
            rate = 0.0
        w = 2 * np.pi * cutoff
        slopes = w * w * (omega[k] - measured) - 2 * np.sin(np.pi / 4) * w * slope
        rates[:, k] = slope, slopes, 2 * np.pi * d_cutoff * (slope - alpha), rate
    return torque, rates.ravel()


def flown(times, kind, bandwidth=None, gains=None, period=None, **filtered):
    """Attitude and rate, by SciPy: continuous, or with a command that is held for a period."""

    def asked(t, y):
        E = y[:9].reshape(3, 3).T @ expm(np.cross(np.eye(3), TURN) * t)
        return E @ TURN + KP * error_by_quaternions(E, kind)

    def field(t, y, held):
        R, omega, rates = y[:9].reshape(3, 3), y[9:12], []
        command = asked(t, y) if held is None else held
        off = command - omega
        if filtered:
            torque, rates = pid(command, omega, y[12:], gains, **filtered)
        elif gains is None:
            torque = J * (bandwidth * off) + np.cross(omega, J * omega)
        else:
            torque = np.array(gains) * off
        turned = R @ np.cross(np.eye(3), omega)
        return np.concatenate([turned.ravel(), (torque - np.cross(omega, J * omega)) / J, rates])

    R = expm(np.cross(np.eye(3), [0.5, -0.8, 1.0]))
    omega = TURN + np.array([0.5, -0.3, 0.8])
    y, states = np.concatenate([R.ravel(), omega, [*omega, *np.zeros(9)] if filtered else []]), []
    ticks = times if period is None else np.arange(0, times[-1], period).round(12)
    ends = np.unique([*times.round(12), *ticks.round(12)])
    for start, end in pairwise(ends):
        states += [y] * (start in times.round(12))
        if period and start in ticks:
            held = asked(start, y)
        y = solve_ivp(field, (start, end), y, args=(held if period else None,), **TIGHT).y[:, -1]
    return np.array([*states, y])


PID = {
    "gains": [0.5, 0.6, 0.7],
    "cutoff": 30.0,
    "ki": [9.0, 7.0, 0.5],
    "kd": [0.003, 0.002, 0.0],
    "d_cutoff": 25.0,
}
LIMITED = {**PID, "feedforward": [0.01, 0.02, 0.0], "i_limit": [0.2, 0.2, 0.3]}


@pytest.mark.parametrize(
    ("engine", "control", "error", "loop"),
    [
        ("native", None, "full", {"bandwidth": 30.0}),
        ("solve_ivp", None, "reduced", {"bandwidth": 30.0}),
        ("native", None, "reduced", {"gains": [0.5, 0.6, 0.7]}),
        ("native", {"period": 0.02}, "full", {"bandwidth": [30.0, 40.0, 20.0]}),
        ("solve_ivp", {"period": 0.02}, "full", {"bandwidth": [30.0, 40.0, 20.0]}),
        ("native", None, "full", PID),
        ("native", None, "reduced", LIMITED),
        ("solve_ivp", None, "full", LIMITED),
        ("native", {"period": 0.02}, "full", LIMITED),
        ("solve_ivp", {"period": 0.02}, "full", LIMITED),
    ],
)
def test_runs_by_rates_are_those_of_a_plain_program(solved, engine, control, error, loop):
    problem, solution = solved(text(engine, control, error, **loop), "rate")
    loop = {name: np.array(value) for name, value in loop.items()}
    states = flown(problem.times, error, period=control and control["period"], **loop)
    s = problem.loop.tracking(problem.times, solution.states)
    np.testing.assert_allclose(s.Q[0].reshape(3, 9), states[:, :9], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.V[0], states[:, 9:12], rtol=0, atol=1e-9)
    if "cutoff" in loop:
        x = s.vehicle["actuators_0"][0]
        np.testing.assert_allclose(x[:, :3], states[:, 12:15], rtol=0, atol=1e-9)
        np.testing.assert_allclose(x[:, 6:], states[:, 18:], rtol=1e-9, atol=1e-9)
        most = np.abs(x[:, 9:]).max()  # its limit is reached, and left again
        assert most == pytest.approx(0.2, abs=1e-9) if "i_limit" in loop else most > 0.5


def a_loop(**options):
    """A rate loop of one run."""
    return RateLoop(**options).of_run(SO3, None)


def test_torque_and_rates_of_the_pid_are_those_of_a_plain_program():
    """At random states, errors beyond 400°/s and integrals beyond their limits among them."""
    random, loop = np.random.default_rng(2), a_loop(**LIMITED)
    beyond = []
    for _ in range(200):
        asked, omega = random.normal(size=(2, 3)) * 5
        x = random.normal(size=(4, 3)) * [[5], [50], [50], [0.2]]
        torque, rates = pid(asked, omega, x, **LIMITED)
        here = loop.at(SimpleNamespace(V=omega))
        found = here.state_rate(SO3, asked, x.ravel())
        np.testing.assert_allclose(found, rates, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(here.output(SO3, asked, x.ravel()), torque, rtol=0, atol=1e-12)
        beyond.append([np.abs(asked - x[0]).max() > np.radians(400), np.abs(x[3]).max() > 0.3])
    assert np.mean(beyond, axis=0).min() > 0.2


def sampled(omega, asked, rate, until, gains, cutoff, ki, kd, feedforward, i_limit, d_cutoff):
    """The last torque of PX4's loop as its firmware computes it, at so many samples per second."""
    dt = 1 / rate
    b, a = butter(2, cutoff, fs=rate)
    times = np.arange(1, round(until * rate) + 1) * dt
    start = lfilter_zi(b, a)[:, None] * omega(0.0)
    measured, _ = lfilter(b, a, np.array([omega(t) for t in times]), axis=0, zi=start)
    alpha, z, before = np.zeros(3), np.zeros(3), omega(0.0)
    for t, now in zip(times, measured, strict=True):
        alpha += dt / (dt + 1 / (2 * np.pi * d_cutoff)) * ((now - before) / dt - alpha)
        error, before = asked(t) - now, now
        torque = gains * error + z - kd * alpha + feedforward * asked(t)
        factor = np.maximum(0.0, 1 - (error / np.radians(400.0)) ** 2)
        z = np.clip(z + factor * ki * error * dt, -i_limit, i_limit)
    return torque


def test_the_loop_is_that_of_the_firmware_as_its_sampling_becomes_fast():
    def omega(t):
        return np.array([0.5 + 2 * np.sin(20 * t), np.cos(9 * t), 3 * t - 2 * t * t])

    def asked(t):
        return np.array([2 + np.cos(11 * t), 8 * np.sin(5 * t), -1.0])

    def field(t, x):
        return loop.at(SimpleNamespace(V=omega(t))).state_rate(SO3, asked(t), x)

    loop, options = a_loop(**LIMITED), {name: np.array(x) for name, x in LIMITED.items()}
    x = solve_ivp(field, (0, 0.25), loop.started(SO3, omega(0.0)), max_step=1e-3, **TIGHT).y[:, -1]
    torque = loop.output(SO3, asked(0.25), x)
    apart = [np.abs(sampled(omega, asked, r, 0.25, **options) - torque) for r in (4000, 16000)]
    print(f"apart {apart[0]} N m at 4 kHz, {apart[1]} at 16 kHz; of {torque}")
    assert np.abs(x[9:11]).min() == pytest.approx(
        0.2, abs=1e-9
    )  # two integrals are at their limits
    assert apart[1].max() < 1e-4 * np.abs(torque).max()
    assert apart[0].max() / apart[1].max() == pytest.approx(4.0, rel=0.05)  # the first order of dt


QUADROTOR = {
    "group": "SE3",
    "inertia": [*J.tolist(), 1, 1, 1],
    "model": {"forces": [{"kind": "restoring", "weight": 9.81}]},
    "reference": {"kind": "flat", "position": ["sin(2*t)", "cos(2*t)", 1], "heading": "0.5*t"},
    "initial": {"pose": "fixed", "velocity": "fixed"},
    "time": {"duration": 2, "samples": 21},
    "solver": {"engine": "native", "rtol": 1e-11, "atol": 1e-13},
}
LAW = {"kind": "cascade", "position": {"kx": 4, "kv": 3}, "along": [0, 0, 1]}
BY_RATES = {**LAW, "attitude": {"kind": "rate", "kp": 8.0}}


def poses(experiment_of, law, actuators=()):
    """Poses of a run that starts off its reference."""
    config = QUADROTOR | {"controllers": [law], "actuators": list(actuators)}
    one, times = experiment_of(yaml.safe_dump(config)), np.linspace(0.0, 2.0, 21)
    (loop,) = one.loops.values()
    Q, V, _ = loop.reference.motion(loop.group, 0.0)
    Q = Q[None] @ loop.group.exp(np.array([[0.3, -0.2, 0.4, 0.1, 0.2, 0.3]]))
    states = loop.initial_state(Q, V[None], Q, V[None])
    return loop.tracking(times, one.engine.solve(Problem(loop, states, times)).states).Q[0]


def test_a_cascade_by_rates_becomes_that_by_torques_as_the_bandwidth_grows(experiment_of):
    """With k_R = 𝕁 b k_p and k_Ω = 𝕁 b, they differ by the feedforward of Ω̇_c alone."""
    bandwidths, apart = [80.0, 160.0, 320.0], []
    for b in bandwidths:
        H = J * b * 8.0  # the Hessian tr(K) I − K of the stiffness K
        gains = {"kp": np.diag(H.sum() / 2 - H).tolist(), "kd": (J * b).tolist()}
        torques = poses(experiment_of, LAW | {"attitude": "quaternion", "gains": gains})
        rates = poses(experiment_of, BY_RATES, [{"kind": "rate_loop", "bandwidth": b}])
        apart.append(np.linalg.norm((torques - rates)[:, :3, 3], axis=1).max())
    slope = np.polyfit(np.log(bandwidths), np.log(apart), 1)[0]
    print(f"apart {apart} m, slope {slope:.4f}")
    assert slope == pytest.approx(-1.0, abs=0.01)


ROTORS = {
    "kind": "thrusters",
    "thrusters": [
        {"at": [x, y, 0], "along": [0, 0, 1], "turns": 0.02 * x * y / 0.01}
        for x, y in ((0.1, 0.1), (0.1, -0.1), (-0.1, -0.1), (-0.1, 0.1))
    ],
    "thrust_constant": 1e-5,
    "low_speed": 0,
    "high_speed": 2000,
    "time_constant": 0.02,
}


@pytest.mark.parametrize("loop", [{"bandwidth": 20}, {"gains": 0.4, "cutoff": 30, "kd": 0.003}])
def test_rotors_behind_a_rate_loop_run_at_the_start(experiment_of, loop):
    actuators = [{"kind": "rate_loop", **loop}, ROTORS]
    config = QUADROTOR | {"controllers": [BY_RATES], "actuators": actuators}
    (loop,) = experiment_of(yaml.safe_dump(config)).loops.values()
    Q, V, _ = loop.reference.motion(loop.group, 0.0)
    Q = Q[None] @ loop.group.exp(np.array([[0.02, -0.02, 0.01, 0.1, 0.0, 0.0]]))
    s = loop.tracking(0.0, loop.initial_state(Q, V[None], Q, V[None]))
    _, rates = loop.acting_and_rates(s)
    assert np.abs(rates["actuators_1"]).max() < 1e-9
    assert signals(loop.now(s))["thrust"].min() > 1.0


def test_what_is_exported_is_a_rate_and_a_force(experiment_of):
    config = QUADROTOR | {"controllers": [BY_RATES]}
    config["actuators"] = [{"kind": "rate_loop", "bandwidth": 20}]
    (loop,) = experiment_of(yaml.safe_dump(config)).loops.values()
    program = law_program(loop)
    assert program.torque.unit == "rad/s (rotation), N (translation)"
    assert "bandwidth" not in [each.name for each in program.numbers]  # it is the autopilot's


@from_yaml
def test_what_no_rate_loop_takes_is_refused(experiment_of, changes, said):
    config = QUADROTOR | {"controllers": [BY_RATES]}
    config["actuators"] = [{"kind": "rate_loop", "bandwidth": 20}]
    text = yaml.safe_dump(config | yaml.safe_load(changes))
    assert mentions(refusal(EqtError, experiment_of, text), said)


def test_a_rate_loop_needs_an_attitude_in_space(noted):
    said = "rate_loop needs group SO3 or SE3, got SE2"
    assert noted(RateLoop(bandwidth=20.0), group_named("SE2")) == [("", said)]
