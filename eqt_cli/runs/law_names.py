"""Names of registered laws among the points of a sweep over the options of laws."""

from collections.abc import Hashable
from dataclasses import replace
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array, Arrays
from eqt_cli.base.errors import Problems, parse_key
from eqt_cli.base.option_types import Kind, option_names
from eqt_cli.components.laws import Controller, RunsCode, controllers, fits, gains_group
from eqt_cli.config.designs import Sweep
from eqt_cli.config.document import with_value
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.schema import LawKind
from eqt_cli.config.study import Study, section_of
from eqt_cli.numbers.leaves import leaves

STATES = 4
"""Number of random states at which torques are compared; one suffices for smooth laws."""

ROUNDING = 1e-12
"""Tolerance relative to the largest torque, for sums of some tens of products in another order."""


def law_names(study: Study, sweep: Sweep) -> Array | None:
    """Return the names by point and controller; "" if a controller equals no law without options.

    None if no swept key changes the controllers. Laws are equal if their structures and their
    parameters are equal, or, if nothing else is swept, if they give the same torque. For example,
    the frame of the damping makes no difference if K_d is the same in every frame. Only the laws of
    each point are built, which takes little time.
    """
    keys = [key for key in sweep.sets if section_of(key) == "controllers"]
    if not keys:
        return None
    base, G = study.base, study.base.group
    laws = [kind() for kind in controllers.all() if not option_names(kind)]
    name_of = {_identity(law): law.name for law in reversed(laws)}
    torques: dict[str, Array] = {}
    swept = [loop.controller for loop in base.loops.values()]
    if len(keys) == len(sweep.sets) and all(gains_group(law, G) is G for law in swept):
        fitting = (law for law in laws if base.config.task in law.tasks and fits(law, G))
        torques = {law.name: _torque(law, base) for law in fitting}
    names = np.full((len(study), len(base.loops)), "", dtype=object)
    for point in range(len(study)):
        values = sweep.settings(point)
        data: Any = {"controllers": study.document.data["controllers"]}
        for key in filter(values.__contains__, keys):
            data = with_value(data, parse_key(key), values[key])
        for index, entry in enumerate(data["controllers"]):
            if isinstance(entry, dict):
                entry = {
                    key: value for key, value in entry.items() if key not in LawKind.of_every_entry
                }
            law: Controller = Kind(controllers).read(entry, Problems())
            identity = _identity(law)
            if identity not in name_of:
                name_of[identity] = _law_of_torque(law, base, torques)
            names[point, index] = name_of[identity]
    return names


def _law_of_torque(law: Controller, base: Experiment, torques: Arrays) -> str:
    """Return the first of some laws with the same torque, up to rounding; "" if there is none."""
    # Without memory: at random states, one with memory is compared at none.
    if not torques or isinstance(law, RunsCode) or type(law).memory is not Controller.memory:
        return ""
    torque = _torque(law, base)
    bound = ROUNDING * np.abs(torque).max()
    equal = (name for name, other in torques.items() if np.abs(other - torque).max() <= bound)
    return next(equal, "")


def _torque(law: Controller, base: Experiment) -> Array:
    """Return the torque of a law at some random states of an experiment."""
    G, loop, random = base.group, replace(base.loop, controller=law), np.random.default_rng(0)
    Q, Qd = G.exp(random.standard_normal((2, STATES, G.dimension)))
    V, Vd = random.standard_normal((2, STATES, G.dimension))
    return law.torque(loop.tracking(0.0, loop.initial_state(Q, V, Qd, Vd)))


def _identity(law: Controller) -> Hashable:
    """Return a key that is equal for laws of equal structure and parameters."""
    numbers = {name: (value + 0.0).tobytes() for name, value in leaves(law).items()}
    return law.structure, tuple(sorted(numbers.items()))  # + 0.0 turns -0.0 into 0.0
