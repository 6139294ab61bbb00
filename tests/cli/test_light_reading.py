"""Reading a result loads few modules of eqt, and none of the simulator."""

import subprocess
import sys

import pytest

from eqt_cli.base.extensions import shipped

MOST = 43
"""Without the manifests of the extensions."""

PROGRAM = """
import sys
from eqt_cli.cli import main
try:
    main()
finally:
    print("modules", *(name for name in sys.modules if name.startswith("eqt_cli")))
"""


@pytest.mark.ci("starts an interpreter")
def test_compare_loads_no_simulator(paper_result):
    arguments = [sys.executable, "-c", PROGRAM, "compare", str(paper_result)]
    done = subprocess.run(arguments, capture_output=True, text=True, check=True)
    _, *loaded = done.stdout.splitlines()[-1].split()
    simulator = ("eqt_cli.components", "eqt_cli.loop", "eqt_cli.engines", "eqt_cli.runs")
    assert not [name for name in loaded if name.startswith((*simulator, "eqt_cli.config"))]
    manifests = [f"eqt_cli.extensions.{extension.name}" for extension in shipped()]
    assert len({*loaded} - {*manifests}) <= MOST
