"""`eqt run` flies an exported policy as the environment does, bit for bit."""

import json
from itertools import pairwise

import numpy as np
import pytest
from policies import POLICY, attitude
from said import error_of, says

import eqt_cli
from eqt_cli.analysis.intervals import Resampling
from eqt_cli.base import yaml_source
from eqt_cli.base.errors import EqtWarning
from eqt_cli.engines.engine import hurried
from eqt_cli.extensions.gym.policy import commands_of
from eqt_cli.extensions.suite.tasks import TASKS
from eqt_cli.extensions.sweeps.pooled import answer as compare_pooled
from eqt_cli.results.quantity import Plain
from eqt_cli.results.result import open_result

pytest.importorskip("gymnasium", reason="needs the extra gym")
onnx = pytest.importorskip("onnx", reason="needs the extra network")


def exported(layers, path):
    """Write weights and biases with tanh between them as ONNX, as a trainer would."""
    make, name, nodes, arrays = onnx.helper, "x", [], []
    for k, (W, b) in enumerate(layers):
        for letter, values in (("W", W), ("b", b)):
            array = np.asarray(values, np.float32)
            arrays.append(onnx.numpy_helper.from_array(array, f"{letter}{k}"))
        last = k == len(layers) - 1
        nodes.append(make.make_node("Gemm", [name, f"W{k}", f"b{k}"], [f"z{k}"], transB=1))
        nodes += [] if last else [make.make_node("Tanh", [f"z{k}"], [f"h{k}"])]
        name = f"z{k}" if last else f"h{k}"
    ends = [
        make.make_tensor_value_info(end, onnx.TensorProto.FLOAT, [1, n])
        for end, n in (("x", layers[0][0].shape[1]), (name, len(layers[-1][0])))
    ]
    graph = make.make_graph(nodes, "policy", ends[:1], ends[1:], arrays)
    model = make.make_model(graph, opset_imports=[make.make_opsetid("", 17)], ir_version=8)
    path.write_bytes(model.SerializeToString())
    return path


def random_policy(env, path):
    """The layers of an untrained network of two hidden ones, in 32 bits, written to a file."""
    random = np.random.default_rng(0)
    sizes = env.plant.observations, 32, 32, env.plant.actions
    layers = [
        (random.normal(0, 1 / np.sqrt(m), (n, m)).astype(np.float32), np.zeros(n, np.float32))
        for m, n in pairwise(sizes)
    ]
    return exported(layers, path), layers


def outputs(layers, x):
    for W, b in layers[:-1]:
        x = np.tanh(x @ W.T + b)
    return x @ layers[-1][0].T + layers[-1][1]


ROTORS = {
    "kind": "thrusters",
    "thrusters": [
        {"at": [x, y, 0], "along": [0, 0, 1], "turns": turns, "name": name}
        for name, x, y, turns in (
            ("front left", 0.03, 0.03, 1),
            ("front right", 0.03, -0.03, -1),
            ("rear right", -0.03, -0.03, 1),
            ("rear left", -0.03, 0.03, -1),
        )
    ],
    "thrust_constant": 2.3e-8,
    "moment_constant": 7.8e-10,
    "low_speed": 0,
    "high_speed": 2500,
    "time_constant": "72 ms",
}


def quadrotor(position, duration):
    law = {
        "kind": "network",
        "label": "policy",
        "observes": [
            {"signal": "position_error", "clip": 0.5},
            {"signal": "rotation"},
            {"signal": "velocity_error"},
            {"signal": "rates", "scale": 0.1},
            {"signal": "last_command", "steps": 2},
        ],
        "commands": {"as": "rotors", "thrust": [0.0359375, 0.071875, 0.0359375]},
    }
    return {
        "name": "quadrotor",
        "group": "SE3",
        "inertia": [1.43e-5, 1.43e-5, 2.89e-5, 0.03, 0.03, 0.03],
        "rigid": False,
        "model": {"forces": [{"kind": "restoring", "weight": 0.2943}]},
        "reference": {"kind": "flat", "position": position, "heading": 0},
        "controllers": [law],
        "plant": {
            "forces": [
                {"kind": "restoring", "weight": {"normal": [0.2943, 0.02]}},
                {"kind": "drag", "linear": [0, 0, 0, 7.3e-3, 7.3e-3, 5.4e-3], "current": [1, 0, 0]},
                {"kind": "gust", "std": [0, 0, 0, 0.01, 0.01, 0.01], "time_constant": 0.3},
            ]
        },
        "sensors": {
            "pose": [{"kind": "noise", "std": 0.005}],
            "velocity": [{"kind": "noise", "std": 0.02}],
        },
        "actuators": [ROTORS],
        "control": {"period": "10 ms", "delay": 1},
        "initial": {
            "pose": {"kind": "exp_normal", "std": 0.2},
            "velocity": {"kind": "normal", "std": 0.3},
        },
        "ensemble": {"runs": 3, "seed": 1},
        "time": {"duration": duration, "samples": 11},
        "solver": {"engine": "native", "cross_check": 0},
    }


def wheels(duration):
    wheel = {"kind": "wheels", "pyramid": "54.7 deg", "limit": "4 mN m", "momentum": "15 mN m s"}
    wheel |= {"inertia": 2.39e-5, "start": ["4 mN m s", "-4 mN m s", "4 mN m s", "-4 mN m s"]}
    law = POLICY | {"commands": {"as": "wrench", "scale": 4.0e-3}}
    star = {"kind": "noise", "std": 1.0e-4, "period": 0.4, "delay": "100 ms", "dropout": 0.2}
    return attitude(
        inertia=[0.042, 0.042, 0.0067],
        plant={
            "forces": [
                {"kind": "gravity_gradient", "rate": 1.1e-3, "inertia": [0.042, 0.042, 0.0067]}
            ]
        },
        controllers=[law],
        actuators=[wheel],
        control={"period": 0.1},
        sensors={"pose": [star], "velocity": [{"kind": "noise", "density": 5.0e-5}]},
        time={"duration": duration, "samples": 11},
    )


def planar(duration):
    """A body in the plane that follows waypoints, whose instants lie between ticks."""
    law = {
        "kind": "network",
        "label": "policy",
        "observes": [{"signal": "position_error", "frame": "body"}, {"signal": "velocity"}],
        "commands": {"as": "wrench"},
    }
    return {
        "name": "planar",
        "group": "SE2",
        "inertia": [0.1, 1, 1],
        "reference": {"torque": ["0.1*sin(3*t)", "where(t < 0.333, 1, 0)", "0"]},
        "controllers": [law],
        "plant": {"forces": [{"kind": "constant", "force": [0.01, 0, {"uniform": [0, 0.2]}]}]},
        "control": {"period": 0.05},
        "initial": {"pose": {"kind": "exp_normal", "std": 0.2}, "velocity": "normal"},
        "ensemble": {"runs": 3, "seed": 1},
        "time": {"duration": duration, "samples": 11},
        "solver": {"engine": "native", "cross_check": 0},
    }


SHAPES = {
    "attitude": lambda seconds: attitude(time={"duration": seconds, "samples": 11}),
    "rotors": lambda seconds: quadrotor([0, 0, 1], seconds),
    "figure eight": lambda seconds: quadrotor(["0.8*sin(t)", "0.4*sin(2*t)", "1"], seconds),
    "wheels": lambda seconds: wheels(10 * seconds),
    "instants between ticks": planar,
}
WHY = pytest.mark.ci("compiles a loop, and flies 20 runs")


@pytest.mark.parametrize("shape", [pytest.param(name, marks=WHY) for name in SHAPES])
def test_eqt_run_flies_a_policy_as_the_environment_does(shape, tmp_path):
    """Stepped and walked, by the same programs: the difference is 0, not only small.

    The first command of rotors is computed by other ones: 7e-13 of poses to 19 m was measured.
    """
    env = eqt_cli.gym.make(SHAPES[shape](2), num_envs=2, episodes=2)
    path, layers = random_policy(env, tmp_path / "policy.onnx")
    apart = env.check(path, lambda x: outputs(layers, x))
    assert apart < 1e-10 if env.plant.first_command else apart == 0.0
    assert env.plant.asks_first == (shape in ("rotors", "figure eight"))


@pytest.mark.parametrize("shape", [pytest.param(name, marks=WHY) for name in SHAPES])
def test_a_run_that_begins_late_has_the_same_bits(shape):
    """References and held numbers of each run are those of its own time."""
    env = eqt_cli.gym.make(SHAPES[shape](0.5), num_envs=20, episodes=20)
    actions = 0.3 * np.random.default_rng(1).normal(size=(env.plant.ticks, 20, env.plant.actions))
    env.reset(options={"runs": np.arange(20)})
    together = [env.step(actions[k])[0] for k in range(env.plant.ticks - 1)]
    start = np.arange(20) % 7
    env.reset(options={"runs": np.arange(20)})
    for now in range(env.plant.ticks + 5):
        if (begins := start == now).any():
            env.reset(options={"reset_mask": begins, "runs": np.flatnonzero(begins)})
        ticks = now - start
        known = np.clip(ticks, 0, env.plant.ticks - 1)
        observed = env.step(actions[known, np.arange(20)])[0]
        for run in np.flatnonzero((ticks >= 0) & (ticks < len(together))):
            assert (observed[run] == together[ticks[run]][run]).all(), (run, ticks[run])


@pytest.mark.ci("compiles a network, and runs an experiment")
def test_a_stored_run_is_that_of_the_environment(tmp_path):
    """The poses in the file of `eqt run`, and its metric by the mean of the rewards."""
    with hurried():
        env = eqt_cli.gym.make(attitude(), num_envs=3, episodes=3, dtype=np.float64, cost="effort")
        path, layers = random_policy(env, tmp_path / "policy.onnx")
        assert env.check(path, runs=3) == 0.0
        env.bound = "effort", 1e-6
        with pytest.warns(EqtWarning, match="onnx: effort is .* 1e-06 is the bound"):
            env.check(path, runs=3)
        said = error_of(env.check, path, lambda x: np.tanh(outputs(layers, x)))
        assert says(said, "…policy.onnx: its output …where the policy gives…")
        law = POLICY | {"file": str(path)}
        seeded = attitude(controllers=[law], ensemble={"runs": 3, "seed": env.training_seed})
        study = eqt_cli.load_experiment(seeded)
        commands = commands_of(study.base.loops["policy"].controller)
        result = eqt_cli.run(study, tmp_path / "result")
        stored = np.asarray(result.read("pose", controller="policy")).reshape(3, 21, 3, 3)
        assert result.failed == 0
        observed, rewards, costs = env.reset(options={"runs": np.arange(3)})[0], [], []
        for k in range(20):
            assert (env.exactly("pose") == stored[:, k]).all()
            observed, reward, *_, info = env.step(commands(observed))
            rewards.append(reward)
            costs.append(info["cost"])
        means = np.ravel(result.metric("mean_pose_error"))
        efforts = np.ravel(result.metric("effort"))
    assert np.sum(costs, axis=0) == pytest.approx(efforts, rel=2e-3)  # by Simpson's rule there
    assert -np.mean(rewards, axis=0) == pytest.approx(means, rel=1e-12)  # rounding of sums


@pytest.mark.ci("compiles a network, and runs an experiment")
def test_a_policy_is_not_judged_by_the_runs_of_its_training(tmp_path):
    """The file knows its training, the result knows the file; other runs judge."""
    with hurried():
        env = eqt_cli.gym.make(attitude(), num_envs=3, episodes=3)
        path, _ = random_policy(env, tmp_path / "policy.onnx")
        about = env.record(path)
        assert about["reward"] == "-mean_pose_error"
        assert env.record(path) == about  # once only
        assert about["seeds"] == "2"
        stored = {p.key: p.value for p in onnx.load(path).metadata_props}
        assert json.loads(stored["eqt_trained"]).keys() == {*about, "starts"}
        config = attitude(controllers=[POLICY | {"file": str(path)}, {"kind": "eqt"}])
        results = {}
        for seed in (env.training_seed, 1):
            loaded = eqt_cli.load_experiment(config, {"ensemble.seed": seed})
            if seed == env.training_seed:
                with pytest.warns(match="was trained on the runs of seed 2"):
                    results[seed] = eqt_cli.run(loaded, tmp_path / f"{seed}")
            else:
                results[seed] = eqt_cli.run(loaded, tmp_path / f"{seed}")
        seeds = {"ensemble.seed": [1, env.training_seed]}
        swept = eqt_cli.sweep(config, seeds, out=tmp_path / "swept")
    assert "was trained on the runs of seed 2" in error_of(eqt_cli.compare, swept)
    said = error_of(eqt_cli.compare, results[env.training_seed], controllers=["policy"])
    assert says(said, "…'policy' was trained on the runs of seed 2…ensemble.seed=1002")
    said = error_of(eqt_cli.compare, results[1], other=results[env.training_seed])
    assert "was trained on the runs of seed 2" in said
    assert {pair.first for pair in eqt_cli.compare(results[1]).pairs} == {"eqt"}
    with pytest.warns(match="does not compare the laws: 'policy' was trained on"):
        page = eqt_cli.report(results[env.training_seed].path, figures=["runs"], quick=True)
    assert "which are of this result, so a comparison would flatter it" in page.read_text()
    with hurried():  # a training that goes on by another seed has seen both
        later = eqt_cli.gym.make(attitude(), num_envs=3, episodes=3, seed=7)
        assert later.record(path)["seeds"] == "2, 7"
        again = eqt_cli.load_experiment(config, {"ensemble.seed": 2})
        with pytest.warns(match="was trained on the runs of seed 2"):
            eqt_cli.run(again, tmp_path / "again")
    assert "was trained on the runs of seed 2" in error_of(eqt_cli.compare, tmp_path / "again")


TUNE = {
    "over": {"gains.kp": {"log": [0.01, 1]}},
    "objective": "mean_pose_error",
    "samples": 3,
    "budget": 3,
}
WORST = {"over": {"gains.kp": [0.01, 0.1]}, "objective": "final_pose_error"}
QUADROTOR = {
    "observes": ["rotation_error", "rates"],
    "commands": {"as": "wrench", "scale": [1.5, 1.5, 0.4]},
}


@pytest.mark.ci("runs experiments and a task of the suite")
def test_no_command_judges_a_policy_by_the_runs_of_its_training(tmp_path):
    """By the seed of the runs, wherever that is written, or by their starts."""
    with hurried():
        env = eqt_cli.gym.make(attitude(), num_envs=1, episodes=8, seed=4)
        path, _ = random_policy(env, tmp_path / "policy.onnx")
        env.record(path)
        laws = [POLICY | {"file": str(path)}, "gt"]
        config = attitude(controllers=laws, gains={"kp": 0.05, "kd": 0.02})

        def refused(function, name, *, runs=6, seed=1, **changes):
            changed = config | {"ensemble": {"runs": runs, "seed": seed}} | changes
            return error_of(function, changed, out=tmp_path / name)

        start = "…'policy' was trained on the runs of seed 4, which are "
        said = refused(eqt_cli.tune, "a", tune=TUNE)  # whose held-out runs have the seed 1 + 3
        assert says(said, f"{start}those of tune.confirm.seed, so a comparison would flatter it…")
        assert refused(eqt_cli.tune, "b", tune=TUNE | {"confirm": {"seed": 4}}) == said
        assert says(refused(eqt_cli.worst, "c", seed=4, worst=WORST), f"{start}those of ensemble.…")
        cases = [{"cases": {"one": {"ensemble.seed": 1}, "other": {"ensemble.seed": 4}}}]
        swept = eqt_cli.run(config | {"sweep": cases}, tmp_path / "cases")
        for function in (eqt_cli.compare_sweep, pooled):
            said = error_of(function, swept, ["mean_pose_error"])
            assert says(said, f"{start}of this result…ensemble.seed=1004")
        of = config | {"controllers": ["gt"], "ensemble": {"runs": 3, "seed": 4}}
        eqt_cli.run(of, tmp_path / "starts")
        other = {"runs": 3, "seed": 77}
        initial = {"file": str(tmp_path / "starts" / "results.h5")}
        same = eqt_cli.run(config | {"ensemble": other, "initial": initial}, tmp_path / "same")
        said = error_of(eqt_cli.compare, same)
        assert says(said, "…'policy' was trained on 3 of the starts, which are of this result…")
        further = attitude(controllers=laws[:1], tune=TUNE | {"samples": 1})
        assert says(error_of(eqt_cli.gym.make, further, seed=2), "seed: 2 is tune.confirm.seed…")
        env = eqt_cli.gym.make(further, num_envs=1, episodes=1)
        assert env.training_seed == 3
        said = error_of(eqt_cli.suite, net(tmp_path, seed=999), ["quad_att"], out=tmp_path / "d")
        assert says(said, "'net' was trained on the runs of seed 999, which are those of quad_att…")


def net(folder, seed):
    """A network for a task of the suite, which was trained by a seed."""
    path = TASKS / "quad_att.yaml"
    task = dict(yaml_source.load(path.read_bytes(), "").data)
    task |= {"controllers": [{"kind": "network", **QUADROTOR}]}
    del task["suite"]
    env = eqt_cli.gym.make(task, num_envs=1, episodes=1, seed=seed)
    env.record(random_policy(env, folder / "net.onnx")[0])
    law = folder / "net.yaml"
    law.write_text(yaml_source.dump({"file": "net.onnx", **QUADROTOR}))
    return law


def pooled(swept, metrics):
    with open_result(swept) as result:
        compare_pooled(result, Resampling(), Plain(), metrics, [])
