"""The `reference` to track, or the `target` to come to rest at: Q_d, V_d and what drives them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from eqt_cli.config.components import component, option_path, resolved
from eqt_cli.config.problems import Path, Problems
from eqt_cli.config.schema import TargetSection
from eqt_cli.config.translate import problems_of
from eqt_cli.core.arrays import Array
from eqt_cli.core.numbers import Real
from eqt_cli.experiment import tensors
from eqt_cli.experiment.pose import pose_from
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.references import Reference, references
from eqt_cli.references.constant import ConstantReference

DEFAULTS = {"pose": "identity", "velocity": 0.0}
"""Q_d(0) and V_d(0), which every reference takes beside its own options."""


@dataclass(frozen=True)
class Motion:
    """The desired motion.

    Attributes
    ----------
    reference
        What drives it.
    pose, velocity
        Q_d(0) and V_d(0).
    resolved
        The section of the configuration that describes it, complete.
    """

    reference: Reference
    pose: Array
    velocity: Array
    resolved: dict[str, Any]


def motion_from(
    task: str | None,
    reference: dict[str, Any] | None,
    target: TargetSection | None,
    G: MatrixLieGroup | None,
    problems: Problems,
) -> Motion | None:
    """The motion that a configuration asks for, or None after noting what is wrong with it."""
    if task == "stabilise":
        if reference is not None:
            problems.add(("reference",), "belongs to task: track; task: stabilise has a target")
        return _rest(target or TargetSection(), G, problems)
    if target is not None:
        problems.add(("target",), "belongs to task: stabilise; task: track has a reference")
    if reference is None:
        if task == "track":
            problems.add(("reference",), "missing; task: track needs the trajectory to follow")
        return None
    return _tracked(reference, G, problems)


def _rest(target: TargetSection, G: MatrixLieGroup | None, problems: Problems) -> Motion | None:
    """The target pose, at rest for all time."""
    if G is None:
        return None
    pose = pose_from(target.pose, G, ("target", "pose"), problems)
    if pose is None:
        return None
    section = {"target": {"pose": _as_floats(target.pose)}}
    return Motion(ConstantReference(), pose, np.zeros(G.dimension), section)


def _tracked(
    section: dict[str, Any], G: MatrixLieGroup | None, problems: Problems
) -> Motion | None:
    common = {key: section.get(key, default) for key, default in DEFAULTS.items()}
    options = {"kind": "torque"} | {k: v for k, v in section.items() if k not in common}
    reference = component(references, options, ("reference",), problems, tuple(DEFAULTS))
    if G is None:
        return None
    for option, message in reference.problems(G) if reference else ():
        problems.add(option_path(("reference",), option), message)
    pose = pose_from(common["pose"], G, ("reference", "pose"), problems)
    velocity = _velocity(common["velocity"], G, problems)
    if reference is None or pose is None or velocity is None:
        return None
    described = {**resolved(reference), **_as_floats(common)}
    return Motion(reference, pose, velocity, {"reference": described})


def _as_floats(value: Any) -> Any:
    """The same with whole numbers as floats, so that 0 and 0.0 describe one experiment."""
    if isinstance(value, dict):
        return {key: _as_floats(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_as_floats(entry) for entry in value]
    return float(value) if isinstance(value, int) else value


def _velocity(value: Any, G: MatrixLieGroup, problems: Problems) -> Array | None:
    path: Path = ("reference", "velocity")
    try:
        numbers = TypeAdapter(Real | list[Real]).validate_python(value)
    except ValidationError as error:
        for place, message in problems_of(error, value, lambda _: {}):
            problems.add((*path, *place), message)
        return None
    velocity = tensors.vector(numbers, G.dimension, G)
    if isinstance(velocity, str):
        problems.add(path, velocity)
        return None
    return velocity
