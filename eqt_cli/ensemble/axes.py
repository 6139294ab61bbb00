"""An axis of a design: a list of values, or a range."""

import math
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, Tag

from eqt_cli.core.errors import Problems
from eqt_cli.core.option_types import MAX_POINTS, AnyReal, number_schema, one_of


def _narrower(key: str, value: Any, **bounds: Any) -> dict[str, Any]:
    """Return a JSON schema in which these bounds are narrower if `key` has this value."""
    return {
        "if": {"properties": {key: {"const": value}}, "required": [key]},
        "then": {"properties": bounds},
    }


_STRICT = {"extra": "forbid", "strict": True}
_WHOLE = {"type": ["integer", "string"]}
_POSITIVE = _narrower("scale", "log", low=number_schema(above=0))
_WHOLE_BOUNDS = _narrower("integer", True, low=_WHOLE, high=_WHOLE)


@dataclass(frozen=True, kw_only=True)
class Range:
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

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT | {
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

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT | {
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
class Choices:
    """Values that are equally likely."""

    __pydantic_config__: ClassVar[dict[str, Any]] = _STRICT

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
