"""Carries out pages of the documentation, in this process.

Blocks of a page work in one folder, from top to bottom:

- `python` with a caption, or `yaml` with one, is a file of that name;
- `python` without is executed, with the names of the blocks before it;
- `yaml` without is a part of a configuration, which must be accepted in the place of the
  shipped paper's;
- `sh` is one command a line; ensembles of `eqt run`, `sweep` and `budget` and searches of `eqt
  tune` are made small, those of shipped configurations and of pages without `output` coarse,
  sweeps also short; figures are drawn in one format, and animations are brief;
- `output` is what the block before it prints, where … stands for any text.

A page can also be *read* only, which takes less than to carry it out: configurations are checked,
code is compiled, and of commands that compute or draw, the words are parsed.
"""

import contextlib
import importlib.util
import io
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import pytest
from plugin_sources import forget_plugins

from eqt_cli.base.yaml_source import dump, load
from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.config.study import study

BLOCK = re.compile(r"^(?P<fence>`{3,})(?P<head>[^\n]*)\n(?P<body>.*?)^(?P=fence)$", re.M | re.S)
CAPTION = re.compile(r"^:caption: (\S+)\n+", re.M)
PROGRESS = re.compile(r"^\d+/\d+ .*(?: left|: done in [^\n]*)\n", re.M)
EXTRAS = ("xarray", "mujoco", "pinocchio")
SMALL = ["--set=ensemble.runs=2", "--set=solver.cross_check=0"]
COARSE = ["--set=solver.rtol=1e-6", "--set=solver.error_estimate=false"]
FEW = ["--set=tune.budget=5", "--set=tune.samples=1", "--set=tune.confirm.runs=5"]
FEW_OF_A_FRONT = [
    *(f"--set=tune.{size}" for size in ("budget=10", "population=5", "seeds=1", "confirm.runs=5"))
]
FEWER = ["--set=worst.budget=1", "--set=worst.population=5", "--set=worst.seeds=1"]
SHORT = ["--set=time.duration=0.5", "--set=time.samples=11"]
BRIEF = {"plot": ("--format", "png"), "animate": ("--seconds", "0.5")}
"""Options of commands that draw, where a page names none."""
CHEAP = ("config", "list", "log", "--version")
"""Commands that are carried out where a page is only read."""


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, the file that it is, if any, and its text."""

    language: str
    file: str | None
    text: str


def blocks(page):
    """The fenced blocks of a page."""
    for block in BLOCK.finditer(page):
        language = re.sub(r"^\{code-block\}\s*", "", block["head"]).strip()
        caption = CAPTION.match(block["body"])
        text = block["body"][caption.end() :] if caption else block["body"]
        text = text.replace(" \\\n", " ") if language == "sh" else text
        yield Block(language, caption.group(1) if caption else None, text)


def computes(page):
    """Whether a page has a command that takes its time, or runs an experiment from Python."""
    texts = {
        language: "\n".join(block.text for block in blocks(page) if block.language == language)
        for language in ("sh", "python")
    }
    commands = re.findall(r"^eqt (\S+)", texts["sh"], re.M)
    return "eqt_cli.run(" in texts["python"] or any(name not in CHEAP for name in commands)


def carry_out(page):
    """All blocks of a page, in the current folder."""
    names, printed = {"__name__": "__main__"}, None
    shows_digits = any(block.language == "output" for block in blocks(page))
    for block in blocks(page):
        if block.file:
            Path(block.file).write_text(block.text, encoding="utf-8")
        elif block.language == "output":
            assert printed is None or matches(block.text, printed), f"printed:\n{printed}"
        elif any(name in block.text and not installed(name) for name in EXTRAS):
            printed = None
        elif block.language == "python":
            printed = run_python(block.text, names)
        elif block.language == "sh":
            lines = filter(None, block.text.splitlines())
            printed = "".join(run_command(line, shows_digits) for line in lines)
        elif block.language == "yaml":
            check_part(block.text)
        elif block.language.startswith("{literalinclude}"):
            printed = None  # another test runs the file


def read(page):
    """All blocks of a page, in the current folder, without what takes its time."""
    for block in blocks(page):
        if block.file:
            Path(block.file).write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            compile(block.text, "<page>", "exec")
        elif block.language == "sh":
            for line in filter(None, block.text.splitlines()):
                read_command(line)
        elif block.language == "yaml":
            check_part(block.text)


def installed(name):
    return importlib.util.find_spec(name) is not None


def matches(expected, printed):
    """Whether a text was printed, … standing for anything and blanks at the ends for nothing.

    Lines of progress, which only a slow machine prints, do not count.
    """
    lines = [line.rstrip() for line in expected.strip().splitlines()]
    pattern = re.escape("\n".join(lines)).replace("…", ".*?")
    shown = PROGRESS.sub("", printed).strip()
    text = "\n".join(line.rstrip() for line in shown.splitlines())
    return re.fullmatch(pattern, text, re.S) is not None


def run_python(text, names):
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(text, "<page>", "exec"), names)
    return out.getvalue()


def run_command(line, shows_digits=True):
    """What a command prints, on both streams; it fails unless the line says with what code."""
    words, expected, plain = taken_apart(line)
    mine = words[2:] and words[2].endswith(".yaml")
    shipped = mine and words[2].startswith("configs/")
    added = []
    if words[:2] == ["eqt", "sweep"] and mine:
        added = SMALL + SHORT + COARSE if shipped else []  # a page's own sweep is as it prints it
    elif words[:2] == ["eqt", "tune"] and shipped:
        added = [*SMALL, *(FEW_OF_A_FRONT if "objectives" in line else FEW), *SHORT]
    elif words[:2] == ["eqt", "tune"] and mine and "--dry-run" not in words:
        added = ["--set=tune.budget=6", "--set=tune.samples=1"]  # with which it may go on later
    elif words[:2] == ["eqt", "worst"] and shipped:
        added = [*SMALL, *FEWER, *SHORT]
    elif words[:2] == ["eqt", "live"]:
        added = SMALL if shipped else []
    elif words[:2] == ["eqt", "budget"]:
        added = ["--set=ensemble.runs=5", *COARSE]
    elif words[:2] == ["eqt", "run"] and mine:
        added = [*SMALL, *([] if shows_digits and not shipped else COARSE)]
    elif words[0] == "eqt" and words[1] in BRIEF and BRIEF[words[1]][0] not in words:
        added = BRIEF[words[1]]
    words = [*without_keys_of(added, words), *added]
    code, printed = called(words[1:]) if plain else shell(line)
    too_few = shipped_runs_are_few(words, printed)
    assert code == expected or too_few, f"{line}\nexit code {code}\n{printed}"
    return printed


def without_keys_of(added, words):
    """The words without settings of keys that others set, since a key may be set once."""
    keys = {word.split("=")[1] for word in added if word.startswith("--set=")}
    kept = []
    for word in words:
        if kept[-1:] == ["--set"] and word.partition("=")[0] in keys:
            kept.pop()
        elif not (word.startswith("--set=") and word.split("=")[1] in keys):
            kept.append(word)
    return kept


def shipped_runs_are_few(words, printed):
    """Whether a map of winners is refused only since `SMALL` left two runs of the page's 200."""
    return "winners" in words and "with 2 runs nobody can" in printed


def read_command(line):
    """Cheap commands are carried out; of others, the words and the changes are accepted."""
    words, expected, plain = taken_apart(line)
    if not plain:
        return
    checks = words[1:3] == ["config", "check"] and expected == 0
    if words[1] in CHEAP and not checks:
        run_command(line)
        return
    accept(words[1:])
    sets = tuple(change for flag, change in pairwise(words) if flag == "--set")
    target = "".join(words[3:4] if checks else words[2:3])
    is_users = target.endswith(".yaml") and not target.startswith("configs/")
    made = target.startswith("results/")  # by a command before it, which was not carried out
    computing = (checks or words[1] in ("run", "sweep", "tune", "worst")) and not made
    if expected == 0 and computing and (is_users or sets):
        study(read_config(Path(target), sets))


def taken_apart(line):
    """The words of a line, its exit code, and whether it is `eqt` alone."""
    command, _, comment = line.partition("  # exit code ")
    words = [
        path
        for word in shlex.split(command)
        for path in (sorted(map(str, Path().glob(word))) if word.endswith("*.csv") else [word])
    ]
    return words, int(comment or 0), words[0] == "eqt" and not set(command) & set("|>")


def accept(words):
    """Have the command line parsed, and nothing done."""
    import typer

    from eqt_cli.cli.app import app

    command, context = typer.main.get_command(app), None
    while True:
        context = command.make_context("eqt", list(words), parent=context)
        rest = [*context._protected_args, *context.args]  # of a group, what its command is given
        if not hasattr(command, "resolve_command"):
            return
        _, command, words = command.resolve_command(context, rest)


def shell(line):
    eqt = f'eqt() {{ "{sys.executable}" -m eqt_cli "$@"; }}; '
    done = subprocess.run(
        ["sh", "-c", eqt + line], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    return done.returncode, done.stdout


def called(arguments):
    """The exit code of `eqt`, called with these arguments, and what it prints."""
    from eqt_cli.cli import main

    out, before, code = io.StringIO(), sys.argv, 0
    sys.argv = ["eqt", *arguments]
    try:
        with (
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(out),
            without_plugins(stranger=False),
        ):
            main()
    except SystemExit as end:
        code = end.code or 0
    finally:
        sys.argv = before
    return code, out.getvalue()


@contextlib.contextmanager
def without_plugins(*, stranger=True):
    """As a process that has loaded none; those that are loaded here are forgotten afterwards."""
    with pytest.MonkeyPatch.context() as patch:
        forget_plugins(patch, stranger=stranger)
        yield


def check_part(text):
    """A part of a configuration fits into the paper's."""
    part = load(text, "part").data
    whole = load(Path("configs/paper.yaml").read_text(encoding="utf-8"), "paper").data | part
    task = part.get("task")
    if task == "stabilise" or (isinstance(task, dict) and "at" in task):
        del whole["reference"]
    Path("part.yaml").write_text(dump(whole), encoding="utf-8")
    check = study if "sweep" in part else build
    check(read_config(Path("part.yaml"), ()))
