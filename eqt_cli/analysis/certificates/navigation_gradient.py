"""The gradient of the navigation function is its derivative."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from eqt_cli.analysis.bounded import rate_of
from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.cross_product import is_rotations_of_space, vee
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.core.arrays import Array, dot, transpose
from eqt_cli.mechanics.navigation import gradient, potential


class NavigationGradient(Identity):
    """d/dt Υ(Q) = ⟨L*_Q dΥ, V⟩ along Q̇ = Q V^; on SO(3) also the paper's (K R − Rᵀ K)^∨."""

    name: ClassVar[str] = "gradient of Υ"
    statement: ClassVar[str] = "Example 3.4, eq. (13)"
    section: ClassVar[float] = 3.4

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The rate of Υ against the contraction with its gradient."""
        G, K, (Q, P), (V, _) = sample.G, sample.loop.gains.K, sample.states[0], sample.inputs[0]
        along, _ = sample.moving((Q, P), (Q @ G.hat(V), 0 * P))
        yield rate_of(potential(G, K, along)), dot(gradient(G, K, Q), V)
        if is_rotations_of_space(G):
            yield gradient(G, K, Q), vee(K @ Q - transpose(Q) @ transpose(K))
