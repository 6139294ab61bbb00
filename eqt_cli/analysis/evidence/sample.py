"""A closed loop at random states, in numbers that know their rates and perhaps their errors."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from eqt_cli.analysis.evidence.numbers import with_rate
from eqt_cli.analysis.evidence.running_error import UNIT, lifted
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array
from eqt_cli.core.leaves import leaves, with_leaves
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.semidirect import Input, Semidirect, State
from eqt_cli.mechanics.tracking import Gains, Tracking
from eqt_cli.references import Reference
from eqt_cli.references.torque import TorqueReference

if TYPE_CHECKING:
    from eqt_cli.analysis.evidence.exact_states import ExactStates

MATRIX, INITIAL, INVERSE = "inertia.matrix", "inertia.initial", "inertia.inverse"
K, K_D = "gains.K", "gains.K_d"
"""The paths of the numbers of a loop that are tensors."""

STATES = 5
"""Random states per identity: an error in a formula shows at any one of them."""


@dataclass(frozen=True)
class Sample:
    """What an identity may look at; every array has a leading axis of random states.

    Attributes
    ----------
    label, loop
        A controller's label, and its closed loop in these numbers.
    times, flat
        Random times and flat states, at rest.
    states
        Elements X, Y, Z of G ⋉ g*, at rest.
    inputs
        Elements U, W of its algebra.
    drawn
        The poses and velocities Q, V, Q_d, V_d that the flat states were made of.
    gains
        Gains without symmetries that could hide a fault: K commutes with no rotation, and K_d is
        not symmetric.
    reference
        The experiment's own, which the loop may not have (see `sampled`).
    lost
        How far the momenta of V and V_d, as products in plain floats, can have moved either.
    exact
        The exact states of the same loop, where its identities are to be proved.
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
    lost: tuple[float, float]
    exact: "ExactStates | None" = None

    @cached_property
    def s(self) -> Tracking:
        """What the law reads; every rate is the time derivative along the closed loop."""
        field = self.loop.vector_field(self.times, self.flat)
        moving = with_rate(self.flat, field)
        return self.loop.tracking(with_rate(self.times, 1.0), moving)

    @property
    def resting(self) -> Tracking:
        """The same state without rates."""
        return self.loop.tracking(self.times, self.flat)

    @cached_property
    def generic(self) -> Tracking:
        """The same states with `gains` instead of the experiment's."""
        return replace(self.s, gains=self.gains)

    def lifted(self, values: Any) -> Array:
        """Floats, or such numbers, as numbers of the sample's kind that do not move."""
        kind = type(self.flat.flat[0])
        return np.asarray(np.frompyfunc(kind.of, 1, 1)(values), dtype=object)

    @property
    def G(self) -> MatrixLieGroup:
        """The group."""
        return self.loop.group

    @property
    def semidirect(self) -> Semidirect:
        """G ⋉ g*."""
        return Semidirect(self.G)

    def moving(self, X: State, X_dot: State) -> State:
        """X with X_dot as its rate."""
        return with_rate(X[0], X_dot[0]), with_rate(X[1], X_dot[1])

    def near_identity(self, U: Input) -> State:
        """A curve through (I, 0) with velocity U: (exp(tV), tP) to first order."""
        V, P = U
        identity = np.broadcast_to(self.G.identity, (*V.shape[:-1], *self.G.identity.shape))
        return self.moving((identity, np.zeros(P.shape)), (self.G.hat(V), P))


def sampled(label: str, loop: ClosedLoop, horizon: float, random: np.random.Generator) -> Sample:
    """A closed loop at random states and random times of its horizon.

    The reference moves, whatever it does in the experiment, unless the law tracks none; so one that
    has no state of its own is replaced by one that has.
    """
    G, own = loop.group, loop.reference
    at_rest = tracks_nothing(loop)
    loop = with_moving_reference(loop)
    bounded = with_leaves(loop, _with_errors(leaves(loop)))
    poses = [G.exp(random.standard_normal((STATES, G.dimension))) for _ in range(5)]
    vectors = random.standard_normal((9, STATES, G.dimension))
    times = random.uniform(0.0, horizon, STATES)
    Vd = np.zeros_like(vectors[1]) if at_rest else vectors[1]
    flat = np.stack(
        [
            loop.initial_state(Q, V, Q_d, V_d, t)
            for Q, V, Q_d, V_d, t in zip(poses[0], vectors[0], poses[1], Vd, times, strict=True)
        ]
    )
    draw_beyond_work(loop, flat, random)
    drift = np.maximum(G.drift(poses[0]), G.drift(poses[1]))
    # What is off the group by its drift is as good as an element of it with errors of that size.
    errors = np.maximum(drift[:, None], UNIT * np.abs(flat))
    free = [lifted(Q, G.drift(Q)[:, None, None]) for Q in poses[2:]]
    states = [(Q, lifted(P)) for Q, P in zip(free, vectors[2:5], strict=True)]
    inputs = [(lifted(vectors[k]), lifted(vectors[k + 1])) for k in (5, 7)]
    gains = _without_symmetry(loop, random)
    # The inverse of the inertia magnifies what plain floats lose in a momentum.
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
        own,
        (roundings * np.abs(vectors[0]).max(), roundings * np.abs(Vd).max()),
    )


def tracks_nothing(loop: ClosedLoop) -> bool:
    """Whether the law is for a reference at rest only."""
    return "track" not in loop.controller.tasks


def with_moving_reference(loop: ClosedLoop) -> ClosedLoop:
    """The same with a reference whose pose and velocity are part of the state."""
    if "velocity" in loop.reference.starts_from:
        return loop
    torque = 0.0 if tracks_nothing(loop) else 0.5
    return replace(loop, reference=TorqueReference([torque] * loop.group.dimension))


def draw_beyond_work(loop: ClosedLoop, flat: Array, random: np.random.Generator) -> None:
    """Random numbers for every state behind W, such as a law's memory, which starts at 0."""
    beyond = flat[:, loop.layout.slices["work"].stop :]
    beyond[:] = random.standard_normal(beyond.shape)


def _without_symmetry(loop: ClosedLoop, random: np.random.Generator) -> Gains:
    A, B = (random.standard_normal(given.shape) for given in (loop.gains.K, loop.gains.K_d))
    return Gains(A @ A.T / len(A) + np.eye(len(A)), B + len(B) * np.eye(len(B)))


def _with_errors(numbers: dict[str, Array]) -> dict[str, Array]:
    """The numbers of a loop with what is inexact in them: inverses, and digits of symmetry."""
    found = dict(numbers)
    for path in {MATRIX, INITIAL, K} & found.keys():
        matrix = found[path]
        found[path] = lifted(matrix, np.abs(matrix - matrix.swapaxes(-1, -2)))
    if INVERSE in found:
        matrix, inverse = numbers[MATRIX], numbers[INVERSE]
        condition = np.linalg.norm(matrix) * np.linalg.norm(inverse)
        # Higham, section 14.1: an inverse errs by a few m u cond(A) ‖A⁻¹‖.
        error = 4 * len(matrix) * UNIT * condition * np.abs(inverse).max()
        found[INVERSE] = lifted(inverse, error)
    return found
