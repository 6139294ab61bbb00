"""The tree of commands, and usage errors in the form of all other errors."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Annotated, Any

import typer
from typer.main import get_group

from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError, EqtWarning, suggestion
from eqt_cli.base.extensions import (
    COMPUTE,
    LOOK_UP,
    READ,
    START,
    CommandPlace,
    Extension,
    functions_for,
    imported,
    shipped,
    usable,
)
from eqt_cli.base.process import drop_stdout
from eqt_cli.base.reporting import reporter
from eqt_cli.base.version import __version__
from eqt_cli.cli.options import Command, Group, example, spread

_UsageError: Any = typer.BadParameter.__base__
"""Usage error of the parser; typer's own or click's, depending on the version of typer."""

_REWRITTEN = (
    (r"No such command '([^']*)'.*", r"unknown command '\1'"),
    (r"No such option: (.*)", r"unknown option \1"),
    (r"Got unexpected extra arguments?(?:\(s\))? \((.*)\)", r"unexpected argument: \1"),
    (r"Option '(.*)' requires an argument\.", r"\1: expected a value"),
    (r"Option '(.*)' does not take a value\.", r"\1: takes no value"),
    (r"Input should be a valid integer.*", "expected a whole number"),
    (r"Input should be a valid number.*", "expected a number"),
    (r"Input should be greater than or equal to (.*)", r"expected at least \1"),
    (r"(?:Value error, )?'(.*)' is not one of (.*)\.", r"unknown value '\1'; known: \2"),
    (r"(?s)(?:Value error, )?(.*?)\.?", r"\1"),
)
"""Patterns of parser messages, and eqt's wording; the first match is used."""


@contextmanager
def in_words() -> Iterator[None]:
    """Raise an `EqtError` for a usage error of the parser."""
    try:
        yield
    except _UsageError as error:
        if type(error).__name__ == "NoArgsIsHelpError":  # the help page, not an error
            raise
        context: Any = getattr(error, "ctx", None)
        below = context.command_path.removeprefix(context.find_root().info_name) if context else ""
        raise EqtError(f"{_usage_message(error, context)}; see `eqt{below} --help`") from None


def _usage_message(error: Any, context: Any) -> str:
    parameter, name = getattr(error, "param", None), ""
    if parameter is not None:  # as it is typed, or an argument as the help names it
        is_option = parameter.param_type_name == "option"
        name = str(parameter.opts[0] if is_option else parameter.metavar or parameter.name)
    if type(error).__name__ == "MissingParameter":
        create = "; try `eqt config new --vehicle satellite --inertia 2,3,4 --bandwidth 1`"
        return f"{name}: missing{create if 'CONFIG' in name else ''}"
    for pattern, words in _REWRITTEN:
        if match := re.fullmatch(pattern, error.message):
            message = match.expand(words)
            break
    if name:
        got = f", got '{_typed_value(parameter)}'" if message.startswith("expected ") else ""
        return f"{name}: {message}{got}"
    typed = getattr(error, "option_name", None) or (match and match.groups() and match[1]) or ""
    return message + (_hint(typed, context) if message.startswith("unknown ") else "")


def _typed_value(parameter: Any) -> str:
    """Return the last value of an option, written ``--option value`` or ``--option=value``."""
    options, values = tuple(parameter.opts), sys.argv[1:]
    for before, value in reversed([*zip(["", *values], values, strict=False)]):
        if before in options:
            return value
        if value.startswith(tuple(f"{option}=" for option in options)):
            return value.partition("=")[2]
    return ""


def _hint(typed: str, context: Any) -> str:
    """Suggest an option or command similar to the unknown one."""
    if not typed.startswith("-"):
        lead = "".join(hint(typed) for hint in functions_for(purposes.command_for_a_word))
        return lead or suggestion(typed, getattr(context.command, "commands", {}))
    value = typed.lstrip("-")
    for parameter in context.command.params:  # a format typed as an option, such as --latex
        if "--format" in parameter.opts and value in re.findall(r"\w+", parameter.help or ""):
            return f"; did you mean '--format {value}'?"
    offered = (one for one in context.command.params if one.param_type_name == "option")
    options = [name.lstrip("-") for parameter in offered for name in parameter.opts]
    return suggestion(typed.lstrip("-"), options).replace("'", "'--", 1)


MOST_COLUMNS = 1000
"""Maximum width assumed of the terminal, since lines are padded with spaces to their width."""


_CORE = {
    "run": ("eqt_cli.cli.run.run", START, "configs/paper.yaml --set gains.kp=2"),
    "sweep": ("eqt_cli.cli.run.sweep", START, "configs/paper.yaml --grid gains.kp=1,2"),
    "plot": ("eqt_cli.cli.plot.plot", START, "results/paper --figure torque --format pdf"),
    "compare": ("eqt_cli.cli.compare.compare", START, "results/paper --metric mean_torque"),
    "pack": ("eqt_cli.cli.run.pack", COMPUTE, "results/sweep_gains"),
    "show": ("eqt_cli.cli.show.show", READ, "results/paper --failed"),
    "results": ("eqt_cli.cli.show.results", READ, "results"),
    "list": ("eqt_cli.cli.lookup.list_components", LOOK_UP, "controllers"),
    "config": ("eqt_cli.cli.lookup.app", LOOK_UP, ""),
}


def with_commands(extensions: Iterable[Extension]) -> dict[str, CommandPlace]:
    """Return the commands of eqt and of extensions, in the order of the help."""
    listed = [(name, CommandPlace(*row)) for name, row in _CORE.items()]
    for extension in extensions:
        for name, place in extension.commands.items():
            names = [other for other, _ in listed]
            if name in names:
                exists = f"extension '{extension.name}': eqt has a command '{name}'; rename yours"
                reporter().remark(EqtWarning(exists))
                continue
            panels = [other.panel for _, other in listed]
            last = len(panels) - panels[::-1].index(place.panel)
            at = names.index(place.after) + 1 if place.after in names else last
            listed.insert(at, (name, place))
    return dict(listed)


COMMANDS = with_commands(shipped())
"""The commands of eqt, in the order of the help."""


@cache
def all_commands() -> dict[str, CommandPlace]:
    """Return the commands, also those of other distributions."""
    return with_commands(usable())


class _Commands(Group):
    """The commands, each built when it is asked for, since all of them take 0.1 s.

    A reader may close their output early.
    """

    @property
    def commands(self) -> Any:
        """All commands by name."""
        return {name: self.get_command(None, name) for name in all_commands()}

    @commands.setter
    def commands(self, none: Any) -> None:
        self._built = none

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command; None if there is none of this name."""
        if cmd_name not in self._built:
            # Other distributions are looked for last, since that takes 30 ms.
            commands = COMMANDS if cmd_name in COMMANDS else all_commands()
            if cmd_name in commands:
                self._built[cmd_name] = _command(cmd_name, commands[cmd_name])
        return self._built.get(cmd_name)

    def main(self, *args: Any, **extra: Any) -> Any:
        """Run a command, with the width of the terminal limited to a plausible one."""
        columns = os.environ.get("COLUMNS", "")
        if columns.isdecimal() and (len(columns) > 9 or int(columns) > MOST_COLUMNS):
            os.environ["COLUMNS"] = str(MOST_COLUMNS)
        try:
            return super().main(*args, **extra)
        except SystemExit as end:
            if isinstance(end.__context__, BrokenPipeError):  # the reader of a help page has left
                raise SystemExit from None
            raise

    def make_context(self, *args: Any, **extra: Any) -> Any:
        """Read the options of eqt itself."""
        with in_words():
            return super().make_context(*args, **extra)

    def invoke(self, ctx: Any) -> Any:
        try:
            try:
                with in_words():
                    return super().invoke(ctx)
            finally:
                ctx.close()
                sys.stdout.flush()
        except BrokenPipeError as error:  # the reader of our output has left, as `head` does
            # Writing the rest at the end of the process must not fail again.
            drop_stdout()
            raise typer.Exit(getattr(error.__context__, "exit_code", 0)) from None


# Given to each command, too: it keeps its options of help from the first time it is looked at.
_HELP = {"help_option_names": ["-h", "--help"]}

app = typer.Typer(
    name="eqt",
    cls=_Commands,
    help="Simulate tracking control laws from one YAML file, and compare them run by run.",
    epilog=example("eqt", "run configs/paper.yaml"),
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings=_HELP,
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"eqt {__version__}")
        raise typer.Exit


@app.callback()
def main(
    version: Annotated[
        bool,
        typer.Option(
            "--version", metavar="", callback=_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """Simulate tracking control laws from one YAML file, and compare them run by run."""


def _command(name: str, place: CommandPlace) -> Any:
    """Return a command, or a group of commands."""
    function, alone = imported(place.function), typer.Typer()
    if isinstance(function, typer.Typer):
        alone.add_typer(function, name=name, rich_help_panel=place.panel, context_settings=_HELP)
    else:
        epilog = example(f"eqt {name}", place.example)
        texts: Any = {"rich_help_panel": place.panel, "epilog": epilog, "context_settings": _HELP}
        alone.command(name, cls=Command, **texts)(spread(function))
    return get_group(alone).commands[name]
