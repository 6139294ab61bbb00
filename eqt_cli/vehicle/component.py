"""What all parts of a vehicle have in common: numbers that may differ from run to run."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.component import Component
from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.vehicle.numbers import Numbers, check_numbers, drawn, is_drawn, lowest
from eqt_cli.written.poses import square, vector

Given = Mapping[str, Array]
"""The numbers of a part by option: of one run, of many along a leading axis, or symbols."""


@dataclass(frozen=True)
class VehiclePart(Component):
    """A part of a vehicle: a frozen dataclass whose fields are its options in a configuration.

    What it computes, it computes from the arrays of `numbers` that it is handed, and not from its
    own fields: those are the same for all runs.
    """

    vectors: ClassVar[tuple[str, ...]] = ()
    """The options that are a number for each coordinate; one number stands for all."""
    matrices: ClassVar[tuple[str, ...]] = ()
    """The options that are matrices; a number stands for a multiple of I, a list for a diagonal."""
    departs: ClassVar[str]
    """In what the loop departs from the one that theorems are about, in a few words."""
    positive: ClassVar[tuple[str, ...]] = ()
    """The options whose numbers must be greater than 0."""

    @property
    def varies(self) -> bool:
        """Whether its numbers differ from run to run."""
        return any(is_drawn(getattr(self, field.name)) for field in dataclasses.fields(self))

    def of_run(self, random: np.random.Generator | None) -> Self:
        """The same with the numbers of one run; with the means without a generator."""
        options = {
            field.name: drawn(getattr(self, field.name), random, field.name in self.positive)
            for field in dataclasses.fields(self)
        }
        return dataclasses.replace(self, **options)

    def numbers(self, G: MatrixLieGroup, random: np.random.Generator | None) -> dict[str, Array]:
        """Its numbers by option, in one run; with the means without a generator."""
        part, m = self.of_run(random), G.dimension
        return {
            name: shaped(value, m, G)
            for names, shaped in ((self.vectors, vector), (self.matrices, square))
            for name in names
            if (value := getattr(part, name)) is not None
        }

    @property
    def structure(self) -> tuple[Any, ...]:
        """What of it is no number; parts of equal structure can be solved together."""
        names = (*self.vectors, *self.matrices)
        fields = [field.name for field in dataclasses.fields(self) if field.name not in names]
        return type(self), tuple((name, repr(getattr(self, name))) for name in fields)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note numbers that are not what they must be, or not as many as there are coordinates."""
        m = G.dimension
        for names, shaped in ((self.vectors, vector), (self.matrices, square)):
            for name in names:
                here, value = problems.at(name), getattr(self, name)
                if value is None:
                    continue
                check_numbers(value, here, name in self.positive)
                if not here:
                    with here.catching():
                        shaped(drawn(value, None), m, G)


def check_deviations(value: Numbers, G: MatrixLieGroup, problems: Problems) -> None:
    """Note a negative standard deviation, or a wrong number of them."""
    check_count(value, G.dimension, G.name, problems, deviations=True)


def check_count(
    value: Numbers, count: int, of: str, problems: Problems, deviations: bool = False
) -> None:
    """Note distributions that are none, a negative one of `deviations`, or a wrong number."""
    check_numbers(value, problems)
    for entry in value if isinstance(value, list) else [value]:
        if deviations and not problems and lowest(entry) < 0:
            problems.add(f"expected a standard deviation of at least 0, got {lowest(entry):g}")
    if isinstance(value, list) and len(value) != count:
        problems.add(f"expected {count} entries for {of}, got {len(value)}")
