"""Lemma 6.1: the error system, integrated by itself, gives the error of the closed loop."""

import dataclasses

import numpy as np
import pytest

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.controllers import controllers
from eqt_cli.controllers.eqt import EqT
from eqt_cli.core.arrays import frobenius
from eqt_cli.core.expressions import parse
from eqt_cli.engines import Problem, engines
from eqt_cli.groups import group_named
from eqt_cli.mechanics.inertia import Inertia, PrescribedInertia
from eqt_cli.mechanics.lie_poisson import lie_poisson
from eqt_cli.mechanics.semidirect import Semidirect
from eqt_cli.mechanics.tracking import Gains
from eqt_cli.references.torque import TorqueReference


@dataclasses.dataclass(frozen=True)
class ErrorSystem(ClosedLoop):
    """The Lie-Poisson system of E = X X_d⁻¹, with the inertia 𝕀̄_t, and the reference.

    A flat state is the closed loop's with E = (Q_E, P_E) in place of X.
    """

    def error(self, state):
        """Return E from a flat state of this system."""
        found = self.layout.split(state)
        return self.group.unpack(found["pose"]), found["momentum"]

    def state_from(self, loop_state, t):
        """Return the flat state of this system for a flat state of the closed loop."""
        s = super().tracking(t, loop_state)
        Q_E, P_E = Semidirect(self.group).error((s.Q, s.P), (s.Qd, s.Pd))
        error = {"pose": self.group.pack(Q_E), "momentum": P_E}
        return self.layout.join(self.layout.split(loop_state) | error, loop_state)

    def tracking(self, t, state):
        """Return the quantities that a law may read, at X = E X_d."""
        s = super().tracking(t, state)
        Q, P = Semidirect(self.group).compose(self.error(state), (s.Qd, s.Pd))
        return dataclasses.replace(s, Q=Q, P=P)

    def vector_field(self, t, state):
        """Return Q̇_E = Q_E V_E^, Ṗ_E = ad*_{V_E} P_E + τ_E with V_E = 𝕀̄_t⁻¹ P_E.

        Hampsey et al. (2025), eq. (18) and Lemma 6.1; τ_E is the second part of eq. (19).
        """
        G, s = self.group, self.tracking(t, state)
        Q_E, P_E = self.error(state)
        V_E = G.Ad(s.Qd, s.inertia.velocity(G.Ad_star(s.Qd, P_E)))
        acting, _ = self.acting_and_rates(s)
        _, tau_E = Semidirect(G).error_input((s.Qd, s.Pd), (s.V, acting), (s.Vd, s.tau_d))
        Q_E_dot, P_E_dot = lie_poisson(G, Q_E, P_E, V_E, tau_E)
        rates = self.layout.split(super().vector_field(t, state))
        error = {"pose": G.pack(Q_E_dot), "momentum": P_E_dot, "work": 0.0}
        return self.layout.join(rates | error, state)


TIMES = np.linspace(0.0, 1.0, 6)
RTOL = 1e-8
# Two integrations, each with errors of some rtol, of states up to ten.
TOLERANCE = 1000 * RTOL


def closed_loop(G, law=None, inertia=None):
    tensor = np.diag(np.linspace(1.0, 2.0, G.dimension)) + 0.1
    return ClosedLoop(
        group=G,
        inertia=inertia or Inertia(tensor, np.linalg.inv(tensor)),
        gains=Gains(np.diag(np.linspace(1.0, 2.0, G.size)), np.eye(G.dimension)),
        reference=TorqueReference((["cos(t)", "sin(t)", "cos(t)*sin(t)"] * 3)[: G.dimension]),
        controller=law or EqT(),
    )


def start(loop, runs=2):
    G, random = loop.group, np.random.default_rng(0)
    Q, Qd = (G.exp(0.7 * random.standard_normal((runs, G.dimension))) for _ in range(2))
    V, Vd = 0.5 * random.standard_normal((2, runs, G.dimension))
    return loop.initial_state(Q, V, Qd, Vd)


def both(loop, engine):
    """E of the error system, and X X_d⁻¹ of the closed loop."""
    state, system = start(loop), ErrorSystem.of(loop)
    solved = [
        engine.solve(Problem(one, states, TIMES)).states
        for one, states in ((loop, state), (system, system.state_from(state, 0.0)))
    ]
    s = loop.tracking(TIMES, solved[0])
    return system.error(solved[1]), Semidirect(loop.group).error((s.Q, s.P), (s.Qd, s.Pd))


def assert_same(one, other):
    for left, right in zip(one, other, strict=True):
        np.testing.assert_allclose(left, right, rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("name", ["gt", "nog", "goodarzi2013", "quaternion"])
def test_lemma_6_1_for_laws(name):
    """In space and in the body, with memory and without; it holds for any torque."""
    loop = closed_loop(group_named("SO3"), controllers.get(name)())
    assert_same(*both(loop, engines.get("solve_ivp")(rtol=RTOL, atol=1e-11)))


def test_lemma_6_1_with_an_inertia_that_varies(G):
    rows = [["0"] * G.dimension for _ in range(G.dimension)]
    for k in range(G.dimension):
        rows[k][k] = f"{k + 1} + sin(t)/{k + 2}"
    law = PrescribedInertia(tuple(tuple(parse(text) for text in row) for row in rows))
    loop = closed_loop(G, inertia=law)
    assert_same(*both(loop, engines.get("solve_ivp")(rtol=RTOL, atol=1e-11)))


@pytest.mark.parametrize("name", ["SO3", "SE3*SO2"])
def test_lemma_6_1_with_the_compiled_engine(name):
    assert_same(*both(closed_loop(group_named(name)), engines.get("native")(rtol=RTOL)))


def test_state_of_the_error_system_holds_the_error(G):
    loop = closed_loop(G)
    state, system = start(loop), ErrorSystem.of(loop)
    s = loop.tracking(0.0, state)
    expected = Semidirect(G).error((s.Q, s.P), (s.Qd, s.Pd))
    for left, right in zip(system.error(system.state_from(state, 0.0)), expected, strict=True):
        np.testing.assert_allclose(left, right, rtol=0, atol=1e-12)


def test_error_system_sees_the_state_of_the_closed_loop(G):
    loop = closed_loop(G)
    state, system = start(loop), ErrorSystem.of(loop)
    one, other = loop.tracking(0.0, state), system.tracking(0.0, system.state_from(state, 0.0))
    for name in ("Q", "P", "Qd", "Pd", "V_E", "gradient"):
        left, right = getattr(one, name), getattr(other, name)
        np.testing.assert_allclose(left, right, rtol=0, atol=1e-12, err_msg=name)


def test_the_error_is_not_small_to_begin_with(G):
    """So that the comparison means something."""
    s = (loop := closed_loop(G)).tracking(0.0, start(loop))
    assert frobenius(s.G.identity - s.Q_E).min() > 0.05
