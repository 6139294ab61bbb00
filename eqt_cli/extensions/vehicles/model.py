"""A model of SDF or URDF: links, joints and plugins, whatever the format."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, suggestion
from eqt_cli.extensions.vehicles.bodies import Joint, Link
from eqt_cli.extensions.vehicles.elements import Element

Entry = Callable[[str, float | None], float]
"""Returns an entry of a tensor by its name, or a default; None for one that must be there."""

WATER = "hydrodynamics"
UPPER = ("xx", "xy", "xz", "yy", "yz", "zz")


@dataclass
class Model:
    """Links and joints of a file, in the axes of its base link, and what acts on them.

    Attributes
    ----------
    parts
        Elements that hold links and joints, with their names.
    floats
        Whether the world of the file has no gravity.
    """

    name: str
    form: str
    base: str
    links: dict[str, Link]
    joints: dict[str, Joint]
    plugins: list[tuple[Element, str]]
    notes: list[str] = field(default_factory=list)
    parts: list[tuple[Element, str]] = field(default_factory=list)
    floats: bool = False

    def named(self, kind: str, scope: str, name: str, place: str) -> str:
        """Return the whole name of a link or joint that a plugin names."""
        names = self.links if kind == "link" else self.joints
        for whole in (scope + name, name):
            if whole in names:
                return whole
        raise EqtError(f"{place}: no {kind} '{name}'{suggestion(name, names)}; correct the name")


def is_plugin(element: Element, name: str) -> bool:
    """Whether a plugin is of a kind, by its file or its name."""
    of = f"{element.attributes.get('filename', '')} {element.attributes.get('name', '')}"
    return re.search(name, of, re.IGNORECASE) is not None


def base_of(plugins: list[tuple[Element, str]], links: Collection[str], canonical: str) -> str:
    """Return the link in whose axes the water acts, whose drag over |U| U cannot be moved."""
    wet = [
        scope + plugin.words("link_name") for plugin, scope in plugins if is_plugin(plugin, WATER)
    ]
    if len(wet) > 1:
        raise EqtError(
            f"{plugins[0][0].place}: the water acts on {', '.join(wet)}; of one link alone"
        )
    return wet[0] if wet and wet[0] in links else canonical


def mass_and_tensor(name: str, element: Element, mass: float, entry: Entry) -> tuple[float, Array]:
    """Return the mass and the tensor of a link, whose entries have the names ixx, ixy, …."""
    if mass < 0:
        raise EqtError(
            f"{element.place}: link {name}: expected a mass of at least 0 kg, got {mass:g}"
        )
    upper = [entry(f"i{key}", None if key[0] == key[1] else 0.0) for key in UPPER]
    xx, xy, xz, yy, yz, zz = upper
    if min(xx, yy, zz) < 0:
        raise EqtError(
            f"{element.place}: link {name}: expected moments of at least 0 kg m², got {upper}"
        )
    return mass, np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def check_joined(
    links: dict[str, Link], joints: dict[str, Joint], base: str, without: Sequence[str]
) -> None:
    """Refuse links that no chain of joints holds to the base: they are other bodies."""
    held = _links_held_to(base, joints)
    for name, link in links.items():
        if name not in held:
            remedy = f"add the joint, or leave the link out: --without {name}"
            if without:
                remedy += f"; if --without {', '.join(without)} took what held it, keep that"
            raise EqtError(
                f"{link.place}: no joint holds link {name} to {base}, so that it is another body; "
                f"{remedy}"
            )


def _links_held_to(base: str, joints: dict[str, Joint]) -> set[str]:
    """Return the base and all links that joints hold to it, but over the world."""
    neighbours: dict[str, list[str]] = {}
    for joint in joints.values():
        neighbours.setdefault(joint.parent, []).append(joint.child)
        neighbours.setdefault(joint.child, []).append(joint.parent)
    held, waiting = {base}, [base]
    while waiting:
        for link in neighbours.get(waiting.pop(), ()):
            if link not in held and link != "world":
                held.add(link)
                waiting.append(link)
    return held
