"""Remarks on an experiment: numbers that look wrong, numerics, limits below the reference."""

import re
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache
from math import log
from typing import Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array, apply_matrix
from eqt_cli.base.errors import (
    EqtWarning,
    InputError,
    InputProblem,
    KeyPath,
    Problems,
    dotted,
    parse_key,
)
from eqt_cli.base.extensions import functions_for
from eqt_cli.base.registry import blamed, is_foreign
from eqt_cli.base.reporting import reporter
from eqt_cli.base.stored import THRUSTER, SmallErrors
from eqt_cli.components.forces import Force, weighed
from eqt_cli.components.groups import MatrixLieGroup, moving_parts
from eqt_cli.components.inertia import Inertia, in_other_order, not_rigid, over_horizon
from eqt_cli.components.vehicle import ACTUATORS, Vehicle, navigates, without_inner
from eqt_cli.components.vehicle_parts import ConstantInertia
from eqt_cli.config.document import value_at
from eqt_cli.config.experiment import Experiment, digest_of, draws_nothing, starts_on_reference
from eqt_cli.engines.engine import Engine, Problem, Work
from eqt_cli.engines.horizon import Horizon
from eqt_cli.engines.solve_ivp import SolveIvp
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.growth import Along, growth, left_out, size_of
from eqt_cli.loop.linearised import Linearised, flow, linearised
from eqt_cli.loop.small_errors import along

# Remarks on an experiment -------------------------------------------------------------------------


FORCE_SAMPLES = 4_001
"""Times over the horizon at which a user's force is compared with itself."""

FORCE_JUMP = 0.2
"""Share of its range by which a force that changes between two of these times jumps."""

IN_THE_LOOP = ("control", "actuators", "sensors")
"""Sections whose times are milliseconds to seconds."""

NO_ROTATION = "leaves nothing of a measured rotation"
IMPLAUSIBLE: dict[str, tuple[float, str, str, str, tuple[str, ...]]] = {
    "sensors.pose": (1.0, "rad", NO_ROTATION, "degrees or arc seconds", ("deg", "arcsec")),
    "sensors.velocity": (1.0, "rad/s", "is more than any gyro has", "degrees", ("deg/s", "deg/h")),
    "sensors.accelerometer": (2.0, "m/s^2", "is more than any accelerometer has", "mg", ("mg",)),
}
"""Deviations that are remarked on. Cheap gyros have offsets up to 20 deg/s, 0.35 rad/s, and cheap
accelerometers up to 150 mg, 1.5 m/s²."""

FUNCTION_WORDS = {*"all and any both default each no none not or some the with without".split()}
"""Labels that a reader takes for a word of a sentence, as in "none against gt: undecided"."""


@blamed()
def remarks(
    experiment: Experiment, shown: Horizon | None = None, runs: bool = True
) -> list[EqtWarning]:
    """Return remarks on an experiment and its reference, and on its `runs` before they are run."""
    return [EqtWarning(str(problem)) for problem in _noted(experiment, shown, runs)]


def _noted(experiment: Experiment, shown: Horizon | None, runs: bool) -> list[InputProblem]:
    equal = (
        f"all {experiment.config.ensemble.runs} runs of a law are equal, as nothing is drawn: "
        "one run tells as much, and no interval follows from them"
    )
    unclear = (
        f"the label '{label}' reads as a word of a sentence; write one such as 'no rates'"
        for label in experiment.loops
        if label in FUNCTION_WORDS
    )
    repeats = runs and draws_nothing(experiment) and not starts_on_reference(experiment)
    placed = [
        *((("controllers",), text) for text in unclear),
        *([(("ensemble", "runs"), equal)] if repeats else []),
        *experiment.remarks(),
        *_component_remarks(experiment),
        *value_remarks(experiment, shown),
        *numerical_remarks(experiment, shown),
        *limits_below_reference(experiment, shown),
    ]
    # Each function takes the experiment and its reference, and yields places and texts.
    for more in functions_for(purposes.remarks_on_an_experiment):
        placed += more(experiment, shown)
    # A number of another unit explains what is said of the whole actuator.
    steps = {"thrust_constant": 1, "density": 1, "at": 3}
    explained = {key[: -steps[key[-1]]] for key, _ in placed if key[-1] in steps}
    shortened = ((key, text) for key, text in placed if key not in explained)
    return [experiment.document.problem(key, text) for key, text in shortened]


def remark_on(experiment: Experiment, runs: bool = True) -> tuple[str, ...]:
    """Tell the reporter the remarks on an experiment of which loops, or also runs, are computed.

    They are returned as results hold them, without the places of this machine.
    """
    noted = _noted(experiment, None, runs)
    for problem in noted:
        reporter().remark(EqtWarning(str(problem)))
    return tuple(f"{problem.path}: {_FOLDERS.sub('', problem.message)}" for problem in noted)


_FOLDERS = re.compile(r"(?<![\w.)\]])/(?:[^\s/:'\"]+/)+")
"""The folders of an absolute path in a text; a slash of a unit stands behind a letter."""


Placed = Iterator[tuple[KeyPath, str]]
"""Remarks, each with the key that it is about."""


def _component_remarks(experiment: Experiment) -> Placed:
    """Yield the remarks of reference, starts, forces of the user's own, and estimator."""
    loops, G = experiment.loops.values(), experiment.group
    loop = next(iter(loops))
    yield from ((("reference",), text) for text in loop.reference.remarks(G))
    yield from (
        (("initial", "file"), text) for text in getattr(experiment.start.poses, "notes", ())
    )
    section = section_of_forces(experiment)
    for index, force in enumerate(loop.vehicle.forces):
        if is_foreign(type(force).__module__) and (t := _jump(experiment, force)) is not None:
            yield (
                (section, "forces", index),
                f"jumps at about t = {t:.4g} s, which engines may step over; give its times in "
                "`instants(self, G, until)`",
            )
    if loop.vehicle.estimator and not navigates(loop.vehicle):
        for part in loop.vehicle.schedule(G).unmeasured:
            yield (
                ("estimator",),
                f"no sensor measures the {part}, so the error of its estimate "
                "grows without bound; add an entry for it to sensors.pose",
            )


def section_of_forces(experiment: Experiment) -> str:
    """Return the section that lists what acts: `plant`, or `model` where that is what acts."""
    plant = experiment.config.plant
    return "plant" if plant and plant.forces else "model"


def value_remarks(experiment: Experiment, shown: Horizon | None) -> Placed:
    """Yield the remarks on values of the vehicle, which runs may draw, but for its limits."""
    yield from _actuator_remarks(experiment)
    loop, G, section = experiment.loop, experiment.group, section_of_forces(experiment)
    body, model = body_of(loop.inertia.at(0.0), loop.vehicle), experiment.config.known_forces
    if section == "plant" and model and model != "plant":  # what laws know need not be what acts
        means = weighed(G, tuple(force.of_run(G, None) for force in model), loop.inertia)
        yield from _force_remarks(G, means, loop.inertia.at(0.0), "model")
    yield from _force_remarks(G, loop.vehicle.forces, body, section)
    for key, text in _lever_remarks(experiment, body, shown):
        yield (section, *key), text
    true = (loop.vehicle.configured or loop.vehicle).inertia
    is_rigid = isinstance(true, ConstantInertia) and experiment.config.rigid is not False
    if is_rigid and (broken := not_rigid(G, body, 0.0)):
        yield ("plant", "inertia"), f"not of a rigid body: its {broken}"
    yield from _sensor_remarks(experiment)


def _actuator_remarks(experiment: Experiment) -> Placed:
    """Yield what each law is not given; with the laws, where they ask for other directions."""
    G, alike = experiment.group, dict[tuple[Any, ...], list[str]]()
    for label, loop in experiment.loops.items():
        rows = tuple(map(tuple, loop.controller.directions(G).tolist()))
        alike.setdefault(rows, []).append(label)
    texts = dict[tuple[int, str], list[str]]()
    for rows, labels in alike.items():
        parts = without_inner(experiment.loops[labels[0]].vehicle).actuators
        for index, actuator in enumerate(parts if rows else ()):
            for text in actuator.remarks(G, np.array(rows)):
                texts.setdefault((index, f"{actuator.name} {text}"), []).extend(labels)
    for (index, text), labels in texts.items():
        names = ", ".join(experiment.titles[label] for label in labels)
        of_all = len(labels) == sum(len(labels) for rows, labels in alike.items() if rows)
        yield (ACTUATORS, index), text if of_all else f"{text} ({names})"


def body_of(model: Inertia, vehicle: Vehicle) -> Inertia:
    """Return the true inertia of a vehicle of a run without what it carries, at the start."""
    true = vehicle.inertia and vehicle.inertia.unloaded
    return model if true is None else true.at(model, 0.0)


def _force_remarks(
    G: MatrixLieGroup, forces: Sequence[Force], inertia: Inertia, section: str
) -> Placed:
    """Yield the remarks of forces on a body, each with its key."""
    kinds = [force.name for force in forces]
    for index, force in enumerate(forces):
        for key, text in force.remarks(G, inertia):
            if key != "weight" or kinds.count(force.name) == 1:  # several weights are one in all
                yield (section, "forces", index, key), text


def _jump(experiment: Experiment, force: Force) -> float | None:
    """Return where a force jumps in time, at the start of the runs, though it gives no instant."""
    G, Q, V = experiment.group, experiment.desired.pose[None], experiment.desired.velocity[None]
    times = np.linspace(0.0, experiment.config.time.duration, FORCE_SAMPLES)
    with np.errstate(all="ignore"):  # of one run, as engines call it
        values = np.array([(force.in_body(G, t, Q, V) + 0.0 * V)[0] for t in times.tolist()])
    steps = np.abs(np.diff(values, axis=0)).max(axis=-1)
    after = np.searchsorted(times, force.instants(G, times[-1]))
    steps[np.clip(after, 1, len(steps)) - 1] = 0.0
    jumps = steps.max() > FORCE_JUMP * np.ptp(values, axis=0).max()
    return float(times[steps.argmax()]) if jumps else None


def _sensor_remarks(experiment: Experiment) -> Placed:
    """Remark on noises and biases that no instrument has."""
    vehicle, G = experiment.loop.vehicle, experiment.group
    for path, sensor in vehicle.sensors().items():
        bound = IMPLAUSIBLE.get(path.split("[")[0])
        if vehicle.control is None or bound is None:
            continue
        limit, unit, says, meant, units = bound
        std = sensor.drawn(None).white_deviation(G, sensor.period or vehicle.control.period)
        bias = sensor.bias_deviation(G)
        written = value_at(experiment.document.data, parse_key(path))
        numbers = written if isinstance(written, dict) else {}  # else a kind's name alone
        is_bare = "density" not in numbers and not _has_unit(
            [numbers.get("std"), numbers.get("value")]
        )
        measured = [part for part in G.parts if part.name == sensor.of] or G.parts
        turns = np.array([part.turns for part in measured for _ in range(G.dimension)[part.axes]])
        of_unit = turns if "rad" in unit else ~turns
        for what, sizes in (("noise", std), ("bias", bias and bias[0])):
            most = 0.0 if sizes is None else np.max(sizes, where=of_unit, initial=0.0)
            if most > limit:
                instead = " or ".join(f"'{most:g} {other}'" for other in units)
                hint = f"; if {meant} were meant, write {instead}" if is_bare else ""
                yield parse_key(path), f"a {what} of {most:g} {unit} {says}{hint}"


def _has_unit(written: Any) -> bool:
    """Whether a number is written with its unit, or one of several."""
    if isinstance(written, dict):
        written = list(written.values())
    return isinstance(written, str) or (isinstance(written, list) and any(map(_has_unit, written)))


MOST_TURNED = 1 / 3
"""Largest deviation of an angle without a remark, rad: 3σ are 1 rad, where the torque of a law in
sin θ has almost ceased to grow."""


def _lever_remarks(experiment: Experiment, body: Inertia, shown: Horizon | None) -> Placed:
    """Remark on random forces along a line of space whose lever turns the body too far.

    About an axis, θ̈ + d θ̇ + ω² θ = n/J; with a torque n of the deviation σ and the correlation
    exp(−|t|/T), θ has the variance (σ/J)² (1/T + d) / (ω² d (1/T² + d/T + ω²)).
    """
    turning, poses = moving_parts(experiment.group)[0], along_reference(experiment, shown).poses
    for index, force in enumerate(experiment.loop.vehicle.forces):
        of_lever = getattr(force, "lever_torque", None)
        if of_lever is None or turning is None:
            continue
        torque, T = of_lever(experiment.group, poses)
        torque, J = torque[:, turning.axes].max(axis=0), np.diag(body.matrix)[turning.axes]
        flown = gains_flown(experiment, shown) if torque.any() else {}
        for label, small in flown.items():
            both = np.array([small.stiffness, small.damping])
            w2, d = np.diagonal(both, axis1=2, axis2=3)[..., turning.axes]
            variance = (torque / J) ** 2 * (1 / T + d) / (w2 * d * (1 / T**2 + d / T + w2))
            angle = np.sqrt(np.max(variance, where=(w2 > 0) & (d > 0), initial=0.0))
            if angle > MOST_TURNED:
                yield (
                    ("forces", index, "at"),
                    f"by its lever, it turns the body with a torque of σ = {torque.max():.3g} N m, "
                    f"at the gains of {experiment.loops[label].controller.title} by {angle:.2g} "
                    "rad (1σ); for wind, write `at: centre`",
                )
                break


def numerical_remarks(experiment: Experiment, shown: Horizon | None) -> Placed:
    """Remark on the effects of rounding, stiffness and instability, at the section to change."""
    texts, loop = [("inertia", ill_conditioned(experiment))], experiment.loop
    texts.append(("inertia", in_other_order(loop.group, loop.inertia)))
    try:
        with blamed():
            tried = _Tried.of(experiment, shown)
            texts.append(("gains", stiff(tried)))
            texts += [("controllers", text) for text in unstable_or_slow(tried)]
    except InputError as error:
        texts.append(("controllers", f"loops cannot be linearised: {error}"))
    yield from (((section,), text) for section, text in texts if text)


# Remarks on its numerics: rounding, stiffness, and loops that are unstable or slow ----------------


EPSILON = float(np.finfo(float).eps)

ORDINARY = 20_000
"""Largest number of evaluations of the vector field, or of steps, without a remark: two seconds for
a single run. For stability, most shipped experiments need some hundreds, `se3_survey` 14,000."""

CERTAINLY = 3.0
"""Ratio of estimated to allowed work beyond which no run ends, with a margin for the estimate."""

TRIAL = 1_500
"""Number of evaluations of a trial with an implicit method: half a second."""

ENOUGH = 0.02
"""Share of the horizon that a trial must reach to extrapolate its evaluations. On SO(3), a
trial over 1 % of the horizon was right to 20 %. On the submersible, the first millisecond alone
takes 3,000 evaluations."""

TRIAL_SAMPLES = 4_001
"""Number of samples that show how far the trial came."""


def ill_conditioned(experiment: Experiment) -> str:
    """Return the words for a remark on an ill-conditioned inertia; empty if it is not.

    V = 𝕀⁻¹P is accurate to about ε κ, with ε = 2.2e-16 and the condition number κ of the inertia in
    units that make its diagonal 1 (Higham 2002, Theorem 7.2 and Section 7.3). So units do not
    matter, but nearly dependent axes do. If ε κ exceeds `rtol`, no step can be that accurate.
    """
    loop, rtol = experiment.loop, experiment.engine.rtol
    times, matrices = over_horizon(loop.inertia, experiment.config.time.duration)
    roots = np.sqrt(np.diagonal(matrices, axis1=-2, axis2=-1))
    numbers = np.linalg.cond(matrices / (roots[:, :, None] * roots[:, None, :]))
    worst = int(numbers.argmax())
    if numbers[worst] * EPSILON <= rtol:
        return ""
    when = "" if len(times) == 1 else f" at t = {times[worst]:.4g} s"
    return (
        f"its condition number is {numbers[worst]:.2g}{when}, so that rounding alone changes "
        f"velocities by {numbers[worst] * EPSILON:.1g} of their size, more than solver.rtol = "
        f"{rtol:g}; choose other axes, or increase solver.rtol"
    )


@dataclass(frozen=True)
class _Tried:
    """An experiment, and points of its reference; where the keys are equal, so are its numerics.

    They are computed once, also for runs that differ in their seed, their number or their starts.
    """

    key: Hashable
    experiment: Experiment = field(compare=False)
    along: Along = field(compare=False)

    @classmethod
    def of(cls, experiment: Experiment, shown: Horizon | None = None) -> "_Tried":
        along, every = along_reference(experiment, shown), experiment.numeric_config
        numbers = {key: every[key] for key in every.keys() - {"ensemble", "initial"}}
        at = tuple(array.tobytes() for array in along)
        return cls((digest_of(numbers), *at), experiment, along)


@lru_cache(maxsize=2)
def stiff(tried: _Tried) -> str:
    """Return the words for a remark on the work for a stiff loop; empty if no loop is stiff.

    A loop is stiff if the fastest decay of its errors needs more than `ORDINARY` evaluations, and
    an implicit method needs fewer (Hairer and Wanner 1996, Section IV.1).
    """
    experiment, (work, label, rates) = tried.experiment, _most_work(tried)
    chosen = experiment.engine
    if work.amount <= ORDINARY:
        return ""
    explicit = SolveIvp(rtol=chosen.rtol).work_for_stability(rates, experiment.config.time.duration)
    implicit, reached = _radau_evaluations(experiment, experiment.loops[label])
    # With fewer evaluations by the explicit method, the horizon is long, but the loop is not stiff.
    if not implicit < min(explicit.amount, work.amount):
        return ""
    count = f"about {_rounded(implicit)} evaluations" if reached > ENOUGH else "fewer"
    return (
        f"the loop of '{label}' is stiff: its errors decay at up to "
        f"{np.abs(rates).max():.2g} 1/s, for which engine {chosen.name} takes about "
        f"{_rounded(work.amount)} {work.unit} a run; `solver.method: Radau` {count}"
    )


@lru_cache(maxsize=2)
def _most_work(tried: _Tried) -> tuple[Work, str, Array]:
    """Return the most work that the decay of a loop demands, its label and its eigenvalues."""
    experiment, along = tried.experiment, tried.along
    chosen = experiment.engine
    worst: tuple[Work, str, Array] = (Work(), "", np.zeros(1))
    with threadpool_limits(1):  # threads slow down small matrices
        for label, loop in small_loops(experiment, along).items():
            matrices = flow(loop, *along)
            if np.isfinite(matrices).all():
                rates = np.linalg.eigvals(matrices)
                work = chosen.work_for_stability(rates, experiment.config.time.duration)
                worst = max(worst, (work, label, rates), key=lambda candidate: candidate[0])
    return worst


def check_steps(experiment: Experiment, problems: Problems) -> None:
    """Note a loop that needs many more steps than a run may take, so that no run would end."""
    most = getattr(experiment.engine, "max_steps", np.inf)
    with blamed():
        work, label, rates = _most_work(_Tried.of(experiment))
    if work.amount > CERTAINLY * most:
        problems.at("time", "duration").add(
            f"no run of '{label}' would end: its errors decay at up to {np.abs(rates).max():.2g} "
            f"1/s, for which {experiment.config.time.duration:g} s take about "
            f"{_rounded(work.amount)} {work.unit}, and solver.max_steps is {most:,}; check "
            "gains, inertia and time constants, take a shorter duration, or `solver.method: Radau`"
        )


def _rounded(count: float) -> str:
    """Format a number with two digits: ``46,000``."""
    return f"{float(f'{count:.2g}'):,.0f}"


def _radau_evaluations(experiment: Experiment, loop: ClosedLoop) -> tuple[float, float]:
    """Estimate the evaluations of a run by an implicit method from the progress of a trial.

    The trial starts without errors, because fast errors decay at once. The estimate is infinite if
    the trial makes no progress. The second value is the share of the horizon that it reached.
    """
    Qd, Vd, stop = experiment.desired.pose, experiment.desired.velocity, experiment.times[-1]
    engine = SolveIvp(method="Radau", rtol=experiment.engine.rtol, max_steps=TRIAL)
    states = loop.initial_state(Qd, Vd, Qd, Vd)[None]
    solution = engine.solve(Problem(loop, states, np.linspace(0.0, stop, TRIAL_SAMPLES)))
    solved = int(np.isfinite(solution.states[0]).all(axis=-1).sum()) - 1
    reached = solved / (TRIAL_SAMPLES - 1)
    return (solution.steps[0] / reached if solved else np.inf), reached


LINEARISED = 9
"""Number of times at which a loop is linearised."""

GOLDEN = (5**0.5 - 1) / 2
"""Golden ratio. The fractional parts of its multiples are spread evenly without equal gaps."""

CERTAIN = 10.0
"""Growth over the horizon, at the least rate of all times, beyond which a loop that changes is
unstable. Of the shipped loops, which settle, the largest is 1.8 (`quadrotor_lee` without rates)."""

BEGINNING = 0.1
"""Share of the horizon at whose times a loop is linearised before those of the whole."""

HOPELESS = 1e8
"""The same by the rate where the reference begins, if no more of it is known; shipped: 2e4."""

NEAR, FAR = 1e3, 1e4
"""How far apart flights start in velocity, in tolerances of the engine, and by which factor they
part at the rate of an unstable loop; by the square root of what a time gives, they part indeed."""

MOST_ENTRIES = 200_000
"""Largest number of matrix entries over all times; at 9 times, this allows 149 states."""


@lru_cache(maxsize=2)
def unstable_or_slow(tried: _Tried) -> list[str]:
    """Return sentences on unstable loops, and on slow ones, that do not depend on time."""
    with threadpool_limits(1):
        return list(_unstable_or_slow(tried.experiment, tried.along))


def _unstable_or_slow(experiment: Experiment, along: Along) -> Iterator[str]:
    horizon = experiment.config.time.duration
    check = "check the signs and sizes of its gains, and the delays; `eqt margins` shows more"
    for key, value in _bare_seconds(experiment.document.data):
        check = f"{key} is {value:g} s: if milliseconds were meant, write '{value:g} ms'"

    @cache  # all laws have one reference; its beginning tells of most loops that they settle
    def up_to(share: float) -> Along:
        return along_reference(experiment, experiment.reference_over_horizon(share=share))

    for label, loop in small_loops(experiment, along).items():
        with np.errstate(all="ignore"):
            linear = linearised(loop, *along)
        if not np.isfinite(linear.closed).all():
            continue
        begins = len(along.times) == 1
        if begins or not linear.is_constant:
            rate = _least_growth(linear)
            if begins:
                rate, begins = _least_later(loop, rate, log(CERTAIN) / horizon, up_to)
            is_certain = rate * horizon > log(HOPELESS if begins else CERTAIN)
            if is_certain and part(experiment.engine, loop, along, rate, horizon):
                where = "where the reference begins" if begins else "wherever the reference is held"
                yield (
                    f"the loop of '{label}' is unstable {where}: small errors grow at {rate:.3g} "
                    f"1/s or more; {check}"
                )
            continue
        largest = growth(linear)
        if largest.is_stable and -largest.rate * horizon < log(2.0):
            yield (
                f"the loop of '{label}' is slower than the runs last: small errors take "
                f"{log(2.0) / -largest.rate:.3g} s to halve, and time.duration is {horizon:g} s; "
                "check the sizes of its gains, or take a longer duration"
            )
        if largest.is_stable is not False:
            continue
        size = size_of(largest, linear)
        per = "a period" if linear.period == linear.cycle else f"in {linear.cycle:g} s"
        many = "" if linear.period is None else f" (eigenvalue {size:.4g} {per})"
        omitted = ", ".join(omission.words for omission in left_out(loop))
        yield (
            f"the loop of '{label}' is unstable: small errors grow at {largest.rate:.3g} 1/s{many}"
            + (f", leaving out {omitted}" if omitted else "")
            + f"; {check}"
        )


def _least_later(
    loop: ClosedLoop, rate: float, least: float, up_to: Callable[[float], Along]
) -> tuple[float, bool]:
    """Return the least growth along a reference while it is large, and whether none is known.

    If flights part within the beginning, and not later, it is that of the beginning.
    """
    begins, early = True, -np.inf
    for share in (BEGINNING, 1.0):
        if rate > least:
            begins = len(up_to(share).times) == 1
            with np.errstate(all="ignore"):
                linear = linearised(loop, *up_to(share))
            rate = _least_growth(linear) if np.isfinite(linear.closed).all() else -np.inf
            early = max(early, -np.inf if begins else rate)
    parts_early = early * BEGINNING > least * log(FAR) / log(CERTAIN)
    return (early, True) if parts_early and rate <= least else (rate, begins)


def part(engine: Engine, loop: ClosedLoop, along: Along, rate: float, horizon: float) -> bool:
    """Whether flights that start a little apart part as errors do that grow at a rate, 1/s.

    The rate is of a loop that is held at its reference with the first memory of its law. A flight
    has a steady error and another memory, where the loop may be stable.
    """
    _, Q, V = (values[:1] for values in along)
    states = loop.initial_state(Q, V + np.array([[0.0], [NEAR * engine.rtol]]), Q, V)
    begin, stop = (min(horizon, log(far) / rate) for far in (FAR**0.5, FAR))
    times = np.array([0.0, *np.linspace(begin, stop, 5)])  # later, both may be far away
    solution = engine.solve(Problem(loop, states, times))
    if solution.status.any():
        return True
    apart = []
    for t, now in zip(times, solution.states.swapaxes(0, 1), strict=True):
        first, second = loop.tracking(t, now).V
        apart.append(float(np.linalg.norm(second - first)))
    return bool((apart[1:] > np.exp(rate * times[1:] / 2) * apart[0]).any())


def _bare_seconds(data: Any, path: KeyPath = ()) -> Iterator[tuple[str, float]]:
    """Yield periods and time constants of the loop of 1 s or more that are written without unit."""
    entries = enumerate(data) if isinstance(data, list) else data.items()
    for step, value in entries if path else [(key, data.get(key)) for key in IN_THE_LOOP]:
        if step in ("period", "time_constant") and isinstance(value, int | float) and value >= 1:
            yield dotted((*path, step)), value
        if isinstance(value, dict | list):
            yield from _bare_seconds(value, (*path, step))


def _least_growth(linear: Linearised) -> float:
    """Return the growth rate of errors at the time at which it is least, 1/s."""
    eigenvalues = np.linalg.eigvals(linear.closed)
    if linear.cycle is None:
        return float(eigenvalues.real.max(axis=-1).min())
    return log(np.abs(eigenvalues).max(axis=-1).min()) / linear.cycle


def small_loops(experiment: Experiment, along: Along) -> dict[str, ClosedLoop]:
    """Return the loops whose matrices at all times are small enough, by label.

    Those of laws that answer in the order of time only are left out.
    """
    return {
        label: loop
        for label, loop in experiment.loops.items()
        if len(along.times) * loop.state_length**2 <= MOST_ENTRIES
        and not getattr(loop.controller, "in_order", 0)
    }


def along_reference(experiment: Experiment, shown: Horizon | None) -> Along:
    """Return the reference at its start or, if it is known, at times spread over the horizon.

    The times are not multiples of each other, so that a rotating reference is sampled at different
    angles.
    """
    finite = np.flatnonzero(shown.finite) if shown is not None else ()
    if shown is None or not 1 < len(finite) == len(shown.times):
        start = np.zeros(1), experiment.desired.pose[None], experiment.desired.velocity[None]
        return Along(*start)
    shares = np.sort(np.arange(LINEARISED) * GOLDEN % 1.0)
    where = np.searchsorted(shown.times, shares * shown.times[-1])
    return Along(shown.times[where], shown.pose[where], shown.velocity[where])


POSES = 21
"""Number of poses of a reference at which a law is tried, equally spaced in time."""


def gains_flown(experiment: Experiment, shown: Horizon | None = None) -> dict[str, SmallErrors]:
    """Return the small errors of each law along the reference, where its torque tells them."""
    return _flown(_Tried.of(experiment)) if shown is None else _along(experiment, shown)


@lru_cache(maxsize=2)
def _flown(tried: _Tried) -> dict[str, SmallErrors]:
    return _along(tried.experiment, None)


def _along(experiment: Experiment, shown: Horizon | None) -> dict[str, SmallErrors]:
    times = np.linspace(0.0, experiment.times[-1], POSES)

    @cache  # the reference is integrated once, if at all
    def poses() -> Array | None:
        desired = experiment.reference_over_horizon() if shown is None else shown
        is_whole = desired.finite.all() and desired.spent is None
        return desired.pose[np.searchsorted(desired.times, times)] if is_whole else None

    flown = {label: along(loop, times, poses) for label, loop in experiment.loops.items()}
    return {label: errors for label, errors in flown.items() if errors}


# Remarks on limits below the torque of the reference ----------------------------------------------


class WheelsNeeded(NamedTuple):
    """What each wheel needs to follow the reference exactly, under the forces of the plant.

    Attributes
    ----------
    momentum, torque : (times, k)
        N m s and N m.
    limits
        Largest momentum and torque, ``(k,)`` each; None without one.
    """

    times: Array
    momentum: Array
    torque: Array
    limits: tuple[Array | None, Array | None]

    @property
    def in_words(self) -> str:
        """``8.2 of 15 mN m s (wheel 1, t = 120 s) and 0.9 of 4 mN m (wheel 2, t = 35 s)``."""
        words = []
        pairs = zip((self.momentum, self.torque), self.limits, ("mN m s", "mN m"), strict=True)
        for values, limit, unit in pairs:
            share = np.abs(values) / (1.0 if limit is None else limit)
            when, wheel = np.unravel_index(np.argmax(share), share.shape)
            of = "" if limit is None else f" of {1e3 * limit[wheel]:.3g}"
            size = 1e3 * abs(values[when, wheel])
            words.append(f"{size:.3g}{of} {unit} (wheel {wheel + 1}, t = {self.times[when]:.4g} s)")
        return " and ".join(words)

    @property
    def are_too_much(self) -> bool:
        """Whether a limit is below what is needed."""
        pairs = zip((self.momentum, self.torque), self.limits, strict=True)
        return any(bool((np.abs(v) > limit).any()) for v, limit in pairs if limit is not None)


NEEDED = 1e-6
"""What the reference needs beyond a limit is rounding below this part of the largest need: it is
integrated to 1e-8, and a limit may be what it needs, such as 0 of an idle thruster."""


def _forces_along(loop: ClosedLoop, shown: Horizon) -> Array:
    """Return what acts on the plant along the reference, body frame, ``(times, m)``."""
    total = np.zeros_like(shown.velocity)
    for force in loop.vehicle.forces:
        total = total + force.in_body(loop.group, shown.times, shown.pose, shown.velocity)
    return total


def wheels_needed(experiment: Experiment, shown: Horizon) -> WheelsNeeded | None:
    """Return what wheels need along the reference, by the balance of momentum; None without any.

    In space, the momentum of body and wheels is that of the start and the integral of all forces.
    Numbers that are drawn for each run have their mean values.
    """
    loop = experiment.loop
    if loop.vehicle.wheels is None or not shown.finite.all():
        return None
    G, wheels, t, Q, V = loop.group, loop.vehicle.wheels[1], shown.times, shown.pose, shown.velocity
    forces, inertia = _forces_along(loop, shown), loop.inertia.at(t)
    body = inertia.momentum(V)
    there = G.Ad_star(G.inverse(Q), forces + inertia.leaving(V))
    gained = np.cumsum(np.diff(t)[:, None] * (there[1:] + there[:-1]) / 2, axis=0)
    start = wheels.matrix @ wheels.start
    total = G.Ad_star(G.inverse(Q), body + start)[:1]
    total = total + np.concatenate([0.0 * gained[:1], gained])
    carried = G.Ad_star(Q, total) - body
    torque = shown.torque - forces - G.ad_star(V, carried)
    limits = wheels.momentum, wheels.limit
    momentum = wheels.start + apply_matrix(wheels.inverse, carried - start)
    return WheelsNeeded(t, momentum, wheels.allocated(torque), limits)


def limits_below_reference(experiment: Experiment, shown: Horizon | None = None) -> Placed:
    """Remark on actuators whose limits are below the torque of the reference alone.

    Numbers that are drawn for each run have their mean values.
    """
    loop = experiment.loop
    if not experiment.vehicle.limits:
        return
    shown = shown or experiment.reference_over_horizon()
    torque = shown.torque - _forces_along(loop, shown)
    times, torque = shown.times[shown.finite], torque[shown.finite]
    wheels = wheels_needed(experiment, shown)
    if wheels is not None and wheels.are_too_much and not loop.vehicle.magnet:  # which dumps it
        needs = f"the reference, with the forces of the plant, needs {wheels.in_words}"
        yield (ACTUATORS,), f"{needs}; no law can follow it there"
    for index, actuator in enumerate(experiment.vehicle.actuators):
        demand = actuator.needed(loop.group, times, torque) if actuator.limits else None
        if demand is None or not len(demand[0]):
            continue
        *values, limited = demand
        needed, low, high = np.broadcast_arrays(*values)
        beyond = np.maximum(needed - high, low - needed)
        limits = np.where(needed > high, high, low)
        # Thrusts have one unit, other limits that of their axis; a limit may be 0.
        size = np.abs(needed).max(axis=None if actuator.members else 0)
        share = np.divide(beyond, size, out=0.0 * beyond, where=size > 0)
        when, axis = np.unravel_index(share.argmax(), share.shape)
        if share[when, axis] > NEEDED:
            t = times[len(times) - len(needed) + when]
            most = "most" if needed[when, axis] > high[when, axis] else "least"
            names = actuator.members.get(THRUSTER)
            name, unit = (f"'{names[axis]}'", " N") if names else (actuator.name, "")
            yield (
                (ACTUATORS, index),
                f"{name} gives at {most} {limited}{limits[when, axis]:.4g}{unit}, but the "
                f"reference alone needs {needed[when, axis]:.4g}{unit} at t = {t:.4g} s; no law "
                "can follow it there",
            )
