"""One environment of Gymnasium, for its checkers, evaluations and programs that take no vectors."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from eqt_cli.api.loading import Configuration
from eqt_cli.base.arrays import Array
from eqt_cli.extensions.gym.environment import Environment, make


class SingleEnvironment(gymnasium.Env[Array, Array]):
    """A vector environment of one, as one environment; see `single`.

    Attributes
    ----------
    vector
        The vector environment, with all else: `exactly`, `record`, `check`, `set_reward`.
    """

    def __init__(self, vector: Environment) -> None:
        self.vector = vector
        self.metadata = {"render_modes": []}
        self.observation_space = vector.single_observation_space
        self.action_space = vector.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin a new episode; see `Environment.reset`."""
        super().reset(seed=seed)
        observations, info = self.vector.reset(seed=seed, options=options)
        return observations[0], _first(info)

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Move by a control period."""
        observations, rewards, *ends, info = self.vector.step(np.ma.asarray(action)[None])
        terminated, truncated = (bool(end[0]) for end in ends)
        return observations[0], float(rewards[0]), terminated, truncated, _first(info)

    def close(self) -> None:
        """Close the environment."""
        self.vector.close()


def _first(info: dict[str, Any]) -> dict[str, Any]:
    """Return what a vector environment says of its first one."""
    return {
        name: _first(value) if isinstance(value, dict) else value[0]
        for name, value in info.items()
        if not name.startswith("_")
    }


def single(
    config: Configuration, seed: int | None = None, *, episodes: int = 256, **options: Any
) -> SingleEnvironment:
    """Return an experiment as one environment of Gymnasium.

    Each step costs as much as one of 64 environments of `make`.

    Parameters
    ----------
    config, seed, episodes
        As of `make`, with fewer episodes.
    options
        Further ones of `make`, but for ``num_envs``, ``autoreset`` and ``stagger``.

    Returns
    -------
    SingleEnvironment
        A `gymnasium.Env`.

    Examples
    --------
    >>> env = eqt_cli.gym.single("examples/gym/attitude.yaml", episodes=4)
    >>> observation, info = env.reset(seed=0)
    >>> observation.shape, env.action_space.shape
    ((12,), (3,))
    """
    vector = make(config, 1, seed, autoreset="disabled", episodes=episodes, **options)
    return SingleEnvironment(vector)
