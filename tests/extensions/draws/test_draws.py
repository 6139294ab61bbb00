"""Draws that hang together: each run against closed forms, and what is refused."""

import numpy as np
import pytest
import yaml
from case_tables import from_yaml, refusal
from said import mentions
from scipy.integrate import solve_ivp

import eqt_cli
from eqt_cli.base.errors import ConfigError, Problems
from eqt_cli.config.document import read_config
from eqt_cli.config.remarks import remarks
from eqt_cli.extensions.draws.names import DrawnNames, factor_of
from eqt_cli.extensions.draws.remarks import remark_elsewhere
from eqt_cli.extensions.failures.drawn import drawn_numbers, values_of
from eqt_cli.results.result import open_result
from eqt_cli.runs.run_study import Shard

pytestmark = pytest.mark.needs("draws")
M, D, G = 1.5, 0.3, 9.80665
T = np.linspace(0.0, 1.0, 11)
FREE = {
    "group": "SE3",
    "inertia": [0.02, 0.03, 0.04, M, M, M],
    "gains": {"kp": 1e-14, "kd": 1e-14},  # nothing but the forces acts
    "controllers": ["eqt"],
    "reference": {"kind": "constant"},
    "time": {"duration": 1.0, "samples": 11},
    "ensemble": {"runs": 4},
    "solver": {"engine": "solve_ivp", "cross_check": 0},
}
WIND = {"W": {"uniform": [2, 8]}, "psi": {"uniform": [0, "2*pi"]}}
ACCURATE = 1e-8  # solver.rtol is 1e-9, of paths of some metres


def result_of(folder, **sections):
    path = folder / "drawn.yaml"
    path.write_text(yaml.safe_dump(FREE | sections))
    return eqt_cli.run(eqt_cli.load_experiment(path), out=folder / "out")


def position(result):
    return result["pose"][0, :, :, :3, 3]


def drawn(result, *names):
    return (result[f"drawn.draws.{name}"] for name in names)


@pytest.mark.ci("runs are integrated")
def test_a_wind_of_drawn_speed_blows_from_a_drawn_direction(tmp_path):
    current = ["W*cos(psi)", "W*sin(psi)", 0]
    drag = {"kind": "drag", "linear": [0, 0, 0, D, D, D], "current": current}
    result = result_of(tmp_path, draws=WIND, plant={"forces": [drag]})
    W, psi = drawn(result, "W", "psi")
    c = np.stack([W * np.cos(psi), W * np.sin(psi), 0 * W], axis=-1)[:, None]
    expected = c * (T - M / D * (1 - np.exp(-D * T / M)))[:, None]
    assert np.abs(position(result) - expected).max() < ACCURATE
    assert np.ptp(W) > 0.5
    assert [n for n in result.names if n.startswith("drawn.")] == [
        "drawn.draws.W",
        "drawn.draws.psi",
    ]


@pytest.mark.ci("runs are integrated")
def test_formulas_may_hold_names_and_t_beside_each_other(tmp_path):
    forces = [
        {"kind": "expression", "frame": "spatial", "force": [0, 0, 0, "W*sin(psi*t)", "W", 1.0]},
        {"kind": "drag", "linear": [0, 0, 0, D, D, D], "current": ["W*t", 0, "step(t, 0.5)*W"]},
    ]
    result = result_of(tmp_path, draws=WIND, plant={"forces": forces})
    for run, (W, psi) in enumerate(zip(*drawn(result, "W", "psi"), strict=True)):

        def rate(t, x, W=W, psi=psi):
            wind = np.array([W * t, 0, W * (t >= 0.5)])
            force = np.array([W * np.sin(psi * t), W, 1.0]) - D * (x[3:] - wind)
            return [*x[3:], *force / M]

        x = np.zeros(6)
        for start, end in ((0.0, 0.5), (0.5, 1.0)):  # the wind jumps between them
            x = solve_ivp(rate, (start, end - 1e-12), x, rtol=1e-11, atol=1e-12).y[:, -1]
        assert np.abs(position(result)[run, -1] - x[:3]).max() < ACCURATE


@pytest.mark.ci("runs are integrated")
def test_a_drawn_mass_falls_as_fast_as_any(tmp_path):
    sections = {
        "draws": {"mass": {"uniform": [1.2, 1.8]}},
        "plant": {
            "inertia": [0.02, 0.03, 0.04, "mass", "mass", "mass"],
            "forces": [
                {"kind": "restoring", "gravity": G},
                {"kind": "constant", "force": [0, 0, 0, 1.0, 0, 0]},
            ],
        },
    }
    result = result_of(tmp_path, **sections)
    (mass,) = drawn(result, "mass")
    expected = np.stack([T**2 / 2 / mass[:, None], np.broadcast_to(-G * T**2 / 2, (4, 11))], -1)
    assert np.abs(position(result)[..., ::2] - expected).max() < ACCURATE


@pytest.mark.ci("runs are integrated")
def test_the_weight_of_the_law_is_that_of_its_model(tmp_path):
    weight = {"kind": "restoring", "gravity": G}
    relative = {"relative": {"uniform": [-0.2, 0.2]}}
    model, plant = {"forces": [weight]}, {"inertia": relative}
    result = result_of(tmp_path, model=model, plant=plant)
    r = result["drawn.plant.inertia.relative"]
    # The law holds M g, and M (1 + r) g pulls.
    fallen = -(r * G / (1 + r))[:, None] * T**2 / 2
    assert np.abs(position(result)[..., 2] - fallen).max() < ACCURATE


@pytest.mark.ci("runs are integrated")
def test_runs_start_with_the_numbers_of_a_table(tmp_path):
    (tmp_path / "vehicles.csv").write_text("speed,turn\n1,0.1\n2,0.2\n\n3,0.3\n")
    velocity = {"kind": "fixed", "coordinates": ["turn", 0, 0, "speed", "speed/2", 0]}
    ensemble = {"seed": 3}
    draws = {"table": "vehicles.csv"}
    result = result_of(tmp_path, draws=draws, initial={"velocity": velocity}, ensemble=ensemble)
    expected = [[0.1 * k, 0, 0, k, k / 2, 0] for k in (1, 2, 3)]
    assert np.abs(result["initial_velocity"] - expected).max() < 1e-15  # of decimals
    again = eqt_cli.run(eqt_cli.load_experiment(tmp_path / "out"), out=tmp_path / "again")
    assert np.array_equal(again["pose"], result["pose"])


def names_of(tmp_path, draws):
    path = tmp_path / "names.yaml"
    path.write_text(yaml.safe_dump({"group": "SO3", "draws": draws}))
    problems = Problems()
    names = DrawnNames.read(read_config(path), problems)
    problems.raise_if_any()
    return names


def test_several_normals_have_their_means_and_their_covariance(tmp_path):
    mean, C = [1.0, -2.0, 0.5], np.array([[4, 1.2, 0], [1.2, 1, -0.3], [0, -0.3, 0.25]])
    draws = {
        "a, b, c": {"normal": {"mean": mean, "covariance": C.tolist()}},
        "twice": "2*a",
        "after": {"uniform": ["twice", "twice + 1"]},
    }
    names, n = names_of(tmp_path, draws), 500
    numbers = np.array([[*names.of(7, run).values()] for run in range(n)])
    x = numbers[:, :3]
    # Standard errors of means and of covariances of normals; 5 of them are exceeded once in 10⁶.
    assert (np.abs(x.mean(axis=0) - mean) < 5 * np.sqrt(np.diag(C) / n)).all()
    spread = np.sqrt((np.outer(np.diag(C), np.diag(C)) + C**2) / n)
    assert (np.abs(np.cov(x.T) - C) < 5 * spread).all()
    assert np.array_equal(numbers[:, 3], 2 * x[:, 0])
    rest = numbers[:, 4] - numbers[:, 3]
    assert abs(rest.mean() - 0.5) < 5 / np.sqrt(12 * n)
    assert 0 <= rest.min()
    assert rest.max() < 1
    assert names.means == pytest.approx({"a": 1, "b": -2, "c": 0.5, "twice": 2, "after": 2.5})


def test_a_singular_covariance_ties_names():
    ones = np.ones((2, 2))
    assert np.allclose(factor_of(ones) @ factor_of(ones).T, ones, atol=1e-15)


@pytest.mark.ci("runs are integrated")
def test_names_change_no_other_draw(tmp_path):
    push = {"kind": "constant", "force": [0, 0, 0, {"uniform": [0, 1]}, 0, 0]}
    drawn_by = []
    for name, draws in (("one", None), ("two", WIND)):
        (tmp_path / name).mkdir()
        forces = [push]
        if draws:
            forces = [push, {"kind": "constant", "force": [0, 0, 0, 0, "W*cos(psi)", 0]}]
        result = result_of(tmp_path / name, draws=draws, plant={"forces": forces})
        drawn_by.append(result["drawn.plant.forces.0.force.3"])
    assert np.array_equal(*drawn_by)


@from_yaml
def test_what_no_run_can_have_is_told_before_the_first(tmp_path, sections, said):
    (tmp_path / "table.csv").write_text("u,v\n1,2\n3,x\n")
    path = tmp_path / "refused.yaml"
    data = FREE | {"draws": WIND, "ensemble": {"runs": 200}} | sections
    path.write_text(yaml.safe_dump(data, default_flow_style=None, width=1000))
    message = refusal(ConfigError, eqt_cli.load_experiment, path)
    assert mentions(message, said), message


def test_values_are_remarked_on_at_every_draw_and_at_both_ends(tmp_path, told):
    weight = {"kind": "restoring", "weight": M * G}
    data = FREE | {
        "plant": {"inertia": {"relative": {"uniform": [-0.2, 0.2]}}, "forces": [weight]},
        "ensemble": {"runs": 20},
    }
    path = tmp_path / "weight.yaml"
    path.write_text(yaml.safe_dump(data))
    [remark] = [x for x in remarks(eqt_cli.load_experiment(path).base) if "weight" in str(x)]
    numbers = eqt_cli.load_experiment(path).base
    values = values_of(numbers, drawn_numbers(numbers))[0]
    wrong = np.flatnonzero(np.abs(1 / (1 + values) - 1) > 0.03)
    assert mentions(str(remark), f"in {len(wrong)} of 20 runs, such as run {wrong[0]}: …kg")
    fixed = data | {"plant": {"inertia": {"relative": 0}, "forces": [weight]}}
    path.write_text(yaml.safe_dump(fixed))
    base, heavy = (
        eqt_cli.load_experiment(path, {"plant.inertia.relative": r}).base for r in (0, 0.2)
    )
    told.remarks.clear()
    remark_elsewhere(base, [("at the upper end", heavy)])
    [remark] = told.remarks
    assert mentions(remark, "at the upper end: belongs to 1.5 kg…1.8 kg")


@pytest.mark.ci("runs a sweep, in shards too")
@pytest.mark.parametrize("shards", [1, 2])
def test_a_result_holds_what_is_remarked_on_a_point_that_is_not_its_first(tmp_path, told, shards):
    path, out = tmp_path / "weight.yaml", tmp_path / "r"
    weight = {"kind": "restoring", "weight": M * G}
    data = FREE | {
        "plant": {"inertia": {"relative": 0}, "forces": [weight]},
        "sweep": [{"grid": {"plant.inertia.relative": [0, 0.2]}}],
        "ensemble": {"runs": 1},
    }
    path.write_text(yaml.safe_dump(data))
    for shard in range(1, shards + 1):
        eqt_cli.run(path, out, shard=Shard(shard, shards) if shards > 1 else None)
    if shards > 1:
        eqt_cli.pack(out)
    with open_result(out) as result:
        [remark] = [text for text in result.described.remarks if "kg" in text]
    assert mentions(remark, "weight: at point 1: belongs to 1.5 kg…1.8 kg")
    assert sum("at point 1: belongs" in text for text in told.remarks) >= 1


def test_a_limit_that_some_run_draws_below_the_reference_is_remarked_on(tmp_path):
    path = tmp_path / "limit.yaml"
    data = FREE | {
        "group": "SO3",
        "inertia": [0.01, 0.011, 0.02],
        "reference": {"torque": ["0.1*sin(2*t)", 0, 0]},  # 0.1 N m at 0.785 s
        "actuators": [{"kind": "limit", "limit": {"uniform": [0.08, 0.4]}}],
        "ensemble": {"runs": 60},
    }
    path.write_text(yaml.safe_dump(data))
    base = eqt_cli.load_experiment(path).base
    low = np.flatnonzero(values_of(base, drawn_numbers(base))[0] < 0.1)
    [remark] = remarks(base, base.reference_over_horizon())
    assert mentions(str(remark), f"actuators[0]: in {len(low)} of 60 runs, such as run {low[0]}: …")
