"""A payload that joins: closed forms of what it does, and what is refused."""

import numpy as np
import pytest
import yaml
from case_tables import refusal
from said import mentions
from scipy.integrate import solve_ivp

from eqt_cli.base.errors import ConfigError
from eqt_cli.extend import group_named
from eqt_cli.extensions.disturbances.payload import Payload

pytestmark = pytest.mark.needs("disturbances")
J, M, MASS, POINT, SINCE, G = np.diag([0.02, 0.03, 0.04]), 0.8, 0.3, [0.1, -0.05, -0.2], 0.37, 9.81
OVER = 0.02
PAYLOAD = {"kind": "payload", "mass": MASS, "at": POINT, "since": SINCE, "over": OVER}
FREE = {
    "group": "SE3",
    "inertia": [*np.diag(J).tolist(), M, M, M],
    "gains": {"kp": 1e-14, "kd": 1e-14},  # nothing but the weight acts
    "controllers": ["eqt"],
    "reference": {"kind": "constant"},
    "initial": {
        "pose": {"kind": "exp_normal", "std": 0.0, "centre": [0.3, -0.2, 0.5, 1, 2, 3]},
        "velocity": {"kind": "fixed", "coordinates": [1.0, 2.0, -0.5, 2.0, -1.0, 3.0]},
    },
    "time": {"duration": 1.0, "samples": 11},
}


def momenta(s, masses):
    """Linear and angular momentum about the origin of space, of both by their point velocities."""
    Q, V = s.Q[0], s.V[0]
    R, p, omega = Q[:, :3, :3], Q[:, :3, 3], V[:, :3]
    v = (R @ V[:, 3:, None])[..., 0]
    turn = (R @ np.cross(omega, POINT)[..., None])[..., 0]
    there, moves = p + R @ POINT, v + turn
    linear = M * v + masses[:, None] * moves
    spin = (R @ (J @ omega[..., None]))[..., 0] + M * np.cross(p, v)
    return linear, spin + masses[:, None] * np.cross(there, moves)


@pytest.mark.ci("runs of both engines")
@pytest.mark.parametrize(
    ("engine", "gravity"), [("solve_ivp", 1e-12), ("native", 1e-12), ("native", G)]
)
def test_the_momentum_is_kept_as_it_joins(solved, engine, gravity):
    """Both momenta without a weight; with it, p(t) = p(0) − ∫ g (M + m s(t)) dt."""
    weight = {"kind": "restoring", "weight": M * gravity}
    solver = {"engine": engine, "rtol": 1e-12, "atol": 1e-13}
    forces = {"forces": [weight, PAYLOAD | {"gravity": gravity}]}
    problem, solution = solved(yaml.safe_dump(FREE | {"solver": solver, "plant": forces}))
    t = problem.times
    masses = MASS * (t > SINCE)
    linear, angular = momenta(problem.loop.tracking(t, solution.states), masses)
    fallen = M * t + MASS * np.clip(t - SINCE - OVER / 2, 0.0, None)
    expected = linear[0] - gravity * np.outer(fallen, [0, 0, 1])
    np.testing.assert_allclose(linear, expected, rtol=0, atol=1e-9)
    if gravity != G:
        np.testing.assert_allclose(angular, angular[[0] * len(t)], rtol=0, atol=1e-9)


RELEASED = {
    "mass": {"uniform": [0.2, 0.4]},
    "at": [0.1, {"uniform": [-0.1, 0.1]}, -0.2],
    "since": {"uniform": [0.2, 0.4]},
    "lasts": 0.2,
}


@pytest.mark.ci("runs of both engines")
@pytest.mark.parametrize("engine", ["solve_ivp", "native"])
def test_a_payload_with_drawn_numbers_joins_and_leaves_with_its_momentum(solved, engine):
    """The body turns by Euler's equation with the momenta of both, and alone from its velocity."""
    solver = {"engine": engine, "rtol": 1e-12, "atol": 1e-13}
    plant = {"forces": [PAYLOAD | RELEASED | {"gravity": 1e-14}]}
    text = FREE | {"solver": solver, "plant": plant, "ensemble": {"runs": 3, "seed": 5}}
    problem, solution = solved(yaml.safe_dump(text))
    t, numbers = problem.times, problem.leaves_of_runs()
    for run in range(3):
        since, until, mass = (
            numbers[f"vehicle.forces[0].{name}"][run].item()
            for name in ("presence.since", "presence.until", "weight.weight")
        )
        point = numbers["vehicle.forces[0].weight.centre_of_mass"][run]
        V, times = by_hand(t, since, until, mass / 1e-14, point)
        s = problem.loop.tracking(t, solution.states)
        np.testing.assert_allclose(s.V[run][times], V, rtol=0, atol=1e-10)


def by_hand(t, since, until, mass, point):
    """V before, with, and after the mass; rows of the samples outside of the time of joining."""
    V, begin, found, rows = np.array([1.0, 2.0, -0.5, 2.0, -1.0, 3.0]), 0.0, [], []
    lever = np.array([[0, -point[2], point[1]], [point[2], 0, -point[0]], [-point[1], point[0], 0]])
    moved = np.hstack([-lever, np.eye(3)])
    body = np.block([[J, np.zeros((3, 3))], [np.zeros((3, 3)), M * np.eye(3)]])
    load = mass * moved.T @ moved

    def rate(time, V):
        x = np.clip((time - since) / OVER, 0, 1)
        share = x * x * (3 - 2 * x) * (time < until)
        slope = 6 * x * (1 - x) / OVER
        inertia = body + share * load
        P, omega, v = inertia @ V, V[:3], V[3:]
        turned = [*(np.cross(P[:3], omega) + np.cross(P[3:], v)), *np.cross(P[3:], omega)]
        return np.linalg.solve(inertia, turned - slope * load @ V)

    for end in (since, since + OVER, until, t[-1] + 1e-9):
        here = (t >= begin) & (t < end)
        path = solve_ivp(
            lambda time, V, end=end: rate(min(time, end - 1e-12), V),
            (begin, end), V, method="DOP853", t_eval=[*t[here], end], rtol=1e-13, atol=1e-14,
        )  # fmt: skip
        found.append(path.y[:, :-1].T)
        rows.append(here)
        V, begin = path.y[:, -1], end
    return np.concatenate(found), np.any(rows, axis=0)


def test_it_is_there_from_the_start_where_no_time_is_given(experiment):
    """𝕀 of both about the origin, by hand, on top of an inertia that a run draws."""
    forces = "[{kind: payload, mass: 0.3, at: [0.1, -0.05]}]"
    loop = experiment(
        group="SE2",
        inertia="[0.02, 0.8, 0.8]",
        reference="{kind: constant}",
        plant=f"{{inertia: {{relative: 0.5}}, forces: {forces}}}",
    ).loops["eqt"]
    found = loop.vehicle.inertia.at(loop.inertia.at(0.0), 0.0).matrix
    x, y = 0.1, -0.05
    load = 0.3 * np.array([[x * x + y * y, -y, x], [-y, 1, 0], [x, 0, 1]])
    np.testing.assert_allclose(found, 1.5 * np.diag([0.02, 0.8, 0.8]) + load, atol=1e-15)


def test_a_true_inertia_does_not_jump_and_its_pieces_are_instants(experiment):
    """At a jump of 𝕀, runs would keep V in place of 𝕀V."""

    def plant(entry, leaves="null"):
        matrix = f"[['2 + {entry}', 0, 0], [0, 2, 0], [0, 0, 3]]"
        return f"{{inertia: {{matrix: {matrix}, leaves: {leaves}}}}}"

    loop = experiment(plant=plant("smoothstep(t, 0.3, 0.4)")).loops["eqt"]
    assert {0.3, 0.4} <= {*loop.instants(1.0)}
    assert 0.3 in experiment(plant=plant("step(t, 0.3)", "true")).loops["eqt"].instants(1.0)
    said = "plant.inertia: jumps at t = 0.3 s…smoothstep…leaves: true…"
    assert mentions(refusal(ConfigError, experiment, plant=plant("step(t, 0.3)")), said)


def test_a_model_jumps_only_where_runs_keep_what_the_body_keeps(experiment):
    """A run keeps 𝕀V of the model: not of a constant true inertia, and not V where mass leaves."""
    matrix = "matrix: [['2 + step(t, 0.3)', 0, 0], [0, 2, 0], [0, 0, 3]]"
    jumping, said = f"{{{matrix}}}", "inertia: jumps at t = 0.3 s…the momentum of…smoothstep…"
    experiment(inertia=jumping)
    experiment(inertia=jumping, plant="{inertia: {relative: 0.5}}")
    assert mentions(
        refusal(ConfigError, experiment, inertia=jumping, plant="{inertia: [2, 2, 3]}"), said
    )
    leaving, said = f"{{{matrix}, leaves: true}}", "inertia: jumps…the velocity of…smoothstep…"
    assert mentions(refusal(ConfigError, experiment, inertia=leaving), said)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("mass: -1", "mass: expected a number greater than 0, got -1"),
        ("mass: {uniform: [0, 1]}", "mass.uniform: expected numbers greater than 0, got 0"),
        ("mass: 1, since: {uniform: [-1, 2]}", "since: expected at least 0 s, got -1 s"),
        ("mass: 1, since: 2, until: 2.005", "until: expected more than 2.01 s…got 2.005 s"),
        ("mass: 1, since: {uniform: [1, 3]}, until: 2", "until: expected more than 3.01 s…`lasts`"),
        ("mass: 1, lasts: 2", "lasts: counts from since…"),
        ("mass: 1, since: 1, until: 2, lasts: 2", "lasts: counts from since…with until…"),
        ("mass: 1, at: [0, 0]", "at: expected 3 numbers, got 2"),
        ("mass: 1, since: -2", "since: expected at least 0 s, got -2 s"),
    ],
)
def test_what_is_no_payload_is_refused(experiment_of, options, said):
    forces = {"forces": [yaml.safe_load(f"{{kind: payload, {options}}}")]}
    text = yaml.safe_dump(FREE | {"plant": forces})
    assert mentions(refusal(ConfigError, experiment_of, text), f"plant.forces[0].{said}")


def test_a_payload_needs_a_place(noted):
    for name in ("SO3", "R3", "SE23"):
        said = f"needs group SE2 or SE3, got {name}"
        assert noted(Payload(0.1), group_named(name)) == [("", said)]


def test_a_mass_that_leaves_keeps_no_momentum(experiment_of):
    inertia = {"matrix": [["1" if i == k else "0" for i in range(6)] for k in range(6)]}
    plant = {"inertia": inertia | {"leaves": True}, "forces": [PAYLOAD]}
    said = "plant.forces[0]: keeps the momentum…leaves: false…"
    assert mentions(
        refusal(ConfigError, experiment_of, yaml.safe_dump(FREE | {"plant": plant})), said
    )
