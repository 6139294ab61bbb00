"""A reference that is a product of rotations and translations, each given by an expression."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from eqt_cli.core import units
from eqt_cli.core.arrays import Array, stack
from eqt_cli.core.errors import InputError, Problems
from eqt_cli.core.expressions import Expression, formula
from eqt_cli.core.jets import Jet, series
from eqt_cli.core.option_types import Real
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.logs.reading import coordinate_names
from eqt_cli.mechanics.motions import Factor, motion_along, screws
from eqt_cli.notation.poses import pose_from, vector
from eqt_cli.references.base import ClosedReference, instants_of


@dataclass(frozen=True)
class PathFactor:
    """One factor exp(a(t) ξ) of a path.

    Attributes
    ----------
    axis
        ξ: the name of a coordinate of the algebra, such as wz, or m numbers.
    by
        a(t), an expression in t, in rad or m; or with its unit, such as 30*t deg.
    """

    axis: str | list[Real]
    by: str | float

    @cached_property
    def expression(self) -> Expression:
        """The parsed expression of `by`, in rad and m."""
        text, unit = self._written
        size = "pi/180" if unit == "deg" else repr(units.factor(unit, units.base_of(unit)))
        return formula(f"({text})*{size}" if unit else text)

    @property
    def _written(self) -> tuple[str | float, str]:
        parts = units.split(self.by) if isinstance(self.by, str) else None
        return parts or (self.by, "")

    def vector(self, G: MatrixLieGroup) -> Array:
        """Return ξ in coordinates, or raise an `InputError` if the group has no such axis."""
        if isinstance(self.axis, list):
            return vector(self.axis, G.dimension, G)
        names = coordinate_names(G)
        if self.axis not in names:
            raise InputError(
                f"expected {', '.join(names)} or a list of {G.dimension} numbers for {G.name}, "
                f"got '{self.axis}'"
            )
        return np.eye(G.dimension)[names.index(self.axis)]

    def require_unit(self, G: MatrixLieGroup) -> None:
        """Raise an `InputError` for a unit that is not that of the axis."""
        axis, unit = self.vector(G), self._written[1]
        for part in G.parts:
            own = part.error_unit
            if unit and np.any(axis[part.axes]) and units.factor(unit, own) is None:
                raise InputError(f"expected {units.offered(own)}, got '{self.by}'")


@dataclass(frozen=True)
class PathReference(ClosedReference):
    """Q_d(t) = Q_0 exp(a_1(t) ξ_1) exp(a_2(t) ξ_2) …, rotations and translations in sequence.

    Attributes
    ----------
    factors
        The axes ξ_k, each constant in the frame moved by the factors before it, and the
        displacements a_k(t) along them.
    pose
        Q_0.
    """

    name: ClassVar[str] = "path"
    smooth: ClassVar[bool] = True

    factors: list[PathFactor]
    pose: Any = "identity"

    def motion(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array, Array]:
        """Return the product, its velocity and its acceleration."""
        links, numbers, rates = self.prepared(G, self._constants)
        factors = []
        for each, of_each, rate in zip(self.factors, numbers, rates, strict=True):
            angle = series(each.expression, {"t": t}, 2)
            derivatives = stack([angle.derivative(k) for k in range(3)])
            factors.append(Factor(of_each, derivatives[..., None] * rate))
        return motion_along(G, links, factors)

    def series(self, G: MatrixLieGroup, t: Any, order: int) -> Jet:
        """Return Q_d as a series; a factor E has the rate ȧ E ξ^."""
        links, numbers, rates = self.prepared(G, self._constants)
        Q: Any = links[0]
        for each, of_each, rate, link in zip(self.factors, numbers, rates, links[1:], strict=True):
            angle: Any = stack([series(each.expression, {"t": t}, order)])
            E: Any = Jet([G.exp_along(of_each, angle.value * rate)])
            axis = G.hat(G.along(of_each, rate))
            while E.order < order:
                E = E.extended((angle.rate[..., None] * E @ axis).derivative(E.order))
            Q = Q @ E @ link
        return Q

    def _constants(self, G: MatrixLieGroup) -> tuple[Array, Array, Array]:
        pose = pose_from(self.pose, G, Problems())
        assert pose is not None
        return screws(G, pose, np.stack([factor.vector(G) for factor in self.factors]))

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times at which an expression changes its piece."""
        return instants_of([factor.expression for factor in self.factors], until)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note an invalid pose, axis or expression, and missing factors."""
        pose_from(self.pose, G, problems.at("pose"))
        if not self.factors:
            problems.at("factors").add(
                "expected at least one factor, such as [{axis: wz, by: 0.1*t}]"
            )
        for index, factor in enumerate(self.factors):
            here = problems.at("factors", index)
            with here.catching("axis"):
                factor.vector(G)
            with here.catching("by"):
                _ = factor.expression
                if not here.at("axis"):
                    factor.require_unit(G)
