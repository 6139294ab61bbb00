"""Where the runs of an experiment start: by distributions, or by the rows of a file."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from eqt_cli.config.data_files import data_file
from eqt_cli.config.schema import InitialSection
from eqt_cli.config.source import ConfigSource
from eqt_cli.core.problems import Problems
from eqt_cli.ensemble.listed import ListedPoses, ListedVelocities
from eqt_cli.ensemble.poses import PoseDistribution
from eqt_cli.ensemble.velocities import VelocityDistribution
from eqt_cli.experiment.desired_trajectory import DesiredTrajectory
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.logs.mapping import MAPPING, LogMapping, MappingError
from eqt_cli.logs.reading import read_starts


@dataclass(frozen=True)
class Start:
    """Where the runs start.

    Attributes
    ----------
    poses, velocities
        Q_d(0)⁻¹ Q(0) and V(0) − V_d(0).
    resolved
        The section of the configuration that describes it, complete.
    rows
        For how many runs there are starts; None for any number.
    files
        Contents of the files that they are read from, by their names.
    """

    poses: PoseDistribution
    velocities: VelocityDistribution
    resolved: dict[str, Any]
    rows: int | None = None
    files: dict[str, str] = field(default_factory=dict)


def start_from_file(
    section: InitialSection,
    G: MatrixLieGroup | None,
    desired: DesiredTrajectory | None,
    source: ConfigSource,
    problems: Problems,
) -> Start | None:
    """The rows of `initial.file`, or None after noting what is wrong with them.

    Relative poses are errors to the reference, Q(0) = Q_d(0) · pose and V(0) = V_d(0) + V. Where
    there are no velocities, these are 0.
    """
    name = section.file
    assert name is not None
    for key in ("pose", "velocity"):
        if key in section.model_fields_set:
            problems.at(key).add(f"{name} gives the {key}, one row per run; remove this key")
    if G is None:
        return None
    said = section.mapping or LogMapping()
    said.check(problems.at(MAPPING))
    with problems.catching("file"):
        text = data_file(source, name)
        try:
            poses, velocities = read_starts(text, name, G, said)
        except MappingError as error:
            problems.at(MAPPING, *error.path).add(str(error))
            return None
        if velocities is None:
            velocities = np.zeros((len(poses), G.dimension))
        if desired is None:
            return None
        if not section.relative:
            poses, velocities = G.inverse(desired.pose) @ poses, velocities - desired.velocity
        resolved = section.model_dump(include={"file", "relative", MAPPING}, exclude_none=True)
        listed = ListedPoses(poses), ListedVelocities(velocities)
        return Start(*listed, resolved, len(poses), {name: text})
    return None
