"""Train the policy of attitude.yaml by PPO of Stable-Baselines3, and export it.

    pip install stable-baselines3 onnxscript
    python examples/gym/train.py

It takes 5 minutes of two cores. Seeds are fixed; another machine rounds otherwise, and finds other
weights that fly alike.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import torch
from eqt_cli.gym import make, sb3
from stable_baselines3 import PPO

HERE = Path(__file__).parent


def main() -> None:
    """Train, export, record what the policy was trained for, and check that eqt flies it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=HERE / "policy.onnx")
    parser.add_argument("--steps", type=int, default=6_000_000)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    torch.set_num_threads(1)
    env = make(HERE / "attitude.yaml", num_envs=256, stagger=True)
    model = PPO(
        "MlpPolicy",
        sb3(env),
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
    # What flies is the mean of the actions, without exploration.
    mean = torch.nn.Sequential(model.policy.mlp_extractor.policy_net, model.policy.action_net)
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
