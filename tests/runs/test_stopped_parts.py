"""What a part that is stopped has finished is kept, and computed no second time."""

from contextvars import copy_context
from dataclasses import dataclass

import numpy as np
import pytest
from faults_harness import assert_equal, contents
from small_experiment import configuration, study_of

from eqt_cli.engines import native
from eqt_cli.engines.engine import STOP, Stopped
from eqt_cli.extend import Executor, Serial, TaskContext
from eqt_cli.runs.part_files import unfinished
from eqt_cli.runs.run_study import execute

CONFIG = configuration(
    inertia="[1, 2, 3]",
    initial="{pose: {kind: haar}, velocity: {kind: normal}}",
    ensemble="{runs: 7, seed: 1}",
    time="{duration: 0.2, samples: 3}",
    solver="{engine: native, cross_check: 2}",
    store="{trajectories: 5}",
)
SAMPLED = "control: {period: 0.05}\nsensors: {pose: [{kind: noise, std: 0.01}]}\n"


@dataclass(frozen=True)
class StopsAfter(Executor):
    """Stops a part once so many of its runs are finished."""

    runs: int = 0

    def outcomes(self, task, items):
        stop, context, finished = np.zeros(1, np.int64), copy_context(), []

        def progress(runs):
            finished.append(runs)
            stop[0] = sum(finished) >= self.runs

        context.run(STOP.set, stop)
        yield context.run(task, items[0], TaskContext(progress))


@pytest.mark.parametrize("more", ["", SAMPLED])
def test_finished_runs_of_a_stopped_part_are_kept(tmp_path, monkeypatch, more):
    study = study_of(tmp_path, CONFIG + more)
    execute(study, tmp_path / "whole", executor=Serial())
    monkeypatch.setattr(native, "BLOCK_BYTES", 1)  # a block per run
    out = tmp_path / "out"
    for kept in (2, 5):
        with pytest.raises(Stopped):
            execute(study, out, executor=StopsAfter(runs=kept))
        assert (out / f"parts/000000.r{kept}.npy").exists()
        assert unfinished(out).done == kept
    assert execute(study, out).resumed == 5
    assert_equal(out, contents(tmp_path / "whole"))


def test_a_damaged_file_of_a_stopped_part_is_computed_again(tmp_path, monkeypatch):
    study, out = study_of(tmp_path, CONFIG), tmp_path / "out"
    execute(study, tmp_path / "whole", executor=Serial())
    monkeypatch.setattr(native, "BLOCK_BYTES", 1)
    with pytest.raises(Stopped):
        execute(study, out, executor=StopsAfter(runs=3))
    (out / "parts/000000.r3.npy").write_bytes(b"not HDF5")
    execute(study, out)
    assert_equal(out, contents(tmp_path / "whole"))
