"""The laws that have a name of their own, found among the points of a sweep over their options."""

from collections.abc import Hashable
from dataclasses import replace
from typing import Any

import numpy as np

from eqt_cli.config.source import with_value
from eqt_cli.controllers import Controller, controllers
from eqt_cli.core.arrays import Array
from eqt_cli.core.leaves import leaves
from eqt_cli.core.problems import Problems, parse_key
from eqt_cli.core.validation import component, option_names
from eqt_cli.experiment.build import OF_EVERY_LAW
from eqt_cli.experiment.config_at_point import section_of
from eqt_cli.experiment.study import Study

LAW = "law"
"""The variable of a sweep that holds their names."""

STATES = 4
"""Random states at which torques are compared; one would do for laws that are smooth."""

ROUNDING = 1e-12
"""Of the largest torque: what sums of some tens of products in another order may differ by."""


def law_names(study: Study) -> Array | None:
    """The names by point and controller, "" where the controller equals no law without options.

    None where no swept key changes the controllers. Laws are equal if their structures and their
    parameters are, or, where nothing else is swept, if they ask for the same torque: with a K_d
    that looks alike from every frame, the frame of the damping is no difference. Of each point only
    the laws are built, which takes little time.
    """
    sweep = study.sweep
    keys = [key for key in sweep.sets if section_of(key) == "controllers"] if sweep else []
    if sweep is None or not keys:
        return None
    known: dict[Hashable, str] = {}
    for kind in controllers.all():
        if not option_names(kind):
            known.setdefault(_identity(kind()), kind.name)
    alike = _Torques(study) if len(keys) == len(sweep.sets) else None
    found = np.full((len(study), len(study.base.loops)), "", dtype=object)
    for point in range(len(study)):
        values = sweep.settings(point)
        data: Any = {"controllers": study.source.data["controllers"]}
        for key in filter(values.__contains__, keys):
            data = with_value(data, parse_key(key), values[key])
        for index, entry in enumerate(data["controllers"]):
            law = _law(entry)
            identity = _identity(law)
            if identity not in known:
                known[identity] = alike.name(law) if alike and law.code is None else ""
            found[point, index] = known[identity]
    return found


class _Torques:
    """What the laws with a name of their own ask for at some states of an experiment."""

    def __init__(self, study: Study) -> None:
        base, random = study.base, np.random.default_rng(0)
        loop, G = next(iter(base.loops.values())), base.group
        Q, Qd = G.exp(random.standard_normal((2, STATES, G.dimension)))
        V, Vd = random.standard_normal((2, STATES, G.dimension))
        self.loop, self.start = loop, (Q, V, Qd, Vd)
        fitting = (kind for kind in controllers.all() if base.config.task in kind.tasks)
        laws = [kind() for kind in fitting if not option_names(kind)]
        self.known = [(law.name, self._of(law)) for law in laws]

    def name(self, law: Controller) -> str:
        """The first law that asks for the same torques, up to rounding; "" if there is none."""
        asked = self._of(law)
        bound = ROUNDING * np.abs(asked).max()
        equal = (name for name, torque in self.known if np.abs(torque - asked).max() <= bound)
        return next(equal, "")

    def _of(self, law: Controller) -> Array:
        loop = replace(self.loop, controller=law)
        return law.torque(loop.tracking(0.0, loop.initial_state(*self.start)))


def _law(entry: Any) -> Controller:
    """The law that an entry of the configuration, which is right, asks for."""
    if isinstance(entry, dict):
        entry = {key: value for key, value in entry.items() if key not in OF_EVERY_LAW}
    law = component(controllers, entry, Problems())
    assert law is not None
    return law


def _identity(law: Controller) -> Hashable:
    """Equal for laws of equal structure and parameters."""
    numbers = {name: (value + 0.0).tobytes() for name, value in leaves(law).items()}
    return law.structure, tuple(sorted(numbers.items()))  # + 0.0: for -0.0 is 0.0
