"""Stable-Baselines3 trains on the environment by `eqt_cli.gym.sb3`; where it is installed."""

import pickle

import numpy as np
import pytest
from policies import attitude
from said import error_of, says

import eqt_cli

pytest.importorskip("gymnasium", reason="needs the extra gym")
trainers = pytest.importorskip("stable_baselines3", reason="tests its adapter")
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize  # noqa: E402

pytestmark = [
    pytest.mark.ci("trains, where Stable-Baselines3 is installed"),
    pytest.mark.filterwarnings("ignore"),  # of the trainer
]


def made(**options):
    return eqt_cli.gym.make(attitude(), num_envs=4, episodes=8, **options)


@pytest.fixture(scope="module")
def adapted():
    reward = lambda x: {"error": -x.pose_error, "time": -x.t}  # noqa: E731
    return eqt_cli.gym.sb3(made(reward=reward, cost=lambda x: x.t > 1, privileged=["velocity"]))


def test_ends_and_costs_arrive_in_the_infos_of_environments(adapted):
    watched, ticks = VecMonitor(adapted), adapted.env.plant.ticks
    watched.reset()
    for _ in range(ticks):
        *_, done, infos = watched.step(np.zeros((4, 3), np.float32))
    assert done.all()
    for info in infos:
        assert info["TimeLimit.truncated"]
        assert info["episode"]["l"] == ticks
        assert info["terminal_observation"].shape == (15,)
        assert info["cost"] == 0
        assert [*info["reward_terms"]] == ["error", "time", "end"]
        assert info["privileged"]["velocity"].shape == (3,)


def test_a_seed_reaches_the_environment_and_attributes_are_those_of_each(adapted):
    starts = []
    for seed in (3, 3, 4):
        adapted.seed(seed)
        starts.append(adapted.reset())
    assert (starts[0] == starts[1]).all()
    assert (starts[0] != starts[2]).any()
    assert adapted.get_attr("runs") == adapted.env.runs.tolist()
    assert adapted.get_attr("label", [0, 2]) == ["policy"] * 2
    (error,) = adapted.env_method("exactly", "pose_error", indices=1)
    assert error == adapted.env.exactly("pose_error")[1]
    assert not adapted.has_attr("nothing")
    assert says(error_of(adapted.set_attr, "x", 1, [0]), "set_attr: all environments are one…")
    assert says(error_of(eqt_cli.gym.sb3, made(autoreset="disabled")), "sb3: expected…same_step…")


@pytest.mark.parametrize("name", ["PPO", "SAC"])
def test_trainers_train_and_a_seed_repeats_them(name):
    kinds = {"PPO": {"n_steps": 32, "batch_size": 64}, "SAC": {"learning_starts": 20}}
    weights = []
    for _ in range(2):
        adapted = VecNormalize(pickle.loads(pickle.dumps(eqt_cli.gym.sb3(made()))))
        model = getattr(trainers, name)("MlpPolicy", adapted, seed=0, **kinds[name])
        before = [x.detach().clone() for x in model.policy.parameters()]
        model.learn(128)
        weights.append([x.detach().numpy() for x in model.policy.parameters()])
    assert any((x.numpy() != y).any() for x, y in zip(before, weights[0], strict=True))
    assert all((x == y).all() for x, y in zip(*weights, strict=True))
