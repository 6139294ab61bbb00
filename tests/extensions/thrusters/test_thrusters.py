"""Thrusters and currents: against plain programs, against SciPy, and through whole experiments."""

from functools import cache, partial
from pathlib import Path

import numpy as np
import plain_thrusters as plain
import pytest
import yaml
from ports import ports
from scipy.optimize import lsq_linear

from eqt_cli.api import load_experiment
from eqt_cli.api.loading import open_at
from eqt_cli.components.allocation import allocation, unreachable
from eqt_cli.components.blocks import beyond_limits, signals, solution
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.components.vehicle_parts import Normal, Sampling, Uniform
from eqt_cli.config.remarks import limits_below_reference
from eqt_cli.extend import Drag, Limit, RateLimit, group_named
from eqt_cli.extensions.thrusters.parts import Thruster
from eqt_cli.extensions.thrusters.thrusters import Thrusters
from eqt_cli.numbers.leaves import leaves, with_leaves
from eqt_cli.results.result import open_result
from eqt_cli.runs.run_study import execute

TOLERANCE = 1e-6
"""As in test_against_plain.py."""

DURATION, SAMPLES = 1.0, 11
SE2, SE3 = group_named("SE2"), group_named("SE3")
INERTIA = {"SE2": [1.0, 2.0, 2.5], "SE3": [1.0, 2.0, 2.5, 3.0, 4.0, 5.0]}
START = [0.9, -0.5, 0.7, 0.3, -0.2, 0.4]
EIGHT = [
    {"at": [0.4, 0.3, 0.1], "along": [1, -1, 0], "turns": 0.02},
    {"at": [0.4, -0.3, 0.1], "along": [1, 1, 0], "turns": -0.02},
    {"at": [-0.4, 0.3, 0.1], "along": [-1, -1, 0]},
    {"at": [-0.4, -0.3, 0.1], "along": [-1, 1, 0]},
    {"at": [0.3, 0.5, 0], "along": [0, 0, -1]},
    {"at": [0.3, -0.5, 0], "along": [0, 0, -2]},
    {"at": [-0.3, 0.5, 0], "along": [0, 0, -1]},
    {"at": [-0.3, -0.5, 0], "along": [0, 0, -1]},
]
FOUR = [
    {"at": [0.5, 0.0], "along": [0, 1]},
    {"at": [-0.5, 0.1], "along": [0, 3]},
    {"at": [0.0, 0.4], "along": [1, 0]},
    {"at": [0.0, -0.4], "along": [1, 0.5]},
]
# One thruster has narrow limits, and another a slow lag.
HIGH = {4: [0.1, 5.0, 5.0, 5.0], 8: [5.0, 5.0, 5.0, 5.0, 0.3, 5.0, 5.0, 5.0]}
LOW = {k: [-0.8 * each for each in high] for k, high in HIGH.items()}
LAG = {k: [0.05] * (k - 1) + [0.4] for k in (4, 8)}
CURRENT = {"SE2": [0.3, "0.2*sin(2*t)"], "SE3": [0.3, "0.2*sin(2*t)", -0.1]}


def flow(group):
    return lambda t: np.array([0.3, 0.2 * np.sin(2 * t), -0.1][: {"SE2": 2, "SE3": 3}[group]])


CASES = {
    "saturated and lagging": {"lag": True},
    "current": {"drag": True},
    "bounded": {"period": 0.1, "bounded": True},
    "all": {"lag": True, "drag": True, "period": 0.1, "delay": 1},
}


def text(group, engine, case):
    m, places = len(INERTIA[group]), EIGHT if group == "SE3" else FOUR
    k = len(places)
    part = {"kind": "thrusters", "thrusters": places, "low": LOW[k], "high": HIGH[k]}
    if case.get("lag"):
        part["time_constant"] = LAG[k]
    if case.get("bounded"):
        part["allocation"] = "bounded"
    drag = {"kind": "drag", "linear": 0.2, "quadratic": 0.6, "current": CURRENT[group]}
    config = {
        "group": group,
        "inertia": INERTIA[group],
        "gains": {"kp": 1.5, "kd": 1.2},
        "reference": {"torque": ["0.3*cos(t)", "0.2*sin(t)", 0.1, 0.2, 0, "0.1*t"][:m]},
        "controllers": ["eqt"],
        "actuators": [part],
        "initial": {
            "pose": {"kind": "exp_normal", "std": 0.0, "centre": START[:m]},
            "velocity": {"kind": "fixed", "coordinates": START[:m][::-1]},
        },
        "time": {"duration": DURATION, "samples": SAMPLES},
        "solver": {"engine": engine, "rtol": 1e-10},
    }
    if case.get("drag"):
        config["plant"] = {"forces": [drag]}
    if case.get("period"):
        config["control"] = {"period": case["period"], "delay": case.get("delay", 0)}
    return yaml.safe_dump(config)


@cache
def expected(group, name):
    """Q, V and the thrusts at the sample times, for all engines."""
    case, times = CASES[name], np.linspace(0.0, DURATION, SAMPLES)
    m, places = len(INERTIA[group]), EIGHT if group == "SE3" else FOUR
    k = len(places)

    def torque(t):
        return np.array([0.3 * np.cos(t), 0.2 * np.sin(t), 0.1, 0.2, 0, 0.1 * t][:m])

    drag = {"linear": 0.2, "quadratic": 0.6, "current": flow(group)} if case.get("drag") else {}
    lag = LAG[k] if case.get("lag") else None
    more = {"lag": lag, "bounded": case.get("bounded", False)} | drag
    known = group, INERTIA[group], 1.5, 1.2, torque, places, LOW[k], HIGH[k]
    program = plain.Vehicle(*known, **more)
    start, d = np.array(START[:m]), program.d
    y = program.start(plain.plain.exp(group, start), start[::-1], np.eye(d), np.zeros(m))
    y = program.run(y, times, period=case.get("period"), delay=case.get("delay", 0))
    return (
        y[:, : d * d].reshape(-1, d, d),
        y[:, d * d : d * d + m],
        None if lag is None else y[:, -k:],
    )


COMPILES = pytest.mark.ci("compiles the laws")

in_ci = partial(pytest.param, marks=pytest.mark.ci("the plain program takes seconds there"))
RUNS = [
    pytest.param("SE2", "solve_ivp", "saturated and lagging"),
    pytest.param("SE2", "solve_ivp", "current"),
    pytest.param("SE2", "solve_ivp", "bounded"),
    *(in_ci("SE2", "native", name) for name in [*CASES][::2]),
    *(in_ci("SE3", ("native", "solve_ivp")[k % 2], name) for k, name in enumerate(CASES)),
]


@pytest.mark.parametrize(("group", "engine", "name"), RUNS)
def test_states_are_those_of_a_plain_program(solved, group, engine, name):
    problem, solution = solved(text(group, engine, CASES[name]))
    assert solution.messages == [""]
    s = problem.loop.tracking(problem.times, solution.states)
    Q, V, thrust = expected(group, name)
    np.testing.assert_allclose(s.Q[0], Q, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(s.V[0], V, rtol=0, atol=TOLERANCE)
    found = signals(problem.loop.now(s))["thrust"][0]
    if thrust is not None:
        np.testing.assert_allclose(found, thrust, rtol=0, atol=TOLERANCE)
    B = np.array([plain.column(**each) for each in (EIGHT if group == "SE3" else FOUR)]).T
    np.testing.assert_allclose(problem.loop.torque(s)[0], found @ B.T, rtol=0, atol=1e-12)
    assert beyond_limits(problem.loop.now(s))[0].any()
    # A current and limits do work; the balance holds as far as the states do.
    L, W = s.lyapunov[0], problem.loop.work(solution.states)[0]
    np.testing.assert_allclose(L + W, L[0], rtol=0, atol=TOLERANCE)


# What each part does.


def test_a_thrust_has_the_power_of_its_point_in_the_order_of_the_group():
    places = [Thruster(**each) for each in EIGHT]
    found = Thrusters(thrusters=places).columns(SE3)
    np.testing.assert_allclose(found.T, [plain.column(**each) for each in EIGHT], atol=1e-15)
    found = Thrusters(thrusters=[Thruster(**each) for each in FOUR]).columns(SE2)
    np.testing.assert_allclose(found.T, [plain.column(**each) for each in FOUR], atol=1e-15)


def test_thrusts_have_the_least_weighted_sum_of_squares():
    weights, tau = np.arange(1.0, 9.0), np.array([0.3, -0.2, 0.1, 1.0, 2.0, -0.7])
    part = Thrusters(thrusters=[Thruster(**each) for each in EIGHT], weights=weights.tolist())
    part = part.of_run(SE3, None)
    f, B = part.thrust(SE3, tau, tau[:0]), part.matrix
    np.testing.assert_allclose(B @ f, tau, atol=1e-14)
    across = np.linalg.svd(B)[2][6:]  # of the thrusts that give no torque
    np.testing.assert_allclose(across @ (weights * f), 0, atol=1e-13)


@pytest.mark.parametrize("constant", [None, 2e-5])
def test_thrusts_fall_with_a_time_constant_of_their_own(constant):
    """T ẋ = wanted − x, with T = 0.1 s while x rises and 0.4 s while it falls; x is a speed."""
    part = Thrusters(
        thrusters=[Thruster(**each) for each in EIGHT],
        **({} if constant is None else {"thrust_constant": constant, "low": 0.0, "high": 9.0}),
        time_constant=0.1,
        time_constant_down=0.4,
    ).of_run(SE3, None)
    tau = np.array([0.3, -0.2, 0.1, 1.0, 2.0, -0.7])
    thrusts = np.linalg.pinv(part.matrix) @ tau
    wanted = thrusts if constant is None else np.sqrt(np.clip(thrusts, 0, 9) / constant)
    x = wanted + [0.1, -0.1] * 4
    expected = np.tile([-0.1 / 0.4, 0.1 / 0.1], 4)
    np.testing.assert_allclose(part.state_rate(SE3, tau, x), expected, rtol=1e-9)
    np.testing.assert_array_equal(part.linear_part.time_constant, 8 * [0.4])


def test_directions_that_digits_explain_are_not_pushed_along():
    """Two rotors in one line, and π of three digits: the torque of the third is a rounding."""
    B = np.array([[0.1, -0.1, 0.0], [1e-9, 2e-9, 3e-9], [0.0, 0.0, 0.2], [1.0, 1.0, 1.0]])
    inverse, _ = allocation(B, 0.05, np.ones(3))
    assert np.abs(inverse).max() < 20


@pytest.mark.parametrize("shape", [(), (2,), (2, 3)])
def test_bounded_thrusts_that_lag_are_held_and_followed(shape):
    """States are the thrusts that were solved for, and behind them those that lag."""
    part = Thrusters(
        matrix=[[1.0, 0.0], [0.0, 2.0], [0.0, 0.0]],
        low=-1.0,
        high=[2.0, 3.0],
        time_constant=[0.5, 1.0],
        allocation="bounded",
    ).of_run(SE2, None)
    x = np.broadcast_to([2.0, 0.5, 1.0, -0.5], (*shape, 4))
    tau = np.broadcast_to([5.0, 4.0, 7.0], (*shape, 3))

    def same(found, expected):
        np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), atol=1e-14)
        assert found.shape == (*shape, len(expected))

    assert part.states(SE2) == 4
    same(part.thrust(SE2, tau, x), [1.0, -0.5])
    same(part.output(SE2, tau, x), [1.0, -1.0, 0.0])
    same(part.state_rate(SE2, tau, x), [0.0, 0.0, 2.0, 1.0])
    solved = part.solution(SE2, tau)
    same(solved, [2.0, 2.0])
    same(part.step(SE2, solved, x, 0.1), [2.0, 2.0, 1.0, -0.5])
    for asked, there in (([2.0, 0.0], True), ([0.0, -1.0], True), ([1.9, 2.9], False)):
        x = np.broadcast_to([*asked, 0.0, 0.0], (*shape, 4))
        found = part.at_limit(SE2, tau, x)
        assert found.shape == shape and (found == there).all()


def test_thrusts_of_many_runs_have_the_limits_of_their_own():
    options = {"low": -1.0, "high": Uniform([1.0, 2.0]), "told": True}
    part = Thrusters(matrix=np.eye(3).tolist(), allocation="bounded", **options)
    runs = [part.of_run(SE2, np.random.default_rng(seed)) for seed in range(2)]
    together = with_leaves(
        runs[0], {path: np.stack([leaves(own)[path] for own in runs]) for path in leaves(runs[0])}
    )
    found = together.solution(SE2, np.full((2, 3), 9.0))
    np.testing.assert_array_equal(found, [own.high for own in runs])


@pytest.mark.parametrize("shape", [(), (2,), (2, 3)])
def test_a_thrust_at_its_limit_is_not_beyond_it(shape):
    part = Thrusters(matrix=np.eye(3).tolist(), low=[-1.0, -2.0, -3.0], high=2.0)
    part, none = part.of_run(SE2, None), np.zeros((*shape, 0))
    for command, beyond in (
        ([-1.0, -2.0, 2.0], False),
        ([-1.1, 0.0, 0.0], True),
        ([0.0, 0.0, 2.1], True),
    ):
        found = part.at_limit(SE2, np.broadcast_to(command, (*shape, 3)), none)
        assert found.shape == shape and (found == beyond).all()
    assert Thrusters(matrix=np.eye(3).tolist()).at_limit(SE2, np.zeros(3), none) is None


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_thrusts_that_just_reach_their_limit_are_still_the_least(side):
    """Others would give the same torque, with a larger sum of weight · thrust²."""
    G, weights = group_named("SO2"), [1.0, 3.0, 5.0, 2.0]
    free = Thrusters(matrix=[[1.0, 1.0, 1.0, 1.0]], weights=weights).of_run(G, None)
    command = np.array([side * 0.7])
    thrusts = free.thrust(G, command, command[:0])
    reach = float(np.abs(thrusts).max())
    part = Thrusters(
        matrix=[[1.0, 1.0, 1.0, 1.0]], weights=weights, low=-reach, high=reach, allocation="bounded"
    )
    found = part.of_run(G, None).solution(G, command[None])
    np.testing.assert_array_equal(found, thrusts[None])


@pytest.mark.parametrize("size", [0.5, 3.0, 30.0])
def test_bounded_thrusts_are_those_of_least_squares(size):
    part = Thrusters(
        thrusters=[Thruster(**each) for each in EIGHT],
        low=[-1.0] * 4 + [0.0] * 4,
        high=2.0,
        allocation="bounded",
        weights=np.linspace(0.5, 2.0, 8).tolist(),
    )
    part, random = part.of_run(SE3, None), np.random.default_rng(3)
    commands, B = size * random.standard_normal((20, 6)), part.matrix
    limits, inside = (part.low, part.high), 0
    for command, f in zip(commands, part.solution(SE3, commands), strict=True):
        assert (part.low <= f).all() and (f <= part.high).all()
        best = lsq_linear(B, command, limits, method="trf", tol=1e-14)
        np.testing.assert_allclose(B @ f, B @ best.x, atol=1e-6 * size)
        # Of no thrust does the error fall towards the inside: the least squares are unique in B f.
        slope = B.T @ (B @ f - command)
        free = (part.low < f) & (f < part.high)
        np.testing.assert_allclose(slope[free], 0, atol=1e-10 * size)
        assert (slope[f == part.low] >= -1e-10 * size).all()
        assert (slope[f == part.high] <= 1e-10 * size).all()
        inside += free.all()
    assert inside < 20


def test_numbers_of_thrusters_are_drawn_once_each_in_their_order():
    part = Thrusters(
        matrix=np.eye(3).tolist(),
        low=Uniform([-2.0, -1.0]),
        high=[Uniform([1.0, 2.0]), 1.5, Uniform([1.0, 2.0])],
        time_constant=Normal([0.1, 1.0]),
    )
    runs = [part.of_run(SE2, np.random.default_rng(seed)) for seed in range(30)]
    assert min(own.time_constant.min() for own in runs) > 0
    assert all(np.ptp(own.low) == 0 and -2 <= own.low[0] < -1 for own in runs)
    assert all(own.high[1] == 1.5 != own.high[0] != own.high[2] for own in runs)


def test_thrusters_without_a_name_are_numbered_from_1():
    part = Thrusters(matrix=[[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
    assert part.thruster_names == ("thruster 1", "thruster 2")
    assert Thrusters(matrix=[[1.0, 2.0]]).thruster_names == part.thruster_names
    some = [Thruster([0.0, 0.0], [1.0, 0.0], name="bow"), Thruster([0.0, 0.0], [0.0, 1.0])]
    assert Thrusters(thrusters=some).thruster_names == ("bow", "thruster 2")


def test_a_vehicle_has_the_limits_and_the_solution_of_its_thrusters():
    limited = Thrusters(matrix=np.eye(3).tolist(), low=-1.0, high=2.0, allocation="bounded")
    free, all_axes = Thrusters(matrix=np.eye(3).tolist()), Limit(limit=1.5)
    G = group_named("SO3")
    assert Vehicle(actuators=(all_axes,)).of_run(G).range_of("thrust") is None
    assert Vehicle(actuators=(free,)).of_run(G).range_of("thrust") is None
    rate = RateLimit(rate=20.0)  # 2 in a period
    vehicle = Vehicle(actuators=(rate, all_axes, limited), control=Sampling(period=0.1)).of_run(G)
    assert vehicle.solves == 3
    low, high = vehicle.range_of("thrust")
    np.testing.assert_array_equal([low, high], [[-1.0] * 3, [2.0] * 3])
    asked = np.array([[3.0, -3.0, 0.5]])
    states = {name: np.zeros((1, length)) for name, length in vehicle.states(G).items()}
    tick = {"command": asked, "acts": True}
    found = solution(ports(vehicle, G, states, **tick, solved=np.zeros((1, 3))))
    np.testing.assert_allclose(found, [[1.5, -1.0, 0.5]], atol=1e-12)
    after = ports(vehicle, G, states, **tick).stepped()
    np.testing.assert_allclose(after["actuators_2"], found, atol=1e-12)
    after = ports(vehicle, G, states, **tick, solved=0.5 * found).stepped()  # by an engine
    np.testing.assert_array_equal(after["actuators_2"], 0.5 * found)
    np.testing.assert_array_equal(after["actuators_0"], [[2.0, -2.0, 0.5]])


def test_a_run_that_is_lost_has_no_thrust():
    part = Thrusters(matrix=[[1.0], [0], [0]], low=-1.0, high=1.0, allocation="bounded")
    part = part.of_run(SE2, None)
    assert np.isnan(part.solution(SE2, np.array([[np.nan, 0, 0]]))).all()


def test_the_medium_carries_a_body_without_drag():
    Q = SE3.exp(np.array([[0.4, -0.3, 0.8, 1.0, 2.0, 3.0]]))
    c = np.array([0.3, -0.2, 0.1])
    V = np.concatenate([np.zeros(3), Q[0, :3, :3].T @ c])[None]
    for frame in ("body", "spatial"):
        drag = Drag(linear=2.0, quadratic=3.0, current=[*c.tolist()], frame=frame)
        drag = drag.of_run(SE3, None)
        np.testing.assert_allclose(drag.in_body(SE3, 0.0, Q, V), 0, atol=1e-15)
        assert np.abs(drag.in_body(SE3, 0.0, Q, 0 * V)).max() > 0.1


def test_directions_without_thrust_are_the_fewest_coordinates():
    quadrotor = np.zeros((6, 4))
    quadrotor[:3, :3], quadrotor[5, 3] = np.eye(3), 1.0
    np.testing.assert_array_equal(unreachable(quadrotor), np.eye(6)[[3, 4]])
    assert len(unreachable(np.eye(6))) == 0
    along = np.array([[1.0], [-1.0], [1.0]])
    np.testing.assert_allclose(unreachable(along), [[1, 0, -1], [0, 1, 1]], atol=1e-15)
    np.testing.assert_array_equal(unreachable(np.zeros((3, 2))), np.eye(3))
    for B in np.random.default_rng(5).standard_normal((20, 6, 3)):
        found = unreachable(B)  # in which the first coordinates stand for themselves
        np.testing.assert_array_equal(found[:, :3], np.eye(3))
        np.testing.assert_allclose(found @ B, 0, atol=1e-12 * np.abs(found).max())


def test_what_is_almost_along_a_coordinate_is_along_it():
    np.testing.assert_array_equal(unreachable(np.array([[1.0], [-1e-7]])), [[0, 1]])
    np.testing.assert_array_equal(unreachable(np.array([[-1e-7], [1.0]])), [[1, 0]])


def test_directions_without_thrust_are_said_by_their_coordinates():
    [told] = Thrusters(matrix=[[1.0, 0.0], [0.0, 1.0], [2.0, 0.5]]).remarks(SE2, np.eye(3))
    assert told == (
        "with rank 2 of 3 cannot push along ω + 0.25 vx − 0.5 vy; what a law asks for there is "
        "lost; of what it asks along one axis alone arrives ω 24 %, vx 95 %, vy 81 %"
    )
    [told] = Thrusters(matrix=[[1.0], [-1.0], [1.0]]).remarks(SE2, np.eye(3))
    assert told == (
        "with rank 1 of 3 cannot push along ω − vy, vx + vy; what a law asks for there is lost; "
        "of what it asks along one axis alone arrives ω 33 %, vx 33 %, vy 33 %"
    )
    assert not list(Thrusters(matrix=np.eye(3).tolist()).remarks(SE2, np.eye(3)))


# Directions in which a small torque takes large thrusts.


def arms(rotors, off, shift):
    """Rotors on arms of 0.2 m, in turn clockwise and not; the second is displaced, m."""
    places = []
    for k in set(range(rotors)) - set(off):
        angle = 2 * np.pi * (k + 0.5) / rotors
        place = [0.2 * np.cos(angle) + shift * (k == 1), 0.2 * np.sin(angle), 0]
        places.append(Thruster(place, [0, 0, 1], turns=0.016 * (-1) ** k))
    return places


NEARLY_LOST = {
    "hexarotor, 2 rotors off, 4 mm": (SE3, np.eye(6)[[0, 1, 2, 5]], arms(6, (0, 3), 0.004), "ωz"),
    "hexarotor, 2 others off, 10 mm": (SE3, np.eye(6)[[0, 1, 2, 5]], arms(6, (2, 5), 0.01), "ωz"),
    "boat, both thrusters astern, 1 mm": (
        SE2,
        np.eye(3),
        [
            Thruster([-0.5, 0.3], [1, 0]),
            Thruster([-0.5, -0.3], [1, 0]),
            Thruster([-0.6, 0.0], [0, 1]),
            Thruster([-0.601, 0.0], [0, 1]),
            Thruster([-0.5, 0.3], [1, 1e-3]),
        ],
        None,
    ),
}


@pytest.mark.parametrize("name", NEARLY_LOST)
@pytest.mark.parametrize("weights", [None, 3.0])
def test_a_direction_of_hardly_any_thrust_is_given_up_and_named(name, weights):
    """Against the singular values of B with rows of length 1."""
    G, wanted, places, axis = NEARLY_LOST[name]
    each = None if weights is None else [1.0 + weights * k for k in range(len(places))]
    part = Thrusters(thrusters=places, weights=each)
    B = wanted @ part.columns(G)
    rows = np.linalg.norm(B, axis=1)
    U, sizes, _ = np.linalg.svd(B / rows[:, None], full_matrices=False)
    weak = sizes < 0.05 * sizes[0]
    inverse = part.of_run(G, None).inverse
    exact = Thrusters(thrusters=places, weights=each, least=0)
    if axis is None:  # all directions have thrust
        assert not weak.any() and not list(part.remarks(G, wanted))
        np.testing.assert_array_equal(inverse, exact.of_run(G, None).inverse)
        return
    assert weak.sum() == 1 and sizes[-1] < 0.02 * sizes[0]
    # A command of torques along the lost direction takes no thrust, all others what they ask for.
    np.testing.assert_allclose(inverse @ wanted.T @ (rows * U[:, -1]), 0, atol=1e-10)
    others = (rows * U[:, :-1].T).T
    given = U.T / rows @ B @ inverse @ wanted.T @ others
    np.testing.assert_allclose(given[:-1], np.eye(3), atol=1e-10)
    assert np.abs(inverse).max() < 0.1 * np.abs(exact.of_run(G, None).inverse).max()
    [told] = part.remarks(G, wanted)
    assert f"+ {axis} with less than 0.05 of their strength elsewhere" in told
    assert not list(exact.remarks(G, wanted))


CONFIGS = Path(__file__).parents[3] / "configs"
WITH_THRUSTERS = [
    path.stem
    for path in sorted(CONFIGS.glob("*.yaml"))
    if "kind: thrusters" in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("name", WITH_THRUSTERS)
def test_no_shipped_configuration_gives_up_a_direction(name):
    for loop in load_experiment(CONFIGS / f"{name}.yaml").base.loops.values():
        assert all(getattr(part, "passed", None) is None for part in loop.vehicle.actuators)


@pytest.mark.parametrize(
    ("torque", "limits", "said", "needs"),
    [
        ([0, 0, -0.5], "low: -0.2, high: 0.4", "at least -0.2 N", -0.5),
        ([0, 0, 0.5], "low: -0.9, high: 0.4", "at most 0.4 N", 0.5),
        ([0, 0, 0.1], "low: [-1, -1, 0.2], high: 1", "at least 0.2 N", 0.1),
    ],
)  # fmt: skip
def test_the_limit_that_is_exceeded_is_named(experiment, torque, limits, said, needs):
    found = experiment(
        group="SE2",
        inertia="[1, 2, 2]",
        reference=f"{{torque: {torque}}}",
        actuators=f"[{{kind: thrusters, matrix: [[1, -1, 0], [1, 1, 0], [0, 0, 1]], {limits}}}]",
    )
    [(place, words)] = limits_below_reference(found)
    assert place == ("actuators", 0)
    assert words == (
        f"'thruster 3' gives {said}, but the reference alone needs {needs} N at t = 0 s; no law "
        "can follow it there"
    )


# Whole experiments.

FLIGHT = yaml.safe_load("""
group: SE2
inertia: [1, 2, 2.5]
gains: {kp: 1.5, kd: 1.2}
reference: {torque: [0.3*cos(t), 0.1, 0]}
controllers: [eqt]
plant: {forces: [{kind: drag, quadratic: 0.5, current: [{uniform: [0, 0.3]}, 0.1*cos(t)]}]}
actuators:
  - {kind: thrusters, low: -0.4, high: {uniform: [0.3, 0.6]}, time_constant: 0.1,
     allocation: bounded}
control: {period: 0.1, delay: 1}
initial: {pose: {kind: exp_normal, std: 1.0}, velocity: normal}
ensemble: {runs: 4, seed: 1}
time: {duration: 0.4, samples: 5}
solver: {rtol: 1.0e-6, cross_check: 0, error_estimate: false}
""")
FLIGHT["actuators"][0]["thrusters"] = [
    {**each, "name": name} for each, name in zip(FOUR, "abcd", strict=True)
]


@pytest.mark.parametrize("engine", ["solve_ivp", pytest.param("native", marks=COMPILES)])
def test_thrusts_are_stored_under_their_names_and_give_the_torque(folder, engine):
    execute(
        load_experiment(FLIGHT | {"solver": FLIGHT["solver"] | {"engine": engine}}), Path("out")
    )
    with open_result(Path("out")) as one:
        assert one.dims("thrust") == ("controller", "run", "time", "thruster")
        assert one.coordinate("thruster").tolist() == ["a", "b", "c", "d"]
        assert one.units("thrust") == "N"
        B = np.array([plain.column(**each) for each in FOUR]).T
        np.testing.assert_allclose(one["thrust"] @ B.T, one["torque"], atol=1e-14)
        assert (np.abs(one["thrust"]) <= 0.6).all() and one["saturated_share"].max() > 0
        assert one["energy_residual"].max() < 1e-5


@pytest.mark.ci("computes an experiment several times")
def test_points_with_other_thrusters_have_their_own(folder):
    parts = {
        "none": [],
        "three": [{"kind": "thrusters", "matrix": np.eye(3).tolist()}],
        "as given": FLIGHT["actuators"],
        "other limits": [{**FLIGHT["actuators"][0], "low": -0.2}],
    }
    sweep = {"sweep": [{"cases": {name: {"actuators": own} for name, own in parts.items()}}]}
    few = {"ensemble": {"runs": 1}, "time": {"duration": 0.1, "samples": 2}}
    execute(load_experiment(FLIGHT | few | sweep), Path("out"))
    found = []
    for point in range(len(parts)):
        with open_at(Path("out"), point) as one:
            found.append(one["thrust"].shape[-1] if one.has("thrust") else None)
    assert found == [None, 3, 4, 4]


def test_thrusters_behind_a_part_without_states_have_its_command():
    class Stateless(Limit):
        def output(self, G, command, x):
            return command

    G, command = group_named("SO3"), np.array([1.0, 2.0, 3.0])
    parts = Stateless(limit=9.0), Thrusters(matrix=np.eye(3).tolist())
    behind = Vehicle(actuators=parts).of_run(G)
    np.testing.assert_array_equal(signals(ports(behind, G, {}, command=command))["thrust"], command)
