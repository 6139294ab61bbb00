"""The equations that the benchmarks write out literally are those of the shipped configurations."""

import numpy as np
import pytest

from benchmarks.cases import load
from benchmarks.contenders.plain_loop import body, literal


@pytest.mark.parametrize("name", ["paper", "se3"])
def test_literal_equations_are_those_of_the_configuration(name):
    case = load(name, runs=3)
    q = case.experiment.group.pose_length
    for law, problem in zip(case.experiment.loops, case.problems, strict=True):
        loop, start = problem.loop, problem.states + 0.1  # where no term is 0
        for t in (0.0, 1.7):
            s = loop.tracking(t, start)
            rate = loop.vector_field(t, start)
            for run in range(3):
                y = literal(case).start(s.Q[run], s.V[run], s.Qd[run], s.Vd[run])
                dQ, dV = literal(case).motion(literal(case).field(np, t, y, law, body(case)))
                packed = loop.group.pack(dQ)
                # The paper's and eqt's order of the same sums: some rounding of terms up to 30.
                np.testing.assert_allclose(packed, rate[run, :q], rtol=0, atol=1e-12)
                momentum = rate[run, q : q + loop.group.dimension]
                np.testing.assert_allclose(
                    loop.inertia.at(t).momentum(dV), momentum, rtol=0, atol=1e-11
                )
