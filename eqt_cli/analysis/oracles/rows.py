"""Compares an experiment with a foreign plant; the rows stand beside the certificates."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from eqt_cli.analysis.certificates.base import Row, Verdict
from eqt_cli.analysis.evidence.runs import STATES_PER_RTOL
from eqt_cli.analysis.evidence.sample import draw_beyond_work
from eqt_cli.analysis.oracles.base import Oracle, RigidBody, SteppingOracle
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array, frobenius, norm
from eqt_cli.engines import Problem
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.groups.euclidean import EuclideanGroup
from eqt_cli.mechanics.inertia import Inertia
from eqt_cli.mechanics.lie_poisson import lie_poisson
from eqt_cli.mechanics.tracking import Tracking
from eqt_cli.vehicle import Vehicle
from eqt_cli.vehicle.sampling import Sampling

STATES = 20
"""Number of random states at which accelerations are compared."""

TOLERANCE = 1e-12
"""Tolerance of accelerations relative to the largest of a state or 1: rounding of both sides."""

PERIOD, INSTANTS = 0.05, 40
"""Control period, s, and number of periods of the sampled loop that the oracle integrates."""

SUBSTEPS = (1, 2, 4, 8)
"""Numbers of integration steps per period, one after the other."""

RTOL = 1e-12
"""Relative tolerance of eqt's own solution."""

ORDER = 2.0
"""Least order with which the difference falls. For MuJoCo's "RK4", 2.00 was measured with version
3.3, whose attitude is of second order, and 4.00 with version 4.0."""

SHORTFALL = 0.2
"""Allowed shortfall of the order, which is reached only in the limit of short steps."""


def oracle_rows(
    kind: type[Oracle], experiment: Experiment, random: np.random.Generator
) -> list[Row]:
    """Compare the accelerations of plant and reference, and a sampled loop if possible."""
    compare = _Comparisons(kind, random)
    rows: list[Row] = []
    for index, (label, loop) in enumerate(experiment.loops.items()):
        if index == 0:  # the reference and its inertia are the same for all laws
            rows.append(compare.row("acceleration of the reference", "", compare.reference, loop))
        rows.append(compare.row("acceleration of the plant", label, compare.plant, loop))
        if issubclass(kind, SteppingOracle):
            name = "sampled loop converges to eqt's"
            rows.append(compare.row(name, label, compare.closed_loop, loop, experiment))
    return rows


_Compared = tuple[float, float, str]
"""Measured value, bound and remark."""


class _NotComparable(Exception):
    """Carries the verdict and the reason if a comparison is impossible."""


class _Comparisons:
    """The comparisons of an oracle with one loop after the other."""

    def __init__(self, kind: type[Oracle], random: np.random.Generator) -> None:
        self.kind, self.random = kind, random
        self.statement = f"{kind.title} {kind.version()}"

    def row(self, name: str, label: str, compare: Callable[..., _Compared], *about: Any) -> Row:
        """Return the row of one comparison."""
        try:
            measured, bound, remark = compare(*about)
        except _NotComparable as not_comparable:
            return Row(name, self.statement, "oracle", label, None, None, *not_comparable.args)
        verdict = Verdict.HOLDS if measured <= bound else Verdict.FAILS
        return Row(name, self.statement, "oracle", label, measured, bound, verdict, remark)

    def reference(self, loop: ClosedLoop) -> _Compared:
        """Compare V̇_d under τ_d, with the inertia that the laws use."""
        s = self._states(loop)
        body = self._body(loop, s, true=False)
        _, P_dot = lie_poisson(s.G, s.Qd, s.Pd, s.Vd, s.tau_d)
        return _compared(s, body, (s.Qd, s.Vd, s.tau_d, s.inertia.velocity(P_dot)))

    def plant(self, loop: ClosedLoop) -> _Compared:
        """Compare V̇ under all forces, with the true inertia."""
        s = self._states(loop)
        body = self._body(loop, s, true=True)
        acting, _ = loop.acting_and_rates(s)
        _, P_dot = lie_poisson(s.G, s.Q, s.P, s.V, acting)
        # Without the model error of the inertia, these are the real forces.
        forces = replace(loop.vehicle, inertia=None).acting(s, loop.torque(s))
        return _compared(s, body, (s.Q, s.V, forces, s.inertia.velocity(P_dot)))

    def closed_loop(self, loop: ClosedLoop, experiment: Experiment) -> _Compared:
        """Compare a loop with a zero-order hold, stepped by the oracle, with eqt's solution."""
        body = self._body(loop, self._states(loop), true=False)
        assert isinstance(body, SteppingOracle)
        loop = replace(loop, vehicle=Vehicle(control=Sampling(PERIOD)))
        G, x = loop.group, self.random.standard_normal((2, loop.group.dimension)) / 2
        Qd, Vd = experiment.initial_pose, experiment.initial_velocity
        first = loop.initial_state(Qd @ G.exp(x[0]), Vd + x[1], Qd, Vd)
        times = PERIOD * np.arange(INSTANTS + 1)
        engine = experiment.engine.sized(1, loop.state_length)
        exact = engine.tightened(min(1.0, RTOL / engine.rtol))
        solution = exact.solve(Problem(loop, first[None], times))
        if solution.status[0]:
            reason = f"eqt's own run fails: {solution.messages[0]}"
            raise _NotComparable(Verdict.UNDECIDED, reason)
        found = [_difference(loop, body, times, first, solution.states[0], n) for n in SUBSTEPS]
        orders = np.log2(np.array(found[:-1]) / found[1:])
        bound = max(found[0] / SUBSTEPS[-1] ** (ORDER - SHORTFALL), STATES_PER_RTOL * RTOL)
        falls = ", ".join(f"{order:.2f}" for order in orders)
        step = PERIOD / SUBSTEPS[-1]
        remark = f"at {times[-1]:g} s, steps of {step:g} s; falls with order {falls}"
        return found[-1], bound, remark

    def _states(self, loop: ClosedLoop) -> Tracking:
        """Return the loop at random states, all at one time."""
        G, random = loop.group, self.random
        Q, Qd = (G.exp(random.standard_normal((STATES, G.dimension))) for _ in range(2))
        V, Vd = random.standard_normal((2, STATES, G.dimension))
        t = float(random.uniform(0.0, 1.0))
        flat = loop.initial_state(Q, V, Qd, Vd, t)
        draw_beyond_work(loop, flat, random)
        return loop.tracking(t, flat)

    def _body(self, loop: ClosedLoop, s: Tracking, *, true: bool) -> Oracle:
        """Create the loop's body in the other program, with its true or its modelled inertia."""
        inertia: Inertia = s.inertia
        if true and loop.vehicle.inertia is not None:
            inertia = loop.vehicle.inertia.at(inertia, s.t)
        if inertia.change is not None:
            raise _NotComparable(Verdict.NOT_COVERED, "the inertia varies in time")
        body = RigidBody.of(loop.group, np.asarray(inertia.matrix))
        if body is None:
            reason = "no rigid body in space has this group or this inertia"
            raise _NotComparable(Verdict.NOT_COVERED, reason)
        try:
            return self.kind(body)
        except ValueError as error:
            reason = f"{self.kind.title} does not take this body: {error}"
            raise _NotComparable(Verdict.NOT_COVERED, reason) from error


def _compared(s: Tracking, oracle: Oracle, given: tuple[Array, ...]) -> _Compared:
    """Return the largest difference of accelerations, given Q, V, the force and eqt's V̇."""
    Q, V, force, expected = (
        np.broadcast_to(values, (STATES, *values.shape[values.ndim - axes :]))
        for values, axes in zip(given, (2, 1, 1, 1), strict=True)
    )
    worst = 0.0
    for k in range(STATES):
        found = oracle.acceleration(*_attitude_and_position(s, Q[k]), V[k], force[k])
        size = max(1.0, float(np.abs(expected[k]).max()))
        worst = max(worst, float(np.abs(found - expected[k]).max()) / size)
    return worst, TOLERANCE, f"relative, at {STATES} random states"


def _attitude_and_position(s: Tracking, Q: Array) -> tuple[Array, Array]:
    """Return the attitude and the position of a pose."""
    assert isinstance(s.G, EuclideanGroup)
    return s.G.rotation(Q), Q[:3, 3:].reshape(-1)


def _difference(
    loop: ClosedLoop,
    oracle: SteppingOracle,
    times: Array,
    first: Array,
    expected: Array,
    substeps: int,
) -> float:
    """Return the final difference between eqt's solution and a loop whose plant the oracle steps.

    The law is eqt's, evaluated at the motion of the oracle's body. The reference is eqt's.
    """
    G, layout, state = loop.group, loop.layout, first
    s = loop.tracking(times[0], state)
    oracle.start(*_attitude_and_position(s, s.Q), s.V)
    ours = [name for name in layout.lengths if name.startswith("desired")]
    for k, t in enumerate(times[:-1]):
        state = loop.after_instant(t, state)
        torque = loop.torque(loop.tracking(t, state))
        R, x, V = oracle.steps(torque, PERIOD / substeps, substeps)
        pose = np.eye(G.size)
        pose[:3, :3], pose[:3, 3:] = R, x.reshape(3, -1) if x.size else np.empty((3, 0))
        after = layout.split(expected[k + 1])
        changed = {name: after[name] for name in ours}
        changed |= {"pose": G.pack(pose), "momentum": loop.inertia.at(times[k + 1]).momentum(V)}
        state = layout.join(layout.split(state) | changed, state)
    end, right = (loop.tracking(times[-1], values) for values in (state, expected[-1]))
    return float(max(frobenius(end.Q - right.Q), norm(end.V - right.V)))
