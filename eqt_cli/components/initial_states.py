"""Distributions of initial poses and velocities, and the seeds of their random numbers."""

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated, Any, ClassVar, Literal
from zlib import crc32

import numpy as np
from numpy.random import Generator

from eqt_cli.base import option_types
from eqt_cli.base.arrays import Array, norm
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import POSE, VELOCITY, Angle, Kind, Real, Scale, Unit
from eqt_cli.base.registry import Component, Keys, Registry
from eqt_cli.components.groups import MatrixLieGroup, Part, ProductGroup
from eqt_cli.components.matrix_groups import EuclideanGroup, rotation_of_euler
from eqt_cli.components.pose_notation import check_sizes

# Random streams, and the base class of distributions ----------------------------------------------
#
# Run k draws the same numbers for any number and order of runs, workers and controllers.


class Stream(IntEnum):
    """The purpose of a stream; its number affects every result and must not change."""

    INITIAL_STATE = 0
    CROSS_CHECK = 1
    CERTIFICATES = 2
    VEHICLE = 3
    EXACT_STATES = 4
    EXPORTED_STATES = 5
    CODE = 6


def generator(root: int, stream: Stream, run: int) -> Generator:
    """Return the generator of one run in one stream."""
    sequence = np.random.SeedSequence(root, spawn_key=(int(stream), run))
    return Generator(np.random.PCG64DXSM(sequence))


def generator_at(root: int, stream: Stream, run: int, place: str) -> Generator:
    """Return the generator of one run for the component at a place of the configuration."""
    sequence = np.random.SeedSequence(root, spawn_key=(int(stream), run, crc32(place.encode())))
    return Generator(np.random.Philox(sequence))


Axis = Literal["random"] | list[Real]
"""A fixed or a random direction."""


class Distribution(Component):
    """A distribution drawn for each run: a frozen dataclass whose fields are its options."""

    @abstractmethod
    def draw(self, G: MatrixLieGroup, generator: Generator) -> Array:
        """Return the random numbers of one run."""

    def draw_of_run(self, G: MatrixLieGroup, generator: Generator, run: int) -> Array:
        """Return the numbers of a run, in distributions that depend on its number."""
        return self.draw(G, generator)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note options that do not fit the group."""


@dataclass(frozen=True)
class Spread(Keys):
    """Independent normals around 0.

    Attributes
    ----------
    std
        Standard deviation of every entry, or one per entry, in the unit of the entries.
    """

    std: Real | list[Real] = 1.0

    def draw(self, length: int, generator: Generator) -> Array:
        """Return `length` independent normals."""
        return np.asarray(self.std) * generator.standard_normal(length)

    def check(self, length: int, problems: Problems) -> None:
        """Note a wrong number of standard deviations, or a negative one."""
        problems = problems.at("std")
        if isinstance(self.std, list) and len(self.std) != length:
            expected = f"expected a number or a list of {length}"
            problems.add(f"{expected}, got a list of {len(self.std)}")
        elif np.min(self.std) < 0:
            problems.add(f"expected a standard deviation of at least 0, got {np.min(self.std):g}")
        with problems.catching():
            check_sizes(self.std)


@dataclass(frozen=True)
class NormalCoordinates:
    """m independent normal coordinates."""

    std: Real | list[Real] = 1.0

    def draw(self, G: MatrixLieGroup, generator: Generator) -> Array:
        """Return std · N(0, 1)^m."""
        return Spread(self.std).draw(G.dimension, generator)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a wrong number of standard deviations, or a negative one."""
        Spread(self.std).check(G.dimension, problems)


@dataclass(frozen=True)
class Coordinates:
    """The same m coordinates in every run; 0 where none are given."""

    coordinates: list[Real] | None = None

    def draw(self, G: MatrixLieGroup, generator: Generator) -> Array:
        """Return the coordinates."""
        return np.zeros(G.dimension) if self.coordinates is None else np.array(self.coordinates)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a wrong number of coordinates."""
        check_coordinates(self.coordinates, G, problems.at("coordinates"))


def check_coordinates(values: list[Real] | None, G: MatrixLieGroup, problems: Problems) -> None:
    """Note a wrong number of algebra coordinates."""
    if values is not None and len(values) != G.dimension:
        problems.add(f"expected {G.dimension} numbers for {G.name}, got {len(values)}")
    with problems.catching():
        check_sizes(values or ())


# Vectors by size and axis -------------------------------------------------------------------------


def directed(size: float | list[float], axis: Axis, length: int, generator: Generator) -> Array:
    """Return a vector of a fixed or a uniform size, ``(length,)``; a random axis is isotropic."""
    low, high = size if isinstance(size, list) else (size, size)
    size = generator.uniform(low, high)
    direction = generator.standard_normal(length) if isinstance(axis, str) else np.array(axis)
    return size * (direction / norm(direction))


def check_size(size: float | list[float], problems: Problems) -> None:
    """Note a list that is not a smallest and a largest size, and a size below 0."""
    if isinstance(size, list) and (len(size) != 2 or size[0] > size[1]):
        problems.add(f"expected a number, or a list of the smallest and the largest, got {size}")
    elif np.min(size) < 0:
        problems.add(f"expected a number of at least 0, got {np.min(size):g}")
    with problems.catching():
        check_sizes(size)


def check_axis(axis: Axis, length: int, problems: Problems) -> None:
    """Note an axis of a wrong length, or without a direction."""
    if isinstance(axis, list) and (len(axis) != length or not any(axis)):
        expected = f"a list of {length} that are not all 0" if length > 1 else "[1] or [-1]"
        problems.add(f"expected random, or {expected}, got {axis}")


# Base classes of distributions of the initial pose ------------------------------------------------


@dataclass(frozen=True)
class PoseDistribution(Distribution):
    """A distribution on a group: a frozen dataclass whose fields are its options.

    It draws random numbers, ``(k,)``: run k starts at Q(0) = Q_d(0) · `place`.

    Attributes
    ----------
    angles
        Options that are angles and may exceed a half-turn.
    """

    angles: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Return the elements of G for the runs' numbers, ``(runs, k) -> (runs, d, d)``.

        This is separate from `draw`, so that many runs need only one array operation, or the code
        that an engine compiles of it. A distribution of eqt uses no numbers but these.
        """


@dataclass(frozen=True)
class RotationDistribution(PoseDistribution):
    """A distribution of the rotation part; translation columns are normal, or 0 where not given.

    Attributes
    ----------
    position, velocity
        Spread of the translation column of that name.
    """

    position: Annotated[Spread | None, Unit("m")] = None
    velocity: Annotated[Spread | None, Unit("m/s")] = None

    def draw(self, G: MatrixLieGroup, generator: Generator) -> Array:
        """Return the numbers of the rotation, then those of the columns from left to right."""
        assert isinstance(G, EuclideanGroup)  # `check` lets no other group through
        numbers = [self.draw_rotation(G, generator)]
        for column in G.columns:
            spread: Spread | None = getattr(self, column)
            numbers.append(np.zeros(G.space) if spread is None else spread.draw(G.space, generator))
        return np.concatenate(numbers)

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Return the poses of many runs."""
        assert isinstance(G, EuclideanGroup)
        k = numbers.shape[1] - G.space * len(G.columns)
        columns = numbers[:, k:].reshape(len(numbers), len(G.columns), G.space).swapaxes(-1, -2)
        return G.assemble(self.place_rotation(G, numbers[:, :k]), columns)

    @abstractmethod
    def draw_rotation(self, G: EuclideanGroup, generator: Generator) -> Array:
        """Return the random numbers of one run's rotation, ``(k,)``."""

    @abstractmethod
    def place_rotation(self, G: EuclideanGroup, numbers: Array) -> Array:
        """Return the rotations of many runs, ``(runs, k) -> (runs, n, n)``."""

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a group without rotations, and a column that it does not have."""
        if not isinstance(G, EuclideanGroup) or not G.rotations:
            advice = f"for {G.name} use exp_normal"
            if isinstance(G, ProductGroup):
                advice += f", or a list of {len(G.factors)}, one per factor"
            problems.at("kind").add(f"{self.name} needs a group with rotations; {advice}")
            return
        for column in ("position", "velocity"):
            spread: Spread | None = getattr(self, column)
            if spread is not None and column in G.columns:
                spread.check(G.space, problems.at(column))
            elif spread is not None:
                columns = ", ".join(G.columns)
                why = f"only {columns}" if columns else "since it has no translations"
                problems.at(column).add(f"{G.name} has no {column} column, {why}; remove this key")


pose_distributions = Registry(
    "pose distribution", "poses", PoseDistribution, ("components.initial_states",)
)


@dataclass(frozen=True)
class AnglePose(RotationDistribution):
    """A rotation by a fixed or a uniform angle, about a random or a fixed axis.

    Attributes
    ----------
    angle
        From 0 to 180 deg, in rad or such as 170 deg; a list of two gives the bounds of a uniform
        angle.
    axis
        `random`, uniform over all directions, or a vector in the frame of the desired pose; in the
        plane [1] or [-1].
    """

    name: ClassVar[str] = "angle"

    angle: Annotated[Angle | list[Angle], Scale("initial angle", "rad")] = np.pi
    axis: Axis = "random"

    def draw_rotation(self, G: EuclideanGroup, generator: Generator) -> Array:
        """Return a rotation vector, the angle along the axis."""
        return directed(self.angle, self.axis, G.rotations, generator)

    def place_rotation(self, G: EuclideanGroup, numbers: Array) -> Array:
        """Return exp of the rotation vectors."""
        still = np.zeros((len(numbers), G.dimension - G.rotations))
        return G.rotation(G.exp(np.concatenate([numbers, still], axis=1)))

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a group without rotations, an angle beyond a half-turn, and an invalid axis."""
        super().check(G, problems)
        check_size(self.angle, problems.at("angle"))
        if (largest := np.max(self.angle)) > np.pi:
            got = f"{np.degrees(largest):.6g} deg"
            problems.at("angle").add(f"expected an angle from 0 to 180 deg, got {got}")
        if isinstance(G, EuclideanGroup) and G.rotations:
            check_axis(self.axis, G.rotations, problems.at("axis"))


# Rotations with uniform Euler angles, as in the paper's §7 ----------------------------------------


@dataclass(frozen=True)
class Euler(RotationDistribution):
    """Three independent Euler angles, uniform between two bounds; the rotation is not uniform.

    Attributes
    ----------
    sequence
        Axes as in SciPy: upper case for moving (intrinsic), lower case for fixed axes.
    low, high
        Bounds of each angle, rad, or such as 90 deg.
    """

    name: ClassVar[str] = "euler"
    angles: ClassVar[tuple[str, ...]] = ("low", "high")

    sequence: str = "ZYX"
    low: Angle = -np.pi
    high: Angle = np.pi

    def draw_rotation(self, G: EuclideanGroup, generator: Generator) -> Array:
        """Return three angles."""
        return generator.uniform(self.low, self.high, size=3)

    def place_rotation(self, G: EuclideanGroup, numbers: Array) -> Array:
        """Return the rotations with these angles."""
        return rotation_of_euler(self.sequence, numbers)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a group without rotations of space, an invalid sequence, and invalid bounds."""
        super().check(G, problems)
        if isinstance(G, EuclideanGroup) and G.space != 3:
            advice = f"for {G.name} use haar or exp_normal"
            problems.at("kind").add(f"euler needs rotations in three dimensions; {advice}")
        axes = self.sequence.upper()
        valid = len(axes) == 3 and set(axes) <= set("XYZ") and axes[1] not in (axes[0], axes[2])
        if not valid or self.sequence not in (axes, axes.lower()):
            expected = "expected three axes such as ZYX (intrinsic) or xyz (extrinsic)"
            problems.at("sequence").add(f"{expected}, got '{self.sequence}'")
        if self.low > self.high:
            expected = f"expected at most {self.high:g}, the value of high"
            problems.at("low").add(f"{expected}, got {self.low:g}")


@dataclass(frozen=True)
class ExpNormal(NormalCoordinates, PoseDistribution):
    """A pose times exp of independent normal algebra coordinates, for every group.

    Attributes
    ----------
    std
        Standard deviation of the coordinates; angles also such as 5 deg.
    centre
        Coordinates of the central pose. Default: the identity.
    """

    name: ClassVar[str] = "exp_normal"

    std: Annotated[Real | list[Real], Unit(POSE)] = 1.0
    centre: Annotated[list[Real] | None, Unit(POSE)] = None

    def draw(self, G: MatrixLieGroup, generator: Generator) -> Array:
        """Return the centre, if there is one, and std · N(0, 1)^m."""
        return np.concatenate([self.centre or [], super().draw(G, generator)])

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Return exp of the centre times exp of the coordinates."""
        m = G.dimension
        placed = G.exp(numbers[..., -m:])
        return placed if numbers.shape[-1] == m else G.exp(numbers[..., :m]) @ placed

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note a wrong number of standard deviations or coordinates, and a negative deviation."""
        super().check(G, problems)
        check_coordinates(self.centre, G, problems.at("centre"))


@dataclass(frozen=True)
class FixedPose(Coordinates, PoseDistribution):
    """exp of given algebra coordinates in every run. Default: the identity.

    Attributes
    ----------
    coordinates
        Coordinates of the algebra; on SO3 a rotation vector, rad, or such as 30 deg.
    """

    name: ClassVar[str] = "fixed"

    coordinates: Annotated[list[Real] | None, Unit(POSE)] = None

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Return exp of the coordinates."""
        return G.exp(numbers)


@dataclass(frozen=True)
class IdentityPose(PoseDistribution):
    """No error of the pose: every run starts at Q_d(0)."""

    name: ClassVar[str] = "identity"

    def draw(self, G: MatrixLieGroup, generator: Generator) -> Array:
        """Return zeros."""
        return np.zeros(G.dimension)

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Return the identity."""
        return G.exp(numbers)


@dataclass(frozen=True)
class Haar(RotationDistribution):
    """The uniform (Haar) distribution of the rotation."""

    name: ClassVar[str] = "haar"

    def draw_rotation(self, G: EuclideanGroup, generator: Generator) -> Array:
        """Return normals: four for rotations of space, two for those of the plane."""
        return generator.standard_normal(4 if G.space == 3 else 2)

    def place_rotation(self, G: EuclideanGroup, numbers: Array) -> Array:
        """Return the rotations in the directions of these normals."""
        return G.rotation_towards(numbers)


@dataclass(frozen=True)
class VelocityDistribution(Distribution):
    """A distribution on g: a frozen dataclass whose fields are its options.

    It draws the coordinates of an algebra element, ``(m,)``: run k starts at V(0) = V_d(0) + draw.
    """


velocity_distributions = Registry(
    "velocity distribution", "velocities", VelocityDistribution, ("components.initial_states",)
)


@dataclass(frozen=True)
class FixedVelocity(Coordinates, VelocityDistribution):
    """A given velocity error in every run. Default: 0.

    Attributes
    ----------
    coordinates
        m coordinates.
    """

    name: ClassVar[str] = "fixed"

    coordinates: Annotated[list[Real] | None, Unit(VELOCITY)] = None


@dataclass(frozen=True)
class Normal(NormalCoordinates, VelocityDistribution):
    """Independent normal velocity coordinates.

    Attributes
    ----------
    std
        Standard deviation of the coordinates.
    """

    name: ClassVar[str] = "normal"

    std: Annotated[Real | list[Real], Unit(VELOCITY)] = 1.0


# Initial velocities of a given size ---------------------------------------------------------------


@dataclass(frozen=True)
class Speed(Keys):
    """A velocity by its size and axis.

    Attributes
    ----------
    speed
        The size; uniform between the two of a list.
    axis
        `random`, uniform over all directions, or a vector in the body frame.
    """

    speed: Annotated[Real | list[Real], Scale("initial speed of translation", "m/s")]
    axis: Axis = "random"


@dataclass(frozen=True)
class SpeedVelocity(VelocityDistribution):
    """An angular velocity of a given size about a random or a fixed axis; the rest is 0.

    Attributes
    ----------
    speed
        Angular speed, rad/s; a list of two gives the bounds of a uniform speed.
    axis
        `random`, uniform over all directions, or a vector in the body frame; in the plane [1] or
        [-1].
    translation
        `speed` (m/s) and `axis` of the translation. Default: 0.
    """

    name: ClassVar[str] = "speed"

    speed: Annotated[Real | list[Real], Scale("initial angular speed", "rad/s")] = 0.0
    axis: Axis = "random"
    translation: Speed | None = None

    def draw(self, G: MatrixLieGroup, generator: Generator) -> Array:
        """Return the coordinates; the rotation is drawn before the translation."""
        velocity = np.zeros(G.dimension)
        for part, motion in self._by_part(G):
            length = part.axes.stop - part.axes.start
            velocity[part.axes] = directed(motion.speed, motion.axis, length, generator)
        return velocity

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note parts that the group does not have exactly once, sizes below 0, and invalid axes."""
        rotations = sum(part.turns for part in G.parts)
        translations = sum(part.velocity_unit == "m/s" for part in G.parts)
        check_size(self.speed, problems.at("speed"))
        if np.any(self.speed) and rotations != 1:
            advice = "use fixed or normal" if rotations else "give `translation` instead"
            problems.at("speed").add(f"{G.name} has {rotations or 'no'} rotations; {advice}")
        if self.translation is not None:
            check_size(self.translation.speed, problems.at("translation", "speed"))
            if G.translation is None:
                advice = "use fixed or normal" if translations else "remove this key"
                problems.at("translation").add(
                    f"{G.name} has {translations or 'no'} translations; {advice}"
                )
        for part, motion in self._by_part(G):
            here = problems.at("axis") if part.turns else problems.at("translation", "axis")
            check_axis(motion.axis, part.axes.stop - part.axes.start, here)

    def _by_part(self, G: MatrixLieGroup) -> Iterator[tuple[Part, Speed]]:
        """Yield the parts of the velocity that may differ from 0."""
        rotations = [part for part in G.parts if part.turns]
        if len(rotations) == 1:
            yield rotations[0], Speed(self.speed, self.axis)
        if self.translation is not None and G.translation is not None:
            yield G.translation, self.translation


# The initial states of an ensemble's runs: drawn, or from a list ----------------------------------


@dataclass(frozen=True)
class _Listed(Distribution):
    """An error of every run, ``(runs, …)``, and remarks on their file."""

    errors: Array
    notes: tuple[str, ...] = ()

    def draw(self, G: MatrixLieGroup, generator: Generator) -> Array:
        """Return the error of the first run."""
        return self.draw_of_run(G, generator, 0)

    def draw_of_run(self, G: MatrixLieGroup, generator: Generator, run: int) -> Array:
        """Return the error of the run."""
        return self.errors[run]


class ListedPoses(_Listed, PoseDistribution):
    """Q_d(0)⁻¹ Q(0) of every run, ``(runs, d, d)``."""

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Return the poses, which are the numbers themselves."""
        return numbers


class ListedVelocities(_Listed, VelocityDistribution):
    """V(0) − V_d(0) of every run, ``(runs, m)``."""


@dataclass(frozen=True)
class FactorPoses(PoseDistribution):
    """Independent draws for each factor, in their order."""

    factors: tuple[PoseDistribution, ...]

    def draw(self, G: MatrixLieGroup, generator: Generator) -> Array:
        """Return the numbers of all factors."""
        return np.concatenate(
            [states.draw(factor, generator) for states, factor in self._by_factor(G)]
        )

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Return the poses of all factors as one pose."""
        assert isinstance(G, ProductGroup)
        poses: list[Array] = []
        for distribution, factor in self._by_factor(G):
            length = len(distribution.draw(factor, np.random.default_rng(0)))
            poses.append(distribution.place(factor, numbers[:, :length]))
            numbers = numbers[:, length:]
        return G.assemble(poses)

    def _by_factor(self, G: MatrixLieGroup) -> list[tuple[PoseDistribution, MatrixLieGroup]]:
        assert isinstance(G, ProductGroup)  # checked where the configuration is read
        return list(zip(self.factors, G.factors, strict=True))


@dataclass(frozen=True)
class PoseKind(Kind):
    """A distribution, or for a product of groups a list with one for each factor."""

    def checked(self, value: Any, problems: Problems, group: MatrixLieGroup | None = None) -> Any:
        """Return the distribution that a value describes, or None after noting its errors."""
        if not isinstance(value, list):
            return super().checked(value, problems, group)
        factors = group.factors if isinstance(group, ProductGroup) else ()
        if len(value) != len(factors):
            if group is not None:
                expected = "one distribution"
                if factors:
                    expected = f"{len(factors)} entries, one per factor of {group.name}"
                problems.add(f"expected {expected}, got a list of {len(value)}")
            return None
        poses = [
            super(PoseKind, self).checked(entry, problems.at(k), factors[k])
            for k, entry in enumerate(value)
        ]
        return None if None in poses else FactorPoses(tuple(poses))

    def section(self, poses: Any) -> Any:
        """Return the value that describes a distribution."""
        if isinstance(poses, FactorPoses):
            return [option_types.as_section(factor) for factor in poses.factors]
        return option_types.as_section(poses)
