"""Stable-Baselines3 trains on the environment by the adapter of the example."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from policies import attitude

import eqt_cli

pytest.importorskip("gymnasium", reason="needs the extra gym")
EXAMPLE = Path(__file__).parents[3] / "examples" / "gym" / "train.py"


@pytest.mark.ci("trains, where Stable-Baselines3 is installed")
@pytest.mark.filterwarnings("ignore")  # of the trainer
def test_stable_baselines_trains_by_the_adapter_of_the_example():
    sb3 = pytest.importorskip("stable_baselines3", reason="the example trains by it")
    from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

    spec = importlib.util.spec_from_file_location("train", EXAMPLE)
    train = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(train)
    env = eqt_cli.gym.make(attitude(), num_envs=4, episodes=8)
    adapted = train.Adapter(env)
    watched = VecMonitor(adapted)
    watched.reset()
    for _ in range(env.plant.ticks):
        *_, done, infos = watched.step(np.zeros((4, 3), np.float32))
    assert done.all()
    for info in infos:
        assert info["TimeLimit.truncated"]
        assert info["episode"]["l"] == env.plant.ticks
        assert info["terminal_observation"].shape == (15,)
    model = sb3.PPO("MlpPolicy", VecNormalize(adapted), n_steps=32, batch_size=64, seed=0)
    before = [x.detach().clone() for x in model.policy.parameters()]
    model.learn(256)
    assert any((x != y).any() for x, y in zip(before, model.policy.parameters(), strict=True))
