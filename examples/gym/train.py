"""Train the policy of attitude.yaml by PPO of Stable-Baselines3, and export it.

    pip install stable-baselines3 onnxscript
    python examples/gym/train.py

It takes 5 minutes of two cores. Seeds are fixed; another machine rounds otherwise, and finds other
weights that fly alike.
"""

import argparse
import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv

import eqt_cli

HERE = Path(__file__).parent


# The environment as Stable-Baselines3 takes one ---------------------------------------------------


class Adapter(VecEnv):
    """A vector environment of Gymnasium, in the mode SAME_STEP, for Stable-Baselines3."""

    def __init__(self, env: Any) -> None:
        self.env = env
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> Any:
        return self.env.reset()[0]

    def step_async(self, actions: Any) -> None:
        self.actions = actions

    def step_wait(self) -> Any:
        observed, reward, terminated, truncated, info = self.env.step(self.actions)
        infos: list[dict[str, Any]] = [{} for _ in reward]
        for i in np.flatnonzero(terminated | truncated):
            infos[i]["terminal_observation"] = info["final_obs"][i]
            infos[i]["TimeLimit.truncated"] = bool(truncated[i])
        return observed, reward.astype(np.float32), terminated | truncated, infos

    def close(self) -> None:
        self.env.close()

    def get_attr(self, name: str, indices: Any = None) -> list[Any]:
        return [getattr(self.env, name, None)] * self.num_envs

    def set_attr(self, name: str, value: Any, indices: Any = None) -> None:
        setattr(self.env, name, value)

    def env_method(self, name: str, *args: Any, indices: Any = None, **more: Any) -> list[Any]:
        return [getattr(self.env, name)(*args, **more)] * self.num_envs

    def env_is_wrapped(self, wrapper: Any, indices: Any = None) -> list[bool]:
        return [False] * self.num_envs


# The training -------------------------------------------------------------------------------------


class Mean(torch.nn.Module):
    """The mean of a policy's actions: what flies has no exploration."""

    def __init__(self, policy: Any) -> None:
        super().__init__()
        self.hidden, self.last = policy.mlp_extractor.policy_net, policy.action_net

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return self.last(self.hidden(x))


def main() -> None:
    """Train, export, record what the policy was trained for, and check that eqt flies it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=HERE / "policy.onnx")
    parser.add_argument("--steps", type=int, default=6_000_000)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    torch.set_num_threads(1)
    env = eqt_cli.gym.make(HERE / "attitude.yaml", num_envs=256, stagger=True)
    model = PPO(
        "MlpPolicy",
        Adapter(env),
        n_steps=32,
        batch_size=2048,
        n_epochs=4,
        gamma=0.97,
        gae_lambda=0.9,
        learning_rate=lambda left: 1e-3 * left + 1e-5,
        policy_kwargs={"log_std_init": -0.7, "net_arch": [64, 64], "activation_fn": torch.nn.Tanh},
        seed=args.seed,
        device="cpu",
    )
    began = time.process_time()
    model.learn(args.steps)
    seconds = time.process_time() - began
    mean = Mean(model.policy).eval()
    torch.onnx.export(mean, (torch.zeros(1, 12),), args.out, external_data=False, verbose=False)
    env.record(args.out)

    def policy(observed: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return mean(torch.as_tensor(observed)).numpy()

    apart = env.check(args.out, policy)
    observed, rewards = env.reset(options={"runs": np.arange(256)})[0], []
    for _ in range(200):
        observed, reward, *_ = env.step(policy(observed))
        rewards.append(reward)
    print(f"{model.num_timesteps:,} steps in {seconds:.0f} s of the CPU")
    print(f"mean pose error of 256 runs of the training: {-np.mean(rewards):.4f}")
    print(f"eqt run flies it as the environment does, to {apart:.1g}")


if __name__ == "__main__":
    main()
