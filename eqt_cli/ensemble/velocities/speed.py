"""Initial velocities of a given size."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import Problems
from eqt_cli.core.option_types import Real, Scale
from eqt_cli.ensemble.spread import Axis, check_axis, check_size, directed
from eqt_cli.ensemble.velocities.base import VelocityDistribution
from eqt_cli.groups import MatrixLieGroup, Part


@dataclass(frozen=True)
class Speed:
    """A velocity by its size and axis.

    Attributes
    ----------
    speed
        The size; uniform between the two of a list.
    axis
        `random`, uniform over all directions, or a vector in the body frame.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "strict": True}

    speed: Annotated[Real | list[Real], Scale("initial speed of translation", "m/s")]
    axis: Axis = "random"


@dataclass(frozen=True)
class SpeedVelocity(VelocityDistribution):
    """An angular velocity of a given size about a random or a fixed axis; the rest is 0.

    Attributes
    ----------
    speed
        The angular speed, rad/s; uniform between the two of a list.
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

    def draw(self, G: MatrixLieGroup, generator: np.random.Generator) -> Array:
        """Return the coordinates; the rotation is drawn before the translation."""
        velocity = np.zeros(G.dimension)
        for part, of_part in self._by_part(G):
            length = part.axes.stop - part.axes.start
            velocity[part.axes] = directed(of_part.speed, of_part.axis, length, generator)
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
        for part, of_part in self._by_part(G):
            at_part = problems if part.turns else problems.at("translation")
            check_axis(of_part.axis, part.axes.stop - part.axes.start, at_part.at("axis"))

    def _by_part(self, G: MatrixLieGroup) -> Iterator[tuple[Part, Speed]]:
        """Yield the parts of the velocity that may differ from 0."""
        rotations = [part for part in G.parts if part.turns]
        if len(rotations) == 1:
            yield rotations[0], Speed(self.speed, self.axis)
        if self.translation is not None and G.translation is not None:
            yield G.translation, self.translation
