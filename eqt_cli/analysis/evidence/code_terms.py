"""The parts of a law, each as the difference of two evaluations of it, and what C does with each.

No formula of a law is written here: a law is evaluated without a gain, without an acceleration, or
with one weight of the family more, and what changes is the part. A torque in C that differs from
the law is then explained by least squares over these parts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.closed_loop.told import Told
from eqt_cli.controllers import Controller
from eqt_cli.controllers.family import Family, Frame
from eqt_cli.core.arrays import Array, apply_matrix
from eqt_cli.mechanics.tracking import Gains

EXPLAINED = {"double": 1e-9, "float": 1e-4}
"""Of the torque: what is left of a difference that is explained."""

CHANGED = {"double": 1e-7, "float": 1e-3}
"""By how much a coefficient differs that is another one."""

VANISHES = 1e-12
"""Relative to the torque: a part that is 0 on this group, or with these gains."""


@dataclass(frozen=True)
class Question:
    """A law that is asked for its torque at many states.

    Attributes
    ----------
    loop
        With the law as a formula.
    told, memory
        What it is told, and what it remembers, a row each.
    """

    loop: ClosedLoop
    told: Told
    memory: Mapping[str, Array]

    def torque(
        self,
        *,
        law: Controller | None = None,
        told: Told | None = None,
        K: float = 1.0,
        K_d: float = 1.0,
        memory: Mapping[str, Array] | None = None,
    ) -> Array:
        """The torque of the law or another, perhaps with its gains scaled, ``(rows, m)``."""
        loop, told = self.loop, told or self.told
        gains = Gains(K * loop.gains.K, K_d * loop.gains.K_d)
        kept = self.memory if memory is None else memory
        s = told.tracking(loop.group, loop.inertia, gains, kept)
        with np.errstate(all="ignore"):
            found: Array = (law or loop.controller).torque(s) + 0.0 * told.velocity
        return found

    @property
    def forgetful(self) -> dict[str, Array]:
        """The memory at 0."""
        return {name: 0 * values for name, values in self.memory.items()}

    @cached_property
    def frame(self) -> Frame:
        """Of the errors that the law is about."""
        found: Frame = getattr(self.loop.controller, "error", "body")
        return found


# The parts ----------------------------------------------------------------------------------------

OTHERS = "all other parts of the law"
SYMMETRIC = "symmetric part of the pose error"


@dataclass(frozen=True)
class Parts:
    """The parts of a law at some states.

    Attributes
    ----------
    columns
        Their torques by name, ``(rows, m)`` each.
    expected
        How often the law has each.
    """

    columns: dict[str, Array]
    expected: dict[str, float]

    @property
    def size(self) -> int:
        """How many parts the law has."""
        return sum(abs(value) > CHANGED["double"] for value in self.expected.values())


def parts_of(question: Question, pose: Told, rest: Told) -> list[Parts]:
    """The parts of a law in the two ways of writing what is quadratic in velocities.

    Parameters
    ----------
    pose, rest
        What its stiffness is told, and what all else is told.
    """
    own = _own_parts(question, pose, rest)
    whole = own["stiffness"] + question.torque(told=rest, K=0.0)
    return [_fitted(whole, own, moving) for moving in _quadratic(question, rest)]


def _own_parts(question: Question, pose: Told, rest: Told) -> dict[str, Array]:
    """Those of gains, accelerations and memory."""
    ask = question.torque
    still = rest._replace(
        desired_velocity=0 * rest.desired_velocity,
        desired_acceleration=0 * rest.desired_acceleration,
    )
    stiffness = ask(told=pose) - ask(told=pose, K=0.0)
    damping = ask(told=rest) - ask(told=rest, K_d=0.0)
    own_damping = ask(told=still) - ask(told=still, K_d=0.0)
    unpushed = rest._replace(desired_acceleration=0 * rest.desired_acceleration)
    found = {
        "stiffness": stiffness,
        "damping": own_damping,
        "damping of the desired velocity": damping - own_damping,
        "desired acceleration": ask(told=rest) - ask(told=unpushed),
    }
    for name in question.memory:
        without = dict(question.memory) | {name: 0 * question.memory[name]}
        found[name] = ask(told=rest) - ask(told=rest, memory=without)
    return found


def _quadratic(question: Question, told: Told) -> list[dict[str, Array]]:
    """What is quadratic in velocities, by the weights of the family, in two ways of writing it."""
    unpushed = told._replace(desired_acceleration=0 * told.desired_acceleration)
    nothing = question.forgetful

    def family(at: Told, **weights: float) -> Array:
        weighted = {"gyroscopic": 0.0, "transport": 0.0, **weights}
        law = Family(**weighted, error=question.frame)  # type: ignore[arg-type]  # floats only
        return question.torque(law=law, told=at, K=0.0, K_d=0.0, memory=nothing)

    def weighed(name: str, at: Told = unpushed) -> Array:
        return family(at, **{name: 1.0}) - family(at)

    of_reference = weighed("quadratic", unpushed._replace(velocity=0 * told.velocity))
    of_body = weighed("quadratic", unpushed._replace(desired_velocity=0 * told.desired_velocity))
    g, c, n, q = map(weighed, ("gyroscopic", "transport", "connection", "quadratic"))
    return [
        {
            "gyroscopic": of_body,
            "transport": n,
            "gyroscopic of the desired velocity": of_reference,
            "gyroscopic, body with desired velocity": g + of_reference,
            "gyroscopic, desired velocity with body": c + of_reference,
        },
        {
            "gyroscopic (weight g)": g,
            "transport (weight c)": c,
            "connection (weight n)": n,
            "quadratic (weight q)": q,
            "driving torque": of_reference,
        },
    ]


def _fitted(torque: Array, own: dict[str, Array], moving: dict[str, Array]) -> Parts:
    """How often a law has each part, and what of it is none of them."""
    scale = np.abs(torque).max()
    columns = {
        name: column
        for name, column in (own | moving).items()
        if np.abs(column).max() > VANISHES * scale
    }
    expected = dict.fromkeys(own.keys() & columns.keys(), 1.0)
    rest = torque - sum((columns[name] for name in own if name in columns), 0 * torque)
    found = _least_squares({name: columns[name] for name in moving if name in columns}, rest)
    # A law has each of them a whole number of times, or its own weight.
    expected |= {name: _rounded(value) for name, value in found.items()}
    for name in [name for name in found if expected[name] < 0]:  # told as "1.00 of 1"
        columns[name], expected[name] = -columns[name], -expected[name]
    left = rest - sum((expected[n] * columns[n] for n in found), 0 * torque)
    if np.abs(left).max() > EXPLAINED["double"] * scale:
        columns[OTHERS], expected[OTHERS] = left, 1.0
    return Parts(columns, {name: expected[name] for name in columns})


def _rounded(value: float) -> float:
    nearest = round(value * 2) / 2
    return nearest if abs(value - nearest) < CHANGED["double"] else value


def _least_squares(columns: Mapping[str, Array], torque: Array) -> dict[str, float]:
    """The smallest coefficients by which columns are nearest to a torque."""
    if not columns:
        return {}
    matrix = np.stack([column.ravel() for column in columns.values()], axis=1)
    sizes = np.linalg.norm(matrix, axis=0)
    found = np.linalg.lstsq(matrix / sizes, torque.ravel(), rcond=1e-10)[0] / sizes
    return dict(zip(columns, found.tolist(), strict=True))


# What C does with them ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Explanation:
    """A torque in C as a sum of the parts of a law.

    Attributes
    ----------
    assumed
        What is assumed of the code, in words; "" where nothing is.
    coefficients
        How often the code has each part, and how often the law has it.
    left
        What is not explained, as a share of the torque.
    real
        ``double`` or ``float``.
    """

    assumed: str
    coefficients: dict[str, tuple[float, float]]
    left: float
    real: str

    @property
    def is_complete(self) -> bool:
        """Whether nothing is left over but rounding."""
        return self.left <= EXPLAINED[self.real]

    @property
    def changed(self) -> dict[str, tuple[float, float]]:
        """The parts that the code has more or less often than the law."""
        return {
            name: (found, expected)
            for name, (found, expected) in self.coefficients.items()
            if abs(found - expected) > CHANGED[self.real] * max(1.0, abs(expected))
        }

    @property
    def cost(self) -> float:
        """How much it assumes: the less, the better the explanation."""
        return len(self.changed) + (1.5 if self.assumed else 0.0)

    @property
    def words(self) -> str:
        """What differs, and what does not."""
        if not self.is_complete:
            share = f"{100 * self.left:.2g} % of the torque"
            return f"no sum of the law's parts in any frame: {share} is none of them"
        said = [self.assumed] if self.assumed else []
        lacking = {name: pair for name, pair in self.changed.items() if _is_zero(pair[0], self)}
        other = {name: pair for name, pair in self.changed.items() if name not in lacking}
        if lacking:
            said.append("lacks " + ", ".join(_told(n, *pair) for n, pair in lacking.items()))
        for name, (found, expected) in other.items():
            said.append(f"has {_told(name, found, expected)}{_sign(found, expected)}")
        same = [n for n, (_, e) in self.coefficients.items() if n not in self.changed and e]
        if same and (lacking or other):
            said.append(f"the same as in the law: {', '.join(same)}")
        return "; ".join(said)


def _is_zero(found: float, of: Explanation) -> bool:
    return abs(found) <= CHANGED[of.real] * 10


def _told(name: str, found: float, expected: float) -> str:
    close = abs(found - expected) < 0.005
    one = f"{found:.6g}" if close else f"{found:.2f}".replace("-0.00", "0.00")
    return f"{name}: coefficient {one} of {expected:g}"


def _sign(found: float, expected: float) -> str:
    return (
        " (the sign is wrong)" if expected and abs(found + expected) < 0.005 * abs(expected) else ""
    )


def explained(question: Question, torque: Array, real: str) -> Explanation:
    """The explanation of a torque in C that assumes least, among those that leave nothing over.

    Where all leave something over, the one that leaves least.
    """
    usable = np.isfinite(torque).all(axis=1) & np.isfinite(question.torque()).all(axis=1)
    few = Question(
        question.loop,
        Told(*(np.asarray(part)[usable] for part in question.told)),
        {name: values[usable] for name, values in question.memory.items()},
    )
    found = [
        _explanation(changed, parts, torque[usable], words, real)
        for words, changed, pose, rest in _assumptions(few)
        for parts in parts_of(changed, pose, rest)
    ]
    complete = [each for each in found if each.is_complete]
    if complete:
        return min(complete, key=lambda each: each.cost)
    # An assumption has to earn its place by what it explains.
    return min(found, key=lambda each: each.left * (2.0 if each.assumed else 1.0))


def _explanation(
    question: Question, parts: Parts, torque: Array, assumed: str, real: str
) -> Explanation:
    law = sum((parts.expected[n] * column for n, column in parts.columns.items()), 0 * torque)
    columns = dict(parts.columns)
    expected = dict(parts.expected)
    symmetric = _symmetric(question)
    if np.abs(symmetric).max() > 0:
        columns[SYMMETRIC], expected[SYMMETRIC] = symmetric, 0.0
    difference = torque - law
    more = _least_squares(columns, difference)
    left = difference - sum((more[n] * column for n, column in columns.items()), 0 * torque)
    scale = np.sqrt((torque**2).mean()) or 1.0
    return Explanation(
        assumed,
        {name: (expected[name] + more[name], expected[name]) for name in columns},
        float(np.sqrt((left**2).mean()) / scale),
        real,
    )


def _symmetric(question: Question) -> Array:
    """What a stiffness returns of the part of the pose error that no rotation's error has.

    It is there where a difference to the transpose was forgotten, or is of the wrong matrices.
    """
    G, told = question.loop.group, question.told
    error = G.inverse(told.desired_pose) @ told.pose
    basis = np.stack([G.hat(row) for row in np.eye(G.dimension)])
    rotates = np.array([np.allclose(B, -B.T) for B in basis])
    even = (error + error.swapaxes(-1, -2)) / 2
    entries = np.einsum("kij,nij->nk", np.abs(basis), even) / 2 * rotates
    stiffness = told.tracking(G, question.loop.inertia, question.loop.gains, {}).stiffness
    return -apply_matrix(stiffness, entries)


# What may be assumed ------------------------------------------------------------------------------


def _assumptions(question: Question) -> list[tuple[str, Question, Told, Told]]:
    """What code may do otherwise: words, the law, and what its stiffness and its rest are told."""
    G, told, loop = question.loop.group, question.told, question.loop
    Q, Qd, V, Vd, A = told[1], told[3], told.velocity, told.desired_velocity, told[5]
    inverse_Q, inverse_Qd = G.inverse(Q), G.inverse(Qd)
    Q_L = inverse_Qd @ Q

    def carried(by: Array) -> Told:
        return told._replace(desired_velocity=G.Ad(by, Vd), desired_acceleration=G.Ad(by, A))

    if question.frame == "body":
        exchanged = told._replace(pose=Qd @ Q @ inverse_Qd)
        carrying = {
            "V_d is not carried to the body frame": carried(Q_L),
            "V_d is carried the wrong way, by Q_d⁻¹Q for Q⁻¹Q_d": carried(Q_L @ Q_L),
        }
    else:
        exchanged = told._replace(pose=inverse_Qd @ Q @ Qd)
        carrying = {"V_d is carried to the body frame": carried(G.inverse(Q_L))}
    other = "Q Q_d⁻¹ for Q_d⁻¹Q" if question.frame == "body" else "Q_d⁻¹Q for Q Q_d⁻¹"
    frames = f"the frames are exchanged: the pose error is in the other frame, {other}"
    everywhere = {
        "the pose is transposed": told._replace(pose=inverse_Q),
        "the desired pose is transposed": told._replace(desired_pose=inverse_Qd),
        "both poses are transposed": told._replace(pose=inverse_Q, desired_pose=inverse_Qd),
        "the pose and the desired pose are exchanged": told._replace(pose=Qd, desired_pose=Q),
        "V is in the spatial frame": told._replace(velocity=G.Ad(inverse_Q, V)),
        "V is in degrees": told._replace(velocity=np.radians(V)),
        "V is read in degrees": told._replace(velocity=np.degrees(V)),
    }
    found = [("", question, told, told), (frames, question, exchanged, told)]
    found.append((f"{frames}, wherever it occurs", question, exchanged, exchanged))
    found += [(words, question, told, rest) for words, rest in carrying.items()]
    found += [(f"{frames}; {words}", question, exchanged, rest) for words, rest in carrying.items()]
    found += [(words, question, each, each) for words, each in everywhere.items()]
    for name, gains in _transposed(loop.gains):
        found.append((f"{name} is transposed", _with(question, gains=gains), told, told))
    found += [(words, _with(question, controller=law), told, told) for words, law in _turned(loop)]
    for option, law in _without_options(loop.controller):
        found.append(
            (f"as without the option {option}", _with(question, controller=law), told, told)
        )
    if question.memory:
        s = told.tracking(G, loop.inertia, loop.gains, question.memory)
        control = loop.vehicle.control
        period, rates = (control.period if control else 0.0), loop.controller.memory_rate(s)
        later = {name: z + period * rates[name] for name, z in question.memory.items()}
        if period:
            words = "memory goes on before it is used, and not after"
            found.append((words, replace(question, memory=later), told, told))
    return found


def _turned(loop: ClosedLoop) -> list[tuple[str, Controller]]:
    """A member of the family with all its errors in the other frame."""
    law = loop.controller
    if not isinstance(law, Family):
        return []
    other: Frame = "body" if law.error == "spatial" else "spatial"
    turned = Family(law.gyroscopic, law.transport, law.connection, None, other, law.quadratic)
    return [(f"the frames are exchanged: all errors are in the {other} frame", turned)]


def _with(question: Question, **changes: object) -> Question:
    return replace(question, loop=replace(question.loop, **changes))  # type: ignore[arg-type]  # two kinds of values


def _transposed(gains: Gains) -> list[tuple[str, Gains]]:
    """Gains of which one is transposed, where that changes it."""
    found = []
    for name, turned in (
        ("kp", Gains(gains.K.swapaxes(-1, -2), gains.K_d)),
        ("kd", Gains(gains.K, gains.K_d.swapaxes(-1, -2))),
    ):
        if np.any(turned.K != gains.K) or np.any(turned.K_d != gains.K_d):
            found.append((name, turned))
    return found


def _without_options(law: Controller) -> list[tuple[str, Controller]]:
    """A law without one of the options that can be left out, such as a bound of an integral."""
    return [
        (each.name, replace(law, **{each.name: None}))
        for each in fields(law)
        if each.init and each.default is None and getattr(law, each.name) is not None
    ]
