"""The `reference` to track, or the `target` to come to rest at: Q_d, V_d and what drives them."""

from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eqt_cli.config.data_files import with_data
from eqt_cli.config.schema import TargetSection
from eqt_cli.config.source import ConfigSource
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError
from eqt_cli.core.option_types import Real
from eqt_cli.core.problems import Problems, parse_key
from eqt_cli.core.validation import as_section, component, option_names, validated
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.over_time import GivenOverTime
from eqt_cli.notation.poses import pose_from, vector
from eqt_cli.references import Reference, references
from eqt_cli.references.constant import ConstantReference

DEFAULTS = {"pose": "identity", "velocity": 0.0}
"""Q_d(0) and V_d(0), of which a reference takes what it starts from, beside its own options."""


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
    files
        Contents of the files that it is read from, by their names.
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
    """What a configuration asks to track, or None after noting what is wrong with it.

    Parameters
    ----------
    problems
        Of the whole configuration.
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
    """The target pose, at rest for all time."""
    pose = None if G is None else pose_from(target.pose, G, problems.at("pose"))
    if G is None or pose is None:
        return None
    section = {"target": {"pose": _as_floats(target.pose)}}
    rest = ConstantReference(pose=target.pose)
    return DesiredTrajectory(rest, pose, np.zeros(G.dimension), section)


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
    reference = component(references, options, problems, takes)
    if G is None:
        return None
    texts: dict[str, str] = {}
    if reference is not None:
        reference, texts = with_data(reference, source, problems)
        reference.check(G, problems)
    pose, velocity = G.identity, np.zeros(G.dimension)
    if "pose" in common:
        found = pose_from(common["pose"], G, problems.at("pose"))
        pose = pose if found is None else found
    if "velocity" in common:
        numbers = validated(Real | list[Real], common["velocity"], problems.at("velocity"))
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
    """Note a run that begins before what a key gives over time, outlasts it, or meets a gap."""
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
            f"there, `time: {{duration: {begin:.6g}}}`, or begin behind it, `mapping: {{time: "
            "{begin: …, offset: first}}`"
        )


def _as_floats(value: Any) -> Any:
    """The same with whole numbers as floats, so that 0 and 0.0 describe one experiment."""
    if isinstance(value, dict):
        return {key: _as_floats(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_as_floats(entry) for entry in value]
    return float(value) if isinstance(value, int) else value
