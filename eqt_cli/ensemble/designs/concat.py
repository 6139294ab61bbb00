"""Designs one after the other, over the same keys."""

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import Annotated, Any, ClassVar, Self

from pydantic import Field

from eqt_cli.core.errors import KeyPath, Problems
from eqt_cli.core.option_types import shown
from eqt_cli.ensemble.designs import Design
from eqt_cli.ensemble.designs.base import counted
from eqt_cli.ensemble.sweep import Sweep


@dataclass(frozen=True)
class Concat(Design):
    """The points of several sweeps, one after the other.

    Attributes
    ----------
    parts
        One entry for each sweep: a block, or a list of blocks that multiply.
    """

    name: ClassVar[str] = "concat"
    whole_section: ClassVar[str] = "parts"

    parts: Annotated[list[Sweep], Field(min_length=1)]

    @classmethod
    def read(cls, section: Any, problems: Problems) -> Self | None:
        if not isinstance(section, list) or not section:
            problems.add(f"expected a list of blocks, got {shown(section)}")
            return None
        parts = [Sweep.part(entry, problems.at(index)) for index, entry in enumerate(section)]
        design = cls([part for part in parts if part is not None])
        if not problems:
            design.check(problems)
        return None if problems else counted(design, problems)

    def check(self, problems: Problems) -> None:
        """Note a part whose keys differ from those of the first."""
        for index, part in enumerate(self.parts):
            if set(part.keys) != set(self.keys):
                problems.at(index).add(
                    f"expected the same keys as in the first part: {', '.join(self.keys)}"
                )
                return

    @cached_property
    def keys(self) -> tuple[str, ...]:  # type: ignore[override]  # derived
        """The keys of the first part."""
        return self.parts[0].keys

    @cached_property
    def _ends(self) -> list[int]:
        return list(accumulate(len(part) for part in self.parts))

    def __len__(self) -> int:
        return self._ends[-1]

    def values(self, point: int) -> tuple[Any, ...]:
        index, inner = self._find(point)
        values = self.parts[index].point(inner)
        return tuple(values[key] for key in self.keys)

    @cached_property
    def sets(self) -> tuple[str, ...]:
        """The keys that any part changes."""
        return tuple(dict.fromkeys(key for part in self.parts for key in part.sets))

    @cached_property
    def always(self) -> tuple[str, ...]:
        """The keys that all parts always change."""
        return tuple(key for key in self.sets if all(key in part.always for part in self.parts))

    def settings(self, point: int) -> dict[str, Any]:
        index, inner = self._find(point)
        return self.parts[index].settings(inner)

    def place(self, point: int, key: str) -> KeyPath:
        index, inner = self._find(point)
        return (index, *self.parts[index].place(inner, key))

    def _find(self, point: int) -> tuple[int, int]:
        """Return the part that holds a point, and the point's number in it."""
        index = bisect_right(self._ends, point)
        return index, point - (self._ends[index - 1] if index else 0)
