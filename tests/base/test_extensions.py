"""eqt without its extensions: nothing outside imports them."""

import shutil
import subprocess
import sys
from pathlib import Path

import eqt_cli

SESSION = """
from eqt_cli.base.extensions import function_for, shipped
from eqt_cli.base.registry import registry
from eqt_cli.cli.app import COMMANDS
print(shipped(), {"fit", "log", "export", "report", "verify", "margins"} & COMMANDS.keys())
print({"code", "replay"} & {*registry("controllers").names()}, registry("controllers").get("eqt"))
from eqt_cli import api
print({"fit", "verify"} & {*api.__all__}, "compare" in api.__all__)
from eqt_cli import extend
print("Certificate" in extend.__all__, "Claim" in extend.__all__)
function_for("compare --measured")
"""


def test_eqt_works_without_them(tmp_path):
    package = Path(eqt_cli.__file__).parent
    names = [path.name for path in (package / "extensions").iterdir() if path.is_dir()]
    skipped = shutil.ignore_patterns(*names)
    shutil.copytree(package, tmp_path / "eqt_cli", ignore=skipped)
    done = subprocess.run(
        [sys.executable, "-c", SESSION], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.stdout.splitlines() == [
        "() set()",
        "set() <class 'eqt_cli.components.laws.EqT'>",
        "set() True",
        "False True",
    ]
    assert done.stderr.endswith(
        "compare --measured: its extension is not installed; install eqt again\n"
    )
