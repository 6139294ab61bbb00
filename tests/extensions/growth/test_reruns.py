"""Failed runs, computed again by a solver with other settings."""

import json

import numpy as np
import pytest
from faults_harness import contents
from said import error_of, says
from small_experiment import mapping

from eqt_cli.analysis.intervals import Resampling
from eqt_cli.api import compare, pack, run
from eqt_cli.extensions.sweeps.pooled import answer
from eqt_cli.results.quantity import Plain
from eqt_cli.results.result import open_result

SMALL = {"time": {"duration": 6, "samples": 7}, "name": "x"}
FEW_STEPS = {"engine": "native", "rtol": 1e-9, "max_steps": 100}
MANY_STEPS = FEW_STEPS | {"max_steps": 10_000}
GRID = [{"grid": {"gains.kp": [1, 30]}}]

pytestmark = pytest.mark.ci("compiles laws")


@pytest.fixture
def config():
    return lambda solver, **changes: mapping(
        **{**SMALL, "sweep": GRID, "solver": solver, **changes}
    )


def test_failed_runs_are_those_of_the_other_settings(config, tmp_path):
    out = tmp_path / "out"
    first = run(config(FEW_STEPS), out)
    before = contents(first.path)
    failed = before["status"] != 0
    assert 0 < failed.sum() < failed.size
    done = run(config(MANY_STEPS), out, rerun_failed=True)
    assert (done.failed, done.outcome.resumed) == (0, int((~failed).sum()))
    after = contents(out)
    whole = contents(run(config(MANY_STEPS), tmp_path / "whole").path)
    for name in ("effort", "pose", "steps", "mean_pose_error"):
        np.testing.assert_array_equal(after[name][failed], whole[name][failed])
        np.testing.assert_array_equal(after[name][~failed], before[name][~failed])
    np.testing.assert_array_equal(after["desired_pose"], whole["desired_pose"])
    with open_result(out) as result:
        [noted] = json.loads(result.attributes["solver_of_runs"])
        assert noted["solver"] == {"max_steps": 10_000}
        runs = [(result.labels.index(law), point, k) for law, point, k in noted["runs"]]
        assert sorted(runs) == sorted((law, point, k) for point, law, k in np.argwhere(failed))
    # The experiment is still the first one, and complete.
    assert run(config(FEW_STEPS), out).outcome.was_complete
    with open_result(out) as result:
        *_, of_all_points = answer(result, Resampling(), Plain(), ["effort"], [])
    said = "…failed at first, and were computed with solver.max_steps=10000"
    for words in (compare(out, point=1).between, of_all_points):
        assert any(says(line, said) for line in words)


def test_what_fails_again_stays_as_it_was(config, tmp_path):
    before = contents(run(config(FEW_STEPS), tmp_path / "r").path)
    run(config(FEW_STEPS | {"max_steps": 101}), tmp_path / "r", rerun_failed=True)
    after = contents(tmp_path / "r")
    assert after["message"].tolist() == before["message"].tolist()
    with open_result(tmp_path / "r") as result:
        assert "solver_of_runs" not in result.attributes


def test_more_than_the_solver_is_refused_and_growth_loses_nothing(config, tmp_path):
    out = tmp_path / "out"
    run(config(FEW_STEPS), out)
    message = error_of(run, config(MANY_STEPS, inertia=[1, 1, 1]), out, rerun_failed=True)
    assert "inertia[0]: 2" in message and "failed runs may differ in `solver` only" in message
    run(config(MANY_STEPS), out, rerun_failed=True)
    before = (out / "results.h5").read_bytes()
    grid = [{"grid": {"gains.kp": [1, 2, 30]}}]
    said = "…solver.max_steps=10000; the runs of a result that grows…"
    assert says(error_of(run, config(FEW_STEPS, sweep=grid), out, grow=True), said)
    run(config(FEW_STEPS, sweep=[{"grid": {"gains.kp": [2]}}]), tmp_path / "other")
    assert says(error_of(pack, out, tmp_path / "other", out=tmp_path / "both"), said)
    assert (out / "results.h5").read_bytes() == before
