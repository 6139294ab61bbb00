"""What a compiled MJCF model says and eqt leaves out: notes, or refusals with their lines.

MuJoCo resolves default classes and included files first, so that its compiled model is asked, not
the text of the file. Numbers that an older MuJoCo does not have are those that change nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.vehicles.attributes import kind_of, shortest
from eqt_cli.extensions.vehicles.bodies import Vehicle, gravity_notes
from eqt_cli.extensions.vehicles.elements import Element

ON_JOINTS = {
    "damping": "dof_damping",
    "armature": "dof_armature",
    "frictionloss": "dof_frictionloss",
    "stiffness": "jnt_stiffness",
}
"""Attributes of joints, and where the compiled model has them."""


@dataclass
class Checks:
    """Reads what acts on the bodies `held` together, of which `base` is free.

    Attributes
    ----------
    place
        Returns the file and line of a body, joint, actuator, tendon or equality by its number.
    root
        The text of the file as elements.
    """

    mujoco: Any
    model: Any
    base: int
    held: list[int]
    place: Callable[[str, int], str]
    root: Element

    def flag(self, name: str) -> bool:
        """Whether something is switched off by ``<flag>``."""
        return bool(
            self.model.opt.disableflags & int(getattr(self.mujoco.mjtDisableBit, f"mjDSBL_{name}"))
        )

    def number(self, name: str, k: int) -> float:
        """Return a number of the compiled model; 0 if this MuJoCo has none of this name."""
        there = getattr(self.model, name, None)
        return 0.0 if there is None else float(np.ravel(there[k])[0])

    def line_of(self, tag: str, attribute: str) -> str:
        """Return the line of an attribute that stands in a file once; else the file."""
        for element in self.root.walk():
            if element.tag == tag and attribute in element.attributes:
                return element.place
        return self.place("file", 0)

    def check_world(self, v: Vehicle, kind: str | None) -> None:
        """Note what the world and the bodies say.

        Raises
        ------
        EqtError
            With the line of what changes the motion, and eqt does not read.
        """
        model, place = self.model, self.place("file", 0)
        gravity = np.zeros(3) if self.flag("GRAVITY") else np.array(model.opt.gravity)
        v.floats = not gravity.any()
        if kind != "satellite":
            v.notes += gravity_notes(gravity, self.line_of("option", "gravity"))
        if model.opt.density or model.opt.viscosity:
            what = "density, viscosity" + (", wind" if np.any(model.opt.wind) else "")
            v.notes.append(f"{place}: drag by <option {what}> is left out")
        if self.flag("ACTUATION"):
            line = self.line_of("flag", "actuation")
            raise EqtError(f"{line}: <flag> switches all actuators off; remove actuation")
        for b in self.held:
            what = f"{self.place('body', b)}: body {model.body(b).name or b}"
            if model.body_gravcomp[b] and not v.floats and kind != "satellite":
                raise EqtError(
                    f"{what} has gravcomp {model.body_gravcomp[b]:g}, which takes weight off it; "
                    "eqt weighs the whole body: remove gravcomp"
                )
            if self.number("body_plugin", b) >= 0 and model.nplugin:
                raise EqtError(f"{what} has a plugin, whose forces eqt does not read; remove it")
        if any(int(b) in self.held for b in getattr(model, "flex_vertbodyid", ())):
            raise EqtError(f"{place}: a flex is on the vehicle, which is no rigid body; remove it")
        self._check_free_joint(v)

    def check_ties(self, v: Vehicle) -> None:
        """Note what joints, tendons and equalities say, and what eqt does not know.

        Raises
        ------
        EqtError
            With the line of what ties the vehicle to something else.
        """
        v.notes += self._of_joints(v)
        v.notes += self._of_ties()
        v.notes += self._unknown()

    def _on(self, j: int) -> dict[str, float]:
        """Return the attributes of a joint that change its motion, where they are not 0."""
        at = {"dof": int(self.model.jnt_dofadr[j]), "jnt": j}
        values = {name: self.number(where, at[where[:3]]) for name, where in ON_JOINTS.items()}
        return {name: value for name, value in values.items() if value}

    def _check_free_joint(self, v: Vehicle) -> None:
        """Refuse springs, friction and armature of the free joint; note its damping."""
        j = int(self.model.body_jntadr[self.base])
        for name, value in self._on(j).items():
            said = f"{self.place('joint', j)}: {name} {value:g} of the free joint"
            if name == "damping":
                v.notes.append(f"{said} is left out: N s/m and N m s of drag (kind: drag)")
            else:
                raise EqtError(
                    f"{said} changes the motion, and eqt does not read it; write <freejoint/>: no "
                    "default class applies to it"
                )

    def _of_joints(self, v: Vehicle) -> Iterator[str]:
        """Yield notes on joints of the vehicle that can move; wheels turn, others are held."""
        model, wheels = self.model, {wheel.name for wheel in v.wheels}
        loose = []
        for j in range(model.njnt):
            if int(model.jnt_bodyid[j]) not in self.held or int(model.jnt_type[j]) == 0:
                continue
            name, place = model.joint(j).name or f"joint {j}", self.place("joint", j)
            values = [f"{key} {value:g}" for key, value in self._on(j).items()]
            if name not in wheels:
                loose.append(name)
            limits = [("range", model.jnt_limited, model.jnt_range)]
            if name not in wheels:  # whose torque is limited by it
                limits.append(("actuatorfrcrange", model.jnt_actfrclimited, model.jnt_actfrcrange))
            for word, is_limited, ranges in limits:
                if is_limited[j]:
                    values.append(f"{word} {ranges[j, 0]:g} to {ranges[j, 1]:g}")
            if values:
                yield f"{place}: {', '.join(values)} of {name} are left out"
        if loose:
            yield f"{self.place('file', 0)}: joints that can move are held at 0: {', '.join(loose)}"

    def _of_ties(self) -> Iterator[str]:
        """Yield notes on tendons and equalities within the vehicle; refuse those to others."""
        model, wrap, equal = self.model, self.mujoco.mjtWrap, self.mujoco.mjtEq
        bodies = {
            int(wrap.mjWRAP_JOINT): model.jnt_bodyid,
            int(wrap.mjWRAP_SITE): model.site_bodyid,
            int(wrap.mjWRAP_SPHERE): model.geom_bodyid,
            int(wrap.mjWRAP_CYLINDER): model.geom_bodyid,
        }
        for k in range(model.ntendon):
            start = int(model.tendon_adr[k])
            parts = range(start, start + int(model.tendon_num[k]))
            ends = [
                int(bodies[int(model.wrap_type[w])][model.wrap_objid[w]])
                for w in parts
                if int(model.wrap_type[w]) in bodies
            ]
            yield from self._tie(f"{self.place('tendon', k)}: a tendon", ends)
        for k in range(model.neq):
            kind, objects = int(model.eq_type[k]), (model.eq_obj1id[k], model.eq_obj2id[k])
            if not model.eq_active0[k] or kind not in (
                int(equal.mjEQ_CONNECT),
                int(equal.mjEQ_WELD),
                int(equal.mjEQ_JOINT),
            ):
                continue
            of = getattr(model, "eq_objtype", None)
            if kind == int(equal.mjEQ_JOINT):
                ends = [int(model.jnt_bodyid[o]) for o in objects if o >= 0]
            elif of is not None and int(of[k]) == int(self.mujoco.mjtObj.mjOBJ_SITE):
                ends = [int(model.site_bodyid[o]) for o in objects]
            else:
                ends = [int(o) for o in objects]
            yield from self._tie(f"{self.place('equality', k)}: an equality", ends)

    def _tie(self, what: str, ends: list[int]) -> Iterator[str]:
        """Yield a note on a tie within the vehicle.

        Raises
        ------
        EqtError
            For one between the vehicle and something else.
        """
        inside = [end in self.held for end in ends]
        if all(inside) and inside:
            yield f"{what} between joints or bodies, which are held, is left out"
        elif any(inside):
            raise EqtError(
                f"{what} ties the vehicle to another body, or to the world; eqt does not read it; "
                "remove it"
            )

    def _unknown(self) -> Iterator[str]:
        """Yield attributes of a newer MuJoCo than the table of attributes knows."""
        left = [(self.root, self.root.tag)]
        while left:
            element, path = left.pop()
            for name in element.attributes:
                if kind_of("MJCF", place := mjcf_path(f"{path}/{name}")) is None:
                    yield f"{element.place}: eqt does not know {place}: left out"
            left += [(child, f"{path}/{child.tag}") for child in element.children]


def mjcf_path(path: str) -> str:
    """Return a path of the table: the world is a body, and a default is as what it is for."""
    parts = path.replace("worldbody", "body").split("/")
    if "default" in parts[:-2]:
        last = len(parts) - parts[::-1].index("default")
        parts = parts[last:]
        if len(parts) == 1:  # of a class within a class
            return f"default/{parts[0]}"
        if section := SECTIONS.get(parts[0]):
            return "/".join([section, *parts])
        if kind_of("MJCF", f"actuator/{'/'.join(parts)}"):
            return "/".join(["actuator", *parts])
    elif len(parts) > 2 and parts[1] not in ("body", "actuator", "default", "include"):
        return "/".join(parts[1:])
    return shortest("MJCF", "/".join(parts))


SECTIONS = {
    "mesh": "asset",
    "texture": "asset",
    "material": "asset",
    "pair": "contact",
    "camera": "body",
    "light": "body",
}
"""The sections of what has default classes."""
