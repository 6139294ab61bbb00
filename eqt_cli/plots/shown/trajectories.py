"""Trajectories of the runs of one or several results."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from eqt_cli.closed_loop.signals import MIXED
from eqt_cli.core.arrays import Array
from eqt_cli.ensemble.spread import Stream, generator_at
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.rotations import turn_of_distance
from eqt_cli.mechanics.tracking import Tracking
from eqt_cli.plots.drawing.labels import in_words, signal_label
from eqt_cli.plots.shown.controllers import ALL, Chosen, Ensemble, ShownControllers, error_of, names
from eqt_cli.results.result import Result

_NORMS = ("pose_error", "velocity_error", "torque_norm")


MEMBERS = {"thrust": "thruster", "wheel_momentum": "wheel"}
"""Dimensions of signals that have a row for each thruster or wheel."""


class ShownRuns(ShownControllers):
    """Trajectories of the runs that did not fail, of one or several results on one group.

    Raises
    ------
    EqtError
        In the cases of `ShownControllers`, or if a result holds no trajectories of good runs.
    """

    def __init__(self, results: Sequence[Result], figure: str, chosen: Chosen = ALL) -> None:
        super().__init__(results, figure, chosen)
        self._time = chosen.time
        for one in results:
            self._check_stored(one, "lyapunov")
            if len(one.times) < 2:
                message = (
                    "needs trajectories of two samples or more, and the result holds one; "
                    "decrease store.decimate and run the experiment again"
                )
                raise error_of(one, figure, message)
        self.ensembles = [
            replace(e, good=e.results.good[e.controller][e.results.stored_runs])
            for e in self.ensembles
        ]
        if not self.shown:
            raise self.error("has nothing to show: every run whose trajectory is stored failed")

    def with_function(self) -> list[Ensemble]:
        """Return the controllers whose L is drawn; add a remark that names the others."""
        others = [e.title for e in self.shown if e.law in e.results.without_function]
        named = ", ".join(others)
        remark = f"Without L, since the law does not claim that it falls: {named}."
        if others and remark not in self.remarks:
            self.remarks.append(remark)
        return [e for e in self.shown if e.law not in e.results.without_function]

    @property
    def span(self) -> tuple[float, float]:
        """First and last time of all results."""
        ends = [one.times[self._samples(one)[[0, -1]]] for one in self.results]
        return float(np.min(ends)), float(np.max(ends))

    def times(self, ensemble: Ensemble) -> Array:
        """Return the sample times of a controller's runs."""
        return ensemble.results.times[self._samples(ensemble.results)]

    def _samples(self, result: Result) -> Array:
        """Return the indices of the samples that are shown."""
        return self._time.samples(result.times, partial(error_of, result, self.figure))

    def values(self, signal: str, ensemble: Ensemble, most: int | None = None) -> Array:
        """Return a signal of the good runs of a controller, ``(runs, samples, …)``.

        Parameters
        ----------
        most
            Largest number of runs to read, from the first; all if None.

        Raises
        ------
        EqtError
            If the result does not hold the signal over time.
        """
        return self._stored(signal, ensemble, most) * ensemble.results.factor(signal)

    def _stored(self, signal: str, ensemble: Ensemble, most: int | None = None) -> Array:
        """Return `values` in the unit of the file."""
        self._check_stored(ensemble.results, signal)
        every = ensemble.results.trajectories(signal, ensemble.controller, most)
        return every[:, self._samples(ensemble.results)]

    def of_run(self, signal: str, ensemble: Ensemble, run: int) -> Array:
        """Return a signal of one run of a controller, ``(samples, …)``.

        Raises
        ------
        EqtError
            If the run failed, or the result does not hold its trajectory.
        """
        values: Array = ensemble.results.trajectory(signal, run)[ensemble.controller]
        if not ensemble.results.good[ensemble.controller, run]:
            raise self.error(f"cannot show run {run} of {ensemble.label}, which failed")
        return values[self._samples(ensemble.results)] * ensemble.results.factor(signal)

    def errors(self, signal: str, ensemble: Ensemble, *, degrees: bool) -> Array:
        """Return `values` of a norm; with `degrees`, rotations are angles and in deg/s."""
        values = self.values(signal, ensemble)
        turns = signal.replace("estimate_error", "pose_error") in self.results[0].attitude_errors
        if degrees and turns:
            _, factor = self.results[0].shown_in("", "deg")
            return np.degrees(turn_of_distance(values)) * factor
        return np.degrees(values) if degrees and self._turns_at(signal) else values

    def error_label(self, signal: str, *, degrees: bool) -> str:
        """Return the label of the scale of `errors`."""
        if degrees and signal in self.results[0].attitude_errors:
            return in_words("attitude error", self.results[0].shown_in("", "deg")[0])
        label = signal_label(self.results[0], signal)
        return label.replace("rad/s", "deg/s") if degrees and self._turns_at(signal) else label

    def _turns_at(self, signal: str) -> bool:
        """Whether a signal is the norm of angular velocities in rad/s."""
        of_pose = signal.replace("velocity_error", "pose_error")
        turns = of_pose != signal and of_pose in self.results[0].attitude_errors
        return turns and self.unit(signal) == "rad/s"

    def require_attitude(self, *, degrees: bool) -> None:
        """Refuse degrees where there is no attitude error."""
        if degrees and not self.results[0].attitude_errors:
            group = self.results[0].group_name
            raise self.error(f"finds no attitude error on {group} to show in degrees")

    def numbers(self, ensemble: Ensemble, most: int | None = None) -> Array:
        """Return the numbers of the good runs of a controller, in the order of `values`."""
        return ensemble.results.stored_runs[ensemble.good][:most]

    def desired(self, signal: str, ensemble: Ensemble) -> Array:
        """Return a signal of the reference, ``(samples, …)``: ``torque`` for τ_d."""
        self._check_stored(ensemble.results, f"desired_{signal}")
        values = self._desired(signal, ensemble)
        return values * ensemble.results.factor(f"desired_{signal}")

    def _desired(self, signal: str, ensemble: Ensemble) -> Array:
        return ensemble.results[f"desired_{signal}"][self._samples(ensemble.results)]

    def feedforward(self, ensemble: Ensemble) -> Array:
        """Return the feedforward torque of the good runs, body frame, ``(runs, samples, m)``.

        Raises
        ------
        EqtError
            If the law has no separate feedforward, the loop is not ideal, or the experiment cannot
            be built.
        """
        result = ensemble.results
        if result.loop_in_words:
            raise self.error(
                f"separates feedforward from feedback in ideal loops only. {result.loop_in_words}"
            )
        loop = result.experiment().loops[ensemble.law]
        poses, velocities = (self._stored(name, ensemble) for name in ("pose", "velocity"))
        desired = [self._desired(name, ensemble) for name in ("pose", "velocity", "torque")]
        torque = np.empty_like(velocities)
        for k, t in enumerate(self.times(ensemble)):
            inertia = loop.inertia.at(t)
            Qd, Vd, tau_d = (each[k] for each in desired)
            state = Tracking(
                G=loop.group,
                inertia=inertia,
                gains=loop.gains,
                t=t,
                Q=poses[:, k],
                P=inertia.momentum(velocities[:, k]),
                Qd=Qd,
                Pd=inertia.momentum(Vd),
                tau_d=tau_d,
            )
            given = loop.controller.feedforward_torque(state)
            if given is None:
                raise self.error(
                    f"cannot separate the feedforward of {ensemble.title}: the law does not say "
                    "which of its terms are feedforward; choose others with the option "
                    "'controllers'"
                )
            torque[:, k] = given
        return torque * result.factor("torque")

    @cached_property
    def parts(self) -> list[str]:
        """Suffixes of the norms per part, such as ``_rotation``; else one empty suffix."""
        first = self.results[0]
        suffixes = [f"_{part}" for part in first.parts(_NORMS[0])]
        return [end for end in suffixes if all(first.has(norm + end) for norm in _NORMS)] or [""]

    @property
    def group(self) -> MatrixLieGroup | None:
        """The group of all results; None if it is of a plugin that is not loaded."""
        return self.results[0].group

    @cached_property
    def axes(self) -> list[tuple[str, str]]:
        """Name and torque unit of each algebra coordinate."""
        axes = [str(name) for name in self.results[0].coordinate("axis")]
        units = [self.unit("torque")] * len(axes)
        if MIXED in units and self.group is not None:
            for part in self.group.parts:
                unit, _ = self.results[0].shown_in("torque", part.force_unit)
                units[part.axes] = [unit] * len(axes[part.axes])
        return list(zip(axes, units, strict=True))

    def members(self, signal: str) -> list[str]:
        """Return the names of the thrusters, or of the wheels, that have the signal.

        Raises
        ------
        EqtError
            If a vehicle has none, or its names differ from the first vehicle's.
        """
        member = MEMBERS[signal]
        for one in self.results:
            if not one.has(signal):
                message = f"finds no {member}s on this vehicle; leave out the option '{member}s'"
                raise error_of(one, self.figure, message)
        names = [[str(name) for name in one.coordinate(member)] for one in self.results]
        if any(each != names[0] for each in names):
            raise self.error(f"has a row for each {member}, and the results have other {member}s")
        return names[0]

    def limits(self, ensemble: Ensemble, run: int, signal: str) -> tuple[Array, Array] | None:
        """Return the smallest and largest torque of each axis in a run, or signal of each member.

        None if the vehicle has no such limits.
        """
        experiment = ensemble.results.experiment()
        vehicle = experiment.loops[ensemble.law].vehicle
        random_of = partial(generator_at, experiment.config.ensemble.seed, Stream.VEHICLE, run)
        flying = vehicle.of_run(experiment.group, random_of)
        known = {"thrust": flying.thrust_limits, "wheel_momentum": flying.momentum_limits}
        limits = known[signal] if signal in known else flying.torque_limits(experiment.group)
        factor = ensemble.results.factor(signal)
        return limits and (limits[0] * factor, limits[1] * factor)

    def notes(self) -> list[str]:
        """Return notes on loops and stored runs, then `ShownControllers.notes`."""
        return [*self._loops(), *self._thinned(), *super().notes()]

    def _loops(self) -> Iterator[str]:
        """Yield how each loop differs from the paper's ideal loop."""
        for one, name in zip(self.results, names(self.results), strict=True):
            if words := one.loop_in_words:
                yield f"{name}: {words}" if len(self.results) > 1 else words

    def _thinned(self) -> Iterator[str]:
        for one, name in zip(self.results, names(self.results), strict=True):
            if len(one.stored_runs) < one.runs:
                whose = f" of {name}" if len(self.results) > 1 else ""
                yield f"Trajectories of the first {len(one.stored_runs)} of {one.runs} runs{whose}."

    def _check_stored(self, result: Result, signal: str) -> None:
        result.check_stored(signal, who=f"figure '{self.figure}' needs")
