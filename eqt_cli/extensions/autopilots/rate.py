"""An attitude law that commands an angular velocity, as autopilots do."""

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from eqt_cli.base.arrays import Array, sqrt, stack
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Scale
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.laws import Controller, EachAxis, check_each_axis
from eqt_cli.components.mechanics import Tracking


@dataclass(frozen=True)
class Rate(Controller):
    """An attitude law that commands a rate, ω_c = ξ + k_p e, to a `rate_loop`; SO3.

    ξ is the desired velocity in the body. With E = QᵀQ_d, q_0 and q its unit quaternion, `full` has
    e = 2 sgn(q_0) q (Brescianini, Hehn and D'Andrea, Nonlinear Quadrocopter Attitude Control,
    2013). `reduced` turns the third axis first, by 2 sgn(q_0) q of the shortest turn to where it is
    to point, and the rest about it (Faessler, Fontana, Forster and Scaramuzza, 2015). It is not
    defined at half turns.

    Attributes
    ----------
    kp
        k_p, 1/s: one, or one about each axis.
    error
        `full` or `reduced`.
    """

    name: ClassVar[str] = "rate"
    tasks: ClassVar[tuple[str, ...]] = ()
    theorem: ClassVar[str] = ""
    reads_gains: ClassVar[bool] = False
    commands: ClassVar[str] = "rates"

    kp: Annotated[EachAxis, Scale("k_p", "1/s", is_symbol=True)]
    error: Literal["full", "reduced"] = "full"

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups other than SO3, and gains that are not for each axis."""
        if not (G.compact and G.dimension == G.size == 3):
            problems.add(f"rate is a law for SO3, got {G.name}; on SE3, use it inside a cascade")
        check_each_axis(self.kp, 3, problems.at("kp"))

    def torque(self, s: Tracking) -> Array:
        """ω_c, body frame."""
        r = s.relative
        E = r.Q.swapaxes(-1, -2)
        e = r.G.vee(E - r.Q) / sqrt(1.0 + E[..., 0, 0] + E[..., 1, 1] + E[..., 2, 2])[..., None]
        if self.error == "reduced":
            c = sqrt(2.0 / (1.0 + E[..., 2, 2]))
            e = stack([-c * E[..., 1, 2], c * E[..., 0, 2], c * e[..., 2]])
        return s.V - r.V_tilde + self.kp * e
