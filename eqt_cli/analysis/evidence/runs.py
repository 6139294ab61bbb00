"""The runs of one law as far as a result keeps them, and the setting that all laws share."""

from dataclasses import dataclass

import numpy as np

from eqt_cli.analysis.evidence.flight import VehicleRuns
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.controllers import Controller
from eqt_cli.core.arrays import Array

ENERGY_PER_RTOL = 100.0
"""Allowed error of L per unit of `rtol`: steps err by about rtol and number hundreds, and damping
forgets most of it (measured over all groups and laws: 0.2 to 3)."""

STATES_PER_RTOL = 1000.0
"""Allowed error of states per unit of `rtol`, as in the cross-check: trajectories amplify it,
190 times for a run of nog in the paper's ensemble that is solved alone."""


@dataclass(frozen=True)
class Runs:
    """Metrics and trajectories of the good runs of one controller.

    Attributes
    ----------
    label
        Of the controller.
    claims_decrease
        Whether L is claimed to decrease; None where the law says nothing.
    rtol
        The accuracy that the runs were asked for.
    threshold
        Pose error below which a run counts as arrived; with thresholds by part, the norm of these.
    times : (samples,)
    lyapunov : (runs, samples) or None
        L; None where no trajectories are kept.
    energy_residual, group_drift, final_pose_error, final_velocity_error : (runs,)
        As in a result.
    error_system
        Largest difference of E, integrated by itself, to X X_d⁻¹ of the closed loop, relative to
        the largest entry of E or 1; None where no run could be compared.
    failed
        How many runs have no end.
    departures
        What the loop holds of which the theorems do not speak, in words.
    flight
        Runs of a loop that is not ideal, as they were integrated.
    energy, theorem
        Which function L is, and where it is shown to fall.
    pose_error, velocity_error : (runs, samples) or None
        Over time, of the runs whose trajectories are kept; None where none are.
    settled : (runs,) or None
        Which runs have arrived, where thresholds by part say so.
    desired_speed
        The largest ‖V_d‖.
    """

    label: str
    claims_decrease: bool | None
    rtol: float
    threshold: float
    times: Array
    lyapunov: Array | None
    energy_residual: Array
    group_drift: Array
    final_pose_error: Array
    final_velocity_error: Array
    error_system: float | None
    failed: int = 0
    departures: str = ""
    flight: VehicleRuns | None = None
    energy: str = Controller.energy
    theorem: str = Controller.theorem
    pose_error: Array | None = None
    velocity_error: Array | None = None
    settled: Array | None = None
    desired_speed: float = 0.0

    @property
    def own_function(self) -> str:
        """Which function L is, where it is not the paper's."""
        return "" if self.energy == Controller.energy else f"L = {self.energy}"

    @property
    def count(self) -> int:
        """The number of good runs."""
        return len(self.energy_residual)

    @property
    def no_dissipation(self) -> bool:
        """Whether the law does not say what it dissipates."""
        return bool(np.isnan(self.energy_residual).all())

    @property
    def remark(self) -> str:
        """How many runs failed, where some did."""
        return f"{self.failed} runs failed" if self.failed else ""

    def decay_rate(self) -> float:
        """The median over runs of the rate of log L, fitted over the second half of the horizon.

        Positive where L falls; NaN where there is nothing to fit.
        """
        if self.lyapunov is None or not len(self.lyapunov):
            return float("nan")
        later = self.times >= (self.times[0] + self.times[-1]) / 2
        t, L = self.times[later], self.lyapunov[:, later]
        usable = (L > 0).all(axis=1)
        if later.sum() < 2 or not usable.any():
            return float("nan")
        slopes = np.polyfit(t, np.log(L[usable]).T, 1)[0]
        return float(-np.median(slopes))


@dataclass(frozen=True)
class Setting:
    """An experiment's assumptions.

    Attributes
    ----------
    loops
        The closed loops by label; all but the controller is common to them.
    times : (samples,)
        The horizon.
    desired_pose, desired_velocity : (samples, …)
        Q_d and V_d along it.
    rigid
        Whether the inertia is said to be a rigid body's.
    """

    loops: dict[str, ClosedLoop]
    times: Array
    desired_pose: Array
    desired_velocity: Array
    rigid: bool = True

    @property
    def loop(self) -> ClosedLoop:
        """Any of the loops, for what they have in common."""
        return next(iter(self.loops.values()))


def largest(values: Array) -> float:
    """The largest of some numbers; NaN is larger than any."""
    return float(np.max(values))
