"""The desired motion, of a result or before anything is run."""

from collections.abc import Sequence

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError, Problems
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.experiment.horizon import check_reference, reference_over_horizon
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.plots.drawing.labels import notation
from eqt_cli.plots.shown.controllers import ALL, Chosen, error_of, positions
from eqt_cli.results.result import Result

MOST_REMARKS = 3
"""Largest number of remarks on a reference below its figure."""


class ShownReference:
    """The desired motion of an experiment, from a result or before anything is run.

    Parameters
    ----------
    source
        The open result, or the experiment.
    figure, chosen
        See `ShownControllers`; the reference is the same for all controllers.

    Attributes
    ----------
    group
        The group G.
    times : (n,)
        Sample times, s.
    pose : (n, d, d)
        Desired poses Q_d.
    velocity, torque : (n, m)
        Desired velocity V_d and torque τ_d, body frame.

    Raises
    ------
    EqtError
        If the result is a sweep, lacks the reference or is on an unknown group.
    """

    def __init__(self, source: Result | Experiment, figure: str, chosen: Chosen = ALL) -> None:
        self._remarks: list[str] = []
        self.group, of = self._take(source, figure, chosen.controllers)
        place = "the reference" if isinstance(source, Experiment) else str(source.path)
        shown = chosen.time.samples(
            of[0], lambda message: EqtError(f"{place}: figure '{figure}' {message}")
        )
        self.times, self.pose, self.velocity, self.torque = (each[shown] for each in of)

    def _take(
        self, source: Result | Experiment, figure: str, chosen: Sequence[str]
    ) -> tuple[MatrixLieGroup, tuple[Array, Array, Array, Array]]:
        """Return the group, and times, poses, velocities and torques over the whole horizon."""
        if isinstance(source, Experiment):
            desired = reference_over_horizon(source)
            problems = Problems(lambda path: "")
            jumps = check_reference(desired, None, problems)
            self._remarks += [problem.message for problem in problems] + jumps
            return source.group, (desired.times, desired.pose, desired.velocity, desired.torque)
        source.single(f"figure '{figure}' shows single experiments")
        positions([source], figure, chosen)
        needed = ("desired_pose", "desired_velocity", "desired_torque")
        source.check_stored(*needed, who=f"figure '{figure}' needs")
        if source.group is None:
            raise error_of(source, figure, f"does not know group '{source.group_name}' of a plugin")
        pose, velocity, torque = (source[name] for name in needed)
        return source.group, (source.times, pose, velocity, torque)

    def notes(self) -> list[str]:
        """Return the first remarks: where the reference is not finite, and where it jumps."""
        shown = [f"The reference: {notation(each)}." for each in self._remarks[:MOST_REMARKS]]
        left = len(self._remarks) - len(shown)
        return [*shown, f"And {left} more jumps."] if left else shown
