"""Laws that are told less than the whole reference: against plain programs, and what is refused."""

import numpy as np
import pytest
import yaml
from case_tables import from_yaml
from plain_quadrotor import flown, of_heading, parts_of, rows_of
from said import mentions

from eqt_cli.extend import EqtError
from eqt_cli.loop.law_program import law_program
from eqt_cli.loop.linearised import linearised

J, MASS, PERIOD, STEPS = [0.02, 0.021, 0.04], 1.2, 0.01, 60
UP = np.array([0.0, 0.0, 1.0])
KX, KV, KR, KW = np.array([6.0, 5.0, 8.0]), 3.5, 1.6, 0.3
LAW = {
    "kind": "cascade",
    "attitude": "lee2010",
    "position": {"kx": KX.tolist(), "kv": KV},
    "gains": {"k_R": KR, "k_Omega": KW},
    "along": [0, 0, 1],
    "rates": "none",
}
QUADROTOR = {
    "group": "SE3",
    "inertia": [*J, MASS, MASS, MASS],
    "model": {"forces": [{"kind": "restoring", "weight": MASS * 9.81}]},
    "reference": {
        "kind": "flat",
        "position": ["sin(t)", "cos(2*t) - 1", "0.3*t"],
        "heading": "0.4*t",
    },
    "controllers": [LAW],
    "control": {"period": PERIOD},
    "initial": {"pose": {"kind": "exp_normal", "std": 0.1}},
    "ensemble": {"runs": 1, "seed": 1},
    "time": {"duration": PERIOD * STEPS, "samples": STEPS + 1},
    "solver": {"rtol": 1e-12, "atol": 1e-13},
}
POINTS = [(0.0, [0, 0, 0], 0.0), (0.2, [0.3, 0, 0.1], 0.3), (0.35, [0.3, -0.2, 0.1], -0.2)]


def with_law(law=None, **changes):
    return {**QUADROTOR, "controllers": [{**LAW, **(law or {})}], **changes}


def along_path(t, order):
    p = np.array([np.sin(t), np.cos(2 * t) - 1, 0.3 * t])
    v = np.array([np.cos(t), -2 * np.sin(2 * t), 0.3])
    a = np.array([-np.sin(t), -4 * np.cos(2 * t), 0.0])
    return p, v * (order > 0), a * (order > 1), 0.4 * t


def held(t, order):
    _, p, psi = [point for point in POINTS if point[0] <= t + 1e-9][-1]
    return np.array(p, float), np.zeros(3), np.zeros(3), psi


def by_hand(setpoint, order):
    def law(t, p, v, R, w):
        pd, vd, ad, psi = setpoint(t, order)
        F = MASS * (ad + 9.81 * UP - KX * (p - pd) - KV * (v - vd))
        E = of_heading(F, psi).T @ R
        E = E - E.T
        e = np.array([E[2, 1], E[0, 2], E[1, 0]]) / 2
        return np.array([*(-KR * e - KW * w + np.cross(w, J * w)), F @ R[:, 2]])

    return law


@pytest.mark.ci("a plain program integrates 60 periods")
@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
@pytest.mark.parametrize("told", ["position", "velocity", "full", "held"])
def test_laws_fly_what_they_are_told_as_a_plain_program_does(solved, told, engine):
    config = with_law({} if told == "held" else {"setpoint": told})
    setpoint, order = along_path, ["position", "velocity", "full", "held"].index(told)
    if told == "held":
        points = [{"t": t, "position": p, "heading": psi} for t, p, psi in POINTS]
        config["reference"], setpoint = {"kind": "setpoints", "points": points}, held
    config["solver"] = {**config["solver"], "engine": engine}
    problem, solution = solved(yaml.safe_dump(config), "cascade")
    rows = rows_of(problem, solution.states[0])
    body = {"J": J, "mass": MASS, "axis": [0, 0, 1]}
    times = {"period": PERIOD, "steps": STEPS}
    states = flown(by_hand(setpoint, order), *parts_of(rows[0]), **times, **body)
    assert np.abs(states[-1, :3] - states[0, :3]).max() > 0.05
    np.testing.assert_allclose(rows, states, rtol=0, atol=1e-10)


def test_a_told_law_is_one_whose_reference_stands_still(experiment_of):
    """For all groups: V_d and V̇_d are 0, and the pose is the same."""
    config = {
        "group": "SO3",
        "inertia": [1, 1.2, 1.5],
        "gains": {"kp": 2.0, "kd": 1.0},
        "reference": {"kind": "rates", "rates": ["0.3*t", 0.2, "sin(t)"]},
        "controllers": [
            {"kind": "eqt", "label": name, "setpoint": name}
            for name in ("position", "velocity", "full")
        ],
        "time": {"duration": 1},
    }
    one = experiment_of(yaml.safe_dump(config))
    random, loop = np.random.default_rng(1), one.loops["full"]
    G = one.group
    Q, Qd = G.exp(random.standard_normal((2, 20, 3)))
    V, Vd = random.standard_normal((2, 20, 3))
    s = loop.tracking(0.7, loop.initial_state(Q, V, Qd, Vd))
    still, even = s.following(0 * s.Vd, 0 * s.Vd), s.following(s.Vd, 0 * s.Vd)
    for name, expected in (("position", still), ("velocity", even), ("full", s)):
        torque = one.loops[name].command(s)
        np.testing.assert_allclose(torque, loop.law.torque(expected), rtol=0, atol=1e-13)
        assert (one.loops[name].claims_decrease is True) == (name == "full")
        assert (one.loops[name].dissipation(s) is None) == (name != "full")


def test_the_exported_law_reads_no_derivatives_of_the_reference(experiment_of):
    config = with_law({"setpoint": "position"})
    program = law_program(experiment_of(yaml.safe_dump(config)).loops["cascade"])
    names = {entry.name for entry in program.inputs}
    assert "position" in names
    assert not {name for name in names if name.startswith("desired_")}


def test_the_margins_are_those_of_the_loop_about_its_setpoint(experiment_of):
    """At rest all setpoints are the same, so that their loops are."""
    at_rest = {"reference": {"kind": "flat", "position": [0, 0, 1]}}
    poles = []
    for told in ("position", "full"):
        one = experiment_of(yaml.safe_dump(with_law({"setpoint": told}, **at_rest)))
        loop = one.loops["cascade"]
        Q = np.eye(4)[None]
        closed = linearised(loop, np.zeros(1), Q, np.zeros((1, 6))).closed
        poles.append(np.sort_complex(np.linalg.eigvals(closed[0])))
    np.testing.assert_allclose(*poles, rtol=0, atol=1e-7)


@from_yaml
def test_what_no_setpoint_is_is_refused(experiment_of, tmp_path, changes, message):
    changes = yaml.safe_load(changes)
    (tmp_path / "a.csv").write_text(changes.pop("table", ""))
    law = {**LAW, **changes.pop("law", {})}
    if law["kind"] != "cascade":
        law = {key: x for key, x in law.items() if key not in {*LAW} - {"kind"}}
    config = {**QUADROTOR, "controllers": [law], **changes}
    with pytest.raises(EqtError) as caught:
        experiment_of(yaml.safe_dump(config))
    assert mentions(str(caught.value), message)


def test_setpoints_of_a_file_are_those_of_points(experiment_of, tmp_path):
    rows = [f"{t},{p[0]},{p[1]},{p[2]},{psi}" for t, p, psi in POINTS]
    (tmp_path / "a.csv").write_text("\n".join(["time,px,py,pz,heading", *rows]))
    columns = {"t": "time", "x": "px", "y": "py", "z": "pz"}
    points = [{"t": t, "position": p, "heading": psi} for t, p, psi in POINTS]
    motions = []
    for options in ({"file": "a.csv", "columns": columns}, {"points": points}):
        config = with_law(reference={"kind": "setpoints", **options})
        one = experiment_of(yaml.safe_dump(config))
        reference, G = one.loops["cascade"].reference, one.group
        assert reference.instants(G, 1.0).tolist() == [0.0, 0.2, 0.35]
        motions.append(np.stack([reference.motion(G, t)[0] for t in (0.1, 0.2, 0.3, 0.5)]))
    np.testing.assert_array_equal(*motions)
    np.testing.assert_allclose(motions[0][3, :3, 3], [0.3, -0.2, 0.1])
