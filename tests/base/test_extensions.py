"""eqt without its extensions: nothing outside imports them."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import eqt_cli

SESSION = """
from eqt_cli.base.extensions import function_for, shipped
from eqt_cli.base.registry import registry
from eqt_cli.cli.app import COMMANDS
GONE = {"fit", "log", "export", "report", "verify", "margins", "tune", "worst"}
print(shipped(), GONE & COMMANDS.keys())
print({"code", "replay"} & {*registry("controllers").names()}, registry("controllers").get("eqt"))
from eqt_cli import api
print({"fit", "verify", "tune"} & {*api.__all__}, "compare" in api.__all__)
from eqt_cli import extend
print("Certificate" in extend.__all__, "Claim" in extend.__all__)
from eqt_cli.base import purposes
function_for(purposes.compare_measured)
"""

FILES = """
from pathlib import Path
from eqt_cli.api import load_experiment
Path("starts.csv").write_text("qx,qy,qz,qw\\n0,0,0,1\\n1,0,0,0\\n")
Path("plan.csv").write_text("t,qx,qy,qz,qw\\n0,0,0,0,1\\n20,0,0,0,1\\n")
keys = {"name": "bare", "group": "SO3", "inertia": 1.0, "gains": {"kp": 1.0, "kd": 1.0}}
keys |= {"controllers": ["eqt"], "time": {"duration": 1.0}, "initial": {"file": "starts.csv"}}
keys |= {"reference": {"kind": "waypoints", "file": "plan.csv"}}
print(load_experiment(keys).trajectories)
Path("starts.csv").write_text("yaw (deg),pitch,roll\\n0,0,0\\n")
load_experiment(keys)
"""


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """Run a text with eqt without its extensions."""
    package, folder = Path(eqt_cli.__file__).parent, tmp_path_factory.mktemp("bare")
    shutil.copytree(package, folder / "eqt_cli", ignore=shutil.ignore_patterns("extensions"))

    def run(text):
        return subprocess.run(
            [sys.executable, "-c", text], cwd=folder, capture_output=True, text=True, check=False
        )

    return run


def test_eqt_works_without_them(session):
    done = session(SESSION)
    assert done.stdout.splitlines() == [
        "() set()",
        "set() <class 'eqt_cli.components.laws.EqT'>",
        "set() True",
        "False True",
    ]
    assert done.stderr.endswith(
        "compare --measured: its extension is not installed; install eqt again\n"
    )


@pytest.mark.ci("starts an interpreter, as another one does fast")
def test_plain_files_are_read_without_them(session):
    done = session(FILES)
    assert done.stdout == "2\n", done.stderr
    assert done.stderr.endswith("initial.file: its extension is not installed; install eqt again\n")


@pytest.mark.ci("starts an interpreter")
@pytest.mark.needs("search")
def test_a_module_of_an_extension_may_be_imported_first():
    first = "import eqt_cli.extensions.search.api as api; print(api.tune.__name__)"
    done = subprocess.run([sys.executable, "-c", first], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "tune\n"), done.stderr
