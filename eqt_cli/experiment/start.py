"""Initial states of the runs of an experiment, from the rows of a file."""

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
    """The initial states of the runs.

    Attributes
    ----------
    poses, velocities
        Q_d(0)⁻¹ Q(0) and V(0) − V_d(0).
    resolved
        The complete section of the configuration.
    rows
        Number of runs for which there are initial states; None for any number.
    files
        Contents of the files with data, by their names.
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
    """Read the rows of `initial.file`; return None after noting their problems.

    Relative poses are errors to the reference, Q(0) = Q_d(0) · pose and V(0) = V_d(0) + V. Missing
    velocities are 0.
    """
    name = section.file
    assert name is not None
    for key in ("pose", "velocity"):
        if key in section.model_fields_set:
            problems.at(key).add(f"{name} gives the {key}, one row per run; remove this key")
    if G is None:
        return None
    mapping = section.mapping or LogMapping()
    mapping.check(problems.at(MAPPING))
    if problems.at(MAPPING):
        return None
    with problems.catching("file"):
        text = data_file(source, name)
        try:
            poses, velocities = read_starts(text, name, G, mapping)
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
