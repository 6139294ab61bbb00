"""Designs one after the other, over the same keys."""

from __future__ import annotations

from bisect import bisect_right
from itertools import accumulate
from typing import Any, ClassVar, Self

from eqt_cli.ensemble.designs import Design, Note, Path, Schema, Surroundings
from eqt_cli.ensemble.sweep import Sweep


class Concat(Design):
    """The points of several sweeps, one after the other.

    Parameters
    ----------
    parts
        Each one or several blocks that multiply.
    alone
        For each, whether it is a block that is written without a list around it.
    """

    name: ClassVar[str] = "concat"

    def __init__(self, parts: list[Sweep], alone: list[bool]) -> None:
        self.parts, self.alone = parts, alone
        self.keys = parts[0].keys
        self._ends = list(accumulate(len(part) for part in parts))

    @classmethod
    def parse(cls, section: Any, note: Note) -> Self | None:
        if not isinstance(section, list) or not section:
            note((), "expected a list of blocks")
            return None
        alone = [not isinstance(entry, list) for entry in section]
        parts = []
        for index, entry in enumerate(section):

            def here(path: Path, message: str, index: int = index) -> None:
                note((index, *(path[1:] if alone[index] else path)), message)

            part = Sweep.parse([entry] if alone[index] else entry, here)
            if part is not None:
                parts.append(part)
        if len(parts) < len(section):
            return None
        for index, part in enumerate(parts):
            if set(part.keys) != set(parts[0].keys):
                note((index,), f"expected the keys of the first ({', '.join(parts[0].keys)})")
                return None
        return cls(parts, alone)

    @classmethod
    def schema(cls, around: Surroundings) -> Schema:
        part = {"anyOf": [around.block, Sweep.schema(around)]}
        return {"type": "array", "minItems": 1, "items": part}

    def __len__(self) -> int:
        return self._ends[-1]

    def values(self, point: int) -> tuple[Any, ...]:
        index, inner = self._find(point)
        found = self.parts[index].point(inner)
        return tuple(found[key] for key in self.keys)

    def place(self, point: int, key: str) -> Path:
        index, inner = self._find(point)
        path = self.parts[index].place(inner, key)
        return (index, *(path[1:] if self.alone[index] else path))

    def _find(self, point: int) -> tuple[int, int]:
        """The part that a point is in, and its number there."""
        index = bisect_right(self._ends, point)
        return index, point - (self._ends[index - 1] if index else 0)
