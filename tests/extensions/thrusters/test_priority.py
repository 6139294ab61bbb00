"""Allocation by priority: against linear programs of its own, through runs, and bad input."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.optimize import linprog

import eqt_cli
from eqt_cli.components.vehicle_parts import Uniform
from eqt_cli.extend import group_named
from eqt_cli.extensions.thrusters.parts import Priority, Thruster
from eqt_cli.extensions.thrusters.thrusters import Thrusters
from eqt_cli.numbers.leaves import leaves, with_leaves

SE3 = group_named("SE3")
ORDER = [["torque x", "torque y"], "force", ["torque z"]]
AXES, ROWS = [[0, 1], [5], [2]], [0, 1, 5, 2]
PLACES = {
    "cross": ([[0.5, 0.5, 0], [0.5, -0.5, 0], [-0.5, -0.5, 0], [-0.5, 0.5, 0]], 0.0, 1.0),
    "uneven": ([[0.6, 0.4, 0], [0.5, -0.7, 0], [-0.4, -0.5, 0], [-0.6, 0.3, 0]], 0.2, 1.1),
    "six": ([[np.cos(a), np.sin(a), 0] for a in np.pi / 3 * np.arange(6)], 0.0, 1.0),
}


def rotors(name, **more):
    places, low, high = PLACES[name]
    thrusters = [Thruster(at, [0, 0, 1], 0.1 * (-1) ** k) for k, at in enumerate(places)]
    options = {"low": low, "high": high, "allocation": Priority("priority", ORDER)} | more
    return Thrusters(thrusters=thrusters, **options).of_run(SE3, None)


def demands(part, count, seed=0):
    """Commands around what the rotors reach: some within, most beyond it."""
    random, most = np.random.default_rng(seed), np.abs(part.matrix).sum(axis=1)
    commands = most * random.uniform(-1, 1, (count, 6)) * random.uniform(0, 1, (count, 1))
    commands[:, 5] = most[5] * random.uniform(-0.3, 1.2, count)
    return commands * [1, 1, 1, 0, 0, 1]


def program(objective, *, above=None, at=None, low, high):
    """The thrusts, and one more number within [0, 1] or above 0, of least objective."""
    A, b = above or (None, None)
    found = linprog(objective, A, b, *at, [*zip(low, high, strict=True)])
    assert found.status == 0, found.message
    return found.x


def by_linear_programs(B, d, low, high):
    """The numbers of groups, by one linear program after the other; it shares no line with eqt."""
    k = B.shape[1]
    rows, values = np.zeros((0, k)), np.zeros(0)
    wide = {"low": [*low, 0.0], "high": [*high, np.inf]}

    def nearest(row, value, known, numbers):
        """Least t with −t ≤ row f − value ≤ t."""
        within = np.block([[row, -1.0], [-row, -1.0]]), [value, -value]
        at = np.pad(known, [(0, 0), (0, 1)]), numbers
        return row @ program(np.eye(k + 1)[k], above=within, at=at, **wide)[:k]

    for group in AXES:
        if len(group) == 1:
            y = [nearest(B[group[0]], d[group[0]], rows, values)]
        else:
            c = []
            for n, axis in enumerate(group):
                known = np.vstack([rows, B[group[:n]]])
                c.append(nearest(B[axis], 0.0, known, np.append(values, c)))
            # The largest s with y = c + s (d − c).
            last = np.append(np.zeros(len(rows)), c - d[group])[:, None]
            at = np.hstack([np.vstack([rows, B[group]]), last]), np.append(values, c)
            limits = {"low": [*low, 0.0], "high": [*high, 1.0]}
            y = c + program(-np.eye(k + 1)[k], at=at, **limits)[k] * (d[group] - c)
        rows, values = np.vstack([rows, B[group]]), np.append(values, y)
    return values


@pytest.mark.parametrize("name", PLACES)
def test_each_group_is_met_as_far_as_those_before_it_allow(name):
    part = rotors(name)
    commands = demands(part, 40)
    thrusts = part.solution(SE3, commands)
    found = (thrusts @ part.matrix.T)[:, ROWS]
    expected = [by_linear_programs(part.matrix, d, part.low, part.high) for d in commands]
    # HiGHS ends at a vertex; what is left is rounding.
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13)
    assert (part.low <= thrusts).all() and (thrusts <= part.high).all()
    met = np.abs(found - commands[:, ROWS]) < 1e-12
    assert 0 < met.all(axis=1).sum() < len(commands)
    # Where the least thrusts are within the limits, they are the answer.
    least = commands @ part.inverse.T
    inside = ((part.low < least) & (least < part.high)).all(axis=1)
    assert inside.any()
    np.testing.assert_allclose(thrusts[inside], least[inside], rtol=0, atol=1e-14)


CRAZYFLIE = yaml.safe_load(Path("configs/quadrotor_recovery.yaml").read_text(encoding="utf-8"))
DEMAND = [-3.297e-3, 0, 0, 0, 0, 0.917]


@pytest.mark.needs("underactuated")
@pytest.mark.parametrize(
    ("allocation", "roll", "force"),
    [("bounded", 0.0, 0.575), ({"kind": "priority", "order": ORDER}, -3.297e-3, 0.46655)],
)
def test_a_crazyflie_keeps_its_roll_by_priority_alone(allocation, roll, force):
    """4 · 0.14375 N; the side that rises gives 2 · 0.14375, the other 3.297e-3/0.0304 less."""
    [section] = CRAZYFLIE["actuators"]
    config = {**CRAZYFLIE, "actuators": [{**section, "allocation": allocation}]}
    config.pop("sweep")
    experiment = eqt_cli.load_experiment(config)
    [part] = experiment.base.loop.vehicle.of_run(SE3).actuators
    wrench = part.matrix @ part.solution(SE3, np.array([DEMAND]))[0]
    np.testing.assert_allclose(wrench[[0, 5]], [roll, force], rtol=0, atol=5e-6)
    np.testing.assert_allclose(wrench[1:5], 0, rtol=0, atol=1e-16)


def test_runs_have_the_limits_of_their_own():
    part = Thrusters(
        thrusters=[
            Thruster(at, [0, 0, 1], 0.1 * (-1) ** k) for k, at in enumerate(PLACES["cross"][0])
        ],
        low=0.0,
        high=Uniform([0.5, 1.5]),
        allocation=Priority("priority", ORDER),
    )
    runs = [part.of_run(SE3, np.random.default_rng(seed)) for seed in range(3)]
    together = with_leaves(
        runs[0], {path: np.stack([leaves(own)[path] for own in runs]) for path in leaves(runs[0])}
    )
    commands = demands(runs[0], 3, seed=5)
    alone = [own.solution(SE3, command) for own, command in zip(runs, commands, strict=True)]
    np.testing.assert_allclose(together.solution(SE3, commands), alone, rtol=0, atol=1e-15)
    assert np.isnan(runs[0].solution(SE3, np.full((1, 6), np.nan))).all()


# Through runs -------------------------------------------------------------------------------------


def flight(engine):
    config = {**CRAZYFLIE, "ensemble": {"runs": 2, "seed": 1}}
    config.pop("sweep")
    [section] = CRAZYFLIE["actuators"]
    allocation = {"kind": "priority", "order": ORDER}
    config["actuators"] = [{**section, "allocation": allocation, "time_constant": None}]
    config["time"] = {"duration": 0.1, "samples": 51}
    config["solver"] = {"engine": engine, "error_estimate": False, "cross_check": 0}
    return config


@pytest.mark.needs("underactuated")
@pytest.mark.parametrize(
    "engine", ["solve_ivp", pytest.param("native", marks=pytest.mark.ci("compiles the law"))]
)
def test_runs_have_the_thrusts_of_linear_programs_at_instants(tmp_path, engine, invoke):
    eqt_cli.run(flight(engine), tmp_path)
    with eqt_cli.open_result(tmp_path) as data:
        command, torque = data["command"][0, 0], data["torque"][0, 0]
        shares = {name: data[name] for name in data.names if name.startswith("cut_share")}
        cut = (np.abs(data["command"] - data["torque"]) > 1e-9)[:, :, :-1].mean(axis=2)
    [section] = CRAZYFLIE["actuators"]
    B = rotors_of(section)
    high = np.full(4, 2.3e-8 * 2500**2)
    scale = np.array([1e3, 1e3, 1e3, 1, 1, 1])[:, None]  # mN m, so that the program sees them
    for u, tau in zip(command, torque, strict=True):
        expected = by_linear_programs(scale * B, scale[:, 0] * u, np.zeros(4), high)
        np.testing.assert_allclose((scale[:, 0] * tau)[ROWS], expected, rtol=0, atol=1e-12)
    # Samples are control instants, and the command is held: shares are counts of samples.
    for axis, name in enumerate(
        ["torque_x", "torque_y", "torque_z", "force_x", "force_y", "force_z"]
    ):
        np.testing.assert_allclose(shares[f"cut_share_{name}"], cut[..., axis], atol=1e-12)
    assert cut[..., 2].all() and cut[..., 5].any() and not cut[..., [0, 1, 3, 4]].any()
    told = invoke("show", tmp_path).stdout
    assert "commands cut by limits: cascade torque z" in told and "and force z" in told


def rotors_of(section):
    """B of the shipped rotors, by moments of forces."""
    ratio = section["moment_constant"] / section["thrust_constant"]
    a = np.array([0.0, 0.0, 1.0])
    each = [(np.array(one["at"]), one["turns"] * ratio) for one in section["thrusters"]]
    return np.array([np.concatenate([np.cross(r, a) + c * a, a]) for r, c in each]).T
