"""The errors that eqt raises on purpose; it knows nothing of how a command prints them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

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


def _advised(text: str, remedies: Sequence[Remedy], word: Word) -> str:
    """A text, and what can be done about it."""
    advice = ", or ".join(one.advice.replace("{}", word(one.argument), 1) for one in remedies)
    return text + ("\n" if "\n" in text else "; ") + advice if advice else text


class _Message(Exception):
    """A text with remedies; the arguments in them are written as a Python function takes them."""

    def __init__(self, message: str = "", *remedies: Remedy) -> None:
        super().__init__(message)
        self.remedies = remedies

    def told(self, word: Word) -> str:
        """What is wrong, and what to do about it."""
        return _advised(str(self.args[0]), self.remedies, word)

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
    """A law that uses an operation which an engine cannot compile."""


class ResultError(EqtError):
    """A result file or folder that cannot be read, written or trusted."""


@dataclass(frozen=True)
class InputProblem:
    """One thing wrong with a configuration: where (`path`, as `solver.method`) and what."""

    path: str
    message: str
    place: str = ""
    remedies: tuple[Remedy, ...] = ()

    def told(self, word: Word) -> str:
        """What is wrong, and what to do about it."""
        return _advised(self.message, self.remedies, word)

    def __str__(self) -> str:
        return self.located(keyword)

    def located(self, word: Word) -> str:
        """As `told`, after the place and the path."""
        return "".join(f"{part}: " for part in (self.place, self.path) if part) + self.told(word)


class InterruptedRun(EqtError):
    """A run that its user has stopped."""

    exit_code = 130


class ConfigError(EqtError):
    """Every problem found in one configuration, together."""

    def __init__(self, problems: Iterable[InputProblem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(map(str, self.problems)))

    def told(self, word: Word) -> str:
        """Every problem with its place, and what to do about it."""
        return "\n".join(problem.located(word) for problem in self.problems)


def suggestion(word: str, known: Iterable[str]) -> str:
    """`; did you mean 'x'?` for the known word closest to `word`, whatever its case, or nothing."""
    by_lower = {name.lower(): name for name in known}
    close = get_close_matches(word.lower(), list(by_lower), n=1, cutoff=0.6)
    return f"; did you mean '{by_lower[close[0]]}'?" if close else ""
