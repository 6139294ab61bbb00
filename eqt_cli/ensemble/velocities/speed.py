"""Initial velocities of a given size."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.option_types import Real, Scale
from eqt_cli.core.problems import Problems
from eqt_cli.ensemble.spread import Axis, check_axis, check_size, directed
from eqt_cli.ensemble.velocities.base import VelocityDistribution
from eqt_cli.groups import MatrixLieGroup, Part


@dataclass(frozen=True)
class Speed:
    """A velocity by its size and axis.

    Attributes
    ----------
    speed
        Its size; of a list of two, uniform between them.
    axis
        `random`, uniform over all directions, or a vector in the body frame.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "strict": True}

    speed: Annotated[Real | list[Real], Scale("initial speed of translation", "m/s")]
    axis: Axis = "random"


@dataclass(frozen=True)
class SpeedVelocity(VelocityDistribution):
    """An angular velocity of a given size about a random axis or a given one; others are 0.

    Attributes
    ----------
    speed
        Of the rotation, rad/s; of a list of two, uniform between them.
    axis
        `random`, uniform over all directions, or a vector in the body frame; in the plane [1] or
        [-1].
    translation
        `speed` (m/s) and `axis` of the translation; 0 where not given.
    """

    name: ClassVar[str] = "speed"

    speed: Annotated[Real | list[Real], Scale("initial angular speed", "rad/s")] = 0.0
    axis: Axis = "random"
    translation: Speed | None = None

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """The coordinates of the rotation, then those of the translation."""
        found = np.zeros(G.dimension)
        for part, own in self._by_part(G):
            length = part.axes.stop - part.axes.start
            found[part.axes] = directed(own.speed, own.axis, length, generator)
        return found

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Parts that the group does not have once, sizes below 0, another kind of axis."""
        turning = sum(part.turns for part in G.parts)
        moving = sum(part.velocity_unit == "m/s" for part in G.parts)
        check_size(self.speed, problems.at("speed"))
        if np.any(self.speed) and turning != 1:
            instead = "use fixed or normal" if turning else "give `translation` instead"
            problems.at("speed").add(f"{G.name} has {turning or 'no'} rotations; {instead}")
        if self.translation is not None:
            check_size(self.translation.speed, problems.at("translation", "speed"))
            if G.translation is None:
                instead = "use fixed or normal" if moving else "remove this key"
                problems.at("translation").add(
                    f"{G.name} has {moving or 'no'} translations; {instead}"
                )
        for part, own in self._by_part(G):
            at_part = problems if part.turns else problems.at("translation")
            check_axis(own.axis, part.axes.stop - part.axes.start, at_part.at("axis"))

    def _by_part(self, G: MatrixLieGroup) -> Iterator[tuple[Part, Speed]]:
        """The parts of the velocity that are not 0."""
        turning = [part for part in G.parts if part.turns]
        if len(turning) == 1:
            yield turning[0], Speed(self.speed, self.axis)
        if self.translation is not None and G.translation is not None:
            yield G.translation, self.translation
