"""Collects the errors of an input with their places, so that all are reported together."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from functools import lru_cache
from typing import Self, TypeAlias

from eqt_cli.core.errors import ConfigError, InputError, InputProblem, Remedy

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
        self._found: dict[InputProblem, KeyPath] = {}

    def at(self, *steps: str | int) -> Self:
        """Return the problems of a place within this one."""
        inner = copy(self)  # the copy shares the list
        inner._path = (*self._path, *steps)
        return inner

    @property
    def path(self) -> str:
        """The place as users write it."""
        return dotted(self._path)

    def add(self, message: str, remedies: tuple[Remedy, ...] = ()) -> None:
        """Note an error at this place; the same error is noted once."""
        place = self._located(self._path)
        problem = InputProblem(self.path, message, place, remedies)
        self._found.setdefault(problem, self._path)
        if len(self._found) > MAX_PROBLEMS:
            first = sorted(list(self._found)[:MAX_PROBLEMS], key=_position)
            raise ConfigError(
                [*first, InputProblem("", f"and more; only the first {MAX_PROBLEMS} are shown")]
            )

    @contextmanager
    def catching(self, *steps: str | int) -> Iterator[None]:
        """Note an `InputError` from the block at a place within this one, and continue."""
        try:
            yield
        except InputError as error:
            self.at(*steps).add(str(error.args[0]), error.remedies)

    def __iter__(self) -> Iterator[InputProblem]:
        depth = len(self._path)
        return (problem for problem, path in self._found.items() if path[:depth] == self._path)

    def __bool__(self) -> bool:
        """Whether there is an error at this place or within it."""
        return any(True for _ in self)

    def raise_if_any(self) -> None:
        """Raise a `ConfigError` with all errors, in the order of the file, if there are any."""
        if self:
            raise ConfigError(sorted(self, key=_position))


def _position(problem: InputProblem) -> tuple[str, int, int]:
    name, _, column = problem.place.rpartition(":")
    name, _, line = name.rpartition(":")
    if line.isdigit() and column.isdigit():
        return name, int(line), int(column)
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
