"""A sweep: blocks of designs that multiply, the first one changing slowest."""

from __future__ import annotations

from collections.abc import Mapping
from math import prod
from typing import Any, ClassVar, Self

from eqt_cli.core.errors import ComponentError
from eqt_cli.ensemble.designs import Design, Note, Path, Schema, Surroundings, designs


class Sweep(Design):
    """Every combination of the points of its blocks.

    Parameters
    ----------
    blocks
        Designs over different keys.
    data
        The section that describes them.
    """

    name: ClassVar[str]  # none: it is the whole section, not a kind of block

    def __init__(self, blocks: list[Design], data: list[Any]) -> None:
        self.blocks, self.data = blocks, data
        self.keys = tuple(key for block in blocks for key in block.keys)

    @classmethod
    def parse(cls, section: Any, note: Note) -> Self | None:
        if not isinstance(section, list) or not section:
            note((), "expected a list of blocks such as {grid: {gains.kp: [1, 2]}}")
            return None
        blocks = [_block(entry, index, note) for index, entry in enumerate(section)]
        seen: dict[str, int] = {}
        for index, block in enumerate(blocks):
            for key in block.keys if block else ():
                if (other := next((k for k in seen if _overlap(k, key)), None)) is not None:
                    what = "is swept" if other == key else f"overlaps with {other}, which is swept"
                    note(_key_path(section, index, key), f"{key} {what} by an earlier block")
                    return None
                seen[key] = index
        found = [block for block in blocks if block is not None]
        return cls(found, section) if len(found) == len(section) else None

    @classmethod
    def schema(cls, around: Surroundings) -> Schema:
        return {"type": "array", "minItems": 1, "items": around.block}

    def __len__(self) -> int:
        return prod(len(block) for block in self.blocks)

    def values(self, point: int) -> tuple[Any, ...]:
        found: tuple[Any, ...] = ()
        for block, inner in self._split(point):
            found += block.values(inner)
        return found

    def point(self, point: int) -> dict[str, Any]:
        """The values at a point, by key."""
        return dict(zip(self.keys, self.values(point), strict=True))

    def place(self, point: int, key: str) -> Path:
        for index, (block, inner) in enumerate(self._split(point)):
            if key in block.keys:
                return (index, block.name, *block.place(inner, key))
        raise KeyError(key)

    def _split(self, point: int) -> list[tuple[Design, int]]:
        """The point of every block."""
        found = []
        for block in reversed(self.blocks):
            point, inner = divmod(point, len(block))
            found.append((block, inner))
        return found[::-1]


def _block(entry: Any, index: int, note: Note) -> Design | None:
    names = ", ".join(designs.names())
    if not isinstance(entry, Mapping) or len(entry) != 1:
        note((index,), f"expected one block, such as {{grid: {{…}}}}; known: {names}")
        return None
    ((name, section),) = entry.items()
    try:
        design = designs.get(str(name))
    except ComponentError as error:
        note((index, str(name)), str(error))
        return None
    return design.parse(section, lambda path, message: note((index, name, *path), message))


def _overlap(one: str, other: str) -> bool:
    """Whether one key is the other, or within it."""
    short, long = sorted((one, other), key=len)
    return long == short or long.startswith((short + ".", short + "["))


def _key_path(section: list[Any], index: int, key: str) -> Path:
    name = next(iter(section[index]))
    inner = section[index][name]
    axes: Path = ("axes",) if isinstance(inner, Mapping) and "axes" in inner else ()
    return (index, name, *axes, key)
