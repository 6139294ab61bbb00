"""`--help` of every command, as it stands in the folder help/.

The layout is that of the version of typer named in help/VERSION, and compared with it only;
`python tests/cli/test_help.py` writes the texts anew. What the texts say is checked with any.
"""

import os
import re
import shlex
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
import typer.main

from eqt_cli.cli.app import app

SNAPSHOTS = Path(__file__).parent / "help"
VERSION = (SNAPSHOTS / "VERSION").read_text(encoding="utf-8").strip()


def commands():
    """Every command by its words: ``""`` for eqt itself, ``config new``."""

    def below(words, command):
        yield words, command
        for name, inner in getattr(command, "commands", {}).items():
            yield from below(f"{words} {name}".strip(), inner)

    return below("", typer.main.get_command(app))


COMMANDS = dict(commands())


@pytest.fixture(autouse=True)
def wide(folder, monkeypatch):
    """The width of the kept texts."""
    monkeypatch.setenv("COLUMNS", "100")


def snapshot(words):
    return SNAPSHOTS / ("_".join(["eqt", *words.split()]) + ".txt")


def as_kept(text):
    return "\n".join(line.rstrip() for line in text.strip("\n").splitlines()) + "\n"


@pytest.mark.needs
@pytest.mark.skipif(version("typer") != VERSION, reason=f"the texts are of typer {VERSION}")
@pytest.mark.parametrize("words", COMMANDS)
def test_help_is_as_kept(eqt, words):
    done = eqt(*words.split(), "--help")
    assert (done.code, done.err) == (0, "")
    assert as_kept(done.out) == snapshot(words).read_text(encoding="utf-8")


@pytest.mark.needs
def test_there_is_a_text_for_every_command():
    assert {path.name for path in SNAPSHOTS.glob("*.txt")} == {
        snapshot(words).name for words in COMMANDS
    }


@pytest.mark.parametrize("words", COMMANDS)
def test_help_names_and_explains_every_argument_and_option(eqt, words):
    done = eqt(*words.split(), "--help")
    assert (done.code, done.err) == (0, "")
    shown = " ".join(done.out.replace("│", " ").split())
    for parameter in COMMANDS[words].params:
        if parameter.name in ("install_completion", "show_completion"):
            continue  # typer's own
        if getattr(parameter, "hidden", False):
            continue  # there only to be refused in words
        assert parameter.help
        assert parameter.help in shown
        for name in (option for option in parameter.opts if option.startswith("-")):
            assert name in shown
    texts = re.findall(r"^ +(--\w\S*)", COMMANDS[words].callback.__doc__ or "", re.M)
    assert {*texts} <= {name for each in COMMANDS[words].params for name in each.opts}


@pytest.mark.parametrize("words", COMMANDS)
def test_help_ends_with_an_example_that_parses(words):
    start, arguments = f"Example: eqt {words}".strip(), COMMANDS[words].epilog
    assert arguments.startswith(f"{start} ")
    given = shlex.split(arguments.removeprefix(start).partition(">")[0])
    COMMANDS[words].make_context(words, given)  # which refuses what is no option of it


def test_help_is_short_for_minus_h(eqt):
    assert eqt("run", "-h") == eqt("run", "--help")


if __name__ == "__main__":
    environment = {**os.environ, "COLUMNS": "100", "NO_COLOR": "1", "PYTHONIOENCODING": "utf-8"}
    for path in SNAPSHOTS.glob("*.txt"):
        path.unlink()
    for one in COMMANDS:
        command = [sys.executable, "-m", "eqt_cli", *one.split(), "--help"]
        done = subprocess.run(
            command, capture_output=True, encoding="utf-8", env=environment, check=True
        )
        text = done.stdout.replace("python -m eqt_cli", "eqt")
        snapshot(one).write_text(as_kept(text), encoding="utf-8")
    (SNAPSHOTS / "VERSION").write_text(version("typer") + "\n", encoding="utf-8")
