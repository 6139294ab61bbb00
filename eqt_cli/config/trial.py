"""Tries an experiment once, before any run: its loop at the first start, and the user's parts."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, InputError, Problems, dotted
from eqt_cli.base.registry import described, is_foreign, place_of, place_of_function
from eqt_cli.components.actuators import Actuator
from eqt_cli.components.estimators import Estimator
from eqt_cli.components.forces import Force
from eqt_cli.components.initial_states import Stream, draw_initial_states, generator_at
from eqt_cli.components.sensors import Errors, Sensor
from eqt_cli.config.experiment import Experiment
from eqt_cli.engines.engine import Problem
from eqt_cli.loop.closed_loop import ClosedLoop, LoopPart, parts_of, vehicle_parts
from eqt_cli.loop.signals import compute
from eqt_cli.numbers.leaves import leaves

WHEN = "at the start of run 0"

TOGETHER = "when runs are solved together, with every number of a law as an array (runs, 1)"

CONTRACTED = "; multiply before you contract: dot(self.k * z, z), not self.k * dot(z, z)"


def probe(experiment: Experiment, problems: Problems) -> None:
    """Note what components of the user's raise, or return in a shape that does not fit."""
    loops, Qd, Vd = experiment.loops, experiment.initial_pose, experiment.initial_velocity
    poses, velocities = experiment.poses, experiment.velocities
    parts = [part for e in loops.values() for part in (e.group, e.reference, e.controller)]
    if not any(is_foreign(type(part).__module__) for part in [*parts, poses, velocities]):
        return
    first, seed = next(iter(loops.values())), experiment.config.ensemble.seed
    with problems.catching("initial"), failing("the initial states"):
        Q, V = draw_initial_states(
            first.group, poses, velocities, Qd=Qd, Vd=Vd, seed=seed, runs=[0]
        )
        state = first.initial_state(Q, V, Qd, Vd)[0]
    if not problems:
        _, reference, group, *_ = parts_of(first)
        suspect = _suspect(reference, group)
        with problems.catching(*suspect.path):
            _probe_reference(first, state, suspect.name)
    if problems:
        return
    for index, loop in enumerate(loops.values()):
        law, _, group, *_ = parts_of(loop, index)
        suspect = _suspect(law, group)
        with problems.catching(*suspect.path):
            with failing(suspect.name):
                state = loop.initial_state(Q, V, Qd, Vd)[0]  # with the memory of this law
            _probe_law(loop, state, suspect.name)


def _suspect(part: LoopPart, group: LoopPart) -> LoopPart:
    """Return the part to blame: the user's group if the part itself is from eqt."""
    return group if group.is_foreign and not part.is_foreign else part


def _probe_reference(loop: ClosedLoop, state: Array, name: str) -> None:
    states = repeated(loop, state)[:, 0]
    with failing(name):
        torque = loop.tracking(0.0, states).tau_d
    function = type(loop.reference).driving_torque
    require_fit(torque, states, (loop.group.dimension,), name, function)


def _probe_law(loop: ClosedLoop, state: Array, name: str) -> None:
    """Evaluate the law for runs at one time, as engines do, and on all samples, as metrics do.

    Each with the numbers of the configuration, and with numbers of each run: so points of a sweep
    are solved together.
    """
    whole = repeated(loop, state)
    times = np.zeros(whole.shape[1])
    numbers = {
        path: np.repeat(number[None], len(whole), axis=0) for path, number in leaves(loop).items()
    }
    together = Problem(loop, whole[:, 0], times, numbers)
    for extra_axes, (t, states) in enumerate(((0.0, whole[:, 0]), (times, whole))):
        _require_law(loop, t, states, name, WHEN)
        _require_law(together.batched_loop(extra_axes), t, states, name, TOGETHER)


def _require_law(loop: ClosedLoop, t: Any, states: Array, name: str, when: str) -> None:
    """Raise an `InputError` if the law fails, or returns no numbers for every run."""
    law = loop.controller
    with failing(name, when):
        s = loop.tracking(t, states)
        torque, dissipation, lyapunov = law.torque(s), law.dissipation(s), law.lyapunov(s)
    axes = (loop.group.dimension,)
    require_fit(torque, states, axes, name, type(law).torque, exact=True, when=when)
    require_fit(lyapunov, states, (), name, type(law).lyapunov, exact=True, when=when)
    if dissipation is not None:
        require_fit(dissipation, states, (), name, type(law).dissipation, when=when)
    with failing(name, when):
        if states.ndim == 2:
            loop.vector_field(t, states)
        else:
            compute(loop, t, states)


def repeated(loop: ClosedLoop, state: Array) -> Array:
    """The state for some runs and samples, as many of each as nothing else in the loop has."""
    m = loop.group.dimension
    return np.broadcast_to(state, (m + 2, m + 3, len(state))).copy()


def require_fit(
    value: Any,
    states: Array,
    axes: tuple[int, ...],
    name: str,
    function: Any,
    *,
    exact: bool = False,
    when: str = WHEN,
) -> None:
    """Raise an `InputError` if a function returns no numbers for every run, sample and axis.

    What is the same for all runs or samples may lack their axes, unless it is to be `exact`.
    """
    wrong = _unfit(value, states.shape[:-1], axes, exact)
    if wrong:
        place = f"{place_of_function(function)}: {function.__name__}"
        hint = CONTRACTED if when == TOGETHER else ""
        raise InputError(f"{name} is wrong {when}: {place} returns {wrong}{hint}")


def _unfit(value: Any, leading: tuple[int, ...], axes: tuple[int, ...], exact: bool) -> str | None:
    if not isinstance(value, np.ndarray | np.generic | float | int):
        return f"{'None' if value is None else type(value).__name__}; expected an array"
    actual, kind = np.shape(value), np.asarray(value).dtype
    if kind.kind not in "fiu":
        return f"an array of {kind}; expected real numbers"
    shape = (*leading, *axes)
    try:
        spread = np.broadcast_shapes(actual, shape) == shape
        fits = actual == shape if exact else spread and actual[len(actual) - len(axes) :] == axes
    except ValueError:
        fits = False
    counts = " of ".join(f"{n} {w}" for n, w in zip(leading, ("runs", "samples"), strict=False))
    return None if fits else f"an array of shape {actual} for {counts}; expected {shape}"


@contextmanager
def failing(name: str, when: str = WHEN) -> Iterator[None]:
    """Turn an exception into an `InputError` with the line of the user's component it is from."""
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            yield
    except EqtError as error:
        raise InputError(str(error)) from error
    except Exception as error:
        place = place_of(error)
        at = f" at {place}" if place else ""
        raise InputError(f"{name} fails {when}: {described(error)}{at}") from error


MEASUREMENTS = 3, 7
"""So many are drawn at once, and then as many with the same random numbers."""


def probe_parts(experiment: Experiment, problems: Problems) -> None:
    """Note what parts of the user's lack, raise, or return in a shape that does not fit."""
    loop = next(iter(experiment.loops.values()))
    own = [each for each in vehicle_parts(loop) if each.is_foreign]
    if not own:
        return
    Qd, Vd = experiment.initial_pose, experiment.initial_velocity
    state = loop.initial_state(Qd, Vd, Qd, Vd)
    for part, path, name in own:
        with problems.catching(*path):
            _require_words(part, name)
            if isinstance(part, Sensor):
                _try_sensor(loop, part, name, experiment.config.ensemble.seed, dotted(path))
            elif isinstance(part, Estimator):
                _try_estimator(loop, name, experiment.config.ensemble.seed, state)
            else:
                _try_part(loop, part, name, repeated(loop, state))


def _require_words(part: Any, name: str) -> None:
    """Raise where a report has no words for it."""
    words = part.departs
    if not isinstance(words, str) or not words.strip():
        raise InputError(
            f"{name}: `departs` is {words!r}; expected text that says in a few words how the loop "
            'departs from the ideal one, such as departs: ClassVar[str] = "a tether"'
        )


def _try_sensor(loop: ClosedLoop, part: Sensor, name: str, seed: int, place: str) -> None:
    control = loop.vehicle.control
    assert control is not None

    def drawn(count: int) -> tuple[Array, Array]:
        random = (generator_at(seed, Stream.VEHICLE, 0, place) for _ in range(2))
        with failing(name):
            errors = part.errors(loop.group, count, control.period, next(random))
            lost = np.asarray(part.lost(count, next(random)))
        shape, at_errors = (count, part.coordinates(loop.group)), type(part).errors
        if np.shape(errors) != shape:
            raise InputError(
                f"{name}: {place_of_function(at_errors)}: errors returns an array of shape "
                f"{np.shape(errors)} for {count} measurements; expected {shape}"
            )
        if lost.shape != (count,) or lost.dtype != bool:
            raise InputError(
                f"{name}: {place_of_function(type(part).lost)}: lost returns an array of "
                f"{lost.dtype} of shape {lost.shape} for {count} measurements; expected booleans "
                f"of shape ({count},)"
            )
        return errors, lost

    few, many = map(drawn, MEASUREMENTS)
    for method, first, more in zip(("errors", "lost"), few, many, strict=True):
        if not np.array_equal(first, more[: len(first)]):
            where = place_of_function(getattr(type(part), method))
            raise InputError(
                f"{name}: {where}: {method}: the first values depend on how many are drawn; draw "
                "the numbers of each measurement in a row of its own"
            )


def _try_estimator(loop: ClosedLoop, name: str, seed: int, state: Array) -> None:
    """At two instants, as engines call it."""
    random_of = partial(generator_at, seed, Stream.VEHICLE, 0)
    states = repeated(loop, state)[:, 0]
    with failing(name):
        errors = loop.vehicle.measurement_errors(loop.group, 2, random_of)
        for tick in range(2):
            states = loop.measured(0.0, states, Errors(*(part[tick] for part in errors)))
    if not np.isfinite(states).all():
        raise InputError(f"{name} gives no number {WHEN}: its states are not finite")


def _try_part(loop: ClosedLoop, part: Any, name: str, whole: Array) -> None:
    """As engines call it, for runs at one time, and as it is measured, on all samples."""
    G = loop.group
    for t, states in ((0.0, whole[:, 0]), (np.zeros(whole.shape[1]), whole)):
        s = loop.tracking(t, states)
        if isinstance(part, Force):
            with failing(name):
                force = part.in_body(G, t, s.Q, s.V)
            require_fit(force, states, (G.dimension,), name, type(part).acting)
            continue
        _require_states(part, part.states(G), name)
        x = np.zeros((*states.shape[:-1], part.states(G)))
        with failing(name):
            output, rate = part.output(G, s.V, x), part.state_rate(G, s.V, x)
            limited = part.at_limit(G, s.V, x)
        require_fit(output, states, (G.dimension,), name, type(part).output)
        if part.moves:
            require_fit(rate, states, (x.shape[-1],), name, type(part).state_rate)
        if part.limits and np.shape(limited) != states.shape[:-1]:
            raise InputError(
                f"{name} is wrong {WHEN}: {place_of_function(type(part).at_limit)}: at_limit "
                f"returns an array of shape {np.shape(limited)}; expected {states.shape[:-1]}"
            )


def _require_states(part: Actuator, count: int, name: str) -> None:
    """Raise where it has states that nothing moves, or moves none."""
    if count and not part.moves and not part.sampled:
        raise InputError(
            f"{name}: has {count} states, but neither `moves` nor `sampled` is True; set `moves`, "
            "and give their time derivative in `state_rate`, or `sampled`, and give the states "
            "after an instant in `step`"
        )
    if part.moves and (not count or type(part).state_rate is Actuator.state_rate):
        raise InputError(
            f"{name}: `moves` is True; give the number of its states in `states` and their time "
            "derivative in `state_rate`"
        )
    if count and not part.moves and type(part).step is Actuator.step:
        raise InputError(f"{name}: has {count} states; give them after an instant in `step`")
