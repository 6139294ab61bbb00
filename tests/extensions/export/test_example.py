"""The example of the guide: a task on a vehicle gives the torques of the stored runs."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from emulated_arm import emulated_arm
from exported_laws import FLAGS, compilers

import eqt_cli
from eqt_cli.api.loading import open_at

EXAMPLE = Path(__file__).parents[3] / "examples" / "vehicle"
GUIDE = Path(__file__).parents[3] / "docs" / "howto" / "fly.md"
SHORT = {"time.duration": 2.0, "time.samples": 101, "ensemble.runs": 1, "solver.cross_check": 0}

ROUNDING = 1e-5
"""N m: rounding of floats, some 1e-6 an instant, which adds up in the integral."""


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A stored run, and the law that flew it, in a folder."""
    folder = tmp_path_factory.mktemp("flight")
    loaded = eqt_cli.load_experiment(EXAMPLE / "flight.yaml", SHORT)
    eqt_cli.run(loaded, folder / "result")
    eqt_cli.export(folder / "result", folder / "law", real="float", reference=True)
    return folder


def flies(flown, command, *start):
    """What the script of the example says of the task, by a compiler."""
    program = flown / "task"
    sources = [str(EXAMPLE / "task.c"), str(flown / "law" / "goodarzi2013.c")]
    made = [*command, *FLAGS, "-O2", f"-I{flown / 'law'}", *sources, "-o", str(program)]
    subprocess.run(made, check=True)
    script = [sys.executable, str(EXAMPLE / "fly.py"), str(flown / "result"), *start, str(program)]
    done = subprocess.run(script, capture_output=True, text=True, check=True)
    assert re.fullmatch(r"100 calls, \d+\.\d\d us each\n", done.stderr)
    said = re.fullmatch(r"largest difference of a torque: (\S+) N m\n", done.stdout)
    assert said
    return float(said[1])


@pytest.mark.ci("a run is stored, a law exported, and a script and a compiler are started")
def test_the_task_gives_the_torques_of_the_stored_run(flown):
    with open_at(flown / "result") as stored:
        assert np.abs(stored["command"]).max() > 0.1
    assert 0 < flies(flown, compilers()[0]) < ROUNDING


@pytest.mark.ci("a script, a compiler and an emulator are started")
def test_the_task_gives_them_on_emulated_arm(flown):
    assert 0 < flies(flown, *emulated_arm()) < ROUNDING


def test_the_guide_shows_the_files_of_the_example():
    guide = GUIDE.read_text(encoding="utf-8")
    assert "{literalinclude} ../../examples/vehicle/flight.yaml" in guide
    (shown,) = re.findall(r"^```\{code-block\} c\n(.*?)^```$", guide, re.MULTILINE | re.DOTALL)
    assert shown in (EXAMPLE / "task.c").read_text(encoding="utf-8")
