"""Named cases of a sweep."""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Annotated, Any, ClassVar

from pydantic import Field

from eqt_cli.core.errors import InputError, KeyPath, Problems, parse_key
from eqt_cli.ensemble.designs.base import CASE, Design, overlap

MAX_CHARACTERS = 40
"""Longest name of a case, which is a line in tables and figures."""


@dataclass(frozen=True)
class Cases(Design):
    """Named points, each with the keys that it changes; all other keys stay unchanged.

    Attributes
    ----------
    cases
        The values of keys by the name of the case, as for `--set`.
    """

    name: ClassVar[str] = "cases"
    whole_section: ClassVar[str] = "cases"

    cases: Annotated[dict[str, dict[str, Any]], Field(min_length=1)]

    def check(self, problems: Problems) -> None:
        """Note names that do not fit into tables, invalid or overlapping keys, and equal cases."""
        for case, settings in self.cases.items():
            at_case = problems.at(case)
            if not (case.strip() and case.isprintable() and len(case) <= MAX_CHARACTERS):
                at_case.add(
                    f"expected a name of 1 to {MAX_CHARACTERS} printable characters, got {case!r}"
                )
            for key in settings:
                with at_case.catching(key):
                    if not key.strip():
                        raise InputError("expected a key of the configuration, got ''")
                    parse_key(key)
            for one, other in combinations(settings, 2):
                if overlap(one, other):
                    at_case.at(other).add(f"{other} overlaps with {one}; remove one of them")
        if problems:
            return
        for one, other in combinations(self.cases, 2):
            if self.cases[one] == self.cases[other]:
                problems.at(other).add(f"changes the same as '{one}'; remove one of them")

    @property
    def keys(self) -> tuple[str, ...]:  # type: ignore[override]  # of all cases
        """The name of the case."""
        return (CASE,)

    @cached_property
    def _names(self) -> list[str]:
        return list(self.cases)

    @cached_property
    def sets(self) -> tuple[str, ...]:
        """The keys that any case changes."""
        return tuple(dict.fromkeys(key for case in self.cases.values() for key in case))

    @cached_property
    def always(self) -> tuple[str, ...]:
        """The keys that all cases change."""
        return tuple(key for key in self.sets if all(key in case for case in self.cases.values()))

    def __len__(self) -> int:
        return len(self.cases)

    def values(self, point: int) -> tuple[Any, ...]:
        return (self._names[point],)

    def settings(self, point: int) -> dict[str, Any]:
        return self.cases[self._names[point]]

    def place(self, point: int, key: str) -> KeyPath:
        case = self._names[point]
        return (case, key) if key in self.cases[case] else (case,)
