"""The errors that eqt raises on purpose; it knows nothing of how a command prints them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches


class EqtError(Exception):
    """Anything that a user can mend; commands print it and exit with `exit_code`."""

    exit_code = 2


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

    def __str__(self) -> str:
        location = f"{self.place}: " if self.place else ""
        return f"{location}{self.path}: {self.message}" if self.path else location + self.message


class InterruptedRun(EqtError):
    """A run that its user has stopped."""

    exit_code = 130


class ConfigError(EqtError):
    """Every problem found in one configuration, together."""

    def __init__(self, problems: Iterable[InputProblem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(map(str, self.problems)))


def suggestion(word: str, known: Iterable[str]) -> str:
    """`; did you mean 'x'?` for the known word closest to `word`, whatever its case, or nothing."""
    by_lower = {name.lower(): name for name in known}
    close = get_close_matches(word.lower(), list(by_lower), n=1, cutoff=0.6)
    return f"; did you mean '{by_lower[close[0]]}'?" if close else ""
