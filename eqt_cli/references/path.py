"""A reference that is a product of turns and moves, each by an expression in time."""

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
        a(t), an expression in t; about an axis that turns also one in degrees, such as
        30*t deg.
    """

    axis: str | list[Real]
    by: str | float

    @cached_property
    def expression(self) -> Expression:
        """`by`, parsed; in rad and m."""
        degrees = written_in_degrees(self.by)
        return formula(self.by if degrees is None else f"({degrees})*pi/180")

    def vector(self, G: MatrixLieGroup) -> Array:
        """ξ in coordinates; raises `InputError` where the group has no such axis."""
        if isinstance(self.axis, list):
            return vector(self.axis, G.dimension, G)
        names = coordinate_names(G)
        if self.axis not in names:
            raise InputError(
                f"expected {', '.join(names)} or a list of {G.dimension} numbers for {G.name}, "
                f"got '{self.axis}'"
            )
        return np.eye(G.dimension)[names.index(self.axis)]

    def require_turning(self, G: MatrixLieGroup) -> None:
        """Raise an `InputError` for degrees along an axis that moves."""
        axis, moves = self.vector(G), [part for part in G.parts if not part.turns]
        if written_in_degrees(self.by) and any(np.any(axis[part.axes]) for part in moves):
            raise InputError(f"expected no deg along an axis that moves, got '{self.by}'")


@dataclass(frozen=True)
class PathReference(ClosedReference):
    """Q_d(t) = Q_0 exp(a_1(t) ξ_1) exp(a_2(t) ξ_2) …, turns and moves one after the other.

    Attributes
    ----------
    factors
        The axes ξ_k, constant in the frame that the factors before have made, and how far the
        motion has come along each, a_k(t).
    pose
        Q_0.
    """

    name: ClassVar[str] = "path"

    factors: list[PathFactor]
    pose: Any = "identity"

    def motion(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array, Array]:
        """The product, its velocity and its acceleration."""
        links, numbers, rates = self.prepared(G, self._constants)
        factors = []
        for factor, own, rate in zip(self.factors, numbers, rates, strict=True):
            derivatives = value_and_derivatives(factor.expression, t)
            angles = stack(derivatives)[..., None] * rate
            factors.append(Factor(own, angles))
        return motion_along(G, links, factors)

    def _constants(self, G: MatrixLieGroup) -> tuple[Array, Array, Array]:
        pose = pose_from(self.pose, G, Problems())
        assert pose is not None
        return screws(G, pose, np.stack([factor.vector(G) for factor in self.factors]))

    def instants(self, G: MatrixLieGroup) -> Array:
        """Where an expression changes its piece."""
        return instants_of(factor.expression for factor in self.factors)

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """A pose, an axis or an expression that will not do, and no factors at all."""
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
                    factor.require_turning(G)
