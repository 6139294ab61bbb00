"""The name `eqt_cli.gym`."""

from eqt_cli.extensions import gym

__all__ = ["gym"]
