"""URDF: links on joints, with Gazebo's plugins and the properties of gym-pybullet-drones."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.vehicles.bodies import (
    SIZES,
    Joint,
    Link,
    inverse,
    pose_of,
    rotation,
    unit,
    volume_of,
)
from eqt_cli.extensions.vehicles.elements import Element
from eqt_cli.extensions.vehicles.model import Model, base_of, mass_and_tensor
from eqt_cli.extensions.vehicles.request import Request

YES, NO = ("true", "yes", "1"), ("false", "no", "0")
"""What sdformat takes for true and false in a ``<gazebo>``."""


def read_urdf(root: Element, request: Request) -> Model:
    """Return the model of a URDF.

    Raises
    ------
    EqtError
        With file and line, for what is missing, wrong or not to be read.
    """
    links, joints = (_by_name(root, tag) for tag in ("link", "joint"))
    on: dict[str, Element] = {}
    for joint in joints.values():
        parent, child = (_end(joint, tag) for tag in ("parent", "child"))
        for end in (parent, child):
            if end not in links:
                raise EqtError(f"{joint.place}: no link '{end}'; correct the name")
        if child in on:
            raise EqtError(f"{joint.place}: link {child} has two parents; remove one joint")
        on[child] = joint
    poses, notes = _poses(root, links, on, request)
    plugins = [(plugin, "") for gazebo in root.all("gazebo") for plugin in gazebo.all("plugin")]
    plugins += [(block, "") for block in root.all("properties")]
    base = base_of(plugins, poses, next(iter(poses)))
    to_base = inverse(poses[base])
    bodies = {name: _link(name, links[name], to_base @ pose) for name, pose in poses.items()}
    parts = [(root, f"robot {root.attributes.get('name', '')}")]
    parts += _of_gazebo(root, bodies, request)
    held = {}
    for name, joint in joints.items():
        parent, child = _end(joint, "parent"), _end(joint, "child")
        if child in poses:
            axis = joint.one("axis")
            along = np.array([1.0, 0.0, 0.0])
            if axis is not None:
                along = unit(axis.numbers(3, "xyz", "1 0 0"), axis)
            along = bodies[child].pose[:3, :3] @ along
            kind = joint.attributes.get("type", "")
            held[name] = Joint(name, joint.place, kind, parent, child, along, joint)
    name = root.attributes.get("name", request.path.stem)
    return Model(name, "URDF", base, bodies, held, plugins, notes, parts)


def _of_gazebo(
    root: Element, bodies: dict[str, Link], request: Request
) -> Iterator[tuple[Element, str]]:
    """Yield the ``<gazebo>`` blocks of what is not left out; take gravity off their links."""
    for gazebo in root.all("gazebo"):
        of = gazebo.attributes.get("reference", "")
        if of and request.left_out(of):
            continue
        yield gazebo, of or "the robot"
        for tag, words in (("turnGravityOff", YES), ("gravity", NO)):
            said = gazebo.one(tag)
            if of in bodies and said is not None and said.text.strip().lower() in words:
                bodies[of].weightless = said.place


def _by_name(root: Element, tag: str) -> dict[str, Element]:
    """Return links or joints by their names, of which no two are equal."""
    elements: dict[str, Element] = {}
    for element in root.all(tag):
        name = _name(element)
        if name in elements:
            raise EqtError(
                f"{element.place}: a second {tag} is called {name}, the first is at "
                f"{elements[name].place}; rename one, or give the macro that makes both a prefix"
            )
        elements[name] = element
    return elements


def _poses(
    root: Element, links: dict[str, Element], on: dict[str, Element], request: Request
) -> tuple[dict[str, Array], list[str]]:
    """Return the poses of the links in the root link, which is the first; and what is left out."""
    roots = [name for name in links if name not in on]
    if len(roots) != 1:
        are = ", ".join(roots[:5]) or "none"
        raise EqtError(f"{root.place}: expected one link without a parent, got {are}; join them")
    below: dict[str, list[str]] = {}
    for child, joint in on.items():
        below.setdefault(_end(joint, "parent"), []).append(child)
    poses, notes, left = {roots[0]: np.eye(4)}, list[str](), [roots[0]]
    seen = set(roots)
    while left:
        here = left.pop()
        for child in below.get(here, ()):
            seen.add(child)
            if here in poses and not request.leaves_out(child):
                poses[child] = poses[here] @ _origin(on[child])
            else:
                notes.append(f"{links[child].place}: link {child} is left out, as --without asks")
                request.leave_out(child)
                request.leave_out(on[child].attributes["name"])
            left.append(child)
    for name, element in links.items():
        if name not in seen:
            raise EqtError(f"{element.place}: link {name} hangs on itself; correct its joints")
    return {name: poses[name] for name in links if name in poses}, notes


def _link(name: str, element: Element, pose: Array) -> Link:
    inertial = element.one("inertial")
    shapes = [_shape(collision, pose) for collision in element.all("collision")]
    if inertial is None:
        none, zero = np.zeros((3, 3)), pose[:3, 3]
        return Link(name, element.place, pose, 0.0, zero, none, shapes, element=element)
    mass, tensor = inertial.one("mass"), inertial.one("inertia")
    for tag, there in (("mass", mass), ("inertia", tensor)):
        if there is None:
            raise EqtError(f"{inertial.place}: link {name} has no <{tag}>; add it")
    assert mass is not None and tensor is not None
    value = float(mass.numbers(1, "value")[0])
    kg, J = mass_and_tensor(name, inertial, value, partial(_entry, tensor))
    middle = pose @ _origin(inertial)
    R = middle[:3, :3]
    J = R @ J @ R.T
    return Link(name, mass.place, pose, kg, middle[:3, 3], J, shapes, element=element)


def _entry(tensor: Element, key: str, default: float | None) -> float:
    return float(tensor.numbers(1, key, None if default is None else f"{default}")[0])


def _name(element: Element) -> str:
    if not element.attributes.get("name"):
        raise EqtError(f"{element.place}: <{element.tag}> has no name; give it one")
    return element.attributes["name"]


def _end(joint: Element, tag: str) -> str:
    end = joint.one(tag)
    return "" if end is None else end.attributes.get("link", "")


def _origin(element: Element) -> Array:
    """Return the pose of the ``<origin>`` of an element; the identity without one."""
    origin = element.one("origin")
    if origin is None:
        return np.eye(4)
    angles = origin.numbers(3, "rpy", "0 0 0")
    return pose_of(rotation(*angles), origin.numbers(3, "xyz", "0 0 0"))


def _shape(collision: Element, pose: Array) -> tuple[float, Array] | None:
    geometry = collision.one("geometry")
    centre = (pose @ _origin(collision))[:3, 3]
    if geometry is not None:
        for shape in geometry.children:
            if shape.tag == "box":
                return volume_of("box", [*shape.numbers(3, "size")]), centre
            if shape.tag in SIZES:
                sizes = [float(shape.numbers(1, key)[0]) for key in SIZES[shape.tag]]
                return volume_of(shape.tag, sizes), centre
    return None
