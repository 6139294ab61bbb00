"""The laws that have a name of their own, found among the points of a sweep over their options."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any

import numpy as np

from eqt_cli.controllers import Controller, controllers
from eqt_cli.core.arrays import Array
from eqt_cli.experiment.components import component, option_names
from eqt_cli.experiment.point import path_of, section_of
from eqt_cli.experiment.problems import Problems
from eqt_cli.experiment.source import with_value
from eqt_cli.experiment.study import Study

LAW = "law"
"""The variable of a sweep that holds their names."""


def law_names(study: Study) -> Array | None:
    """The names by point and controller, "" where the controller equals no law without options.

    None where no swept key changes the controllers. Of each point only these are built, which takes
    little time.
    """
    sweep = study.sweep
    keys = [key for key in sweep.keys if section_of(key) == "controllers"] if sweep else []
    if sweep is None or not keys:
        return None
    known: dict[Hashable, str] = {}
    for kind in controllers.all():
        if not option_names(kind):
            known.setdefault(_identity(kind()), kind.name)
    found = np.full((len(study), len(study.base.loops)), "", dtype=object)
    for point in range(len(study)):
        values = sweep.point(point)
        data: Any = {"controllers": study.source.data["controllers"]}
        for key in keys:
            data = with_value(data, path_of(key), values[key], "")
        for index, entry in enumerate(data["controllers"]):
            found[point, index] = known.get(_identity(_law(entry)), "")
    return found


def _law(entry: Any) -> Controller:
    """The law that an entry of the configuration, which is right, asks for."""
    path = ("controllers",)
    law = component(controllers, _without_label(entry), path, Problems(str))
    assert law is not None
    return law


def _without_label(entry: Any) -> Any:
    if not isinstance(entry, dict):
        return entry
    return {key: value for key, value in entry.items() if key != "label"}


def _identity(law: Controller) -> Hashable:
    """Equal for laws of equal structure and parameters."""
    numbers = {name: (value + 0.0).tobytes() for name, value in law.parameters.items()}
    return law.structure, tuple(sorted(numbers.items()))  # + 0.0: for -0.0 is 0.0
