from eqt_cli.extensions.gym.entry import gym as gym
