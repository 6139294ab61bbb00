"""The super-twisting algorithm on a group."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self

from eqt_cli.base.arrays import Array, Arrays, absolute, less, sqrt, where
from eqt_cli.base.errors import Problems, Remedy
from eqt_cli.base.option_types import VELOCITY, Positive, Scale, Unit
from eqt_cli.components.classic_laws import SlidingVariable
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.laws import EachAxis, check_each_axis, published
from eqt_cli.components.mechanics import Tracking
from eqt_cli.components.motions import PlantModel


@dataclass(frozen=True)
class SuperTwisting(SlidingVariable):
    """Super-twisting of the sliding variable, on every group; it uses its own gains.

    τ = 𝕀V̇_r + 𝕀̇V_r − ad*_V 𝕀V + Ṡ*S⁻* 𝕀s − 𝕀(k₁ |s|^½ sgn s − z), ż = −k₂ sgn s, z(0) = 0, with
    s = V − V_r and V_r of `sliding`, coordinate by coordinate. Other than there, the gyroscopic
    force is cancelled whole: with a constant 𝕀 and a force δ that the model does not know,

        ṡ = −k₁ |s|^½ sgn s + z + 𝕀⁻¹δ,

    the algorithm of Moreno and Osorio (2008) with the perturbation 𝕀⁻¹δ, of whose paper only the
    abstract was read. s is 0 after a finite time, and then z = −𝕀⁻¹δ, if k₁ is large enough for k₂,
    and k₂ for the rate of 𝕀⁻¹δ. V = 2k₂|s| + ½z² + ½(k₁|s|^½ sgn s − z)² falls along each
    coordinate without δ. `gains.kd` is not used.

    Attributes
    ----------
    k1
        k₁, rad^½/s^(3/2): a number, or one along each axis.
    k2
        k₂, rad/s³, likewise.
    layer
        ε of a smooth sign, s/√(s² + ε²), and of |s| as √(s² + ε²), rad/s (translations: m/s).
        `null` is the jump of the sign as published, which needs `control.period`.
    """

    name: ClassVar[str] = "super_twisting"
    title: ClassVar[str] = "super-twisting"
    theorem: ClassVar[str] = ""
    bibtex: ClassVar[str] = published("moreno2008lyapunov")
    matched: ClassVar[bool | None] = False
    claims_decrease: ClassVar[bool | None] = None
    weight = "body"
    output_units: ClassVar[Mapping[str, str]] = {"z": "rad/s^2"}

    k1: Annotated[EachAxis, Scale("k_1", "rad^(1/2)/s^(3/2)", is_symbol=True)] = 2.0
    k2: Annotated[EachAxis, Scale("k_2", "rad/s^3", is_symbol=True)] = 1.0
    layer: Annotated[Positive | None, Unit(VELOCITY)] = 0.01

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note gains that are not for each axis."""
        check_each_axis(self.k1, G.dimension, problems.at("k1"))
        check_each_axis(self.k2, G.dimension, problems.at("k2"))

    def for_plant(self, G: MatrixLieGroup, plant: PlantModel, problems: Problems) -> Self:
        """Note a jump of the sign that no instants interrupt."""
        if plant.period is None and self.layer is None:
            remedy = Remedy("set control.period, or a layer, such as layer: 0.01")
            problems.at("layer").add("got null, with which the sign jumps at all times", remedy)
        return self

    def torque(self, s: Tracking) -> Array:
        """τ, body frame."""
        r = self._sliding(s)
        return r.cancelling_feedforward - self.reaching(r)

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the length of z."""
        return {"z": G.dimension}

    def memory_rate(self, s: Tracking) -> Arrays:
        """ż = −k₂ sgn s."""
        return {"z": -self.k2 * self._sign(self._sliding(s).V_tilde)}

    def reaching(self, r: Tracking) -> Array:
        """𝕀(k₁ |s|^½ sgn s − z)."""
        x: Any = r.V_tilde
        size = absolute(x) if self.layer is None else sqrt(x * x + self.layer * self.layer)
        twisting = self.k1 * sqrt(size) * self._sign(x)
        return r.inertia.momentum(twisting - r.memory["z"])

    def _sign(self, x: Any) -> Any:
        if self.layer is None:
            return where(less(x, 0.0), -1.0 + 0.0 * x, where(less(0.0, x), 1.0 + 0.0 * x, 0.0 * x))
        return x / sqrt(x * x + self.layer * self.layer)
