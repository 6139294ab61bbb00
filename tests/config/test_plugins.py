"""Components of the user's own, from files beside the configuration and from results."""

import pickle
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plugin_sources import EVERY_KIND, component
from said import says

from eqt_cli.base import registry
from eqt_cli.base.store_reader import open_results
from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.config.study import study
from eqt_cli.extend import EqtError
from eqt_cli.runs.executors import executors
from eqt_cli.runs.run_study import execute

PLUGINS = Path(__file__).parents[1] / "plugins"

MINE = {
    "plugins": "[mine.py]",
    "group": "MyGroup",
    "controllers": "[{kind: my_law, label: law}]",
    "reference": '{kind: my_reference, torque: ["cos(t)", "sin(t)", "0"]}',
    "initial": "{pose: my_poses, velocity: my_velocities}",
    "solver": "{engine: my_engine, rtol: 1.0e-6, cross_check: 0}",
}
THEIRS = {"controllers": "[{kind: eqt, label: law}]"}

LAW = component("""
push(eqt_cli.components.laws.Controller):
    title: ClassVar[str] = "Push"
    gain: float = 1.0

    def torque(self, s):
        return -self.gain * s.V_tilde
""")
PUSH = {
    "plugins": "[law.py]",
    "controllers": "[push, eqt]",
    "ensemble": "{runs: 1}",
    "time": "{duration: 0.1, samples: 3}",
}


@pytest.fixture
def law(folder):
    path = folder / "law.py"
    path.write_text(LAW, encoding="utf-8")
    return path


@pytest.fixture
def every_plugin(tmp_path, monkeypatch):
    """The configuration that uses the plugins in ``tests/plugins``, beside a copy of them."""
    shutil.copytree(PLUGINS, tmp_path / "plugins", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.chdir(tmp_path)
    return Path(shutil.copy(PLUGINS / "every_kind.yaml", tmp_path))


def datasets(results):
    return {name: results[name] for name in (*results.names, *results.coordinates)}


def assert_equal_datasets(one, other):
    with open_results(one) as a, open_results(other) as b:
        found, expected = datasets(a), datasets(b)
    assert list(found) == list(expected)
    for name, values in found.items():
        np.testing.assert_array_equal(values, expected[name], err_msg=name)


def test_a_plugin_of_every_kind_runs(run, folder):
    (folder / "mine.py").write_text(EVERY_KIND, encoding="utf-8")
    run(out="mine", **MINE)
    run(out="theirs", **THEIRS)
    assert_equal_datasets(folder / "mine", folder / "theirs")


LOAD = """\
import sys
from pathlib import Path
from eqt_cli.base.registry import load_plugin
for path in sys.argv[1:]:
    assert load_plugin(Path(path)), path
"""


@pytest.mark.ci("starts an interpreter that loads all of eqt")
def test_a_plugin_is_all_that_a_process_needs_to_load():
    """Nothing else is imported before, so the base class alone brings its registry."""
    paths = sorted(map(str, PLUGINS.glob("*.py")))
    command = [sys.executable, "-W", "error", "-c", LOAD, *paths]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("", "")


@pytest.mark.needs("proofs")
def test_plugins_of_every_kind_run_together(every_plugin, tmp_path):
    found = study(read_config(every_plugin, ["ensemble.runs=1", "time.duration=0.1"]))
    done = execute(found, tmp_path / "out", executor=executors.get("backwards")(1))
    assert (done.runs, done.failed) == (5, 0)


def test_wrong_options_of_plugins_are_reported_together(every_plugin):
    wrong = {
        "frequencies: [1.0, 2.0, pi/2]": "frequencies: [1.0]",
        'amplitude: "1 + 0.2*cos(t)"': 'amplitude: "1 +"',
        "weight: 0.25": "wieght: 0.25",
        "angle: 0.8": "angle: -1",
        "rtol: 1.0e-6": "rtol: 2.0",
    }
    text = every_plugin.read_text()
    for right, value in wrong.items():
        assert right in text
        text = text.replace(right, value)
    every_plugin.write_text(text)
    with pytest.raises(EqtError) as caught:
        study(read_config(every_plugin))
    said = [line.split(": ", 1)[1] for line in str(caught.value).splitlines()]
    assert [line.partition(":")[0] for line in said] == (
        "reference.frequencies reference.amplitude controllers[4].wieght initial.pose.angle "
        "solver.rtol"
    ).split()
    assert said[0] == "reference.frequencies: expected 3 for Turning, got 1"
    assert said[4] == "solver.rtol: expected less than 1, got 2"


def test_options_of_a_plugin_are_checked(message, law):
    said = message(plugins="[law.py]", controllers="[{kind: push, gian: 1}, {kind: push, gain: x}]")
    assert said.splitlines() == [
        "c.yaml:5:28: controllers[0].gian: unknown key; did you mean 'gain'?",
        "c.yaml:5:51: controllers[1].gain: expected a number, got 'x'",
    ]


def test_paths_are_relative_to_the_configuration(run, law, folder, monkeypatch):
    run(**PUSH)
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    assert "push" in build(read_config(Path("../c.yaml"))).loops


def test_the_digest_sees_the_source_and_not_its_path(experiment, law):
    one = experiment(**PUSH).digest
    law.rename(law.with_name("other.py"))
    assert experiment(**PUSH | {"plugins": "[other.py]"}).digest == one
    law.write_text(LAW.replace("-self.gain", "-2 * self.gain"), encoding="utf-8")
    assert experiment(**PUSH).digest != one


def test_an_edited_plugin_is_another_experiment(run, law):
    run(**PUSH)
    law.write_text(LAW.replace("-self.gain", "-2 * self.gain"), encoding="utf-8")
    with pytest.raises(EqtError) as caught:
        run(**PUSH)
    first, plugin, _ = str(caught.value).splitlines()
    assert first == "out: holds another experiment, which differs in"
    assert plugin.startswith("  plugins[0]: '")


# Results that hold plugins ----------------------------------------------------------------------


def test_a_folder_and_a_trusted_result_run_again_without_the_file(run, law, folder):
    run(**PUSH)
    law.unlink()
    kept = Path("out/config.yaml")
    assert "plugins: [stored_plugins/0-law.py]" in kept.read_text(encoding="utf-8")
    source = read_config(kept)
    execute(study(source), folder / "again")
    assert_equal_datasets(folder / "out", folder / "again")
    (folder / "away").mkdir()
    moved = Path("out/results.h5").rename(folder / "away" / "results.h5")
    execute(study(read_config(moved, trusted=True)), folder / "alone")
    assert_equal_datasets(moved, folder / "alone")
    assert (folder / "alone/stored_plugins/0-law.py").read_text(encoding="utf-8") == LAW


def test_a_sweep_takes_the_source_to_other_processes(run, law, folder, monkeypatch):
    run(**PUSH)
    (folder / "c.yaml").write_text(
        (folder / "out/config.yaml").read_text().replace("stored_plugins/0-", "")
        + "sweep: [{cases: {ideal: {}, stiff: {gains.kp: 2}}}]\n",
        encoding="utf-8",
    )
    sent = pickle.dumps(study(read_config(folder / "c.yaml")))
    law.unlink()
    monkeypatch.setattr(registry, "_loaded_plugins", {})
    assert pickle.loads(sent).experiment(1).config.gains.kp == 2


def test_code_that_its_user_has_executed_needs_no_trust(run, law):
    """A configuration of one's own has named it; its copy beside a result is no reason."""
    run(**PUSH)
    assert build(read_config(Path("out"))).loops
    law.write_text(LAW.replace("-self.gain", "-2 * self.gain"), encoding="utf-8")
    stored = {"law.py": law.read_text(encoding="utf-8")}
    own = read_config(Path("out"))
    hostile = replace(own, home=replace(own.home, plugins=stored))
    with pytest.raises(EqtError, match="executes only on request"):
        build(hostile)


def test_a_result_executes_no_plugin_unasked(run, law, forget_plugins):
    run(**PUSH)
    forget_plugins()
    source = read_config(Path("out"))
    with pytest.raises(EqtError) as caught:
        build(source)
    place = source.place(("plugins", 0))
    assert place.startswith(f"{Path('out/results.h5')}[config]:")
    assert says(
        str(caught.value), f"{place}: plugins[0]: the result contains the source of law.py…"
    )


# Errors -----------------------------------------------------------------------------------------


def test_files_that_do_not_exist(message):
    assert message(plugins="[law.py, ../mine.py]").splitlines() == [
        "c.yaml:10:11: plugins[0]: law.py: not found; "
        "plugin paths are relative to the configuration's folder",
        f"c.yaml:10:19: plugins[1]: {Path('../mine.py')}: not found; "
        "plugin paths are relative to the configuration's folder",
    ]


def test_a_syntax_error(message, law):
    law.write_text("class Push(:\n", encoding="utf-8")
    said = message(**PUSH)
    assert said.startswith("c.yaml:10:11: plugins[0]: plugin law.py: SyntaxError: ")
    assert said.endswith("(law.py, line 1)")


def test_an_error_when_it_is_executed(message, law):
    law.write_text("import eqt_does_not_exist\n", encoding="utf-8")
    assert says(
        message(**PUSH),
        "c.yaml:10:11: plugins[0]: plugin law.py: ModuleNotFoundError: No…'eqt_does_not_exist'",
    )


def test_a_file_that_it_reads_and_no_result_copies(message, law):
    law.write_text("open('/no/gain.txt')\n", encoding="utf-8")
    assert says(
        message(**PUSH),
        "…FileNotFoundError…'/no/gain.txt'; put the file there; results copy plugins, but no…",
    )


def test_no_component(message, law):
    law.write_text("x = 1\n", encoding="utf-8")
    said = message(**PUSH)
    assert said.startswith(
        "c.yaml:10:11: plugins[0]: plugin law.py: defines no component; "
        "derive a class with a `name` from one of "
    )
    assert "Controller, " in said  # of the kinds that this command knows


ENGINE = component("""
mine(eqt_cli.extend.Engine):
    rtol: float = 1e-6

    def solve(self, problem, workers=1, progress=lambda runs: None):
        ...

    def tightened(self, factor):
        return self
""")


def test_an_engine_that_leaves_the_walk_to_nobody(message, folder):
    """One that integrates from the first sample to the last by itself would miss the instants."""
    (folder / "engine.py").write_text(ENGINE, encoding="utf-8")
    assert message(plugins="[engine.py]").endswith(
        "engine.py: engine 'mine' does not define integrator; see eqt_cli.extend.Engine"
    )


CERTIFICATE = """
from eqt_cli.extend import Identity

class Own(Identity):
    name = "bracket"

    def sides(self, sample):
        yield sample.s.V, sample.s.V
"""


@pytest.mark.needs("proofs")
def test_a_class_variable_that_a_base_only_declares(message, folder):
    """A report and a table need it, long after the plugin was loaded."""
    (folder / "own.py").write_text(CERTIFICATE, encoding="utf-8")
    assert message(plugins="[own.py]").endswith(
        "own.py: certificate 'bracket' does not define section, statement; "
        "see eqt_cli.extend.Certificate"
    )


@pytest.mark.parametrize(("name", "said"), [("eqt", ""), ("EqT", ", in other capitals ('eqt')")])
def test_the_name_of_one_of_eqts_own(message, law, name, said):
    law.write_text(LAW.replace('"push"', f'"{name}"'), encoding="utf-8")
    assert message(**PUSH) == (
        f"c.yaml:10:11: plugins[0]: plugin law.py: controller '{name}' already exists in eqt{said}"
        "; give yours another name"
    )


def test_two_names_of_plugins_that_differ_in_capitals(message, law, folder):
    (folder / "other.py").write_text(LAW.replace('"push"', '"Push"'), encoding="utf-8")
    assert message(**PUSH | {"plugins": "[law.py, other.py]"}).endswith(
        "plugins[1]: law.py already defines controller 'push', and controller 'Push' differs in "
        "capitals only; rename one of them"
    )


def test_wrong_plugins_are_reported_together(message, law):
    law.write_text("x = 1 +\n", encoding="utf-8")
    places = [line.split(": ")[0] for line in message(plugins="[law.py, no.py, 3]").splitlines()]
    assert places == ["c.yaml:10:11", "c.yaml:10:19", "c.yaml:10:26"]


def typed(folder, option):
    """A configuration with a law that has an option of a type."""
    imports = "import datetime, decimal, enum, pathlib\nimport numpy as np\n"
    imports += "class Mode(enum.Enum): HIGH = 'high'\n"
    (folder / "law.py").write_text(
        component(f"\n{imports}push(eqt_cli.components.laws.EqT):\n    {option}\n"),
        encoding="utf-8",
    )


@pytest.mark.parametrize(
    ("option", "held"),
    [
        ("one: 'pathlib.Path' = pathlib.Path('a')", "a"),
        ("one: 'decimal.Decimal' = decimal.Decimal('0.1')", "0.1"),
        ("one: 'Mode' = Mode.HIGH", "high"),
        ("one: 'datetime.date' = datetime.date(2020, 1, 2)", "2020-01-02"),
        ("one: 'tuple[float, ...]' = (1.0, 2.0)", [1.0, 2.0]),
    ],
)
def test_options_that_are_text_in_a_configuration(experiment, folder, option, held):
    typed(folder, option)
    assert experiment(**PUSH).resolved["controllers"][0]["one"] == held


@pytest.mark.parametrize(
    "option",
    ["one: 'np.ndarray | None' = None", "one: 'Missing' = 1", "one: 'complex | slice' = 1j"],
)
def test_options_that_no_configuration_can_hold(message, folder, option):
    typed(folder, option)
    assert "'push' has an option whose type no configuration can hold: " in message(**PUSH)
