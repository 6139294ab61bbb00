"""`eqt export`: what it writes and says, and what it refuses."""

import ctypes
import json
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from case_tables import from_yaml, in_ci
from exported_laws import FLAGS, checked, compilers, library, made, written
from said import mentions, says

import eqt_cli
from eqt_cli.extend import EqtError
from eqt_cli.extensions.export.export_laws import exported
from eqt_cli.extensions.export.program_error import DOUBLE, FLOAT

CONFIG = """\
name: flight
group: SO3
inertia: [1, 2, 2.5]
gains: {kp: 1, kd: 0.5}
reference: {kind: rates, rates: ["0.1", "0", "0.2*cos(t)"]}
controllers: [lee2010, {kind: eqt, label: "ours, kp=1"}]
initial: {pose: haar, velocity: normal}
ensemble: {runs: 2, seed: 1}
time: {duration: 0.5, samples: 3}
solver: {engine: solve_ivp, cross_check: 0}
"""


@pytest.fixture
def config(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "flight.yaml"
    path.write_text(CONFIG, encoding="utf-8")
    return path


def test_it_writes_the_files_of_every_law_and_says_what_is_known(config, invoke):
    done = invoke("export", "flight.yaml")
    folder = config.parent / "exported" / "flight"
    assert sorted(path.name for path in folder.iterdir()) == [
        "README.md",
        *("lee2010.c", "lee2010.h", "lee2010_check.c"),
        *("ours_kp_1.c", "ours_kp_1.h", "ours_kp_1_check.c"),
    ]
    assert re.search(r"lee2010 +lee2010\.c +285 +\S+e-1[3-6] +0\n", done.stdout)
    assert done.stdout.endswith(f"exported  {Path('exported', 'flight')}\n")
    page = (folder / "README.md").read_text(encoding="utf-8")
    assert '\nIn C, "ours, kp=1" is `ours_kp_1`.\n' in page
    assert "| `velocity` | 3 | rad/s: V, the body velocity as it was measured |" in page
    assert "- **Order of coordinates.** ωx, ωy, ωz." in page
    assert "\n| law | operations |\n|---|---|\n| `lee2010` | 285 |\n" in page
    assert re.search(r"\*\*Lee 2010\*\*: L = .* Identities: \d+ hold, 0 fail\.", page)


def test_without_the_extension_for_proofs_nothing_is_said_of_identities(config, monkeypatch):
    monkeypatch.setattr("eqt_cli.extensions.export.export.functions_for", lambda purpose: ())
    eqt_cli.export("flight.yaml", out="out", controllers=["lee2010"])
    page = Path("out", "README.md").read_text(encoding="utf-8")
    assert re.search(r"\*\*Lee 2010\*\*: L = .*\(\S.*\)\.\n", page) and "Identities" not in page


@pytest.mark.parametrize("command", ["export", "run", "verify", "margins"])
def test_every_command_that_computes_loops_makes_the_remarks(config, invoke, command):
    degrees = invoke(command, "flight.yaml", "--set", "settling_threshold=30.0")
    assert "settling_threshold: no rotation is further than 2.83 from another" in degrees.stderr


def test_a_label_changes_nothing_but_names(config, invoke):
    label = "$functions */ <b>`|_[c](d)"
    text = CONFIG.replace('lee2010, {kind: eqt, label: "ours, kp=1"}', "LAW")
    law = json.dumps({"kind": "eqt", "label": label})
    config.write_text(text.replace("LAW", law), encoding="utf-8")
    invoke("export", "flight.yaml", "--out", "out")
    assert {path.stem for path in Path("out").glob("*.h")} == {"functions_b_c_d"}
    for command in compilers()[:1]:
        made = ["-c", "out/functions_b_c_d.c", "-o", "law.o"]
        subprocess.run([*command, *FLAGS, *made], check=True)
    page = Path("out", "README.md").read_text(encoding="utf-8")
    escaped = r"\$functions \*/ \<b\>\`\|\_\[c\](d)"
    assert f"- **{escaped}** (`functions_b_c_d.h`, `functions_b_c_d.c`)" in page
    assert f'"{escaped}" is `functions_b_c_d`' in page


def test_json_has_a_record_for_each_law(config, invoke):
    done = invoke("export", "flight.yaml", "--controller", "lee2010", "--real", "float", "--json")
    found = json.loads(done.stdout)
    assert found["files"] == ["lee2010.h", "lee2010.c", "lee2010_check.c", "README.md"]
    [law] = found["laws"]
    assert {law["label"], law["name"], law["real"]} == {"lee2010", "float"}
    assert law["operations"] == 285
    assert len(law["bound"]) == 3 and 0 < max(law["bound"]) < 1e-3


@pytest.mark.ci("compiles several exports")
def test_it_replaces_its_own_files_and_no_others(config, invoke):
    command = ["export", "flight.yaml", "--out", "out", "--controller", "lee2010"]
    invoke(*command)
    invoke(*command)
    mine = config.parent / "out" / "lee2010.h"
    mine.write_text("/* my own */\n")
    before = (config.parent / "out" / "lee2010.c").stat().st_mtime_ns
    done = invoke(*command, code=2)
    assert says(
        done.stderr, f"eqt: error: {Path('out', 'lee2010.h')}: exists, but eqt did not write it…\n"
    )
    assert mine.read_text() == "/* my own */\n"
    assert (config.parent / "out" / "lee2010.c").stat().st_mtime_ns == before


@from_yaml
def test_what_it_refuses(config, invoke, words, said):
    assert says(invoke("export", "flight.yaml", *words, code=2).stderr, f"eqt: error: {said}\n")
    assert not (config.parent / "exported").exists()


PLUGIN = '''
from dataclasses import dataclass
from eqt_cli.extend import Controller


@dataclass(frozen=True)
class Careful(Controller):
    """Brakes where it is fast."""

    name = "careful"

    def torque(self, s):
        return -2.0 * s.V_tilde {rest}
'''


@pytest.fixture
def export_plugin(config, invoke):
    """Exports the law of a plugin whose torque goes on by some text."""

    def export(rest, *words, offered="", code=0):
        text = PLUGIN.replace("{rest}", rest).replace("Controller\n", f"Controller{offered}\n", 1)
        (config.parent / "careful.py").write_text(text, encoding="utf-8")
        own = ["--set", "controllers=[careful]", "--set", "plugins=[careful.py]"]
        return invoke("export", "flight.yaml", *own, *words, code=code)

    return export


def test_a_plugin_is_exported_too(config, export_plugin):
    export_plugin("")
    header = (config.parent / "exported" / "flight" / "careful.h").read_text(encoding="utf-8")
    assert "Brakes where it is fast." in header


FUNCTIONS = """* (1 + 0.1 * sin(50.0 * s.V) + exp(-s.V**2) + log(1 + s.V**2) + (
            2.0 + s.V**2) ** 1.3)
"""


@pytest.mark.parametrize("real", ["double", in_ci("as test_files.py has it", "float")])
def test_a_plugin_has_the_functions_that_it_calls(config, export_plugin, real):
    export_plugin(FUNCTIONS, "--real", real, offered=", exp, log, sin")
    folder = config.parent / "exported" / "flight"
    source = (folder / "careful.c").read_text(encoding="utf-8")
    assert "eqt_pow(" in source and "eqt_sin(" in source
    assert "eqt_asin(" not in source
    for command in compilers():
        files = [str(folder / f"careful{end}.c") for end in ("", "_check")]
        program = str(folder / "check")
        subprocess.run([*command, *FLAGS, *files, "-o", program, "-lm"], check=True)
        subprocess.run([program], check=True, capture_output=True)


def test_a_law_that_cannot_be_traced_says_why(export_plugin):
    done = export_plugin("if s.V_tilde[..., 0].max() > 1 else s.V_tilde", code=2)
    assert mentions(
        done.stderr,
        "eqt: error: controller 'careful' cannot be compiled: TypeError: '>' not supported between "
        "instances of 'Symbol' and 'int' at careful.py:13: return -2.0 * s.V_tilde if s.V_tilde["
        "..., 0].max() > 1 else s.V_tilde; …functions of eqt_cli.extend, or use…",
    )


def test_an_unknown_type_in_python():
    with pytest.raises(EqtError, match=r"^real: expected double or float, got 'half'$"):
        eqt_cli.export("configs/paper.yaml", real="half")


REFERENCES = {
    "slew": {"kind": "slew", "from": {"rotvec": [0, 0, 0.1]}, "to": {"rotvec": [0.5, 0.3, 0.2]},
        "start": 0.1, "duration": 0.4},
    "waypoints": {"kind": "waypoints",
        "points": [{"t": 0, "pose": "identity"}, {"t": 0.3, "pose": {"rotvec": [0, 0, 0.4]}},
        {"t": 0.6, "pose": {"rotvec": [0.2, 0, 0.4]}}]},
    "constant": {"kind": "constant"},
    "path": {"kind": "path", "factors": [{"axis": [1, 1, 0], "by": "0.5*sin(t)"}]},
}  # fmt: skip


def moving(law, kind, t):
    """The motion of a reference; after the last of the waypoints, it stands still."""
    Q, V, V_dot = law.loop.reference.motion(
        law.loop.group, min(t, 0.6) if kind == "waypoints" else t
    )
    still = kind == "waypoints" and t > 0.6
    return (Q, 0 * V, 0 * V_dot) if still else (Q, V, V_dot)


@pytest.mark.parametrize(
    "kind",
    [
        kind if kind in ("waypoints", "path") else in_ci("others are tried fast", kind)
        for kind in REFERENCES
    ],
)
def test_a_closed_reference_has_the_values_of_the_law(tmp_path, kind):
    experiment = made("SO3", ["lee2010"], reference=REFERENCES[kind])
    [law] = exported(experiment, [], DOUBLE, reference=True)
    compiled = library(law, written(law, tmp_path), compilers()[0])
    function = ctypes.CDLL(str(compiled)).lee2010_reference
    for t in (0.0, 0.05, 0.1, 0.25, 0.3, 0.31, 0.5, 0.6, 0.9):
        found = np.full(31, np.nan)
        function(ctypes.c_double(t), found.ctypes.data_as(ctypes.c_void_p))
        Q, V, V_dot = moving(law, kind, t)
        assert found[0] == t
        assert np.isnan(found[1:13]).all()  # what is measured is left to the vehicle
        for values, expected in ((found[13:22], Q), (found[22:25], V), (found[25:28], V_dot)):
            np.testing.assert_allclose(values, np.ravel(expected), rtol=0, atol=1e-13)


@pytest.mark.ci("a law is exported and compiled in float")
@pytest.mark.parametrize("kind", ["path", "waypoints", "constant"])
def test_a_reference_in_float_counts_time_in_double(tmp_path, kind):
    experiment = made("SO3", ["lee2010"], reference=REFERENCES[kind])
    [law] = exported(experiment, [], FLOAT, reference=True)
    folder = written(law, tmp_path)
    function = ctypes.CDLL(str(library(law, folder, compilers()[0]))).lee2010_reference
    for t in (0.5, 3 * 3600.002, 48 * 3600.002):
        found = np.full(31, np.nan, np.float32)
        function(ctypes.c_double(t), found.ctypes.data_as(ctypes.c_void_p))
        Q, V, V_dot = moving(law, kind, t)
        for values, expected in ((found[13:22], Q), (found[22:25], V), (found[25:28], V_dot)):
            # Half a unit in the last place of a float, and one of a double in the angle.
            np.testing.assert_allclose(values, np.ravel(expected), rtol=6e-8, atol=1e-10)
    code, said = checked(law, folder, compilers()[0])
    assert code == 0
    assert "17 times until t = 1e+06 s" in said
    source = folder / "lee2010.c"
    source.write_text(source.read_text().replace("_motion(&t", "_motion((t = (float)t, &t)"))
    if kind == "path":  # the others are at rest in the end
        code, said = checked(law, folder, compilers()[0])
        assert code == 1
        assert "the reference at t = " in said


def test_it_follows_no_link(config, invoke):
    other = config.parent / "other.h"
    other.write_text("/* Exported by eqt: somebody else's */\n", encoding="utf-8")
    (config.parent / "out").mkdir()
    (config.parent / "out" / "lee2010.h").symlink_to(other)
    done = invoke("export", "flight.yaml", "--out", "out", "--controller", "lee2010", code=2)
    assert says(done.stderr, f"eqt: error: {Path('out', 'lee2010.h')}: is a symbolic link…\n")
    assert other.read_text(encoding="utf-8") == "/* Exported by eqt: somebody else's */\n"
    assert len(list((config.parent / "out").iterdir())) == 1
