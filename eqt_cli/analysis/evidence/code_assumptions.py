"""Typical mistakes in code of a law: frames, transposes, axes, units, options."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.analysis.evidence.code_question import Question
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.closed_loop.law_input import LawInput
from eqt_cli.controllers import Controller
from eqt_cli.controllers.family import Family, Frame
from eqt_cli.core.arrays import Array
from eqt_cli.mechanics.tracking import Gains


class Assumption(NamedTuple):
    """An assumed mistake, with the law that the code then follows.

    Attributes
    ----------
    words
        The mistake in words; "" if none is assumed.
    question
        The law and its inputs.
    pose, rest
        Inputs of the stiffness, and of all other parts.
    """

    words: str
    question: Question
    pose: LawInput
    rest: LawInput


def assumptions(question: Question) -> Iterator[Assumption]:
    """Yield no mistake first, and then the known mistakes in code of a law."""
    inputs = question.inputs
    yield Assumption("", question, inputs, inputs)
    yield from _of_frames(question)
    for words, each in _everywhere(question).items():
        yield Assumption(words, question, each, each)
    for words, changed in _other_laws(question):
        yield Assumption(words, changed, inputs, inputs)


def _of_frames(question: Question) -> Iterator[Assumption]:
    """Yield pose errors in the other frame, and desired velocities in a wrong frame or axis."""
    G, inputs = question.loop.group, question.inputs
    Q, Qd = inputs.pose, inputs.desired_pose
    Q_L = G.inverse(Qd) @ Q
    if question.frame == "body":
        exchanged, named = inputs._replace(pose=Qd @ Q @ G.inverse(Qd)), "Q Q_d⁻¹ for Q_d⁻¹Q"
        carrying = {
            "V_d is not carried to the body frame": Q_L,
            "V_d is carried the wrong way, by Q_d⁻¹Q for Q⁻¹Q_d": Q_L @ Q_L,
        }
    else:
        exchanged, named = inputs._replace(pose=G.inverse(Qd) @ Q @ Qd), "Q_d⁻¹Q for Q Q_d⁻¹"
        carrying = {"V_d is carried to the body frame": G.inverse(Q_L)}
    frames = f"the frames are exchanged: the pose error is in the other frame, {named}"
    variants = {"": inputs} | {w: _carried(question, inputs, by) for w, by in carrying.items()}
    yield Assumption(f"{frames}, wherever it occurs", question, exchanged, exchanged)
    for words, rest in variants.items():
        yield Assumption(f"{frames}; {words}" if words else frames, question, exchanged, rest)
        if words:
            yield Assumption(words, question, inputs, rest)
    for axis, kept in enumerate(np.eye(G.dimension) if G.dimension > 1 else ()):
        read = inputs._replace(
            desired_velocity=kept * inputs.desired_velocity,
            desired_acceleration=kept * inputs.desired_acceleration,
        )
        alone = f"V_d is read on axis {axis + 1} only"
        yield Assumption(alone, question, inputs, read)
        for words, by in carrying.items():
            rest = _carried(question, read, by)
            yield Assumption(f"{alone}; {words}", question, inputs, rest)


def _carried(question: Question, inputs: LawInput, by: Array) -> LawInput:
    """Return the inputs with desired velocity and acceleration in another frame."""
    G = question.loop.group
    return inputs._replace(
        desired_velocity=G.Ad(by, inputs.desired_velocity),
        desired_acceleration=G.Ad(by, inputs.desired_acceleration),
    )


def _everywhere(question: Question) -> dict[str, LawInput]:
    """Return the inputs with a value that the code reads wrongly everywhere."""
    G, inputs = question.loop.group, question.inputs
    Q, Qd, V = inputs.pose, inputs.desired_pose, inputs.velocity
    turned, desired = G.inverse(Q), G.inverse(Qd)
    return {
        "the pose is transposed": inputs._replace(pose=turned),
        "the desired pose is transposed": inputs._replace(desired_pose=desired),
        "both poses are transposed": inputs._replace(pose=turned, desired_pose=desired),
        "the pose and the desired pose are exchanged": inputs._replace(pose=Qd, desired_pose=Q),
        "V is carried to the spatial frame": inputs._replace(velocity=G.Ad(Q, V)),
        "V is carried from the spatial frame": inputs._replace(velocity=G.Ad(turned, V)),
        "V is converted to degrees": inputs._replace(velocity=np.degrees(V)),
        "V is converted from degrees": inputs._replace(velocity=np.radians(V)),
    }


def _other_laws(question: Question) -> Iterator[tuple[str, Question]]:
    """Yield the law with transposed gains, another frame, a missing option or later memory."""
    loop = question.loop
    for name, gains in _transposed(loop.gains):
        yield f"{name} is transposed", _with(question, gains=gains)
    for law in _in_other_frame(loop):
        words = f"the frames are exchanged: all errors are in the {law.error} frame"
        yield words, _with(question, controller=law)
    for option, without in _without_options(loop.controller):
        yield f"the option {option} is missing", _with(question, controller=without)
    control = loop.vehicle.control
    if question.memory and control is not None:
        s = question.inputs.tracking(loop.group, loop.inertia, loop.gains, question.memory)
        rates = loop.controller.memory_rate(s)
        later = {name: z + control.period * rates[name] for name, z in question.memory.items()}
        words = "memory goes on before it is used, and not after"
        yield words, replace(question, memory=later)


def _with(question: Question, **changes: Any) -> Question:
    return replace(question, loop=replace(question.loop, **changes))


def _transposed(gains: Gains) -> Iterator[tuple[str, Gains]]:
    """Yield the gains with one of them transposed, if that changes it."""
    K, K_d = gains.K.swapaxes(-1, -2), gains.K_d.swapaxes(-1, -2)
    if np.any(K != gains.K):
        yield "kp", Gains(K, gains.K_d)
    if np.any(K_d != gains.K_d):
        yield "kd", Gains(gains.K, K_d)


def _in_other_frame(loop: ClosedLoop) -> Iterator[Family]:
    """Yield a member of the family with all its errors in the other frame."""
    law = loop.controller
    if isinstance(law, Family):
        frame: Frame = "body" if law.error == "spatial" else "spatial"
        weights = law.gyroscopic, law.transport, law.connection
        yield Family(*weights, error=frame, quadratic=law.quadratic)


def _without_options(law: Controller) -> Iterator[tuple[str, Controller]]:
    """Yield the law without one of its optional options, such as the bound of an integral."""
    for each in fields(law):
        if each.init and each.default is None and getattr(law, each.name) is not None:
            yield each.name, replace(law, **{each.name: None})
