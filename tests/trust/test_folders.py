"""Folders of strangers: eqt writes and deletes only what is its own, and follows no link.

Whatever a folder holds, a canary outside of it stays as it was: its contents, its times, and the
list of its files.
"""

from __future__ import annotations

import ast
import errno
import io
import os
import re
import shutil
import stat
import sys
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from ci_cases import mostly_ci
from made_up import Table, write
from matplotlib.figure import Figure
from small_experiment import configuration
from typer.main import get_command

import eqt_cli
import eqt_cli.api.running
import eqt_cli.extensions.report.document  # before anything that these import is replaced
from eqt_cli.base.files import (
    CONFIG_MARK,
    FIGURES,
    FILE_NAME,
    kind_of,
    name_to_be,
    new_file,
    replace_file,
)
from eqt_cli.cli import main
from eqt_cli.cli.app import app
from eqt_cli.config import study as studies
from eqt_cli.extend import EqtError
from eqt_cli.runs.folder import CONFIG as CONFIG_NAME
from eqt_cli.runs.folder import FILES, PLUGINS, RERUN, RESULT_ENTRIES
from eqt_cli.runs.lock import LOCK, holder, locked
from eqt_cli.runs.part_files import MANIFEST, PARTS

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="links need rights on Windows"),
    pytest.mark.needs("search"),
]

CONFIG = configuration(
    controllers="[eqt]",
    ensemble="{runs: 2, seed: 1}",
    time="{duration: 0.1, samples: 3}",
    solver="{rtol: 1.0e-3, cross_check: 0, error_estimate: false}",
)
ONE = (
    "tune: {over: {gains.kp: [0.1, 10]}, objective: mean_pose_error, budget: 5, samples: 1, "
    "confirm: {runs: 2}}\n"
)
MANY = (
    "tune: {over: {gains.kp: [0.1, 10]}, objectives: [mean_pose_error, effort], budget: 5, "
    "population: 5, seeds: 1, confirm: {runs: 2}}\n"
)

BAD = (
    "worst: {over: {gains.kp: [0.1, 10]}, objective: mean_pose_error, budget: 1, population: 5, "
    "seeds: 1}\n"
)

# What the commands write, recorded while they do -------------------------------------------------


@dataclass
class Recorder:
    """The names below a folder that this process has written, as the interpreter tells."""

    home: Path | None = None
    files: set[str] = field(default_factory=set)
    folders: set[str] = field(default_factory=set)

    def __call__(self, event, arguments):
        if self.home is None:
            return
        if event == "open" and isinstance(arguments[2], int):
            if arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
                self.note(arguments[0], self.files)
        elif event == "os.rename":
            self.note(arguments[1], self.files)
        elif event == "os.mkdir":
            self.note(arguments[0], self.folders)

    def note(self, path, names):
        """One path, if it is below the folder and will not be renamed."""
        assert self.home is not None
        if not isinstance(path, str | os.PathLike):
            return
        path = Path(os.path.abspath(path))  # noqa: PTH100  # resolves no link
        if path != self.home and path.is_relative_to(self.home) and not name_to_be(path.name):
            names.add(path.relative_to(self.home).as_posix())


RECORDER = Recorder()


@pytest.fixture(scope="session", autouse=True)
def _audited():
    """A hook makes all that follows slower, so none is there before the first of these tests."""
    sys.addaudithook(RECORDER)


MAKES = {
    "complete": [
        "run c.yaml --out OUT",
        "plot OUT --figure torque --format json",
        "report OUT --figure torque",
        "animate OUT",
    ],
    "begun": ["run c.yaml --out OUT --shard 1/1"],
    "failed": ["run c.yaml --out OUT --set solver.max_steps=1"],
    "swept": [
        "sweep c.yaml --out OUT --grid gains.kp=1,2",
        "plot OUT --figure torque --format json --point 0",
        "report OUT --figure torque --point 0",
    ],
    "tuned": ["tune one.yaml --out OUT"],
    "front": ["tune many.yaml --out OUT"],
    "worst": ["worst bad.yaml --out OUT"],
}
"""Folders, and the commands that make them."""

COMMANDS = {
    "run": ("complete", "run c.yaml --out OUT"),
    "run --force": ("complete", "run c.yaml --out OUT --force"),
    "run on": ("begun", "run c.yaml --out OUT"),
    "run --shard": ("begun", "run c.yaml --out OUT --shard 1/1"),
    "run --rerun-failed": (
        "failed",
        "run c.yaml --out OUT --set solver.max_steps=1 --rerun-failed",
    ),
    "pack": ("begun", "pack OUT"),
    "sweep --force": ("swept", "sweep c.yaml --out OUT --grid gains.kp=1,2 --force"),
    "tune": ("tuned", "tune one.yaml --out OUT"),
    "tune --force": ("tuned", "tune one.yaml --out OUT --force"),
    "tune of a front": ("front", "tune many.yaml --out OUT --force"),
    "worst": ("worst", "worst bad.yaml --out OUT"),
    "worst --force": ("worst", "worst bad.yaml --out OUT --force"),
    "plot": ("complete", "plot OUT --figure torque --format json"),
    "plot --out": ("complete", "plot OUT --figure torque --format json --out OUT"),
    "plot --point": ("swept", "plot OUT --figure torque --format json --point 0"),
    "report": ("complete", "report OUT --figure torque"),
    "report --out": ("complete", "report OUT --figure torque --out OUT/report.html"),
    "report --point": ("swept", "report OUT --figure torque --point 0"),
    "animate": ("complete", "animate OUT"),
    "config new": ("complete", "config new OUT/config.yaml"),
}
"""Every way to write into a folder: the folder, and the command."""


READ = {FILE_NAME, MANIFEST, CONFIG_NAME, "tuning.json", "worst.json"}
"""What commands read before they write: a link there may be refused for what it leads to."""


@dataclass(frozen=True)
class Folders:
    """What was made, once for all tests, and the names that this took."""

    home: Path
    all: frozenset[str]
    folders: frozenset[str]


@pytest.fixture(scope="module", autouse=True)
def _only_folders():
    """Figures and pages are empty, and the commands are made once: folders are the subject."""
    from eqt_cli.extensions.search.api import Search  # before anything that it imports is replaced

    page = '<!DOCTYPE html>\n<meta name="generator" content="eqt test">\n'
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eqt_cli.cli.app.app", get_command(app))
        patch.setattr(studies, "study", _once(studies.study))
        patch.setattr(Search, "read", _once(Search.read))
        patch.setattr("eqt_cli.figures.render.figure_from", lambda name, _: _Figure(name))
        patch.setattr("eqt_cli.figures.render.curves", lambda _: [])
        patch.setattr(
            "eqt_cli.extensions.proofs.verification.verify_stored", lambda *_, **__: _Verified()
        )
        patch.setattr("eqt_cli.extensions.report.document.report", lambda *_: page)
        patch.setattr(
            "eqt_cli.extensions.report.scenes.gif", lambda *_, **__: b"GIF89a!\xfe\x09eqt test"
        )
        yield


def _once(read):
    """Each configuration is read once: it is the same under every name."""
    found = {}

    def known(source, **options):
        key = repr((source.data, source.path))
        if key not in found:
            found[key] = read(source, **options)
        return found[key]

    return known


class _Verified:
    rows = ()


@dataclass
class _Figure:
    """Shows nothing."""

    name: str

    def draw(self, *_, **__):
        """Draw nothing."""
        return Figure()


@dataclass(frozen=True)
class Done:
    """How a command ended, and what it said."""

    code: int
    error: str


def refusal_of(said):
    """How a command ends that refuses the folder `out`, or an entry of it."""
    return Done(2, f"eqt: error: out{said}\n")


def call(text):
    """A command in words, with `OUT` for the folder `out`, within this process."""
    words = [word.replace("OUT", "out") for word in text.split()]
    if words[0] in ("run", "sweep", "tune", "worst"):
        words += ["--executor", "serial", "--quiet"]
    out, error, argv = io.StringIO(), io.StringIO(), sys.argv
    sys.argv = ["eqt", *words]
    try:
        with redirect_stdout(out), redirect_stderr(error), pytest.raises(SystemExit) as ended:
            main()
    finally:
        sys.argv = argv
    return Done(int(ended.value.code or 0), error.getvalue())


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """All folders of `MAKES`, and the names that are written into them."""
    home = tmp_path_factory.mktemp("made")
    for name, text in {"c": "", "one": ONE, "many": MANY, "bad": BAD}.items():
        (home / f"{name}.yaml").write_text(CONFIG + text, encoding="utf-8")
    literal = {name for entry in RESULT_ENTRIES for name in [literally(entry)] if name}
    for entry in RESULT_ENTRIES:
        assert literally(entry) or entry.name.startswith(re.escape(LOCK))
    here = Path.cwd()
    os.chdir(home)
    try:
        for name, commands in MAKES.items():
            RECORDER.home = home / "out"
            for text in commands:
                done = call(text)
                assert done.code == (3 if name == "failed" else 0), (text, done)
            if name == "failed":  # on a copy: it is to be done again
                shutil.copytree("out", "kept")
                call(COMMANDS["run --rerun-failed"][1])
                shutil.rmtree("out")
                Path("kept").rename("out")
            RECORDER.home = None
            Path("out").rename(name)
    finally:
        RECORDER.home = None
        os.chdir(here)
    folders = {name for name in literal if "." not in name} | RECORDER.folders
    return Folders(home, frozenset(RECORDER.files | literal | folders), frozenset(folders))


def literally(own):
    """The name of what eqt owns, where it is one and no pattern."""
    name = re.sub(r"\\(.)", r"\1", own.name)
    return name if re.escape(name) == own.name or (name == own.name and name.isidentifier()) else ""


@pytest.fixture
def lay(made, tmp_path, monkeypatch):
    """Lays down a copy of one of the folders as `out`, beside the configurations."""
    monkeypatch.chdir(tmp_path)
    for path in made.home.glob("*.yaml"):
        shutil.copy(path, tmp_path)

    def laid(name):
        out = tmp_path / "out"
        if out.exists():
            shutil.rmtree(out)
        shutil.copytree(made.home / name, out, symlinks=True)
        return out

    return laid


@pytest.fixture
def canary(tmp_path):
    """A folder of others, whose files have the names and the marks of eqt's."""
    home = tmp_path / "canary"
    (home / "folder" / "inner").mkdir(parents=True)
    names = ("000000.npy", "reference.npy", "0-a.py", "eqt.yaml", "1.yaml", "config.yaml", "x.tmp")
    for folder in (home, home / "folder", home / "folder" / "inner"):
        for name in (*names, "results.h5", "torque.json", f"a.{'0' * 16}.tmp"):
            (folder / name).write_text(CONFIG_MARK.format("tune"))
    (home / "file").write_bytes(b"precious")
    return home


def state(folder):
    """All that there is in a folder: names, kinds, contents, times."""
    found = {}
    for path in [folder, *sorted(folder.rglob("*"))]:
        here = path.lstat()
        content = path.read_bytes() if stat.S_ISREG(here.st_mode) else b""
        link = path.readlink() if path.is_symlink() else None
        times = here.st_mtime_ns, here.st_ctime_ns
        found[str(path)] = (stat.S_IFMT(here.st_mode), here.st_ino, content, link, times)
    return found


def replaced_by_link(path, target):
    """Put a link where an entry is, or could be."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.is_dir():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
    path.symlink_to(target)


FAST = ("config new", "plot")
"""One that writes a file, and one that writes several; the others go through links, too."""


@mostly_ci("command", COMMANDS, FAST, "tries every name")
def test_links_are_refused(made, lay, canary, command, record_property):
    """A link at every name that eqt writes, under every command that writes.

    A name that the command writes is refused before anything in the folder changes. Each of the
    others is refused or left alone; links are at all of them at once, less those refused, and at
    files that the command may read one at a time.
    """
    base, text = COMMANDS[command]
    before = state(canary)
    plain, own, folders = written_by(text, lay(base))
    folders |= made.folders

    def hostile(names):
        """The command where links are at some names, and whether the folder is as it was."""
        out = lay(base)
        for name in names:
            replaced_by_link(out / name, canary / ("folder" if name in folders else "file"))
        there = state(out)
        done = call(text)
        assert state(canary) == before, names
        return done, state(out) == there

    def refusal(name):
        if command == "config new":  # which replaces nothing
            return refusal_of(f"/{name}: already exists; give another name, or remove it")
        expected = f"expected {'a folder' if name in folders else 'a file'} that eqt wrote"
        advice = "or no such entry; rename or remove it"
        return refusal_of(f"/{name}: is a symbolic link; {expected}, {advice}")

    for name in sorted(own):
        assert hostile([name]) == (refusal(name), True)
    others, refused = sorted(made.all - own), 0
    for name in others:
        if name in READ:
            refused += hostile([name]) == (refusal(name), True)
    left = [name for name in others if name not in READ]
    while left:
        outer = [name for name in left if not any(_is_within(name, one) for one in left)]
        done, is_same = hostile(outer)
        found = [name for name in outer if done == refusal(name)]
        assert is_same if found else done.code == plain.code, done
        refused += len(found)
        left = [name for name in left if name not in (found or outer)]
    alone = len(made.all | own) - len(own) - refused
    record_property("table", f"{len(own)} {refused} {alone}")


def _is_within(name, folder):
    return name.startswith(f"{folder}/")


def written_by(text, out):
    """How a command ends, the names that it writes in a folder, and which of them are folders."""
    RECORDER.home, RECORDER.files, RECORDER.folders = out, set(), set()
    done = call(text)
    RECORDER.home = None
    return done, RECORDER.files | RECORDER.folders, RECORDER.folders


# What is removed ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "command", ["run --force", "run --rerun-failed", "sweep --force", "tune --force", "pack"]
)
def test_only_own_names_are_deleted(lay, command):
    """Whatever others keep in a folder of eqt's, or under a name like one of eqt's, stays."""
    base, text = COMMANDS[command]
    out = lay(base)
    slug = "tuned/eqt.yaml" if base == "tuned" else "tuned/notes.yaml"
    kept = {
        f"{folder}/{name}"
        for folder in (PARTS, RERUN, FIGURES, PLUGINS, FILES, "generations/eqt/seeds-0-0")
        for name in ("notes.txt", "x.tmp", "mine/000000.npy", f"notes.{'0' * 16}.tmp")
    }
    kept |= {"x.tmp", "results.h5.tmp", "notes.txt", f"{FIGURES}/mine/torque.json"}
    if base == "tuned":
        kept |= {"generations/notes.txt", "generations/mine/001/results.h5", "tuned/notes.yaml"}
    for name in kept:
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_bytes(b"mine")
    unfinished = {"tuned": ["tuning.json", "tuned/eqt.yaml"]}.get(
        base, ["results.h5", "parts/000000.npy"]
    )
    killed = [f"{name}.{'0' * 16}.tmp" for name in unfinished]
    for name in killed:
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).write_bytes(b"half")
    done = call(text)
    assert done.code in (0, 3), done
    assert {name for name in kept if (out / name).read_bytes() != b"mine"} == set()
    assert [name for name in killed if (out / name).exists()] == []
    assert not list((out / RERUN).glob("*.h5"))
    assert slug == "tuned/notes.yaml" or CONFIG_MARK.format("tune") in (out / slug).read_text()


@pytest.mark.parametrize("name", [PARTS, RERUN, FIGURES, PLUGINS, FILES])
@pytest.mark.parametrize("force", ["", " --force"])
def test_a_folder_of_others_takes_no_result(lay, name, force):
    out = lay("complete")
    shutil.rmtree(out)
    (out / name).mkdir(parents=True)
    (out / name / "000000.npy").write_bytes(b"mine")
    before = state(out / name)
    assert call(f"run c.yaml --out OUT{force}") == refusal_of(
        f": holds {name} that eqt did not write; choose another folder with --out"
    )
    assert state(out / name) == before


@pytest.mark.parametrize("at", [0, 5, 40, -3])
def test_a_flipped_bit_of_a_manifest_is_told(lay, at):
    """The brace before all, the name of a key, a value, and the brace behind all."""
    out = lay("complete")
    content = bytearray((out / MANIFEST).read_bytes())
    content[at] ^= 4
    (out / MANIFEST).write_bytes(content)
    said = call("run c.yaml --out OUT").error
    assert "manifest.json is damaged" in said
    assert "did not write" not in said
    assert "\n" not in said.strip()


@pytest.mark.parametrize("name", ["tuning.json", "generations", "tuned"])
@pytest.mark.parametrize("force", ["", " --force"])
def test_a_folder_of_others_takes_no_tuning(lay, name, force):
    out = lay("complete")
    if name == "tuning.json":
        (out / name).write_bytes(b"{}")
    else:
        (out / name / "eqt").mkdir(parents=True)
    before = state(out)
    assert call(f"tune one.yaml --out OUT{force}") == refusal_of(
        f": holds {name} that eqt did not write; choose another folder with --out"
    )
    assert [path for path in state(out) if path not in before] == []


# Temporary files ---------------------------------------------------------------------------------


def test_temporary_files_are_exclusive(tmp_path, canary, monkeypatch):
    """Each has a name of its own that nobody can guess; where one guesses, nothing is written."""
    writes = {
        "a.json": lambda path: replace_file(path, b"new"),
        "a.h5": lambda path: write(path, Table({})),
    }
    names = []
    rename = Path.replace
    monkeypatch.setattr(Path, "replace", lambda a, b: (names.append(a.name), rename(a, b))[1])
    for name, written in writes.items():
        written(tmp_path / name)
        written(tmp_path / name)
    assert [name_to_be(name) for name in names] == ["a.json", "a.json", "a.h5", "a.h5"]
    assert len(set(names)) == 4
    assert len(names[0]) == len("a.json..tmp") + 16  # 64 bits that nobody knows
    before = state(canary)
    monkeypatch.setattr(os, "urandom", bytes)
    for name, written in writes.items():
        for target in ("file", "missing", "folder"):
            link = tmp_path / f"{name}.{'0' * 16}.tmp"
            link.symlink_to(canary / target)
            with pytest.raises((FileExistsError, EqtError), match="exists"):
                written(tmp_path / name)
            link.unlink()
    assert state(canary) == before


@pytest.mark.parametrize("target", ["file", "missing", "folder"])
def test_a_new_file_replaces_nothing(tmp_path, canary, target):
    before = state(canary)
    (tmp_path / "new.yaml").symlink_to(canary / target)
    with pytest.raises(FileExistsError):
        new_file(tmp_path / "new.yaml", b"new")
    assert state(canary) == before


WRITING = {"write_text", "write_bytes", "savefig", "rmtree", "mkstemp", "NamedTemporaryFile"}
"""What writes or deletes past the one way."""


def test_every_file_is_written_in_one_way():
    """No module opens a file for writing but the one that replaces files, and the lock."""
    package = Path(eqt_cli.__file__).parent
    allowed = {
        ("base/files.py", "FileIO"),  # the one way
        ("runs/lock.py", "open"),  # a file that is locked cannot be replaced
        ("figures/render.py", "savefig"),  # into memory
        ("figures/layout.py", "savefig"),
        ("figures/style.py", "savefig"),
        ("base/store_writer.py", "File"),  # into the one way
        ("base/process.py", "open"),  # the null device
        ("extensions/code/python_law.py", "open"),  # the same
        # Into a new folder of their own, for a compiler.
        ("extensions/code/user_code.py", "write_text"),
        ("extensions/code/user_code.py", "write_bytes"),
        ("engines/compiler.py", "write_bytes"),
    }
    found, names = set(), re.compile(rf"\b({'|'.join(WRITING | {'open', 'FileIO', 'File'})})\b")
    for path in package.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if names.search(text) else ():
            if isinstance(node, ast.Call) and _writes(node):
                found.add((path.relative_to(package).as_posix(), _name(node)))
    assert found <= allowed, sorted(found - allowed)


def _name(node):
    return getattr(node.func, "attr", getattr(node.func, "id", ""))


def _writes(node):
    name = _name(node)
    if name not in ("open", "FileIO", "File"):
        return name in WRITING
    words = [ast.unparse(each) for each in (*node.args, *(key.value for key in node.keywords))]
    if any(re.search(r"\bO_(WRONLY|RDWR|CREAT)\b", word) for word in words):
        return True
    modes = [word[1:-1] for word in words if re.fullmatch(r"'[rwaxbt+]{1,3}'", word)]
    return any(set(mode) & set("wax+") for mode in modes) or (name == "File" and not modes)


# The lock ----------------------------------------------------------------------------------------


def hard(path, canary):
    os.link(canary / "file", path)
    return "a file with 2 hard links; expected a file"


def symbolic(path, canary):
    path.symlink_to(canary / "file")
    return "a symbolic link; expected a file"


def dangling(path, canary):
    path.symlink_to(canary / "missing")
    return "a symbolic link; expected a file"


def pipe(path, canary):
    os.mkfifo(path)
    return "a named pipe; expected a file"


def folder(path, canary):
    path.mkdir()
    return "a folder; expected a file"


def other(path, canary):
    path.write_bytes(b"[mine]")
    return "a file with another content; expected a lock"


@pytest.mark.parametrize("put", [hard, symbolic, dangling, pipe, folder, other])
@pytest.mark.parametrize("command", ["run on", "run --force", "run --shard", "pack", "tune"])
def test_the_lock_follows_no_link(lay, canary, put, command):
    base, text = COMMANDS[command]
    names = {"run --shard": [LOCK, f"{LOCK}-1-1"], "tune": [f"{LOCK}-tune"]}
    for name in names.get(command, [LOCK]):
        out = lay(base)
        (out / name).unlink(missing_ok=True)  # what the first shard left
        what = put(out / name, canary)
        before, there = state(canary), state(out / name)
        assert call(text) == refusal_of(
            f"/{name}: is {what} that eqt wrote, or no such entry; rename or remove it"
        )
        assert state(canary) == before
        assert state(out / name) == there


def test_the_lock_of_a_killed_process_is_taken_over(tmp_path):
    for left in (b"", b'{"pi', b'{"pid": 1, "host": "a", "since": "2025"}'):
        (tmp_path / LOCK).write_bytes(left)
        with locked(tmp_path):
            assert holder(tmp_path)["pid"] == os.getpid()  # it is held
        assert not (tmp_path / LOCK).exists()


def test_nothing_is_written_before_the_lock_is_held(tmp_path):
    with locked(tmp_path):
        before = state(tmp_path)
        with pytest.raises(EqtError, match="another eqt"), locked(tmp_path):
            pass
        assert state(tmp_path) == before


def test_only_the_own_lock_is_removed(tmp_path):
    """Somebody removed it, and another process has made one of its own."""
    with locked(tmp_path):
        (tmp_path / LOCK).unlink()
        (tmp_path / LOCK).write_bytes(b"another's")
    assert (tmp_path / LOCK).read_bytes() == b"another's"


@pytest.mark.parametrize("step", ["ftruncate", "write"])
def test_a_lock_that_cannot_be_written(lay, monkeypatch, step):
    out = lay("begun")

    def fail(*_):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(f"eqt_cli.runs.lock.os.{step}", fail)
    done = call("run c.yaml --out OUT")
    monkeypatch.undo()
    said = ": cannot be used: input/output error; choose another folder with --out"
    assert done == refusal_of(said)
    assert kind_of(out / LOCK) is None


def test_a_lock_that_cannot_be_removed_ends_no_run(tmp_path, monkeypatch):
    def fail(*_, **__):
        raise OSError(errno.EIO, "Input/output error")

    with monkeypatch.context() as patch, locked(tmp_path):
        patch.setattr(Path, "unlink", fail)
    with locked(tmp_path):
        pass
