"""Draws random exact states of a closed loop, at which identities are proved.

Free parameters are the Cayley parameters of every pose, the entries of every vector, of the inertia
and of the gains, and every function of time with its first and second derivative. Numbers in a law
are not free: a float is its exact dyadic fraction.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from eqt_cli.analysis.evidence.exact import Exact, Ledger, free, inverse, noting
from eqt_cli.analysis.evidence.numbers import Number
from eqt_cli.analysis.evidence.sample import (
    INITIAL,
    INVERSE,
    K_D,
    MATRIX,
    K,
    Sample,
    tracks_nothing,
    with_moving_reference,
)
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.core.differentiation import Dual
from eqt_cli.core.expressions import Expression
from eqt_cli.core.expressions.tree import Variable
from eqt_cli.core.leaves import STRUCTURE, leaves, with_leaves
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle import Vehicle
from eqt_cli.vehicle.forces import Force

RANGE = 2**64
"""N, the number of integers from which each parameter is drawn."""

SMALL = 7
"""The same for differences that people read."""

MEMBERSHIP = 1e-9
"""Largest distance of a floating-point pose from the group due to rounding."""


class Parameters:
    """Free parameters: independent integers, each uniform among `count` around 0."""

    def __init__(self, random: np.random.Generator, count: int) -> None:
        self._random, self._count = random, count

    def one(self) -> Exact:
        """Draw a parameter."""
        drawn = int(self._random.integers(self._count, dtype=np.uint64))
        return free(drawn - self._count // 2)

    def array(self, *shape: int) -> Array:
        """Draw an array of parameters."""
        found = np.empty(shape, dtype=object)
        for index in np.ndindex(shape):
            found[index] = self.one()
        return found

    def symmetric(self, size: int) -> Array:
        """Draw a symmetric matrix."""
        found = self.array(size, size)
        upper = np.triu_indices(size, 1)
        found[upper[::-1]] = found[upper]
        return found

    def function(self) -> Expression:
        """Draw an arbitrary function of time."""
        return FreeFunction("f(t)", frozenset("t"), Variable("t", 1), tuple(self.array(3)))


@dataclass(frozen=True)
class FreeFunction(Expression):
    """A function of time by its value, rate and second derivative at the time of the sample."""

    jet: tuple[Exact, ...] = field(repr=False, compare=False)

    def evaluate(self, values: Mapping[str, Any]) -> Any:
        """Return the value at the time of the sample, with its rate if the time has one."""
        t = values["t"]
        if isinstance(t, Dual):
            return Dual(self._derivative(0, t.value), self._derivative(1, t.value) * t.rate)
        return self._derivative(0, t)

    def _derivative(self, order: int, t: Any) -> Any:
        def at(time: Any) -> Exact:
            rate = time.derivative() if isinstance(time, Number) else 0.0
            return self.jet[order].moving(Exact.of(self.jet[order + 1] * rate))

        return np.frompyfunc(at, 1, 1)(t)


@dataclass(frozen=True)
class FreeForce(Force):
    """An arbitrary force that replaces everything between law and plant."""

    name: ClassVar[str] = "free"
    departs: ClassVar[str] = "any force"

    force: Any = field(metadata=STRUCTURE)

    def acting(self, G: MatrixLieGroup, t: Any, Q: Array, V: Array) -> Array:
        """Return the force."""
        return self.force


@dataclass
class State:
    """An exact state, and the assumptions of all computations from it."""

    sample: Sample
    ledger: Ledger


class ExactStates:
    """Exact states of a law, drawn once and shared by all identities."""

    def __init__(self, label: str, loop: ClosedLoop, random: np.random.Generator) -> None:
        self._label, self._loop, self._random = label, loop, random
        self._drawn: dict[int, list[State]] = {}

    def state(self, index: int, count: int = RANGE) -> State:
        """Return a state whose parameters are drawn from `count` integers.

        Raises
        ------
        ZeroDivisionError
            If the inertia is singular; the next call draws again.
        """
        drawn = self._drawn.setdefault(count, [])
        while len(drawn) <= index:
            parameters = Parameters(self._random, count)
            ledger = Ledger(parameters.one)
            with noting(ledger):
                sample = self._sample(parameters)
            drawn.append(State(sample, ledger))
        return drawn[index]

    @cached_property
    def obstacle(self) -> str:
        """Reason why there are no such states; empty if Cayley's transform stays in the group."""
        G = self._loop.group
        V = np.random.default_rng(0).uniform(-0.5, 0.5, G.dimension)
        if G.violation(G.cayley(V)) <= MEMBERSHIP:
            return ""
        return (
            f"Cayley's transform leaves the group {G.name}; give it a method `cayley` that does not"
        )

    def _sample(self, parameters: Parameters) -> Sample:
        loop, own = self._loop, self._loop.reference
        at_rest, G, m = tracks_nothing(loop), loop.group, loop.group.dimension
        loop = with_moving_reference(loop)
        loop = replace(
            loop,
            inertia=loop.inertia.with_functions(parameters.function),
            reference=loop.reference
            if at_rest
            else loop.reference.with_functions(parameters.function),
            vehicle=_with_any_force(loop.vehicle, parameters.array(1, m)),
        )
        loop = with_leaves(loop, _freed(loop, parameters))
        poses = [G.cayley(parameters.array(1, m)) for _ in range(5)]
        vectors = parameters.array(9, 1, m)
        Vd = np.zeros((1, m), dtype=object) if at_rest else vectors[1]
        times = parameters.array(1)
        drawn = poses[0], vectors[0], poses[1], Vd
        flat = loop.initial_state(*drawn, t=times)
        beyond = flat[:, loop.layout.slices["work"].stop :]
        beyond[:] = parameters.array(*beyond.shape)
        return Sample(
            label=self._label,
            loop=loop,
            times=times,
            flat=flat,
            states=list(zip(poses[2:], vectors[2:5], strict=True)),
            inputs=[(vectors[k], vectors[k + 1]) for k in (5, 7)],
            drawn=drawn,
            gains=loop.gains,
            reference=own.with_functions(parameters.function),
            lost=(0.0, 0.0),
        )


def _with_any_force(vehicle: Vehicle, force: Array) -> Vehicle:
    if vehicle.is_ideal:
        return vehicle
    return Vehicle(forces=(FreeForce(force),), control=vehicle.control)


def _freed(loop: ClosedLoop, parameters: Parameters) -> dict[str, Array]:
    """Return free tensors and gains, and the exact values of the law's own numbers."""
    found = {path: _constants(value) for path, value in leaves(loop).items()}
    found[K] = parameters.symmetric(len(found[K]))
    found[K_D] = parameters.array(*found[K_D].shape)
    for path in {MATRIX, INITIAL} & found.keys():
        found[path] = parameters.symmetric(len(found[path]))
    if INVERSE in found:
        found[INVERSE] = inverse(found[MATRIX])
    return found


def _constants(values: Array) -> Array:
    return np.asarray(np.frompyfunc(Exact.of, 1, 1)(values), dtype=object)
