"""Remarks before a run: a steady force that the rates of a cascade mistake for an acceleration."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array, apply_matrix
from eqt_cli.base.errors import KeyPath
from eqt_cli.components.forces import weighed
from eqt_cli.components.matrix_groups import rigid
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.remarks import along_reference, gains_flown
from eqt_cli.engines.horizon import Horizon
from eqt_cli.extensions.underactuated.cascade import Cascade

ENLARGED = 0.05
"""Least distance, m, by which the rates enlarge an offset that is remarked on."""


@purposes.remarks_on_an_experiment
def remarks(experiment: Experiment, shown: Horizon | None) -> Iterator[tuple[KeyPath, str]]:
    """Yield cascades whose derived rates enlarge the offset by a steady force.

    At rest in an unknown acceleration a it is a/k_x, and by `rates: model` 1 + (D k_v + k_x)/H
    times that, with the stiffness H and the damping D of the attitude per inertia.
    """
    model = experiment.config.known_forces
    cascades = {k: x for k, x in experiment.loops.items() if isinstance(x.controller, Cascade)}
    if model == "plant" or not cascades:
        return
    shown = shown or experiment.reference_over_horizon()
    first: Any = next(iter(cascades.values())).controller
    pushes: Array = np.array(first.direction)
    unknown = _unknown(experiment, model or (), shown, pushes)
    for label, loop in cascades.items():
        law: Any = loop.controller
        gains = law.position
        small = gains_flown(experiment, shown).get(label)
        if law.rates != "model" or gains.ki is not None or small is None:
            continue
        along = unknown**2 / max(unknown @ unknown, np.finfo(float).tiny)
        kx, kv = (float(along @ (np.array(x, float) + 0 * along)) for x in (gains.kx, gains.kv))
        H, D = np.array(small.stiffness)[0], np.array(small.damping)[0]
        ratio = 1.0 + (D[0, 0] * kv + kx) / H[0, 0]
        size = float(np.linalg.norm(unknown))
        offset = size / kx if size else 0.0
        if offset * (ratio - 1.0) > ENLARGED:
            yield (
                ("controllers", experiment.laws[label].index, "rates"),
                f"a steady force that the model does not know, {size:.2g} m/s^2, moves the body "
                f"by {ratio * offset:.2g} m, {ratio:.2g} times as far as with `rates: none` or "
                "`filter`, since model takes it for an acceleration; give one of them, "
                "`position.ki`, or the mean wind in model.forces",
            )


def _unknown(experiment: Experiment, model: Any, shown: Horizon, pushes: Array) -> Array:
    """Return the mean acceleration along the reference by forces that no law knows, m/s², in space.

    Only what acts across the push tilts the body.
    """
    G, loop = experiment.group, next(iter(experiment.loops.values()))
    times, poses, velocities = along_reference(experiment, shown)
    part: Any = rigid(G).translation
    sums: list[Array] = []
    foreseen = weighed(G, tuple(force.of_run(G, None) for force in model), loop.inertia)
    for forces in (loop.vehicle.forces, foreseen):
        total: Any = np.zeros_like(velocities)
        for t, Q, V, here in zip(times, poses, velocities, total, strict=True):
            for force in forces:
                here += np.reshape(force.in_body(G, float(t), Q[None], V[None]), -1)
        sums.append(total[:, part.axes])
    mass = loop.inertia.at(0.0).matrix[-1, -1]
    rotations = poses[:, : rigid(G).space, : rigid(G).space]
    across = sums[0] - sums[1]
    across = across - (across @ pushes)[:, None] * pushes / (pushes @ pushes)
    return apply_matrix(rotations, across).mean(axis=0) / mass
