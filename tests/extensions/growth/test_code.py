"""Results grow only by the code that computed them."""

import os
import sys
from modulefinder import ModuleFinder
from pathlib import Path

import pytest
from said import says

import eqt_cli
from eqt_cli.base import code_files, registry
from eqt_cli.base.errors import EqtError

LAW = """\
import os
from pathlib import Path
from dataclasses import dataclass
from typing import ClassVar
from eqt_cli.extend import Controller
import helper_of_a_law
from package_of_a_law import GAIN
DATA = float((Path(__file__).parent / "gain.txt").read_text())

@dataclass(frozen=True)
class Own(Controller):
    name: ClassVar[str] = "own"

    def torque(self, s):
        from late_of_a_law import GAIN as LATE
        late = LATE * float((Path(__file__).parent / "late.txt").read_text())
        of_system = float(os.environ.get("GAIN_OF_A_LAW", "1"))
        return -s.V - late * of_system * DATA * helper_of_a_law.GAIN * GAIN * s.relative.gradient
"""
CONFIG = {
    "group": "SO3",
    "inertia": [1, 2, 3],
    "gains": {"kp": 1.0, "kd": 0.5},
    "plugins": ["law.py"],
    "reference": {"kind": "constant"},
    "controllers": ["own"],
    "initial": {"pose": "haar"},
    "time": {"duration": 0.2, "samples": 3},
    "solver": {"engine": "solve_ivp", "block": 1},
}
FILES = {
    "law.py": LAW,
    "helper_of_a_law.py": "GAIN = 1.0\n",
    "package_of_a_law/__init__.py": "from .inner import GAIN\n",
    "package_of_a_law/inner.py": "GAIN = 1.0\n",
    "gain.txt": "1.0",
    "late_of_a_law.py": "GAIN = 1.0\n",
    "late.txt": "1.0",
}


@pytest.fixture
def computed(tmp_path, monkeypatch):
    """Runs the law as a new process does; with files that it needs."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    for name, text in FILES.items():
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text(text, encoding="utf-8")

    def compute(runs, **more):
        for name in [name for name in sys.modules if "_of_a_law" in name]:
            del sys.modules[name]
        for names in (registry._loaded_plugins, registry._code, code_files._hashes):
            names.clear()
        return eqt_cli.run(CONFIG | {"ensemble": {"runs": runs}, "name": "x"}, out="r", **more)

    yield compute
    for name in [
        name for name in sys.modules if name.endswith("_of_a_law") or "_of_a_law." in name
    ]:
        del sys.modules[name]


@pytest.mark.ci("two runs of a law for each file")
@pytest.mark.parametrize("name", [name for name in FILES if name != "law.py"])
def test_a_changed_file_is_named(computed, name):
    computed(1)
    text = Path(name).read_text(encoding="utf-8")
    Path(name).write_text(text.replace("1.0", "9.0") + "\n", encoding="utf-8")
    with pytest.raises(EqtError) as caught:
        computed(2, grow=True)
    module = name.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    assert f"  {module}: " in str(caught.value)


def test_a_kept_run_that_is_computed_again_and_differs_stops_the_command(computed, monkeypatch):
    computed(2)
    before = Path("r/results.h5").read_bytes()
    monkeypatch.setitem(os.environ, "GAIN_OF_A_LAW", "9")
    with pytest.raises(EqtError) as caught:
        computed(3, grow=True)
    assert says(str(caught.value), "r/results.h5: run …of own at point 0 was computed again, …")
    assert Path("r/results.h5").read_bytes() == before


def test_modules_are_those_that_the_standard_library_finds(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    texts = {
        "__init__.py": "from . import one\n",
        "one.py": "from .inner.two import (\n    X,\n)\nimport numpy\n",
        "inner/__init__.py": "",
        "inner/two.py": "def f():\n    import p_of_modules.never\n\nfrom ..three import Y as X\n",
        "three.py": "if True:\n    from p_of_modules import four\nY = 1\n",
        "four.py": "import json\n",
        "never.py": "",
    }
    for name, text in texts.items():
        (tmp_path / "p_of_modules" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "p_of_modules" / name).write_text(text, encoding="utf-8")
    __import__("p_of_modules.one")
    finder = ModuleFinder([str(tmp_path)])
    finder.import_hook("p_of_modules.one")
    expected = {name for name in finder.modules if name.startswith("p_of_modules")}
    assert {*code_files.modules_of("p_of_modules.one")} == expected - {"p_of_modules.never"}
    __import__("p_of_modules.never")
    assert {*code_files.modules_of("p_of_modules.one", in_functions=True)} == expected
