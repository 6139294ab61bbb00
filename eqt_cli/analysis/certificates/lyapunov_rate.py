"""L falls at the rate at which the law dissipates."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from eqt_cli.analysis.bounded import rate_of
from eqt_cli.analysis.certificates.base import Identity
from eqt_cli.analysis.certificates.sample import Sample
from eqt_cli.core.arrays import Array


class LyapunovRate(Identity):
    """dL/dt = −dissipation along the closed loop, L differentiated exactly."""

    name: ClassVar[str] = "rate of L"
    statement: ClassVar[str] = "Theorems 3.2, 6.2"
    section: ClassVar[float] = 6.25
    per_law: ClassVar[bool] = True

    def sides(self, sample: Sample) -> Iterator[tuple[Array, Array]]:
        """The derivative of L along the flow against the law's own dissipation, if it says it."""
        dissipation = sample.loop.dissipation(sample.s)
        if dissipation is not None:
            yield rate_of(sample.loop.lyapunov(sample.s)), -dissipation
