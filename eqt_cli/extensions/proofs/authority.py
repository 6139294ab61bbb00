"""What the limits of thrusters and wheels leave of torque and force, by linear programmes.

The vehicle rests where its reference begins: thrusts f hold what acts on it, B f = w. In a
direction n, what is left is the largest n·(B f − w) within limits that changes nothing in the other
directions.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from eqt_cli.base.arrays import Array, norm
from eqt_cli.base.errors import KeyPath
from eqt_cli.components.actuators import THRUSTS
from eqt_cli.components.groups import command_axes
from eqt_cli.components.laws import OuterLoop
from eqt_cli.components.vehicle import ACTUATORS, without_inner
from eqt_cli.components.vehicle_parts import drawn
from eqt_cli.config.experiment import Experiment
from eqt_cli.engines.horizon import Horizon

if TYPE_CHECKING:
    from rich.text import Text

NOTHING = 1e-6
"""Share of what all members could do along a direction, below which nothing is left: linear
programmes meet their constraints to 1e-7."""

BESIDE = 1e-3
"""Force or torque that a unit of another one brings along, below which it is none."""

TRIED = 1e-4
"""Share of the same, by which an allocation is tried from rest."""

MOST_TILT = np.radians(20)
"""Tilt from which on a vehicle that pushes in all directions is taken to need no other law."""

MILLI = 0.1
"""Largest number, N m or N, of a column that is in mN m or mN."""


@dataclass(frozen=True)
class Members:
    """Thrusters or wheels, and the directions in which the laws push.

    Attributes
    ----------
    part
        The actuator, with B and its limits.
    index
        Its number among the actuators.
    wanted : (k, m)
        The directions.
    names
        Their names.
    held : (k,)
        w in these directions.
    begins
        When a failure begins, or an efficiency, s: in the mean of the runs; None if at no time.
    key
        Its key.
    """

    part: Any
    index: int
    wanted: Array
    names: tuple[str, ...]
    held: Array
    begins: float | None
    key: str

    @property
    def columns(self) -> Array:
        """B in the directions, ``(k, n)``."""
        return self.wanted @ np.asarray(self.part.matrix)

    @property
    def state(self) -> str:
        """``hover`` where a force is held, else ``rest``."""
        forces = [w for name, w in zip(self.names, self.held, strict=True) if "force" in name]
        return "hover" if np.any(forces) else "rest"

    @property
    def commanded(self) -> Array:
        """The least and the largest thrusts that may be commanded, ``(2, n)``."""
        part = self.part
        ends = (part.low, part.high) if hasattr(part, "low") else (-part.limit, part.limit)
        return np.array(ends, dtype=float)

    def limits(self, failed: bool) -> Array:
        """Return the least and the largest thrusts, ``(2, n)``, before or after the failure."""
        share = getattr(self.part, "share", None)
        left = 1.0 + self.part.lost if failed else 1.0 if share is None else share
        limits: Array = left * self.commanded
        return limits

    def changes_until(self, end: float) -> bool:
        """Whether a failure or an efficiency begins before the end of the runs."""
        return self.begins is not None and self.begins <= end

    def left(self, failed: bool = False) -> Array | None:
        """Return what is left against and along each direction, ``(k, 2)``; None if B f ≠ w."""
        from scipy.optimize import linprog  # slow to import

        B, (low, high) = self.columns, self.limits(failed)
        sizes, ends = np.abs(B).max(axis=1), np.zeros((len(B), 2))
        for k, sense in np.ndindex(ends.shape):
            sign, others = 2 * sense - 1, np.arange(len(B)) != k
            best = linprog(
                -sign * B[k] / sizes[k],
                A_eq=B[others] / sizes[others, None],
                b_eq=self.held[others] / sizes[others],
                bounds=[*zip(low, high, strict=True)],
            )
            if best.status:
                return None
            ends[k, sense] = -best.fun * sizes[k] - sign * self.held[k]
        whole = (np.abs(B) * (high - low)).sum(axis=1)[:, None]
        if (ends < -NOTHING * whole).any():  # the other directions alone would allow it
            return None
        return np.where(ends <= NOTHING * whole, 0.0, ends * [-1, 1])

    def lacking(self, left: Array, counts: Array) -> str:
        """Name the directions and senses in which nothing is left, of those that count."""
        named = []
        for k, sense in np.argwhere((left == 0) & counts).tolist():
            kind, _, axis = self.names[k].partition(" ")
            along = (sense == 1) != axis.startswith("−")
            named.append(f"{kind} {'+' if along else '−'}{axis.lstrip('−')}")
        return " and no ".join(named)

    def tilt(self, left: Array) -> float:
        """Return the largest tilt at which thrusts hold the weight, rad, of a law that never tilts.

        Sideways, they then push by tan θ of the weight.
        """
        forces = np.array(["force" in name for name in self.names])
        weight = norm(self.held[forces])
        beside = forces & (np.abs(self.held) <= NOTHING * weight)
        if beside.sum() < 2 or not weight:
            return np.pi / 2
        return float(np.arctan(np.abs(left[beside]).min() / weight))

    @property
    def is_cut(self) -> bool:
        """Whether the allocation gives no torque in any sense, though other thrusts would."""
        turns = [k for k, name in enumerate(self.names) if "torque" in name]
        commanded = self.part.sampled or self.part.takes == THRUSTS
        if commanded or self.part.name == "wheels" or not turns:
            return False
        inverse, (low, high) = self.part.inverse, self.commanded
        whole = (np.abs(self.columns) * (high - low)).sum(axis=1)
        steps = np.diag(TRIED * whole)[turns]
        commands = (self.held + np.concatenate([steps, -steps])) @ np.linalg.pinv(self.wanted).T
        room = NOTHING * (np.abs(low) + np.abs(high))
        thrusts = commands @ inverse.T
        if (thrusts.mean(axis=0) > high + room).any():  # too weak to hover, which is told
            return False
        return not ((thrusts >= low - room) & (thrusts <= high + room)).all(axis=1).any()


def members_of(experiment: Experiment) -> Iterator[Members]:
    """Yield the thrusters and wheels with limits, where laws want them to push."""
    G, loops, written = experiment.group, experiment.loops.values(), experiment.config.actuators
    directions = max((loop.controller.directions(G) for loop in loops), key=len)
    directions = directions if len(directions) else np.eye(G.dimension)  # a design asks in none
    pushes = isinstance(experiment.loop.controller.formula, OuterLoop)
    for index, part in enumerate(experiment.vehicle.actuators):
        B = getattr(part, "matrix", None)
        if B is None or getattr(part, "low", getattr(part, "limit", None)) is None:
            continue
        if not np.isfinite(w := _held(experiment)).all():
            return
        # By the largest entries, since squares may be too large for a float.
        spans = np.abs(directions @ B).max(axis=1) > NOTHING * np.abs(B).max()
        held = directions @ w
        if pushes and G.translation is not None:  # the body turns until its push holds the force
            held[-1] = norm(w[G.translation.axes])
        names = tuple(_name(G, row) for row in directions[spans])
        begins = drawn(getattr(written[index], "begins", None), None) if written else None
        key = "fails" if written and getattr(written[index], "fails", None) else "efficiency_from"
        yield Members(part, index, directions[spans], names, held[spans], begins, key)


def _held(experiment: Experiment) -> Array:
    """Return what holds a body at rest where the reference begins, ``(m,)``."""
    loop, pose = experiment.loop, experiment.desired.pose[None]
    still, w = np.zeros((1, loop.group.dimension)), np.zeros(loop.group.dimension)
    with np.errstate(all="ignore"):  # of a plugin
        for force in loop.vehicle.forces:
            w = w - (force.in_body(loop.group, 0.0, pose, still) + 0.0 * still)[0]
    return w


def _name(G: Any, direction: Array) -> str:
    """Return ``torque x``, ``force −z``, or ``force`` of an oblique direction."""
    [*axes] = np.flatnonzero(direction)
    name = command_axes(G)[axes[0]]
    kind, _, axis = name.partition(" ")
    if len(axes) > 1:
        return str(kind)
    return f"{kind} −{axis}" if direction[axes[0]] < 0 else str(name)


def authority_table(experiment: Experiment) -> Text | None:
    """Return the table of what limits leave, before and after a failure; None without limits."""
    from eqt_cli.cli.output import table

    header, rows = list[str](), list[list[str]]()
    for member in members_of(experiment):
        times = {False: f"at {member.state}"}
        if member.changes_until(experiment.config.time.duration):
            times[True] = f"from {member.begins:g} s"
        left_at = {when: member.left(when) for when in times}
        if left_at[False] is None or (header and header[1:] != _columns(member, left_at)):
            continue
        header = ["left by limits", *_columns(member, left_at)]
        for when, left in left_at.items():
            if left is None:
                rows.append([f"{times[when]}, not held", *["-"] * (len(header) - 1)])
                continue
            units = [1e3 if ", mN" in column else 1.0 for column in header[1:]]
            cells = [f"{a * u:.3g} to {b * u:.3g}" for (a, b), u in zip(left, units, strict=True)]
            rows.append([times[when], *(cell.replace("-", "−") for cell in cells)])
    return table(header, rows) if rows else None


def _columns(members: Members, left: dict[bool, Array | None]) -> list[str]:
    """Return the names of the directions with their units."""
    most = np.max([np.abs(x).max(axis=1) for x in left.values() if x is not None], axis=0)
    units = ["N m" if name.startswith("torque") else "N" for name in members.names]
    milli = [f"m{unit}" if size < MILLI else unit for unit, size in zip(units, most, strict=True)]
    return [f"{name}, {unit}" for name, unit in zip(members.names, milli, strict=True)]


def beside(members: Members, directions: Sequence[str]) -> Iterator[str]:
    """Yield what each direction brings along others, in which no law asks for anything."""
    if members.part.takes == THRUSTS or members.part.name == "wheels":
        return
    rest = np.eye(len(directions)) - np.linalg.pinv(members.wanted) @ members.wanted
    moved = (
        rest
        @ np.asarray(members.part.matrix)
        @ members.part.inverse
        @ np.linalg.pinv(members.wanted)
    )
    for name, column in zip(members.names, moved.T, strict=True):
        for k in np.flatnonzero(np.abs(column) > BESIDE).tolist():
            unit = "N m" if directions[k].startswith("torque") else "N"
            yield f"{column[k]:.3g} {unit} of {directions[k]} with 1 of {name}".replace("-", "−")


def remarks(experiment: Experiment, shown: Horizon | None) -> Iterator[tuple[KeyPath, str]]:
    """Yield remarks on directions in which limits leave nothing, and on what is always cut.

    Before a run, `shown` is None, and linear programmes are solved for failures only.
    """
    for member in members_of(experiment):
        key: KeyPath = (ACTUATORS, member.index)
        cut = [
            experiment.titles[label]
            for label, loop in experiment.loops.items()
            if replace(member, part=without_inner(loop.vehicle).actuators[member.index]).is_cut
        ]
        if cut:
            yield (
                key,
                f"at {member.state}, the thrusts for any torque of {', '.join(cut)} are beyond "
                "their limits, because nothing else needs thrusts, to which they could add. So "
                "every command is cut; `allocation: bounded` finds thrusts that give the torque",
            )
            continue
        if words := ", ".join(beside(member, command_axes(experiment.group))):
            yield key, f"{member.part.name} give more than the law asks for: {words}"
        failing = member.changes_until(experiment.config.time.duration)
        before = member.left() if failing or shown is not None else None
        if before is None:
            continue
        if lost := member.lacking(
            before, np.broadcast_to(before.any(axis=1, keepdims=True), before.shape)
        ):
            yield key, f"at {member.state}, the limits leave no {lost}"
        elif (tilt := member.tilt(before)) < MOST_TILT:
            yield (
                key,
                f"the thrusters hold the weight up to a tilt of {np.degrees(tilt):.2g}° only; "
                "beyond it, the body falls under a law that does not tilt to move; use `cascade`",
            )
        if not failing:
            continue
        after = member.left(failed=True)
        when = f"from {member.begins:g} s on, the body cannot be held at {member.state}"
        if after is None:
            yield (*key, member.key), f"{when} by the thrusts that are left"
        elif lost := member.lacking(after, np.asarray(before != 0)):
            yield (
                (*key, member.key),
                f"{when}: no {lost} is left; a run settles only while nothing pushes",
            )
