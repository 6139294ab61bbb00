"""Small errors at rest: stiffness, damping and poles of a law at the poses where it flies.

A law with K or K_d in space has the stiffness and damping of its gains only where Q_d = I.
Elsewhere the body meets Ad_{Q_d}ᵀ H Ad_{Q_d}: the same numbers, about axes that are turned.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.stored import DIFFERENT, SmallErrors
from eqt_cli.components.laws import Designed, Previews, RunsCode
from eqt_cli.components.mechanics import Tracking
from eqt_cli.loop.closed_loop import ClosedLoop

SAME = 1e-6
"""Relative change of a stiffness or a damping that is only rounding: it was up to 1e-10."""

STEP = 1e-3
"""Step of the differences, rad or m: truncation and rounding change a stiffness by 1e-11 of it."""

NODES, WEIGHTS = np.array([-2.0, -1.0, 1.0, 2.0]), np.array([1.0, -8.0, 8.0, -1.0]) / 12
"""A central difference of fourth order, in steps."""


@dataclass(frozen=True)
class AtRest:
    """ε̈ + D ε̇ + H ε = 0 in the body, with Q = Q_d exp(ε^), about poses at rest.

    Attributes
    ----------
    times : (k,)
        s.
    stiffness, damping : (k, m, m)
        H, 1/s², and D, 1/s: those of the torque, divided by the inertia.
    """

    times: Array
    stiffness: Array
    damping: Array

    @property
    def poles(self) -> Array:
        """The poles at each pose, rad/s, ``(k, 2m)``, the slowest first."""
        zero = np.zeros_like(self.stiffness)
        states = np.block([[zero, zero + np.eye(zero.shape[-1])], [-self.stiffness, -self.damping]])
        poles = np.linalg.eigvals(states).astype(complex)
        return np.take_along_axis(poles, np.argsort(-poles.real, axis=-1, kind="stable"), axis=-1)

    def changes(self, other: AtRest) -> list[str]:
        """Return the gains whose effect differs."""
        pairs = {"K": (self.stiffness, other.stiffness), "K_d": (self.damping, other.damping)}
        return [x for x, (a, b) in pairs.items() if np.abs(a - b).max() > SAME * np.abs(a).max()]


def at_rest(loop: ClosedLoop, times: Array, poses: Array) -> AtRest | None:
    """Differentiate the torque of a law about poses at rest; None if it reads more than a state.

    The memory of a law is 0. Of a cascade it is the attitude law, about the attitude of the pose.

    Parameters
    ----------
    times : (k,)
    poses : (k, d, d)
    """
    inner = loop.inside
    law, G, k, m = inner.controller, inner.group, len(times), inner.group.dimension
    reads_more = law.reads_flat_output or isinstance(law, RunsCode | Previews | Designed)
    # A law that is designed for a plant has its poles with that plant: `margins` has them.
    if reads_more or not loop.task.is_whole or law.commands != "torque":
        return None
    x = np.tile(STEP * np.einsum("s,ij->sij", NODES, np.eye(m)).reshape(-1, m), (k, 1))
    t, Qd = np.repeat(times, 4 * m), np.repeat(poses[:, : G.size, : G.size], 4 * m, axis=0)
    inertia, still = replace(inner.inertia.at(t), change=None), np.zeros_like(x)
    memory = {name: np.zeros((len(x), length)) for name, length in law.memory(G).items()}

    def derivative(Q: Array, P: Array) -> Array:
        s = Tracking(G, inertia, inner.gains, t, Q, P, Qd, still, still, memory)
        rate = inertia.velocity(np.broadcast_to(law.torque(s), x.shape)).reshape(k, 4, m, m)
        return -np.einsum("ksij,s->kji", rate, WEIGHTS / STEP)

    with np.errstate(all="ignore"):
        stiffness = derivative(Qd @ G.exp(x), still)
        damping = derivative(Qd, inertia.momentum(x))
    return AtRest(times, stiffness, damping)


def along(loop: ClosedLoop, times: Array, poses: Callable[[], Array | None]) -> SmallErrors | None:
    """Return the small errors of a law along its reference; None where its torque hides them.

    Parameters
    ----------
    times : (k,)
        s.
    poses
        Returns Q_d at these times, ``(k, d, d)``. It is called for a law that depends on the pose.
    """
    G = loop.group
    nominal = at_rest(loop, times, np.broadcast_to(G.identity, (len(times), *G.identity.shape)))
    # Poses that turn and move along each axis show whether the reference matters at all.
    tried = at_rest(loop, np.repeat(times[:1], G.dimension), G.exp(np.eye(G.dimension)))
    if nominal is None or tried is None:
        return None
    flown: AtRest | None = nominal
    if AtRest(times[:1], nominal.stiffness[:1], nominal.damping[:1]).changes(tried):
        on_the_way = poses()
        flown = None if on_the_way is None else at_rest(loop, times, on_the_way)
    if flown is None or not np.isfinite([flown.stiffness, flown.damping]).all():
        return None
    slowest, in_space = flown.poles[:, 0], nominal.changes(flown)
    worst = int(slowest.real.argmax())
    first, last, least = map(_in_words, slowest[[0, -1, worst]])
    poles = f"{first} rad/s at all times"
    if {last, least} != {first}:
        poles = f"{first} rad/s at the start, {last} at the end, {least} at worst"
        poles += f" ({times[worst]:.3g} s)"
    return SmallErrors(
        poles=poles,
        departs=_departs(nominal.poles, flown.poles, times, " and ".join(in_space)),
        in_space=in_space,
        stiffness=_rounded(flown.stiffness[[0, -1]]),
        damping=_rounded(flown.damping[[0, -1]]),
    )


def _departs(nominal: Array, flown: Array, times: Array, gains: str) -> str:
    """Name the slowest pole, if it is not that at Q_d = I, or else the one that is farthest off."""
    size = np.maximum(np.abs(nominal), np.finfo(float).tiny)
    # Each pole is held against the nearest of the other set, both ways, so they need no order.
    apart = np.abs(flown[:, :, None] - nominal[:, None, :])
    off, missed = (apart / size[:, None]).min(axis=2), apart.min(axis=1) / size
    if max(off.max(), missed.max()) <= DIFFERENT:
        return ""
    k, column, what = int(flown[:, 0].real.argmax()), 0, "slowest pole"
    before = nominal[k, 0]
    if abs(flown[k, 0] - before) <= DIFFERENT * abs(before):
        (k, column), what = np.unravel_index(off.argmax(), off.shape), "a pole"
        before = nominal[k, apart[k, column].argmin()]
    return (
        f"{what} {_in_words(flown[k, column])} rad/s at {times[k]:.3g} s, {_in_words(before)} at "
        f"Q_d = I: {gains} in space, not in the body"
    )


def _in_words(pole: complex) -> str:
    """``−0.1``, or ``−0.1 ± 0.2i``."""
    turning = f" ± {abs(pole.imag):.3g}i" if abs(pole.imag) > 1e-3 * abs(pole.real) else ""
    return f"{pole.real:.3g}{turning}".replace("-", "−")


def _rounded(matrices: Array) -> list[list[list[float]]]:
    """Return matrices without the rounding of differences, and in few digits."""
    unit = 10.0 ** np.floor(np.log10(np.abs(matrices).max() + np.finfo(float).tiny) - 5)
    rounded: list[list[list[float]]] = (np.round(matrices / unit) * unit).tolist()
    return rounded
