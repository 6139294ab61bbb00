"""Usage errors, reported in the form of all other errors; this module knows no command."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import typer

from eqt_cli.core.errors import EqtError, suggestion

_UsageError: type[Exception] = typer.BadParameter.__mro__[1]
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
        raise EqtError(f"{_told(error, context)}; see `eqt{below} --help`") from None


def _told(error: Any, context: Any) -> str:
    parameter = getattr(error, "param", None)
    name = "" if parameter is None else _name(parameter)
    if type(error).__name__ == "MissingParameter":
        return f"{name}: missing"
    said = error.message
    for pattern, words in _REWRITTEN:
        if found := re.fullmatch(pattern, said):
            told = found.expand(words)
            break
    typed = getattr(error, "option_name", None) or (found and found.groups() and found[1]) or ""
    hint = _hint(typed, context) if told.startswith("unknown ") and not name else ""
    given = f", got '{_given(parameter)}'" if told.startswith("expected ") and name else ""
    return ": ".join(filter(None, [name, told + given + hint]))


def _given(parameter: Any) -> str:
    """Return the last value of an option, written ``--option value`` or ``--option=value``."""
    options, values = tuple(parameter.opts), sys.argv[1:]
    for before, value in reversed([*zip(["", *values], values, strict=False)]):
        if before in options:
            return value
        if value.startswith(tuple(f"{option}=" for option in options)):
            return value.partition("=")[2]
    return ""


def _name(parameter: Any) -> str:
    """Return an option as typed, or an argument as named in the help."""
    return str(parameter.opts[0] if parameter.param_type_name == "option" else parameter.metavar)


def _hint(typed: str, context: Any) -> str:
    """Suggest an option or command similar to the unknown one."""
    if not typed.startswith("-"):
        return suggestion(typed, getattr(context.command, "commands", {}))
    options = [name.lstrip("-") for each in context.command.params for name in each.opts]
    return suggestion(typed.lstrip("-"), options).replace("'", "'--", 1)
