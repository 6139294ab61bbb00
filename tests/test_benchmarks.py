"""The equations that the benchmarks write out literally are those of the shipped configurations."""

import numpy as np
import pytest

from benchmarks.cases import load
from benchmarks.contenders.plain_loop import body, literal


@pytest.mark.parametrize("t", [0.0, 1.7])
@pytest.mark.parametrize("name", ["paper", "se3"])
def test_literal_equations_are_those_of_the_configuration(name, t):
    """Q̇ and V̇ of every law at a state and a reference state without any symmetry."""
    case = load(name, runs=1)
    random = np.random.default_rng(3)
    for law, loop in case.experiment.loops.items():
        G = loop.group
        Q, Qd = G.exp(random.standard_normal((2, G.dimension)))
        V, Vd = random.standard_normal((2, G.dimension))
        rate = loop.vector_field(t, loop.initial_state(Q, V, Qd, Vd))
        y = literal(case).start(Q, V, Qd, Vd)
        Q_dot, V_dot = literal(case).motion(literal(case).field(np, t, y, law, body(case)))
        q, m = G.pose_length, G.dimension
        # The same sums in another order; their terms are up to some 100.
        np.testing.assert_allclose(G.pack(Q_dot), rate[:q], rtol=0, atol=1e-13)
        momentum_rate = loop.inertia.at(t).momentum(V_dot)
        np.testing.assert_allclose(momentum_rate, rate[q : q + m], rtol=0, atol=1e-12)
