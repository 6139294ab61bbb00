"""Finds registered laws among the points of a sweep over the options of laws."""

from collections.abc import Hashable
from dataclasses import replace
from typing import Any

import numpy as np

from eqt_cli.config.source import with_value
from eqt_cli.controllers import Controller, controllers
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems, parse_key
from eqt_cli.core.leaves import leaves
from eqt_cli.core.option_types import component, option_names
from eqt_cli.experiment.build import OF_EVERY_LAW
from eqt_cli.experiment.study import Study, section_of

LAW = "law"
"""Variable of a sweep's result that holds the names."""

STATES = 4
"""Number of random states at which torques are compared; one suffices for smooth laws."""

ROUNDING = 1e-12
"""Tolerance relative to the largest torque, for sums of some tens of products in another order."""


def law_names(study: Study) -> Array | None:
    """Return the names by point and controller; "" if a controller equals no law without options.

    None if no swept key changes the controllers. Laws are equal if their structures and their
    parameters are equal, or, if nothing else is swept, if they give the same torque. For example,
    the frame of the damping makes no difference if K_d is the same in every frame. Only the laws of
    each point are built, which takes little time.
    """
    sweep = study.sweep
    keys = [key for key in sweep.sets if section_of(key) == "controllers"] if sweep else []
    if sweep is None or not keys:
        return None
    known: dict[Hashable, str] = {}
    for kind in controllers.all():
        if not option_names(kind):
            known.setdefault(_identity(kind()), kind.name)
    G, laws = study.base.group, [loop.controller for loop in study.base.loops.values()]
    comparable = all(law.gains_group(G) is G for law in laws) and len(keys) == len(sweep.sets)
    alike = _Torques(study) if comparable else None
    names = np.full((len(study), len(study.base.loops)), "", dtype=object)
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
            names[point, index] = known[identity]
    return names


class _Torques:
    """The torques of the registered laws without options at some states of an experiment."""

    def __init__(self, study: Study) -> None:
        base, random = study.base, np.random.default_rng(0)
        loop, G = next(iter(base.loops.values())), base.group
        Q, Qd = G.exp(random.standard_normal((2, STATES, G.dimension)))
        V, Vd = random.standard_normal((2, STATES, G.dimension))
        self.loop, self.start = loop, (Q, V, Qd, Vd)
        fitting = (kind for kind in controllers.all() if base.config.task in kind.tasks)
        laws = [kind() for kind in fitting if not option_names(kind)]
        self.known = [(law.name, self._of(law)) for law in laws if law.fits(G)]

    def name(self, law: Controller) -> str:
        """Return the first law with the same torques, up to rounding; "" if there is none."""
        expected = self._of(law)
        bound = ROUNDING * np.abs(expected).max()
        equal = (name for name, torque in self.known if np.abs(torque - expected).max() <= bound)
        return next(equal, "")

    def _of(self, law: Controller) -> Array:
        loop = replace(self.loop, controller=law)
        return law.torque(loop.tracking(0.0, loop.initial_state(*self.start)))


def _law(entry: Any) -> Controller:
    """Build the law of a valid entry of the configuration."""
    if isinstance(entry, dict):
        entry = {key: value for key, value in entry.items() if key not in OF_EVERY_LAW}
    law = component(controllers, entry, Problems())
    assert law is not None
    return law


def _identity(law: Controller) -> Hashable:
    """Return a key that is equal for laws of equal structure and parameters."""
    numbers = {name: (value + 0.0).tobytes() for name, value in leaves(law).items()}
    return law.structure, tuple(sorted(numbers.items()))  # + 0.0 turns -0.0 into 0.0
