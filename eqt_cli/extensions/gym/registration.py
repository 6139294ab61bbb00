"""Environments of Gymnasium by name: ``gymnasium.make_vec("eqt/Attitude-v0", config=…)``."""

from __future__ import annotations

import gymnasium

IDS = {"eqt/Attitude-v0": "eqt-suite-2/quad_att", "eqt/Pose-v0": "eqt-suite-2/uuv_station"}
"""Names, and what each is of where no `config` is named."""


PLACE = __name__.rpartition(".")[0]
"""The package; Gymnasium imports what makes an environment when it makes one."""


def register() -> None:
    """Register the names, once."""
    for name, config in IDS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point=f"{PLACE}.one:single",
                vector_entry_point=f"{PLACE}.environment:make",
                kwargs={"config": config},
            )
