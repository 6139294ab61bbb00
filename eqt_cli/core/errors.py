"""Errors and warnings of eqt, with advice to the user."""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

from eqt_cli.core.printable import printable

Word = Callable[[str], str]
"""Returns how an argument is written: ``out=…`` in Python, ``--out`` in a command."""


def keyword(argument: str) -> str:
    """Return an argument as it is passed to a Python function."""
    return f"{argument}={'True' if argument in ('force', 'trust_plugins') else '…'}"


@dataclass(frozen=True)
class Remedy:
    """Advice to the user, perhaps to set an argument of the function or command.

    Attributes
    ----------
    advice
        The advice, with ``{}`` for the argument: ``choose another folder with {}``.
    argument
        The argument's name in Python.
    """

    advice: str
    argument: str = ""


OTHER_FOLDER = Remedy("choose another folder with {}", "out")
START_OVER = Remedy("start over with {}", "force")


def _advised(text: str, lines: Sequence[str], remedies: Sequence[Remedy], word: Word) -> str:
    """Return a text, the lines below it and the advice, all safe to show."""
    advice = ", or ".join(one.advice.replace("{}", word(one.argument), 1) for one in remedies)
    message = "\n".join(printable(line) for line in (text, *lines))
    return message + ("\n" if lines else "; ") + printable(advice) if advice else message


class _Message(Exception):
    """A message with remedies; `str` writes their arguments as in Python.

    Parameters
    ----------
    message
        One line; it may quote a file, because it is escaped when it is shown.
    lines
        Further lines, such as those of a list.
    """

    def __init__(self, message: str = "", *remedies: Remedy, lines: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.remedies, self.lines = remedies, tuple(lines)

    def with_advice(self, word: Word) -> str:
        """Return the error and the advice."""
        return _advised(str(self.args[0]), self.lines, self.remedies, word)

    def __str__(self) -> str:
        return self.with_advice(keyword)


class EqtError(_Message):
    """An error that the user can correct; commands print it and exit with `exit_code`."""

    exit_code = 2


class EqtWarning(_Message, UserWarning):
    """A remark that the user should know, which is no error."""


class InputError(EqtError):
    """An invalid value; `Problems.catching` notes it with its place in the input."""


class ExpressionError(InputError):
    """An expression that does not parse; `column` counts from 1 within the expression."""

    def __init__(self, message: str, column: int) -> None:
        super().__init__(message)
        self.column = column


class ComponentError(InputError):
    """A group, controller, reference, engine or figure that does not exist or cannot be loaded."""


class TraceError(EqtError):
    """A law that an engine cannot compile: it has an unknown operation, or no compiler is found."""


class ResultError(EqtError):
    """A result file or folder that cannot be read, written or trusted."""


class FullDiskError(ResultError):
    """A file for which the disk or a quota has no space left."""


@dataclass(frozen=True)
class InputProblem:
    """One error of a configuration: its key (`path`, as `solver.method`), message and place."""

    path: str
    message: str
    place: str = ""
    remedies: tuple[Remedy, ...] = ()

    def with_advice(self, word: Word) -> str:
        """Return the error and the advice."""
        return _advised(self.message, (), self.remedies, word)

    def __str__(self) -> str:
        return self.located(keyword)

    def located(self, word: Word) -> str:
        """Return the place and the path, followed by the text of `with_advice`."""
        before = "".join(f"{part}: " for part in (self.place, self.path) if part)
        return printable(before) + self.with_advice(word)


class InterruptedRun(EqtError):
    """A run that was stopped, with the exit code that belongs to the signal."""

    def __init__(self, message: str, exit_code: int, lines: Sequence[str] = ()) -> None:
        super().__init__(message, lines=lines)
        self.exit_code = exit_code


class ConfigError(EqtError):
    """All errors found in one configuration."""

    def __init__(self, problems: Iterable[InputProblem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(map(str, self.problems)))

    @property
    def heading(self) -> str:
        """The number of errors and their files: ``7 errors in bad.yaml``.

        Empty for a single error outside of a file, as in an option.
        """
        placed = [problem for problem in self.problems if problem.place or problem.path]
        place = re.compile(r"(:\d+){1,2}$|\[\d+\]$")
        names = dict.fromkeys(place.sub("", one.place) for one in placed if one.place)
        if len(placed) == 1 and not re.search(r":\d+:\d+$", placed[0].place):
            return ""
        more = "more than " if len(placed) < len(self.problems) else ""
        count = f"{len(placed)} error{'' if len(placed) == 1 else 's'}"
        return f"{more}{count}{' in ' if names else ''}{' and '.join(map(printable, names))}"

    def with_advice(self, word: Word) -> str:
        """Return every error with its place and the advice."""
        return "\n".join(problem.located(word) for problem in self.problems)


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return `; did you mean 'x'?` for the known word closest to `word`, or an empty text."""
    by_lower = {name.lower(): name for name in known}
    close = get_close_matches(word.lower(), list(by_lower), n=1, cutoff=0.6)
    return f"; did you mean '{by_lower[close[0]]}'?" if close else ""
