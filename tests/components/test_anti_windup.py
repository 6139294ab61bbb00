"""Anti-windup of laws with an integral: against plain programs, and what is said of it."""

from functools import cache

import numpy as np
import pytest
import yaml
from plain import hat
from scipy.integrate import solve_ivp

from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.extend import group_named
from eqt_cli.loop.linearised import off_limits

KINDS = {"none": "none", "clamp": "clamp", "back": {"back_calculation": 0.5}}
T = 0.5
native = pytest.param("native", marks=pytest.mark.ci("compiles the law"))


# A body that turns: a plain program on SO(3) ------------------------------------------------------


J, K, KD, KI, C2, MOST = np.diag([1.0, 1.2, 1.5]), 2.0, 4.0, 1.0, 2.0, 0.5
START = [1.5, 0.3, -0.2]
TIMES = np.linspace(0.0, 2.0, 11)


def turn(kind, engine, period=None):
    law = {"kind": "goodarzi2013", "ki": KI, "c2": C2, "anti_windup": KINDS[kind]}
    config = {
        "group": "SO3",
        "inertia": np.diag(J).tolist(),
        "gains": {"kp": K, "kd": KD},
        "reference": {"kind": "constant"},
        "controllers": [law],
        "actuators": [{"kind": "limit", "limit": MOST}],
        "initial": {
            "pose": {"kind": "exp_normal", "std": 0.0, "centre": START},
            "velocity": {"kind": "fixed", "coordinates": [0, 0, 0]},
        },
        "ensemble": {"runs": 1},
        "time": {"duration": 2.0, "samples": len(TIMES)},
        "solver": {"engine": engine, "rtol": 1e-12},
    }
    return config | ({"control": {"period": period}} if period else {})


def asked(R, w, integral):
    """−k_R e_R − k_Ω ω − k_I e_I with k_R = 2 K, and e_R."""
    e = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return -2 * K * e - KD * w - KI * integral, e


def switches(y):
    """Beyond the upper limit, above the lower one, and growing, of each axis: above 0."""
    u, e = asked(y[:9].reshape(3, 3), y[9:12], y[12:])
    return np.concatenate([u - MOST, u + MOST, y[9:12] + C2 * e])


def going(kind, y, sides):
    """The torque and the rate of the integral, by the sides of the switches."""
    w, (u, e) = y[9:12], asked(y[:9].reshape(3, 3), y[9:12], y[12:])
    torque, rate = u.copy(), w + C2 * e
    for k in range(3):
        above, below = sides[k] > 0, sides[3 + k] < 0
        torque[k] = MOST if above else -MOST if below else u[k]
        if kind == "clamp" and ((above and sides[6 + k] < 0) or (below and sides[6 + k] > 0)):
            rate[k] = 0.0  # it would go further beyond the limit
        elif kind == "back":
            rate[k] += (u[k] - torque[k]) / (KI * T)
    return torque, rate


def moving(_, y, torque, rate=(0.0, 0.0, 0.0)):
    R, w = y[:9].reshape(3, 3), y[9:12]
    w_dot = np.linalg.solve(J, np.cross(J @ w, w) + torque)
    return np.concatenate([(R @ hat(w)).ravel(), w_dot, rate])


EXACT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}


def switched(field, switches, y, times):
    """From one switch to the next, so that the field is smooth in between."""
    sides, found, t = np.sign(switches(y)), [y], times[0]
    for end in times[1:]:
        while t < end:
            events = []
            for k, side in enumerate(sides):
                events.append(lambda t, y, k=k: switches(y)[k])
                events[k].terminal, events[k].direction = True, -side
            got = solve_ivp(lambda t, y: field(y, sides), (t, end), y, events=events, **EXACT)
            t, y = got.t[-1], got.y[:, -1]
            for k, at in enumerate(got.t_events):
                sides[k] *= -1 if len(at) else 1
        found.append(y)
    return np.array(found)


@cache
def flown(kind, period):
    start = group_named("SO3").exp(np.array(START))
    y = np.concatenate([start.ravel(), np.zeros(6)])
    if period is None:
        return switched(lambda y, at: moving(0, y, *going(kind, y, at)), switches, y, TIMES)
    found = [y]
    for _ in TIMES[1:]:
        for _ in range(round((TIMES[1] - TIMES[0]) / period)):
            torque, rate = going(kind, y, np.sign(switches(y)))
            integral = y[12:] + period * rate
            y = solve_ivp(moving, (0, period), y, args=(torque,), **EXACT).y[:, -1]
            y[12:] = integral
        found.append(y)
    return np.array(found)


@pytest.mark.parametrize("engine", ["solve_ivp", native])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("period", [None, 0.02])
def test_a_turn_is_that_of_a_plain_program(solved, kind, engine, period):
    problem, solution = solved(yaml.safe_dump(turn(kind, engine, period)), "goodarzi2013")
    s, expected = problem.loop.tracking(TIMES, solution.states), flown(kind, period)
    np.testing.assert_allclose(s.Q[0].reshape(-1, 9), expected[:, :9], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.V[0], expected[:, 9:12], rtol=0, atol=1e-9)
    # At an instant, a sample has the values after it, which the plain program computes next.
    if period is None:
        np.testing.assert_allclose(s.memory["integral"][0], expected[:, 12:], rtol=0, atol=1e-9)


def test_within_the_limits_nothing_changes(solved):
    """The same bits."""
    free = turn("none", "solve_ivp") | {"actuators": [{"kind": "limit", "limit": 100}]}
    states = [
        solved(
            yaml.safe_dump({**free, "controllers": [{**free["controllers"][0], **more}]}),
            "goodarzi2013",
        )[1].states
        for more in ({}, {"anti_windup": "clamp"}, {"anti_windup": {"back_calculation": 1}})
    ]
    np.testing.assert_array_equal(states[1], states[0])
    np.testing.assert_array_equal(states[2], states[0])


# A quadrotor that climbs: a plain program along the vertical, and at single states ----------------


M, WEIGHT, KX, KV, KI3, TOP = 0.5, 4.905, 4.0, 4.0, 2.0, 6.0  # 6 N of thrust
PLACES = [[0.1, 0.1, 0], [0.1, -0.1, 0], [-0.1, -0.1, 0], [-0.1, 0.1, 0]]


def climb(kind, engine, period=None, inside="lee2010"):
    position = {"kx": KX, "kv": KV, "ki": KI3, "anti_windup": KINDS[kind]}
    rotors = [
        {"at": at, "along": [0, 0, 1], "turns": 0.02 * (-1) ** k} for k, at in enumerate(PLACES)
    ]
    gains = {"kp": 0.4, "kd": 0.1}
    config = {
        "group": "SE3",
        "inertia": [4e-3, 4e-3, 7e-3, M, M, M],
        "model": {"forces": [{"kind": "restoring", "weight": WEIGHT}]},
        "plant": {"forces": [{"kind": "restoring", "weight": WEIGHT}]},
        "reference": {"kind": "flat", "position": [0, 0, 0], "heading": 0},
        "controllers": [
            {"kind": "cascade", "attitude": inside, "position": position, "gains": gains}
        ],
        "actuators": [{"kind": "thrusters", "thrusters": rotors, "low": 0, "high": TOP / 4}],
        "initial": {"pose": {"kind": "exp_normal", "std": 0.0, "centre": [0, 0, 0, 0, 0, -2]}},
        "ensemble": {"runs": 1},
        "time": {"duration": 2.0, "samples": len(TIMES)},
        "solver": {"engine": engine, "rtol": 1e-12},
    }
    config["initial"]["velocity"] = {"kind": "fixed", "coordinates": [0] * 6}
    return config | ({"control": {"period": period}} if period else {})


@cache
def climbed(kind):
    def push(y):
        return M * (-KX * y[0] - KV * y[1] - KI3 * y[2]) + WEIGHT

    def field(y, sides):
        above, below, e = sides[0] > 0, sides[1] < 0, y[0]
        f = TOP if above else 0.0 if below else push(y)
        if kind == "clamp" and ((above and e < 0) or (below and e > 0)):
            e = 0.0
        elif kind == "back":
            e += (push(y) - f) / M / (KI3 * T)
        return np.array([y[1], (f - WEIGHT) / M, e])

    return switched(
        field, lambda y: np.array([push(y) - TOP, push(y), y[0]]), np.array([-2.0, 0, 0]), TIMES
    )


@pytest.mark.needs("underactuated", "thrusters")
@pytest.mark.parametrize("engine", ["solve_ivp", native])
@pytest.mark.parametrize("kind", KINDS)
def test_a_climb_is_that_of_a_plain_program(solved, kind, engine):
    problem, solution = solved(yaml.safe_dump(climb(kind, engine)), "cascade")
    s, expected = problem.loop.tracking(TIMES, solution.states), climbed(kind)
    np.testing.assert_allclose(s.Q[0, :, 2, 3], expected[:, 0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.V[0, :, 5], expected[:, 1], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.memory["integral"][0, :, 2], expected[:, 2], rtol=0, atol=1e-9)


@pytest.mark.needs("underactuated", "thrusters")
@pytest.mark.parametrize("kind", ["clamp", "back"])
def test_both_integrals_of_a_cascade_are_told_of_limits_at_an_instant(experiment_of, kind):
    """By thrusts of the pseudo-inverse that are cut off, at states with and without limits."""
    inside = {"kind": "goodarzi2013", "ki": 0.05, "c2": 0.7, "anti_windup": KINDS[kind]}
    config = climb(kind, "solve_ivp", 0.01, inside)
    [loop] = experiment_of(yaml.safe_dump(config)).loops.values()
    random = np.random.default_rng(4)
    size = np.linspace(0.01, 1, 40)[:, None]
    z = 0.3 * size * random.standard_normal((40, loop.state_length))
    z[:, :12] = loop.group.pack(loop.group.exp(0.5 * size * random.standard_normal((40, 6))))
    z[:, 12:15] *= 4e-3  # the momentum of the turn
    s = loop.tracking(0.0, z)
    law, free = loop.law, off_limits(loop).law
    command, later = law.answer(s, 0.01)
    _, plain = free.answer(loop.tracking(0.0, z), 0.01)
    B = np.array([[at[1], -at[0], 0.02 * (-1) ** k, 0, 0, 1] for k, at in enumerate(PLACES)]).T
    f = command @ np.linalg.pinv(B).T
    x = (f - np.clip(f, 0, TOP / 4)) @ B.T
    told = 0
    for run in range(40):
        rate = {name: (plain[name] - s.memory[name])[run] / 0.01 for name in plain}
        b = s.Q[run, :3, 2]
        along, cut = rate["integral"] @ b, x[run, 5] / M
        turning = rate["attitude_integral"].copy()
        if kind == "back":
            new, turning = along + cut / (KI3 * T), turning + x[run, :3] / (0.05 * T)
        else:
            new = 0.0 if cut * along < 0 else along
            turning[x[run, :3] * turning < -1e-20] = 0.0
        expected = {"integral": rate["integral"] + (new - along) * b, "attitude_integral": turning}
        told += bool(np.abs(x[run]).any()) and abs(new - along) > 1e-6
        for name, of in expected.items():
            np.testing.assert_allclose(
                later[name][run], s.memory[name][run] + 0.01 * of, rtol=0, atol=1e-12
            )
    assert 5 < told < 40


# What is said of it -------------------------------------------------------------------------------


@pytest.mark.needs("proofs")
def test_the_energy_balance_holds_with_an_anti_windup_and_no_more_is_claimed(tmp_path):
    """Beyond the limits, too: the rate of L counts the change of the integral."""
    from eqt_cli.extensions.proofs.certificates import Verdict
    from eqt_cli.extensions.proofs.verification import verify_experiment

    path = tmp_path / "turn.yaml"
    for kind in KINDS:
        path.write_text(
            yaml.safe_dump(turn(kind, "solve_ivp") | {"time": {"duration": 3, "samples": 31}})
        )
        rows = verify_experiment(build(read_config(path))).rows
        found = {row.name: row.verdict for row in rows}
        assert found["energy balance"] is Verdict.HOLDS, kind
        assert found["decrease of L"] is Verdict.NOT_COVERED, kind


def test_margins_are_those_off_the_limits(invoke, tmp_path):
    path, said = tmp_path / "turn.yaml", {}
    for kind in KINDS:
        path.write_text(yaml.safe_dump(turn(kind, "solve_ivp")))
        said[kind] = " ".join(invoke("margins", path).stdout.split())
    assert "the anti-windup (the loop is that off its limits)" in said["clamp"]
    assert "anti-windup" not in said["none"]
    first = [text.split("Goodarzi 2013", 1)[1][:40] for text in said.values()]
    assert first[0] == first[1] == first[2]


# Gains of an integral for each axis ---------------------------------------------------------------

SPREAD = np.array([0.1, 0.3, 0.8])


def random_state(loop):
    """A state of a loop at which nothing is 0, with its integral."""
    random = np.random.default_rng(3)
    G = loop.group
    Q, Qd = G.exp(0.4 * random.normal(size=(2, G.dimension)))
    V, Vd = random.normal(size=(2, G.dimension))
    state = loop.initial_state(Q, V, Qd, Vd)
    z = loop.layout.slices["controller.integral"]
    state[..., z] = random.normal(size=z.stop - z.start)
    return loop.tracking(0.3, state)


def test_each_axis_has_its_own_gain_of_the_integral(experiment_of):
    entry = {"kind": "goodarzi2013", "c2": 0.4}
    config = turn("none", "native") | {
        "controllers": [entry | {"ki": SPREAD.tolist()}, entry | {"ki": 0.2, "label": "one"}]
    }
    loops = experiment_of(yaml.safe_dump(config)).loops
    spread, one = (random_state(loops[label]) for label in ("goodarzi2013", "one"))
    z = spread.memory["integral"]
    apart = loops["goodarzi2013"].law.torque(spread) - loops["one"].law.torque(one)
    np.testing.assert_allclose(apart, -(SPREAD - 0.2) * z, rtol=0, atol=1e-14)
    stored = loops["goodarzi2013"].lyapunov(spread) - loops["one"].lyapunov(one)
    np.testing.assert_allclose(stored, (SPREAD - 0.2) @ z**2 / 2, rtol=0, atol=1e-14)


@pytest.mark.needs("underactuated", "thrusters")
def test_the_position_loop_may_have_an_integral_along_one_axis_only(experiment_of):
    config = climb("none", "native")
    [law] = config["controllers"]
    c1 = np.array([0.5, 1.0, 2.0])
    position = law["position"] | {"ki": [0.0, 0.0, 0.9]}
    config["controllers"] = [
        law | {"position": position | {"c1": c1.tolist()}, "rates": "none", "label": "z"},
        law | {"position": position | {"ki": 0.4}, "rates": "none", "label": "alike"},
    ]
    loops = experiment_of(yaml.safe_dump(config)).loops
    z, alike = (random_state(loops[label]) for label in ("z", "alike"))
    inside = loops["z"].law.commanded(z)
    apart = inside.acceleration - loops["alike"].law.commanded(alike).acceleration
    expected = (0.4 - np.array([0.0, 0.0, 0.9])) * z.memory["integral"]
    np.testing.assert_allclose(apart, expected, rtol=0, atol=1e-14)
    p, v = z.Q[:3, 3], z.Q[:3, :3] @ z.V[3:]  # the reference rests at 0
    np.testing.assert_allclose(inside.integrand, v + c1 * p, rtol=0, atol=1e-14)
