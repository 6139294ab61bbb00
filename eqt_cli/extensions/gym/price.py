"""A bound of what a policy spends in the mean, as the suite has: charged at a price that adapts."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.gym.environment import Environment

FIRST = 0.02
"""What is charged at first of a step that spends its share of the bound, as a share of the size of
the first rewards."""


class Bounded(gymnasium.vector.VectorWrapper):
    """A vector environment whose reward pays for its cost; see `bounded`.

    Attributes
    ----------
    price
        What a step costs that spends its share of the bound; 0 before the first step.
    """

    def __init__(self, env: Any, most: float, rate: float) -> None:
        super().__init__(env)
        self.price, self._rate = 0.0, rate
        self._share = most / env.unwrapped.plant.ticks

    def step(self, actions: Any) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Move every environment by a control period; ``info`` has the `price`."""
        observations, rewards, terminated, truncated, info = self.env.step(actions)
        spent = info["cost"] / self._share
        if not self.price:
            self.price = FIRST * float(np.abs(rewards).mean() or 1.0)
        self.price *= float(np.exp(self._rate * np.clip(spent.mean() - 1, -1, 1)))
        info["price"] = np.full(len(spent), self.price)
        return observations, rewards - self.price * spent, terminated, truncated, info


def bounded(env: Any, most: float | None = None, *, rate: float = 3e-3) -> Bounded:
    """Return an environment whose rewards keep what a policy spends within a bound, in the mean.

    The cost of a step is charged at a price, which rises while the mean over the environments
    spends more than the bound, and falls while it spends less (a Lagrange multiplier).

    Parameters
    ----------
    env
        An environment of `make`, with a `cost` or with a bound, as one of a task of the suite, or a
        wrapper of Gymnasium around one.
    most
        What an episode may spend. Default: the bound of the task, or that in ``tune.equal``.
    rate
        How fast the price adapts: by at most this share in a step.

    Returns
    -------
    Bounded
        A `gymnasium.vector.VectorWrapper`.

    Raises
    ------
    EqtError
        If nothing says what is spent, or how much.

    Examples
    --------
    >>> env = eqt_cli.gym.bounded(eqt_cli.gym.make("eqt-suite-2/late", num_envs=2, episodes=4))
    >>> env.unwrapped.bound
    ('effort', 75.0)
    """
    inner = getattr(env, "unwrapped", None)
    if not isinstance(inner, Environment):
        raise EqtError(
            f"bounded: expected an environment of eqt_cli.gym.make, got {type(env).__name__}"
        )
    if inner.bound is None and (most is None or inner.cost is None):
        raise EqtError(
            "bounded: nothing says what an episode may spend; give the metric and its bound, as "
            "bounded(make(…, cost='effort'), 60), or write tune: {equal: {effort: 60}}"
        )
    metric, usual = inner.bound or ("", 0.0)
    if inner.cost is None:
        inner.set_cost(metric)
    most = usual if most is None else most
    for name, value in {"most": most, "rate": rate}.items():
        if not isinstance(value, int | float) or not 0 < value < np.inf:  # type: ignore[redundant-expr]
            raise EqtError(f"{name}: expected a positive number, got {value!r}")
    return Bounded(env, float(most), rate)
