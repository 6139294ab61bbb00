"""A current and the added mass, against Fossen's equations and against Galilei."""

import numpy as np
import plain_current as plain
import pytest
import yaml
from case_tables import in_ci
from said import says
from scipy.linalg import solve_continuous_are
from scipy.optimize import root
from scipy.spatial.transform import Rotation

import eqt_cli
from eqt_cli.base.errors import ConfigError
from eqt_cli.components.forces import Drag, Restoring, in_currents
from eqt_cli.config.remarks import remarks
from eqt_cli.extend import Inertia, group_named

SE2, SE3 = group_named("SE2"), group_named("SE3")
TOLERANCE = 1e-7
"""Of both programs: their relative tolerances are 1e-10 and 1e-11, over up to 20 s."""

BODY, WATER = [0.16, 0.16, 0.16, 11.5, 11.5, 11.5], [0.12, 0.12, 0.12, 5.5, 12.7, 14.57]
DRAG = [0.07, 0.07, 0.07, 4.03, 6.22, 5.18]
STILL = [0.0] * 6

# A boat whose centre of mass and centre of added mass are beside its origin.
BOAT = [[3.0, 0.0, 2.0], [0.0, 20.0, 0.0], [2.0, 0.0, 20.0]]
SEA = [[1.5, 0.0, -1.2], [0.0, 2.0, 0.0], [-1.2, 0.0, 14.0]]
FLOATING = [[0.3, 0, 0, 0, -0.23, 0.1], [0, 0.4, 0, 0.23, 0, 0], [0, 0, 0.35, -0.1, 0, 0]]
FLOATING += [[0, 0.23, -0.1, 11.5, 0, 0], [-0.23, 0, 0, 0, 11.5, 0], [0.1, 0, 0, 0, 0, 11.5]]
SWIRL = np.diag(WATER) + 0.05 * (np.eye(6, k=2) + np.eye(6, k=-2))
CASES = {
    "from rest": {
        "group": "SE3",
        "rigid": BODY,
        "added": WATER,
        "drag": {"linear": DRAG, "current": [0.4, 0.3, 0]},
        "start": (STILL, STILL),
        "duration": 20.0,
    },
    "boat": {
        "group": "SE2",
        "rigid": BOAT,
        "added": SEA,
        "drag": {"linear": [1, 2, 3], "quadratic": [2, 5, 30], "current": [-0.5, 0.8]},
        "start": ([0.9, 1.0, -2.0], [0.3, 0.7, -0.2]),
        "duration": 10.0,
    },
    "tide": {
        "group": "SE3",
        "rigid": FLOATING,
        "added": SWIRL.tolist(),
        "drag": {"linear": DRAG, "current": ["0.6*sin(t)", "0.3 + 0.2*cos(2*t)", "0.1*t"]},
        "restoring": {
            "weight": 112.8,
            "buoyancy": 114.8,
            "centre_of_mass": [0.0, 0.01, 0.02],
            "centre_of_buoyancy": [0.02, 0.0, -0.01],
        },
        "start": ([0.3, -0.4, 0.9, 1, 2, 3], [0.4, 0.2, -0.3, 0.5, -0.2, 0.1]),
        "duration": 5.0,
    },
}
TIDE = (
    lambda t: np.array([0.6 * np.sin(t), 0.3 + 0.2 * np.cos(2 * t), 0.1 * t]),
    lambda t: np.array([0.6 * np.cos(t), -0.4 * np.sin(2 * t), 0.1]),
)


def in_space(M):
    """A matrix of the plane as one of space, with the coordinates (ω, vx, vy) as 2, 3 and 4."""
    M = np.asarray(M, dtype=float)
    whole, at = np.eye(6), np.ix_([2, 3, 4], [2, 3, 4])
    whole[at] = np.diag(M) if M.ndim == 1 else M
    return whole


def program(case, **more):
    drag, planar = case["drag"], case["group"] == "SE2"
    constant = np.append(drag["current"], 0.0)[:3] if case != CASES["tide"] else None
    flow, rate = TIDE if constant is None else (lambda t: constant, lambda t: 0 * constant)
    found = [case["rigid"], case["added"], drag["linear"], drag.get("quadratic", 0)]
    if planar:
        found = [in_space(M) for M in found]
        found[1] = found[1] - np.diag([1, 1, 0, 0, 0, 1])
    found[3] = np.zeros((6, 6)) if np.ndim(found[3]) == 0 else found[3]
    if restoring := case.get("restoring"):
        more |= {"weight": restoring["weight"], "buoyancy": restoring["buoyancy"]}
        more |= {"at_weight": restoring["centre_of_mass"], "at": restoring["centre_of_buoyancy"]}
    return plain.Vehicle(*found, flow, rate, **more)


def config(case, **changes):
    pose, velocity = case["start"]
    forces = [{"kind": "drag", **case["drag"]}]
    if "restoring" in case:
        forces.append({"kind": "restoring", **case["restoring"]})
    return {
        "task": "stabilise",
        "group": case["group"],
        "inertia": {"rigid": case["rigid"], "added": case["added"]},
        "gains": {"kp": 1e-13, "kd": 1e-13},  # as good as no control
        "target": {"pose": "identity"},
        "controllers": [{"kind": "stabilising", "feedforward": False}],
        "plant": {"forces": forces},
        "initial": {
            "pose": {"kind": "exp_normal", "std": 0.0, "centre": pose},
            "velocity": {"kind": "fixed", "coordinates": velocity},
        },
        "time": {"duration": case["duration"], "samples": 6},
        "solver": {"engine": "solve_ivp", "rtol": 1e-10},
    } | changes


NATIVE = pytest.param("native", marks=pytest.mark.ci("compiles the loop"))


@pytest.mark.parametrize("engine", ["solve_ivp", NATIVE])
@pytest.mark.parametrize(
    "name", [in_ci("a boat is tried fast", name, unless=name == "boat") for name in CASES]
)
def test_a_vehicle_in_a_current_moves_by_fossens_equations(solved, name, engine):
    case = CASES[name]
    text = yaml.safe_dump(config(case, solver={"engine": engine, "rtol": 1e-10}))
    problem, solution = solved(text, "stabilising")
    s, n = problem.loop.tracking(problem.times, solution.states), 2 if case["group"] == "SE2" else 3
    start, Q = s.Q[0, 0], s.Q[0]
    R, p, V = np.eye(3), np.zeros(3), np.zeros(6)
    R[:n, :n], p[:n] = start[:n, :n], start[:n, n]
    V[[2, 3, 4] if n == 2 else slice(None)] = case["start"][1]
    R, p, V = program(case).run(R, p, V, problem.times)
    np.testing.assert_allclose(Q[:, :n, :n], R[:, :n, :n], rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(Q[:, :n, n], p[:, :n], rtol=0, atol=TOLERANCE * 10)
    np.testing.assert_allclose(s.V[0], V[:, 2:5] if n == 2 else V, rtol=0, atol=TOLERANCE)
    if name == "from rest":
        heading = np.degrees(np.arctan2(Q[-1, 1, 0], Q[-1, 0, 0]))
        assert heading == pytest.approx(-68.20993, abs=1e-5)
    # The current does work; the balance of L holds as far as the states do.
    loop = problem.loop
    balance = loop.lyapunov(s) + loop.work(solution.states)
    np.testing.assert_allclose(balance[0], balance[0, 0], rtol=0, atol=1e-6)


def test_a_vehicle_that_is_held_in_a_current_needs_a_yaw_moment():
    """Munk's moment, (12.7 − 5.5) · 0.4 · 0.3 N m, at the identity and at rest."""
    drag = Drag(current=[0.4, 0.3, 0]).of_run(SE3, None)
    assert not drag.in_body(SE3, 0.0, np.eye(4), np.zeros(6)).any()
    body = Inertia(np.diag(BODY) + np.diag(WATER), np.eye(6), added=np.diag(WATER))
    [drag] = in_currents(SE3, (drag,), body)
    found = drag.in_body(SE3, 0.0, np.eye(4), np.zeros(6))
    np.testing.assert_allclose(found, [0, 0, -0.864, 0, 0, 0], rtol=0, atol=1e-15)


@pytest.mark.parametrize("frame", ["body", "spatial"])
@pytest.mark.parametrize("G", [SE2, SE3], ids=["SE2", "SE3"])
def test_a_steady_current_is_still_water_seen_from_a_moving_frame(G, frame):
    """The same motion relative to the medium, so d(V − V_c)/dt is V̇ at V − V_c in still water."""
    random, m = np.random.default_rng(3), G.dimension
    n = G.space
    c = random.normal(size=n)
    D = random.normal(size=(2, m, m))
    given = {"linear": D[0].tolist(), "quadratic": D[1].tolist(), "frame": frame}
    rigid, added = (M @ M.T for M in random.normal(size=(2, m, m)))
    rigid[-n:, -n:] = 2.0 * np.eye(n)
    rigid[:-n, :-n] += 30.0 * np.eye(m - n)
    turns = rigid[:-n, -n:]  # of a body: S(r) m
    turns[:] = [[0.6, -0.4]] if n == 2 else np.cross([0.3, -0.2, 0.5], np.eye(3)).T
    rigid[-n:, :-n] = turns.T
    M, whole = rigid + added, Inertia(rigid + added, np.linalg.inv(rigid + added), added=added)
    [moving] = in_currents(G, (Drag(current=c.tolist(), **given).of_run(G, None),), whole)
    still = Drag(**given).of_run(G, None)
    for _ in range(10):
        Q, V = G.exp(random.normal(size=m)), random.normal(size=m)
        flow = G.Ad(G.inverse(Q), np.append(np.zeros(m - n), c))
        slip = V - flow

        def rate(force, W):
            return np.linalg.solve(M, G.ad_star(W, M @ W) + force)

        found = rate(moving.in_body(G, 0.0, Q, V), V) + G.ad(V, flow)
        # A drag of the spatial frame depends on the place, which is the same in both frames now.
        np.testing.assert_allclose(found, rate(still.in_body(G, 0.0, Q, slip), slip), atol=1e-12)


def test_what_floats_moves_with_a_current_that_varies():
    """A neutral body with any added mass has the acceleration of the medium, whatever it is."""
    mass, at = 11.5, [0.1, -0.2, 0.05]
    S = np.cross(at, np.eye(3)).T
    rigid = np.block([[np.eye(3) - mass * S @ S, mass * S], [-mass * S, mass * np.eye(3)]])
    whole = Inertia(rigid + SWIRL, np.linalg.inv(rigid + SWIRL), added=SWIRL)
    drag = Drag(linear=DRAG, current=["sin(t)", "t**2", 0.3]).of_run(SE3, None)
    neutral = 9.80665 * mass
    weight = Restoring(neutral, neutral, centre_of_mass=at, centre_of_buoyancy=at).of_run(SE3, None)
    Q = SE3.exp(np.array([0.4, -0.3, 0.8, 1.0, 2.0, 3.0]))
    t, back = 0.7, Q[:3, :3].T
    V = np.append(np.zeros(3), back @ [np.sin(t), t**2, 0.3])
    forces = in_currents(SE3, (drag, weight), whole)
    force = sum(each.in_body(SE3, t, Q, V) for each in forces)
    found = np.linalg.solve(whole.matrix, SE3.ad_star(V, whole.matrix @ V) + force)
    pushed = np.append(np.zeros(3), back @ [np.cos(t), 2 * t, 0.0])
    np.testing.assert_allclose(found, pushed, rtol=0, atol=1e-13)


def test_still_water_has_the_bits_of_one_matrix(solved):
    case = CASES["boat"] | {"drag": {"linear": [1, 2, 3]}, "duration": 1.0}
    whole = (np.array(BOAT) + np.array(SEA)).tolist()
    found = [
        solved(yaml.safe_dump(config(case, **changes)), "stabilising")[1].states
        for changes in ({}, {"inertia": whole})
    ]
    np.testing.assert_array_equal(*found)


# The loop of a controller, on the plane: Υ = 2k(1 − cos θ) + ½κ|p|².

HELD = CASES["boat"] | {"drag": {"linear": [2, 8, 12], "current": [0.6, 0.1]}, "start": (0, 0)}
TURN, PULL, DAMPING = 0.3, 4.0, [1.5, 3.0, 3.0]


def held(**changes):
    gains = {"kp": [TURN / 2, TURN / 2, PULL], "kd": DAMPING}
    start = {"initial": {"pose": {"kind": "exp_normal", "std": 0.0}}}
    return config(HELD | {"start": ([0.0] * 3, [0.0] * 3)}, gains=gains, **start, **changes)


def law(R, p, V):
    torque = np.zeros(6)
    torque[2] = -TURN * R[1, 0] - DAMPING[0] * V[2]
    torque[3:5] = -PULL * (R.T @ p)[:2] - np.multiply(DAMPING[1:], V[3:5])
    return torque


def eigenvalues(vehicle):
    """Of the vector field in (θ, x, y, ω, vx, vy), at its equilibrium near the origin."""

    def field(y):
        R = Rotation.from_euler("z", y[0]).as_matrix()
        V = np.array([0, 0, y[3], y[4], y[5], 0])
        rates = vehicle.acceleration(0.0, R, np.array([y[1], y[2], 0]), V)
        return np.concatenate([[y[3]], (R @ V[3:])[:2], rates[2:5]])

    rest = root(field, np.zeros(6), tol=1e-13).x
    steps = 1e-5 * np.eye(6)
    return np.linalg.eigvals([(field(rest + e) - field(rest - e)) / 2e-5 for e in steps])


@pytest.mark.needs("proofs")
@pytest.mark.filterwarnings("ignore:.*acts on the drag only", "ignore:.*is unstable")
def test_margins_know_that_a_current_turns_a_vehicle_across():
    """Along a current a long vehicle is unstable, which drag alone does not show."""
    law_margins = eqt_cli.margins(held()).laws[0].growth.eigenvalue.real
    expected = eigenvalues(program(HELD, control=law)).real.max()
    assert law_margins == pytest.approx(expected, abs=1e-5) and expected > 0.01
    whole = (np.array(BOAT) + np.array(SEA)).tolist()
    assert eqt_cli.margins(held(inertia=whole)).laws[0].growth.eigenvalue.real < -0.01


@pytest.mark.needs("designed_laws")
def test_a_regulator_knows_the_current_and_the_added_mass():
    """By differences of Fossen's equations about a pose that is held across the current."""
    case, at = CASES["tide"], [0.3, -0.4, 0.9]
    drag = {"kind": "drag", "linear": DRAG, "current": [0.4, 0.3, -0.1]}
    forces = [drag, {"kind": "restoring", **case["restoring"]}]
    pose = {"rotvec": at, "position": [1, 2, 3]}
    reference = {"reference": {"kind": "constant", "pose": pose}}
    text = config(case, model={"forces": forces}, controllers=["lqr"], **reference)
    del text["task"], text["target"], text["gains"], text["plant"]
    loop = eqt_cli.load_experiment(text).experiment(0).loops["lqr"]
    vehicle = program(case | {"drag": {"linear": DRAG, "current": drag["current"]}})
    start, M = Rotation.from_rotvec(at).as_matrix(), np.array(case["rigid"]) + case["added"]
    hold = -M @ vehicle.acceleration(0.0, start, np.zeros(3), np.zeros(6))
    vehicle.control = lambda R, p, V: hold

    def rates(x):
        R = start @ Rotation.from_rotvec(x[:3]).as_matrix()
        return vehicle.acceleration(0.0, R, np.zeros(3), x[6:])

    steps = 1e-5 * np.eye(12)
    slope = np.array([(rates(e) - rates(-e)) / 2e-5 for e in steps]).T
    A = np.block([[np.zeros((6, 6)), np.eye(6)], [slope]])
    B = np.vstack([np.zeros((6, 6)), np.linalg.inv(M)])
    S = solve_continuous_are(A, B, np.eye(12), np.eye(6))
    gain = loop.controller.regulator.gain
    np.testing.assert_allclose(gain, B.T @ S, rtol=0, atol=1e-7)  # of differences over 1e-5
    Q = loop.reference.motion(SE3, 0.0)[0]
    s = loop.tracking(0.0, loop.initial_state(Q, np.zeros(6), Q, np.zeros(6)))
    np.testing.assert_allclose(loop.command(s), hold, rtol=0, atol=1e-13)


@pytest.mark.ci("compiles and runs the loop")
@pytest.mark.filterwarnings("ignore:.*is unstable")
def test_certificates_know_the_work_of_a_current(tmp_path):
    """L rises by it, which is no fault: its balance holds, and its decrease is not claimed."""
    start = {"pose": {"kind": "exp_normal", "std": 0.0, "centre": [0.2, 0.1, -0.3]}}
    text = held(name="held") | {"initial": start, "time": {"duration": 5.0, "samples": 51}}
    text |= {"solver": {"engine": "native"}}
    result = eqt_cli.run(text, tmp_path / "held").to_xarray()
    rows = {row.name: row.verdict for row in eqt_cli.verify(tmp_path / "held").rows}
    assert rows["energy balance"] == rows["momentum balance"] == "holds"
    assert rows["decrease of L"] == "not covered"
    Q = result.pose.values[0, 0]
    R, V = np.eye(3), np.zeros(6)
    R[:2, :2] = Q[0, :2, :2]
    vehicle = program(HELD, control=law)
    R, p, V = vehicle.run(R, np.append(Q[0, :2, 2], 0.0), V, result.time.values)
    M = np.array(BOAT) + SEA
    L = np.einsum("ti,ij,tj->t", V[:, 2:5], M, V[:, 2:5]) / 2 + 2 * TURN * (1 - R[:, 0, 0]) / 2
    L += PULL * (p[:, :2] ** 2).sum(axis=1) / 2
    np.testing.assert_allclose(result.lyapunov.values[0, 0], L, rtol=0, atol=1e-6)
    assert np.diff(L).max() > 0.01


# What is said.

LEFT = "acts on the drag only, but {}: write the inertia as {{rigid: …, added: …}}, for the current"
LEFT += " to act on its added part; for a wind, write `drag_only: true`"
DIFFER, FLOATS = "the masses differ by direction", "the body has buoyancy"
FLOW, PUSHED = {"kind": "drag", "linear": 1, "current": [0.3, 0, 0]}, [1, 2, 3, 4, 4, 5]
ROUND = [1, 2, 2.5, 4, 4, 4]


def buoyant(B):
    return {"kind": "restoring", "weight": 40.0, "buoyancy": B}


@pytest.mark.parametrize(
    ("inertia", "forces", "more", "said"),
    [
        (PUSHED, [FLOW], {}, DIFFER),
        (ROUND, [FLOW, buoyant(41.0)], {}, FLOATS),
        (ROUND, [FLOW], {"plant_inertia": PUSHED}, DIFFER),
        (PUSHED, [FLOW], {"plant_inertia": {"relative": 0.1}}, DIFFER),
        (ROUND, [FLOW, buoyant(0.0)], {}, None),
        (PUSHED, [FLOW | {"drag_only": True}], {}, None),
        (PUSHED, [{"kind": "drag", "linear": 1}, buoyant(41.0)], {}, None),
        ({"rigid": ROUND, "added": 0}, [FLOW, buoyant(41.0)], {}, None),
        (ROUND, [FLOW], {"plant_inertia": {"rigid": ROUND, "added": PUSHED}}, None),
    ],
)
def test_a_current_without_added_mass_is_said(experiment_of, inertia, forces, more, said):
    text = config(CASES["from rest"], inertia=inertia)
    text["plant"] = {"forces": forces}
    if "plant_inertia" in more:
        text["plant"]["inertia"] = more["plant_inertia"]
    found = [str(each) for each in remarks(experiment_of(yaml.safe_dump(text)))]
    found = [each.partition(": plant.forces[0].current: ")[2] for each in found]
    assert list(filter(None, found)) == ([LEFT.format(said)] if said else [])


def test_only_one_current_moves_the_masses():
    text = config(CASES["from rest"])
    text["plant"] = {"forces": [FLOW, FLOW, FLOW | {"current": [0, 5, 0]}]}
    with pytest.raises(ConfigError) as refused:
        eqt_cli.load_experiment(text)
    assert says(
        str(refused.value), "plant.forces[2].current: forces[0] has another current, but the added…"
    )
    text["plant"]["forces"][2]["drag_only"] = True
    eqt_cli.load_experiment(text)


@pytest.mark.parametrize(
    ("inertia", "message"),
    [
        ({"rigid": BODY}, "inertia.added: missing"),
        ({"rigid": BODY, "added": [0, 0, 0, -1, 0, 0]}, "inertia.added: expected a positive sem"),
        ({"rigid": [0] * 6, "added": WATER}, "inertia.rigid: expected a positive definite matrix"),
    ],
)
def test_both_parts_of_an_inertia_are_checked(inertia, message):
    with pytest.raises(ConfigError) as refused:
        eqt_cli.load_experiment(config(CASES["from rest"], inertia=inertia))
    assert message in str(refused.value)


def test_a_plant_has_an_added_part_of_its_own(experiment_of):
    text = config(CASES["from rest"])
    for true, factor in (({"relative": 0.5}, 1.5), ({"rigid": BODY, "added": BODY}, None)):
        text["plant"]["inertia"] = true
        loop = experiment_of(yaml.safe_dump(text)).loops["stabilising"]
        expected = np.diag(BODY) if factor is None else factor * np.diag(WATER)
        np.testing.assert_allclose(loop.vehicle.forces[0].added, expected, rtol=1e-15)


# Signs and orders.

VEHICLE, FOUR = config(CASES["from rest"], inertia=ROUND), np.eye(6).tolist()[:4]


def said_of(experiment_of, **changes):
    found = [str(each) for each in remarks(experiment_of(yaml.safe_dump(VEHICLE | changes)))]
    return [each.partition(": ")[2] for each in found if "the loop of" not in each]


@pytest.mark.parametrize(
    ("drag", "key", "least"),
    [
        ({"linear": [1, 1, 1, 4, -6.22, 5]}, "linear", -6.22),
        ({"quadratic": -0.5}, "quadratic", -0.5),
        ({"linear": [*FOUR, [0, 0, 0, 0, 1, 3], [0, 0, 0, 0, 0, 1]]}, "linear", -0.5),
        ({"linear": [*FOUR, [0, 0, 0, 0, 1, 9], [0, 0, 0, 0, -9, 0]]}, None, 0),
        # √(1/3) and 1/3 in six digits: an eigenvalue of −1e-7
        ({"linear": [*FOUR, [0, 0, 0, 0, 1, 0.57735], [0, 0, 0, 0, 0.57735, 0.333333]]}, None, 0),
    ],
)
def test_drag_that_gives_energy_is_said(experiment_of, drag, key, least):
    found = said_of(experiment_of, plant={"forces": [{"kind": "drag", **drag}]})
    expected = (
        f"plant.forces[0].{key}: has the eigenvalue {least:g} and drives the body at some "
        "velocities; derivatives such as X_u are negative: give −X_u"
    )
    assert found == ([expected] if key else [])


@pytest.mark.parametrize("name", ["weight", "buoyancy"])
def test_a_weight_or_buoyancy_below_0_is_refused(name):
    force = {"kind": "restoring", "weight": 10.0, "buoyancy": 10.0} | {name: -9.81}
    with pytest.raises(ConfigError) as refused:
        eqt_cli.load_experiment(VEHICLE | {"plant": {"forces": [force]}})
    assert says(str(refused.value), f"plant.forces[0].{name}: expected at least 0 N, got -9.81…")


ORDER = (
    "inertia: looks as if masses stood before moments of inertia, as in Fossen's order; on {} the "
)
ORDER += (
    "rotation comes first: move the last {} rows and columns to the front; or the moments are not "
    "in kg m^2"
)


@pytest.mark.parametrize(
    ("group", "inertia", "is_exchanged"),
    [
        ("SE3", [11.5, 11.5, 11.5, 0.16, 0.16, 0.16], True),  # BlueROV2
        ("SE3", [17.0, 24.2, 26.07, 0.28, 0.28, 0.28], True),
        ("SE3", [30.5, 30.5, 30.5, 0.177, 3.45, 3.45], True),  # REMUS
        ("SE3", [50.0, 60.0, 60.0, 0.8, 3.0, 3.0], True),  # with added mass, shorter
        ("SE3", [0.03, 0.03, 0.03, 1.43e-5, 1.43e-5, 2.89e-5], True),  # Crazyflie
        ("SE2", [[25.8, 0, 0], [0, 33.8, 1.01], [0, 1.01, 2.76]], True),  # CyberShip II
        ("SE2", [5.3e6, 8.3e6, 3.7e9], True),  # a supply vessel
        ("SE3", [0.28, 0.28, 0.28, 17.0, 24.2, 26.07], False),
        ("SE3", [0.177, 3.45, 3.45, 30.5, 30.5, 30.5], False),
        ("SE3", [1.43e-5, 1.43e-5, 2.89e-5, 0.03, 0.03, 0.03], False),
        ("SE3", [1.2e8, 1.1e8, 1.9e8, 4.2e5, 4.2e5, 4.2e5], False),  # a space station
        ("SE2", [2.76, 25.8, 33.8], False),
        ("SE2", [3.7e9, 5.3e6, 8.3e6], False),
        ("SE3", [1, 1, 1, 1, 1, 1], False),
    ],
)
def test_masses_before_moments_are_said(experiment_of, group, inertia, is_exchanged):
    m = len(inertia)
    start = {"pose": {"kind": "exp_normal", "std": 0.1}}
    found = said_of(experiment_of, group=group, inertia=inertia, plant=None, initial=start)
    found = [each for each in found if "looks as if" in each]
    assert found == ([ORDER.format(group, m // 2)] if is_exchanged else [])


POINTS = np.array([[1.0, 1, 1], [-1, -1, -1], [2, 2, 1.9], [0.1, 0, 0]])
"""Of 1 kg each: a body that is long along no axis of the frame."""


def tensor(points, sign):
    """∫(|r|²I − rrᵀ)dm with products of inertia of this sign: −1 is right."""
    J = sum(np.dot(p, p) * np.eye(3) - np.outer(p, p) for p in points)
    return -sign * J + (1 + sign) * np.diag(np.diag(J))


def test_products_of_inertia_with_the_other_sign_are_said(experiment_of):
    """About the centre they break the triangle inequality; about another point, definiteness."""
    hint = "(with the other sign of its products of inertia it would be one: off the diagonal "
    hint += "stands −∫xy dm)"
    of_body = POINTS - POINTS.mean(axis=0)
    changes = {"group": "SO3", "plant": None, "initial": {"pose": "haar"}}
    assert not said_of(experiment_of, **changes, inertia=tensor(of_body, -1).tolist())
    [found] = said_of(experiment_of, **changes, inertia=tensor(of_body, 1).tolist())
    assert "violate the triangle inequality" in found and hint in found
    far = np.add(POINTS, [3.0, 2.0, 4.0])
    S = sum(np.cross(p, np.eye(3)).T for p in far)
    for sign in (-1, 1):
        M = np.block([[tensor(far, sign), S], [S.T, 4.0 * np.eye(3)]]).tolist()
        if sign == -1:
            assert not said_of(experiment_of, inertia=M, plant=None)
            continue
        with pytest.raises(ConfigError, match="expected a positive definite matrix") as refused:
            eqt_cli.load_experiment(VEHICLE | {"inertia": M})
        assert str(refused.value).endswith(hint)
    with pytest.raises(ConfigError) as refused:  # neither sign helps
        eqt_cli.load_experiment(VEHICLE | changes | {"inertia": [1, -1, 2]})
    assert hint not in str(refused.value)
