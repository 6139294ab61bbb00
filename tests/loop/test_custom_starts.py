"""Runs that begin at times of their own move as the closed loop does at these times."""

import dataclasses

import numpy as np
import pytest

from eqt_cli.config.shipped import folder, names
from eqt_cli.config.source import read_config
from eqt_cli.config.study import study
from eqt_cli.loop.closed_loop import STARTS, OwnStarts
from eqt_cli.runs.batches import batches

LATER = np.array([0.0, 0.7, 1.9])


ALIKE = pytest.mark.ci("the loops of such a file differ from another's in their numbers only")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=ALIKE if name.startswith(("sweep", "tune")) else ())
        for name in names()
    ],
)
def test_each_run_is_at_its_own_time(name):
    found = study(read_config(folder() / f"{name}.yaml"))
    for label in found.base.loops:
        for batch in batches(found, label, np.arange(len(LATER))):
            problem = batch.problem
            if problem.loop.vehicle.control is not None or problem.runs < len(LATER):
                continue
            varying = problem.varying | {STARTS: LATER[:, None]}
            own = dataclasses.replace(problem, loop=OwnStarts.of(problem.loop), varying=varying)
            rates = own.batched_loop().vector_field(0.3, problem.states)
            for run, later in enumerate(LATER):
                one = problem.select(slice(run, run + 1))
                expected = one.batched_loop().vector_field(0.3 + later, one.states)
                # Sums of another length are rounded in another way.
                np.testing.assert_allclose(rates[run], expected[0], rtol=1e-12, atol=1e-13)
