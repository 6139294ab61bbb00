"""Tries the user's own forces, actuators, sensors and estimators once, before any run is begun.

What a report or a certificate asks of them is asked here, too. It knows no engine.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.closed_loop.parts import vehicle_parts
from eqt_cli.core.arrays import Array
from eqt_cli.core.error_origin import place_of_function
from eqt_cli.core.errors import InputError
from eqt_cli.core.problems import Problems, dotted
from eqt_cli.ensemble.seeds import Stream, generator_at
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.experiment.trial_evaluation import WHEN, failing, repeated, require_fit
from eqt_cli.vehicle.actuators import Actuator
from eqt_cli.vehicle.estimators import Estimator
from eqt_cli.vehicle.forces import Force
from eqt_cli.vehicle.sensors import Sensor
from eqt_cli.vehicle.sensors.channels import Errors

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
    own = {
        flag: getattr(part, flag) and getattr(type(part), method) is getattr(Actuator, method)
        for flag, method in (("moves", "state_rate"), ("sampled", "step"))
    }
    if count and not part.moves and not part.sampled:
        raise InputError(
            f"{name}: has {count} states, but neither `moves` nor `sampled` is True; set `moves`, "
            "and give their time derivative in `state_rate`, or `sampled`, and give the states "
            "after an instant in `step`"
        )
    if part.moves and (not count or own["moves"]):
        raise InputError(
            f"{name}: `moves` is True; give the number of its states in `states` and their time "
            "derivative in `state_rate`"
        )
    if count and not part.moves and own["sampled"]:
        raise InputError(f"{name}: has {count} states; give them after an instant in `step`")
