"""The feedforward terms of the laws change the error energy at the same rate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import ClassVar

from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.family_members import is_of_family
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.core.arrays import Array, dot
from eqt_cli.mechanics.tracking import Gains


class FeedforwardPower(Identity):
    """⟨τ_ff − τ_d, Ṽ⟩ = (c + n)⟨𝕀Ṽ, [V, V_d]⟩ + ⟨Ṡ*S⁻* 𝕀Ṽ, Ṽ⟩, whatever the weight g."""

    name: ClassVar[str] = "power of the feedforward"
    statement: ClassVar[str] = "§7, power of τ_ff − τ_d"
    section: ClassVar[float] = 7.3
    per_law: ClassVar[bool] = True

    def applies(self, loop: ClosedLoop) -> bool:
        """To members of the family."""
        return is_of_family(loop.controller)

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The power of the torque without gains against that of the transport."""
        law, gains = sample.loop.controller, sample.s.gains
        assert is_of_family(law)
        s = replace(sample.s, gains=Gains(0 * gains.K, 0 * gains.K_d))
        bracket = s.G.vee(s.G.hat(s.V) @ s.G.hat(s.Vd) - s.G.hat(s.Vd) @ s.G.hat(s.V))
        transport = (law.transport + law.connection) * dot(s.P_tilde, bracket)
        inertia = dot(s.inertia_force + 0 * s.P, s.V_tilde)
        yield dot(sample.loop.command(s) - s.tau_d, s.V_tilde), transport + inertia
