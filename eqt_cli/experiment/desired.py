"""The `reference` to track, or the `target` to come to rest at: Q_d, V_d and what drives them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from eqt_cli.config.schema import TargetSection
from eqt_cli.core.arrays import Array
from eqt_cli.core.numbers import Real
from eqt_cli.core.problems import Problems
from eqt_cli.core.validation import as_section, component, validated
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.references import Reference, references
from eqt_cli.references.constant import ConstantReference
from eqt_cli.written.poses import pose_from, vector

DEFAULTS = {"pose": "identity", "velocity": 0.0}
"""Q_d(0) and V_d(0), which every reference takes beside its own options."""


@dataclass(frozen=True)
class DesiredTrajectory:
    """Where the loop is to go.

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


def desired_from(
    task: str | None,
    reference: dict[str, Any] | None,
    target: TargetSection | None,
    G: MatrixLieGroup | None,
    problems: Problems,
) -> DesiredTrajectory | None:
    """What a configuration asks to track, or None after noting what is wrong with it.

    Parameters
    ----------
    problems
        Of the whole configuration.
    """
    at_reference, at_target = problems.at("reference"), problems.at("target")
    if task == "stabilise":
        if reference is not None:
            at_reference.add("belongs to task: track; task: stabilise has a target")
        return _rest(target or TargetSection(), G, at_target)
    if target is not None:
        at_target.add("belongs to task: stabilise; task: track has a reference")
    if reference is None:
        if task == "track":
            at_reference.add("missing; task: track needs the trajectory to follow")
        return None
    return _tracked(reference, G, at_reference)


def _rest(
    target: TargetSection, G: MatrixLieGroup | None, problems: Problems
) -> DesiredTrajectory | None:
    """The target pose, at rest for all time."""
    pose = None if G is None else pose_from(target.pose, G, problems.at("pose"))
    if G is None or pose is None:
        return None
    section = {"target": {"pose": _as_floats(target.pose)}}
    return DesiredTrajectory(ConstantReference(), pose, np.zeros(G.dimension), section)


def _tracked(
    section: dict[str, Any], G: MatrixLieGroup | None, problems: Problems
) -> DesiredTrajectory | None:
    common = {key: section.get(key, default) for key, default in DEFAULTS.items()}
    options = {"kind": "torque"} | {k: v for k, v in section.items() if k not in common}
    reference = component(references, options, problems, tuple(DEFAULTS))
    if G is None:
        return None
    if reference is not None:
        reference.check(G, problems)
    pose = pose_from(common["pose"], G, problems.at("pose"))
    velocity = None
    numbers = validated(Real | list[Real], common["velocity"], problems.at("velocity"))
    if numbers is not None:
        with problems.catching("velocity"):
            velocity = vector(numbers, G.dimension, G)
    if reference is None or pose is None or velocity is None:
        return None
    described = {**as_section(reference), **_as_floats(common)}
    return DesiredTrajectory(reference, pose, velocity, {"reference": described})


def _as_floats(value: Any) -> Any:
    """The same with whole numbers as floats, so that 0 and 0.0 describe one experiment."""
    if isinstance(value, dict):
        return {key: _as_floats(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_as_floats(entry) for entry in value]
    return float(value) if isinstance(value, int) else value
