"""C files as users write them, and configurations that name them."""

from pathlib import Path

import numpy as np
import pytest

import eqt_cli
from eqt_cli.engines import compiler
from eqt_cli.extend import EqtError
from eqt_cli.extensions.code.code_rows import code_rows
from eqt_cli.extensions.export.export import header, source
from eqt_cli.extensions.export.export_laws import exported
from eqt_cli.extensions.export.program_error import DOUBLE

HERE = Path(__file__).parent
LEE, HEADER = ((HERE / name).read_text(encoding="utf-8") for name in ("lee2010.c", "lee.h"))
TORQUE = "void lee_torque(const lee_numbers *n, lee_memory *m, const lee_input *in, real *torque)\n"

EXPERIMENT = {
    "group": "SO3",
    "inertia": [1.0, 2.0, 3.0],
    "gains": {"kp": 1.0, "kd": 0.5},
    "reference": {"kind": "torque", "torque": ["0.3*cos(t)", "0.2*sin(t)", 0.1]},
    "control": {"period": 0.02},
    "ensemble": {"runs": 2, "seed": 1},
    "initial": {"pose": "haar", "velocity": {"kind": "normal", "std": 0.3}},
    "time": {"duration": 0.4, "samples": 5},
    "solver": {"engine": "solve_ivp", "cross_check": 0},
}
NUMBERS = {"kR": 2.0, "kW": 0.5, "J": [1.0, 2.0, 3.0]}


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path, monkeypatch):
    if compiler.missing():
        pytest.skip("needs a C compiler")
    monkeypatch.chdir(tmp_path)
    # All states of a fault are worse than the bound, and 400 bounds take half of the time.
    monkeypatch.setattr("eqt_cli.extensions.code.code_rows.MOST_BOUNDED", 20)


@pytest.fixture
def written():
    """Writes a C file and its header, with parts of both replaced."""

    def write(*changes, body=None, real="double", name="lee.c", more=""):
        text = LEE if body is None else f'#include "lee.h"\n{more}\n{TORQUE}{{\n{body}\n}}\n'
        header = HEADER.replace("typedef double", f"typedef {real}")
        for old, new in changes:
            assert old in text + header, old
            text, header = text.replace(old, new), header.replace(old, new)
        Path(name).write_text(text, encoding="utf-8")
        Path("lee.h").write_text(header, encoding="utf-8")

    return write


@pytest.fixture
def config():
    """An experiment with one law in code."""

    def make(*others, over=(), **options):
        entry = {"kind": "code", "file": "lee.c", "as": "lee2010", "numbers": NUMBERS}
        entry |= {"label": "ours", **options}
        entry = {key: value for key, value in entry.items() if value is not None}
        return EXPERIMENT | dict(over) | {"name": "code", "controllers": [*others, entry]}

    return make


@pytest.fixture
def told():
    """The error that a configuration makes."""

    def tell(configuration):
        with pytest.raises(EqtError) as caught:
            eqt_cli.load_experiment(configuration)
        return str(caught.value)

    return tell


@pytest.fixture
def judged():
    """Rows of a law in code that do not hold: name and remark."""

    def judge(configuration):
        loop = eqt_cli.load_experiment(configuration).base.loops["ours"]
        rows = code_rows("ours", loop, 5.0, np.random.default_rng(0), None)
        return {row.name: row.remark for row in rows if row.verdict != "holds"}

    return judge


# Exported laws -----------------------------------------------------------------------------------

SKEW = {"kp": 1.0, "kd": [[0.5, 0.1, 0.0], [-0.1, 0.6, 0.0], [0.0, 0.0, 0.7]]}
"""A Rayleigh tensor that is not symmetric, so that a transposed one is told."""

KINDS = {
    "lee2010": "lee2010",
    "eqt": "eqt",
    "goodarzi2013": {"kind": "goodarzi2013", "bound": 0.3},
    "spatial": {"kind": "family", "quadratic": 1.0, "label": "spatial"},
}


@pytest.fixture(scope="session")
def exports(tmp_path_factory):
    """What `eqt export` writes of some laws, by name: header and source."""
    data = EXPERIMENT | {"gains": SKEW, "name": "export", "controllers": list(KINDS.values())}
    experiment = eqt_cli.load_experiment(data).base
    laws = exported(experiment, [], DOUBLE)
    return {law.name: (header(law), source(law)) for law in laws}


@pytest.fixture
def faulty(exports, config):
    """An exported law with a fault, as a law in code: what is replaced in its source."""

    def make(name, *changes, claims=None, over=()):
        text, body = exports[name]
        for old, new in changes:
            assert old in body, old
            body = body.replace(old, new)
        Path(f"{name}.h").write_text(text, encoding="utf-8")
        Path(f"{name}.c").write_text(body, encoding="utf-8")
        memory = ["integral"] if "integral" in text else []
        law = {"file": f"{name}.c", "as": claims or KINDS[name], "numbers": {}, "memory": memory}
        return config(*over, **law) | {"gains": SKEW}

    return make
