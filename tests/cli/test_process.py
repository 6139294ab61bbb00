"""The command in a process of its own: exit codes, streams, signals, imports."""

import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import redirect_stdout

import pytest
from case_tables import from_yaml
from plugin_sources import EVERY_KIND
from said import says

import eqt_cli
from eqt_cli.base import process
from eqt_cli.cli import main

HEAVY = ["numpy", "scipy", "h5py", "matplotlib", "pydantic", "yaml", "xarray"]


@from_yaml
def test_wrong_usage_is_told_as_other_errors_are(refused, command, told):
    said = refused(*command.split())
    assert says(said, f"{told}…\n")


def test_wrong_usage_leaves_stdout_as_it_was(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["eqt", "compare", "--json", "--resamples", "x"])
    before = sys.stdout
    with pytest.raises(SystemExit), redirect_stdout(io.StringIO()):
        main()
    assert sys.stdout is before


def test_version(process):
    done = process("--version")
    assert (done.code, done.out, done.err) == (0, f"eqt {eqt_cli.__version__}\n", "")


def test_an_internal_error_is_1_with_a_traceback(folder):
    code = (
        "import eqt_cli.config.experiment as build, eqt_cli.cli as cli, sys\n"
        "build._group = None\n"
        "sys.argv = ['eqt', 'config', 'check', 'c.yaml']\n"
        "cli.main()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert done.returncode == 1
    assert done.stdout == b""
    assert b"Traceback (most recent call last)" in done.stderr


@pytest.mark.parametrize(
    ("error", "told"),
    [
        ("MemoryError", "not enough memory; use fewer workers, or a smaller part"),
        ("OSError(24, 'Too many open files')", "too many open files; use fewer workers"),
    ],
)
def test_what_a_process_lacks_is_told(folder, error, told):
    code = (
        "import eqt_cli.config.experiment as build, eqt_cli.cli as cli, sys\n"
        f"def lack(*_): raise {error}\n"
        "build._group = lack\n"
        "sys.argv = ['eqt', 'config', 'check', 'c.yaml']\n"
        "cli.main()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False, text=True)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"eqt: error: {told}")


@pytest.mark.skipif(os.name != "posix", reason="removes the current folder")
def test_a_current_folder_that_was_removed_is_told(tmp_path, folder):
    gone = tmp_path / "gone"
    gone.mkdir()
    words = f"cd {gone} && rmdir {gone} && {sys.executable} -m eqt_cli run {folder / 'c.yaml'}"
    done = subprocess.run(["sh", "-c", words], capture_output=True, check=False, text=True)
    assert done.returncode == 2
    assert done.stderr.endswith(
        "eqt: error: the current folder does not exist any more; change to another one\n"
    )


@pytest.mark.ci("starts eqt twice")
@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
def test_ctrl_c_is_130_and_the_same_command_starts_again(process, folder):
    command = [sys.executable, "-m", "eqt_cli", "run", "c.yaml"]
    long = ["--set", "solver.block=1", "--set", "ensemble.runs=1000000"]
    running = subprocess.Popen(
        [*command, *long], stdout=subprocess.PIPE, stderr=subprocess.PIPE, encoding="utf-8"
    )
    manifest = folder / "results/c/manifest.json"
    deadline = time.monotonic() + 60
    while not manifest.exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    running.send_signal(signal.SIGINT)
    out, err = running.communicate(timeout=60)
    assert running.returncode == 130
    assert out == ""
    last = err.splitlines()[-1]
    assert re.fullmatch(
        r"eqt: interrupted; \d+ of 2000000 runs are kept in results/c"
        r"( \(whole parts of \d+ are\))?: "
        r"run the same command again to continue",
        last,
    ), last
    assert process("run", "c.yaml").code == 0


ANOTHER = pytest.mark.ci("starts a process of every command")


@pytest.mark.ci("starts an interpreter")
@pytest.mark.skipif(os.name != "posix", reason="pipes as a POSIX shell has them")
@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["config", "schema"], 0),
        pytest.param(["list"], 0, marks=ANOTHER),
        pytest.param(["list", "--help"], 0, marks=ANOTHER),
        (["--help"], 0),
        pytest.param(["run", "c.yaml", "--quiet"], 0, marks=ANOTHER),  # no progress
        (["config", "check", "c.yaml", "--json", "--set", "time.samples=1"], 2),
    ],
)
def test_a_reader_that_leaves_is_no_error(folder, arguments, code):
    reads, writes = os.pipe()
    os.close(reads)
    done = subprocess.run(
        [sys.executable, "-m", "eqt_cli", *arguments],
        stdout=writes,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        check=False,
    )
    os.close(writes)
    assert (done.returncode, done.stderr) == (code, "")


# Imports ----------------------------------------------------------------------------------------


def loaded_by(*arguments):
    """The heavy packages that a command has loaded when it ends."""
    code = (
        "import sys, eqt_cli.cli as cli\n"
        f"sys.argv = ['eqt', *{list(arguments)}]\n"
        "try:\n    cli.main()\n"
        f"finally:\n    print(*[m for m in {HEAVY} if m in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8")
    return set(done.stdout.splitlines()[-1].split())


def test_help_loads_nothing_heavy():
    assert loaded_by("--help") == set()


@pytest.mark.ci("starts an interpreter")
def test_show_does_without_scipy(result):
    assert not {"scipy", "matplotlib", "xarray"} & loaded_by("show", result)


def test_show_on_an_unfinished_folder_does_without_numpy(folder):
    (folder / "out/parts").mkdir(parents=True)
    plan = {"points": 1, "runs": 100, "controllers": 2, "size": 50}
    manifest = {"plan": plan, "name": "c", "begun": "2026-01-01T00:00:00+00:00"}
    (folder / "out/manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    (folder / "out/parts/000001.npy").touch()
    assert not {"numpy", "scipy", "h5py", "yaml"} & loaded_by("show", "out")


# Components of other distributions ----------------------------------------------------------------

DECLARED = {
    "groups": "MyGroup",
    "controllers": "my_law",
    "references": "my_reference",
    "poses": "my_poses",
    "velocities": "my_velocities",
    "engines": "my_engine",
    "figures": "my_figure",
}
CONFIG = """\
group: MyGroup
inertia: [2, 1, 3]
gains: {kp: 1.0, kd: 0.5}
reference: {kind: my_reference, torque: ["cos(t)", "sin(t)", "0"]}
controllers: [my_law]
initial: {pose: my_poses, velocity: my_velocities}
ensemble: {runs: 2}
time: {duration: 1.0, samples: 11}
solver: {engine: my_engine, rtol: 1.0e-6, cross_check: 0}
"""


def install(folder, declared, module=EVERY_KIND):
    """Lay out an installed distribution; returns the environment that finds it."""
    site = folder / "site"
    information = site / "mine-1.0.dist-info"
    information.mkdir(parents=True)
    components = "".join(
        f"    extension.add_component({x!r}, {y!r})\n" for x, y in declared.items()
    )
    text = f"{module}\n\ndef register(extension):\n{components}"
    (site / "mine.py").write_text(text, encoding="utf-8")
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text("[eqt.extensions]\nx = mine:register\n")
    return {"PYTHONPATH": str(site)}


@pytest.mark.ci("computes, draws and verifies in processes of their own")
def test_entry_points_of_every_kind_run(process, folder):
    environment = install(folder, DECLARED)
    (folder / "mine.yaml").write_text(CONFIG, encoding="utf-8")
    assert process("run", "mine.yaml", **environment).code == 0
    listed = json.loads(process("list", "--json", **environment).out)
    found = {entry["name"] for kind in listed.values() for entry in kind}
    assert {*DECLARED.values()} <= found


@from_yaml
def test_a_broken_entry_point(process, folder, module, said):
    environment = install(folder, {"controllers": "my_law"}, module)
    done = process("list", "controllers", **environment)
    assert (done.code, done.out) == (2, "")
    assert says(done.err, f"eqt: error: {said}\n")


COMMANDS = """\
import typer

def greet(): typer.echo("hello")

def fail(): raise KeyError("nothing")
"""


@pytest.mark.ci("starts interpreters")
@pytest.mark.parametrize(
    ("added", "command", "code", "printed"),
    [
        ("command('greet', 'greet')", "greet", 0, "hello"),
        ("command('greet', 'greet')", "--help", 0, "greet"),
        ("command('greet', 'fail')", "greet", 2, "KeyError: 'nothing' at mine.py:5"),
        ("command('greet', 'greet')", "greed", 2, "unknown command 'greed'; did you mean 'greet'?"),
        ("command('run', 'greet')", "--help", 0, "extension 'x': eqt has a command 'run'; rename"),
        (
            "component('controler', 'law')",
            "--help",
            0,
            "extension 'x' of the entry point 'mine:register' cannot be loaded: unknown kind "
            "'controler'; did you mean 'controllers'?; fix or uninstall",
        ),
    ],
)
def test_what_other_distributions_add(process, folder, added, command, code, printed):
    environment = install(folder, {}, COMMANDS)
    register = f"\n\ndef register(extension):\n    extension.add_{added}\n"
    (folder / "site/mine.py").write_text(COMMANDS + register, encoding="utf-8")
    done = process(command, **environment)
    assert done.code == code
    assert " ".join((done.out + done.err).split()).count(printed) == 1


@pytest.mark.ci("starts an interpreter")
def test_a_folder_in_place_of_entry_points_is_passed_over(process, folder):
    (folder / "site/a-1.0.dist-info/entry_points.txt").mkdir(parents=True)
    done = process("--help", PYTHONPATH=str(folder / "site"))
    assert (done.code, done.err) == (0, "")


def test_packages_that_are_too_old_are_one_line(eqt, monkeypatch):
    """As `pip install do-mpc` put NumPy 1.26 under eqt; 2.0.0rc1 is as good as 2.0."""
    from importlib import metadata

    versions = {"numpy": "1.26.4", "scipy": "1.11.4", "h5py": "3.16.0rc1"}
    real = metadata.version
    monkeypatch.setattr(metadata, "version", lambda name: versions.get(name) or real(name))
    facts = "numpy 1.26.4…2.0…scipy 1.11.4…1.16…pip install 'numpy>=2.0' 'scipy>=1.16'"
    assert says(process.too_old("eqt-cli"), facts)
    assert process.too_old("no-such-distribution") == ""
