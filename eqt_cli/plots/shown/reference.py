"""The desired motion, of a result or before anything is run."""

from collections.abc import Sequence

from eqt_cli.core.problems import Problems
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.experiment.horizon import check_reference, reference_over_horizon
from eqt_cli.plots.shown.controllers import error_of, positions
from eqt_cli.results.result import Result

MOST_REMARKS = 3
"""Lines about one reference, below its figure."""


class ShownReference:
    """The desired motion of an experiment, from a result or before anything is run.

    Parameters
    ----------
    source
        The open result, or the experiment.
    figure, chosen
        As for `ShownControllers`; the reference is the same for all controllers.

    Attributes
    ----------
    group
        G.
    times : (n,)
        s.
    pose : (n, d, d)
        Q_d.
    velocity, torque : (n, m)
        V_d and τ_d, body frame.

    Raises
    ------
    EqtError
        If the result is a sweep's, lacks the reference or is on a group that is not known.
    """

    def __init__(
        self, source: Result | Experiment, figure: str, chosen: Sequence[str] = ()
    ) -> None:
        self._remarks: list[str] = []
        if isinstance(source, Experiment):
            found = reference_over_horizon(source)
            self.group, self.times = source.group, found.times
            self.pose, self.velocity, self.torque = found.pose, found.velocity, found.torque
            problems = Problems(lambda path: "")
            jumps = check_reference(found, None, problems)
            self._remarks += [problem.message for problem in problems] + jumps
            return
        source.single(f"figure '{figure}' shows single experiments")
        positions([source], figure, chosen)
        needed = ("desired_pose", "desired_velocity", "desired_torque")
        source.check_stored(*needed, who=f"figure '{figure}' needs")
        if source.group is None:
            raise error_of(source, figure, f"does not know group '{source.group_name}' of a plugin")
        self.group, self.times = source.group, source.times
        self.pose, self.velocity, self.torque = (source[name] for name in needed)

    def notes(self) -> list[str]:
        """Where the reference leaves the real numbers, and where it jumps; the first places."""
        shown = [f"The reference: {remark}." for remark in self._remarks[:MOST_REMARKS]]
        left = len(self._remarks) - len(shown)
        return [*shown, f"And {left} more jumps."] if left else shown
