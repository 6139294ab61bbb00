"""SDF 1.4 to 1.12: links, joints and frames of a model and of the models that it includes.

Poses are relative to the model, or to `relative_to`; a nested model has the scope ``name::``, one
that is merged has that of its parent.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.components.matrix_groups import rotation_of_quaternion
from eqt_cli.extensions.vehicles.bodies import (
    SIZES,
    Joint,
    Link,
    gravity_notes,
    inverse,
    pose_of,
    rotation,
    unit,
    volume_of,
)
from eqt_cli.extensions.vehicles.elements import TRUE, Element, read
from eqt_cli.extensions.vehicles.model import Model, base_of, check_joined, mass_and_tensor
from eqt_cli.extensions.vehicles.request import Request

MODEL = "__model__"
MOST_MODELS = 1000
"""Most included models, which may include each other many times."""

WEB = re.compile(r"\w+://[^/]*\.[^/]*/|https?:")


@dataclass
class _Part:
    """A model or an included model: its elements, scope and frame, and the version of its file."""

    element: Element
    scope: str
    frame: str
    version: tuple[int, ...]
    file: Path


class _Sdf:
    """Reads one file; `frames` has the parent and the pose of each frame."""

    def __init__(self, request: Request) -> None:
        self.request = request
        self.files: dict[Path, Element] = {}
        self.frames: dict[str, tuple[str, Array, str]] = {}
        self.carriers: dict[str, str] = {}
        self.links: dict[str, tuple[Element, _Part]] = {}
        self.joints: dict[str, tuple[Element, _Part]] = {}
        self.plugins: list[tuple[Element, str]] = []
        self.placed: list[tuple[str, str]] = []
        self.lost: list[str] = []
        self.notes: list[str] = []
        self.parts: list[tuple[Element, str]] = []
        self.floats = False
        self.count = 0
        self.resolved: dict[str, Array] = {MODEL: np.eye(4)}

    def root(self, file: Path) -> Element:
        """Return the root of a file, which is read once."""
        if file not in self.files:
            self.files[file] = read(file)
        return self.files[file]

    # Models and what they include ---------------------------------------------------------------

    def chosen(self) -> tuple[_Part, list[Path]]:
        """Return the one model of the file that moves."""
        file = self.request.path
        root = self.root(file)
        models: list[tuple[_Part, list[Path]]] = []
        worlds = list(root.all("world"))
        for place in (root, *worlds):
            for element in place.children:
                name = element.words("name") if element.tag == "include" else ""
                name = name or element.attributes.get("name", "")
                if element.tag not in ("model", "include") or self.request.leaves_out(name):
                    continue
                opened = self._opened(element, file, [file])
                if opened is None:
                    continue
                stated = element if element.one("static") is not None else opened[0].element
                if not stated.holds("static"):
                    models.append(opened)
        self._check_lost()
        if len(models) != 1:
            names = ", ".join(part.element.attributes.get("name", "?") for part, _ in models)
            have = f"{len(models)} models that move ({names})" if models else "no model that moves"
            raise EqtError(f"{file}: {have}; give the file of one, or leave others out: --without")
        for world in worlds:
            self._weigh(world)
            self.parts.append((world, "the world"))
            self.plugins += ((plugin, "") for plugin in world.all("plugin"))
        return models[0]

    def _weigh(self, world: Element) -> None:
        """Take the gravity of a world: none, or one along −z."""
        if (element := world.one("gravity")) is None:
            return
        gravity = element.numbers(3)
        self.floats = not gravity.any()
        self.notes += gravity_notes(gravity, element.place)

    def _opened(
        self, element: Element, file: Path, stack: list[Path]
    ) -> tuple[_Part, list[Path]] | None:
        """Return the model of a ``<model>`` or ``<include>``, with the files that led there."""
        if element.tag == "model":
            return _Part(element, "", MODEL, _version(self.root(file)), file), stack
        uri = element.words("uri")
        name = re.sub(r"^(model|file|package)://", "", uri).strip("/")
        if self.request.leaves_out(name, element.words("name") or name):
            self.notes.append(f"{element.place}: {uri} is left out, as --without asks")
            return None
        if WEB.match(uri):
            place = (element.one("uri") or element).place
            self.lost.append(
                f"{place}: {uri} is on the web; download it and give its folder with --models DIR"
            )
            return None
        there = self._file_of(name, file)
        if there is None:
            self.lost.append(
                f"{element.place}: {uri or 'no <uri>'} not found beside the file; give the folder "
                f"that has it with --models DIR, or leave it out: --without {name}"
            )
            return None
        if there in stack:
            raise EqtError(f"{element.place}: {uri} includes itself; remove one <include>")
        self.count += 1
        if self.count > MOST_MODELS:
            raise EqtError(f"{element.place}: more than {MOST_MODELS} models; flatten the file")
        root = self.root(there)
        inside = next((child for child in root.children if child.tag in ("model", "include")), None)
        if inside is None:
            raise EqtError(f"{element.place}: {uri}: {there} has no model; correct <uri>")
        return self._opened(inside, there, [*stack, there])

    def _file_of(self, name: str, file: Path) -> Path | None:
        """Return the file of an included model: beside the file, or in a folder of models."""
        beside = (self.request.path, file)
        folders = [folder for place in beside for folder in (place.parent, place.parent.parent)]
        for folder in dict.fromkeys((*folders, *self.request.models)):
            there = folder / name
            if there.is_file():
                return there.resolve()
            config = there / "model.config"
            listed = (
                [tag.text.strip() for tag in read(config).all("sdf")] if config.is_file() else []
            )
            for option in (*listed[::-1], "model.sdf", f"{there.name}.sdf"):
                for end in ("", ".jinja"):  # PX4 makes the one from the other
                    if (there / (option + end)).is_file():
                        return (there / (option + end)).resolve()
        return None

    def _check_lost(self) -> None:
        if self.lost:
            raise EqtError(self.lost[0], lines=self.lost[1:])

    def walk(self, part: _Part, stack: list[Path]) -> str:
        """Note links, joints, frames and plugins of a model; return its canonical link."""
        model, scope, frame = part.element, part.scope, part.frame
        self.parts.append((model, f"model {model.attributes.get('name', '')}"))
        first = ""
        for element in model.children:
            tag, name = element.tag, scope + element.attributes.get("name", "")
            if tag in ("link", "joint", "frame") and not element.attributes.get("name"):
                raise EqtError(f"{element.place}: <{tag}> has no name; give it one")
            if tag == "link":
                if self.request.leaves_out(name, element.attributes["name"]):
                    self.notes.append(
                        f"{element.place}: link {name} is left out, as --without asks"
                    )
                    continue
                self.links[name] = element, part
                self.carriers[name] = name
                self._place(name, element, frame, part)
                first = first or name
            elif tag == "joint":
                self.joints[name] = element, part
                if not (element.words("parent") and element.words("child")):
                    raise EqtError(f"{element.place}: joint {name} needs <parent> and <child>")
                child = self._inside(part, element.words("child"))
                self.carriers[name] = child
                self._place(name, element, child, part)
            elif tag == "frame":
                on = element.attributes.get("attached_to", "")
                self.carriers[name] = self._inside(part, on) if on else frame
                self._place(name, element, self.carriers[name], part)
            elif tag in ("model", "include"):
                opened = self._opened(element, part.file, stack)
                inner = opened and self._nested(element, opened[0], part, opened[1])
                first = first or inner or ""
            elif tag == "plugin":
                self.plugins.append((element, scope))
        named = model.attributes.get("canonical_link", "")
        self.carriers[frame] = canonical = self._inside(part, named) if named else first
        return canonical

    def _nested(self, element: Element, inner: _Part, part: _Part, stack: list[Path]) -> str:
        """Note a nested or included model; return its canonical link."""
        model = inner.element
        name = element.words("name") if element.tag == "include" else ""
        name = name or model.attributes.get("name", "")
        merged = element.attributes.get("merge") in TRUE
        frame = f"{part.scope}{name}::{MODEL}{'#' if merged else ''}"
        placed, on = element, element.words("placement_frame")
        on = on or model.attributes.get("placement_frame", "")
        if element.one("pose") is None and element.tag == "include" and not on:
            placed = model
        scope = part.scope if merged else f"{part.scope}{name}::"
        self._place(frame, placed, part.frame, part)
        if on:
            self.placed.append((frame, scope + on))
        if not merged:
            self.carriers[f"{part.scope}{name}"] = frame
            self._place(f"{part.scope}{name}", None, frame, part)
        nested = _Part(model, scope, frame, inner.version, inner.file)
        canonical = self.walk(nested, stack)
        if element.tag == "include":
            self.parts.append((element, f"the included {name}"))
            self.plugins += ((plugin, scope) for plugin in element.all("plugin"))
        return canonical

    # Frames -------------------------------------------------------------------------------------

    def _inside(self, part: _Part, name: str) -> str:
        """Return the whole name of a frame that an element of a model names."""
        if name == MODEL:
            return part.frame
        return part.scope + name if name != "world" else "world"

    def _place(self, name: str, element: Element | None, default: str, part: _Part) -> None:
        place = (element or part.element).place
        if name in self.frames:
            raise EqtError(f"{place}: two elements are called {name}; rename one")
        pose = None if element is None else element.one("pose")
        relative = "" if pose is None else pose.attributes.get("relative_to", "")
        if pose is not None and not relative:
            relative = pose.attributes.get("frame", "")  # up to 1.6
        to = self._inside(part, relative) if relative else default
        place = place if pose is None else pose.place
        self.frames[name] = to, _pose(pose), place

    def relative(self, name: str, root: str = MODEL) -> Array:
        """Return the pose of a frame in another one, `root`, that it hangs on."""
        chain: list[str] = []
        done = self.resolved if root == MODEL else {root: np.eye(4)}
        here, place = name, ""
        while here not in done:
            if here not in self.frames:
                at = place or self.request.path
                if gone := self.request.left_out(here):
                    raise EqtError(
                        f"{at}: a pose here is in '{here}', which --without {gone} leaves out; "
                        "leave this out, too, or keep it"
                    )
                raise EqtError(f"{at}: no link, joint or frame '{here}'; correct the name")
            if len(chain) > len(self.frames):
                circle = chain[chain.index(here) : len(chain) - chain[::-1].index(here)]
                names = " → ".join(dict.fromkeys(circle[:5]))
                raise EqtError(
                    f"{place}: frames hang on each other in a circle: {names}; correct one's "
                    "relative_to or attached_to"
                )
            chain.append(here)
            here, _, place = self.frames[here]
        pose = done[here]
        for frame in reversed(chain):
            done[frame] = pose = pose @ self.frames[frame][1]
        return pose

    def set_placements(self) -> None:
        """Turn poses of placement frames into those of their models, inner ones first."""
        for frame, on in reversed(self.placed):
            to, pose, place = self.frames[frame]
            self.frames[frame] = to, pose @ inverse(self.relative(on, frame)), place

    def link_of(self, name: str, place: str) -> str:
        """Return the link that a frame belongs to."""
        for _ in range(len(self.carriers) + 1):
            carrier = self.carriers.get(name, "")
            if carrier == name:
                return name
            name = carrier
        raise EqtError(f"{place}: no link '{name}'; correct the name")

    def drop_joints(self) -> None:
        """Drop the joints that hold what is left out."""
        if not self.request.without:
            return
        for name, (element, part) in list(self.joints.items()):
            ends = [self._inside(part, element.words(end)) for end in ("parent", "child")]
            if any(end not in self.carriers and end != "world" for end in ends):
                self.notes.append(f"{element.place}: joint {name} is left out, too")
                self.request.leave_out(name)
                del self.joints[name], self.carriers[name], self.frames[name]

    # Links and joints in the axes of the base ---------------------------------------------------

    def link(self, name: str, to_base: Array) -> Link:
        """Return a link with its mass."""
        element, _ = self.links[name]
        pose = to_base @ self.relative(name)
        inertial = element.one("inertial")
        if inertial is None:
            raise EqtError(
                f"{element.place}: link {name} has no <inertial>, which Gazebo takes for 1 kg and "
                f"1 kg m²; add it, or leave the link out: --without {name}"
            )
        if inertial.attributes.get("auto") in TRUE:
            raise EqtError(
                f"{inertial.place}: link {name} has its mass from its shapes (auto); write <mass> "
                "and <inertia>, as Gazebo shows them"
            )
        tensor = inertial.one("inertia")
        if tensor is None:
            raise EqtError(f"{inertial.place}: link {name} has no <inertia>; add it")
        if inertial.one("mass") is None:
            raise EqtError(f"{inertial.place}: link {name} has no <mass>; add it")
        if inertial.one("fluid_added_mass") is not None:
            self.notes.append(f"{inertial.place}: <fluid_added_mass> is left out")
        mass, J = mass_and_tensor(name, inertial, inertial.number("mass"), tensor.number)
        middle = pose @ _pose(inertial.one("pose"))
        R = middle[:3, :3]
        shapes = [_shape(collision, pose) for collision in element.all("collision")]
        gravity = element.one("gravity")
        weightless = gravity.place if gravity and gravity.text.strip() in ("0", "false") else ""
        place = (inertial.one("mass") or inertial).place
        J = R @ J @ R.T
        return Link(name, place, pose, mass, middle[:3, 3], J, shapes, weightless, element)

    def joint(self, name: str, to_base: Array) -> Joint:
        """Return a joint with its axis."""
        element, part = self.joints[name]
        axis, xyz = element.one("axis"), element.one("axis/xyz")
        direction, frame = np.array([0.0, 0.0, 1.0]), name
        if axis is not None and xyz is not None:
            direction = unit(xyz.numbers(3), xyz)
            in_model = axis.holds("use_parent_model_frame") or part.version < (1, 5)
            if in_model or xyz.attributes.get("expressed_in"):
                frame = self._inside(part, xyz.attributes.get("expressed_in") or MODEL)
        R = (to_base @ self.relative(frame))[:3, :3]
        ends = [self._inside(part, element.words(end)) for end in ("parent", "child")]
        parent, child = (
            end if end == "world" else self.link_of(end, element.place) for end in ends
        )
        kind = element.attributes.get("type", "")
        return Joint(name, element.place, kind, parent, child, R @ direction, element)


def read_sdf(request: Request) -> Model:
    """Return the one model that moves of an SDF file.

    Raises
    ------
    EqtError
        With file and line, for what is missing, wrong or not to be read.
    """
    sdf = _Sdf(request)
    part, stack = sdf.chosen()
    canonical = sdf.walk(part, stack)
    sdf._check_lost()
    if not sdf.links:
        raise EqtError(f"{part.element.place}: the model has no link; give the file that has them")
    sdf.set_placements()
    sdf.drop_joints()
    base = sdf.link_of(canonical, part.element.place)
    base = base_of(sdf.plugins, sdf.links, base)
    to_base = inverse(sdf.relative(base))
    links = {name: sdf.link(name, to_base) for name in sdf.links}
    joints = {name: sdf.joint(name, to_base) for name in sdf.joints}
    check_joined(links, joints, base, request.without)
    version = ".".join(map(str, part.version))
    name = part.element.attributes.get("name", request.path.stem)
    form = f"SDF {version}"
    return Model(name, form, base, links, joints, sdf.plugins, sdf.notes, sdf.parts, sdf.floats)


def _version(root: Element) -> tuple[int, ...]:
    text = root.attributes.get("version", "1.6")
    if not re.fullmatch(r"\d{1,3}(\.\d{1,3})+", text):
        raise EqtError(f"{root.place}: expected a version such as 1.9, got '{text[:20]}'")
    return tuple(int(number) for number in text.split("."))


def _pose(element: Element | None) -> Array:
    """Return the pose of a ``<pose>``; the identity without one."""
    if element is None or not element.text.strip():
        return np.eye(4)
    form = element.attributes.get("rotation_format", "euler_rpy")
    if form == "quat_xyzw":
        numbers = element.numbers(7)
        return pose_of(rotation_of_quaternion(unit(numbers[3:], element)), numbers[:3])
    if form != "euler_rpy":
        raise EqtError(f"{element.place}: rotation_format: expected euler_rpy or quat_xyzw")
    numbers = element.numbers(6)
    angles = np.radians(numbers[3:]) if element.attributes.get("degrees") in TRUE else numbers[3:]
    return pose_of(rotation(*angles), numbers[:3])


def _shape(collision: Element, pose: Array) -> tuple[float, Array] | None:
    """Return the volume and the centre of a collision shape; None for a mesh."""
    geometry = collision.one("geometry")
    centre = (pose @ _pose(collision.one("pose")))[:3, 3]
    if geometry is not None:
        for shape in geometry.children:
            if shape.tag == "box":
                size = shape.one("size") or shape
                return volume_of("box", [*size.numbers(3)]), centre
            if shape.tag in SIZES:
                return volume_of(shape.tag, [shape.number(key) for key in SIZES[shape.tag]]), centre
    return None
