"""No command runs code that came with a folder or a result, unless it was trusted."""

import os
import shutil
import subprocess
import sys

import pytest
from ci_cases import mostly_ci

from eqt_cli.runs import provenance
from eqt_cli.runs.provenance import commit_of

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
  budget: 5
  samples: 1
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


NEEDS_GIT = pytest.mark.skipif(not shutil.which("git"), reason="needs git")
GIT_CONFIG = """[core]
	repositoryFormatVersion = 1
	fsmonitor = {monitor}
	hooksPath = {sent}
	pager = {monitor}
	sshCommand = {monitor}
[alias]
	rev-parse = !{monitor}
[pager]
	rev-parse = {monitor}
[filter "x"]
	clean = {monitor}
[diff]
	external = {monitor}
[extensions]
	partialClone = origin
[remote "origin"]
	url = ext::{monitor}
	uploadpack = {monitor}
	promisor = true
[protocol]
	allow = always
"""


@pytest.fixture
def witness(sent, tmp_path, monkeypatch):
    """A file that the colleague's programs write: those that git might start, and plugins."""
    found = tmp_path / "witness"
    (tmp_path / "programs").mkdir()
    hooks = (sent / "reference-transaction", sent / "post-checkout", sent / "post-index-change")
    for program in (sent / "monitor", sent / "git", sent / "uname", *hooks):
        program.write_text(f"#!/bin/sh\necho {program.name} >> {found}\n", encoding="utf-8")
        program.chmod(0o755)
    git = sent / ".git"
    (git / "refs/heads").mkdir(parents=True)
    (git / "objects").mkdir()
    (git / "HEAD").write_text("ref: refs/heads/main\n", encoding="utf-8")
    # No object has this name: git would fetch it, if it wanted to read it.
    (git / "refs/heads/main").write_text(COMMIT + "\n", encoding="utf-8")
    text = GIT_CONFIG.format(sent=sent, monitor=sent / "monitor")
    (git / "config").write_text(text, encoding="utf-8")
    (git / "info").mkdir()
    (git / "info/attributes").write_text("* filter=x\n", encoding="utf-8")
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


@mostly_ci("name", COMMANDS, FAST, "one of many commands")
def test_no_command_starts_a_program(sent, witness, eqt, name):
    (sent / "t.yaml").write_text((sent / "c.yaml").read_text() + TUNE, encoding="utf-8")
    eqt("run", "c.yaml", "--out", "own", "--quiet")
    if name == "pack":
        eqt("run", "c.yaml", "--shard", "1/1", "--out", "shards", "--quiet")
    del _started[:]
    done = eqt(*COMMANDS[name].split())
    assert done.code == 0, done.err
    assert all(values[1][::3] == ["git", "rev-parse"] for _, values in _started)
    assert not witness.exists()


@NEEDS_GIT
def test_git_starts_nothing_of_a_repository(sent, witness):
    assert commit_of(sent) == COMMIT
    assert not witness.exists()


@pytest.mark.ci("starts four processes of Python, each of which loads the libraries")
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


@pytest.mark.ci("starts a process that loads Matplotlib")
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


# The commit -------------------------------------------------------------------------------------


def _git(at, *words):
    names = ["-c", "user.name=x", "-c", "user.email=x@y"]
    done = subprocess.run(["git", *names, *words], cwd=at, capture_output=True, check=True)
    return done.stdout.decode().strip()


@NEEDS_GIT
@pytest.mark.parametrize("form", ["sha1", "sha256"])
def test_the_commit_is_that_of_git(tmp_path, monkeypatch, form):
    """In a repository, its worktree, with packed references, and of a commit without a branch."""
    repository, tree = tmp_path / "repository", tmp_path / "tree"
    (repository / "below").mkdir(parents=True)
    _git(repository, "init", f"--object-format={form}")
    assert commit_of(repository) is None  # before the first commit
    _git(repository, "commit", "--allow-empty", "-m", "one")
    first = _git(repository, "rev-parse", "HEAD")
    assert len(first) == {"sha1": 40, "sha256": 64}[form]
    _git(repository, "worktree", "add", str(tree))
    _git(repository, "commit", "--allow-empty", "-m", "two")
    second = _git(repository, "rev-parse", "HEAD")
    assert commit_of(repository / "below") == second != first
    assert commit_of(tree) == first
    _git(repository, "pack-refs", "--all")
    assert commit_of(repository) == second
    assert commit_of(tree) == first
    _git(repository, "checkout", "--detach", first)
    assert commit_of(repository) == first
    monkeypatch.setenv("GIT_DIR", str(repository / ".git"))  # as where a hook starts eqt
    assert commit_of(tmp_path) is None


def test_without_git_or_a_folder_there_is_no_commit(tmp_path, monkeypatch):
    assert commit_of(tmp_path / "none") is None
    monkeypatch.setenv("PATH", str(tmp_path))
    assert commit_of(tmp_path) is None
    program = tmp_path / "git"
    program.write_text("#!/bin/sh\necho SECRET\n", encoding="utf-8")
    program.chmod(0o755)
    assert commit_of(tmp_path) is None  # what it says is no commit


def _put(path, content):
    path.unlink()
    path.write_bytes(content)


def _leads_out(git, main):
    _put(git / "HEAD", b"ref: refs/../../../heads/main\n")


def _is_no_hash(git, main):
    _put(main, b"SECRET\n")


def _is_large(git, main):
    with main.open("wb") as file:
        file.truncate(2**40)


def _waits(git, main):
    (git / "HEAD").unlink()
    os.mkfifo(git / "HEAD")


def _reference_waits(git, main):
    main.unlink()
    os.mkfifo(main)


def _reference_links_out(git, main):
    main.unlink()
    main.symlink_to(git.parents[1] / "heads/main")


def _references_link_out(git, main):
    shutil.rmtree(main.parent)
    main.parent.symlink_to(git.parents[1] / "heads")


def _settings_wait(git, main):
    os.mkfifo(git / "pipe")
    _put(git / "config", b"[include]\n\tpath = pipe\n")


def _is_a_circle(git, main):
    shutil.rmtree(git)
    git.symlink_to(git)


def _points_at_itself(git, main):
    shutil.rmtree(git)
    git.write_bytes(b"gitdir: .git\n")


def _points_nowhere(git, main):
    shutil.rmtree(git)
    git.write_bytes(b"gitdir: /dev/zero\n")


def _is_packed_badly(git, main):
    main.unlink()
    (git / "packed-refs").write_bytes(b"\xff" * 100)


HOSTILE = [
    _leads_out,
    _is_no_hash,
    _is_large,
    _waits,
    _reference_waits,
    _reference_links_out,
    _references_link_out,
    _settings_wait,
    _is_a_circle,
    _points_at_itself,
    _points_nowhere,
    _is_packed_badly,
]


@pytest.mark.skipif(os.name != "posix", reason="has no pipes in folders")
@NEEDS_GIT
@pytest.mark.parametrize("hostile", HOSTILE)
def test_a_hostile_repository_has_no_commit(tmp_path, monkeypatch, hostile):
    monkeypatch.setattr(provenance, "_PATIENCE", 0.3)
    sent, secret = tmp_path / "sent", tmp_path / "heads/main"
    for path in (sent, secret.parent):
        path.mkdir()
    secret.write_text(COMMIT + "\n", encoding="utf-8")
    _git(sent, "init", "--initial-branch=main")
    _git(sent, "commit", "--allow-empty", "-m", "one")
    assert commit_of(sent)
    hostile(sent / ".git", sent / ".git/refs/heads/main")
    assert commit_of(sent) is None


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
        "shards/config.yaml:46:11: plugins[0]: the result folder contains "
        "shards/stored_plugins/0-law.py, which eqt executes only on request; read this file, then "
        "add --trust-plugins\n"
    )
    assert not witness.exists()
    assert eqt("pack", "shards", "--trust-plugins").code == 0
    assert witness.read_text() == "plugin "


SEARCH = '{"over":{"gains.kp":[0.1,10]},"objective":"effort","budget":5,"samples":1}'
WORST = '{"over":{"gains.kp":[0.1,10]},"objective":"effort","budget":1,"population":5,"seeds":1}'
RESULT_COMMANDS = {
    "run": "run shards --out ../run",
    "sweep": "sweep shards --grid gains.kp=1,2 --out ../sweep",
    "tune": f"tune shards --set tune={SEARCH} --out ../tune",
    "worst": f"worst shards --set worst={WORST} --out ../worst",
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
        pytest.param(DRAW, id="figures", marks=pytest.mark.ci("draws figures")),
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
    "worst": f"worst c.yaml --executor serial --set worst={WORST} --out ../out",
    "margins": "margins c.yaml",
    "export": "export c.yaml --out ../out",
    "replay": "replay c.yaml --measured none.csv",
    "fit": "fit c.yaml --measured none.csv --over inertia --out ../out",
    "config check": "config check c.yaml",
    "verify": "verify c.yaml",
    "plot": "plot c.yaml --format svg --out ../out",
}


@pytest.mark.ci("calls every command with a plugin")
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
