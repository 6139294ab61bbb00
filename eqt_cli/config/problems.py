"""Collects what is wrong with a configuration, so that all of it is reported together."""

from __future__ import annotations

from collections.abc import Callable

from eqt_cli.config.yaml_source import dotted
from eqt_cli.core.errors import ConfigError, Problem

Path = tuple[str | int, ...]


class Problems:
    """A growing list of problems, each at the place where its path was written.

    Parameters
    ----------
    place
        Gives ``file:line:column``, or ``--set[0]``, for a path.
    """

    def __init__(self, place: Callable[[Path], str]) -> None:
        self._place = place
        self._found: list[Problem] = []

    def add(self, path: Path, message: str) -> None:
        """Note one problem; the same one is noted once."""
        problem = Problem(dotted(path), message, self._place(path))
        if problem not in self._found:
            self._found.append(problem)

    def __len__(self) -> int:
        return len(self._found)

    def raise_if_any(self) -> None:
        """Raise a `ConfigError` with everything that was noted, in the order of the file."""
        if self._found:
            raise ConfigError(sorted(self._found, key=_position))


def _position(problem: Problem) -> tuple[str, int, int]:
    name, _, column = problem.place.rpartition(":")
    name, _, line = name.rpartition(":")
    if line.isdigit() and column.isdigit():
        return name, int(line), int(column)
    return problem.place, 0, 0
