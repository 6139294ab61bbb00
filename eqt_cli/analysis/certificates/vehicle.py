"""Checks the vehicle against its configuration: each part is compared with a second form.

The second form has its own formulas, and draws its numbers again from the configuration. A part of
a plugin has no second form; the remark then names it.
"""

from abc import abstractmethod
from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Row, TrajectoryCheck, Verdict
from eqt_cli.analysis.certificates.flight import ROUNDING, inputs_at_samples
from eqt_cli.analysis.evidence.flight import SLACK, VehicleRuns
from eqt_cli.analysis.evidence.plain_algebra import ad_matrix, applied, exponential
from eqt_cli.analysis.evidence.runs import Runs
from eqt_cli.analysis.evidence.second_vehicle import SecondVehicle, second_vehicles
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array, transpose
from eqt_cli.mechanics.tracking import Tracking

SAMPLES = 20
"""Number of samples of a run at which rates are compared; any of them shows a wrong formula."""

COMMANDS = 40
"""Number of random commands for every run, with sizes between `SIZES`."""

SIZES = -3.0, 3.0
"""Powers of ten: far below and far above what actuators let through."""

OFF_GROUP = 10.0
"""Allowed difference of Q⁻¹ by the group's formula and by elimination, in drifts of the pose."""

Difference = tuple[float, float, str]
"""Difference of two sides, its rounding bound, and its place."""


class VehicleCheck(TrajectoryCheck):
    """A check of the parts between the law's command and the motion."""

    def applies(self, runs: Runs) -> bool:
        """Whether the runs belong to a loop that the check concerns."""
        return runs.flight is not None and self.is_about(runs.flight.problem.loop)

    def is_about(self, loop: ClosedLoop) -> bool:
        """Whether the check concerns this loop."""
        return True

    def check(self, runs: Runs) -> Row:
        """Judge the difference with the largest ratio to its bound, and name its place."""
        flight, label = runs.flight, runs.label
        if flight is None or not len(flight.states):
            return self.row(Verdict.UNDECIDED, remark=runs.remark, controller=label)
        missing = "; ".join(dict.fromkeys(self.without_second_form(second_vehicles(flight)[0])))
        with np.errstate(all="ignore"):  # a quotient with a norm of 0 is not used
            found = [] if missing else list(self.differences(flight))
        if not found:
            return self.row(Verdict.UNDECIDED, remark=missing or runs.remark, controller=label)
        measured, bound, place = max(found, key=_excess)
        remark = place if measured > bound else ""
        return self.compared(float(measured), float(bound), remark or runs.remark, label)

    def without_second_form(self, again: SecondVehicle) -> Iterator[str]:
        """Yield the parts that cannot be compared, in words."""
        yield from ()

    @abstractmethod
    def differences(self, flight: VehicleRuns) -> Iterator[Difference]:
        """Yield all differences."""


class ForcesAgain(VehicleCheck):
    """Compares every force at the states of the runs with its second form."""

    name: ClassVar[str] = "forces are those of the configuration"
    statement: ClassVar[str] = "second form of each force"
    section: ClassVar[float] = 9.01

    def is_about(self, loop: ClosedLoop) -> bool:
        """Whether forces act."""
        return bool(loop.vehicle.forces)

    def without_second_form(self, again: SecondVehicle) -> Iterator[str]:
        """The forces of plugins."""
        yield from _unknown_forces(again)

    def differences(self, flight: VehicleRuns) -> Iterator[Difference]:
        """Force by force, and run by run."""
        few = _few(flight)
        loop, times = few.loop, few.problem.times
        s = loop.tracking(times, few.states)
        for k, force in enumerate(loop.vehicle.forces):
            found = force.in_body(s.G, times, s.Q, s.V) + 0 * s.V
            for again in second_vehicles(few):
                place, acting = list(again.forces())[k]
                assert acting is not None
                expected = acting(times, s.Q[again.index], s.V[again.index])
                yield _difference(found[again.index], expected, place, off_group=_drift(s))


class PlantMoves(VehicleCheck):
    """d(𝕀V)/dt − ad*_V 𝕀V = τ + Σ f at the states of the runs, with the 𝕀 of the plant.

    V̇ is that of the differential equation that was integrated; τ follows from the command.
    """

    name: ClassVar[str] = "plant moves by its forces"
    statement: ClassVar[str] = "d(𝕀V)/dt − ad*_V 𝕀V = τ + forces"
    section: ClassVar[float] = 9.02

    def without_second_form(self, again: SecondVehicle) -> Iterator[str]:
        """The forces and actuators of plugins."""
        yield from _unknown_forces(again)
        yield from _unknown_actuators(again)

    def differences(self, flight: VehicleRuns) -> Iterator[Difference]:
        """Run by run."""
        few = _few(flight)
        loop, times = few.loop, few.problem.times
        s = loop.tracking(times, few.states)
        P_dot = loop.layout.split(loop.vector_field(times, few.states))["momentum"]
        V_dot = s.inertia.velocity(P_dot - s.inertia.rate_force(s.V))
        command = loop.controller.torque(s) + 0 * s.V
        ad = ad_matrix(s.G, s.V)
        for again in second_vehicles(few):
            k = again.index
            matrix, rate = again.inertia(times)
            momentum = applied(matrix, s.V[k])
            inertial = applied(matrix, V_dot[k]) + applied(rate, s.V[k])
            left = inertial - applied(transpose(ad[k]), momentum)
            states = {name: values[k] for name, values in s.vehicle.items()}
            right, _ = again.torque(command[k], states)
            for _, acting in again.forces():
                assert acting is not None
                right = right + acting(times, s.Q[k], s.V[k])
            # The error of an inverse grows with the condition number and the forces.
            loss = float(np.linalg.cond(matrix).max())
            size = float(np.abs(inertial).max() + np.abs(right).max())
            yield _difference(left, right, "", 1 + loss * size, _drift(s))


class ActuatorsAgain(VehicleCheck):
    """Compares output, states and limits of the actuators for commands of all sizes."""

    name: ClassVar[str] = "actuators are those of the configuration"
    statement: ClassVar[str] = "second form of each actuator"
    section: ClassVar[float] = 9.03

    def is_about(self, loop: ClosedLoop) -> bool:
        """Whether there are actuators or delayed commands."""
        return bool(loop.vehicle.actuators) or loop.vehicle.control is not None

    def without_second_form(self, again: SecondVehicle) -> Iterator[str]:
        """The actuators of plugins."""
        yield from _unknown_actuators(again)

    def differences(self, flight: VehicleRuns) -> Iterator[Difference]:
        """Yield differences of torques, rates, states after an instant, and limits."""
        loop, random = flight.loop, np.random.default_rng(flight.seed)
        G, vehicle, runs = loop.group, loop.vehicle, len(flight.states)
        of_estimator = vehicle.estimator_lengths(G)  # which no actuator has
        lengths = {k: n for k, n in vehicle.states(G).items() if k not in of_estimator}
        seconds = second_vehicles(flight)
        if lengths != seconds[0].lengths:
            yield np.inf, ROUNDING, f"states {lengths} instead of {seconds[0].lengths}"
            return
        size = 10 ** random.uniform(*SIZES, (runs, COMMANDS, 1))

        def drawn(length: int) -> Array:
            found: Array = size * random.standard_normal((runs, COMMANDS, length))
            return found

        command = drawn(G.dimension)
        states = {name: drawn(length) for name, length in lengths.items()}
        torque, rates = vehicle.passed(G, command, states)
        limited = vehicle.at_limit(G, command, states)
        alone = {}
        for index, part in enumerate(vehicle.actuators):
            x = states.get(f"actuators_{index}", command[..., :0])
            here = part.at_limit(G, command, x)
            if here is not None:
                alone[index] = here
        later = {} if vehicle.control is None else vehicle.after_instant(G, command, states)
        period = 1.0 if vehicle.control is None else min(1.0, vehicle.control.period)
        for again in seconds:
            k = again.index
            own = {name: values[k] for name, values in states.items()}
            scale = float(size.max()) / period
            expected, moving = again.torque(command[k], own)
            yield _difference(torque[k], expected, "torque", scale)
            for name, rate in moving.items():
                rate_scale = scale + float(np.abs(rate).max())
                yield _difference(rates[name][k], rate, f"rate of {name}", rate_scale)
            if later:
                for name, values in again.after_instant(command[k], own).items():
                    yield _difference(later[name][k], values, name, scale)
            wrong = limited[k] != again.at_limit(command[k], own)
            yield float(wrong.mean()), ROUNDING, "at a limit"
            for index, here in alone.items():
                passed, _ = again.chain(command[k], own, range(index, index + 1))
                wrong = here[k] != again.at_limit_of(index, command[k], own, passed)
                yield float(wrong.mean()), ROUNDING, f"at the limit of actuators[{index}]"


class CommandArrives(VehicleCheck):
    """The command in a period is the law's output `delay` periods earlier; before that, 0.

    This is checked in the stored states wherever they contain both periods.
    """

    name: ClassVar[str] = "command arrives after its delay"
    statement: ClassVar[str] = "zero-order hold, delay in periods"
    section: ClassVar[float] = 9.11

    def is_about(self, loop: ClosedLoop) -> bool:
        """Whether the law is sampled."""
        return loop.vehicle.control is not None

    def without_second_form(self, again: SecondVehicle) -> Iterator[str]:
        """The actuators of plugins."""
        yield from _unknown_actuators(again)

    def differences(self, flight: VehicleRuns) -> Iterator[Difference]:
        """Period by period."""
        loop, times = flight.loop, flight.problem.times
        control, m = flight.problem.loop.vehicle.control, loop.group.dimension
        assert control is not None
        s = loop.tracking(times, flight.states)
        asked = loop.command(s)
        # The last sample is the state before its instant.
        seconds = second_vehicles(flight)
        samples = dict(zip(flight.periods[:-1].tolist(), range(len(times) - 1), strict=True))
        for period, sample in samples.items():
            source = samples.get(period - control.delay)
            if source is None and period >= control.delay:
                continue
            first = asked[:, 0] * 0 if source is None else asked[:, source]
            queue = s.vehicle["commands"][:, sample]
            yield _difference(queue[..., :m], first, f"at t = {times[sample]:g} s")
            yield from self._held(seconds, s.vehicle, first, sample)

    def _held(
        self,
        seconds: list[SecondVehicle],
        states: Mapping[str, Array],
        arrived: Array,
        sample: int,
    ) -> Iterator[Difference]:
        """Yield differences of the output of actuators at instants, if these have no states."""
        for again in seconds:
            parts = range(again.at_instants)
            if not parts or any(f"actuators_{k}" in states for k in parts):
                return
            held, _ = again.chain(arrived[again.index], {}, parts)
            found = states["held"][again.index, sample]
            yield _difference(found, held, f"held at t = {again.time(sample):g} s")


class TruthAndErrors(VehicleCheck):
    """The law's inputs differ from the true state by the configured measurement errors."""

    name: ClassVar[str] = "measurements err as configured"
    statement: ClassVar[str] = "second form of each sensor"
    section: ClassVar[float] = 9.31

    def is_about(self, loop: ClosedLoop) -> bool:
        """Whether there are measurement errors."""
        return loop.vehicle.measures

    def without_second_form(self, again: SecondVehicle) -> Iterator[str]:
        """The sensors of plugins."""
        if again.measurement_errors() is None:
            yield "a sensor has no second form"

    def differences(self, flight: VehicleRuns) -> Iterator[Difference]:
        """Run by run."""
        errors, G = flight.problem.errors, flight.loop.group
        if errors is None:
            yield np.inf, ROUNDING, "the law is told the truth"
            return
        for again in second_vehicles(flight):
            drawn = again.measurement_errors()
            assert drawn is not None
            n, b = drawn
            yield _difference(errors.pose[again.index], exponential(G, n), "sensors.pose")
            yield _difference(errors.velocity[again.index], b, "sensors.velocity")


class MeasurementsArrive(VehicleCheck):
    """The law or the filter reads the last measurement made at least `delay` periods earlier.

    This is checked wherever the stored states contain the instant of the measurement.
    """

    name: ClassVar[str] = "measurements are held and arrive late"
    statement: ClassVar[str] = "rate, delay and dropout of sensors"
    section: ClassVar[float] = 9.32

    def is_about(self, loop: ClosedLoop) -> bool:
        """Whether the law reads held measurements."""
        return bool(loop.vehicle.holding(loop.group))

    def without_second_form(self, again: SecondVehicle) -> Iterator[str]:
        """The sensors of plugins."""
        if again.measurement_errors() is None:
            yield "a sensor has no second form"

    def differences(self, flight: VehicleRuns) -> Iterator[Difference]:
        """Yield differences of every held part, sample by sample."""
        times, G, periods = flight.problem.times, flight.loop.group, flight.periods
        s, vehicle = flight.loop.tracking(times, flight.states), flight.loop.vehicle
        read = inputs_at_samples(flight)
        if vehicle.estimator is not None:  # the filter reads them; the law reads the estimate
            pose, velocity = vehicle.as_arrived(G, s.Q, s.V, s.vehicle)
            read = read._replace(pose=pose, velocity=velocity)
        # The last sample is the state before its instant.
        at_instants = np.abs(times - periods * flight.period) <= SLACK * flight.period
        sample_of = {int(periods[k]): k for k in np.flatnonzero(at_instants[:-1])}
        for again in second_vehicles(flight):
            drawn, run = again.measurement_errors(), again.index
            assert drawn is not None
            n, b = drawn
            for signal, part, delay, measured in again.measuring.held():
                for sample, period in enumerate(periods[:-1].tolist()):
                    last = max((i for i in measured if i <= period - delay), default=0)
                    at = sample_of.get(last)
                    if at is None:
                        continue
                    if signal == "pose":
                        expected = (s.Q[run, at] @ exponential(G, n[last]))[part.entries]
                        found = read.pose[run, sample][part.entries]
                    else:
                        expected = (s.V[run, at] + b[last])[part.axes]
                        found = read.velocity[run, sample][part.axes]
                    place = f"sensors.{signal}, {part.name}, at t = {times[sample]:g} s"
                    yield _difference(found, expected, place)


def _unknown_forces(again: SecondVehicle) -> Iterator[str]:
    forces = again.vehicle.forces
    for force, (_, acting) in zip(forces, again.forces(), strict=True):
        if acting is None:
            yield f"{force.name} has no second form"


def _unknown_actuators(again: SecondVehicle) -> Iterator[str]:
    for actuator, acts in zip(again.vehicle.actuators, again.actuators, strict=True):
        if acts is None:
            yield f"{actuator.name} has no second form"


def _few(flight: VehicleRuns) -> VehicleRuns:
    """Return the runs at a few samples without the last, which is the state before its instant."""
    return flight.at_samples(
        np.unique(np.linspace(0, len(flight.problem.times) - 2, SAMPLES, dtype=int))
    )


def _drift(s: Tracking) -> float:
    """Return the allowed error of the group's formulas due to the drift of the poses."""
    return OFF_GROUP * float(s.G.drift(s.Q).max())


def _difference(
    found: Array, expected: Array, place: str, scale: float = 1.0, off_group: float = 0.0
) -> Difference:
    """Return the largest difference, and its bound relative to the largest entry or 1."""
    largest = max(1.0, scale, float(np.abs(expected).max(initial=0.0)))
    measured = float(np.abs(found - expected).max(initial=0.0))
    return measured, (ROUNDING + off_group) * largest, place


def _excess(found: Difference) -> float:
    measured, bound, _ = found
    return measured / bound if np.isfinite(measured) else np.inf
