"""Remarks on a filter whose inertial unit is not where, or not under the weight that it assumes."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.errors import KeyPath
from eqt_cli.components.accelerometer import Lever
from eqt_cli.extensions.navigation.navigation import MOVES, Navigation


@purposes.remarks_on_an_experiment
def of_navigation(experiment: Any, shown: Any) -> Iterator[tuple[KeyPath, str]]:
    """Yield the remarks on an experiment whose laws read `navigation`."""
    loop = next(iter(experiment.loops.values()))
    vehicle, G = loop.vehicle, loop.group
    filter_: Any = vehicle.estimator
    if not isinstance(filter_, Navigation):
        return
    for part in vehicle.schedule(G).unmeasured:
        said = {
            "rotation": "no sensor measures the attitude: the fixes of the position tell the tilt, "
            "and the heading only while the vehicle accelerates sideways",
            "translation": "no sensor measures the position, whose error grows without bound",
        }
        yield ("estimator",), f"{said[part]}; add an entry with `of: {part}` to sensors.pose"
    inertia = loop.inertia.at(0.0)
    true = inertia if vehicle.inertia is None else vehicle.inertia.at(inertia, 0.0)
    mass = true.matrix - (0.0 if true.added is None else true.added)
    weight = np.zeros(3)
    for force in vehicle.forces:
        if (alone := getattr(force, "weight_alone", None)) is not None:
            still = np.zeros(G.dimension)
            weight = weight + alone.in_body(G, 0.0, G.identity, still)[MOVES]
    felt, assumed = weight / mass[3, 3], np.broadcast_to(filter_.gravity, 3)
    if np.abs(felt - assumed).max() > 1e-3 * max(np.abs(felt).max(), np.abs(assumed).max()):
        there, here = (np.round(g, 4).tolist() for g in (felt, assumed))
        yield (
            ("estimator", "gravity"),
            f"the filter takes off {here} m/s^2, and the weight of the plant is {there} m/s^2 "
            "times its mass; give this gravity, or add what weighs to plant.forces, kind restoring",
        )
    if any(isinstance(sensor, Lever) for sensor in vehicle.more_sensors[1]):
        yield (
            ("sensors", "accelerometer"),
            "the filter takes the accelerometer to be at the origin, and lever puts it elsewhere: "
            "turns look like a force",
        )
