"""An attitude law that commands an angular velocity, as autopilots do."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from eqt_cli.base.arrays import Array, apply, clip, cos, sin, sqrt, stack
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Positive, Scale
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
    defined at half turns. With a `yaw_weight` w, both turns are one, of which the second has w
    times its angle, and the gain about the third axis is divided by w: PX4's AttitudeControl.cpp
    (commit 129a2ae6) without its reference model.

    Attributes
    ----------
    kp
        k_p, 1/s: one, or one about each axis.
    error
        `full` or `reduced`.
    yaw_weight
        w of `reduced`, above 0 and at most 1; PX4's `MC_YAW_WEIGHT`.
    limit
        Largest rates, rad/s: one, or one about each axis; PX4's `MC_ROLLRATE_MAX`, and so on.
    """

    name: ClassVar[str] = "rate"
    tasks: ClassVar[tuple[str, ...]] = ()
    theorem: ClassVar[str] = ""
    reads_gains: ClassVar[bool] = False
    commands: ClassVar[str] = "rates"

    kp: Annotated[EachAxis, Scale("k_p", "1/s", is_symbol=True)]
    error: Literal["full", "reduced"] = "full"
    yaw_weight: Annotated[Positive | None, Scale("yaw weight")] = None
    limit: Annotated[EachAxis | None, Scale("limit of the rates", "rad/s")] = None

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups other than SO3, and gains that are not for each axis."""
        if not (G.compact and G.dimension == G.size == 3):
            problems.add(f"rate is a law for SO3, got {G.name}; on SE3, use it inside a cascade")
        check_each_axis(self.kp, 3, problems.at("kp"))
        check_each_axis(self.limit, 3, problems.at("limit"))
        if self.yaw_weight is not None and self.error != "reduced":
            problems.at("yaw_weight").add("applies to error: reduced; write that, too")
        elif self.yaw_weight is not None and self.yaw_weight > 1:
            problems.at("yaw_weight").add(f"expected at most 1, got {self.yaw_weight:g}")

    def torque(self, s: Tracking) -> Array:
        """ω_c, body frame."""
        r = s.relative
        E = r.Q.swapaxes(-1, -2)
        e = r.G.vee(E - r.Q) / sqrt(1.0 + E[..., 0, 0] + E[..., 1, 1] + E[..., 2, 2])[..., None]
        if self.error == "reduced":
            c = sqrt(2.0 / (1.0 + E[..., 2, 2]))
            e = stack([-c * E[..., 1, 2], c * E[..., 0, 2], c * e[..., 2]])
            e = e if self.yaw_weight is None else self._weighed(e, 1.0 / c)
        rate = s.V - r.V_tilde + self.kp * e
        return rate if self.limit is None else clip(rate, -self.limit, self.limit)

    def _weighed(self, e: Array, cosine: Array) -> Array:
        """Return the error of one turn, of the tilt with the cosine of half its angle, and yaw."""
        w: Any = self.yaw_weight
        half = w * apply("asin", clip(e[..., 2, None] / 2.0, -1.0, 1.0))
        c, s, x, y = cos(half), sin(half), e[..., :1], e[..., 1:2]
        parts = c * x + s * y, c * y - s * x, 2.0 * cosine[..., None] * s / w
        return np.concatenate(parts, axis=-1)
