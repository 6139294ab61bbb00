"""What all parts of a vehicle share: options per axis, the true inertia, sampling."""

import dataclasses
import math
from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    NamedTuple,
    Protocol,
    Self,
    TypeAlias,
    runtime_checkable,
)

import numpy as np
from pydantic import Tag

from eqt_cli.base.arrays import Array, inverse_spd, stack
from eqt_cli.base.errors import Problems
from eqt_cli.base.expressions import Expression, formula
from eqt_cli.base.option_types import (
    AsText,
    Kind,
    Real,
    Scale,
    has_unit,
    one_of,
    option_names,
    seconds,
)
from eqt_cli.base.registry import Component, Keys
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.inertia import Inertia, InertiaLaw
from eqt_cli.components.pose_notation import GREATEST, check_sizes, square, vector
from eqt_cli.numbers.instants import instants_of
from eqt_cli.numbers.leaves import STRUCTURE, with_fields

# The base class of all parts of a vehicle, whose numbers may differ from run to run ---------------


@dataclass(frozen=True)
class Uniform(Keys):
    """A uniform distribution between two numbers.

    Attributes
    ----------
    uniform
        The least and the greatest.
    """

    uniform: list[Real]

    @property
    def mean(self) -> float:
        """The mean of the two bounds."""
        return (self.uniform[0] + self.uniform[1]) / 2

    @property
    def variance(self) -> float:
        """The variance, (b − a)²/12 with the bounds a and b."""
        return (self.uniform[1] - self.uniform[0]) ** 2 / 12

    def draw(self, random: np.random.Generator) -> float:
        """Return a number in the half-open interval."""
        return float(random.uniform(self.uniform[0], self.uniform[1]))

    def check(self, problems: Problems, positive: bool) -> None:
        """Note anything but two numbers in order."""
        problems, count = problems.at("uniform"), len(self.uniform)
        if count != 2:
            problems.add(f"expected two numbers, the lowest and the highest, got {count}")
        elif self.uniform[0] > self.uniform[1]:
            low, high = self.uniform
            problems.add(f"expected the smaller number first, got [{low:g}, {high:g}]")
        elif positive:
            _check_positive("numbers", self.uniform, problems)


@dataclass(frozen=True)
class Normal(Keys):
    """A normal distribution, truncated to numbers greater than 0 where these are required.

    Attributes
    ----------
    normal
        Mean and standard deviation.
    """

    normal: list[Real]

    @property
    def mean(self) -> float:
        """The first of the two numbers."""
        return self.normal[0]

    @property
    def variance(self) -> float:
        """The square of the second number."""
        return self.normal[1] ** 2

    def draw(self, random: np.random.Generator) -> float:
        """Return one number, of either sign."""
        return float(random.normal(self.normal[0], self.normal[1]))

    def check(self, problems: Problems, positive: bool) -> None:
        """Note anything but a mean and a standard deviation that is not negative."""
        problems, count = problems.at("normal"), len(self.normal)
        if count != 2:
            problems.add(f"expected two numbers, the mean and the standard deviation, got {count}")
        elif self.normal[1] < 0:
            problems.add(f"expected a standard deviation of at least 0, got {self.normal[1]:g}")
        elif positive:
            _check_positive("a mean", self.normal[:1], problems)


class NamesOfRuns(Protocol):
    """The numbers that runs draw by their names, of the section `draws`."""

    @property
    def means(self) -> dict[str, float]:
        """The means by name."""

    def of(self, seed: int, run: int) -> dict[str, float]:
        """Return the numbers of a run by name."""


@dataclass(frozen=True)
class NamedFormula(AsText):
    """A formula in names of the section `draws`, and perhaps in t, whose numbers each run draws.

    Attributes
    ----------
    text
        The formula as it is written.
    names
        The section.
    expression
        The formula, parsed.
    """

    text: str
    names: NamesOfRuns
    expression: Expression = field(compare=False, repr=False)

    def __str__(self) -> str:
        return self.text

    @property
    def moves(self) -> bool:
        """Whether it depends on t."""
        return "t" in self.expression.variables

    @property
    def mean(self) -> float:
        """The value at the means of the names."""
        return float(self.expression.evaluate(self.names.means))

    @property
    def variance(self) -> float:
        """The variance over `TRIED` runs."""
        values = [self.expression.evaluate(self.names.of(0, run)) for run in range(TRIED)]
        return float(np.var(values))

    def numbers(self, random: np.random.Generator | None) -> dict[str, float]:
        """Return the names in it with the numbers of the run of a generator; without one, means."""
        every = self.names.means
        if random is not None:
            stream: Any = random.bit_generator.seed_seq
            every = self.names.of(stream.entropy, stream.spawn_key[1])
        return {name: every[name] for name in sorted(self.expression.variables - {"t"})}

    def draw(self, random: np.random.Generator) -> float:
        """Return the value in the run of a generator, which it does not change."""
        return float(self.expression.evaluate(self.numbers(random)))

    def check(self, problems: Problems, positive: bool) -> None:
        """Note a mean that no number may be; what runs draw is checked run by run."""
        if self.moves:
            return
        if positive:
            _check_positive("a number", [self.mean], problems)
        else:
            with problems.catching():
                check_sizes(self.mean)


@dataclass(frozen=True)
class NamedNumbers:
    """The numbers of names in the formulas in t of a part, in a run.

    Attributes
    ----------
    names
        The names.
    values : (n,)
        Their numbers.
    """

    names: tuple[str, ...] = field(metadata=STRUCTURE)
    values: Any

    def at(self, t: Any) -> dict[str, Any]:
        """Return what a formula may read at time t."""
        return {"t": t} | {name: self.values[..., k] for k, name in enumerate(self.names)}

    def bound(self, expressions: Iterable[Expression | None]) -> list[Expression]:
        """Return formulas in t alone, with these numbers; of many runs, with the first ones."""
        numbers = np.reshape(self.values, (-1, len(self.names)))[0].tolist()
        values = dict(zip(self.names, numbers, strict=True))
        return [expression.bound(values) for expression in expressions if expression]


def named_numbers(
    entries: Iterable[Any], random: np.random.Generator | None
) -> NamedNumbers | None:
    """Return the numbers of all names in some entries of an option; None without a name."""
    numbers: dict[str, float] = {}
    for entry in entries:
        numbers |= entry.numbers(random) if isinstance(entry, NamedFormula) else {}
    return NamedNumbers((*numbers,), np.array([*numbers.values()])) if numbers else None


TRIED = 256
"""Runs that estimate the variance of a formula, to 9 % (1/sqrt(128), of a normal one)."""

Distribution: TypeAlias = Uniform | Normal | NamedFormula
"""A distribution from which each run draws a number; its mean stands for it outside of runs."""


def _kind(value: Any) -> str | None:
    if isinstance(value, NamedFormula):
        return "named"
    keys = vars(value) if isinstance(value, Distribution) else value
    if isinstance(keys, dict):
        return next((name for name in ("uniform", "normal") if name in keys), None)
    return None if isinstance(value, bool | list) else "number"


def _rank(value: Any) -> str | None:
    if not isinstance(value, list):
        return "one"
    return "matrix" if any(isinstance(row, list) for row in value) else "list"


if TYPE_CHECKING:  # The parts that `of_run` returns have arrays in their place.
    Number: TypeAlias = Any
    NumberOrExpression: TypeAlias = Any
    Numbers: TypeAlias = Any
    Matrix: TypeAlias = Any
else:
    _Drawn = (
        Annotated[Uniform, Tag("uniform")]
        | Annotated[Normal, Tag("normal")]
        | Annotated[NamedFormula, Tag("named")]
    )

    Number = Annotated[
        Annotated[Real, Tag("number")] | _Drawn,
        one_of(_kind, "a number, {uniform: [least, greatest]} or {normal: [mean, std]}"),
    ]
    """A number, or a distribution from which every run draws its own."""

    NumberOrExpression = Annotated[
        Annotated[Real, Tag("number")] | Annotated[str, Tag("expression")] | _Drawn,
        one_of(
            lambda value: (
                "expression" if isinstance(value, str) and not has_unit(value) else _kind(value)
            ),
            "a number, an expression in t, {uniform: [least, greatest]} or {normal: [mean, std]}",
        ),
    ]
    """A number, a distribution, or an expression in t."""

    Numbers = Annotated[
        Annotated[Number, Tag("one")] | Annotated[list[Number], Tag("list")],
        one_of(
            lambda value: None if _rank(value) == "matrix" else _rank(value),
            "a number or a list of numbers",
        ),
    ]
    """A number, or one for each of the coordinates."""

    Matrix = Annotated[
        Annotated[Number, Tag("one")]
        | Annotated[list[Number], Tag("list")]
        | Annotated[list[list[Number]], Tag("matrix")],
        one_of(_rank, "a number, a list (the diagonal) or a list of rows"),
    ]
    """A number (times the identity), a list (a diagonal) or a list of rows."""


def is_drawn(value: Any) -> bool:
    """Return whether a value is a distribution, or a list or a mapping that contains one."""
    if isinstance(value, list):
        return any(map(is_drawn, value))
    if isinstance(value, Keys) and not isinstance(value, Distribution):
        return any(map(is_drawn, vars(value).values()))
    return isinstance(value, Distribution)


def drawn(value: Any, random: np.random.Generator | None, positive: bool = False) -> Any:
    """Return a value with a number drawn from each distribution; without a generator, its mean."""
    if isinstance(value, list):
        return [drawn(entry, random, positive) for entry in value]
    if not isinstance(value, Distribution):
        if not is_drawn(value):
            return value
        entries = {name: drawn(entry, random, positive) for name, entry in vars(value).items()}
        return with_fields(value, **entries)
    if isinstance(value, NamedFormula) and value.moves:
        return value  # its names are numbers of the part
    if random is None:
        return value.mean
    number = value.draw(random)
    while positive and number <= 0 and redraws(value):  # the mean is greater, so this ends soon
        number = value.draw(random)
    return number


def redraws(value: Any) -> bool:
    """Return whether another draw in the same run can give another value; names keep theirs."""
    if isinstance(value, list):
        return all(redraws(entry) for entry in value)
    return not isinstance(value, NamedFormula)


def mean_square(value: float | Distribution) -> float:
    """Return the mean of the square of a number."""
    if isinstance(value, Distribution):
        return value.mean**2 + value.variance
    return float(value) ** 2


def lowest(value: float | Distribution) -> float:
    """Return a number, the lower bound of a uniform distribution, or the mean of a normal one."""
    return value.uniform[0] if isinstance(value, Uniform) else float(drawn(value, None))


def highest(value: float | Distribution) -> float:
    """Return a number, the upper bound of a uniform distribution, or the mean of a normal one."""
    return value.uniform[1] if isinstance(value, Uniform) else float(drawn(value, None))


LEAST = 1e-15
"""Least of numbers that must be positive, in SI units; no lag or limit of a vehicle is below."""


def check_numbers(value: Any, problems: Problems, positive: bool = False) -> None:
    """Note invalid distributions, absurd numbers, and such that are not positive but must be."""
    if isinstance(value, list):
        for index, entry in enumerate(value):
            check_numbers(entry, problems.at(index), positive)
    elif isinstance(value, Distribution):
        value.check(problems, positive)
        numbers_of = {} if isinstance(value, NamedFormula) else vars(value)
        for name, numbers in numbers_of.items():
            with problems.at(name).catching():
                check_sizes(() if problems else numbers)
    elif isinstance(value, Keys):
        for name, entry in vars(value).items():
            if is_drawn(entry):
                check_numbers(entry, problems.at(name))
    elif positive:
        _check_positive("a number", [value], problems)
    elif not isinstance(value, str):  # an expression in time, which is parsed elsewhere
        with problems.catching():
            check_sizes(value)


def _check_positive(expected: str, values: list[float], problems: Problems) -> None:
    for value in values:
        if value <= 0:
            problems.add(f"expected {expected} greater than 0, got {value:g}")
        elif not LEAST <= value <= GREATEST:
            problems.add(f"expected {expected} from {LEAST:g} to {GREATEST:g}, got {value:g}")


def check_limits(
    low: Any, high: Any, problems: Problems, names: tuple[str, str] = ("low", "high")
) -> None:
    """Note a limit without the other one, and a lower limit not below the upper, by the means."""
    for name, value, other in zip(names, (low, high), (high, low), strict=True):
        if value is None and other is not None:
            problems.at(name).add(f"missing; give both limits, {names[0]} and {names[1]}")
        elif value is not None:
            check_numbers(value, problems.at(name))
    if problems or low is None:
        return
    lows, highs = np.broadcast_arrays(*(np.atleast_1d(drawn(end, None)) for end in (low, high)))
    for index, (least, most) in enumerate(zip(lows, highs, strict=True)):
        if least >= most:
            here = problems.at(names[0], index) if np.size(low) > 1 else problems.at(names[0])
            here.add(f"expected a number less than {names[1]}, {most:g}, got {least:g}")


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
    in_time: ClassVar[tuple[str, ...]] = ()
    """Options whose entries may depend on t."""

    @property
    def varies(self) -> bool:
        """Whether the numbers of the part differ from run to run."""
        return any(is_drawn(getattr(self, field.name)) for field in dataclasses.fields(self))

    def drawn(self, random: np.random.Generator | None) -> Self:
        """Return the part with a number for each distribution; without a generator, its mean."""
        names = [field.name for field in dataclasses.fields(self)]
        options = {
            name: drawn(getattr(self, name), random, name in self.positive) for name in names
        }
        return with_fields(self, **options)

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the part of one run; without a generator, with the means.

        `vectors` have m entries, `matrices` are m × m. Any other number is an array ``(1,)``, any
        other list of numbers an array.
        """
        part = self.drawn(random)
        arrays = {
            field.name: self._as_array(field.name, getattr(part, field.name), G)
            for field in dataclasses.fields(part)
            if not field.metadata.get("is_structure")
        }
        return with_fields(part, **arrays)

    def _as_array(self, name: str, value: Any, G: MatrixLieGroup) -> Any:
        if value is None:
            return None
        if name in self.vectors:
            return vector(value, G.dimension, G)
        if name in self.matrices:
            return square(value, G.dimension, G)
        if isinstance(value, float):
            return np.array([value])
        is_numbers = isinstance(value, list) and all(isinstance(x, int | float) for x in value)
        return np.array(value, dtype=float) if is_numbers and value else value

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times, s, at which it switches to another expression, in order."""
        return np.empty(0)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note invalid numbers, and a number of entries that does not fit the coordinates."""
        for name in (*self.vectors, *self.matrices):
            here, value = problems.at(name), getattr(self, name)
            if value is not None:
                check_numbers(value, here, name in self.positive)
                if not here:
                    with here.catching():
                        self._as_array(name, drawn(value, None), G)


def check_still(value: Any, problems: Problems) -> None:
    """Note formulas in names that depend on t, where a number is expected."""
    for index, entry in enumerate(value if isinstance(value, list) else [value]):
        here = problems.at(index) if isinstance(value, list) else problems
        if isinstance(entry, list):
            check_still(entry, here)
        elif isinstance(entry, NamedFormula) and entry.moves:
            here.add(f"expected a number in each run, got '{entry}', which depends on t")


class PartKind(Kind):
    """Marks a part of a vehicle: what the class says of its numbers holds, whatever its check."""

    def checked(self, value: Any, problems: Problems, group: MatrixLieGroup | None = None) -> Any:
        """Return the part that a value describes, or None after noting its errors."""
        part = self.read(value, problems, group)
        if part is None:
            return None
        for name in set(option_names(type(part))) - {*part.in_time}:
            check_still(getattr(part, name), problems.at(name))
        if group is not None and not problems:
            part.check(group, problems)
        if not problems:
            check_declared(part, problems)
        return part


def check_declared(part: VehiclePart, problems: Problems) -> None:
    """Note numbers and times of a part that its class does not allow."""
    for name in option_names(type(part)):
        number, is_positive = getattr(part, name), name in part.positive
        if number is not None and (is_positive or is_drawn(number)):
            check_numbers(number, problems.at(name), is_positive)
    if isinstance(part, Timed) and not problems:
        part.check_times(problems)


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


# What acts from a time on, or until a time -------------------------------------------------------


@dataclass(frozen=True)
class Presence:
    """When something acts: from `since` on, and until `until`, which runs may draw.

    Engines end steps at numbers that all runs share, and find those that each run draws.

    Attributes
    ----------
    share
        1 while it acts, else 0, in t and the times that are drawn.
    over
        How long the share rises, s.
    since, until : (1,)
        The times of a run, s; None where all runs share them, or there is none.
    """

    share: Expression = field(metadata=STRUCTURE)
    over: float = field(metadata=STRUCTURE)
    since: Any = None
    until: Any = None

    def at(self, t: Any) -> Array:
        """Return the share at time t, ``(..., 1)``."""
        return stack([self.share.evaluate({"t": t} | self.drawn)])

    @property
    def drawn(self) -> dict[str, Any]:
        """The values of the times in the share that are drawn."""
        ends = {"since": self.since, "until": self.until}
        return {name: time[..., 0] for name, time in ends.items() if time is not None}

    @property
    def of_runs(self) -> Array:
        """The times at which it changes in runs that draw them, s."""
        times = [np.ravel(time) for time in self.drawn.values()]
        begins = [] if self.since is None else [np.ravel(self.since) + self.over]
        return np.concatenate([np.empty(0), *times, *begins])

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times at which it changes in all runs, s."""
        return np.empty(0) if self.drawn else instants_of([self.share], until)


def presence(since: Any, until: Any, over: float = 0.0, are_drawn: bool = False) -> Presence | None:
    """Return when something acts; None: always. Without `over`, it begins with a jump."""
    if since is None and until is None:
        return None
    ends = {"since": since, "until": until}
    names = {name: name if are_drawn else repr(float(x or 0.0)) for name, x in ends.items()}
    begin, end = names.values()
    rises = f"smoothstep(t, {begin}, {begin} + {over!r})" if over else f"step(t, {begin})"
    parts = [rises] if since is not None else []
    parts += [f"(1 - step(t, {end}))"] if until is not None else []
    share = formula("*".join(parts), ("t", *ends))
    times = {name: np.array([x]) for name, x in ends.items() if are_drawn and x is not None}
    return Presence(share, over, **times)


def presences(parts: Iterable[Any]) -> list[Presence]:
    """Return when those of some parts act that do not always act."""
    return [part.presence for part in parts if getattr(part, "presence", None) is not None]


@dataclass(frozen=True)
class Timed(VehiclePart):
    """A part that may act for a stretch of time.

    Attributes
    ----------
    since
        When it begins to act, s. Default: it acts from the start on.
    until
        When it ends, s. Default: never.
    lasts
        Instead of `until`: how long it acts from `since` on, s.
    """

    positive: ClassVar[tuple[str, ...]] = ("lasts",)

    since: Annotated[Number | None, Scale("start of the force", "s")] = field(
        default=None, kw_only=True, metadata=STRUCTURE
    )
    until: Annotated[Number | None, Scale("end of the force", "s")] = field(
        default=None, kw_only=True, metadata=STRUCTURE
    )
    lasts: Annotated[Number | None, Scale("duration of the force", "s")] = field(
        default=None, kw_only=True, metadata=STRUCTURE
    )
    presence: Any = field(default=None, init=False, repr=False)

    @property
    def rising(self) -> float:
        """How long it takes to be there, s."""
        return 0.0

    def drawn(self, random: np.random.Generator | None) -> Self:
        """Return the part with a number for each distribution, and when it acts."""
        part: Any = super().drawn(random)
        until = part.until if self.lasts is None else part.since + part.lasts
        are_drawn = any(map(is_drawn, (self.since, self.until, self.lasts)))
        acts = presence(part.since, until, self.rising, are_drawn)
        return with_fields(part, presence=acts)

    def check_times(self, problems: Problems) -> None:
        """Note a beginning before the start of a run, and an end that is not after it."""
        since, lasts = self.since, self.lasts
        if since is not None and lowest(since) < 0:
            problems.at("since").add(f"expected at least 0 s, got {lowest(since):g} s")
        if lasts is not None and (since is None or self.until is not None):
            got = "without since" if since is None else "with until"
            problems.at("lasts").add(f"counts from since, got it {got}; write since and lasts")
        for name, value in (("lasts", lasts), ("until", self.until)):
            begins = 0.0 if since is None or name == "lasts" else highest(since)
            if value is not None and lowest(value) <= begins + self.rising:
                after = f"more than {begins + self.rising:g} s, at which it is there"
                remedy = "; `lasts` counts from since" if is_drawn(since) else ""
                problems.at(name).add(f"expected {after}, got {lowest(value):g} s{remedy}")


# The true inertia of the plant, where it differs from the model of the law ------------------------


class TrueInertia(VehiclePart):
    """The inertia tensor of the plant, where numbers may differ from run to run."""

    departs: ClassVar[str] = "inertia not as believed"

    @property
    def unloaded(self) -> "TrueInertia | None":
        """The inertia without what the body carries; None for that of the model."""
        return self

    @abstractmethod
    def at(self, model: Inertia, t: Any) -> Inertia:
        """Return the true tensor at time t, where `model` is the tensor of the law."""


@dataclass(frozen=True)
class RelativeInertia(TrueInertia):
    """The inertia (1 + r) 𝕀, with the 𝕀 of the law.

    Attributes
    ----------
    relative
        r.
    """

    relative: Number

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the inertia with an r for which 1 + r is greater than 0."""
        relative = drawn(self.relative, random)
        while 1.0 + relative <= 0 and redraws(self.relative):
            relative = drawn(self.relative, random)
        return with_fields(self, relative=np.array([relative]))

    def at(self, model: Inertia, t: Any) -> Inertia:
        """Return the model times 1 + r."""
        factor = 1.0 + self.relative[..., None]
        change = None if model.change is None else model.change * factor
        added = None if model.added is None else model.added * factor
        inverse, leaves = model.inverse / factor, model.leaves
        return Inertia(model.matrix * factor, inverse, change, added=added, leaves=leaves)


@dataclass(frozen=True)
class ConstantInertia(TrueInertia):
    """A constant inertia tensor.

    Attributes
    ----------
    matrix
        A number, a list (the diagonal) or a list of rows.
    """

    matrix: Matrix
    inverse: Any = field(default=None, init=False, repr=False)

    def of_run(self, G: MatrixLieGroup, random: np.random.Generator | None) -> Self:
        """Return the inertia with matrix and inverse; draws that are not definite are repeated."""
        matrix = square(drawn(self.matrix, random), G.dimension, G)
        redrawn = random is not None and redraws(self.matrix)
        while redrawn and np.linalg.eigvalsh(matrix).min() <= 0:
            matrix = square(drawn(self.matrix, random), G.dimension, G)
        # Exact fractions, as for inertia that is not drawn, take long for each run.
        return with_fields(self, matrix=matrix, inverse=inverse_spd(matrix))

    def at(self, model: Inertia, t: Any) -> Inertia:
        """Return the constant tensor."""
        return Inertia(self.matrix, self.inverse)


@dataclass(frozen=True)
class VaryingInertia(TrueInertia):
    """An inertia tensor that is a function of time, or that has an added part.

    Attributes
    ----------
    law
        The tensor as a function of time.
    """

    law: InertiaLaw

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times at which the tensor changes its piece."""
        return self.law.instants(G, until)

    def at(self, model: Inertia, t: Any) -> Inertia:
        """Return the tensor at time t."""
        return self.law.at(t)


@runtime_checkable
class CarriesMass(Protocol):
    """A force of something that joins the body, whose true inertia it changes."""

    def loaded(self, inertia: TrueInertia | None) -> TrueInertia:
        """Return the inertia of a run with it; None stands for that of the model."""


# The clocks of a sampled loop: when law, sensors and actuators act, and when a command arrives ----


EXACT = 1e9
"""Largest number of periods for which rounding can tell whether it is whole."""

ROUNDING = 1e-9
"""Relative error that decimals of a time and of a period may leave."""


def periods_in(time: float, period: float, least: int = 0, name: str = "periods") -> int:
    """Return how many whole periods a time is.

    Parameters
    ----------
    time, period
        Time and period, s.
    name
        What the periods are called.

    Raises
    ------
    ValueError
        If it is no whole number of periods; it names the nearest.
    """
    count = time / period
    if not least * (1 - ROUNDING) <= count < EXACT:
        raise ValueError(
            f"expected from {least} to {EXACT:g} {name} of {period:.10g} s, got {time:.10g} s"
        )
    if abs(count - round(count)) > ROUNDING * max(count, 1.0):
        near = [math.floor(count), math.ceil(count)]
        times = " or ".join(f"{1e3 * count * period:.10g} ms" for count in near)
        raise ValueError(
            f"expected a whole number of {name} of {1e3 * period:.10g} ms, got "
            f"{1e3 * time:.10g} ms; "
            f"write {times}"
        )
    return round(count)


def common_divisor(times: Iterable[float]) -> float:
    """Return the greatest time of which all times are whole multiples, up to decimals."""
    divisor = 0.0
    for time in times:
        floor = ROUNDING * max(time, divisor) * EXACT ** (1 / 3)
        rest = 0.0 if 0 < divisor <= floor else time  # too fine already
        while rest > floor:
            divisor, rest = rest, abs(math.remainder(divisor, rest))
    return divisor


def check_period(
    period: float, control: float | None, problems: Problems, name: str = "periods"
) -> int | None:
    """Return the number of control periods, or ticks, in a period; note it if it is not whole."""
    if control is None:
        problems.add("counts control periods; set control.period")
        return None
    try:
        return periods_in(period, control, 1, name)
    except ValueError as error:
        problems.add(str(error))
        return None


class Clock(NamedTuple):
    """The ticks at which a part acts, in which `every` is the step and `offset` the first one.

    Attributes
    ----------
    every
        Number of ticks between two of its instants.
    offset
        Number of the first tick, less than `every`.
    """

    every: int = 1
    offset: int = 0

    @property
    def acts_always(self) -> bool:
        """Whether the part acts at every tick."""
        return self == (1, 0)

    def is_due(self, tick: Any) -> Any:
        """Return whether the part acts at a tick, or at each of an array of ticks."""
        return (tick - self.offset) % self.every == 0

    def numbers(self, ticks: int) -> Array:
        """Return the number of the last measurement at each of so many ticks, from 0.

        The first is of t = 0, whatever the offset.
        """
        return (np.arange(ticks) - self.offset) // self.every + (self.offset > 0)


ALWAYS = Clock()
"""The clock of a part that acts at every tick."""


@dataclass(frozen=True)
class Sampling:
    """The tick of a loop, and the clock of its law, whose command is held from instant to instant.

    Attributes
    ----------
    period
        Control period: the time between two instants of the law, s.
    delay
        Number of ticks after which a command arrives; until the first one does, 0 is held.
    clock
        Clock of the law.
    """

    period: float
    delay: int = 0
    clock: Clock = ALWAYS

    departs = "sampled control"

    @property
    def tick(self) -> float:
        """Time between two ticks, s."""
        return self.period / self.clock.every

    def clock_of(self, period: float | None, offset: float | None) -> Clock:
        """Return the clock of a part with a period and an offset, s; that of the law for None."""
        if period is None:
            every, first = self.clock
        else:
            every, first = round(period / self.tick), 0
        return Clock(every, first if offset is None else round(offset / self.tick))

    def ticks_of(self, delay: int | str) -> int:
        """Return the ticks of a delay: a whole number of control periods, or a time as text."""
        if isinstance(delay, int):
            return delay * self.clock.every
        return round(seconds(delay) / self.tick)
