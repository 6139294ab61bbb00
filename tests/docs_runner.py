"""Carries out pages of the documentation: lines of PAGE, a tab, and FOLDER on standard input.

It answers each with the exit code of the page, whose output is then in FOLDER/.said.

Blocks of a page work in one folder, from top to bottom:

- `python` with a caption, or `yaml` with one, is a file of that name;
- `python` without is executed, with the names of the blocks before it;
- `yaml` without is a part of a configuration, which must be accepted in the place of the
  shipped paper's;
- `sh` is one command a line; ensembles of `eqt run`, and of shipped sweeps, are made small, and
  such sweeps short;
- `output` is what the block before it prints, where … stands for any text.

Each page, and each `eqt` command of one, runs in a process of its own, forked from this one, which
has loaded the libraries already: to load them takes longer than most commands.
"""

import contextlib
import importlib
import importlib.util
import io
import os
import pkgutil
import re
import shlex
import subprocess
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

BLOCK = re.compile(r"^(?P<fence>`{3,})(?P<head>[^\n]*)\n(?P<body>.*?)^(?P=fence)$", re.M | re.S)
CAPTION = re.compile(r"^:caption: (\S+)\n+", re.M)
LIBRARIES = (
    "h5py",
    "heyoka",
    "matplotlib.backends.backend_pdf",
    "matplotlib.backends.backend_svg",
    "matplotlib.figure",
    "scipy.integrate",
    "xarray",
    "yaml",
)
EXTRAS = ("xarray", "heyoka", "mujoco", "pinocchio")
SMALL = ["--set", "ensemble.runs=2"]
FEW = ["--set=tune.budget=2", "--set=tune.population=5", "--set=tune.confirm.runs=5"]
SHORT = ["--set=time.duration=0.5", "--set=time.samples=11", "--set=solver.cross_check=0"]


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, the file that it is, if any, and its text."""

    language: str
    file: str | None
    text: str


def blocks(page):
    """The fenced blocks of a page."""
    for found in BLOCK.finditer(page):
        language = re.sub(r"^\{code-block\}\s*", "", found["head"]).strip()
        caption = CAPTION.match(found["body"])
        text = found["body"][caption.end() :] if caption else found["body"]
        yield Block(language, caption.group(1) if caption else None, text)


def carry_out(page):
    """All blocks of a page, in the current folder."""
    names, printed = {"__name__": "__main__"}, None
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
            printed = "".join(run_command(line) for line in block.text.splitlines() if line)
        elif block.language == "yaml":
            check_part(block.text)


def installed(name):
    return importlib.util.find_spec(name) is not None


def matches(expected, printed):
    """Whether a text was printed, … standing for anything and blanks at the ends for nothing."""
    lines = [line.rstrip() for line in expected.strip().splitlines()]
    pattern = re.escape("\n".join(lines)).replace("…", ".*?")
    text = "\n".join(line.rstrip() for line in printed.strip().splitlines())
    return re.fullmatch(pattern, text, re.S) is not None


def run_python(text, names):
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        exec(compile(text, "<page>", "exec"), names)
    return out.getvalue()


def run_command(line):
    """What a command prints, on both streams; it fails unless the line says with what code."""
    line, _, comment = line.partition("  # exit code ")
    words = shlex.split(line)
    if words[:2] == ["eqt", "sweep"] and words[2].startswith("configs/"):
        words += [*SMALL, *SHORT]
    elif words[:2] == ["eqt", "tune"] and words[2].startswith("configs/"):
        words += [*SMALL, *FEW, *SHORT]
    elif words[:2] == ["eqt", "run"] and words[2].endswith(".yaml"):
        words += SMALL  # what is tested is that the command works, not how long it takes
    expected = int(comment or 0)
    plain = words[0] == "eqt" and not set(line) & set("|>")
    code, printed = forked(words[1:]) if plain else shell(line)
    assert code == expected, f"{line}\nexit code {code}\n{printed}"
    return printed


def shell(line):
    eqt = f'eqt() {{ "{sys.executable}" -m eqt_cli "$@"; }}; '
    done = subprocess.run(
        ["sh", "-c", eqt + line], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    return done.returncode, done.stdout


def forked(arguments):
    """`eqt` with these arguments, without the time it takes to start."""
    from eqt_cli.cli import main

    sys.argv = ["eqt", *arguments]
    return in_a_process(main, Path(".printed"))


def in_a_process(work: Callable[[], object], file: Path) -> tuple[int, str]:
    """The exit code of a function in a process forked from this one, and what it prints."""
    with file.open("w+", encoding="utf-8") as stream:
        child = os.fork()
        if child == 0:
            code = 1
            try:
                os.dup2(stream.fileno(), 1)
                os.dup2(stream.fileno(), 2)
                code = exit_code(work)
                sys.stdout.flush()
                sys.stderr.flush()
            finally:
                os._exit(code)
        _, status = os.waitpid(child, 0)
        stream.seek(0)
        return os.waitstatus_to_exitcode(status), stream.read()


def exit_code(work: Callable[[], object]) -> int:
    try:
        work()
    except SystemExit as end:
        return end.code or 0
    except BaseException:
        traceback.print_exc()
        return 1
    return 0


def check_part(text):
    """A part of a configuration fits into the paper's."""
    from eqt_cli.config.source import read_config
    from eqt_cli.config.yaml_source import dump, load
    from eqt_cli.experiment.build import build

    part = load(text, "part").data
    whole = load(Path("configs/paper.yaml").read_text(encoding="utf-8"), "paper").data | part
    if part.get("task") == "stabilise":
        del whole["reference"]
    Path("part.yaml").write_text(dump(whole), encoding="utf-8")
    build(read_config(Path("part.yaml"), ()))


def load():
    """All modules of eqt, and the libraries that they load when they are needed."""
    import eqt_cli

    for name in LIBRARIES:
        if installed(name.partition(".")[0]):
            importlib.import_module(name)
    for module in pkgutil.walk_packages(eqt_cli.__path__, "eqt_cli."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)


def carried_out(page: Path, folder: Path) -> None:
    text = page.read_text(encoding="utf-8")
    os.chdir(folder)
    carry_out(text)


if __name__ == "__main__":
    load()
    for line in sys.stdin:
        page, folder = map(Path, line.rstrip("\n").split("\t"))
        code, _ = in_a_process(lambda: carried_out(page, folder), folder / ".said")  # noqa: B023
        print(code, flush=True)
