"""Lemma 6.1: the error system, integrated by itself, gives the error of the closed loop."""

import numpy as np
import pytest

from eqt_cli.closed_loop import ClosedLoop, ErrorSystem
from eqt_cli.controllers.eqt import EqT
from eqt_cli.core.arrays import frobenius
from eqt_cli.core.expressions import parse
from eqt_cli.engines import Problem, engines
from eqt_cli.groups import group_named
from eqt_cli.mechanics.inertia import Inertia, PrescribedInertia
from eqt_cli.mechanics.semidirect import Semidirect
from eqt_cli.mechanics.tracking import Gains
from eqt_cli.references.torque import TorqueReference

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


def test_lemma_6_1_on_every_group(law_on_group):
    loop = closed_loop(*law_on_group)
    assert_same(*both(loop, engines.get("solve_ivp")(rtol=RTOL, atol=1e-11)))


def test_lemma_6_1_with_an_inertia_that_varies(G):
    rows = [["0"] * G.dimension for _ in range(G.dimension)]
    for k in range(G.dimension):
        rows[k][k] = f"{k + 1} + sin(t)/{k + 2}"
    law = PrescribedInertia(tuple(tuple(parse(text) for text in row) for row in rows))
    loop = closed_loop(G, inertia=law)
    assert_same(*both(loop, engines.get("solve_ivp")(rtol=RTOL, atol=1e-11)))


@pytest.mark.parametrize("name", ["SO3", "SE3*SO2"])
def test_lemma_6_1_with_the_taylor_engine(name):
    pytest.importorskip("heyoka")
    assert_same(*both(closed_loop(group_named(name)), engines.get("taylor")(rtol=RTOL)))


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
