"""Functions that CasADi generated, flown and judged."""

import sys
from pathlib import Path

import numpy as np
import pytest

import eqt_cli
from eqt_cli.base.errors import InputError
from eqt_cli.engines import compiler
from eqt_cli.extensions.code.casadi_code import casadi_call
from eqt_cli.extensions.code.user_code import compiled

HERE = Path(__file__).parent / "casadi"
NAMES = ("pose", "velocity", "desired_pose", "desired_velocity", "desired_acceleration")
INPUTS = dict(zip(("R", "w", "Rd", "wd", "dwd"), ({"signal": name} for name in NAMES), strict=True))
LEE = {"file": "lee.c", "function": "casadi:lee", "numbers": None, "adapter": {"inputs": INPUTS}}


@pytest.fixture(autouse=True)
def _files():
    for name in ("lee.c", "pd.c"):
        Path(name).write_text((HERE / name).read_text())


def test_lee_of_casadi_is_lee(config, judged):
    """Its null tests of pointers count as constant, and no row fails or is undecided."""
    assert judged(config(**LEE)) == {}


@pytest.mark.ci("compiles a file again")
def test_a_file_is_compiled_once(config, monkeypatch):
    """To assembly language, of which the library is made: a generated file takes a minute."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(Path.cwd()))
    commands, run = [], compiler.run

    def noted(command, text="", *limits):
        if "lee_name_in" in text:
            commands.append(command)
        return run(command, text, *limits)

    monkeypatch.setattr(compiler, "run", noted)
    Path("lee.c").write_text(Path("lee.c").read_text() + "int lee_own;")
    eqt_cli.load_experiment(config(**LEE))
    compiles = [x for x in commands if "-E" not in x]
    assert [("-S" in x, x[x.index("-x") + 1]) for x in compiles] == [
        (True, "c"),
        (False, "assembler"),
    ]


@pytest.mark.ci("gcc is fast")
def test_comments_of_clang_are_no_calls(config, monkeypatch):
    """Its assembly language says "# kill: def $eax": see `UserCode.refuse`."""
    pytest.importorskip("ziglang", reason="needs the extra native")
    monkeypatch.setenv("CC", f"{sys.executable} -m ziglang cc")
    compiled.cache_clear()
    code = eqt_cli.load_experiment(config(**LEE)).base.loops["ours"].controller.called.code
    assert "kill" not in compiler.assembly(code.source, compiler.compiler())
    compiled.cache_clear()


@pytest.mark.ci("a run of another one is fast")
def test_it_flies_as_lee(config):
    result = eqt_cli.run(config("lee2010", **LEE))
    np.testing.assert_allclose(*result["pose"], rtol=0, atol=1e-13)


def test_sparse_arguments_and_later_times_by_column(config):
    """−k ω + V_d(0.1) + 10 V_d(0.2); of k, CasADi has the diagonal alone."""
    inputs = {"w": {"signal": "velocity"}, "late": {"signal": "later_velocity"}}
    law = {"file": "pd.c", "function": "casadi:pd", "as": None, "adapter": {"inputs": inputs}}
    law |= {"numbers": {"k": [1, 0, 0, 0, 2, 0, 0, 0, 3]}, "preview": {"steps": 2, "every": 0.1}}
    path = {"kind": "path", "factors": [{"axis": "wz", "by": "t**2"}]}
    result = eqt_cli.run(config(over={"reference": path}, **law))
    velocity, command = result["velocity"][0, 0, 0], result["command"][0, 0, 0]
    expected = -np.array([1, 2, 3]) * velocity + [0, 0, 0.2 + 10 * 0.4]
    np.testing.assert_allclose(command, expected, rtol=0, atol=1e-12)


def test_what_is_said_of_other_names_and_sizes(config, told):
    adapter = {"inputs": {"w": {"signal": "velocity"}, "late": {"signal": "later_velocity"}}}
    law = {"file": "pd.c", "as": None, "adapter": adapter, "preview": {"steps": 2, "every": 0.1}}
    numbers = {"numbers": {"k": [1.0] * 9}}
    assert told(config(**law, **numbers, function="casadi:other")).endswith(
        "pd.c has no other_name_in, which CasADi exports with `other`"
    )
    assert told(config(**law, numbers=None, function="casadi:pd")).endswith(
        "pd in pd.c has an input k; name it in adapter.inputs or in numbers"
    )
    assert told(config(**law, numbers={"k": [1.0]}, function="casadi:pd")).endswith(
        "pd in pd.c has 3×3 numbers in k; expected 1"
    )
    assert told(config(**{**LEE, "adapter": None})).endswith(
        "a function of CasADi needs an adapter that names its inputs, and keeps nothing"
    )
    text, shapes = Path("pd.c").read_text(), (("w", (3,)), ("late", (2, 3)))
    with pytest.raises(InputError, match=r"pd in pd\.c returns 3×1 numbers; expected 6"):
        casadi_call(text, "pd.c", "pd", shapes, {"k": 9}, 6)
