"""Signals of large works are compiled from the laws; they equal those on arrays to rounding."""

import dataclasses

import numpy as np
import pytest

import eqt_cli
from eqt_cli.closed_loop.signals import SIGNALS
from eqt_cli.engines import Engine, taylor
from eqt_cli.engines.taylor import evaluation
from eqt_cli.execution.batches import batches
from eqt_cli.execution.compute_part import compute_part, measured, shared_reference
from eqt_cli.execution.executors import TaskContext
from eqt_cli.results.quantity_table import MEASURED

pytest.importorskip("heyoka")

RUNS = 7
"""No multiple of the runs, or samples, that are evaluated as one."""

# Of the largest magnitude of a signal: a hundred operations, each rounded to 1e-16.
ROUNDING = 1e-13


ALL = tuple(each.name for each in (*SIGNALS, *MEASURED))


COMPILED = pytest.mark.slow("compiles all signals of a large loop, as full code too")


@pytest.fixture(
    scope="module",
    params=[
        "paper",
        *(
            pytest.param(name, marks=COMPILED)
            for name in ("se3_survey", "satellite_panels", "body_and_slider")
        ),
    ],
)
def solved(request):
    """A batch of one controller, its solution and the reference."""
    sizes = {"solver.engine": "taylor", "ensemble.runs": RUNS, "time.samples": 21}
    study = eqt_cli.load_experiment(f"configs/{request.param}.yaml", sizes).study
    label = list(study.base.loops)[-1]
    (batch,) = batches(study, label, np.arange(RUNS))
    solution = batch.engine.solve(batch.problem)
    return batch, solution, shared_reference(study)


def with_code(batch, code):
    return dataclasses.replace(batch, engine=dataclasses.replace(batch.engine, code=code))


def test_compiled_signals_equal_those_on_arrays(solved, monkeypatch):
    batch, *given = *solved, ALL
    on_arrays = measured(with_code(batch, "compact"), *given)
    monkeypatch.delattr(Engine, "evaluate")  # which evaluates on arrays
    compiled = measured(with_code(batch, "full"), *given)
    assert compiled.keys() == on_arrays.keys()
    for name, values in on_arrays.items():
        scale = np.abs(values).max(initial=1.0, where=np.isfinite(values))
        np.testing.assert_allclose(compiled[name], values, rtol=0, atol=ROUNDING * scale)


def test_signals_of_a_run_do_not_depend_on_its_neighbours(solved):
    batch, solution, reference = solved
    whole = measured(with_code(batch, "full"), solution, reference, ALL)
    alone = with_code(batch, "full").select(np.array([4]))
    single = measured(
        alone, dataclasses.replace(solution, states=solution.states[[4]]), reference, ALL
    )
    for name, values in whole.items():
        np.testing.assert_array_equal(single[name], values[[4]])


def test_signals_do_not_depend_on_how_many_samples_are_evaluated_together(solved, monkeypatch):
    batch, solution, reference = solved
    whole = measured(with_code(batch, "full"), solution, reference, ALL)
    monkeypatch.setattr(evaluation, "AT_ONCE", 64)  # of 147
    parts = measured(with_code(batch, "full"), solution, reference, ALL)
    for name, expected in whole.items():
        np.testing.assert_array_equal(parts[name], expected)


@pytest.mark.slow("compiles full code of signals")
def test_a_part_does_not_depend_on_its_blocks(monkeypatch):
    sizes = {"solver.engine": "taylor", "solver.code": "full", "ensemble.runs": 11}
    few = {"time.samples": 21, "store.trajectories": 5}
    study = eqt_cli.load_experiment("configs/paper.yaml", sizes | few).study
    part, reference = study.plan.part(0), shared_reference(study)
    whole = compute_part(study, part, reference, TaskContext())
    monkeypatch.setattr(taylor, "BLOCK_BYTES", 1)  # which as many runs fill as there are lanes
    cut = compute_part(study, part, reference, TaskContext(threads=2))
    assert cut.variables.keys() == whole.variables.keys()
    for name, expected in whole.variables.items():
        np.testing.assert_array_equal(cut.variables[name].data, expected.data)
