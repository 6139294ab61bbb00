"""Magnetorquers, magnetometer and B-dot against plain programs."""

import numpy as np
import pytest
import yaml
from case_tables import from_yaml, refusal
from plain import hat
from said import mentions
from scipy.integrate import solve_ivp
from scipy.optimize import bisect

from eqt_cli.base.errors import ConfigError
from eqt_cli.components.blocks import signals
from eqt_cli.config.remarks import remarks
from eqt_cli.extend import Native, group_named
from eqt_cli.extensions.spacecraft.magnetic import Magnetorquers, Orbit
from eqt_cli.numbers.leaves import with_fields

J = np.diag([0.042, 0.040, 0.0067])
ORBIT = "{altitude: 500 km, inclination: 97.4 deg, node: 20 deg, phase: 35 deg}"
TORQUERS = f"{{kind: magnetorquers, orbit: {ORBIT}, limit: 0.2 A m^2, takes: dipole}}"
TEXT = f"""
task: stabilise
group: SO3
inertia: {np.diag(J).tolist()}
controllers: [{{kind: b_dot, k: 1.0e+5}}]
actuators: [{TORQUERS}]
control: {{period: 0.5}}
initial:
  pose: {{kind: exp_normal, std: 0.0, centre: [0.9, -0.5, 0.7]}}
  velocity: {{kind: fixed, coordinates: [6 deg/s, -6 deg/s, 5 deg/s]}}
time: {{duration: 20, samples: 41}}
settling_threshold: {{rate: 0.5 deg/s}}
solver: {{engine: native, rtol: 1.0e-12, atol: 1.0e-14}}
"""


def changed(changes):
    return yaml.safe_dump(yaml.safe_load(TEXT) | changes)


G = group_named("SO3")
EARTH, DISTANCE = 6371.2e3, 6871.2e3
RATE = np.sqrt(3.986004418e14 / DISTANCE**3)
NODE, TILT, PHASE = np.radians([20.0, 97.4, 35.0])
NODAL = np.array([np.cos(NODE), np.sin(NODE), 0.0])
NORMAL = np.array([np.sin(NODE) * np.sin(TILT), -np.cos(NODE) * np.sin(TILT), np.cos(TILT)])


def place(t):
    """The direction of the satellite, in axes of the Earth at t = 0, x at Greenwich."""
    angle = PHASE + RATE * t
    return np.cos(angle) * NODAL + np.sin(angle) * np.cross(NORMAL, NODAL)


FRAME = np.array([place(0.0), np.cross(NORMAL, place(0.0)), NORMAL])


def pole(t):
    """g₁¹, h₁¹, g₁⁰ of IGRF-13, turned with the Earth."""
    c, s = np.cos(7.292115e-5 * t), np.sin(7.292115e-5 * t)
    return 1e-9 * np.array([-1450.9 * c - 4652.5 * s, -1450.9 * s + 4652.5 * c, -29404.8])


def field(t):
    x, m = place(t), pole(t)
    return FRAME @ ((EARTH / DISTANCE) ** 3 * (3 * (m @ x) * x - m))


@pytest.mark.parametrize("t", [0.0, 700.0, 40_000.0])
def test_the_field_is_minus_the_gradient_of_the_potential_of_a_dipole(t):
    orbit = Orbit(500e3, TILT, NODE, PHASE)
    found = Magnetorquers(limit=0.2, orbit=orbit).of_run(G, None).in_space(t)
    p, step = DISTANCE * place(t), 1e3

    def potential(p):
        return EARTH**3 * (pole(t) @ p) / np.linalg.norm(p) ** 3

    slope = [
        8 * (potential(p + d) - potential(p - d)) - potential(p + 2 * d) + potential(p - 2 * d)
        for d in step * np.eye(3)
    ]
    np.testing.assert_allclose(found, -FRAME @ slope / (12 * step), rtol=0, atol=1e-14)
    # 4e-5 T, turned by up to 44 rad that the last place of the orbit's rate may change.
    np.testing.assert_allclose(found, field(t), rtol=0, atol=1e-18)


@pytest.mark.parametrize(("e", "anomaly"), [(0.3, 2.0), (0.9, -1.2)])
def test_the_field_on_an_ellipse_is_that_at_its_place(e, anomaly):
    """Kepler's equation by halving; the perigee is where the circle of other tests is."""
    orbit = Orbit(500e3, TILT, NODE, PHASE, eccentricity=e, anomaly=anomaly)
    torquers = Magnetorquers(limit=0.2, orbit=orbit).of_run(G, None)
    a = DISTANCE / (1 - e)
    n, ratio = np.sqrt(3.986004418e14 / a**3), np.sqrt((1 + e) / (1 - e))
    begin = 2 * np.arctan(np.tan(anomaly / 2) / ratio)
    for t in (0.0, 700.0, 0.4 * 2 * np.pi / n):
        M = (begin - e * np.sin(begin) + n * t + np.pi) % (2 * np.pi) - np.pi
        E = bisect(lambda E, M=M: E - e * np.sin(E) - M, -4, 4, xtol=1e-15, rtol=1e-15)
        angle = 2 * np.arctan(ratio * np.tan(E / 2)) - anomaly + PHASE
        x = np.cos(angle) * NODAL + np.sin(angle) * np.cross(NORMAL, NODAL)
        m = pole(t)
        B = (EARTH / (a * (1 - e * np.cos(E)))) ** 3 * (3 * (m @ x) * x - m)
        np.testing.assert_allclose(torquers.in_space(t), FRAME @ B, rtol=0, atol=1e-17)


def body_field(t, Q):
    return Q.T @ field(t)


def turned(turn, t, w, torque):
    """The rates of Q and ω under a torque."""
    return np.concatenate(
        [(turn @ hat(w)).ravel(), np.linalg.solve(J, np.cross(J @ w, w) + torque)]
    )


def started(s):
    return np.concatenate([s.Q[0, 0].ravel(), s.V[0, 0]])


def followed(field, times, y):
    found = solve_ivp(field, (0, times[-1]), y, "DOP853", times, rtol=1e-12, atol=1e-15)
    return found.y.T


@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
def test_b_dot_is_that_of_a_plain_program(solved, engine):
    """Differences of the field at 2 Hz, the dipole cut as a whole: SciPy at instants."""
    text = TEXT.replace("engine: native", f"engine: {engine}")
    problem, solution = solved(text, label="b_dot")
    s = problem.loop.tracking(problem.times, solution.states)
    y, last, found, dipoles = started(s), None, [started(s)], []
    for k in range(40):
        B = body_field(0.5 * k, y[:9].reshape(3, 3))
        m = np.zeros(3) if last is None else -1e5 * (B - last) / 0.5
        dipoles.append(m)
        last, m = B, np.clip(m, -0.2, 0.2)

        def rate(t, y, m=m, begin=0.5 * k):
            Q = y[:9].reshape(3, 3)
            return turned(Q, t, y[9:], np.cross(m, body_field(begin + t, Q)))

        y = solve_ivp(rate, (0, 0.5), y, "DOP853", rtol=1e-12, atol=1e-15).y[:, -1]
        found.append(y)
    found, dipoles = np.array(found), np.array(dipoles)
    assert (np.abs(dipoles) > 0.2).any(axis=1).sum() > 5
    np.testing.assert_allclose(s.Q[0].reshape(-1, 9), found[:, :9], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.V[0], found[:, 9:], rtol=0, atol=1e-9)
    asked = problem.loop.command(s)[0]
    np.testing.assert_allclose(asked[:-1], dipoles, rtol=0, atol=1e-9)
    energy = 0.5 * (found[:, 9:] ** 2 @ np.diag(J))
    np.testing.assert_allclose(problem.loop.lyapunov(s)[0], energy, rtol=1e-7)


def test_the_l_of_b_dot_is_the_energy_of_the_turn(experiment_of):
    [loop] = experiment_of(TEXT).loops.values()
    w = np.array([0.1, -0.2, 0.3])
    state = loop.initial_state(np.eye(3), w, np.eye(3), np.zeros(3))
    assert loop.lyapunov(loop.tracking(0.0, state)) == pytest.approx(w @ J @ w / 2, rel=1e-14)


CONTINUOUS = TEXT.replace("control: {period: 0.5}\n", "").replace("samples: 41", "samples: 11")


@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
def test_a_torque_is_projected_across_the_field(solved, engine):
    """PD on the attitude by the dipole B × τ/|B|², each cut at 0.2 A m²."""
    text = CONTINUOUS.replace("engine: native", f"engine: {engine}").replace(
        "takes: dipole", "takes: torque"
    )
    text = (
        text.replace("{kind: b_dot, k: 1.0e+5}", "stabilising")
        + "gains: {kp: 5.0e-6, kd: 6.0e-5}\n"
    )
    problem, solution = solved(text, label="stabilising")
    s = problem.loop.tracking(problem.times, solution.states)
    cut = []

    def rate(t, y):
        Q, w = y[:9].reshape(3, 3), y[9:]
        B = body_field(t, Q)
        error = 5e-6 * np.array([(Q - Q.T)[2, 1], (Q - Q.T)[0, 2], (Q - Q.T)[1, 0]])
        m = np.cross(B, -error - 6e-5 * w) / (B @ B)
        cut.append(np.abs(m).max() > 0.2)
        return turned(Q, t, w, np.cross(np.clip(m, -0.2, 0.2), B))

    found = followed(rate, problem.times, started(s))
    assert 0 < sum(cut) < len(cut)
    np.testing.assert_allclose(s.Q[0].reshape(-1, 9), found[:, :9], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.V[0], found[:, 9:], rtol=0, atol=1e-9)


AXES = "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]"
WHEELS = f"{{kind: wheels, axes: {AXES}, start: [4 mN m s, -3 mN m s, 2 mN m s]}}"
DUMP = (
    CONTINUOUS.replace("actuators: [", f"actuators: [{WHEELS}, ")
    .replace("takes: dipole", "dump: 0.01, dump_to: [1 mN m s, 0, -2 mN m s]")
    .replace("{kind: b_dot, k: 1.0e+5}", "stabilising")
) + "gains: {kp: 1.0e-3, kd: 0.01}\n"


@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
def test_dumping_is_that_of_a_plain_program_and_takes_momentum(solved, engine):
    problem, solution = solved(DUMP.replace("engine: native", f"engine: {engine}"), "stabilising")
    s = problem.loop.tracking(problem.times, solution.states)

    def rate(t, y):
        Q, w, h = y[:9].reshape(3, 3), y[9:12], y[12:]
        B = body_field(t, Q)
        error = 1e-3 * np.array([(Q - Q.T)[2, 1], (Q - Q.T)[0, 2], (Q - Q.T)[1, 0]])
        u = -error - 0.01 * w
        m = np.clip(0.01 * np.cross(h - [1e-3, 0, -2e-3], B) / (B @ B), -0.2, 0.2)
        return np.concatenate([turned(Q, t, w, np.cross(h, w) + u + np.cross(m, B)), -u])

    y = np.concatenate([started(s), [4e-3, -3e-3, 2e-3]])
    found = followed(rate, problem.times, y)
    np.testing.assert_allclose(s.V[0], found[:, 9:12], rtol=0, atol=1e-9)
    now = problem.loop.now(s)
    np.testing.assert_allclose(signals(now)["wheel_momentum"][0], found[:, 12:], rtol=0, atol=1e-12)
    np.testing.assert_allclose(now["actuators_0.momentum"][0], found[:, 12:], rtol=0, atol=1e-12)


@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
@pytest.mark.parametrize(("sensor", "every", "late"), [
    ("{kind: noise, std: 200 nT}, {kind: bias, value: [1 uT, 0, 0]}", 1, 0),
    ("{kind: noise, std: 200 nT, period: 1.0, delay: 1}", 2, 1),
])  # fmt: skip
@pytest.mark.parametrize("estimator", [None, "invariant"])
def test_the_law_reads_the_magnetometer_at_its_clock(
    solved, engine, sensor, every, late, estimator
):
    """The dipole at an instant from measurements: B + b of every n-th instant, one period late.

    An estimator gives pose and velocity, but not the field.
    """
    short = {"time": {"duration": 5, "samples": 11}, "solver": {"engine": engine, "rtol": 1e-12}}
    sensors = {"magnetometer": yaml.safe_load(f"[{sensor}]")}
    if estimator:
        noisy = [{"kind": "noise", "std": 1e-3}]
        sensors |= {"pose": noisy, "velocity": noisy}
        short["estimator"] = estimator
    problem, solution = solved(changed(short | {"sensors": sensors}), label="b_dot")
    s = problem.loop.tracking(problem.times, solution.states)
    errors = problem.drawn().flux[0]
    assert np.ptp(errors, axis=0).min() > 1e-7
    true = [body_field(t, Q) for t, Q in zip(problem.times, s.Q[0], strict=True)]
    measured = np.array(true)[: len(errors)] + errors[: len(true)]
    held = [measured[max(k - late, 0) // every * every] for k in range(10)]
    dipoles = [-1e5 * (held[k] - held[k - 1]) / 0.5 for k in range(1, 10)]
    asked = problem.loop.command(s)[0]
    np.testing.assert_allclose(asked[:10], [np.zeros(3), *dipoles], rtol=0, atol=1e-11)


def test_a_check_names_the_direction_and_the_mean(experiment_of):
    """Shares of a torque about the axes of the mean of I − b bᵀ over an orbit, by this program."""
    [said] = [str(each) for each in remarks(experiment_of(TEXT)) if "magnetorquers" in str(each)]
    b = np.array([field(t) for t in np.linspace(0, 2 * np.pi / RATE, 2000, endpoint=False)])
    b /= np.linalg.norm(b, axis=1, keepdims=True)
    shares = np.linalg.eigvalsh(np.eye(3) - b.T @ b / 2000).round(2)
    first = f"magnetorquers give no torque along the field, {b[0].round(2)} in space at t = 0; "
    assert first in said
    assert f"over {2 * np.pi / RATE:.0f} s, {shares[0]} of a torque about [" in said
    assert said.endswith(f"] remains, {shares[1]} and {shares[2]} across it")


def test_of_a_field_by_expressions_the_mean_is_over_an_hour_and_a_half():
    """A field that turns once about z in this time: ½ about each axis of the plane, 1 about z."""
    flux = ["3e-5*cos(pi*t/2700)", "3e-5*sin(pi*t/2700)", 0.0]
    [said] = (
        Magnetorquers(flux=flux, limit=0.2, takes="dipole").of_run(G, None).remarks(G, np.eye(3))
    )
    assert mentions(said, "in the mean over 5400 s, 0.5 of…, 0.5 and 1.0 across it")


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"takes": "dipole"}, [0.2, -0.1, 0.2]),
        ({"takes": "torque", "dump": 1.0}, [0.5, -0.1, 0.3]),  # by the wheels
    ],
)
def test_limits_cut_dipoles_and_no_torque_that_wheels_give(options, expected):
    part = Magnetorquers(flux=[2e-5, -1e-5, 3e-5], limit=0.2, **options).of_run(G, None)
    part = with_fields(part, moving=(part.in_space(0.0), np.ones(3)))  # of wheels, with `dump`
    assert part.within(G, np.array([0.5, -0.1, 0.3]), np.zeros(0)).tolist() == expected


def rotated(q, x, y, z, B):
    """A vector of space in the body, by a quaternion with the scalar q first."""
    s, t, u = z * B[1] - y * B[2], x * B[2] - z * B[0], y * B[0] - x * B[1]
    s, t, u = 2 * s, 2 * t, 2 * u
    return (
        B[0] + q * s + z * t - y * u,
        B[1] + q * t + x * u - z * s,
        B[2] + q * u + y * s - x * t,
    )


def rates_of(state, B, m, inertia):
    """The rates of quaternion and ω, number by number, which is faster than arrays."""
    q, x, y, z, a, b, c = state
    (I, J, K), (u, v, w), (e, f, g) = inertia, rotated(q, x, y, z, B), m
    return (
        (-x * a - y * b - z * c) / 2,
        (q * a + y * c - z * b) / 2,
        (q * b + z * a - x * c) / 2,
        (q * c + x * b - y * a) / 2,
        ((J - K) * b * c + f * w - g * v) / I,
        ((K - I) * c * a + g * u - e * w) / J,
        ((I - J) * a * b + e * v - f * u) / K,
    )


@pytest.mark.ci("an hour of a tumbling satellite")
@pytest.mark.skipif(Native.unavailable() is not None, reason="needs a C compiler")
def test_it_detumbles_in_the_time_of_a_plain_program(solved):
    """A unit of 1.3 kg from 10 to 1 deg/s, at 10 Hz, by Runge-Kutta at 50 ms."""
    start, k, duration = 10.0, 5e3, 3500
    inertia = [2.2e-3, 2.1e-3, 1.9e-3]
    rate = np.radians(start * np.array([0.6, -0.64, 0.48])).tolist()
    tumbling = {
        "inertia": inertia,
        "controllers": [{"kind": "b_dot", "k": k}],
        "control": {"period": 0.1},
        "initial": {"velocity": {"kind": "fixed", "coordinates": rate}},
        "time": {"duration": duration, "samples": duration + 1},
        "solver": {"rtol": 1e-8, "engine": "native"},
    }
    problem, solution = solved(changed(tumbling), label="b_dot")
    V = problem.loop.tracking(problem.times, solution.states).V[0]
    state, last, found, h = [1.0, 0.0, 0.0, 0.0, *rate], None, [rate], 0.05
    for tick in range(10 * duration):
        B = field(0.1 * tick).tolist()
        here, m = rotated(*state[:4], B), (0.0, 0.0, 0.0)
        if last is not None:
            asked = [-k * (new - old) / 0.1 for new, old in zip(here, last, strict=True)]
            m = [min(0.2, max(-0.2, each)) for each in asked]
        last = here
        for _ in range(2):
            slopes, weight = [rates_of(state, B, m, inertia)], (h / 2, h / 2, h)
            for step in weight:
                moved = [x + step * dx for x, dx in zip(state, slopes[-1], strict=True)]
                slopes.append(rates_of(moved, B, m, inertia))
            sums = [(a + 2 * b + 2 * c + d) / 6 for a, b, c, d in zip(*slopes, strict=True)]
            state = [x + h * dx for x, dx in zip(state, sums, strict=True)]
        if tick % 10 == 9:
            found.append(state[4:])
    sizes = (np.degrees(np.linalg.norm(each, axis=-1)) for each in (V, found))
    settled, plain = (np.flatnonzero(size > 1.0)[-1] for size in sizes)
    assert 100 < plain < duration - 100
    assert settled == pytest.approx(plain, rel=0.01)


@from_yaml
def test_what_is_wrong_is_said_at_its_place(experiment_of, changes, said):
    assert mentions(refusal(ConfigError, experiment_of, changed(yaml.safe_load(changes))), said)
