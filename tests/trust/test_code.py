"""No command runs code that came with a folder or a result, unless it was trusted."""

import os
import shutil
import subprocess
import sys

import pytest
from slow_cases import mostly_slow

from eqt_cli.runs.lock import commit_of

COMMIT = "0123456789abcdef0123456789abcdef01234567"

STARTS = {"subprocess.Popen", "os.exec", "os.posix_spawn", "os.spawn", "os.system", "os.fork"}
_started = []


@pytest.fixture(scope="session", autouse=True)
def _audited():
    """A hook makes all that follows slower, so none is there before the first of these tests."""
    starts, note = STARTS, _started.append  # at the end of the process, the names of a module go
    sys.addaudithook(lambda event, values: event in starts and note((event, values)))


TUNE = """\
tune:
  over: {gains.kp: {log: [0.1, 10]}}
  objective: mean_pose_error
  budget: 2
  population: 5
  seeds: 1
  confirm: {runs: 2}
worst: {over: {gains.kp: [0.5, 2]}, objective: mean_pose_error, budget: 1, population: 5, seeds: 1}
"""
LAW = """\
import os
from dataclasses import dataclass
from eqt_cli.extend import Family
with open(os.environ["WITNESS"], "a") as witness:
    witness.write("plugin ")
@dataclass(frozen=True)
class Law(Family):
    name = "law_of_a_colleague"
"""


@pytest.fixture
def witness(sent, tmp_path, monkeypatch):
    """A file that the colleague's programs write: git, what git would start, and plugins."""
    found = tmp_path / "witness"
    programs = tmp_path / "programs"
    programs.mkdir()
    for program in (programs / "git", sent / "monitor", sent / "git", sent / "uname"):
        program.write_text(f"#!/bin/sh\necho {program.name} >> {found}\n", encoding="utf-8")
        program.chmod(0o755)
    git = sent / ".git"
    (git / "refs/heads").mkdir(parents=True)
    (git / "objects").mkdir()
    (git / "HEAD").write_text("ref: refs/heads/main\n", encoding="utf-8")
    (git / "refs/heads/main").write_text(COMMIT + "\n", encoding="utf-8")
    (git / "config").write_text(
        f"[core]\n\tfsmonitor = {sent}/monitor\n\thooksPath = {sent}\n"
        f'[filter "x"]\n\tclean = {sent}/monitor\n[diff]\n\texternal = {sent}/monitor\n',
        encoding="utf-8",
    )
    (git / "info").mkdir()
    (git / "info/attributes").write_text("* filter=x\n", encoding="utf-8")
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("WITNESS", str(found))
    return found


# What a folder configures ----------------------------------------------------------------------

COMMANDS = {
    "run": "run c.yaml --out ../out",
    "run a result": "run own/results.h5 --out ../out",
    "run here": "run c.yaml --out out",
    "sweep": "sweep c.yaml --grid gains.kp=1,2 --out ../out",
    "tune": "tune t.yaml --out ../out",
    "worst": "worst t.yaml --out ../out",
    "pack": "pack shards",
    "config check": "config check c.yaml",
    "show": "show own",
    "compare": "compare own",
    "diff": "diff own own",
    "verify": "verify own",
    "plot": "plot own --figure torque --format svg --out ../out",
}


FAST = ("run", "verify")
"""The others share their code, but for what they print and draw."""


@mostly_slow("name", COMMANDS, FAST, "one of many commands")
def test_no_command_starts_a_program(sent, witness, eqt, name):
    (sent / "t.yaml").write_text((sent / "c.yaml").read_text() + TUNE, encoding="utf-8")
    eqt("run", "c.yaml", "--out", "own", "--quiet")
    if name == "pack":
        eqt("run", "c.yaml", "--shard", "1/1", "--out", "shards", "--quiet")
    del _started[:]
    done = eqt(*COMMANDS[name].split())
    assert done.code == 0, done.err
    assert not _started
    assert not witness.exists()


@pytest.mark.slow("starts four processes of Python, each of which loads the libraries")
def test_processes_load_nothing_of_the_current_folder(sent, witness, tmp_path):
    """Python looks there first for the modules of its library, in a process that it starts."""
    text = "import os\nopen(os.environ['WITNESS'], 'a').write('module ')\n"
    for name in ("multiprocessing", "tempfile", "numpy", "encodings", "sitecustomize"):
        (sent / f"{name}.py").write_text(text, encoding="utf-8")
    script = tmp_path / "programs/eqt"  # as pip installs it
    script.write_text("from eqt_cli.cli import main\nif __name__ == '__main__':\n    main()\n")
    words = "run c.yaml --executor local --workers 2 --set solver.block=1 --out ../out".split()
    done = subprocess.run(
        [sys.executable, str(script), *words], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert not witness.exists()


@pytest.mark.slow("starts a process that loads Matplotlib")
def test_matplotlib_reads_nothing_of_the_current_folder(sent):
    """It would wait for ever for this pipe."""
    if not hasattr(os, "mkfifo"):
        pytest.skip("has no pipes in folders")
    os.mkfifo(sent / "matplotlibrc")
    done = subprocess.run(
        [sys.executable, "-m", "eqt_cli", "plot", "c.yaml", "--format", "svg", "--out", "../out"],
        capture_output=True,
        text=True,
        check=False,
        timeout=30,
    )
    assert done.returncode == 0, done.stderr


def test_variables_are_as_before(sent, eqt, monkeypatch):
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    before = dict(os.environ)
    assert eqt("config", "check", "c.yaml").code == 0
    assert dict(os.environ) == before


# The commit, without git -------------------------------------------------------------------------


def _written(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def test_the_commit_is_that_of_git(tmp_path):
    """In a repository, its worktree, with packed references, and of a commit without a branch."""
    if not shutil.which("git"):
        pytest.skip("needs git")
    repository, tree = tmp_path / "repository", tmp_path / "tree"

    def git(*words, at=repository):
        names = ["-c", "user.name=x", "-c", "user.email=x@y"]
        done = subprocess.run(
            ["git", *names, *words], cwd=at, capture_output=True, check=True, text=True
        )
        return done.stdout.strip()

    (repository / "below").mkdir(parents=True)
    git("init")
    assert commit_of(repository) is None  # before the first commit
    git("commit", "--allow-empty", "-m", "one")
    commit = git("rev-parse", "HEAD")
    git("worktree", "add", str(tree))
    git("commit", "--allow-empty", "-m", "two")
    assert commit_of(repository / "below") == git("rev-parse", "HEAD") != commit
    assert commit_of(tree) == commit
    git("pack-refs", "--all")
    assert commit_of(repository) == git("rev-parse", "HEAD")
    assert commit_of(tree) == commit
    git("checkout", "--detach", commit)
    assert commit_of(repository) == commit


def _links_out(git, secret):
    (git / "HEAD").symlink_to(secret)


def _reference_links_out(git, secret):
    _written(git / "HEAD", "ref: refs/heads/main\n")
    (git / "refs").symlink_to(secret.parent)


def _leads_out(git, secret):
    _written(git / "HEAD", f"ref: refs/../../../{secret.name}\n")


def _is_no_hash(git, secret):
    _written(git / "HEAD", "SECRET\n")


def _is_large(git, secret):
    with _written(git / "HEAD", "").open("wb") as file:
        file.truncate(2**40)


def _waits(git, secret):
    os.mkfifo(git / "HEAD")


def _reference_waits(git, secret):
    _written(git / "HEAD", "ref: refs/heads/main\n")
    (git / "refs/heads").mkdir(parents=True)
    os.mkfifo(git / "refs/heads/main")


def _is_a_circle(git, secret):
    git.rmdir()
    git.symlink_to(git)


def _points_at_itself(git, secret):
    git.rmdir()
    _written(git, "gitdir: .git\n")


def _points_nowhere(git, secret):
    git.rmdir()
    _written(git, "gitdir: /dev/zero\n")


def _is_packed_badly(git, secret):
    _written(git / "HEAD", "ref: refs/heads/main\n")
    (git / "packed-refs").write_bytes(b"\xff" * 100)


@pytest.mark.skipif(os.name != "posix", reason="has no pipes in folders")
@pytest.mark.parametrize(
    "hostile",
    [
        _links_out,
        _reference_links_out,
        _leads_out,
        _is_no_hash,
        _is_large,
        _waits,
        _reference_waits,
        _is_a_circle,
        _points_at_itself,
        _points_nowhere,
        _is_packed_badly,
    ],
)
def test_a_hostile_repository_has_no_commit(tmp_path, hostile):
    secret = _written(tmp_path / "heads/main", COMMIT + "\n")
    git = tmp_path / "sent/.git"
    git.mkdir(parents=True)
    hostile(git, secret)
    assert commit_of(tmp_path / "sent") is None


# Plugins -----------------------------------------------------------------------------------------

PLUGIN_CONFIG = "plugins: [law.py]\n"


@pytest.fixture
def shards(sent, witness, eqt):
    """A folder in which a shard of an experiment with a plugin has computed all parts."""
    text = (sent / "c.yaml").read_text().replace("[eqt]", "[law_of_a_colleague]")
    (sent / "c.yaml").write_text(text + PLUGIN_CONFIG, encoding="utf-8")
    (sent / "law.py").write_text(LAW, encoding="utf-8")
    done = eqt("run", "c.yaml", "--shard", "1/1", "--out", "shards")
    assert done.out.endswith(
        "next     eqt pack shards --trust-plugins  (when all shards are done)\n"
    )
    assert witness.read_text() == "plugin "
    witness.unlink()
    return sent / "shards"


def test_pack_executes_no_plugin_unasked(shards, witness, eqt, refused, forget_plugins):
    forget_plugins()
    assert refused("pack", "shards") == (
        "1 error in shards/config.yaml\n"
        "shards/config.yaml:45:11: plugins[0]: the result folder contains "
        "shards/stored_plugins/0-law.py, which eqt executes only on request; read this file, then "
        "add --trust-plugins\n"
    )
    assert not witness.exists()
    assert eqt("pack", "shards", "--trust-plugins").code == 0
    assert witness.read_text() == "plugin "


SEARCH = '{"over":{"gains.kp":[0.1,10]},"objective":"effort","budget":1,"population":5,"seeds":1}'
RESULT_COMMANDS = {
    "run": "run shards --out ../run",
    "sweep": "sweep shards --grid gains.kp=1,2 --out ../sweep",
    "tune": f"tune shards --set tune={SEARCH} --out ../tune",
    "worst": f"worst shards --set worst={SEARCH} --out ../worst",
    "margins": "margins shards",
    "export": "export shards --out ../export",
    "replay": "replay shards --measured none.csv",
    "fit": "fit shards --measured none.csv --over inertia --out ../fit",
    "config check": "config check shards",
    "verify": "verify shards",
    "plot": "plot shards --figure torque --format svg --out ../out",
    "animate": "animate shards --out ../out",
    "report": "report shards --out ../out.html",
    "show": "show shards --plugins",
    "compare": "compare shards",
    "diff": "diff shards shards",
}


DRAW = {"animate", "report", "plot"}


@pytest.mark.parametrize(
    "names",
    [
        pytest.param(RESULT_COMMANDS.keys() - DRAW, id="without figures"),
        pytest.param(DRAW, id="figures", marks=pytest.mark.slow("draws figures")),
    ],
)
def test_no_command_executes_the_plugins_of_a_result(shards, witness, eqt, forget_plugins, names):
    forget_plugins()
    assert eqt("pack", "shards", "--trust-plugins").code == 0
    witness.unlink()
    for name in sorted(names):
        forget_plugins()
        eqt(*RESULT_COMMANDS[name].split())
        assert not witness.exists(), name


OWN_COMMANDS = {
    "run": "run c.yaml --executor serial --out ../out",
    "sweep": "sweep c.yaml --executor serial --grid gains.kp=1,2 --out ../out",
    "tune": f"tune c.yaml --executor serial --set tune={SEARCH} --out ../out",
    "worst": f"worst c.yaml --executor serial --set worst={SEARCH} --out ../out",
    "margins": "margins c.yaml",
    "export": "export c.yaml --out ../out",
    "replay": "replay c.yaml --measured none.csv",
    "fit": "fit c.yaml --measured none.csv --over inertia --out ../out",
    "config check": "config check c.yaml",
    "verify": "verify c.yaml",
    "plot": "plot c.yaml --format svg --out ../out",
}


@pytest.mark.slow("calls every command with a plugin")
@pytest.mark.parametrize("name", OWN_COMMANDS)
def test_the_plugins_of_a_configuration_are_the_users_own(
    shards, witness, eqt, forget_plugins, name
):
    forget_plugins()
    eqt(*OWN_COMMANDS[name].split())
    assert witness.read_text() == "plugin "


def test_the_help_says_what_executes_code(eqt):
    done = eqt("config", "check", "--help")
    said = " ".join(done.out.split())
    assert (
        "It executes the plugins of a YAML configuration, and those of a result only on request."
    ) in said


def test_pack_reads_no_file_outside_its_folder(sent, tmp_path, eqt, refused):
    table = "t,wx [rad],wy [rad],wz [rad]\n0,0,0,0\n1,0,0,1\n"
    (tmp_path / "secret.csv").write_text(table, encoding="utf-8")
    (sent / "own.csv").write_text(table, encoding="utf-8")
    reference = "reference: {kind: waypoints, file: own.csv}"
    text = (sent / "c.yaml").read_text().replace("reference: {torque: [0, 0, 0]}", reference)
    (sent / "c.yaml").write_text(text, encoding="utf-8")
    assert eqt("run", "c.yaml", "--shard", "1/1", "--out", "shards").code == 0
    config = sent / "shards/config.yaml"
    theirs = config.read_text().replace("stored_files/0-own.csv", "../../secret.csv")
    assert theirs != config.read_text()
    config.write_text(theirs, encoding="utf-8")
    assert "shards/../../secret.csv: is outside the result folder shards" in refused(
        "pack", "shards"
    )
