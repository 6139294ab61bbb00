"""`--help` of every command: what it names, explains and shows."""

import re
import shlex

import pytest
import typer.main

from eqt_cli.cli.app import app

WIDTH = 100


def commands():
    """Every command by its words: ``""`` for eqt itself, ``config new``."""

    def below(words, command):
        yield words, command
        for name, inner in getattr(command, "commands", {}).items():
            yield from below(f"{words} {name}".strip(), inner)

    return below("", typer.main.get_command(app))


COMMANDS = dict(commands())


def summary(command):
    """The first paragraph of the text of a command."""
    return " ".join(command.help.partition("\n\n")[0].split())


@pytest.fixture(autouse=True)
def wide(folder, monkeypatch):
    monkeypatch.setenv("COLUMNS", str(WIDTH))


@pytest.mark.parametrize("words", COMMANDS)
def test_help_names_and_explains_every_argument_and_option(eqt, words):
    done = eqt(*words.split(), "--help")
    assert (done.code, done.err) == (0, "")
    shown = " ".join(done.out.replace("│", " ").split())
    assert shown.startswith(f"Usage: eqt {words}".strip())
    assert max(map(len, done.out.splitlines())) <= WIDTH
    assert len(summary(COMMANDS[words])) > 10 and summary(COMMANDS[words]) in shown
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
