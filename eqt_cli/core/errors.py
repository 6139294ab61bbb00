"""The errors that eqt raises on purpose; it knows nothing of how a command prints them."""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

from eqt_cli.core.printable import printable

Word = Callable[[str], str]
"""How an argument is written: ``out=…`` in Python, ``--out`` in a command."""


def keyword(argument: str) -> str:
    """An argument as a Python function takes it."""
    return f"{argument}={'True' if argument in ('force', 'trust_plugins') else '…'}"


@dataclass(frozen=True)
class Remedy:
    """What a user can do, perhaps by an argument of the function or command that was called.

    Attributes
    ----------
    advice
        With ``{}`` where the argument stands: ``choose another folder with {}``.
    argument
        By its name in Python.
    """

    advice: str
    argument: str = ""


OTHER_FOLDER = Remedy("choose another folder with {}", "out")
START_OVER = Remedy("start over with {}", "force")


def _advised(text: str, lines: Sequence[str], remedies: Sequence[Remedy], word: Word) -> str:
    """A text, the lines below it, and what can be done about it; all of it can be shown."""
    advice = ", or ".join(one.advice.replace("{}", word(one.argument), 1) for one in remedies)
    told = "\n".join(printable(line) for line in (text, *lines))
    return told + ("\n" if lines else "; ") + printable(advice) if advice else told


class _Message(Exception):
    """A text with remedies; the arguments in them are written as a Python function takes them.

    Parameters
    ----------
    message
        One line; it may hold what was found in a file, since it is escaped when it is told.
    lines
        Further lines, such as those of a list.
    """

    def __init__(self, message: str = "", *remedies: Remedy, lines: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.remedies, self.lines = remedies, tuple(lines)

    def told(self, word: Word) -> str:
        """What is wrong, and what to do about it."""
        return _advised(str(self.args[0]), self.lines, self.remedies, word)

    def __str__(self) -> str:
        return self.told(keyword)


class EqtError(_Message):
    """Anything that a user can mend; commands print it and exit with `exit_code`."""

    exit_code = 2


class EqtWarning(_Message, UserWarning):
    """What a user should know, and no error is."""


class InputError(EqtError):
    """A value that will not do; `Problems.catching` notes it with its place in the input."""


class ExpressionError(InputError):
    """An expression that does not parse; `column` counts from 1 within the expression."""

    def __init__(self, message: str, column: int) -> None:
        super().__init__(message)
        self.column = column


class ComponentError(InputError):
    """A group, controller, reference, engine or figure that does not exist or cannot be loaded."""


class TraceError(EqtError):
    """A law that an engine cannot compile: for an operation in it, or for lack of a compiler."""


class ResultError(EqtError):
    """A result file or folder that cannot be read, written or trusted."""


class FullDiskError(ResultError):
    """A file that the disk, or a quota, has no room for."""


@dataclass(frozen=True)
class InputProblem:
    """One thing wrong with a configuration: where (`path`, as `solver.method`) and what."""

    path: str
    message: str
    place: str = ""
    remedies: tuple[Remedy, ...] = ()

    def told(self, word: Word) -> str:
        """What is wrong, and what to do about it."""
        return _advised(self.message, (), self.remedies, word)

    def __str__(self) -> str:
        return self.located(keyword)

    def located(self, word: Word) -> str:
        """As `told`, after the place and the path."""
        before = "".join(f"{part}: " for part in (self.place, self.path) if part)
        return printable(before) + self.told(word)


class InterruptedRun(EqtError):
    """A run that was told to stop, with the exit code that goes with what told it."""

    def __init__(self, message: str, exit_code: int, lines: Sequence[str] = ()) -> None:
        super().__init__(message, lines=lines)
        self.exit_code = exit_code


class ConfigError(EqtError):
    """Every problem found in one configuration, together."""

    def __init__(self, problems: Iterable[InputProblem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(map(str, self.problems)))

    @property
    def heading(self) -> str:
        """How many errors there are, and in what: ``7 errors in bad.yaml``.

        Nothing for a single one that is in no file, as in an option.
        """
        placed = [problem for problem in self.problems if problem.place or problem.path]
        place = re.compile(r"(:\d+){1,2}$|\[\d+\]$")
        names = dict.fromkeys(place.sub("", one.place) for one in placed if one.place)
        if len(placed) == 1 and not re.search(r":\d+:\d+$", placed[0].place):
            return ""
        more = "more than " if len(placed) < len(self.problems) else ""
        count = f"{len(placed)} error{'' if len(placed) == 1 else 's'}"
        return f"{more}{count}{' in ' if names else ''}{' and '.join(map(printable, names))}"

    def told(self, word: Word) -> str:
        """Every problem with its place, and what to do about it."""
        return "\n".join(problem.located(word) for problem in self.problems)


def suggestion(word: str, known: Iterable[str]) -> str:
    """`; did you mean 'x'?` for the known word closest to `word`, whatever its case, or nothing."""
    by_lower = {name.lower(): name for name in known}
    close = get_close_matches(word.lower(), list(by_lower), n=1, cutoff=0.6)
    return f"; did you mean '{by_lower[close[0]]}'?" if close else ""
