"""Sweeps: the points of designs, alone or one after the other."""

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from math import prod
from typing import Annotated, Any, ClassVar, Self

from pydantic import Field
from pydantic_core import core_schema

from eqt_cli.base.errors import KeyPath, Problems
from eqt_cli.base.option_types import shown
from eqt_cli.config.designs import Design, counted, designs, overlap

# A sweep: blocks of designs that multiply, the first one changing slowest -------------------------


BLOCK: dict[str, Any] = {"type": "object", "title": "a block of a sweep"}
"""Placeholder for a block of any design in the JSON schemas of designs."""


EXPECTED = "expected a list of blocks such as {grid: {gains.kp: [1, 2]}}"


class Sweep(Design):
    """Every combination of the points of its blocks.

    Parameters
    ----------
    blocks
        Designs over different keys.
    data
        The section that describes them: a list, or a single block by itself.
    """

    name: ClassVar[str]  # not set, because a sweep is the whole section and no kind of block

    def __init__(self, blocks: list[Design], data: Any) -> None:
        self.blocks, self.data = blocks, data
        self.keys = tuple(key for block in blocks for key in block.keys)

    @cached_property
    def sets(self) -> tuple[str, ...]:
        """The keys that any block changes."""
        return tuple(key for block in self.blocks for key in block.sets)

    @cached_property
    def always(self) -> tuple[str, ...]:
        """The keys that every point changes."""
        return tuple(key for block in self.blocks for key in block.always)

    def only(self, points: Sequence[int]) -> "Sweep":
        """Return a sweep of some of its points, numbered from 0."""
        return _Some(self, points)

    @classmethod
    def read(cls, section: Any, problems: Problems) -> Self | None:
        if not isinstance(section, list) or not section:
            problems.add(f"{EXPECTED}, got {shown(section)}")
            return None
        read = ((k, _block(entry, problems.at(k))) for k, entry in enumerate(section))
        blocks = {index: block for index, block in read if block is not None}
        seen: list[str] = []
        for index, block in blocks.items():
            for key in dict.fromkeys((*block.keys, *block.sets)):
                if other := next((k for k in seen if overlap(k, key)), None):
                    what = "is swept" if other == key else f"overlaps with {other}, which is swept"
                    at_key = problems.at(index, *_key_path(block, key))
                    at_key.add(f"{key} {what} by an earlier block; remove one of them")
                    return None
            seen += (*block.keys, *block.sets)
        return None if problems else counted(cls(list(blocks.values()), section), problems)

    @classmethod
    def part(cls, section: Any, problems: Problems) -> Self | None:
        """Return a sweep whose section may also be a single block."""
        if isinstance(section, list):
            return cls.read(section, problems)
        block = _block(section, problems)
        return None if block is None else cls([block], section)

    def __len__(self) -> int:
        return prod(len(block) for block in self.blocks)

    def values(self, point: int) -> tuple[Any, ...]:
        return tuple(value for block, inner in self._split(point) for value in block.values(inner))

    def point(self, point: int) -> dict[str, Any]:
        """Return the values at a point, by key."""
        return dict(zip(self.keys, self.values(point), strict=True))

    def settings(self, point: int) -> dict[str, Any]:
        parts = (block.settings(inner) for block, inner in self._split(point))
        return {key: value for part in parts for key, value in part.items()}

    def values_of(self, key: str) -> Iterable[Any]:
        return next(block for block in self.blocks if key in block.sets).values_of(key)

    def place(self, point: int, key: str) -> KeyPath:
        for index, (block, inner) in enumerate(self._split(point)):
            if key in block.keys or key in block.sets:
                path = (block.name, *block.place(inner, key))
                return (index, *path) if isinstance(self.data, list) else path
        raise KeyError(key)

    def _split(self, point: int) -> list[tuple[Design, int]]:
        """Return every block with its own point."""
        parts = []
        for block in reversed(self.blocks):
            point, inner = divmod(point, len(block))
            parts.append((block, inner))
        return parts[::-1]

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        return core_schema.is_instance_schema(cls)

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: Any, handler: Any) -> dict[str, Any]:
        return {"anyOf": [BLOCK, {"type": "array", "minItems": 1, "items": BLOCK}]}


class _Some(Sweep):
    """Some points of a sweep."""

    def __init__(self, whole: Sweep, points: Sequence[int]) -> None:
        super().__init__(whole.blocks, {"points": list(points), "of": whole.data})
        self._whole, self._points = whole, points

    def __len__(self) -> int:
        return len(self._points)

    def place(self, point: int, key: str) -> KeyPath:
        return self._whole.place(self._points[point], key)

    def _split(self, point: int) -> list[tuple[Design, int]]:
        return super()._split(self._points[point])


def _block(entry: Any, problems: Problems) -> Design | None:
    if not isinstance(entry, Mapping) or len(entry) != 1:
        names = ", ".join(designs.names())
        problems.add(f"expected one design, such as {{grid: {{…}}}}, and one only; known: {names}")
        return None
    ((name, section),) = entry.items()
    with problems.catching(name):
        return designs.get(name).read(section, problems.at(name))
    return None


def _key_path(block: Design, key: str) -> KeyPath:
    """Return the place where a block gives a key its values."""
    path = block.first_place(key)
    return (block.name, *(path if path[-1] == key else path[:-1]))


# Designs one after the other, over the same keys --------------------------------------------------


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
