"""A reference in closed form as a program from a time, and the piece it is in, to a motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError
from eqt_cli.core.leaves import leaves, with_leaves
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.program import Program, traced
from eqt_cli.references import references
from eqt_cli.references.base import ClosedReference


@dataclass(frozen=True)
class ReferenceProgram:
    """The motion of a reference as a program.

    Attributes
    ----------
    motion
        ``desired_pose``, ``desired_velocity`` and ``desired_acceleration`` from ``t`` and the
        numbers ``held`` in a piece.
    starts : (pieces,)
        Times at which the pieces begin, s; empty for a single piece.
    held : (pieces, n)
        Numbers of each piece.
    """

    motion: Program
    starts: Array
    held: Array


def _closed() -> str:
    """Return the names of the references in closed form, for a message."""
    names = [each.name for each in references.all() if issubclass(each, ClosedReference)]
    return f"{', '.join(names[:-1])} or {names[-1]}"


def reference_program(experiment: Experiment) -> ReferenceProgram:
    """Return the program of the reference of an experiment.

    Raises
    ------
    EqtError
        If the reference is integrated, or uses operations that programs do not have.
    """
    loop = next(iter(experiment.loops.values()))
    G, reference = loop.group, loop.reference
    if not isinstance(reference, ClosedReference):
        both = "velocity" in reference.starts_from
        parts = "Q_d and V_d follow" if both else "Q_d follows"
        raise EqtError(
            f"--reference: the reference '{reference.name}' is integrated: its {parts} from a "
            f"differential equation, and no formula gives {'them' if both else 'it'} at a time. "
            f"Integrate it on the vehicle, or use a reference in closed form: {_closed()}"
        )
    starts = reference.instants(G) if loop.holds else np.empty(0)
    at = starts if len(starts) else np.zeros(1)
    moving = reference.held(G, at)
    numbers = {} if moving is None else leaves(moving)
    rows = [values.reshape(len(at), -1) for values in numbers.values()]
    held = np.concatenate([np.empty((len(at), 0)), *rows], axis=1)

    def motion(given: Mapping[str, Array]) -> Mapping[str, Array]:
        parts = np.split(given["held"], np.cumsum([row.shape[1] for row in rows]))
        own = {
            name: part.reshape(values.shape[1:])
            for (name, values), part in zip(numbers.items(), parts, strict=False)
        }
        here: Any = reference if moving is None else with_leaves(moving, own)
        Q, V, V_dot = here.motion(G, given["t"][0])
        return {
            "desired_pose": Q,
            "desired_velocity": V,
            "desired_acceleration": V_dot,
        }

    try:
        program = traced(motion, {"t": 1, "held": held.shape[1]})
    except Exception as error:
        raise EqtError(
            f"--reference: the reference '{reference.name}' cannot be written as C: "
            f"{type(error).__name__}: {error}"
        ) from error
    return ReferenceProgram(program, starts, held)
