"""A reference that moves from one pose to another, at rest before and after."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from eqt_cli.core.errors import Problems
from eqt_cli.core.option_types import Positive, Real, Unit
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.motions import Pieces, eased
from eqt_cli.notation.poses import pose_from
from eqt_cli.references.base import PiecewiseReference


@dataclass(frozen=True)
class SlewReference(PiecewiseReference):
    """Rest to rest along the geodesic from · exp(a(t) log(from⁻¹ to)).

    Attributes
    ----------
    to
        The final pose.
    duration
        Duration, s.
    from_
        The initial pose.
    start
        Start time, s.
    profile
        a(t): ``quintic``, 10s³ − 15s⁴ + 6s⁵, which minimises the jerk; velocity and
        acceleration are 0 at both ends.
    """

    name: ClassVar[str] = "slew"

    to: Any
    duration: Annotated[Positive, Unit("s")]
    from_: Any = "identity"
    start: Annotated[Real, Unit("s")] = 0.0
    profile: Literal["quintic"] = "quintic"

    def pieces(self, G: MatrixLieGroup) -> Pieces:
        """Return three pieces: rest, the slew, and rest."""
        start, end = (pose_from(pose, G, Problems()) for pose in (self.from_, self.to))
        assert start is not None and end is not None
        turn = G.log(G.inverse(start) @ end)
        return eased(G, self.start, self.start + self.duration, start, turn)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note invalid poses."""
        for option, pose in (("from", self.from_), ("to", self.to)):
            pose_from(pose, G, problems.at(option))
