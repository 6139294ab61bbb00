"""Train a policy for a task of the suite by PPO of Stable-Baselines3, and let the suite judge it.

    pip install stable-baselines3 onnxscript
    python examples/gym/task.py
    eqt suite policy.yaml --tasks quad_att

It takes a minute of a core, and ends with 1.2 times the error of GT at 0.9 of the effort.
"""

import torch
from eqt_cli.gym import bounded, make, sb3
from stable_baselines3 import PPO

torch.set_num_threads(1)
env = make("eqt-suite-2/quad_att", num_envs=256, stagger=True)
model = PPO(
    "MlpPolicy",
    sb3(bounded(env)),
    n_steps=32,
    batch_size=2048,
    n_epochs=4,
    gamma=0.97,
    gae_lambda=0.9,
    learning_rate=lambda left: 1e-3 * left + 1e-5,
    policy_kwargs={"log_std_init": -1.0, "net_arch": [64, 64], "activation_fn": torch.nn.Tanh},
    seed=1,
    device="cpu",
)
model.learn(2_000_000)

# What flies is the mean of the actions, without exploration.
mean = torch.nn.Sequential(model.policy.mlp_extractor.policy_net, model.policy.action_net).eval()
observation = torch.zeros(1, *env.single_observation_space.shape)
torch.onnx.export(mean, (observation,), "policy.onnx", external_data=False, verbose=False)
env.record("policy.onnx")
env.check("policy.onnx", lambda x: mean(torch.as_tensor(x)).detach().numpy())
env.write_law("policy.yaml", "policy.onnx")
