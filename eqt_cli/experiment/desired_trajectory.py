"""The sections `reference` and `target`: the desired trajectory Q_d, V_d."""

from contextlib import suppress
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np

from eqt_cli.config.named_files import with_data
from eqt_cli.config.schema import TargetSection
from eqt_cli.config.source import ConfigSource
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError, Problems, parse_key
from eqt_cli.core.option_types import (
    VELOCITY,
    Real,
    Unit,
    as_section,
    component,
    option_names,
    validated,
)
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.over_time import GivenOverTime
from eqt_cli.notation.poses import pose_from, vector
from eqt_cli.references import Reference, references
from eqt_cli.references.constant import ConstantReference

DEFAULTS = {"pose": "identity", "velocity": 0.0}
"""Default Q_d(0) and V_d(0), for references that start from them."""


@dataclass(frozen=True)
class DesiredTrajectory:
    """The desired trajectory of the loop.

    Attributes
    ----------
    reference
        The reference.
    pose, velocity
        Q_d(0) and V_d(0).
    resolved
        The complete section of the configuration.
    files
        Contents of the files with data, by their names.
    """

    reference: Reference
    pose: Array
    velocity: Array
    resolved: dict[str, Any]
    files: dict[str, str] = field(default_factory=dict)


def desired_from(
    task: str | None,
    reference: dict[str, Any] | None,
    target: TargetSection | None,
    G: MatrixLieGroup | None,
    source: ConfigSource,
    problems: Problems,
) -> DesiredTrajectory | None:
    """Return the desired trajectory of a configuration, or None after noting its problems.

    Parameters
    ----------
    problems
        Problems of the whole configuration.
    """
    at_reference, at_target = problems.at("reference"), problems.at("target")
    if task == "stabilise":
        if reference is not None:
            at_reference.add("is a key of task: track; give a target for task: stabilise")
        return _rest(target or TargetSection(), G, at_target)
    if target is not None:
        at_target.add("is a key of task: stabilise; give a reference for task: track")
    if reference is None:
        if task == "track":
            at_reference.add("missing; task: track needs a reference to follow")
        return None
    return _tracked(reference, G, source, at_reference)


def _rest(
    target: TargetSection, G: MatrixLieGroup | None, problems: Problems
) -> DesiredTrajectory | None:
    """Return the target pose, at rest for all times."""
    if G is None or (pose := pose_from(target.pose, G, problems.at("pose"))) is None:
        return None
    section = {"target": {"pose": _as_floats(target.pose)}}
    return DesiredTrajectory(ConstantReference(target.pose), pose, np.zeros(G.dimension), section)


def _tracked(
    section: dict[str, Any], G: MatrixLieGroup | None, source: ConfigSource, problems: Problems
) -> DesiredTrajectory | None:
    name, kind = section.get("kind", "torque"), None
    with suppress(InputError):
        kind = references.get(name) if isinstance(name, str) else None
    takes = tuple(DEFAULTS) if kind is None else kind.starts_from
    own = [] if kind is None else option_names(kind)
    for key in (key for key in DEFAULTS if key in section and key not in (*takes, *own)):
        problems.at(key).add(f"a reference of kind {name} determines its {key}; remove this key")
        section = {name: value for name, value in section.items() if name != key}
    common = {key: section.get(key, DEFAULTS[key]) for key in takes}
    options = {"kind": "torque"} | {k: v for k, v in section.items() if k not in common}
    reference = component(references, options, problems, takes, G, check=False)
    if G is None:
        return None
    texts: dict[str, str] = {}
    if reference is not None:
        reference, texts = with_data(reference, source, problems)
        reference.check(G, problems)
    pose, velocity = G.identity, np.zeros(G.dimension)
    if "pose" in common:
        given_pose = pose_from(common["pose"], G, problems.at("pose"))
        pose = pose if given_pose is None else given_pose
    if "velocity" in common:
        coordinates: Any = Annotated[Real | list[Real], Unit(VELOCITY)]
        numbers = validated(coordinates, common["velocity"], problems.at("velocity"), group=G)
        if numbers is not None:
            with problems.catching("velocity"):
                velocity = vector(numbers, G.dimension, G)
    if reference is None or problems:
        return None
    described = as_section(reference) | common
    poses = {key: _as_floats(described[key]) for key in DEFAULTS if key in described}
    described = {"reference": described | poses}
    pose, velocity = reference.initial(G, pose, velocity)
    return DesiredTrajectory(reference, pose, velocity, described, texts)


def check_horizon(
    given: GivenOverTime, key: str, G: MatrixLieGroup, duration: float, problems: Problems
) -> None:
    """Note runs that start before the data of a key over time, outlast them, or meet a gap."""
    here, (first, last) = problems.at(*parse_key(key)), given.ends(G)
    if first > 0:
        here.add(f"begins at {first:g} s, but runs begin at 0 s; shift its times")
    if last < duration:
        what = key if key == "reference" else f"recording of {key}"
        problems.at("time", "duration").add(
            f"expected at most {last:g} s, the end of the {what}, got {duration:g}"
        )
    within = [gap for gap in given.gaps(G) if gap[0] < duration and sum(gap) > 0]
    for begin, length in within[:1]:
        here.add(
            f"has a gap of {length:.4g} s after t = {begin:.6g} s, within the run; end the run "
            f"there, `time: {{duration: {begin:.6g}}}`, or begin after it, `mapping: {{time: "
            "{begin: …, offset: first}}`"
        )


def _as_floats(value: Any) -> Any:
    """Convert integers to floats, so that 0 and 0.0 describe the same experiment."""
    if isinstance(value, dict):
        return {key: _as_floats(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_as_floats(entry) for entry in value]
    return float(value) if isinstance(value, int) else value
