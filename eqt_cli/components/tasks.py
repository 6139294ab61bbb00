"""What a loop is to do: which errors count, what it leaves free, and what is claimed of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import reduce
from math import degrees, hypot, pi
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import WrapValidator

from eqt_cli.base.arrays import Array, apply_matrix, frobenius, maximum, norm
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Real, shown, unknown_key
from eqt_cli.base.registry import Keys
from eqt_cli.components.groups import MatrixLieGroup, Part
from eqt_cli.components.laws import BODY_ENERGY, Controller, controllers, gains_group
from eqt_cli.components.matrix_groups import turn_of_distance
from eqt_cli.components.mechanics import Gains, Tracking, as_distance
from eqt_cli.components.motions import unit_vector

ZERO = np.zeros(3)
"""An error of a velocity that does not count."""


@dataclass(frozen=True)
class Task:
    """What a loop is to do: to bring its pose to that of a reference, or only an axis of the body.

    With an axis, the weight K = k c cᵀ makes Υ(Q_E) = k(1 − cos θ), with θ the angle between R a
    and R_d a: of errors in the body, R_dᵀR, with c = a; of errors in space, R R_dᵀ, with c = R_d a,
    which has to stay where it is. The turn about the axis is left free.

    Attributes
    ----------
    kind
        `track`, to follow a reference; `stabilise`, to come to rest; or `point`.
    axis
        The axis a in the body that alone counts, of length 1; () where the whole pose does.
    at
        Where the axis is to point, in space, and to come to rest.
    along
        `reference`, where it is to point along R_d a.
    is_whole
        Whether the whole pose counts, so that nothing is left free.
    errors
        The signals and metrics, in degrees, that count in place of others, by the names of these.
    """

    is_whole: ClassVar[bool] = True
    errors: ClassVar[Mapping[str, str]] = {}

    kind: str
    axis: Any = ()
    at: Any = None
    along: Any = None

    @property
    def pose(self) -> Array:
        """R_d of the shortest turn from the axis to where it is to point: two half-turns."""
        a, b = np.array(self.axis), np.array(self.at)
        middle = a + b if abs(a + b).max() > 1e-8 else np.cross(a, np.eye(3)[abs(a).argmin()])
        last, first = (2 * np.outer(u, u) / (u @ u) - np.eye(3) for u in (middle, a))
        return last @ first

    # Laws and their gains.

    def refusal(self, law: Controller, G: MatrixLieGroup) -> str:
        """Return why a law cannot do it; "" if it can."""
        if self.is_whole:
            if not law.tasks or self.kind in law.tasks:
                return ""
            fitting = ", ".join(kind.name for kind in controllers.all() if self.kind in kind.tasks)
            its = " or ".join(law.tasks)
            return f"{law.name} is a law for task: {its}; for task: {self.kind} use {fitting}"
        G_of, remedy = gains_group(law, G), "use a law with its error in the body, such as lee2010"
        weight = (getattr(law, "inner", None) or law).weight  # of a cascade, its attitude law's
        if G_of.dimension != 3 or not G_of.compact or (self.at and G_of is not G):
            where = "use group SO3, or on SE3 a cascade with along: reference"
            return f"{law.name} on {G.name} cannot do task: point; {where}"
        if not weight:
            return f"{law.name} does not turn one axis alone, as its force is not −dΥ; {remedy}"
        if weight == "spatial" and self.at is None:
            return f"{law.name} has K in space, where R_d a moves; give `at`, or {remedy}"
        return ""

    def check_push(self, push: tuple[float, ...], problems: Problems) -> None:
        """Note an axis that is not that of the push, which alone a cascade turns."""
        if self.axis and push and abs(np.dot(self.axis, push)) < 1 - 1e-9:
            problems.at("axis").add(f"expected the direction of the push, {list(push)}")

    def axes(self, law: Controller) -> tuple[tuple[float, ...], ...]:
        """Return c in the frames of a law's weight K and of its damping K_d; () of a whole pose."""
        frames = law.weight, getattr(law, "damping", None) or "body"
        axes = (self.at if frame == "spatial" else self.axis for frame in frames)
        return tuple(tuple(axis or self.axis) for axis in axes if self.axis)

    def weight(self, K: Array) -> Array:
        """Return the weight K for errors in the body."""
        return K if self.is_whole else K.trace() * np.outer(self.axis, self.axis)

    # Errors, and what settles.

    def settling_error(
        self, G: MatrixLieGroup, Q: Array, Qd: Array, most: Mapping[str, float], V: Any = ZERO
    ) -> Array:
        """Return max_i ‖(Q − Q_d)_i‖_F / s_i over the parts with a threshold; at most 1 if settled.

        For a translation this is ‖p − p_d‖, for a rotation ‖R − R_d‖_F = 2√2 sin(θ/2) with the
        angle θ of the error. Unlike p − R_E p_d in Q_E, both do not depend on the choice of the
        spatial frame.

        Parameters
        ----------
        most
            Thresholds by the names of parts: an angle, rad, for a rotation, a distance for other
            parts; and ``rate``, of the first part of the velocity, rad/s.
        V
            Error of the velocity; 0 where it does not count.
        """
        shares = [norm(V[..., G.parts[0].axes]) / most.get("rate", np.inf)]
        for part in (part for part in G.parts if part.name in most):
            shares.append(self.part_error(Q, Qd, part) / as_distance(part, most[part.name]))
        return reduce(maximum, shares)

    def part_error(self, Q: Array, Qd: Array, part: Part) -> Array:
        """Return ‖(Q − Q_d)_i‖_F of a part, ``(...)``.

        Of a rotation of which the axis alone counts, √2 ‖(R − R_d)a‖: the ‖I − R_E‖_F of the
        shortest turn from R_d a to R a.
        """
        apart = (Q - Qd)[(..., *part.entries)]
        if self.is_whole or not part.turns:
            return frobenius(apart)
        return 2**0.5 * norm(apply_matrix(apart, np.array(self.axis)))

    def pose_error(self, s: Tracking, law: Controller) -> Array:
        """Return the pose error of which K is the weight."""
        return s.Q_E if self.is_whole or law.weight != "body" else s.relative.Q

    def threshold(self, threshold: Any, G: MatrixLieGroup, problems: Problems) -> Any:
        """Return the threshold of settling, of an axis as an angle; note what is wrong by parts."""
        parts = {part.name: part for part in G.parts}
        if isinstance(threshold, float):
            turn = float(turn_of_distance(np.array(threshold)))
            return threshold if self.is_whole else {x: turn for x in parts if parts[x].turns}
        keys = {*parts, *(["rate"] if G.parts[0].turns else [])}
        for name, most in threshold.items():
            if name not in keys:
                problems.at(name).add(unknown_key(name, parts))
            elif name in parts and parts[name].turns and most > pi:
                problems.at(name).add(
                    f"expected an angle of at most 180 deg, got {degrees(most):.6g} deg"
                )
        return threshold

    def bound(self, threshold: Any, G: MatrixLieGroup) -> float:
        """Return the bound of the pose error: by parts, the norm of theirs; of an axis, deg."""
        if not isinstance(threshold, dict):
            return float(threshold)
        if not self.is_whole:
            return degrees(threshold.get("rotation", 0.0))
        parts = (part for part in G.parts if part.name in threshold)
        return hypot(*(as_distance(part, threshold[part.name]) for part in parts))

    # What it leaves free, and what is claimed.

    def free(self, gains: Gains) -> tuple[Array, ...]:
        """Return the axis if the turn about it is left; twice if the spin is, without damping."""
        if self.is_whole:
            return ()
        spins = np.linalg.cond(gains.K_d + np.transpose(gains.K_d)) > 1e9
        axis = np.array(self.axis)
        return (axis, axis) if spins else (axis,)

    def words(self, gains: Gains) -> str:
        """Return what it leaves free, in words; "" if nothing."""
        spin = " and the spin" if len(self.free(gains)) > 1 else ""
        axis = ", ".join(f"{x:.4g}" for x in self.axis)
        return f"the turn{spin} about the axis ({axis})" if not self.is_whole else ""

    def barrier(self, law: Controller, gains: Gains, reference: Any) -> float:
        """Return 2k of K = k c cᵀ, the least L with the axis opposite.

        It is 0 where no arrival is claimed: with an L of another form, or for a spin that is left
        along a moving reference.
        """
        is_usual = law.energy in (Controller.energy, BODY_ENERGY)
        rests = not np.any(getattr(reference, "velocity", 1.0))
        claims = is_usual and not self.is_whole and (rests or len(self.free(gains)) == 1)
        return 2 * float(np.trace(gains.K)) if claims else 0.0


TRACK = Task("track")


def _direction(value: Any, handler: Any) -> list[float]:
    """Return numbers of length 1."""
    if not isinstance(value, list) or len(value) != 3 or not any(value):
        expected = "expected a direction of 3 numbers, not all 0, such as [0, 0, 1]"
        raise ValueError(f"{expected}, got {shown(value)}")
    return list(unit_vector(handler(value)))


Direction = Annotated[list[Real], WrapValidator(_direction)]


POINTING_ERRORS = {"pose_error": "pointing_error", "final_pose_error": "final_pointing_error"}


@dataclass(frozen=True)
class Point(Task, Keys):
    """The task on the sphere S² to turn an axis of the body; the turn about it stays free.

    Attributes
    ----------
    kind
        `point`.
    axis
        The axis a, in the body.
    at
        Where it is to point, in space, and to come to rest; then there is no reference.
    along
        `reference`: instead of `at`, it is to point along the reference's axis R_d a.
    """

    is_whole: ClassVar[bool] = False
    errors: ClassVar[Mapping[str, str]] = POINTING_ERRORS

    kind: Literal["point"]
    axis: Direction = field()
    at: Direction | None = None
    along: Literal["reference"] | None = None


def task_of(value: str | Point) -> Task:
    """Return the task of a configuration, which writes one without options as its name."""
    return Task(value) if isinstance(value, str) else value
