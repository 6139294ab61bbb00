"""Evaluates a closed loop once, at the start of its first run, before any run is begun.

Components of eqt's own are tested; those of a user are found wrong here, and not by an engine in
the midst of a run. It knows no engine.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.closed_loop.parts import LoopPart, parts_of
from eqt_cli.closed_loop.signals import compute
from eqt_cli.core.arrays import Array
from eqt_cli.core.error_origin import described, place_of, place_of_function
from eqt_cli.core.errors import EqtError, InputError
from eqt_cli.core.leaves import leaves
from eqt_cli.core.problems import Problems
from eqt_cli.core.registry import is_foreign
from eqt_cli.engines.problem import Problem
from eqt_cli.ensemble.initial import draw_initial_states
from eqt_cli.experiment.experiment import Experiment

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
    found, kind = np.shape(value), np.asarray(value).dtype
    if kind.kind not in "fiu":
        return f"an array of {kind}; expected real numbers"
    shape = (*leading, *axes)
    try:
        spread = np.broadcast_shapes(found, shape) == shape
        fits = found == shape if exact else spread and found[len(found) - len(axes) :] == axes
    except ValueError:
        fits = False
    counts = " of ".join(f"{n} {w}" for n, w in zip(leading, ("runs", "samples"), strict=False))
    return None if fits else f"an array of shape {found} for {counts}; expected {shape}"


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
