"""What all formats become: links of one body, what pushes it, and the water around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.vehicles.elements import LARGEST, Element

G0 = 9.80665
"""m/s², by which eqt weighs."""


@dataclass
class Link:
    """A link, in the axes of the body.

    Attributes
    ----------
    pose : (4, 4)
        Of its frame.
    mass, centre, inertia
        kg; its centre of mass, m; the tensor about that, kg m².
    shapes
        Volume, m³, and centre, m, of its collision shapes; None for one that is unknown.
    weightless
        Where the file says that no gravity acts on it; empty if it does.
    element
        In the file.
    """

    name: str
    place: str
    pose: Array
    mass: float
    centre: Array
    inertia: Array
    shapes: list[tuple[float, Array] | None] = field(default_factory=list)
    weightless: str = ""
    element: Element | None = None


@dataclass
class Joint:
    """A joint between two links, at 0; `axis` is in the axes of the body, `element` in the file."""

    name: str
    place: str
    kind: str
    parent: str
    child: str
    axis: Array
    element: Element | None = None


@dataclass
class Rotor:
    """A rotor or thruster, in the axes of the body.

    Attributes
    ----------
    at, along
        Where it pushes, m, and its direction.
    k
        Thrust over speed squared, N s²/rad²; None where the file does not say.
    turns
        Torque on the body about `along` for each N, m.
    low, high
        Limits of the thrust, N.
    speed
        Largest speed, rad/s.
    up, down
        Time constants of the lag as it speeds up and slows down, s; 0 where the file says that
        there is none.
    drag
        Drag coefficient, N s²/(rad m).
    number, command
        By which the rotors are sorted, and how the file numbers them, such as ``motorNumber 2``.
    """

    name: str
    place: str
    at: Array
    along: Array
    k: float | None = None
    turns: float = 0.0
    low: float | None = None
    high: float | None = None
    speed: float | None = None
    up: float | None = None
    down: float | None = None
    drag: float = 0.0
    number: float = 0.0
    command: str = ""

    @property
    def wrench(self) -> Array:
        """Torque about the origin and force of 1 N of thrust, ``(6,)``."""
        torque = np.cross(self.at, self.along) + self.turns * self.along
        return np.concatenate([torque, self.along])


@dataclass
class Wheel:
    """A reaction wheel: its axis in the body, its torque limit, N m, spin, kg m², and lag, s."""

    name: str
    place: str
    axis: Array
    limit: float | None
    inertia: float
    lag: float = 0.0


@dataclass
class Water:
    """Forces of the water at the origin of the body, torque before force, all positive.

    Attributes
    ----------
    added : (6, 6)
        Added mass.
    linear, quadratic : (6, 6)
        Drag over U, and over |U| U.
    buoyancy
        N; None where the file does not say.
    centre
        Of buoyancy, m.
    why
        Where the buoyancy comes from.
    """

    place: str
    added: Array
    linear: Array
    quadratic: Array
    buoyancy: float | None = None
    centre: Array | None = None
    why: str = ""


@dataclass
class Vehicle:
    """A rigid body with what pushes it.

    Attributes
    ----------
    form
        The format of the file, in words.
    base
        The link whose axes are those of the body.
    floats, is_marine, lifts
        Whether no gravity acts, water acts, or something not in the file lifts it.
    notes
        What was held, left out or assumed, with places.
    missing
        What the file does not say.
    """

    name: str
    form: str
    base: str
    links: list[Link]
    rotors: list[Rotor] = field(default_factory=list)
    wheels: list[Wheel] = field(default_factory=list)
    water: Water | None = None
    floats: bool = False
    is_marine: bool = False
    lifts: bool = False
    notes: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)

    def composed(self) -> tuple[float, Array, Array]:
        """Return mass, kg, centre of mass, m, and the tensor about it, kg m², of all links.

        Raises
        ------
        EqtError
            If there is no mass, or no body has such a tensor.
        """
        mass = sum(link.mass for link in self.links)
        if not mass > 0:
            raise EqtError(
                "no link has a mass; add <inertial> to the file, or give the numbers with "
                "--vehicle, --mass and --inertia"
            )
        parts = (link.mass * link.centre for link in self.links)
        centre = np.asarray(sum(parts, np.zeros(3))) / mass
        tensor = np.zeros((3, 3))
        for link in self.links:
            tensor += link.inertia + link.mass * spread(link.centre - centre)
        tensor = (tensor + tensor.T) / 2
        moments = np.linalg.eigvalsh(tensor)
        if not (moments[0] > 0 and moments[-1] < LARGEST):
            raise EqtError(
                "the links have the principal moments "
                f"{', '.join(f'{moment:.4g}' for moment in moments)} kg m² together; expected "
                "positive ones: correct <inertia>"
            )
        return mass, centre, tensor

    def allocation(self, origin: Array) -> Array:
        """Return B about a point: torque and force of 1 N of each rotor, ``(6, k)``."""
        columns = [rotor.wrench for rotor in self.rotors]
        moved = np.stack(columns, axis=-1) if columns else np.zeros((6, 0))
        moved[:3] -= np.cross(origin, moved[3:].T).T
        return moved


UPRIGHT = 1e-6
"""Sine of an angle of gravity from −z that digits of a file explain."""

ABOUT_G0 = 1e-2
"""m/s², by which 9.8 and 9.81 differ from G0."""


def gravity_notes(gravity: Array, place: str) -> list[str]:
    """Return what there is to say of the gravity of a world, m/s².

    Raises
    ------
    EqtError
        If it is not along −z, by which eqt weighs.
    """
    size = float(np.linalg.norm(gravity))
    if not size <= LARGEST:
        raise EqtError(f"{place}: gravity is {size:g} m/s^2; correct the file")
    if size == 0:
        return []
    if gravity[2] > 0 or np.linalg.norm(gravity[:2]) > UPRIGHT * size:
        numbers = ", ".join(f"{part:g}" for part in gravity)
        raise EqtError(
            f"{place}: gravity is [{numbers}] m/s^2, but eqt weighs along −z; turn the file so "
            "that z is up, or give --vehicle satellite with a gravity of 0"
        )
    if abs(size - G0) > ABOUT_G0:
        return [f"{place}: gravity is {size:g} m/s^2; eqt weighs with {G0}"]
    return []


def spread(r: Array) -> Array:
    """Return |r|² I − r rᵀ, by which 1 kg at r adds to a tensor."""
    return (r @ r) * np.eye(3) - np.outer(r, r)


def skew(r: Array) -> Array:
    """Return r^ with r^ x = r × x."""
    return np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])


def rotation(roll: float, pitch: float, yaw: float) -> Array:
    """Return Rz(yaw) Ry(pitch) Rx(roll), the convention of SDF and URDF."""
    (sr, sp, sy), (cr, cp, cy) = np.sin([roll, pitch, yaw]), np.cos([roll, pitch, yaw])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def pose_of(R: Array, p: Sequence[float] | Array) -> Array:
    """Return a pose by rotation and place, ``(4, 4)``."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, p
    return pose


def inverse(pose: Array) -> Array:
    """Return the inverse of a pose."""
    R = pose[:3, :3].T
    return pose_of(R, -R @ pose[:3, 3])


def unit(vector: Array, element: Element) -> Array:
    """Return a direction of length 1."""
    length = float(np.linalg.norm(vector))
    if not length > 0:
        raise EqtError(f"{element.place}: <{element.tag}>: expected a direction, got zeros")
    return vector / length


SIZES = {"sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length")}


def volume_of(tag: str, sizes: Sequence[float]) -> float:
    """Return the volume of a shape: a box by its sides, a cylinder by radius and length, …."""
    if tag == "box":
        return float(np.prod(sizes))
    radius, *length = sizes
    ball, along = 4 / 3 * np.pi * radius**3, np.pi * radius**2 * sum(length)
    return float(along if tag == "cylinder" else ball + along)
