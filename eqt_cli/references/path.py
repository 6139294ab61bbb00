"""A reference that is a product of rotations and translations, each given by an expression."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from eqt_cli.core.arrays import Array, stack
from eqt_cli.core.differentiation import value_and_derivatives
from eqt_cli.core.errors import InputError
from eqt_cli.core.expressions import Expression, formula
from eqt_cli.core.option_types import Real, written_in_degrees
from eqt_cli.core.problems import Problems
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.logs.columns import coordinate_names
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
        a(t), an expression in t; about an axis of rotation also in degrees, such as 30*t deg.
    """

    axis: str | list[Real]
    by: str | float

    @cached_property
    def expression(self) -> Expression:
        """The parsed expression of `by`, in rad and m."""
        degrees = written_in_degrees(self.by)
        return formula(self.by if degrees is None else f"({degrees})*pi/180")

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

    def require_rotation(self, G: MatrixLieGroup) -> None:
        """Raise an `InputError` for degrees along an axis of translation."""
        axis, linear = self.vector(G), [part for part in G.parts if not part.turns]
        if written_in_degrees(self.by) and any(np.any(axis[part.axes]) for part in linear):
            raise InputError(f"expected no deg along an axis of translation, got '{self.by}'")


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

    factors: list[PathFactor]
    pose: Any = "identity"

    def motion(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array, Array]:
        """Return the product, its velocity and its acceleration."""
        links, numbers, rates = self.prepared(G, self._constants)
        factors = []
        for factor, of_factor, rate in zip(self.factors, numbers, rates, strict=True):
            derivatives = value_and_derivatives(factor.expression, t)
            factors.append(Factor(of_factor, stack(derivatives)[..., None] * rate))
        return motion_along(G, links, factors)

    def _constants(self, G: MatrixLieGroup) -> tuple[Array, Array, Array]:
        pose = pose_from(self.pose, G, Problems())
        assert pose is not None
        return screws(G, pose, np.stack([factor.vector(G) for factor in self.factors]))

    def instants(self, G: MatrixLieGroup) -> Array:
        """Return the times at which an expression changes its piece."""
        return instants_of(factor.expression for factor in self.factors)

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
                    factor.require_rotation(G)
