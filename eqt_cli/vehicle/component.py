"""The base class of all parts of a vehicle, whose numbers may differ from run to run."""

import dataclasses
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from eqt_cli.core.component import Component
from eqt_cli.core.leaves import with_fields
from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.notation.poses import square, vector
from eqt_cli.vehicle.numbers import Numbers, check_numbers, drawn, is_drawn, lowest


@dataclass(frozen=True)
class VehiclePart(Component):
    """A part of a vehicle: a frozen dataclass whose fields are its options in a configuration.

    A simulation uses the part that `of_run` returns, in which every number is an array: of one run,
    of many along a leading axis, or of symbols.
    """

    vectors: ClassVar[tuple[str, ...]] = ()
    """Options with a number for each coordinate; one number stands for all."""
    matrices: ClassVar[tuple[str, ...]] = ()
    """Options that are matrices; a number stands for a multiple of I, a list for a diagonal."""
    departs: ClassVar[str]
    """How the part takes the loop away from the one that theorems are about, in a few words."""
    positive: ClassVar[tuple[str, ...]] = ()
    """Options whose numbers must be greater than 0."""

    @property
    def varies(self) -> bool:
        """Whether the numbers of the part differ from run to run."""
        return any(is_drawn(getattr(self, field.name)) for field in dataclasses.fields(self))

    def drawn(self, random: np.random.Generator | None) -> Self:
        """Return the part with a number for each distribution; without a generator, its mean."""
        options = {
            field.name: drawn(getattr(self, field.name), random, field.name in self.positive)
            for field in dataclasses.fields(self)
        }
        return with_fields(self, **options)

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the part of one run; without a generator, with the means.

        `vectors` have m entries, `matrices` are m × m. Any other number is an array ``(1,)``, any
        other list of numbers an array.
        """
        part = self.drawn(random)
        return with_fields(
            part,
            **{
                field.name: self._as_array(field.name, getattr(part, field.name), G)
                for field in dataclasses.fields(part)
            },
        )

    def _as_array(self, name: str, value: Any, G: MatrixLieGroup) -> Any:
        if value is None:
            return None
        if name in self.vectors:
            return vector(value, G.dimension, G)
        if name in self.matrices:
            return square(value, G.dimension, G)
        entries = value if isinstance(value, list) else [value]
        kinds = (int, float) if isinstance(value, list) else float
        if entries and all(isinstance(each, kinds) for each in entries):
            return np.array(entries, dtype=float)
        return value

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note invalid numbers, and a number of entries that does not fit the coordinates."""
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
    """Note negative standard deviations, or a wrong number of them."""
    check_count(value, G.dimension, G.name, problems, deviations=True)


def check_count(value: Numbers, count: int, of: str, problems: Problems, deviations: bool) -> None:
    """Note invalid distributions, negative `deviations`, or a number of entries other than `count`.

    `of` says in messages what the entries belong to.
    """
    check_numbers(value, problems)
    for entry in value if isinstance(value, list) else [value]:
        if deviations and not problems and lowest(entry) < 0:
            problems.add(f"expected a standard deviation of at least 0, got {lowest(entry):g}")
    if isinstance(value, list) and len(value) != count:
        problems.add(f"expected {count} entries for {of}, got {len(value)}")
