"""The error of two extended Lie-Poisson systems is one itself."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from eqt_cli.analysis.bounded import rate_of
from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.core.arrays import Array
from eqt_cli.mechanics.lie_poisson import lie_poisson


class ErrorDynamics(Identity):
    """Ė = f_{U_E}(E) for E = X X_d⁻¹ and U_E = Ad_{X_d}(U − U_d), with free inputs U and U_d."""

    name: ClassVar[str] = "error dynamics"
    statement: ClassVar[str] = "Lemma 5.1, eq. (18), (19)"
    section: ClassVar[float] = 5.1

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The rate of the error against the vector field of the error input."""
        G, S, (X, X_d, _), (U, U_d) = (
            sample.G,
            sample.semidirect,
            sample.states,
            sample.inputs,
        )
        moving, moving_d = (
            sample.moving(state, lie_poisson(G, *state, *control))
            for state, control in ((X, U), (X_d, U_d))
        )
        rates = map(rate_of, S.error(moving, moving_d))
        U_E = S.error_input(X_d, U, U_d)
        yield from zip(rates, lie_poisson(G, *S.error(X, X_d), *U_E), strict=True)
