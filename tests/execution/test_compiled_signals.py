"""Signals of large works are compiled from the laws; they equal those on arrays to rounding."""

import dataclasses

import numpy as np
import pytest

import eqt_cli
from eqt_cli.engines import Engine
from eqt_cli.execution.batches import batches
from eqt_cli.execution.compute_part import measured, shared_reference

pytest.importorskip("heyoka")

RUNS = 7
"""No multiple of the runs, or samples, that are evaluated as one."""

# Of the largest magnitude of a signal: a hundred operations, each rounded to 1e-16.
ROUNDING = 1e-13


@pytest.fixture(scope="module", params=["paper", "se3_survey", "satellite_panels"])
def solved(request):
    """A batch of one controller, its solution and the reference."""
    sizes = {"solver.engine": "taylor", "ensemble.runs": RUNS, "time.samples": 21}
    study = eqt_cli.load_experiment(f"configs/{request.param}.yaml", sizes).study
    label = list(study.base.loops)[-1]
    (batch,) = batches(study, label, np.arange(RUNS))
    solution = batch.engine.solve(batch.problem, lambda runs: None)
    return batch, solution, shared_reference(study)


def with_code(batch, code):
    return dataclasses.replace(batch, engine=dataclasses.replace(batch.engine, code=code))


def test_compiled_signals_equal_those_on_arrays(solved, monkeypatch):
    batch, solution, reference = solved
    on_arrays, _ = measured(with_code(batch, "compact"), solution, reference)
    monkeypatch.delattr(Engine, "evaluate")  # which evaluates on arrays
    compiled, _ = measured(with_code(batch, "full"), solution, reference)
    assert compiled.keys() == on_arrays.keys()
    for name, expected in on_arrays.items():
        scale = np.abs(expected).max(initial=1.0)
        np.testing.assert_allclose(compiled[name], expected, rtol=0, atol=ROUNDING * scale)


def test_signals_of_a_run_do_not_depend_on_its_neighbours(solved):
    batch, solution, reference = solved
    whole, _ = measured(with_code(batch, "full"), solution, reference)
    alone = dataclasses.replace(batch, problem=batch.problem.select(np.array([4])))
    of_one = dataclasses.replace(solution, states=solution.states[[4]])
    single, _ = measured(with_code(alone, "full"), of_one, reference)
    for name, expected in whole.items():
        np.testing.assert_array_equal(single[name], expected[[4]])
