"""Environments by name, one at a time, and in other processes, as programs for Gymnasium expect."""

import pickle
import subprocess
import sys
import warnings

import numpy as np
import pytest
from policies import attitude
from said import error_of, says

import eqt_cli
from eqt_cli.base import yaml_source

gymnasium = pytest.importorskip("gymnasium", reason="needs the extra gym")


def stepped(env, steps):
    actions = np.random.default_rng(0).uniform(-1, 1, (steps, env.num_envs, 3))
    return [env.step(action)[:4] for action in actions]


def test_the_module_can_be_imported():
    import eqt_cli.gym
    from eqt_cli.gym import make

    assert make is eqt_cli.gym.make
    assert "eqt/Attitude-v0" in gymnasium.registry


@pytest.mark.ci("starts Python")
def test_an_import_registers_the_names():
    code = "import eqt_cli.gym, gymnasium; print('eqt/Pose-v0' in gymnasium.registry)"
    printed = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert printed.stdout.strip() == b"True"


@pytest.mark.ci("loads experiments")
def test_a_single_environment_passes_the_checker_of_gymnasium():
    from gymnasium.utils.env_checker import check_env

    env = gymnasium.make("eqt/Attitude-v0", config=attitude(), episodes=4).unwrapped
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*Box observation space.*")  # without bounds
        check_env(env, skip_render_check=True)
    env.reset(seed=0)
    vector = gymnasium.make_vec("eqt/Attitude-v0", num_envs=2, config=attitude(), episodes=4)
    vector.reset(seed=0)
    for _ in range(5):
        observed, reward, *ends, info = env.step([0.1, 0.2, 0.3])
        several = vector.step([[0.1, 0.2, 0.3]] * 2)
        assert (observed == several[0][0]).all()
        assert reward == several[1][0]
        assert ends == [False, False]
        assert info["run"] == several[4]["run"][0]
    env.close()


@pytest.mark.ci("loads an experiment twice")
def test_a_copy_in_another_process_goes_on_alike():
    for reward in ("mean_pose_error", None):
        env = eqt_cli.gym.make(attitude(), num_envs=3, episodes=8, reward=reward)
        env.reset(seed=1)
        stepped(env, 7)
        copied = pickle.loads(pickle.dumps(env))
        pairs = zip(stepped(env, 30), stepped(copied, 30), strict=True)  # into the next episodes
        assert all((x == y).all() for one, other in pairs for x, y in zip(one, other, strict=True))


@pytest.mark.ci("loads tasks of the suite")
def test_tasks_of_the_suite_are_environments_by_their_names(tmp_path):
    env = eqt_cli.gym.make("eqt-suite-2/quad_att", num_envs=1, episodes=2)
    assert env.training_seed == 1
    assert env.reward.text == "-mean_pose_error"
    assert env.single_observation_space.shape == (15,)  # rotation, rates, and a command on its way
    env.write_law(tmp_path / "net.yaml", "net.onnx")
    law = yaml_source.load((tmp_path / "net.yaml").read_bytes(), "").data
    assert law["commands"] == {"as": "wrench", "scale": [1.5, 1.5, 0.4]}  # the limit of the task
    again = eqt_cli.gym.make(
        "eqt-suite-2/quad_att",
        1,
        law=tmp_path / "net.yaml",
        episodes=2,
        overrides={"time.duration": 1},
    )
    assert again.study.document.data["controllers"][0]["observes"] == law["observes"]
    assert again.plant.ticks == 100
    assert env.cost is None
    priced = eqt_cli.gym.bounded(env)
    assert env.bound == ("effort", 0.75)
    priced.reset()
    price, plain = None, eqt_cli.gym.make("eqt-suite-2/quad_att", 1, episodes=2)
    plain.reset()
    for k in range(40):
        action = np.full((1, 3), np.sin(k))
        _, reward, _, _, info = priced.step(action)
        usual = plain.step(action)[1]
        spent = info["cost"] / (0.75 / env.plant.ticks)
        price = 0.02 * -usual[0] if price is None else price
        price *= np.exp(3e-3 * np.clip(spent[0] - 1, -1, 1))
        assert reward == pytest.approx(usual - price * spent, rel=1e-12)  # rounding
    for made, sentence in (
        (lambda: eqt_cli.gym.bounded(3), "bounded: expected an environment…got int"),
        (lambda: eqt_cli.gym.bounded(env, 0), "most: expected a positive number, got 0"),
        (
            lambda: eqt_cli.gym.bounded(eqt_cli.gym.make(attitude(), 1, episodes=2)),
            "bounded: nothing says what an episode may spend…(make(…, cost='effort'), 60)…",
        ),
    ):
        assert says(error_of(made), sentence)
    for name, options, sentence in (
        ("eqt-suite-1/quad_att", {}, "…this eqt judges by eqt-suite-2…name eqt-suite-2/quad_att"),
        ("eqt-suite-2/quadatt", {}, "no task 'quadatt' in eqt-suite-2; did you mean 'quad_att'?"),
        ("eqt-suite-2/fast_eight", {}, "…attitude law within a cascade…name one of late, quad…"),
        ("eqt-suite-2/late", {"seed": 999}, "seed: 999 is suite.judge.seed, by whose runs…"),
        ("eqt-suite-2/late", {"law": 3}, "law: expected the YAML file of a network…got 3"),
    ):
        said = error_of(eqt_cli.gym.make, name, **options)
        assert says(said, sentence), said
