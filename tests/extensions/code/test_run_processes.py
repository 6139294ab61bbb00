"""Each run has a process of its own: nothing that one run changes is seen by another."""

import os
import random
from pathlib import Path

import numpy as np
import pytest

import eqt_cli
from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.code.python_law import RunEnded, RunProcess

# What is changed is of an imported module: as variables of a compiled one, eqt cannot see it.
SHARED = """
import math
class Law:
    def __init__(self):
        math.calls = getattr(math, "calls", 0)
    def compute(self, velocity):
        math.calls += 1
        return -velocity - 1e-3 * math.calls
"""
OWN = SHARED.replace("math", "self").replace("import self", "")
STARTS_THREAD = "import threading, time\nthreading.Thread(target=time.sleep, args=(9,)).start()\n"


@pytest.fixture
def flown(config):
    def fly(text, runs, workers=1, engine="native"):
        Path("law.py").write_text(text, encoding="utf-8")
        over = {
            "ensemble": {"runs": runs, "seed": 1},
            "time": {"duration": 0.2, "samples": 11},
            "solver": {"engine": engine, "cross_check": 0},
        }
        options = {"as": None, "numbers": None, "object": "per run"}
        data = config(over=over, file="law.py", function="Law().compute", **options)
        return eqt_cli.run(data, force=True, workers=workers)

    return fly


@pytest.mark.ci("starts many processes")
@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
def test_modules_are_of_one_run(flown, engine):
    """With its counter in the object or in a module, at any number of runs and workers."""
    right = flown(OWN, 40, engine=engine)["torque"]
    for runs, workers in ((40, 1), (40, 2), (3, 1)):
        torque = flown(SHARED, runs, workers, engine)["torque"]
        # The steps of solve_ivp are of all runs together.
        atol = 0.0 if engine == "native" else 1e-7
        np.testing.assert_allclose(torque, right[:, :runs], rtol=0, atol=atol)


@pytest.mark.ci("waits for a process")
def test_threads_of_an_import_are_told(flown):
    with pytest.raises(EqtError, match=r"its import starts 1 thread, .* where the object is made"):
        flown(STARTS_THREAD + SHARED, 2)


def test_a_program_can_be_the_process_of_a_run():
    """As `cat`, each of which answers by what it is asked, and ends by itself."""

    def serve(reads, writes):
        os.dup2(reads, 0)
        os.dup2(writes, 1)
        os.execv("/bin/cat", ["cat"])

    runs = list[RunProcess]()
    for _ in range(3):
        closes = [end for run in runs for end in run.ends]
        runs.append(RunProcess(serve, closes, patience=10.0, seconds=1.0))
    assert [run.ask([k, 0.1]) for k, run in enumerate(runs)] == [[0, 0.1], [1, 0.1], [2, 0.1]]
    assert [run.end(waits=5.0) for run in runs] == [0, 0, 0]


def test_how_it_ended_is_told():
    run = RunProcess(lambda *pipes: os._exit(3), [], patience=10.0, seconds=1.0)
    with pytest.raises(RunEnded, match="ended the process with code 3"):
        run.ask({})


def test_runs_draw_the_numbers_that_an_import_seeded():
    """Python seeds its generator anew in a fork."""

    def serve(reads, writes):
        for _ in os.fdopen(reads):
            os.write(writes, f"{random.random()}\n".encode())

    random.seed(4)
    for _ in range(2):
        run = RunProcess(serve, [], patience=10.0, seconds=1.0)
        assert run.ask(0) == random.Random(4).random()
        run.end(waits=5.0)
