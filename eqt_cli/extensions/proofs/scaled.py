"""A linearised loop as a function of a factor of some of its gains.

Its matrix is affine in a gain of most laws, and a polynomial of low degree where gains multiply. A
few linearisations then give all others.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.loop.growth import DERIVATIVE, growth_rates
from eqt_cli.loop.linearised import Linearised

PATHS = {
    "kp": ("gains.K",),
    "kd": ("gains.K_d",),
    "position": (".position.kx", ".position.kv", ".position.ki"),
    "lag": ("controller.believed",),
    "effectiveness": (),
}
"""Ends of the paths of numbers that each gain multiplies. The lag is the one that a law believes
in; effectiveness is the torque for each command, which no law knows."""

LARGEST_FACTOR = 128.0
"""Largest factor by which gains are multiplied or divided."""

FACTOR_STEP = 2.0
"""Ratio of successive factors at which stability is tested."""

LOWEST = 1 / LARGEST_FACTOR
"""Factor at which a polynomial is compared with the loop, and below which it is not used."""

HIGHEST = LARGEST_FACTOR, 16.0
"""Factors at which the same is tried: at 128 times its gains, differences of a cascade are off by
1e-4. A kink between them and the lowest moves a polynomial away from the loop at one of the two."""

NODES = FACTOR_STEP, 1 / 8, 8.0, 1 / 32
"""Factors at which a loop is linearised besides 1: the first d of them for the degree d."""

ALIKE = 1e-8
"""Difference of an entry, relative to its row, that says nothing against a polynomial. It is a
hundred times the error of differences, whose steps are longer for larger gains."""


def multiplied(loop: Linearised, names: Sequence[str], factor: float) -> Linearised:
    """Return the loop about the same states with its gains of some names multiplied."""
    scaled = loop.multiplied({end: factor for name in names for end in PATHS[name]})
    if "effectiveness" not in names:
        return scaled
    phases = tuple(phase._replace(B=factor * phase.B) for phase in scaled.phases)
    return dataclasses.replace(scaled, phases=phases)


class ScaledLoop:
    """The closed loop whose gains of some names are multiplied by a factor.

    Attributes
    ----------
    differs
        Whether the gains change the loop.
    """

    def __init__(self, loop: Linearised, names: Sequence[str]) -> None:
        self._loop, self._names = loop, names
        scaled = multiplied(loop, names, FACTOR_STEP)
        self.differs = _differ(scaled, loop)
        self._matrices = {1.0: _closed(loop), FACTOR_STEP: _closed(scaled)}
        self._nodes, self._highest = self._polynomial() if self.differs else ((), 0.0)

    def rate(self, factor: float) -> float:
        """Return the growth rate of errors at a factor, 1/s; NaN where the loop has no matrix."""
        if LOWEST <= factor <= self._highest:
            phases = self._through(self._nodes, factor)
        else:
            phases = self._exact(factor)
        matrix = phases[0]
        for phase in phases[1:]:
            matrix = phase @ matrix
        if not np.isfinite(matrix).all():
            return np.nan
        return float(growth_rates(self._loop, np.linalg.eigvals(matrix)).max())

    def _exact(self, factor: float) -> Array:
        """Return A + BC of each phase, ``(phases, times, n, n)``, as the loop is linearised."""
        return _closed(multiplied(self._loop, self._names, factor))

    def _polynomial(self) -> tuple[Sequence[float], float]:
        """Return the factors that determine a polynomial, and the highest at which it is the loop.

        They are () and 0.0 if it is none of low degree.
        """
        for degree in range(1, len(NODES) + 1):
            nodes = 1.0, *NODES[:degree]
            if not all(self._is_alike(factor) for factor in (*nodes, LOWEST)):
                break
            if self._agrees(nodes, LOWEST):
                for highest in HIGHEST:
                    if self._is_alike(highest) and self._agrees(nodes, highest):
                        return nodes, highest
        return (), 0.0

    def _is_alike(self, factor: float) -> bool:
        """Whether the loop at a factor, which is kept, is finite and has the same states."""
        if factor not in self._matrices:
            self._matrices[factor] = self._exact(factor)
        shapes = {self._matrices[at].shape for at in (1.0, factor)}
        return len(shapes) == 1 and bool(np.isfinite(self._matrices[factor]).all())

    def _agrees(self, nodes: Sequence[float], factor: float) -> bool:
        """Whether a polynomial is the loop at a factor, but for the error of differences."""
        exact = self._matrices[factor]
        error = np.abs(self._through(nodes, factor) - exact).max(axis=-1)
        size = np.maximum(np.abs(exact), np.abs(self._matrices[1.0])).max(axis=-1)
        return bool((error <= ALIKE * size).all())

    def _through(self, nodes: Sequence[float], factor: float) -> Array:
        """Return the polynomial through the loops at some factors, at another one."""
        total = np.zeros_like(self._matrices[1.0])
        for node in nodes:
            others = ((factor - other) / (node - other) for other in nodes if other != node)
            total += math.prod(others) * self._matrices[node]
        return total


def _closed(loop: Linearised) -> Array:
    """Return A + BC of each phase, in coordinates that decide whether the loop is stable."""
    return np.stack([phase.closed for phase in (loop.at_rest or loop).phases])


def _differ(scaled: Linearised, loop: Linearised) -> bool:
    """Whether matrices of a loop differ by more than the differences are off, row by row."""
    for new, old in zip(scaled.phases, loop.phases, strict=True):
        whole = np.abs(old.A) + np.abs(old.B) @ np.abs(old.C)  # A is what BC leaves of it
        for one, other, sizes in zip(new, old, (whole, old.B, old.C), strict=True):
            error = DERIVATIVE * np.abs(sizes).max(axis=-1, keepdims=True)
            if not (np.abs(one - other) <= error).all():
                return True
    return False
