"""L1 adaptive augmentation, as a law that rejects what its model does not know."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np

from eqt_cli.base.arrays import Array, exp, where
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Positive, Scale
from eqt_cli.components import laws
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.mechanics import Tracking
from eqt_cli.extensions.designed_laws.rejection import DISTURBANCE, Estimate, Outer, Rejecting


@dataclass(frozen=True)
class L1(Rejecting):
    """A law with L1 adaptation, u = τ − δ̂: piecewise constant, and a filter; on every group.

    P̂̇ = ad*_V 𝕀V + û + f + σ̂ − a P̃ with P̃ = P̂ − 𝕀V, and at control instants a period T apart

    σ̂ = −Φ⁻¹ e^{−aT} P̃,  Φ = (1 − e^{−aT})/a,  δ̂ = C σ̂,

    the adaptation of Wu and others (2023) with A_s = −a I, for momenta, by a step of Euler. A
    constant δ gives σ̂ = e^{−aT} δ. C is a low-pass filter of first order along each axis, of
    second order with `second_cutoff`. T is the period of the law. As published, around a cascade
    with `lateral: false`, δ̂ acts by torque and push alone.

    Attributes
    ----------
    cutoff
        ω of C, rad/s: a number, or one along each axis.
    second_cutoff
        The cutoff of a second such filter behind it, rad/s. Default: none.
    a
        How fast errors of the predictor decay by themselves, 1/s; less than 1/T.
    """

    name: ClassVar[str] = "l1"
    title: ClassVar[str] = "L1"
    bounded: ClassVar[tuple[str, float, str]] = "a", 1.0, "1/s"
    bibtex: ClassVar[str] = laws.published("wu2023l1quad")

    cutoff: Annotated[laws.EachAxis, Scale("cutoff", "rad/s")]
    second_cutoff: Annotated[laws.EachAxis | None, Scale("second cutoff", "rad/s")] = None
    a: Annotated[Positive, Scale("a", "1/s", is_symbol=True)] = 1.0

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note what no law that rejects may have, and cutoffs that are not for each axis."""
        super().check(G, problems)
        laws.check_each_axis(self.cutoff, G.dimension, problems.at("cutoff"))
        laws.check_each_axis(self.second_cutoff, G.dimension, problems.at("second_cutoff"))

    def share_found(self, period: float) -> float:
        """Return e^{−aT}."""
        return float(np.exp(-self.a * period))

    def memory(self, G: MatrixLieGroup) -> Mapping[str, int]:
        """Return the lengths of all states, with P̂ of the next instant without û."""
        names = ["momentum"] if self.second_cutoff is None else ["momentum", "first_filter"]
        return {**super().memory(G), **dict.fromkeys(names, G.dimension)}

    def estimated(self, s: Tracking, actuated: Array, is_first: Array, period: Any) -> Estimate:
        """Return C σ̂, P̂, and the states of the filter."""
        measured, estimate = self.framed(s, s.P), s.memory[DISTURBANCE]
        fall = exp(-self.a * period)
        begun = measured - (1.0 - fall) / (self.a * fall) * estimate
        P = where(is_first, begun, s.memory["momentum"] + period * self.framed(s, actuated))
        error = P - measured
        sigma = -self.a * fall / (1.0 - fall) * error
        states = {"momentum": P + period * (self.unforced(s) + sigma - self.a * error)}
        before, cutoff = estimate, self.cutoff
        if self.second_cutoff is not None:
            last = where(is_first, estimate, s.memory["first_filter"])
            sigma = _filtered(cutoff, period, last, sigma)
            states["first_filter"], cutoff = sigma, self.second_cutoff
        return _filtered(cutoff, period, before, sigma), states


def _filtered(cutoff: Any, period: Any, before: Array, new: Array) -> Array:
    c = exp(-cutoff * period)
    return c * before + (1.0 - c) * new


class L1Outer(Outer, L1):
    """L1 adaptation around a cascade, of J ω in the body and m v in space."""
