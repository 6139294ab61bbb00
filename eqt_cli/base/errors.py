"""Errors and warnings of eqt, with advice to the user.

The errors of an input are collected with their places, so that all are reported together. Text from
foreign files is made safe to show in a terminal or on a page: control characters can clear a screen
or forge a line, and bidirectional ones reorder text. They are shown as escapes of Python and YAML,
ESC as four characters from a backslash to 1b.
"""

import re
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches
from functools import lru_cache
from typing import Final, Self, TypeAlias


def escape(character: str) -> str:
    """Return the escape of a character in Python, and in double quotes of YAML."""
    return repr(character)[1:-1]


def printable(text: str, keep: str = "", escape: Callable[[str], str] = escape) -> str:
    """Return a text with escapes in place of invisible characters.

    Parameters
    ----------
    keep
        Characters that stay as they are, such as the line breaks of a text of many lines.
    escape
        Returns the escape of a character.
    """
    if text.isprintable():
        return text
    return "".join(
        # All spaces have a width.
        c if c in keep or c.isprintable() or unicodedata.category(c) == "Zs" else escape(c)
        for c in text
    )


Word = Callable[[str], str]
"""Returns how an argument is written: ``out=…`` in Python, ``--out`` in a command."""


def keyword(argument: str) -> str:
    """Return an argument as it is passed to a Python function."""
    return f"{argument}={'True' if argument in ('force', 'grow', 'trust_plugins') else '…'}"


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
        """Return the error, the lines below it and the advice, all safe to show."""
        advice = ", or ".join(r.advice.replace("{}", word(r.argument), 1) for r in self.remedies)
        message = "\n".join(printable(line) for line in (str(self.args[0]), *self.lines))
        return message + ("\n" if self.lines else "; ") + printable(advice) if advice else message

    def __str__(self) -> str:
        return self.with_advice(keyword)


class EqtError(_Message):
    """An error that the user can correct; commands print it and exit with `exit_code`."""

    exit_code = 2


class EqtWarning(_Message, UserWarning):
    """A remark that the user should know, which is no error."""


class HarmWarning(EqtWarning):
    """A remark on what may damage a result, which commands also show with ``--quiet``."""


class InputError(EqtError):
    """An invalid value; `Problems.catching` notes it with its place in the input."""


class ExpressionError(InputError):
    """An expression that does not parse; `column` counts from 1 within the expression."""

    def __init__(self, message: str, column: int) -> None:
        super().__init__(message)
        self.column = column


class ComponentError(InputError):
    """A group, law, reference, engine or figure that does not exist or cannot be loaded."""


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
        return EqtError(self.message, *self.remedies).with_advice(word)

    def __str__(self) -> str:
        return self.located(keyword)

    def located(self, word: Word) -> str:
        """Return the place and the path, followed by the text of `with_advice`."""
        before = "".join(f"{x}: " for x in dict.fromkeys((self.place, self.path)) if x)
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


def alike(name: str, names: Iterable[str]) -> str | None:
    """Return the first of some names that equals a name but for capitals; files may not differ."""
    return next((candidate for candidate in names if candidate.casefold() == name.casefold()), None)


def bare(name: str) -> str:
    """Return the letters and digits of a name, small: ``so3`` of SO(3), SO₃ and so3."""
    plain = unicodedata.normalize("NFKC", name).casefold()
    return "".join(character for character in plain if character.isalnum())


def suggestion(word: str, names: Iterable[str]) -> str:
    """Return `; did you mean 'x'?` for the known word closest to `word`, or an empty text."""
    nearest = closest(word, names)
    return f"; did you mean '{nearest}'?" if nearest else ""


SAME_MEANING: Final[Mapping[str, str]] = {
    **dict.fromkeys(("at", "begin", "begins", "from", "start", "starts"), "since"),
    **dict.fromkeys(("end", "ends", "release", "released", "released_at", "stop"), "until"),
    "duration": "lasts",
}
"""Words for when something acts, and those that configurations have for them."""


def closest(word: str, names: Iterable[str]) -> str | None:
    """Return the known word that was probably meant; None if none is close."""
    by_lower = {name.lower(): name for name in names}
    if (same := SAME_MEANING.get(word.lower())) in by_lower:
        return by_lower[same]
    close = get_close_matches(word.lower(), list(by_lower), n=1, cutoff=0.6)
    return by_lower[close[0]] if close else None


KeyPath: TypeAlias = tuple[str | int, ...]
"""A place in an input: ``("controllers", 0, "label")``."""


MAX_PROBLEMS = 100
"""Largest number of errors of an input; the check ends after it."""


class Problems:
    """The errors at a place of an input and within it.

    A function that checks an input gets the problems of its place, and passes on those of inner
    places: ``problems.at("reference", "torque")``. All of them share one list.

    Parameters
    ----------
    located
        Returns ``file:line:column`` of a path, or the place where it was overridden.
    """

    def __init__(self, located: Callable[[KeyPath], str] = lambda path: "") -> None:
        self._located = located
        self._path: KeyPath = ()
        self._places: dict[InputProblem, KeyPath] = {}

    def at(self, *steps: str | int) -> Self:
        """Return the problems of a place within this one."""
        inner = type(self)(self._located)
        inner._path, inner._places = (*self._path, *steps), self._places
        return inner

    @property
    def path(self) -> str:
        """The place as users write it."""
        return dotted(self._path)

    def add(self, message: str, *remedies: Remedy) -> None:
        """Note an error at this place; the same error is noted once."""
        problem = InputProblem(self.path, message, self._located(self._path), remedies)
        self._places.setdefault(problem, self._path)
        if len(self._places) > MAX_PROBLEMS:
            first = sorted(list(self._places)[:MAX_PROBLEMS], key=_position)
            raise ConfigError(
                [*first, InputProblem("", f"and more; only the first {MAX_PROBLEMS} are shown")]
            )

    def include(self, inner: "Problems") -> None:
        """Note the errors of an input that is written at this place."""
        for problem, path in inner._places.items():
            self.at(*path).add(problem.message, *problem.remedies)

    @contextmanager
    def catching(self, *steps: str | int) -> Iterator[None]:
        """Note an `InputError` from the block at a place within this one, and continue."""
        try:
            yield
        except InputError as error:
            self.at(*steps).add(str(error.args[0]), *error.remedies)

    def __iter__(self) -> Iterator[InputProblem]:
        depth = len(self._path)
        return (problem for problem, path in self._places.items() if path[:depth] == self._path)

    def __bool__(self) -> bool:
        """Whether there is an error at this place or within it."""
        return any(True for _ in self)

    def raise_if_any(self) -> None:
        """Raise a `ConfigError` with all errors, in the order of the file, if there are any.

        What several keys share by a YAML anchor is told once.
        """
        if self:
            once = {(x.place or x.path, x.path.split(".")[-1], x.message): x for x in [*self][::-1]}
            listed = [*once.values()][::-1]
            raise ConfigError(sorted(listed, key=_position))


def _position(problem: InputProblem) -> tuple[str, int, int]:
    name, *ends = problem.place.rsplit(":", 2)
    if len(ends) == 2 and all(map(str.isdigit, ends)):
        return name, int(ends[0]), int(ends[1])
    return problem.place, 0, 0


def dotted(path: KeyPath) -> str:
    """Return a path as users write it, such as ``controllers[0].label``."""
    steps = (f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return "".join(steps).removeprefix(".")


@lru_cache(maxsize=256)
def parse_key(text: str) -> KeyPath:
    """Return the path of ``controllers[0].label``: ``("controllers", 0, "label")``.

    Raises
    ------
    InputError
        If the text is no key.
    """
    steps: list[str | int] = []
    for part in text.split("."):
        name, *indices = part.split("[")
        numbers = [
            index[:-1] for index in indices if index.endswith("]") and index[:-1].isdecimal()
        ]
        if not name or len(numbers) != len(indices):
            raise InputError(
                f"expected a key such as gains.kp or controllers[0].label, got '{text}'"
            )
        steps += [name, *map(int, numbers)]
    return tuple(steps)
