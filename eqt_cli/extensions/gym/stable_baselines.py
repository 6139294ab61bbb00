"""The environment as Stable-Baselines3 takes one."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.gym.environment import MODES

try:
    VecEnv: Any = import_module("stable_baselines3.common.vec_env").VecEnv
except ImportError:
    raise EqtError(
        "eqt_cli.gym.sb3 needs Stable-Baselines3, which is not installed; pip install "
        "stable-baselines3"
    ) from None

PASSED = "cost", "cost_terms", "privileged", "reward_terms"
"""What each environment's `info` has of that of all."""


class StableBaselines(VecEnv):  # type: ignore[misc]
    """A vector environment of Gymnasium for Stable-Baselines3; see `sb3`.

    Attributes
    ----------
    env
        The vector environment.
    """

    def __init__(self, env: Any) -> None:
        self.env, self._actions = env, np.empty(0)
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self) -> Array:
        """Begin new episodes, in the order of the seed that `seed` was called with last."""
        options = next(filter(None, self._options), None)
        observations, info = self.env.reset(seed=self._seeds[0], options=options)
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = self._infos(info)
        return np.asarray(observations)

    def step_async(self, actions: Any) -> None:
        """Take the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[Array, Array, Array, list[dict[str, Any]]]:
        """Move every environment by a control period."""
        observations, rewards, terminated, truncated, info = self.env.step(self._actions)
        infos, done = self._infos(info), terminated | truncated
        for k in np.flatnonzero(done).tolist():
            infos[k]["terminal_observation"] = info["final_obs"][k]
            infos[k]["TimeLimit.truncated"] = bool(truncated[k] and not terminated[k])
        return observations, np.asarray(rewards, dtype=np.float32), done, infos

    def close(self) -> None:
        """Close the environments."""
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of each environment."""
        return self._parts(getattr(self.env, attr_name), indices)

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of all environments, which are one object."""
        self._require_all(indices)
        setattr(self.env, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call a method once, for all environments; return what each one has of the answer."""
        answer = getattr(self.env, method_name)(*method_args, **method_kwargs)
        return self._parts(answer, indices)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return that no environment has a wrapper of its own."""
        return [False for _ in self._get_indices(indices)]

    def _parts(self, value: Any, indices: Any) -> list[Any]:
        is_of_each = isinstance(value, np.ndarray) and value.shape[:1] == (self.num_envs,)
        return [value[k] if is_of_each else value for k in self._get_indices(indices)]

    def _require_all(self, indices: Any) -> None:
        if len({*self._get_indices(indices)}) < self.num_envs:
            raise EqtError("set_attr: all environments are one object; leave `indices` out")

    def _infos(self, info: dict[str, Any]) -> list[dict[str, Any]]:
        passed = {name: info[name] for name in PASSED if name in info}
        if not passed:
            return [{} for _ in range(self.num_envs)]
        return [{name: _of(x, k) for name, x in passed.items()} for k in range(self.num_envs)]


def _of(value: Any, k: int) -> Any:
    return {name: x[k] for name, x in value.items()} if isinstance(value, dict) else value[k]


def sb3(env: Any) -> StableBaselines:
    """Return an environment of `make` for Stable-Baselines3: ``PPO("MlpPolicy", sb3(env))``.

    Parameters
    ----------
    env
        An environment of `make`, or a wrapper of Gymnasium around one. Each ``info`` of an
        environment has its cost, its terms of the reward and what is privileged.

    Returns
    -------
    StableBaselines
        A `stable_baselines3.common.vec_env.VecEnv`.

    Raises
    ------
    EqtError
        If Stable-Baselines3 is not installed, or it is another environment.
    """
    modes = getattr(env, "metadata", {})
    if modes.get("autoreset_mode") is not MODES["same_step"]:
        raise EqtError(
            "sb3: expected an environment of eqt_cli.gym.make with autoreset='same_step', got "
            f"{type(env).__name__}"
        )
    return StableBaselines(env)
