"""Remarks before a run: wheels that friction brings to rest."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.errors import KeyPath
from eqt_cli.components.vehicle import ACTUATORS
from eqt_cli.config.experiment import Experiment
from eqt_cli.engines.horizon import Horizon
from eqt_cli.extensions.spacecraft.wheels import Wheels


@purposes.remarks_on_an_experiment
def remarks(experiment: Experiment, shown: Horizon | None) -> Iterator[tuple[KeyPath, str]]:
    """Yield wheels without a bias whose dry friction takes away the momenta that add up to 0.

    No torque on the body holds these: J_w Ω̇ = −c Ω − T_c, to 0 in J_w/c ln(1 + c Ω/T_c).
    """
    end = experiment.config.time.duration
    for index, actuator in enumerate(experiment.loop.vehicle.actuators):
        wheels: Any = actuator
        if not isinstance(wheels, Wheels):
            continue
        wheels = wheels if wheels.matrix is not None else wheels.of_run(experiment.group, None)
        if wheels.rubbing is None or wheels.pulled is not None:
            continue
        viscous, coulomb = wheels.rubbing[:2]
        null = np.eye(wheels.count) - wheels.inverse @ wheels.matrix
        momenta = np.abs(null @ np.array(wheels.start))
        if not coulomb or momenta.max() <= 1e-9 * np.abs(wheels.start).max():
            continue
        viscous_loss = viscous * momenta.max() / np.min(wheels.inertia)
        lasts = momenta.max() / coulomb
        lasts *= np.log1p(viscous_loss / coulomb) / (viscous_loss / coulomb) if viscous else 1.0
        if lasts < end:
            yield (
                (ACTUATORS, index),
                f"friction brings wheels from {momenta.max():.3g} N m s to rest in about "
                f"{lasts:.3g} s, of which the torque on the body shows nothing, and near speed 0 "
                "it hampers them; add bias: {momentum: [...], time_constant: 20 s}",
            )
