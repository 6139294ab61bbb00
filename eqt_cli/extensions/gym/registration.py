"""Environments of Gymnasium by name: ``gymnasium.make_vec("eqt/Attitude-v0", config=…)``."""

from __future__ import annotations

from typing import Any

import gymnasium

IDS = {"eqt/Attitude-v0": "eqt-suite-2/quad_att", "eqt/Pose-v0": "eqt-suite-2/uuv_station"}
"""Names, and what each is of where no `config` is named."""


def register() -> None:
    """Register the names, once."""
    for name, config in IDS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point=f"{__name__}:one",
                vector_entry_point=f"{__name__}:several",
                kwargs={"config": config},
            )


def one(config: Any, **options: Any) -> Any:
    """Return one environment."""
    from eqt_cli.extensions.gym.one import single

    return single(config, **options)


def several(config: Any, num_envs: int, **options: Any) -> Any:
    """Return a vector environment."""
    from eqt_cli.extensions.gym.environment import make

    return make(config, num_envs, **options)
