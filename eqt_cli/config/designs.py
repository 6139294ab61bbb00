"""Axes of a sweep, designs that choose points on them, and sweeps: the points of designs."""

import math
from abc import abstractmethod
from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, combinations
from math import prod
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar, get_type_hints

import numpy as np
from pydantic import Field, Tag
from pydantic_core import core_schema

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError, KeyPath, Problems, parse_key
from eqt_cli.base.extensions import function_for
from eqt_cli.base.option_types import (
    MAX_POINTS,
    AnyReal,
    CountOrNone,
    Points,
    number_schema,
    one_of,
    shown,
    validated,
)
from eqt_cli.base.registry import Component, Keys, Registry
from eqt_cli.base.reporting import listed
from eqt_cli.base.stored import CASE

# An axis of a design: a list of values, or a range ------------------------------------------------


_WHOLE = {"type": ["integer", "string"]}

# JSON Schemas that are narrower if a key has a value.
_POSITIVE = {
    "if": {"properties": {"scale": {"const": "log"}}, "required": ["scale"]},
    "then": {"properties": {"low": number_schema(above=0)}},
}
_WHOLE_BOUNDS = {
    "if": {"properties": {"integer": {"const": True}}, "required": ["integer"]},
    "then": {"properties": {"low": _WHOLE, "high": _WHOLE}},
}


@dataclass(frozen=True, kw_only=True)
class Range(Keys):
    """Numbers from `low` to `high`.

    Attributes
    ----------
    low
        The smallest value.
    high
        The largest value, greater than low.
    scale
        The scale on which values are uniform; on a log scale, low is greater than 0.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = Keys.__pydantic_config__ | {
        "json_schema_extra": {"allOf": [_POSITIVE]}  # JSON Schema cannot express low < high
    }

    low: AnyReal
    high: AnyReal
    scale: Literal["linear", "log"] = "linear"

    def check(self, problems: Problems) -> None:
        """Note bounds in the wrong order, or that do not fit the scale."""
        if self.low >= self.high:
            problems.at("high").add(
                f"expected more than {self.low:g}, the value of low, got {self.high:g}"
            )
        if self.scale == "log" and self.low <= 0:
            expected = "expected a number greater than 0 on a log scale"
            problems.at("low").add(f"{expected}, got {self.low:g}")

    def at(self, share: float) -> float | int:
        """Return the number at a share of the range, from 0 to 1."""
        return min(max(self._between(self.high, share), self.low), self.high)

    def _between(self, high: float, share: float) -> float:
        if self.scale == "log":
            return self.low * (high / self.low) ** share
        return self.low + share * (high - self.low)


@dataclass(frozen=True, kw_only=True)
class Spaced(Range):
    """Numbers at equal distances from `low` to `high`, each computed when it is used.

    Attributes
    ----------
    points
        The number of values.
    """

    points: Annotated[int, Field(ge=2, le=MAX_POINTS)]

    def __len__(self) -> int:
        return self.points

    def __getitem__(self, index: int) -> float | int:
        return self.at(index / (self.points - 1))


@dataclass(frozen=True, kw_only=True)
class DrawnRange(Range):
    """Numbers that are equally likely on their scale.

    Attributes
    ----------
    integer
        Whether only whole numbers are drawn.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = Keys.__pydantic_config__ | {
        "json_schema_extra": {"allOf": [_POSITIVE, _WHOLE_BOUNDS]}
    }

    integer: bool = False

    def check(self, problems: Problems) -> None:
        """Note also bounds of an integer axis that are not whole numbers."""
        super().check(problems)
        if self.integer and not (self.low.is_integer() and self.high.is_integer()):
            problems.at("low").add("expected whole numbers as low and high, since integer is true")

    def at(self, share: float) -> float | int:
        """Return a number; whole numbers have equal shares of the range, and 1 gives `high`."""
        if self.integer:
            return min(int(self.high), math.floor(self._between(self.high + 1, share)))
        return super().at(share)

    def share(self, value: float) -> float:
        """Return the share of the range at a value within the bounds."""
        low, high = self.low, self.high
        if self.integer:
            value, high = value + 0.5, high + 1
        if self.scale == "log":
            return math.log(value / low) / math.log(high / low)
        return (value - low) / (high - low)


Values = Annotated[list[Any], Field(min_length=1)]
"""Values of any kind."""


@dataclass(frozen=True)
class Choices(Keys):
    """Values that are equally likely."""

    values: Values

    def check(self, problems: Problems) -> None:
        """Accept all values, because their type is checked before."""

    def at(self, share: float) -> Any:
        """Return the value at a share of the list, from 0 to 1."""
        return self.values[min(int(share * len(self.values)), len(self.values) - 1)]


def _listed_kind(value: Any) -> str | None:
    return "list" if isinstance(value, list) else "range" if isinstance(value, dict) else None


def _sampled_kind(value: Any) -> str | None:
    return ("choices" if "values" in value else "range") if isinstance(value, dict) else None


ListedAxis = Annotated[
    Annotated[Values, Tag("list")] | Annotated[Spaced, Tag("range")],
    one_of(_listed_kind, "a list of values, or {low: …, high: …, points: …}"),
    Field(description="A list of values, or a number of points in a range."),
]

SampledAxis = Annotated[
    Annotated[DrawnRange, Tag("range")] | Annotated[Choices, Tag("choices")],
    one_of(_sampled_kind, "{low: …, high: …} or {values: […]}"),
    Field(description="A range, or values that are equally likely."),
]


# The base classes of designs: of all, of those with samples, and of those with lists --------------


D = TypeVar("D", bound="Design")


class Design(Component):
    """Points of a sweep, each computed when it is used.

    A frozen dataclass whose fields are its options. An option that is a mapping with arbitrary keys
    maps keys of the configuration to axes.

    Attributes
    ----------
    name
        The name in a configuration: ``grid``.
    whole_section
        The option that a block gives without its name, as in ``grid: {gains.kp: [1, 2]}``; empty
        where the block is a mapping of options.
    keys
        The keys that distinguish the points: every point has a value for each of them, in this
        order. They are keys of the configuration, or `CASE`.
    """

    name: ClassVar[str]
    whole_section: ClassVar[str] = ""
    keys: tuple[str, ...]

    @classmethod
    def read(cls, section: Any, problems: Problems) -> Self | None:
        """Return the design that a section describes, or None after noting its errors."""
        if cls.whole_section:
            kind = get_type_hints(cls, include_extras=True)[cls.whole_section]
            value = validated(kind, section, problems)
            design = None if value is None else cls(**{cls.whole_section: value})
        else:
            design = validated(cls, section, problems)
        if design is not None:
            design.check(problems)
        return None if problems or design is None else counted(design, problems)

    def check(self, problems: Problems) -> None:
        """Note errors of its options."""

    @abstractmethod
    def __len__(self) -> int:
        """The number of points."""

    @abstractmethod
    def values(self, point: int) -> tuple[Any, ...]:
        """Return the values at a point, in the order of `keys`."""

    @property
    def sets(self) -> tuple[str, ...]:
        """The keys of the configuration that points change."""
        return self.keys

    @property
    def always(self) -> tuple[str, ...]:
        """The keys of `sets` that every point changes."""
        return self.sets

    def settings(self, point: int) -> dict[str, Any]:
        """Return the new values of a point, by key of the configuration."""
        return dict(zip(self.keys, self.values(point), strict=True))

    def values_of(self, key: str) -> Iterable[Any]:
        """Yield every value that points give a key of the configuration, at least once."""
        return (point[key] for point in map(self.settings, range(len(self))) if key in point)

    @abstractmethod
    def place(self, point: int, key: str) -> KeyPath:
        """Return the place in the section where the value of `key` at a point is written."""

    def first_place(self, key: str) -> KeyPath:
        """Return the place in the section where `key` has its first value."""
        changing = (point for point in range(len(self)) if key in self.settings(point))
        return self.place(next(changing, 0), key)


def overlap(one: str, other: str) -> bool:
    """Whether two keys are equal, or one is within the other."""
    short, long = sorted((one, other), key=len)
    return long == short or long.startswith((short + ".", short + "["))


def counted(design: D, problems: Problems) -> D | None:
    """Return the design, or None after noting that it has more points than a sweep may have.

    The points are counted before any of them is made.
    """
    points = design.__len__()  # len() itself fails on numbers beyond 2⁶³
    if points > MAX_POINTS:
        problems.add(f"has {points:,} points; expected at most {MAX_POINTS:,}")
        return None
    return design


@dataclass(frozen=True, kw_only=True)
class Sampled(Design):
    """Points in the unit cube, mapped to the axes.

    Attributes
    ----------
    points
        The number of points.
    seed
        The seed of the design's random stream.
    axes
        The range or the choices of each key.
    """

    points: Points
    seed: CountOrNone = 0
    axes: Annotated[dict[str, SampledAxis], Field(min_length=1)]

    @cached_property
    def keys(self) -> tuple[str, ...]:  # type: ignore[override]  # derived
        """The keys of the axes."""
        return tuple(self.axes)

    def check(self, problems: Problems) -> None:
        """Note invalid ranges."""
        for key, axis in self.axes.items():
            axis.check(problems.at("axes", key))

    @abstractmethod
    def shares(self, generator: np.random.Generator) -> Array:
        """Return all points in the unit cube, ``(points, axes)``."""

    @cached_property
    def _shares(self) -> Array:
        return self.shares(np.random.Generator(np.random.PCG64DXSM(self.seed)))

    def __getstate__(self) -> dict[str, Any]:
        return {"points": self.points, "seed": self.seed, "axes": self.axes}

    def __len__(self) -> int:
        return self.points

    def values(self, point: int) -> tuple[Any, ...]:
        shares = self._shares[point].tolist()
        return tuple(axis.at(share) for axis, share in zip(self.axes.values(), shares, strict=True))

    def place(self, point: int, key: str) -> KeyPath:
        return ("axes", key)


@dataclass(frozen=True)
class Listed(Design):
    """Points made of the values of axes.

    Attributes
    ----------
    axes
        The axes by key.
    """

    whole_section: ClassVar[str] = "axes"

    axes: Annotated[dict[str, ListedAxis], Field(min_length=1)]

    @cached_property
    def keys(self) -> tuple[str, ...]:  # type: ignore[override]  # derived
        """The keys of the axes."""
        return tuple(self.axes)

    def check(self, problems: Problems) -> None:
        """Note invalid ranges, and lists of mappings, which fit into a table by a name only."""
        for key, axis in self.axes.items():
            if isinstance(axis, Spaced):
                axis.check(problems.at(key))
                continue
            for index, value in enumerate(axis):
                if isinstance(value, list) and any(isinstance(entry, dict) for entry in value):
                    problems.at(key, index).add(
                        "expected a number, a text, a list of numbers or one mapping, got "
                        f"{shown(value)}; give each list a name: "
                        "sweep: [{cases: {NAME: {KEY: VALUE}, …}}]"
                    )

    @abstractmethod
    def index(self, point: int, key: str) -> int:
        """Return the index of a point's value on an axis."""

    def values(self, point: int) -> tuple[Any, ...]:
        return tuple(values[self.index(point, key)] for key, values in self.axes.items())

    def values_of(self, key: str) -> Iterable[Any]:
        axis = self.axes[key]
        return (axis[index] for index in range(len(axis)))

    def place(self, point: int, key: str) -> KeyPath:
        return (key,) if isinstance(self.axes[key], Spaced) else (key, self.index(point, key))


designs = Registry("design", "designs", Design, ("config.designs",))


# Named cases of a sweep ---------------------------------------------------------------------------


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


@dataclass(frozen=True)
class Grid(Listed):
    """Every combination of the values of its axes."""

    name: ClassVar[str] = "grid"

    def check(self, problems: Problems) -> None:
        """Note also a value that an axis lists twice, which would make equal points."""
        super().check(problems)
        for key, axis in self.axes.items():
            if isinstance(axis, list) and (index := _repeated(axis)) is not None:
                problems.at(key, index).add(f"{axis[index]} is listed twice; give each value once")

    def __len__(self) -> int:
        return prod(len(values) for values in self.axes.values())

    @cached_property
    def _steps(self) -> dict[str, int]:
        """The number of successive points with the same value on each axis."""
        steps, step = {}, 1
        for key, values in reversed(self.axes.items()):
            steps[key] = step
            step *= len(values)
        return steps

    def index(self, point: int, key: str) -> int:
        return point // self._steps[key] % len(self.axes[key])


def _repeated(values: list[Any]) -> int | None:
    """Return the index of the first repeated value."""
    seen: set[str] = set()
    for index, value in enumerate(values):
        number = isinstance(value, int | float) and not isinstance(value, bool)
        text = repr(float(value) if number else value)
        if text in seen:
            return index
        seen.add(text)
    return None


@dataclass(frozen=True, kw_only=True)
class LatinHypercube(Sampled):
    """A Latin hypercube; all points change with their number."""

    name: ClassVar[str] = "lhs"

    def shares(self, generator: np.random.Generator) -> Array:
        """Return SciPy's Latin hypercube."""
        from scipy.stats import qmc  # slow to import, and rarely needed

        return qmc.LatinHypercube(len(self.axes), rng=generator).random(self.points)


@dataclass(frozen=True, kw_only=True)
class Random(Sampled):
    """Independent points; more of them keep the earlier ones."""

    name: ClassVar[str] = "random"

    def shares(self, generator: np.random.Generator) -> Array:
        """Return points that are uniform on the unit cube."""
        return generator.random((self.points, len(self.axes)))


@dataclass(frozen=True, kw_only=True)
class Sobol(Sampled):
    """A scrambled Sobol sequence; more points keep the earlier ones. Use powers of 2."""

    name: ClassVar[str] = "sobol"

    def shares(self, generator: np.random.Generator) -> Array:
        """Return the first points of SciPy's sequence, scrambled by the seed."""
        from scipy.stats import qmc  # slow to import, and rarely needed

        # SciPy warns unless the number is a power of 2, so the surplus is cut off.
        sequence = qmc.Sobol(len(self.axes), rng=generator)
        return sequence.random_base2((self.points - 1).bit_length())[: self.points]


@dataclass(frozen=True)
class Zip(Listed):
    """The first values of all axes, then the second ones, and so on."""

    name: ClassVar[str] = "zip"

    def check(self, problems: Problems) -> None:
        """Note also an axis whose length differs from the first."""
        super().check(problems)
        if problems:
            return
        first = self.keys[0]
        for key, values in self.axes.items():
            if len(values) != len(self):
                problems.at(key).add(
                    f"expected {len(self)} values, as many as {first} has, got {len(values)}"
                )
                return

    def __len__(self) -> int:
        return len(self.axes[self.keys[0]])

    def index(self, point: int, key: str) -> int:
        return point


# A sweep: blocks of designs that multiply, the first one changing slowest -------------------------


BLOCK: dict[str, Any] = {"type": "object", "title": "a block of a sweep"}
"""Placeholder for a block of any design in the JSON schemas of designs."""


EXPECTED = "expected a list of blocks such as {grid: {gains.kp: [1, 2]}}"

RULES = ("set", "where", "points")
"""Entries beside the blocks of a sweep: what follows from swept names, and which points count."""


class Sweep(Design):
    """Every combination of the points of its blocks, or some of these points.

    Parameters
    ----------
    blocks
        Designs over different keys.
    section
        Their description in a configuration: a list, or a single block.
    points
        The points that count, numbered from 0 in this order; None for all.
    rules
        What follows from swept names, and which combinations are points, by the entries `RULES`.
    """

    name: ClassVar[str]  # not set, because a sweep is the whole section and no kind of block

    def __init__(
        self,
        blocks: list[Design],
        section: Any,
        points: Sequence[int] | None = None,
        rules: Any = None,
    ) -> None:
        self.blocks, self.section, self.points, self.rules = blocks, section, points, rules
        self.keys = tuple(key for block in blocks for key in block.keys)

    @property
    def data(self) -> Any:
        """What tells it from other sweeps, as data for JSON."""
        if self.points is None:
            return self.section
        return {"points": list(self.points), "of": self.section}

    @cached_property
    def sets(self) -> tuple[str, ...]:
        """The keys that any block changes, or a formula."""
        keys = tuple(key for block in self.blocks for key in block.sets)
        return self.rules.sets(keys) if self.rules else keys

    @cached_property
    def always(self) -> tuple[str, ...]:
        """The keys that every point changes."""
        keys = tuple(key for block in self.blocks for key in block.always)
        return self.rules.sets(keys) if self.rules else keys

    @classmethod
    def read(cls, section: Any, problems: Problems) -> Self | None:
        if not isinstance(section, list) or not section:
            problems.add(f"{EXPECTED}, got {shown(section)}")
            return None
        rules = {k: entry for k, entry in enumerate(section) if _is_rule(entry)}
        read = (
            (k, _block(entry, problems.at(k))) for k, entry in enumerate(section) if k not in rules
        )
        blocks = {index: block for index, block in read if block is not None}
        seen: list[str] = []
        for index, block in blocks.items():
            for key in dict.fromkeys((*block.keys, *block.sets)):
                if other := next((k for k in seen if overlap(k, key)), None):
                    what = "is swept" if other == key else f"overlaps with {other}, which is swept"
                    path = block.first_place(key)
                    if path[-1] != key:  # the place of its first value
                        path = path[:-1]
                    at_key = problems.at(index, block.name, *path)
                    at_key.add(f"{key} {what} by an earlier block; give all values there")
                    return None
            seen += (*block.keys, *block.sets)
        if not blocks and not problems:
            problems.add(
                f"has no design; add one, such as {{grid: {{w: [1, 2]}}}}, to {shown(section)}"
            )
        at_places = {(index,): entry for index, entry in rules.items()}
        of_rules = (
            function_for(purposes.rules_of_a_sweep)(at_places, seen, problems) if rules else None
        )
        sweep = cls(list(blocks.values()), section, rules=of_rules)
        return None if problems else counted(sweep, problems)

    def __len__(self) -> int:
        if self.points is not None:
            return len(self.points)
        if self.rules and self.rules.combinations is not None:
            return len(self.rules.combinations)
        return prod(len(block) for block in self.blocks)

    def values(self, point: int) -> tuple[Any, ...]:
        return tuple(value for block, inner in self._split(point) for value in block.values(inner))

    def point(self, point: int) -> dict[str, Any]:
        """Return the values at a point, by key."""
        return dict(zip(self.keys, self.values(point), strict=True))

    def settings(self, point: int) -> dict[str, Any]:
        swept = self.settings_of_blocks(point)
        return self.rules.settings(swept) if self.rules else swept

    def settings_of_blocks(self, point: int) -> dict[str, Any]:
        """Return the values of all swept keys and names, without what follows from them."""
        parts = (block.settings(inner) for block, inner in self._split(point))
        return {key: value for part in parts for key, value in part.items()}

    def values_of(self, key: str) -> Iterable[Any]:
        if self.rules:  # which may compute it, or leave some values out
            return super().values_of(key)
        return next(block for block in self.blocks if key in block.sets).values_of(key)

    def place(self, point: int, key: str) -> KeyPath:
        if self.rules and (path := self.rules.place(key)):
            return tuple(path)
        listed = self.section if isinstance(self.section, list) else [self.section]
        places = (index for index, entry in enumerate(listed) if not _is_rule(entry))
        for index, (block, inner) in zip(places, self._split(point), strict=True):
            if key in block.keys or key in block.sets:
                path = (block.name, *block.place(inner, key))
                return (index, *path) if isinstance(self.section, list) else path
        raise KeyError(key)

    def _split(self, point: int) -> list[tuple[Design, int]]:
        """Return every block with its own point."""
        point = point if self.points is None else self.points[point]
        if self.rules and self.rules.combinations is not None:
            point = self.rules.combinations[point]
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


def _is_rule(entry: Any) -> bool:
    return isinstance(entry, dict) and entry.keys() <= set(RULES) and bool(entry)


def _block(entry: Any, problems: Problems) -> Design | None:
    if not isinstance(entry, Mapping) or len(entry) != 1:
        names = ", ".join(designs.names())
        problems.add(f"expected one design, such as {{grid: {{…}}}}, and one only; known: {names}")
        return None
    ((name, section),) = entry.items()
    with problems.catching(name):
        return designs.get(name).read(section, problems.at(name))
    return None


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
        parts, part = [], None
        for index, entry in enumerate(section):
            if any(map(_is_rule, entry if isinstance(entry, list) else [entry])):
                problems.at(index).add(f"{listed(RULES)} hold for all points; move them to `sweep`")
            elif isinstance(entry, list):
                part = Sweep.read(entry, problems.at(index))
            else:
                block = _block(entry, problems.at(index))
                part = None if block is None else Sweep([block], entry)
            if part is not None:
                parts.append(part)
        design = cls(parts)
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
