"""What designs have in common that spread points over ranges: seed, axes, the unit cube."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from functools import cached_property
from typing import Any, Self

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import suggestion
from eqt_cli.ensemble.axes import DRAWN, Choices, Range, drawn
from eqt_cli.ensemble.designs.base import Design, Note, Path, Schema, Surroundings

KEYS = ("points", "seed", "axes")


class Sampled(Design):
    """Points in the unit cube, mapped to the axes.

    Parameters
    ----------
    points
        How many.
    seed
        Of the design's own random stream.
    axes
        By key.
    """

    def __init__(self, points: int, seed: int, axes: Mapping[str, Range | Choices]) -> None:
        self.points, self.seed, self.axes = points, seed, dict(axes)
        self.keys = tuple(axes)

    @abstractmethod
    def shares(self, generator: np.random.Generator) -> Array:
        """All points in the unit cube, ``(points, axes)``."""

    @cached_property
    def _shares(self) -> Array:
        return self.shares(np.random.Generator(np.random.PCG64DXSM(self.seed)))

    def __getstate__(self) -> dict[str, Any]:
        return {"points": self.points, "seed": self.seed, "axes": self.axes, "keys": self.keys}

    @classmethod
    def parse(cls, section: Any, note: Note) -> Self | None:
        if not isinstance(section, Mapping):
            note((), "expected {points: …, seed: …, axes: {…}}")
            return None
        for key in section:
            if key not in KEYS:
                hint = suggestion(str(key), KEYS) or f"; known here: {', '.join(KEYS)}"
                note((key,), f"unknown key{hint}")
        points = _whole(section, "points", None, 1, note)
        seed = _whole(section, "seed", 0, 0, note)
        entries = section.get("axes")
        if not isinstance(entries, Mapping) or not entries:
            note(("axes",), "expected a mapping from keys to {low: …, high: …} or {values: […]}")
            return None
        axes = {key: drawn(entry, ("axes", key), note) for key, entry in entries.items()}
        found = {key: axis for key, axis in axes.items() if axis is not None}
        if points is None or seed is None or len(found) < len(axes):
            return None
        return cls(points, seed, found)

    @classmethod
    def schema(cls, around: Surroundings) -> Schema:
        return {
            "type": "object",
            "properties": {
                "points": {"type": "integer", "minimum": 1, "description": "How many."},
                "seed": {
                    "type": "integer",
                    "minimum": 0,
                    "default": 0,
                    "description": "Of the design's own random stream.",
                },
                "axes": around.axes(DRAWN) | {"description": "What is drawn, by key."},
            },
            "required": ["points", "axes"],
            "additionalProperties": False,
        }

    def __len__(self) -> int:
        return self.points

    def values(self, point: int) -> tuple[Any, ...]:
        shares = self._shares[point].tolist()
        return tuple(axis.at(share) for axis, share in zip(self.axes.values(), shares, strict=True))

    def place(self, point: int, key: str) -> Path:
        return ("axes", key)


def _whole(
    section: Mapping[str, Any], key: str, default: int | None, least: int, note: Note
) -> int | None:
    value = section.get(key, default)
    if isinstance(value, int) and not isinstance(value, bool) and value >= least:
        return value
    note((key,), f"expected a whole number of at least {least}, got {value!r}")
    return None
