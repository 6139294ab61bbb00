"""Numbers of runs that are found while they are integrated are those of stored states."""

from pathlib import Path

import numpy as np
import pytest

import eqt_cli
from eqt_cli.engines import compiler, library, native
from eqt_cli.engines.engine import measure
from eqt_cli.extend import TaskContext
from eqt_cli.results.quantity import ValuePer
from eqt_cli.runs.compute_part import compute_part, shared_reference

if missing := compiler.missing():
    pytest.skip(missing, allow_module_level=True)

FEW = {
    "ensemble.runs": native.FEW_RUNS + 1,
    "time.duration": 6.0,
    "time.samples": 31,
    "controllers": ["eqt"],
    "store.trajectories": "none",
    "solver": {"engine": "native", "cross_check": 0},
}

CHANGES = {
    "paper": ("paper", {}),
    "SE3": ("se3", {"settling_threshold": {"rotation": "90 deg", "translation": 1.0}}),
    "failing": ("paper", {"solver.max_steps": 40}),
    "flying": ("paper", {"actuators": [{"kind": "lag", "time_constant": 0.05}]}),
}


MORE = pytest.mark.ci("compiles another loop")


@pytest.fixture(
    scope="module",
    params=[name if name == "paper" else pytest.param(name, marks=MORE) for name in CHANGES],
)
def changed(request):
    """A configuration without trajectories."""
    name, changes = CHANGES[request.param]
    return Path(__file__).parents[2] / "configs" / f"{name}.yaml", FEW | changes


def part_of(path, changes, threads=1):
    """What is kept of all runs."""
    study = eqt_cli.load_experiment(path, changes)
    context = TaskContext(lambda runs: None, threads)
    return compute_part(study, study.plan.part(0), shared_reference(study), context)


@pytest.fixture(scope="module")
def expected(changed):
    """With trajectories, from their signals."""
    path, changes = changed
    return part_of(path, changes | {"store.trajectories": "all"})


def assert_same(found, expected):
    numbers = {entry.name for entry in found.quantities if entry.per is ValuePer.RUN}
    assert {"effort", "status", "message", "steps"} < numbers
    for name in numbers:
        np.testing.assert_array_equal(found.data[name], expected.data[name], err_msg=name)


@pytest.mark.parametrize("threads", [1, 2])
def test_numbers_are_those_of_trajectories(changed, expected, threads, monkeypatch):
    monkeypatch.setattr("eqt_cli.engines.engine.evaluate", None)  # of stored states
    assert_same(part_of(*changed, threads), expected)
    assert expected.data["status"].any() == ("solver.max_steps" in changed[1])


def test_numbers_of_few_runs_are_those_of_many(changed, expected, monkeypatch):
    path, changes = changed
    monkeypatch.setattr(native, "running", None)  # which measures on the way
    few = part_of(path, changes | {"ensemble.runs": 3})
    for name in ("error_estimate", "effort", "unstable_distance", "status"):
        np.testing.assert_array_equal(few.data[name], expected.data[name][:3], err_msg=name)


@pytest.mark.parametrize("runs", [3, native.FEW_RUNS + 2])
def test_only_runs_to_check_keep_their_signals(runs, monkeypatch):
    path, kept = Path(__file__).parents[2] / "configs" / "paper.yaml", []

    def noted(engine, *given):
        solution = measure(engine, *given)
        kept.append((len(solution.status), len(solution.arrays), solution.states.shape[1] > 2))
        return solution

    monkeypatch.setattr("eqt_cli.runs.compute_part.measure", noted)
    part = part_of(path, FEW | {"ensemble.runs": runs, "solver.cross_check": 1})
    (checked, signals, states), second, (others, motion, none), _ = kept
    assert (checked, signals > 10, states, second[1]) == (1, True, True, 0)
    assert (others, motion, none) == (runs - 1, 1, False)
    assert np.isfinite(part.data["effort"]).all()
    assert np.isfinite(part.check_states).all()


@pytest.mark.ci("compiles the loop anew")
@pytest.mark.parametrize("lanes", [1, 4])
def test_lanes_change_no_bit(changed, expected, lanes, monkeypatch):
    monkeypatch.setattr(compiler.Compiler, "lanes", lanes)
    for name in ("_integrator", "_evaluate"):
        monkeypatch.setattr(library, name, getattr(library, name).__wrapped__)
    assert_same(part_of(*changed), expected)


@pytest.mark.parametrize(
    "change",
    [{"early_window": 3.33}, {"control": {"period": 0.5}}],
    ids=["a window that ends between samples", "a law that waits for instants"],
)
def test_what_is_measured_of_stored_states(change):
    path = Path(__file__).parents[2] / "configs" / "paper.yaml"
    expected = part_of(path, FEW | change | {"store.trajectories": "all"})
    assert_same(part_of(path, FEW | change), expected)


def test_what_cannot_be_compiled_is_measured_of_stored_states(monkeypatch):
    path = Path(__file__).parents[2] / "configs" / "paper.yaml"
    expected = part_of(path, FEW)
    monkeypatch.setattr(eqt_cli.engines.native, "running", lambda *given: None)
    assert_same(part_of(path, FEW), expected)


@pytest.mark.ci("compiles several laws anew")
def test_laws_that_differ_in_numbers_are_compiled_once(monkeypatch, tmp_path, told):
    """Gains with other principal axes have other critical points, whose code is compiled anew."""
    compiled, compile_ = [], compiler._compiled
    monkeypatch.setattr(compiler, "user_cache", lambda: None)
    monkeypatch.setattr(compiler, "_compiled", lambda *of: compiled.append(0) or compile_(*of))
    few = FEW | {"time.duration": 1.0, "time.samples": 3}
    laws = [
        {"kind": "eqt", "gains": {"kp": [1.0, 2.0, 3.0]}},
        {"kind": "eqt", "label": "b", "gains": {"kp": [1.0, 2.5, 3.5], "kd": 1.0}},
    ]
    compiler._library.cache_clear()
    library._integrator.cache_clear()
    library._evaluate.cache_clear()
    study = eqt_cli.load_experiment("configs/paper.yaml", few | {"controllers": laws})
    shared = shared_reference(study)
    counts = []
    for number in range(len(study.plan)):
        compute_part(study, study.plan.part(number), shared, TaskContext(lambda runs: None))
        counts.append(len(compiled))
    assert counts[0] > 0
    assert set(counts) == {counts[0]}
    # What is compiled is named by its law.
    activities = {"the laws", "law 1 of 2 (eqt)", "the reference"}
    assert set(told.activities) <= {f"compiling {what}" for what in activities}


@pytest.mark.parametrize("most", [20_000, 0])
def test_few_runs_are_compiled_quickly_and_many_well(most, monkeypatch, tmp_path):
    """What integrates them; starts and the reference are always compiled quickly."""
    quickly, compile_ = {"eqt_advance": set(), "eqt_evaluate": set()}, compiler.library

    def asked(text, *, quick):
        quickly["eqt_advance" if "eqt_advance" in text else "eqt_evaluate"].add(quick)
        return compile_(text, quick=quick)

    library._integrator.cache_clear()
    library._evaluate.cache_clear()
    monkeypatch.setattr(compiler, "library", asked)
    monkeypatch.setattr("eqt_cli.runs.compute_part.BRIEF", most)
    study = eqt_cli.load_experiment("configs/paper.yaml", FEW | {"time.duration": 1.0})
    eqt_cli.run(study, tmp_path / "out")
    assert quickly == {"eqt_advance": {True, most > 0}, "eqt_evaluate": {True, most > 0}}
