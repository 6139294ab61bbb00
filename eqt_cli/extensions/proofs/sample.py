"""Random states at which identities are checked, and proofs at exact ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from math import log10
from typing import Any, ClassVar

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.expressions import Expression, Node
from eqt_cli.components.forces import Force
from eqt_cli.components.groups import MatrixLieGroup, cayley
from eqt_cli.components.mechanics import Gains, Input, Semidirect, State, Tracking
from eqt_cli.components.references import Reference, TorqueReference
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.extensions.proofs.exact import (
    UNIT,
    Exact,
    Ledger,
    difference,
    entrywise,
    free,
    inverse,
    is_number,
    lifted,
    noting,
    with_rate,
)
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.numbers.jets import Jet
from eqt_cli.numbers.leaves import STRUCTURE, leaves, with_leaves

# A closed loop at random states, in numbers with rates: rounded ones with error bounds, or exact --
#
# Free parameters of an exact state are the Cayley parameters of every pose, the entries of every
# vector, of the inertia and of the gains, and every function of time with its first and second
# derivative. Numbers in a law are not free: a float is its exact dyadic fraction.


MATRIX, INITIAL, INVERSE = "inertia.matrix", "inertia.initial", "inertia.inverse"
K, K_D = "gains.K", "gains.K_d"
"""Paths of the leaves of a loop that are tensors."""

STATES = 5
"""Number of random states per identity; any of them shows an error in a formula."""


@dataclass(frozen=True)
class Sample:
    """The data of an identity; every array has a leading axis of random states.

    Attributes
    ----------
    label, loop
        Label of a controller, and its closed loop in these numbers.
    times, flat
        Random times and flat states, without rates.
    states
        Elements X, Y, Z of G ⋉ g*, without rates.
    inputs
        Elements U, W of its algebra.
    drawn
        Poses and velocities Q, V, Q_d, V_d from which the flat states were made.
    gains
        Gains without symmetries that could hide a fault: K commutes with no rotation, and K_d is
        not symmetric.
    reference
        Reference of the experiment, which the loop may have replaced (see `sampled`).
    velocities
        V and V_d with the errors that they have because their momenta were computed in floats.
    exact
        Exact states of the same loop, if its identities are to be proved.
    """

    label: str
    loop: ClosedLoop
    times: Array
    flat: Array
    states: list[State]
    inputs: list[Input]
    drawn: tuple[Array, Array, Array, Array]
    gains: Gains
    reference: Reference
    velocities: list[Array]
    exact: ExactStates | None = None

    @cached_property
    def s(self) -> Tracking:
        """The law's arguments; every rate is the time derivative along the closed loop."""
        moving = with_rate(self.flat, self.loop.vector_field(self.times, self.flat))
        return self.loop.tracking(with_rate(self.times, 1.0), moving)

    @property
    def resting(self) -> Tracking:
        """The same states without rates."""
        return self.loop.tracking(self.times, self.flat)

    @cached_property
    def generic(self) -> Tracking:
        """The same states with `gains` instead of the experiment's."""
        return replace(self.s, gains=self.gains)

    def lifted(self, values: Any) -> Array:
        """Convert floats or numbers to the sample's kind of number, without rates."""
        return entrywise(type(self.flat.flat[0]).of, values)

    @property
    def G(self) -> MatrixLieGroup:
        """The group."""
        return self.loop.group

    @property
    def semidirect(self) -> Semidirect:
        """G ⋉ g*."""
        return Semidirect(self.G)

    def moving(self, X: State, X_dot: State) -> State:
        """Return X with the rate X_dot."""
        return with_rate(X[0], X_dot[0]), with_rate(X[1], X_dot[1])


def sampled(label: str, loop: ClosedLoop, horizon: float, random: np.random.Generator) -> Sample:
    """Return a closed loop at random states and random times within its horizon.

    A reference without states is replaced by one with states, so that it moves at random unless the
    law tracks none.
    """
    G, reference = loop.group, loop.reference
    at_rest = tracks_nothing(loop)
    loop = with_moving_reference(loop)
    poses = [G.exp(random.standard_normal((STATES, G.dimension))) for _ in range(5)]
    vectors = random.standard_normal((9, STATES, G.dimension))
    times = random.uniform(0.0, horizon, STATES)
    held = loop.holding(times)
    bounded = with_leaves(held, _with_errors(leaves(held)))
    Vd = np.zeros_like(vectors[1]) if at_rest else vectors[1]
    flat = np.stack(
        [
            loop.initial_state(Q, V, Q_d, V_d, t)
            for Q, V, Q_d, V_d, t in zip(poses[0], vectors[0], poses[1], Vd, times, strict=True)
        ]
    )
    # The states after W, such as a law's memory, would start at 0.
    beyond = flat[:, loop.layout.slices["work"].stop :]
    beyond[:] = random.standard_normal(beyond.shape)
    drift = np.maximum(G.drift(poses[0]), G.drift(poses[1]))
    # A pose with a drift counts as an element of the group with an error of that size.
    errors = np.maximum(drift[:, None], UNIT * np.abs(flat))
    free = [lifted(Q, G.drift(Q)[:, None, None]) for Q in poses[2:]]
    states = [(Q, lifted(P)) for Q, P in zip(free, vectors[2:5], strict=True)]
    inputs = [(lifted(vectors[k]), lifted(vectors[k + 1])) for k in (5, 7)]
    A, B = (random.standard_normal(tensor.shape) for tensor in (loop.gains.K, loop.gains.K_d))
    gains = Gains(A @ A.T / len(A) + np.eye(len(A)), B + len(B) * np.eye(len(B)))
    # The inverse of the inertia magnifies the rounding error of a momentum.
    roundings = 4 * G.dimension * UNIT * np.linalg.cond(loop.inertia.at(times).matrix).max()
    return Sample(
        label,
        bounded,
        lifted(times),
        lifted(flat, errors),
        states,
        inputs,
        (lifted(poses[0]), lifted(vectors[0]), lifted(poses[1]), lifted(Vd)),
        gains,
        reference,
        [lifted(V, roundings * np.abs(V).max()) for V in (vectors[0], Vd)],
    )


def tracks_nothing(loop: ClosedLoop) -> bool:
    """Whether the law only handles a reference at rest."""
    return "track" not in loop.controller.tasks


def with_moving_reference(loop: ClosedLoop) -> ClosedLoop:
    """Return the loop with a reference whose pose and velocity are part of the state.

    Identities are of laws, which take an inertia whose mass leaves for constant.
    """
    if (now := loop.inertia.at(0.0)).leaves:
        loop = replace(loop, inertia=replace(now, change=None, leaves=False))
    if "velocity" in loop.reference.starts_from or loop.controller.reads_flat_output:
        return loop
    torque = 0.0 if tracks_nothing(loop) else 0.5
    return replace(loop, reference=TorqueReference([torque] * loop.group.dimension))


def _with_errors(numbers: dict[str, Array]) -> dict[str, Array]:
    """Return the numbers of a loop with the errors of inverses and of symmetric matrices."""
    widened = dict(numbers)
    for path in {MATRIX, INITIAL, K} & widened.keys():
        matrix = widened[path]
        widened[path] = lifted(matrix, np.abs(matrix - matrix.swapaxes(-1, -2)))
    if INVERSE in widened:
        matrix, inverse = numbers[MATRIX], numbers[INVERSE]
        condition = np.linalg.norm(matrix) * np.linalg.norm(inverse)
        # Higham, section 14.1: an inverse errs by a few m u cond(A) ‖A⁻¹‖.
        error = 4 * len(matrix) * UNIT * condition * np.abs(inverse).max()
        widened[INVERSE] = lifted(inverse, error)
    return widened


# Exact states -------------------------------------------------------------------------------------

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
        return free(int(self._random.integers(self._count, dtype=np.uint64)) - self._count // 2)

    def array(self, *shape: int) -> Array:
        """Draw an array of parameters."""
        entries = np.empty(shape, dtype=object)
        for index in np.ndindex(shape):
            entries[index] = self.one()
        return entries

    def symmetric(self, size: int) -> Array:
        """Draw a symmetric matrix."""
        matrix = self.array(size, size)
        upper = np.triu_indices(size, 1)
        matrix[upper[::-1]] = matrix[upper]
        return matrix

    def function(self) -> Expression:
        """Draw an arbitrary function of time."""
        return FreeFunction("f(t)", frozenset("t"), Node("t", 1), tuple(self.array(3)))


@dataclass(frozen=True)
class FreeFunction(Expression):
    """A function of time by its value, rate and second derivative at the time of the sample."""

    jet: tuple[Exact, ...] = field(repr=False, compare=False)

    def evaluate(self, values: Mapping[str, Any]) -> Any:
        """Return the value at the time of the sample, with its rate if the time has one."""
        t = values["t"]
        if isinstance(t, Jet):
            return Jet([self._derivative(order, t.value) for order in range(2)])
        return self._derivative(0, t)

    def _derivative(self, order: int, t: Any) -> Any:
        def at(time: Any) -> Exact:
            rate = time.derivative() if is_number(time) else 0.0
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


class ExactStates:
    """Exact states of a law, drawn once and shared by all identities."""

    def __init__(self, label: str, loop: ClosedLoop, random: np.random.Generator) -> None:
        self._label, self._loop, self._random = label, loop, random
        self._drawn: dict[int, list[tuple[Sample, Ledger]]] = {}

    def state(self, index: int, count: int) -> tuple[Sample, Ledger]:
        """Return a state whose parameters are drawn from `count` integers.

        With it come the assumptions of all computations from it.

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
                drawn.append((self._sample(parameters), ledger))
        return drawn[index]

    @cached_property
    def obstacle(self) -> str:
        """Reason why there are no such states; empty if Cayley's transform stays in the group."""
        G = self._loop.group
        V = np.random.default_rng(0).uniform(-0.5, 0.5, G.dimension)
        if G.violation(cayley(G, V)) <= MEMBERSHIP:
            return ""
        return (
            f"Cayley's transform leaves the group {G.name}; give it a method `cayley` that does not"
        )

    def _sample(self, parameters: Parameters) -> Sample:
        loop, reference = self._loop, self._loop.reference
        at_rest, G, m = tracks_nothing(loop), loop.group, loop.group.dimension
        loop = with_moving_reference(loop)
        loop = replace(loop, inertia=loop.inertia.with_functions(parameters.function))
        if not at_rest:
            loop = replace(loop, reference=loop.reference.with_functions(parameters.function))
        any_force = FreeForce(parameters.array(1, m))
        if not loop.vehicle.is_ideal:
            loop = replace(loop, vehicle=Vehicle(forces=(any_force,), control=loop.vehicle.control))
        loop = with_leaves(loop, _freed(loop, parameters))
        poses = [cayley(G, parameters.array(1, m)) for _ in range(5)]
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
            reference=reference.with_functions(parameters.function),
            velocities=[vectors[0], Vd],
        )


def _freed(loop: ClosedLoop, parameters: Parameters) -> dict[str, Array]:
    """Return free tensors and gains, and the exact values of the law's own numbers."""
    free = {path: entrywise(Exact.of, value) for path, value in leaves(loop).items()}
    free[K] = parameters.symmetric(len(free[K]))
    free[K_D] = parameters.array(*free[K_D].shape)
    for path in {MATRIX, INITIAL} & free.keys():
        free[path] = parameters.symmetric(len(free[path]))
    if INVERSE in free:
        free[INVERSE] = inverse(free[MATRIX])
    return free


# Proves that two sides are equal as rational functions, by values at random exact states ----------
#
# If the sides are not equal, they differ by n / D, where the polynomial n is not 0. If every
# parameter is drawn from N integers, n vanishes with a probability of at most deg n / N (Schwartz
# 1980, Zippel 1979), and among the states where no denominator vanishes with at most
# deg n / (N − deg D), where D is the product of all divisors. If functions became parameters, the
# differences of their arguments count as well, because an argument difference that is 0 by chance
# would identify two different functions. So the probability that k states miss a difference is at
# most the k-th power of (d + e) / (N − deg D), where d is the degree of n and e is the sum of the
# degrees of the compared arguments.


Sides = Callable[[Sample], Iterator[tuple[Array, Array]]]

CERTAIN = 1e-50
"""Probability of a missed difference below which the sides count as equal."""

MOST_STATES = 20
"""Largest number of drawn states."""


@dataclass(frozen=True)
class Proof:
    """The sides are equal.

    Attributes
    ----------
    degree
        Bound of the degree of every numerator of a difference.
    points
        k, the number of states at which the sides were equal.
    probability
        Bound of the probability that different sides agree at all these states.
    functions
        Sentence about functions that became parameters.
    """

    degree: int
    points: int
    probability: float
    functions: str = ""


@dataclass(frozen=True)
class Refutation:
    """The sides differ.

    Attributes
    ----------
    difference
        Left − right at a state.
    place
        Entry, equation and state of the difference, in words.
    """

    difference: Fraction
    place: str


class UnprovableError(ValueError):
    """States of this kind cannot decide whether the sides are equal."""


def prove(sides: Sides, states: ExactStates) -> Proof | Refutation | None:
    """Decide whether the sides are equal for all states; None if there are no equations.

    Raises
    ------
    UnprovableError
        If exact states cannot decide this.
    Exception
        Any error of a law that cannot be evaluated on exact numbers.
    """
    degree, chance, points = 0, Fraction(0), 0
    for index in range(MOST_STATES):
        differences = _differences(sides, states, index, RANGE)
        if differences is None:
            continue
        if not differences:
            return None
        _, ledger = states.state(index, RANGE)
        functions = " and ".join(f"{name}()" for name in sorted(ledger.functions))
        if functions:
            several = len(ledger.functions) > 1
            functions += " are free parameters" if several else " is a free parameter"
        if any(gap.numerator for _, gap in differences):
            if functions:
                raise UnprovableError(f"the sides differ where {functions}")
            return _readable(sides, states) or _refutation(differences, "at a random state")
        highest = max(gap.degree for _, gap in differences)
        room = max(RANGE - ledger.degree, 1)
        degree, points = max(degree, highest), points + 1
        chance = max(chance, min(Fraction(1), Fraction(highest + ledger.compared, room)))
        if chance**points < CERTAIN:
            return Proof(degree, points, float(chance**points), functions)
    raise UnprovableError(
        f"{MOST_STATES} random states do not suffice, of which {points} have values"
    )


Place = tuple[int, tuple[int, ...]]
"""Number of an equation, and an entry of it."""


def _differences(
    sides: Sides, states: ExactStates, index: int, count: int
) -> list[tuple[Place, Exact]] | None:
    """Return left − right of every entry at a state; None if a denominator vanishes."""
    try:
        sample, ledger = states.state(index, count)
        with noting(ledger):
            return [
                ((number, entry[1:]), gap)
                for number, (left, right) in enumerate(sides(sample), start=1)
                for entry, gap in np.ndenumerate(entrywise(difference, left, right))
            ]
    except ZeroDivisionError:
        return None


def _refutation(differences: Iterable[tuple[Place, Exact]], state: str) -> Refutation | None:
    """Return the first difference that is not 0; None if there is none."""
    for (number, entry), gap in differences:
        if gap.numerator:
            place = f" in entry {list(entry)}" if entry else ""
            return Refutation(gap.value, f"{place} of equation {number}, {state}")
    return None


def _readable(sides: Sides, states: ExactStates) -> Refutation | None:
    """Return a difference at a state of small integers; None if none is found."""
    for index in range(MOST_STATES):
        differences = _differences(sides, states, index, SMALL) or ()
        if refutation := _refutation(differences, "at a random state of small integers"):
            return refutation
    return None


def written(number: Fraction, most: int = 60) -> str:
    """Format a fraction, shortened if it has many digits."""
    if len(text := str(number)) <= most:
        return text
    size = log10(abs(number.numerator)) - log10(number.denominator)
    power = int(size // 1)
    sign = "-" if number < 0 else ""
    digits = sum(map(str.isdigit, text))
    return f"{sign}{10 ** (size - power):.3f}e{power:+03d} (a fraction of {digits} digits)"
